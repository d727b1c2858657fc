"""Figures and tables of the opening of chapter 5, from its worlds and its tidy tables."""

from __future__ import annotations

import dataclasses
import inspect
import textwrap
from collections.abc import Callable, Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import ArrayLike

from thesis_lib import published, robustness
from thesis_lib.edition.plots import COLOURS, PRINTED
from thesis_lib.experiments.chapter5.untrained import Search, find_metronome
from thesis_lib.locomotion import perturbations, rendering
from thesis_lib.locomotion.batch import BatchTask
from thesis_lib.locomotion.batch import Perturbation as Base
from thesis_lib.locomotion.perturbations import TerrainSwitch
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.locomotion.tasks import make_task
from thesis_lib.locomotion.terrain import PATCH, SWITCH_AT, HeightField
from thesis_lib.stats import mean_ci

NAMES = {
    "Swimmer": "swimmer",
    "Hopper": "hopper",
    "HalfCheetah": "half_cheetah",
    "Walker2d": "walker",
    "Ant": "ant",
}
"""How the published tables name the robots."""

CONTROLLERS = {"untrained": COLOURS[1], "metronome": COLOURS[0]}


# ---------------------------------------------------------------------------------- pictures


def gallery(
    make: Callable[[], Sequence[rendering.Image]], titles: Sequence[str], columns: int = 3
) -> Figure:
    """Pictures in a grid; where the machine has no OpenGL, what to do about it instead.

    Parameters
    ----------
    make
        Draws the pictures; may raise :class:`~thesis_lib.locomotion.rendering.NoGL`.
    titles
        One for each picture.
    columns
        Pictures side by side.
    """
    lines = -(-len(titles) // columns)
    try:
        images = make()
    except rendering.NoGL as missing:
        fig, ax = plt.subplots(figsize=(7.2, 1.6))
        ax.axis("off")
        ax.text(0.5, 0.5, textwrap.fill(str(missing), 80), ha="center", va="center")
        return fig
    shape = images[0].shape
    height = 7.2 / columns * shape[0] / shape[1] + 0.28
    fig, axes = plt.subplots(lines, columns, figsize=(7.2, lines * height), squeeze=False)
    for ax in axes.flat:
        ax.axis("off")
    for ax, image, title in zip(axes.flat, images, titles, strict=False):
        ax.imshow(image)
        ax.set_title(title, fontsize=9)
    return fig


def on_hills(robot: str, field: HeightField, x: float, y: float) -> np.ndarray:
    """A robot's starting pose, moved to a place of a map.

    Parameters
    ----------
    robot
        Swimmer or Ant, which move freely in space.
    field
        The ground.
    x, y
        World coordinates of the root, m.

    Returns
    -------
    ndarray
        Positions, shape ``(nq,)``; the root is as high above the ground as at the start.
    """
    qpos = np.array(ROBOTS[robot].init_qpos)
    qpos[:3] += [x, y, field.ground_z(x, y)]
    return qpos


def crossing(
    search: Search, seed: int, *, robot: str = "HalfCheetah", worlds: int = 12, frames: int = 6
) -> tuple[np.ndarray, HeightField, list[str]]:
    """States of a metronome's run across the terrain switch, evenly spaced along its way.

    Of some worlds, that with the longest way is chosen.

    Returns
    -------
    tuple
        Positions, shape ``(frames, nq)``; the ground; and a caption for each state.
    """
    switch = TerrainSwitch(1.0, seed=seed)
    batch = BatchTask(
        make_task(robot, termination="test"), worlds, seed=seed, perturbations=[switch]
    )
    grounds = switch.ground(robot, worlds, np.random.SeedSequence(seed))
    act = find_metronome(robot, search, seed).controller(worlds)
    batch.reset()
    path = [batch.qpos]
    for t in range(500):
        batch.step(act(t))
        path.append(batch.qpos)
    x = np.array(path)[:, :, 0]
    best = int(x[-1].argmax())
    furthest = np.maximum.accumulate(x[:, best])
    # From a little before the switch to the end of the way, or all of a way that ends before.
    start = min(SWITCH_AT[robot] - 2, furthest[-1] / 2)
    moments = [int(np.argmax(furthest >= p)) for p in np.linspace(start, furthest[-1], frames)]
    dt = ROBOTS[robot].control_dt
    told = [f"{t * dt:.1f} s, x = {x[t, best]:.1f} m" for t in moments]
    ground = grounds[best]
    assert isinstance(ground, HeightField)
    return np.array([path[t][best] for t in moments]), ground, told


# ----------------------------------------------------------------------------------- terrain


def terrain_maps(fields: Mapping[str, HeightField]) -> Figure:
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


def slope_histograms(
    fields: Mapping[str, Sequence[HeightField]], steepest: Mapping[str, float]
) -> Figure:
    """Distribution of the slope over several maps a kind, with the steepest possible flank."""
    fig, ax = plt.subplots()
    for (label, maps), colour in zip(fields.items(), COLOURS, strict=False):
        slopes = np.concatenate([field.slope().ravel() for field in maps])
        ax.hist(slopes, bins=120, range=(0, 1.2), density=True, histtype="step", color=colour)
        ax.plot([], color=colour, label=label)
        if steepest[label] < 1.2:
            ax.axvline(steepest[label], color=colour, ls=":")
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


def switch_profiles(fields: Sequence[HeightField], switch: float) -> Figure:
    """The ground along y = 0 on several maps, about the switch, to scale."""
    x = np.linspace(switch - 4, switch + 16, 801)
    fig, ax = plt.subplots(figsize=(7.2, 1.9))
    for field, colour in zip(fields, COLOURS, strict=False):
        ax.plot(x, field.ground_z(x, 0 * x), color=colour, lw=1.4)
    ax.axvline(switch, color="0.4", ls=":")
    ax.annotate("switch", (switch, 1.0), xytext=(-4, 0), textcoords="offset points", ha="right")
    ax.set(xlabel="x [m]", ylabel="ground z [m]", aspect=3, xlim=x[[0, -1]], ylim=(-0.15, 1.2))
    return fig


# ------------------------------------------------------------------------------------ tables


def task_table(table: pd.DataFrame) -> pd.DataFrame:
    """What the robots are and sense, ours beside the printed sizes."""
    return pd.DataFrame(
        {
            "task": table.robot,
            "mass [kg]": table.mass,
            "links": _beside(table.links, table.links_printed),
            "motors": _beside(table.joints, table.joints_printed),
            "sensors": _beside(table.observation, table.observation_printed),
            "rate [Hz]": table.control_hz.round().astype(int),
            "episode [s]": table.episode_s,
        }
    )


def _beside(ours: pd.Series, printed: pd.Series) -> list[str]:
    return [
        f"{a} ({b})" if a == b else f"**{a}** ({b})" for a, b in zip(ours, printed, strict=True)
    ]


def reward_table(table: pd.DataFrame) -> pd.DataFrame:
    """What each task pays and when an episode ends."""
    text = table.control_cost_text != table.control_cost
    cost = [
        f"**{c:g}** (text {p:g})" if differ else f"{c:g}"
        for c, p, differ in zip(table.control_cost, table.control_cost_text, text, strict=True)
    ]
    return pd.DataFrame(
        {
            "task": table.robot,
            "$c_a$": cost,
            "$c_F$": [f"{c:g}" for c in table.contact_cost],
            "$b$": [f"{b:g}" for b in table.alive_bonus],
            "an episode ends if": table.ends,
            "in tests, if": table.ends_in_tests,
        }
    )


def baseline_table(table: pd.DataFrame) -> pd.DataFrame:
    """Return and length of the untrained controller: means with 95% intervals."""
    records = []
    for (robot, ground), group in table.groupby(["robot", "ground"], sort=False):
        total, length = mean_ci(group["return"]), mean_ci(group.length)
        records.append(
            {
                "task": robot,
                "ground": ground,
                "return": f"{total.mean:.1f} ± {total.half_width:.1f}",
                "steps": f"{length.mean:.0f} ± {length.half_width:.0f}",
                "n": total.n,
            }
        )
    made = pd.DataFrame(records)
    wide = made.pivot(index="task", columns="ground", values="return")
    wide = wide.loc[made.task.unique(), made.ground.unique()]
    plane = made[made.ground == "plane"].set_index("task")
    wide.insert(0, "steps, plane", plane.steps)
    wide["n"] = plane.n
    return wide.replace("-", "−", regex=True).reset_index()


def metronome_table(table: pd.DataFrame) -> pd.DataFrame:
    """The metronomes' 1000-step returns and, in brackets, the range of the printed networks."""
    conditions = {"regular": "table-c.1", "noise": "table-c.2", "switch": "table-c.3"}
    records = []
    for robot in ROBOTS:
        row: dict[str, str] = {"task": robot}
        for condition, name in conditions.items():
            own = table[(table.robot == robot) & (table.condition == condition)]
            by_search = own.groupby("search")["return"].mean()
            printed = published.load(name)
            values = printed[(printed.task == NAMES[robot]) & (printed.trained_on == "flat")].value
            ours = ", ".join(f"{v:.0f}" for v in by_search).replace("-", "−")
            row[condition] = f"**{ours}** ({values.min():.0f}–{values.max():.0f})"
        records.append(row)
    return pd.DataFrame(records)


THESIS_PERTURBATIONS = ("WhiteNoise", "TerrainSwitch", "SensorSubset")
"""Those of the thesis: its two tests, and the sensors it takes from some networks."""


def perturbation_table() -> pd.DataFrame:
    """Every perturbation with the first sentence of its description, the thesis's first."""
    records = []
    for name, kind in vars(perturbations).items():
        if inspect.isclass(kind) and issubclass(kind, Base) and kind is not Base:
            first = inspect.getdoc(kind).split("\n\n")[0]  # type: ignore[union-attr]
            fields = ", ".join(f.name for f in dataclasses.fields(kind))  # type: ignore[arg-type]
            records.append({"object": name, "what it does": first, "settings": fields})
    ours = [r for r in records if r["object"] not in THESIS_PERTURBATIONS]
    named = {r["object"]: r for r in records}
    return pd.DataFrame([*(named[name] for name in THESIS_PERTURBATIONS), *ours])


# ------------------------------------------------------------------------------------- noise


def noise_shares(table: pd.DataFrame) -> Figure:
    """Noise over each moving sensor's own spread, by kind of sensor, one panel a robot."""
    table = table[table.sd > 0].assign(share=lambda t: t.sigma / t.sd)
    groups = list(dict.fromkeys(table.group))
    fig, axes = plt.subplots(1, len(ROBOTS), sharey=True, sharex=True, figsize=(7.2, 3.6))
    for ax, robot in zip(axes, ROBOTS, strict=True):
        own = table[table.robot == robot]
        for offset, (controller, colour) in zip((0.15, -0.15), CONTROLLERS.items(), strict=True):
            at = own[own.controller == controller]
            y = np.array([groups.index(g) for g in at.group])
            ax.plot(at.share, -y + offset, "o", ms=3, mfc="none", mew=0.7, color=colour)
            middle = at.groupby("group").share.median()
            places = [-groups.index(str(g)) + offset for g in middle.index]
            ax.plot(middle, places, "|", ms=9, mew=2.2, color=colour)
        ax.axvline(1, color=PRINTED, lw=1, ls=":")
        ax.set_xscale("log")
        ax.set_title(robot, fontsize=9)
        ax.tick_params(labelsize=8)
        ax.set_xticks([0.1, 10, 1000], ["0.1", "10", "1000"])
        ax.minorticks_off()
    axes[0].set_yticks([-i for i in range(len(groups))], groups)
    fig.supxlabel("noise / the sensor's own standard deviation", fontsize=10)
    for controller, colour in CONTROLLERS.items():
        axes[0].plot([], "o", mfc="none", color=colour, label=controller)
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper right", ncols=2)
    return fig


def noise_table(table: pd.DataFrame, controller: str = "metronome") -> pd.DataFrame:
    """Median of noise over spread by kind of sensor (rows) and robot (columns)."""
    table = table[(table.sd > 0) & (table.controller == controller)]
    share = (table.sigma / table.sd).groupby([table.group, table.robot], sort=False).median()
    wide = share.unstack()[list(ROBOTS)]
    return wide.rename_axis(None, axis=1).rename_axis("kind of sensor").reset_index()


# ------------------------------------------------------------------------------------ scores


def score_table(table: pd.DataFrame, robots: Sequence[str]) -> pd.DataFrame:
    """Equation 5.4 for the seven printed networks and the metronome together."""
    regular = published.load("table-c.1")
    records = []
    for robot in robots:
        own = table[table.robot == robot].groupby("condition")["return"].mean()
        for condition, name in (("noise", "table-c.2"), ("switch", "table-c.3")):
            pair = [
                t[(t.task == NAMES[robot]) & (t.trained_on == "flat")]
                .set_index("architecture")
                .value
                for t in (regular, published.load(name))
            ]
            networks = pair[0].index
            base = np.r_[pair[0].to_numpy(), own["regular"]]
            perturbed = np.r_[pair[1][networks].to_numpy(), own[condition]]
            scores = robustness.score(base, perturbed)
            best = int(scores[:-1].argmax())
            records.append(
                {
                    "task": robot,
                    "perturbation": condition,
                    "metronome": scores[-1],
                    "best network": scores[best],
                    "which": networks[best],
                    "rank of 8": int((scores > scores[-1]).sum()) + 1,
                }
            )
    return pd.DataFrame(records)
