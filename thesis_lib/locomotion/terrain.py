"""Hilly terrain as height fields (section 5.1, "Hills").

A map is the upper envelope of many Gaussian bumps.  Their centres stand on a jittered
square lattice, their variances are uniform in an interval and their heights are those of
the density, so a wide hill is a low one; the highest point of the map equals the
difficulty.  The thesis gives the parameters in unnamed units; the author's published code
gives others, and says how long a unit is.  Both are presets here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import uniform_filter

from thesis_lib.arrays import FloatArray
from thesis_lib.checks import one_of
from thesis_lib.locomotion.height_field import Extent, HeightField, Interval

_CUTOFF = 5.0
"""Standard deviations after which a hill counts as nothing: a relative height of 4e-6."""


@dataclass(frozen=True)
class HillLaw:
    """The random law of a hilly terrain, in lattice units.

    Attributes
    ----------
    density
        Hilltops per square unit.
    variance
        Interval from which each hill's variance is drawn, square units.
    metres
        Metres a unit, by robot.
    height
        Height of the map at difficulty 1, metres, by robot.
    anchor
        A site of the lattice of centres, units.  It matters to robots that run along y = 0.
    valley
        World z of the lowest possible ground in metres, or None for the robot's floor.
    """

    density: float
    variance: Interval
    metres: Mapping[str, float]
    height: Mapping[str, float]
    anchor: tuple[float, float]
    valley: float | None

    @property
    def pitch(self) -> float:
        """Distance between neighbouring lattice sites, units."""
        return float(self.density**-0.5)

    @property
    def jitter(self) -> float:
        """Standard deviation of a centre about its site along each axis, units."""
        return float((8 * self.density) ** -0.5)

    def steepest(self, robot: str, difficulty: float) -> float:
        """Largest slope a single hill can have: that of the narrowest, one deviation out.

        A Gaussian of height H and variance v is steepest at distance sqrt(v) from its
        top, with slope H exp(-1/2) / sqrt(v).

        Parameters
        ----------
        robot, difficulty
            As in :func:`hills`.

        Returns
        -------
        float
            Rise over run, dimensionless.
        """
        deviation = self.variance[0] ** 0.5 * self.metres[robot]
        return difficulty * self.height[robot] * float(np.exp(-0.5)) / deviation


@dataclass(frozen=True)
class _Site:
    """Where one robot runs: all lengths in metres except the author's patch (units)."""

    floor: float
    switch_at: float
    extent: Extent
    author_half_size: float
    author_patch: Extent


# How far a run can go decides the extents.  In 1000 steps the thesis's best controllers cover
# about 9 m (Swimmer), 11 m (Walker2d), 44 m (HalfCheetah), 46 m (Hopper) and 64 m (Ant).  The
# planar robots cannot leave y = 0, so a strip carries them.
_SITES: Mapping[str, _Site] = MappingProxyType(
    {
        "Swimmer": _Site(
            -0.1, 2.0, ((-30.0, 60.0), (-40.0, 40.0)), 40.0, ((-3.0, 0.0), (-1.5, -0.5))
        ),
        "Hopper": _Site(
            0.0, 5.0, ((-20.0, 100.0), (-4.0, 4.0)), 40.0, ((-1.0, -0.5), (-1.0, -0.5))
        ),
        "HalfCheetah": _Site(
            0.0, 5.0, ((-40.0, 120.0), (-4.0, 4.0)), 50.0, ((-3.0, 0.0), (-1.5, -0.5))
        ),
        "Walker2d": _Site(
            0.0, 2.0, ((-20.0, 60.0), (-4.0, 4.0)), 40.0, ((-2.0, -0.5), (-2.0, -0.5))
        ),
        "Ant": _Site(0.0, 5.0, ((-40.0, 100.0), (-50.0, 50.0)), 50.0, ((-2.0, 0.0), (-2.0, 0.0))),
    }
)

SWITCH_AT: Mapping[str, float] = MappingProxyType({k: s.switch_at for k, s in _SITES.items()})
"""Where each robot's terrain turns from flat to hilly, world x in metres (ours; the thesis
says "task-dependent" and no more).  About a tenth of what a good controller covers in 1000
steps, as noise begins after a tenth of the steps, but never under the robot at its start."""

PATCH = 2.0
"""Half the side of the flat start square, metres.  The longest robot reaches 1.5 m."""

SUNK = 0.1
"""How far below the flat floor a height field lies where a switch map is flat, metres: deeper
than any foot sinks in, so that there the robot touches the plane alone."""

PRESETS: Mapping[str, HillLaw] = MappingProxyType(
    {
        "author": HillLaw(
            density=0.3125,
            variance=(0.4, 0.8),
            metres=MappingProxyType({k: s.author_half_size / 20 for k, s in _SITES.items()}),
            height=MappingProxyType({k: 0.5 if k == "Swimmer" else 1.0 for k in _SITES}),
            anchor=(-18.0, -20.0),
            valley=-0.1,
        ),
        "text": HillLaw(
            density=0.3,
            variance=(0.1, 0.2),
            metres=MappingProxyType(dict.fromkeys(_SITES, 1.0)),
            height=MappingProxyType(dict.fromkeys(_SITES, 1.0)),
            anchor=(-18.0, -20.0),
            valley=None,
        ),
    }
)
"""``author``: the published code's numbers.  ``text``: section 5.1 read literally in metres."""


def hills(
    difficulty: float,
    seed: int | np.random.SeedSequence,
    *,
    preset: Literal["author", "text"] = "author",
    robot: str = "Ant",
    resolution: float | None = None,
    switch_at: float | Literal["task"] | None = None,
    flat_patch: Literal["centred", "author"] | None = "centred",
    extent: Extent | Literal["author"] | None = None,
    valley: float | None = None,
    colour_map: bool = False,
) -> HeightField:
    """Draw one hilly map.

    Parameters
    ----------
    difficulty
        Height of the highest hill, metres; with the author's preset the Swimmer's hills are
        half as high.  0 is flat ground.  The thesis trains on 0.5 and tests on 1.
    seed
        Decides the hills.  Difficulty, resolution, patch and switch do not change the draw.
    preset
        A key of :data:`PRESETS`.
    robot
        Whose floor, extent and scale to use: Swimmer, Hopper, HalfCheetah, Walker2d or Ant;
        robots of packages have none of their own.
    resolution
        Distance between nodes, metres; default a tenth of a unit, as in the author's code
        (0.2 m, or 0.25 m for the HalfCheetah and the Ant).
    switch_at
        World x, metres, up to which the ground is flat; ``"task"`` for :data:`SWITCH_AT`.
        The start patch lies before the switch, and ``flat_patch`` then changes nothing.
    flat_patch
        ``"centred"``: a square of half side :data:`PATCH` round the origin, where robots
        start, lies on the robot's floor.  ``"author"``: the box the author's code clears,
        beside the robot and on valley level.  None: hills everywhere.
    extent
        World intervals in metres; default as far as a run of 1000 steps can go (planar
        robots get a strip); ``"author"`` for the author's square about the origin.
    valley
        World z of the lowest possible ground, metres; default the preset's.
    colour_map
        Pass the heights through the colour map with which the author's code stored them
        (see :func:`greens`).

    Returns
    -------
    HeightField

    Raises
    ------
    ValueError
        If the difficulty is negative or not finite, a name is unknown, the switch lies off
        the map or under the start patch, or the resolution cannot carry the hills.

    Notes
    -----
    Source: section 5.1 and the author's published terrain code.  Round the start square the
    hills are clamped between planes that leave it, up and down, with the slope of the
    steepest possible hill, so the ground is continuous and no blend is steeper than a hill.

    A switch map keeps the flat task's own floor, a plane, and its hills rise through it from
    the switch on, at most that steeply.  To MuJoCo a flat height field is not a plane (it
    makes several times as many contacts), so only this way is the world before the switch
    exactly the flat task.  Valleys deeper than the floor are filled: under 3 % of the ground
    at difficulty 1.
    """
    law = PRESETS[one_of("preset", preset, PRESETS)]
    if robot not in _SITES:
        raise ValueError(
            f"there are no hills for robot {robot!r}, only for {', '.join(_SITES)}: leave the "
            "ground flat, or lend it a map of theirs."
        )
    site = _SITES[robot]
    if not (isinstance(difficulty, Real) and 0 <= difficulty < np.inf):
        raise ValueError(
            f"difficulty is {difficulty}, but it must be a finite number of metres, 0 or more."
        )
    if flat_patch not in ("centred", "author", None):
        raise ValueError(
            f"flat_patch is {flat_patch!r}, but it must be 'centred', 'author' or None."
        )
    unit = law.metres[robot]
    bounds = _extent(extent, site)
    step = 0.1 * unit if resolution is None else resolution
    narrowest = law.variance[0] ** 0.5 * unit
    if not 0 < step <= narrowest:
        raise ValueError(
            f"resolution is {resolution} m, but it must be positive and at most {narrowest:.3g} m, "
            "one standard deviation of the narrowest hill."
        )
    switch = None if switch_at is None else _switch(switch_at, site, bounds)
    if valley is None:
        valley = site.floor if law.valley is None else law.valley
    # The floor can lie above the valleys, and never below: heights are not negative.
    floor = site.floor - valley
    if not floor >= 0:
        raise ValueError(
            f"valley is {valley} m, but it must not lie above the {robot}'s floor, {site.floor} m."
        )

    (x0, x1), (y0, y1) = bounds
    x = np.linspace(x0, x1, round((x1 - x0) / step) + 1)
    y = np.linspace(y0, y1, round((y1 - y0) / step) + 1)
    shape = _envelope(law, x / unit, y / unit, np.random.default_rng(seed))
    if flat_patch == "author":
        shape = _author_patch(shape, x / unit, y / unit, site.author_patch)
    if colour_map:
        shape = greens(shape)
    ground = difficulty * law.height[robot] * shape
    slope = law.steepest(robot, difficulty)
    if switch is not None:
        # The hills come up through the floor at the switch, and sink away from it before.
        highest = floor + slope * (x - switch)
        ground = np.clip(np.minimum(ground, highest) - floor + SUNK, 0, None)
    elif flat_patch == "centred":
        _flatten(ground, x, y, floor, slope)
    return HeightField(
        heights=ground,
        half_size=((x1 - x0) / 2, (y1 - y0) / 2),
        z_offset=valley if switch is None else site.floor - SUNK,
        centre=((x0 + x1) / 2, (y0 + y1) / 2),
        floor=None if switch is None else site.floor,
    )


def hill_maps(
    n: int, difficulty: float, seed: int | np.random.SeedSequence, **options: object
) -> tuple[HeightField, ...]:
    """Draw several maps; map i depends on the seed and i alone, not on n.

    Parameters
    ----------
    n
        How many, at least 1.
    difficulty, seed, options
        As in :func:`hills`.

    Returns
    -------
    tuple of HeightField
        All of one shape and size.

    Raises
    ------
    ValueError
        If n is below 1, or as in :func:`hills`.
    """
    if n < 1:
        raise ValueError(f"n is {n}, but at least one map must be asked for.")
    root = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
    # Children are built by hand because `spawn` would count up in the caller's object.
    children = (
        np.random.SeedSequence(entropy=root.entropy, spawn_key=(*root.spawn_key, i))
        for i in range(n)
    )
    return tuple(hills(difficulty, child, **options) for child in children)  # type: ignore[arg-type]


def greens(height: ArrayLike) -> FloatArray:
    """Distort relative heights as the author's image files did.

    The author's code drew the map with a colour map and MuJoCo read the image's red channel
    as height.  The colour map is ColorBrewer's nine-step "Greens", interpolated linearly:
    monotone, but flat at the bottom and compressed at the top.

    Parameters
    ----------
    height
        Relative heights in [0, 1], any shape.

    Returns
    -------
    FloatArray
        Relative heights in [0, 1], same shape.

    Raises
    ------
    ValueError
        If a height lies outside [0, 1].
    """
    height = np.asarray(height, np.float64)
    if height.size and not (height.min() >= 0 and height.max() <= 1):
        raise ValueError(
            f"relative heights range from {height.min()} to {height.max()}, but must be in [0, 1]."
        )
    red = np.array([0, 0, 35, 65, 116, 161, 199, 229, 247])  # from dark (low) to light (high)
    return np.asarray(np.interp(height, np.linspace(0, 1, red.size), red / red[-1]))


def _envelope(law: HillLaw, x: FloatArray, y: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Envelope of the hills at the nodes, its highest top 1; everything in lattice units."""
    margin = 2 * law.pitch
    sites = [
        np.arange(
            np.floor((axis[0] - margin - a) / law.pitch),
            np.ceil((axis[-1] + margin - a) / law.pitch) + 1,
        )
        * law.pitch
        + a
        for axis, a in zip((x, y), law.anchor, strict=True)
    ]
    cx, cy = (c.ravel() for c in np.meshgrid(*sites))
    cx = cx + rng.normal(0.0, law.jitter, cx.size)
    cy = cy + rng.normal(0.0, law.jitter, cy.size)
    variance = rng.uniform(*law.variance, cx.size)
    # The density's height is 1 / (2 pi variance).  Scaling by the highest point of the envelope
    # and not by the highest node keeps the ground the same at every resolution; of a hill whose
    # centre lies off the map, the nearest point on the map counts.
    off_map = (cx - np.clip(cx, x[0], x[-1])) ** 2 + (cy - np.clip(cy, y[0], y[-1])) ** 2
    height = 1 / variance
    height /= (height * np.exp(-off_map / (2 * variance))).max()
    reach = _CUTOFF * np.sqrt(variance)
    field = np.zeros((y.size, x.size))
    columns = zip(np.searchsorted(x, cx - reach), np.searchsorted(x, cx + reach), strict=True)
    rows = zip(np.searchsorted(y, cy - reach), np.searchsorted(y, cy + reach), strict=True)
    for k, ((left, right), (low, high)) in enumerate(zip(columns, rows, strict=True)):
        # An isotropic Gaussian is a product of its two profiles, so no exp per node is needed.
        along_x = np.exp(-((x[left:right] - cx[k]) ** 2) / (2 * variance[k]))
        along_y = np.exp(-((y[low:high] - cy[k]) ** 2) / (2 * variance[k]))
        window = field[low:high, left:right]
        hill = np.multiply.outer(height[k] * along_y, along_x)
        np.maximum(window, hill, out=window)
    # A product of two rounded factors can exceed 1 by its last digit.
    return np.minimum(field, 1.0, out=field)


def _author_patch(shape: FloatArray, x: FloatArray, y: FloatArray, box: Extent) -> FloatArray:
    """Clear a box and average its surroundings, as the author's ``clear_patch`` does (units).

    The average runs over one unit along each axis, edges mirrored, inside the box enlarged
    by 0.9 units.
    """
    shape = shape.copy()
    (xa, xb), (ya, yb) = box
    shape[np.ix_((y >= ya) & (y <= yb), (x >= xa) & (x <= xb))] = 0
    wide = np.ix_((y >= ya - 0.9) & (y <= yb + 0.9), (x >= xa - 0.9) & (x <= xb + 0.9))
    window = [max(round(1 / (axis[1] - axis[0])), 1) for axis in (y, x)]
    # The running sums behind the filter can round to just below zero.
    shape[wide] = np.maximum(uniform_filter(shape[wide], size=window, mode="reflect"), 0)
    return shape


def _flatten(ground: FloatArray, x: FloatArray, y: FloatArray, floor: float, slope: float) -> None:
    """Clamp the ground, in place, between planes that leave the start square at a slope."""
    # Beyond this distance the planes are above every hill and below every valley.
    reach = PATCH + (max(ground.max(), floor) / slope if slope > 0 else np.inf)
    columns = slice(*np.searchsorted(x, [-reach, reach]))
    rows = slice(*np.searchsorted(y, [-reach, reach]))
    near = ground[rows, columns]
    off_x = np.maximum(np.abs(x[columns]) - PATCH, 0)
    off_y = np.maximum(np.abs(y[rows]) - PATCH, 0)
    allowed = slope * np.hypot(off_x[None, :], off_y[:, None])
    near[...] = floor + np.clip(near - floor, -allowed, allowed)


def _extent(extent: Extent | Literal["author"] | None, site: _Site) -> Extent:
    """The map's world intervals; ValueError when the robot's start is not on them."""
    if extent is None:
        return site.extent
    if isinstance(extent, str):
        if extent != "author":
            raise ValueError(
                f"extent is {extent!r}, but it must be None, 'author' or ((x0, x1), (y0, y1))."
            )
        half = site.author_half_size
        return (-half, half), (-half, half)
    bounds = np.asarray(extent, np.float64)
    start_inside = bounds.shape == (2, 2) and bool(
        ((bounds[:, 0] <= -PATCH) & (bounds[:, 1] >= PATCH) & np.isfinite(bounds).all()).all()
    )
    if not start_inside:
        raise ValueError(
            f"extent is {extent}, but ((x0, x1), (y0, y1)) must hold the start square from "
            f"-{PATCH:g} to {PATCH:g} m on both axes."
        )
    return (float(bounds[0, 0]), float(bounds[0, 1])), (float(bounds[1, 0]), float(bounds[1, 1]))


def _switch(switch_at: float | str, site: _Site, bounds: Extent) -> float:
    """The switch position in metres; ValueError when it is under the robot or off the map."""
    if isinstance(switch_at, str) and switch_at != "task":
        raise ValueError(f"switch_at is {switch_at!r}, but it must be metres, 'task' or None.")
    value = site.switch_at if isinstance(switch_at, str) else float(switch_at)
    if not PATCH <= value < bounds[0][1]:
        raise ValueError(
            f"switch_at is {value:g} m, but it must lie ahead of the start square and on the map: "
            f"from {PATCH:g} m to below {bounds[0][1]:g} m."
        )
    return value
