"""How fast a gait is (section 5.5.2).

The thesis explains a result by what a network filters out; whether that is noise or the gait
itself depends on the frequency of a gait, which it does not state.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import signal

from thesis_lib.arrays import BoolArray, FloatArray
from thesis_lib.chapter5 import live, untrained
from thesis_lib.chapter5.networks import low_to_high
from thesis_lib.chapter5.open_loop import NAME, SMOKE_SEARCH, Search, find_gait
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.locomotion.batch import BatchTask
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.optimisation import run_episodes

RESOLUTION = 0.02
"""Spacing of the frequencies a spectrum is looked up at [Hz]."""

DRIFT = 0.25
"""Frequencies below this are drift, those from here on a gait's [Hz]."""


def gait_frequency(angles: FloatArray, dt: float) -> float:
    """Frequency at which joint angles swing most [Hz].

    The place of the highest peak of the summed spectra of all angles, each windowed (Hann)
    and without its straight-line trend.

    Parameters
    ----------
    angles
        Shape ``(T, J)`` [rad].
    dt
        Control step [s].

    Raises
    ------
    ValueError
        When the time is too short for two cycles of the slowest kind.
    """
    values = np.asarray(angles, dtype=np.float64)
    if len(values) * dt < 2 / DRIFT:
        raise ValueError(
            f"{len(values) * dt:.2g} s of joint angles are too few: a gait of {DRIFT:g} Hz "
            f"needs at least {2 / DRIFT:g} s."
        )
    padded = max(len(values), round(1 / (RESOLUTION * dt)))
    frequency, power = signal.periodogram(
        values, fs=1 / dt, window="hann", nfft=padded, detrend="linear", axis=0
    )
    power = power.sum(axis=1)
    # A maximum at the bound is no peak but the flank of the drift below it.
    peaks, _ = signal.find_peaks(np.where(frequency < DRIFT, np.inf, power))
    if len(peaks) == 0:
        raise ValueError("the joints do not swing: their spectrum has no peak.")
    return float(frequency[peaks[np.argmax(power[peaks])]])


@dataclass(frozen=True)
class Config:
    """Which controllers are watched, and how long."""

    search: Search = field(default_factory=Search)
    """As for the other tests of open-loop gaits."""
    searches: int = 2
    """Independent searches for each robot."""
    learner: live.Config = field(default_factory=partial(live.Config, seeds=1))
    """The first runs of ``ch5-live``, whose networks are watched."""
    episodes: int = 3
    """Episodes of each controller, which start from different states."""
    seconds: float = 12.0
    """Length of an episode [s]."""
    skip: float = 2.0
    """What is left out at its start [s]."""


@dataclass(frozen=True)
class Episode:
    """One episode of one controller."""

    task: str
    """Name."""
    controller: str
    """open-loop gait, or the network that was trained; greedy, on flat ground."""
    index: int
    """Index of the search, or of the run."""
    episode: int
    """Index."""
    seconds: float
    """Length of the episode; less than asked for after a fall."""
    distance: float
    """Way of the root along x [m]."""
    frequency: float
    """Place of the highest peak of the summed spectra of the joint angles [Hz]; empty after an
    early fall."""


@experiment(
    "ch5-gaits",
    item="Section 5.5.2",
    smoke=Config(
        search=SMOKE_SEARCH,
        searches=1,
        learner=live.Config(iterations=1, batch_steps=200, horizon=100, seeds=1),
        episodes=1,
    ),
    book=Config(learner=live.Config(iterations=30, seeds=1)),
    thesis=Config(searches=10),
    seconds=25,
)
def episodes(config: Config, context: Context) -> list[Episode]:
    """Frequency of a gait: open-loop ones, and that of a network after a short training."""

    def open_loop(job: tuple[str, int]) -> list[Episode]:
        robot, index = job
        batch = _batch(robot, config, context, 0, index)
        act = find_gait(robot, config.search, context.seed, index).controller(config.episodes)
        angles: list[FloatArray] = []

        def watched(t: int) -> FloatArray:
            angles.append(_joints(batch, robot))
            return act(t)

        found = untrained.run_episodes(batch, watched, _steps(robot, config))
        key, (length, distance) = (
            (robot, NAME, index),
            (found["length"].astype(int), found["distance"]),
        )
        return _records(key, np.array(angles), length, distance, config.skip)

    def network(index: int) -> list[Episode]:
        run = live.trained(config.learner.run(context.seed + index))
        robot = run.config.task
        batch = _batch(robot, config, context, 1, index)
        angles: list[FloatArray] = []
        places: list[FloatArray] = []

        def watch(running: BoolArray) -> None:
            angles.append(_joints(batch, robot))
            places.append(batch.qpos[:, 0])

        length = run_episodes(batch, run.policy, watch=watch).lengths
        distance = batch.qpos[:, 0] - places[0]
        key = (robot, f"{run.config.architecture.upper()}, trained", index)
        return _records(key, np.array(angles), length, distance, config.skip)

    jobs = [(robot, index) for robot in ROBOTS for index in range(config.searches)]
    found = context.map(open_loop, jobs, "open-loop gaits")
    found += context.map(network, range(config.learner.seeds), "networks")
    return [record for records in found for record in records]


def _batch(robot: str, config: Config, context: Context, *key: int) -> BatchTask:
    (seed,) = context.seeds(1, 5, 11, list(ROBOTS).index(robot), *key)
    limit = _steps(robot, config)
    return BatchTask(robot, config.episodes, seed=seed, max_episode_steps=limit)


def _steps(robot: str, config: Config) -> int:
    return round(config.seconds / ROBOTS[robot].control_dt)


def _joints(batch: BatchTask, robot: str) -> FloatArray:
    """Angles of the joints with motors, which stand last in a robot's position, ``(n, J)``."""
    return np.array(batch.qpos[:, -ROBOTS[robot].action_size :])


def _records(
    key: tuple[str, str, int],
    angles: FloatArray,
    length: NDArray[np.int_],
    distance: FloatArray,
    skip: float,
) -> list[Episode]:
    """One row an episode; a robot that falls too early for two cycles has no frequency."""
    dt = ROBOTS[key[0]].control_dt
    first = round(skip / dt)
    records = []
    for i, n in enumerate(length):
        long_enough = (n - first) * dt >= 2 / DRIFT
        frequency = gait_frequency(angles[first:n, i], dt) if long_enough else np.nan
        records.append(Episode(*key, i, n * dt, distance[i], frequency))
    return records


def by_controller(table: pd.DataFrame) -> pd.Series:
    """Median frequency [Hz] by robot and controller, the slowest first; without the fallen."""
    return table.groupby(["task", "controller"]).frequency.median().dropna().sort_values()


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Frequency of gaits by robot and controller: median, and range over episodes; speed."""
    records = []
    for (robot, controller), own in table.groupby(["task", "controller"], sort=False):
        found = own.frequency.dropna()
        speed = (own.distance / own.seconds).median()
        records.append(
            {
                "task": robot,
                "controller": controller,
                "frequency [Hz]": f"{found.median():.1f} ({low_to_high(found, 1)})"
                if len(found)
                else "–",
                "speed [m/s]": f"{speed:.1f}" if len(found) else "–",
                "fell early": f"{len(own) - len(found)} of {len(own)}",
            }
        )
    return pd.DataFrame(records)
