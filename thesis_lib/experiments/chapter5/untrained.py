"""Two controllers that have learned nothing of the state, and what they tell of the tasks.

The *untrained* controller is the noise every learner of the chapter starts with: a Gaussian
of mean 0 and standard deviation 1 on each motor (learners add means of their own, see
:mod:`thesis_lib.experiments.chapter5.first_means`).  The *metronome* drives each motor with a
sine of its own, whatever the sensors say.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import pandas as pd

from thesis_lib.arrays import FloatArray
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.locomotion.batch import BatchTask, Perturbation
from thesis_lib.locomotion.perturbations import TerrainSwitch, WhiteNoise
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.locomotion.tasks import HORIZON, TEST_HORIZON, make_task
from thesis_lib.locomotion.terrain import HeightField, hill_maps, hills

Controller = Callable[[int], FloatArray]
"""From the control step, counted from 0, to the actions of n worlds, shape ``(n, A)``."""


def untrained(robot: str, seeds: Sequence[np.random.SeedSequence]) -> Controller:
    """Gaussian actions of mean 0 and standard deviation 1, one stream a world.

    Parameters
    ----------
    robot
        Name of the robot.
    seeds
        One for each world.

    Returns
    -------
    Controller
        To be called once a step, in order.
    """
    streams = [np.random.default_rng(seed) for seed in seeds]
    size = ROBOTS[robot].action_size
    return lambda t: np.array([stream.standard_normal(size) for stream in streams])


# --------------------------------------------------------------------------------- metronome


@dataclass(frozen=True)
class Metronome:
    """Motor i gets ``offset_i + amplitude_i sin(2 pi frequency time + phase_i)``.

    Attributes
    ----------
    robot
        Name of the robot.
    frequency
        Beats per second, common to all motors.
    amplitude, phase, offset
        One for each motor; actions of 1 are the full torque, phases are radians.
    """

    robot: str
    frequency: float
    amplitude: tuple[float, ...]
    phase: tuple[float, ...]
    offset: tuple[float, ...]

    def controller(self, n: int) -> Controller:
        """The metronome in n worlds."""
        one = _beat(self.robot, self._row())
        return lambda t: np.tile(one(t), (n, 1))

    def _row(self) -> FloatArray:
        return np.array([[np.log(self.frequency), *self.amplitude, *self.phase, *self.offset]])


def _beat(robot: str, rows_: FloatArray) -> Controller:
    """One metronome a row: log frequency, then amplitudes, phases and offsets."""
    size, dt = ROBOTS[robot].action_size, ROBOTS[robot].control_dt
    frequency = np.exp(rows_[:, :1])
    amplitude, phase, offset = np.split(rows_[:, 1:], [size, 2 * size], axis=1)

    def actions(t: int) -> FloatArray:
        beat = np.sin(2 * np.pi * frequency * t * dt + phase)
        return np.asarray(np.clip(offset + amplitude * beat, -1, 1))

    return actions


@dataclass(frozen=True)
class Search:
    """Cross-entropy search for a metronome that earns much on flat ground."""

    generations: int = 20
    population: int = 64
    """Metronomes tried in a generation, each in a world of its own."""
    elite: int = 10
    """How many of them the next generation is drawn around."""
    seconds: float = 12.0
    """Simulated time of a trial."""

    def horizon(self, robot: str) -> int:
        """Control steps of a trial."""
        return round(self.seconds / ROBOTS[robot].control_dt)


SLOWEST, FASTEST = 0.25, 5.0
"""Bounds on the beat, Hz: more than five strokes a second would sample no sine at 40 Hz."""


@lru_cache(maxsize=64)
def find_metronome(robot: str, search: Search, seed: int, index: int = 0) -> Metronome:
    """Search a metronome; the same arguments give the same one.

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
    Metronome
        The centre of the last generation.
    """
    size = ROBOTS[robot].action_size
    root = np.random.SeedSequence(seed, spawn_key=(5, 3, index))
    draws, worlds = root.spawn(2)
    rng = np.random.default_rng(draws)
    # One beat a second, seven tenths of the torque, any phase, hardly an offset.
    centre = np.r_[0.0, np.full(size, 0.7), np.zeros(2 * size)]
    spread = np.r_[0.5, np.full(size, 0.4), np.full(size, 2.0), np.full(size, 0.1)]
    horizon = search.horizon(robot)
    batch = BatchTask(robot, search.population, seed=worlds, max_episode_steps=horizon)
    for _ in range(search.generations):
        tried = centre + spread * rng.standard_normal((search.population, centre.size))
        tried[:, 0] = np.clip(tried[:, 0], np.log(SLOWEST), np.log(FASTEST))
        earned = _run(batch, _beat(robot, tried), horizon)["return"]
        best = tried[np.argsort(earned)[-search.elite :]]
        # The floor keeps the search alive when the best agree.
        centre, spread = best.mean(axis=0), best.std(axis=0) + 0.03
    amplitude, phase, offset = (tuple(map(float, part)) for part in np.split(centre[1:], 3))
    return Metronome(robot, float(np.exp(centre[0])), amplitude, phase, offset)


# ------------------------------------------------------------------------------------- runs


def _run(
    batch: BatchTask,
    controller: Controller,
    steps: int,
    watch: Callable[[FloatArray], None] | None = None,
) -> dict[str, FloatArray]:
    """Run one episode in every world; sums over it, each shape ``(n,)``.

    ``watch`` is given the true observations of the worlds still running.
    """
    batch.reset()
    start = batch.qpos[:, :2]
    running = np.ones(batch.n_worlds, dtype=bool)
    parts: dict[str, FloatArray] = {}
    off_map = np.zeros(batch.n_worlds, dtype=bool)
    for t in range(steps):
        step = batch.step(controller(t))
        for name, values in step.info.components.items():
            parts[name] = parts.get(name, 0.0) + values
        off_map |= step.info.off_map
        if watch is not None:
            watch(step.info.true_observation[running])
        running = ~(step.terminated | step.truncated)
        if not running.any():
            break
    return {
        "return": step.info.episode_return,
        "length": step.info.episode_length,
        "distance": batch.qpos[:, 0] - start[:, 0],
        "off_map": off_map,
        **parts,
    }


GROUNDS = {
    "plane": None,
    "flat field": 0.0,
    "hills 0.5": 0.5,
    "hills 1.0": 1.0,
}
"""The flat task's floor; a height field that is just as flat; hills by difficulty."""


@dataclass(frozen=True)
class BaselineConfig:
    """How many episodes of the untrained controller, and on which grounds."""

    n_episodes: int = 40
    horizon: int = HORIZON
    grounds: tuple[str, ...] = tuple(GROUNDS)


def baseline(config: BaselineConfig, context: Context) -> pd.DataFrame:
    """Episodes of the untrained controller; columns are documented in :data:`BASELINE`."""

    def measure(job: tuple[str, str]) -> list[dict[str, Any]]:
        robot, ground = job
        n = config.n_episodes
        cell = (list(ROBOTS).index(robot), list(GROUNDS).index(ground))
        batch_seed, map_seed = context.seeds(2, 5, 4, *cell)
        difficulty = GROUNDS[ground]
        maps = None
        if difficulty is not None:
            # Nothing untrained leaves a small map; robots bound to y = 0 need only a strip.
            side = 25.0 if robot in ("Swimmer", "Ant") else 4.0
            extent = ((-25.0, 25.0), (-side, side))
            maps = hill_maps(n, difficulty, map_seed, robot=robot, extent=extent)
        batch = BatchTask(robot, n, seed=batch_seed, terrain=maps, max_episode_steps=config.horizon)
        found = _run(batch, untrained(robot, context.seeds(n, 5, 5, *cell)), config.horizon)
        if found.pop("off_map").any():
            raise RuntimeError(f"an untrained {robot} left its map; make the map larger.")
        return [
            {"robot": robot, "ground": ground, "episode": i, **{k: v[i] for k, v in found.items()}}
            for i in range(n)
        ]

    jobs = [(robot, ground) for robot in ROBOTS for ground in config.grounds]
    return rows([r for found in context.map(measure, jobs, "baseline") for r in found])


BASELINE = Experiment(
    id="baseline-5.1",
    item="Section 5.1",
    title="The untrained controller on flat and hilly ground",
    function=baseline,
    budgets={
        "smoke": BaselineConfig(n_episodes=3, horizon=40, grounds=("plane", "hills 1.0")),
        "book": BaselineConfig(),
        "thesis": BaselineConfig(n_episodes=400),
    },
    columns={
        "robot": "name",
        "ground": "plane, flat field (a height field of height 0), hills 0.5 or hills 1.0",
        "episode": "index",
        "return": "undiscounted, over at most 500 steps",
        "length": "control steps",
        "distance": "way of the root along x, m",
        "forward": "part of the return: forward velocity",
        "control": "part of the return: minus the cost of actions",
        "contact": "part of the return: minus the cost of contacts",
        "alive": "part of the return: bonus",
        "divergence": "part of the return: penalty of a diverging world",
    },
    seconds={"smoke": 1, "book": 22, "thesis": 220},
)


@dataclass(frozen=True)
class MetronomeConfig:
    """The thesis's robustness tests (section 5.4), with a metronome as controller."""

    search: Search = Search()
    searches: int = 2
    """Independent searches for each robot."""
    n_runs: int = 20
    steps: int = TEST_HORIZON
    difficulty: float = 1.0
    sigma: float = 1.0


def metronome(config: MetronomeConfig, context: Context) -> pd.DataFrame:
    """Test metronomes; columns are documented in :data:`METRONOME`."""

    def measure(job: tuple[str, int]) -> list[dict[str, Any]]:
        robot, index = job
        beat = find_metronome(robot, config.search, context.seed, index)
        n = config.n_runs
        (seed,) = context.seeds(1, 5, 6, list(ROBOTS).index(robot), index)
        flat_field = hills(0.0, 0, robot=robot)
        conditions: dict[str, tuple[list[Perturbation], HeightField | None]] = {
            "regular": ([], None),
            "noise": ([WhiteNoise(config.sigma)], None),
            "switch": ([TerrainSwitch(config.difficulty, seed=context.seed)], None),
            "flat field": ([], flat_field),
        }
        found = []
        for condition, (perturbations, terrain) in conditions.items():
            batch = BatchTask(
                make_task(robot, termination="test"),
                n,
                seed=seed,
                terrain=terrain,
                perturbations=perturbations,
                max_episode_steps=config.steps,
            )
            ran = _run(batch, beat.controller(n), config.steps)
            found += [
                {
                    "robot": robot,
                    "search": index,
                    "condition": condition,
                    "run": i,
                    **{name: ran[name][i] for name in ("return", "length", "distance")},
                }
                for i in range(n)
            ]
        return found

    jobs = [(robot, index) for robot in ROBOTS for index in range(config.searches)]
    return rows([r for found in context.map(measure, jobs, "metronome") for r in found])


SMOKE_SEARCH = Search(generations=2, population=8, elite=3, seconds=0.5)

METRONOME = Experiment(
    id="metronome-5.4",
    item="Section 5.4",
    title="The thesis's robustness tests on a controller without sensors",
    function=metronome,
    budgets={
        "smoke": MetronomeConfig(search=SMOKE_SEARCH, searches=2, n_runs=2, steps=60),
        "book": MetronomeConfig(),
        "thesis": MetronomeConfig(searches=10),
    },
    columns={
        "robot": "name",
        "search": "index of the search that found the metronome",
        "condition": "regular, noise, switch, or flat field (a height field of height 0)",
        "run": "index; one run starts from the same state in all conditions",
        "return": "undiscounted, over at most 1000 steps",
        "length": "control steps",
        "distance": "way of the root along x, m",
    },
    seconds={"smoke": 1, "book": 150, "thesis": 700},
)


# --------------------------------------------------------------------------------- recovery


@dataclass(frozen=True)
class RecoveryConfig:
    """A metronome takes over from a fresh start, or after random actions."""

    search: Search = Search()
    n_runs: int = 100
    struggle: int = 200
    """Steps of the untrained controller before."""
    steps: int = HORIZON
    robots: tuple[str, ...] = ("Swimmer", "HalfCheetah")
    """Those that a metronome moves and no limit stops."""


def recovery(config: RecoveryConfig, context: Context) -> pd.DataFrame:
    """Let metronomes take over; columns are documented in :data:`RECOVERY`."""

    def measure(robot: str) -> list[dict[str, Any]]:
        beat = find_metronome(robot, config.search, context.seed)
        n, found = config.n_runs, []
        for k, start in enumerate(("reset", "struggle")):
            cell = (list(ROBOTS).index(robot), k)
            (seed,) = context.seeds(1, 5, 7, *cell)
            batch = BatchTask(robot, n, seed=seed, max_episode_steps=None)
            batch.reset()
            if start == "struggle":
                act = untrained(robot, context.seeds(n, 5, 8, *cell))
                for t in range(config.struggle):
                    batch.step(act(t))
            before = batch.qpos[:, :2]
            act = beat.controller(n)
            for t in range(config.steps):
                batch.step(act(t))
            way = batch.qpos[:, :2] - before
            if robot not in ("Swimmer", "Ant"):
                way[:, 1] = 0  # the planar robots' second coordinate is their height
            found += [
                {"robot": robot, "start": start, "run": i, "way": float(np.hypot(*way[i]))}
                for i in range(n)
            ]
        return found

    found = context.map(measure, config.robots, "recovery")
    return rows([r for records in found for r in records])


RECOVERY = Experiment(
    id="recovery-5.1",
    item="Section 5.1.1, Swimmer",
    title="Does a metronome get as far after a struggle as from a fresh start?",
    function=recovery,
    budgets={
        "smoke": RecoveryConfig(search=SMOKE_SEARCH, n_runs=3, struggle=10, steps=20),
        "book": RecoveryConfig(),
        "thesis": RecoveryConfig(),
    },
    columns={
        "robot": "name",
        "start": "reset, or struggle: after 200 steps of the untrained controller",
        "run": "index",
        "way": "distance between start and end on the ground, m",
    },
    seconds={"smoke": 1, "book": 37, "thesis": 37},
)


# ------------------------------------------------------------------------------------- noise


@dataclass(frozen=True)
class NoiseConfig:
    """What is watched to learn how far each sensor ranges."""

    search: Search = Search()
    n_episodes: int = 50
    horizon: int = HORIZON
    sigma: float = 1.0


def noise(config: NoiseConfig, context: Context) -> pd.DataFrame:
    """Compare the noise with each sensor's own spread; columns as in :data:`NOISE`."""

    def measure(job: tuple[str, str]) -> list[dict[str, Any]]:
        robot, controller = job
        n, cell = config.n_episodes, list(ROBOTS).index(robot)
        (seed,) = context.seeds(1, 5, 9, cell)
        if controller == "metronome":
            act = find_metronome(robot, config.search, context.seed).controller(n)
        else:
            act = untrained(robot, context.seeds(n, 5, 10, cell))
        batch = BatchTask(robot, n, seed=seed, max_episode_steps=config.horizon)
        seen: list[FloatArray] = []
        _run(batch, act, config.horizon, watch=seen.append)
        values = np.concatenate(seen)
        return [
            {
                "robot": robot,
                "controller": controller,
                "index": i,
                "sensor": sensor.name,
                "group": sensor.group,
                "unit": sensor.unit,
                "observations": len(values),
                "sd": values[:, i].std(),
                "low": values[:, i].min(),
                "high": values[:, i].max(),
                "zero": (values[:, i] == 0).mean(),
                "sigma": config.sigma,
            }
            for i, sensor in enumerate(batch.task.sensors)
        ]

    jobs = [(robot, controller) for robot in ROBOTS for controller in ("untrained", "metronome")]
    return rows([r for found in context.map(measure, jobs, "noise") for r in found])


NOISE = Experiment(
    id="noise-5.1",
    item="Section 5.1, Sensor noise",
    title="How far each sensor ranges by itself, beside noise of standard deviation 1",
    function=noise,
    budgets={
        "smoke": NoiseConfig(search=SMOKE_SEARCH, n_episodes=3, horizon=40),
        "book": NoiseConfig(),
        "thesis": NoiseConfig(n_episodes=400),
    },
    columns={
        "robot": "name",
        "controller": "untrained or metronome, on flat ground",
        "index": "place in the observation",
        "sensor": "name",
        "group": "kind of sensor",
        "unit": "of the sensor and of the next columns",
        "observations": "how many were watched",
        "sd": "standard deviation over all of them",
        "low": "least value seen",
        "high": "greatest value seen",
        "zero": "share of observations that are exactly 0",
        "sigma": "standard deviation of the noise",
    },
    seconds={"smoke": 1, "book": 33, "thesis": 100},
)
