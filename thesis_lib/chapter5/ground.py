"""The terrain of section 5.1, and how robots start on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import ArrayLike
from scipy.ndimage import maximum_filter

from thesis_lib.edition.criteria import exact, judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion, effect_of
from thesis_lib.edition.plots import COLOURS
from thesis_lib.locomotion.batch import BatchTask
from thesis_lib.locomotion.height_field import Extent, HeightField
from thesis_lib.locomotion.robots import ROBOTS, Ground
from thesis_lib.locomotion.terrain import PATCH, PRESETS, hill_maps
from thesis_lib.stats import mean_ci

SQUARE: Extent = ((-20.0, 20.0), (-20.0, 20.0))
"""Map on which terrain is measured [m]."""


# ------------------------------------------------------------------------------------- maps
@dataclass(frozen=True)
class Config:
    """How many maps of 40 m x 40 m are measured for each kind of terrain."""

    n_maps: int = 20


@dataclass(frozen=True)
class Map:
    """One map."""

    preset: str
    """author (code) or text (section 5.1 in metres)."""
    task: str
    """For which robot."""
    difficulty: float
    """d."""
    colour_map: bool
    """Whether the heights went through the colour map of the author's images."""
    map: int
    """Index of the map."""
    metres: float
    """Metres in a unit of length."""
    highest: float
    """Highest node [m]."""
    median_height: float
    """Median over the map [m]."""
    median_slope: float
    """Median over the map's triangles, rise over run."""
    p95_slope: float
    """95th percentile of the same."""
    steepest_flank: float
    """Slope of the narrowest possible hill's flank, without colour map."""
    tops: float
    """Visible hilltops per square unit, missing with the colour map."""
    below_floor: float
    """Share of nodes below world z = 0."""
    node_spacing: float
    """Metres."""


def tops_per_area(field: HeightField) -> float:
    """Visible hilltops per square metre: nodes higher than their eight neighbours.

    Nodes on the map's edge are left out, with their area.
    """
    inner = field.heights[1:-1, 1:-1]
    highest = maximum_filter(field.heights, size=3)[1:-1, 1:-1]
    dx, dy = field.resolution
    return float((inner == highest).sum() / (inner.size * dx * dy))


@experiment(
    "ch5-terrain",
    item="Section 5.1, Hills",
    smoke=Config(n_maps=2),
    book=Config(),
    thesis=Config(n_maps=100),
    seconds=3,
)
def maps(config: Config, context: Context) -> list[Map]:
    """Heights, slopes and hilltops of the author's terrain and the text's."""
    difficulties = (0.5, 1.0)
    kinds = [("author", robot, d, False) for robot in ROBOTS for d in difficulties]
    for d in difficulties:
        kinds += [("author", "Hopper", d, True), ("text", "Hopper", d, False)]

    def measure(kind: tuple[str, str, float, bool]) -> list[Map]:
        # All kinds see the same seeds: difficulty and robot scale one set of hills.
        (seed,) = context.seeds(1, 5, 1)
        preset, robot, difficulty, colour_map = kind
        law = PRESETS[preset]
        unit = law.metres[robot]
        fields = hill_maps(
            config.n_maps, difficulty, seed, preset=preset, robot=robot,
            colour_map=colour_map, extent=SQUARE, flat_patch=None,
        )  # fmt: skip
        return [
            Map(
                *kind,
                map=i,
                metres=unit,
                highest=field.heights.max(),
                median_height=float(np.median(field.heights)),
                median_slope=float(np.median(field.slope())),
                p95_slope=float(np.quantile(field.slope(), 0.95)),
                steepest_flank=law.steepest(robot, difficulty),
                # Plateaus of the colour map would count as tops.
                tops=np.nan if colour_map else tops_per_area(field) * unit**2,
                below_floor=(field.surface < 0).mean(),
                node_spacing=field.resolution[0],
            )
            for i, field in enumerate(fields)
        ]

    return [record for found in context.map(measure, kinds, "terrain") for record in found]


def _plain(table: pd.DataFrame, preset: str) -> pd.DataFrame:
    return table[(table.preset == preset) & ~table.colour_map]


@criterion("5.1-hilltop-density", maps)
def hilltop_density(table: pd.DataFrame) -> Finding:
    """Visible hilltops per square unit against 0.3."""
    parts, near = [], []
    for preset in ("author", "text"):
        own = _plain(table, preset)
        own = own[(own.task == "Hopper") & (own.difficulty == 1)]
        tops = mean_ci(own.tops)
        near.append(abs(tops.mean - 0.3) < 0.03)
        parts.append(f"{preset} preset {tops.mean:.3f} ± {tops.half_width:.3f} (n = {tops.n} maps)")
    return judged(all(near), f"Visible hilltops per square unit: {'; '.join(parts)}.")


@criterion("5.1-height-difficulty", maps)
def height_is_difficulty(table: pd.DataFrame) -> Finding:
    """Height of the highest hill over difficulty, by robot."""
    own = _plain(table, "author")
    ratio = (own.highest / own.difficulty).groupby(own.task).mean()
    equal = (ratio - 1).abs() < 0.02
    evidence = f"The highest hill is as high as the difficulty for {', '.join(ratio.index[equal])}"
    evidence += "".join(f"; for the {r} it is {v:.2f} times that" for r, v in ratio[~equal].items())
    evidence += ". Only the narrowest hills are: the widest are half as high as the narrowest."
    return judged(equal.all(), evidence, otherwise=Verdict.DIRECTION)


@criterion("5.1-steepness-difficulty", maps)
def higher_is_steeper(table: pd.DataFrame) -> Finding:
    """Height and slope at difficulty 1 over those at 0.5, on the same maps."""
    own = _plain(table, "author")
    by = own.groupby(["task", "map", "difficulty"])[["highest", "p95_slope"]].mean()
    ratio = by.xs(1.0, level="difficulty") / by.xs(0.5, level="difficulty")
    return exact(
        (ratio > 1).all(axis=None),
        f"From difficulty 0.5 to 1 height grows by a factor {ratio.highest.mean():.3f} and the "
        f"95th percentile of the slope by {ratio.p95_slope.mean():.3f} on average over "
        f"{len(ratio)} maps: the ground is scaled.",
    )


@effect_of("5.1-terrain-scale", maps)
def scale(table: pd.DataFrame) -> str:
    """Slopes by the author's numbers and by the text's."""
    at = (table.task == "Hopper") & (table.difficulty == 1) & ~table.colour_map
    slopes = table[at].groupby("preset")[["p95_slope", "steepest_flank"]].mean()
    author, text = slopes.loc["author"], slopes.loc["text"]
    return (
        f"At difficulty 1 the 95th percentile of the slope is {author.p95_slope:.2f} with the "
        f"author's numbers and {text.p95_slope:.2f} with the text's taken in metres; the steepest "
        f"flank {author.steepest_flank:.2f} and {text.steepest_flank:.2f}, which none of these "
        "robots can climb."
    )


@effect_of("5.1-terrain-colours", maps)
def colours(table: pd.DataFrame) -> str:
    """Heights and slopes with the author's colour map and without."""
    at = (table.task == "Hopper") & (table.difficulty == 1) & (table.preset == "author")
    by = table[at].groupby("colour_map")[["median_height", "p95_slope"]].mean()
    return (
        f"Median height {by.loc[True, 'median_height']:.2f} m in place of "
        f"{by.loc[False, 'median_height']:.2f} m, 95th percentile of slope "
        f"{by.loc[True, 'p95_slope']:.2f} in place of {by.loc[False, 'p95_slope']:.2f} "
        "(Hopper, difficulty 1)."
    )


@effect_of("5.1-terrain-valleys", maps)
def valleys(table: pd.DataFrame) -> str:
    """How much of the ground lies below the floor."""
    own = _plain(table, "author")
    low = own[own.task == "Hopper"].groupby("difficulty").below_floor.mean()
    parts = " and ".join(f"{share:.1%} at difficulty {d:g}" for d, share in low.items())
    return f"Ground that deep is {parts} of the hopper's maps."


# ----------------------------------------------------------------------------------- starts
@dataclass(frozen=True)
class StartsConfig:
    """How many maps each robot is put down on."""

    n_maps: int = 20
    difficulties: tuple[float, ...] = (0.5, 1.0)


@dataclass(frozen=True)
class Start:
    """One robot put down on one map."""

    task: str
    """Name."""
    difficulty: float
    """d; 0 for the flat floor."""
    patch: str
    """flat floor, centred (ours), author (beside the robot) or none."""
    map: int
    """Index of the map, and of the world."""
    ground: float
    """World z of the ground at the origin [m]."""
    depth: float
    """Deepest contact after the reset [m]; 0 without contact."""


@experiment(
    "ch5-starts",
    item="Section 5.1, Hills",
    smoke=StartsConfig(n_maps=2, difficulties=(1.0,)),
    book=StartsConfig(),
    thesis=StartsConfig(n_maps=100),
    seconds=7,
)
def starts(config: StartsConfig, context: Context) -> list[Start]:
    """How deep robots stick in the ground at a reset, by kind of start patch."""
    kinds: list[tuple[float, str | None]] = [(0.0, "flat floor")]
    kinds += [(d, p) for d in config.difficulties for p in ("centred", "author", None)]

    def measure(robot: str) -> list[Start]:
        (seed,) = context.seeds(1, 5, 2)
        found = []
        for difficulty, patch in kinds:
            fields: tuple[Ground, ...] | None = None
            under = np.full(config.n_maps, -0.1 if robot == "Swimmer" else 0.0)
            if patch != "flat floor":
                fields = hill_maps(
                    config.n_maps, difficulty, seed, robot=robot, extent=SQUARE, flat_patch=patch
                )
                under = np.array([field.ground_z(0, 0) for field in fields])
            batch = BatchTask(robot, config.n_maps, seed=seed, terrain=fields)
            batch.reset()
            for i in range(config.n_maps):
                depth = (-batch.get_data(i).contact.dist).max(initial=0.0)
                found.append(Start(robot, difficulty, patch or "none", i, under[i], float(depth)))
        return found

    return [record for found in context.map(measure, list(ROBOTS), "starts") for record in found]


@effect_of("5.1-terrain-patch", starts)
def start_patch(table: pd.DataFrame) -> str:
    """How deep robots start in the ground by the author's patch and by ours."""
    own = table[table.difficulty.isin([0.0, 1.0])]
    depth = own.groupby(["patch", "task"]).depth.max().unstack()
    ground = own[own.patch == "author"].ground.max()
    ours = (depth.loc["centred"] - depth.loc["flat floor"]).abs().max()
    parts = ", ".join(f"{robot} {100 * d:.0f}" for robot, d in depth.loc["author"].items())
    return (
        f"Beside the author's patch the ground under the robot reaches {ground:.2f} m at "
        f"difficulty 1, and the deepest contact at a reset is, in cm: {parts}. On the centred "
        f"patch it differs from the flat floor's by {1000 * ours:.1f} mm."
    )


# ---------------------------------------------------------------------------------- figures
def map_figure(fields: Mapping[str, HeightField]) -> Figure:
    """Maps side by side on one colour scale, with contours and the start square."""
    top = max(field.surface.max() for field in fields.values())
    low = min(field.surface.min() for field in fields.values())
    levels = np.arange(0, top, 0.2)
    fig, axes = plt.subplots(1, len(fields), figsize=(7.2, 3.5), sharey=True, squeeze=False)
    for ax, (title, field) in zip(axes[0], fields.items(), strict=True):
        picture = ax.pcolormesh(
            field.x, field.y, field.surface, vmin=low, vmax=top, shading="gouraud", rasterized=True
        )
        ax.contour(field.x, field.y, field.surface, levels, colors="white", linewidths=0.5)
        ax.add_patch(
            Rectangle((-PATCH, -PATCH), 2 * PATCH, 2 * PATCH, fill=False, ec=COLOURS[1], lw=1.5)
        )
        ax.set(title=title, xlabel="x [m]", aspect="equal")
        ax.grid(False)
    axes[0, 0].set_ylabel("y [m]")
    fig.colorbar(picture, ax=axes, label="height [m]", shrink=0.85)
    return fig


def slope_figure(n_maps: int, seed: int) -> Figure:
    """Slopes of the hopper's ground over several maps, with the steepest possible flank.

    Parameters
    ----------
    n_maps
        Maps a kind.
    seed
        Of the maps.
    """
    kinds = {
        "author, 0.5": ("author", 0.5),
        "author, 1.0": ("author", 1.0),
        "text in metres, 1.0": ("text", 1.0),
    }
    fig, ax = plt.subplots()
    for (label, (preset, d)), colour in zip(kinds.items(), COLOURS, strict=False):
        fields = hill_maps(
            n_maps, d, seed, preset=preset, robot="Hopper", extent=SQUARE, flat_patch=None
        )
        slopes = np.concatenate([field.slope().ravel() for field in fields])
        ax.hist(slopes, bins=120, range=(0, 1.2), density=True, histtype="step", color=colour)
        ax.plot([], color=colour, label=label)
        if (steepest := PRESETS[preset].steepest("Hopper", d)) < 1.2:
            ax.axvline(steepest, color=colour, ls=":")
    ax.plot([], color="0.4", ls=":", label="steepest flank of a single hill")
    degrees = [0, 10, 20, 30, 40, 50]
    ax.set(xlabel="slope [rise over run]", ylabel="density", xlim=(0, 1.2))
    top = ax.secondary_xaxis("top", functions=(_to_degrees, _to_slope))
    top.set_xticks(degrees, [f"{d}°" for d in degrees])
    ax.legend()
    return fig


def _to_degrees(slope: ArrayLike) -> np.ndarray:
    return np.degrees(np.arctan(slope))


def _to_slope(degrees: ArrayLike) -> np.ndarray:
    return np.tan(np.radians(degrees))


def switch_figure(fields: Sequence[HeightField], switch: float) -> Figure:
    """The ground along y = 0 on several maps, about the switch, to scale."""
    x = np.linspace(switch - 4, switch + 16, 801)
    fig, ax = plt.subplots(figsize=(7.2, 1.9))
    for field, colour in zip(fields, COLOURS, strict=False):
        ax.plot(x, field.ground_z(x, 0 * x), color=colour, lw=1.4)
    ax.axvline(switch, color="0.4", ls=":")
    ax.annotate("switch", (switch, 1.0), xytext=(-4, 0), textcoords="offset points", ha="right")
    ax.set(xlabel="x [m]", ylabel="ground z [m]", aspect=3, xlim=x[[0, -1]], ylim=(-0.15, 1.2))
    return fig
