r"""The heat domain: a round robot looks for a heat source (section 4.3).

State is continuous: the robot's position, its heading and the intensity of the heat.
Tasks differ in where the source is.  The thesis states the area (10 x 10, walled), the
robot's radius (1), the four actions, the reward of a step (:math:`-10/\sqrt{200}`), when
an episode ends, the noise, and 4 tilings with 1664 features.  How far an
action moves, how heat falls off, where robot and source start, the learning rate and the
layout of the tilings are not stated; they are options here.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import FloatArray
from thesis_lib.checks import generator, one_of, positive_number
from thesis_lib.compiled import njit
from thesis_lib.domains.tiles import TileCoding

ACTIONS = ("forward", "backward", "turn left", "turn right")
VARIABLES = ("x", "y", "heading", "heat")

Intensity = Literal["inverse_square", "exponential", "linear"]
"""How heat falls off with the distance d from the source; each is 1 or near it at the source."""

NoiseScale = Literal["raw", "range"]
"""Whether sensor noise is in the units of each variable, or in shares of its range."""

LAYOUTS: dict[str, tuple[int, int, int, int]] = {
    "headings": (1, 1, 8, 12),
    "positions": (3, 3, 2, 12),
}
"""Intervals of x, y, heading and heat that give 4 tilings of 416 tiles, 1664 in all."""


@dataclass(frozen=True)
class HeatWorld:
    """What all tasks of the domain share.

    Parameters
    ----------
    size
        Side of the walled area, in units of length; 10 in the thesis.
    radius
        Radius of the robot in the same unit; 1 in the thesis.  Its centre keeps this distance
        from walls, along which it slides.
    stride
        How far forward and backward go, in units of length.
    turn
        How far a turn goes, in radians.
    slip
        Standard deviation of the noise added to how far an action goes, in units of length or
        radians.
    sensor
        Standard deviation of the noise added to each sensor.
    intensity
        ``"inverse_square"`` is min(1, 1/d^2), ``"exponential"`` exp(-d/3) and ``"linear"``
        1 - d/diagonal, for a source at distance d from the robot's centre.
    noise_scale
        ``"raw"``: the same noise for all sensors, as the text says.  ``"range"``: times the
        range of each variable.
    step_reward
        Reward of each step; -10 divided by the diagonal of the thesis's area.

    Notes
    -----
    Source: section 4.3.  A sensor reads no value outside its range: positions end at the
    walls and heat between 0 and 1.
    """

    size: float = 10.0
    radius: float = 1.0
    stride: float = 0.5
    turn: float = np.pi / 8
    slip: float = 0.1
    sensor: float = 0.02
    intensity: Intensity = "inverse_square"
    noise_scale: NoiseScale = "raw"
    step_reward: float = -10.0 / np.sqrt(200.0)

    def __post_init__(self) -> None:
        for name in ("size", "radius", "stride", "turn"):
            positive_number(name, getattr(self, name))
        for name in ("slip", "sensor"):
            value = getattr(self, name)
            if not 0 <= value < np.inf:
                raise ValueError(f"{name} is {value}, but it must be a number of at least 0.")
        if 2 * self.radius >= self.size:
            raise ValueError(
                f"radius is {self.radius}, but a robot in an area of side {self.size} must have "
                f"one below {self.size / 2}."
            )
        one_of("intensity", self.intensity, get_args(Intensity))
        one_of("noise_scale", self.noise_scale, get_args(NoiseScale))

    @cached_property
    def parameters(self) -> FloatArray:
        """The numbers that the compiled functions take, in their order."""
        law = get_args(Intensity).index(self.intensity)
        unit = 1.0 if self.noise_scale == "raw" else 0.0
        return np.array(
            [
                self.size,
                self.radius,
                self.stride,
                self.turn,
                self.slip,
                self.sensor,
                law,
                unit,
                self.step_reward,
            ]
        )

    def coding(self, intervals: tuple[int, int, int, int] = LAYOUTS["headings"]) -> TileCoding:
        """The tile coding of the sensors: 4 tilings over all four variables jointly.

        Parameters
        ----------
        intervals
            Of x, y, heading and heat; the default gives the printed 1664 features.
        """
        return TileCoding(
            names=VARIABLES,
            low=(0.0, 0.0, 0.0, 0.0),
            high=(self.size, self.size, 2 * np.pi, 1.0),
            intervals=intervals,
            periodic=(False, False, True, False),
        )

    def sample_source(self, rng: np.random.Generator | int) -> tuple[float, float]:
        """Draw where the source of a task is, evenly from where the robot can reach it."""
        draws = generator(rng)
        while True:
            x, y = draws.uniform(0.0, self.size, size=2)
            nearest = np.clip([x, y], self.radius, self.size - self.radius)
            if np.hypot(x - nearest[0], y - nearest[1]) <= self.radius:
                return float(x), float(y)

    def heat(self, distance: ArrayLike) -> FloatArray:
        """Intensity at some distances from the source."""
        law = np.vectorize(lambda d: intensity(self.parameters, d), otypes=[float])
        return np.asarray(law(np.asarray(distance, dtype=float)))


@dataclass(frozen=True)
class HeatTask:
    """One task: a source in a world.

    Parameters
    ----------
    source
        Where the heat source is.
    world
        What the domain's tasks share.

    Raises
    ------
    ValueError
        When the robot cannot come within its radius of the source.
    """

    source: tuple[float, float]
    world: HeatWorld = field(default_factory=HeatWorld)

    def __post_init__(self) -> None:
        world, source = self.world, np.asarray(self.source, dtype=float)
        if source.shape != (2,):
            raise ValueError(f"source is {self.source!r}, but a pair (x, y) is needed.")
        nearest = np.clip(source, world.radius, world.size - world.radius)
        if not np.hypot(*(source - nearest)) <= world.radius:
            raise ValueError(
                f"source is {self.source}, but the robot must be able to come within its radius "
                f"{world.radius} of it; put it inside the area and away from the corners."
            )


@njit(error_model="numpy")
def intensity(parameters, distance):  # type: ignore[no-untyped-def]
    """Heat at a distance; see :class:`HeatWorld`."""
    law = parameters[6]
    if law == 0:
        return 1.0 / max(distance, 1.0) ** 2
    if law == 1:
        return np.exp(-distance / 3.0)
    return 1.0 - distance / (np.sqrt(2.0) * parameters[0])


@njit(error_model="numpy")
def distance_to(state, source):  # type: ignore[no-untyped-def]
    """Distance from the robot's centre to the source."""
    return np.hypot(state[0] - source[0], state[1] - source[1])


@njit(error_model="numpy")
def place(rng, parameters, source, state):  # type: ignore[no-untyped-def]
    """Put the robot anywhere but at the source, facing anywhere."""
    size, radius = parameters[0], parameters[1]
    while True:
        state[0] = radius + (size - 2 * radius) * rng.random()
        state[1] = radius + (size - 2 * radius) * rng.random()
        state[2] = 2 * np.pi * rng.random()
        if distance_to(state, source) > radius:
            return


@njit(error_model="numpy")
def move(rng, parameters, state, action):  # type: ignore[no-untyped-def]
    """Carry out an action: write the new x, y and heading into ``state``."""
    size, radius, slip = parameters[0], parameters[1], parameters[4]
    noise = slip * rng.standard_normal() if slip > 0 else 0.0
    if action < 2:
        far = parameters[2] + noise
        if action == 1:
            far = -far
        state[0] = min(max(state[0] + far * np.cos(state[2]), radius), size - radius)
        state[1] = min(max(state[1] + far * np.sin(state[2]), radius), size - radius)
    else:
        far = parameters[3] + noise
        if action == 3:
            far = -far
        state[2] = (state[2] + far) % (2 * np.pi)


@njit(error_model="numpy")
def sense(rng, parameters, source, state, reading):  # type: ignore[no-untyped-def]
    """Write noisy x, y, heading and heat into ``reading``."""
    size, sensor = parameters[0], parameters[5]
    reading[0], reading[1], reading[2] = state[0], state[1], state[2]
    reading[3] = intensity(parameters, distance_to(state, source))
    if sensor > 0:
        raw = parameters[7] == 1.0
        for d in range(4):
            unit = 1.0
            if not raw:
                unit = size if d < 2 else (2 * np.pi if d == 2 else 1.0)
            reading[d] += sensor * unit * rng.standard_normal()
    reading[0] = min(max(reading[0], 0.0), size)
    reading[1] = min(max(reading[1], 0.0), size)
    reading[2] %= 2 * np.pi
    reading[3] = min(max(reading[3], 0.0), 1.0)
