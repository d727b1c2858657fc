"""Open-loop gaits: each motor gets a sine of its own, whatever the sensors say (section 5.4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from thesis_lib.arrays import FloatArray
from thesis_lib.chapter5.untrained import Controller, run_episodes
from thesis_lib.edition.plots import COLOURS
from thesis_lib.edition.remembered import remembered
from thesis_lib.locomotion.batch import BatchTask
from thesis_lib.locomotion.robots import ROBOTS

NAME = "open-loop gait"
"""How tables call the controller."""

CONTROLLERS = {"untrained": COLOURS[1], NAME: COLOURS[0]}
"""The two controllers that have learned nothing of the state, with their colours."""


@dataclass(frozen=True)
class Gait:
    """Motor i gets ``offset_i + amplitude_i sin(2 pi frequency time + phase_i)``.

    Attributes
    ----------
    robot
        Name of the robot.
    frequency
        Cycles per second, common to all motors.
    amplitude, phase, offset
        One for each motor; actions of 1 are the full torque, phases are radians.
    """

    robot: str
    frequency: float
    amplitude: tuple[float, ...]
    phase: tuple[float, ...]
    offset: tuple[float, ...]

    def controller(self, n: int) -> Controller:
        """The gait in n worlds."""
        row = np.array([[np.log(self.frequency), *self.amplitude, *self.phase, *self.offset]])
        one = _controller(self.robot, row)
        return lambda t: np.tile(one(t), (n, 1))


def _controller(robot: str, gaits: FloatArray) -> Controller:
    """One gait a row: log frequency, then amplitudes, phases and offsets."""
    size, dt = ROBOTS[robot].action_size, ROBOTS[robot].control_dt
    frequency = np.exp(gaits[:, :1])
    amplitude, phase, offset = np.split(gaits[:, 1:], [size, 2 * size], axis=1)

    def actions(t: int) -> FloatArray:
        swing = np.sin(2 * np.pi * frequency * t * dt + phase)
        return np.asarray(np.clip(offset + amplitude * swing, -1, 1))

    return actions


@dataclass(frozen=True)
class Search:
    """Cross-entropy search for a gait that earns much on flat ground."""

    generations: int = 20
    population: int = 64
    """Gaits tried in a generation, each in a world of its own."""
    elite: int = 10
    """How many of them the next generation is drawn around."""
    seconds: float = 12.0
    """Simulated time of a trial."""

    def horizon(self, robot: str) -> int:
        """Control steps of a trial."""
        return round(self.seconds / ROBOTS[robot].control_dt)


SMOKE_SEARCH = Search(generations=2, population=8, elite=3, seconds=0.5)
"""For the smoke budget."""

SLOWEST, FASTEST = 0.25, 5.0
"""Bounds on the frequency [Hz]: more than five strokes a second would sample no sine at 40 Hz."""


@remembered(Gait)
def find_gait(robot: str, search: Search, seed: int, index: int = 0) -> Gait:
    """Search a gait; the same arguments give the same one.

    Parameters
    ----------
    robot
        Name of the robot.
    search
        Budget of the search.
    seed, index
        Non-negative; searches of one seed and different indices are independent.

    Returns
    -------
    Gait
        The centre of the last generation.
    """
    size = ROBOTS[robot].action_size
    root = np.random.SeedSequence(seed, spawn_key=(5, 3, index))
    draws, worlds = root.spawn(2)
    rng = np.random.default_rng(draws)
    # One cycle a second, seven tenths of the torque, any phase, hardly an offset.
    centre = np.r_[0.0, np.full(size, 0.7), np.zeros(2 * size)]
    spread = np.r_[0.5, np.full(size, 0.4), np.full(size, 2.0), np.full(size, 0.1)]
    horizon = search.horizon(robot)
    batch = BatchTask(robot, search.population, seed=worlds, max_episode_steps=horizon)
    for _ in range(search.generations):
        tried = centre + spread * rng.standard_normal((search.population, centre.size))
        tried[:, 0] = np.clip(tried[:, 0], np.log(SLOWEST), np.log(FASTEST))
        earned = run_episodes(batch, _controller(robot, tried), horizon)["episode_return"]
        best = tried[np.argsort(earned)[-search.elite :]]
        # The floor keeps the search alive when the best agree.
        centre, spread = best.mean(axis=0), best.std(axis=0) + 0.03
    amplitude, phase, offset = (tuple(map(float, part)) for part in np.split(centre[1:], 3))
    return Gait(robot, float(np.exp(centre[0])), amplitude, phase, offset)
