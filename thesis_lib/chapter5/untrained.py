"""The untrained controller of section 5.1: the noise every learner starts with.

It is a Gaussian of mean 0 and standard deviation 1 on each motor; learners add means of their
own (``first_means``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from thesis_lib.arrays import FloatArray
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import effect_of
from thesis_lib.locomotion.batch import BatchTask
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.locomotion.tasks import HORIZON
from thesis_lib.locomotion.terrain import hill_maps
from thesis_lib.stats import mean_ci

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


def run_episodes(
    batch: BatchTask,
    controller: Controller,
    steps: int,
    watch: Callable[[FloatArray], None] | None = None,
) -> dict[str, FloatArray]:
    """Run one episode in every world.

    Parameters
    ----------
    batch
        The worlds.
    controller
        What drives them.
    steps
        Control steps at most.
    watch
        Is given the true observations of the worlds still running, step by step.

    Returns
    -------
    dict
        ``episode_return``, ``length``, ``distance`` along x [m], ``off_map`` and the parts of the
        return by name, each of shape ``(n,)``.
    """
    batch.reset()
    start = batch.qpos[:, :2]
    running = np.ones(batch.num_envs, dtype=bool)
    parts: dict[str, FloatArray] = {}
    off_map = np.zeros(batch.num_envs, dtype=bool)
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
        "episode_return": step.info.episode_return,
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
class Config:
    """How many episodes of the untrained controller, and on which grounds."""

    n_episodes: int = 40
    horizon: int = HORIZON
    grounds: tuple[str, ...] = tuple(GROUNDS)


@dataclass(frozen=True)
class Episode:
    """One episode of the untrained controller."""

    task: str
    """Name."""
    ground: str
    """plane, flat field (a height field of height 0), hills 0.5 or hills 1.0."""
    episode: int
    """Index."""
    episode_return: float
    """Undiscounted, over at most 500 steps."""
    length: int
    """Control steps."""
    distance: float
    """Way of the root along x [m]."""
    forward: float
    """Part of the return: forward velocity."""
    control: float
    """Part of the return: minus the cost of actions."""
    contact: float
    """Part of the return: minus the cost of contacts."""
    alive: float
    """Part of the return: bonus."""
    divergence: float
    """Part of the return: penalty of a diverging world."""


@experiment(
    "ch5-untrained",
    item="Section 5.1",
    smoke=Config(n_episodes=3, horizon=40, grounds=("plane", "hills 1.0")),
    book=Config(n_episodes=10),
    thesis=Config(n_episodes=400),
    seconds=12,
)
def episodes(config: Config, context: Context) -> list[Episode]:
    """The untrained controller on flat and hilly ground."""

    def measure(job: tuple[str, str]) -> list[Episode]:
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
        act = untrained(robot, context.seeds(n, 5, 5, *cell))
        found = run_episodes(batch, act, config.horizon)
        if found.pop("off_map").any():
            raise RuntimeError(f"an untrained {robot} left its map; make the map larger.")
        return [Episode(*job, i, **{k: v[i] for k, v in found.items()}) for i in range(n)]

    jobs = [(robot, ground) for robot in ROBOTS for ground in config.grounds]
    return [record for found in context.map(measure, jobs, "untrained") for record in found]


@effect_of("5.1-cheetah-cost", episodes)
def cheetah_cost(table: pd.DataFrame) -> str:
    """What the half-cheetah's actions cost, here and by the text."""
    own = table[(table.task == "HalfCheetah") & (table.ground == "plane")]
    cost = -own.control.mean()
    return (
        "At most 0.27 a step, for full torque on all six joints. The untrained controller pays "
        f"{cost:.0f} in 500 steps here and {cost / 10:.0f} by the text."
    )


@effect_of("5.1-divergence", episodes)
def divergences(table: pd.DataFrame) -> str:
    """How many episodes diverged."""
    return (
        f"{int((table.divergence != 0).sum())} of {len(table)} episodes of the baseline diverged."
    )


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Return by ground, and length on the plane: means with 95% intervals."""
    records = []
    for robot, own in table.groupby("task", sort=False):
        length = mean_ci(own[own.ground == "plane"].length)
        record = {"task": robot, "steps, plane": f"{length.mean:.0f} ± {length.half_width:.0f}"}
        for ground, group in own.groupby("ground", sort=False):
            total = mean_ci(group.episode_return)
            record[str(ground)] = f"{total.mean:.1f} ± {total.half_width:.1f}"
        records.append({**record, "n": length.n})
    return pd.DataFrame(records)
