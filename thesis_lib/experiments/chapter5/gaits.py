"""How fast a gait is: the beat of joint angles, of metronomes and of a trained network.

Section 5.5.2 explains a result by what a network filters out; whether that is noise or the
gait itself depends on the frequency of a gait, which the thesis does not state.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import signal

from thesis_lib.arrays import FloatArray
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.experiments.chapter5.live import LiveConfig, trained
from thesis_lib.experiments.chapter5.untrained import SMOKE_SEARCH, Search, find_metronome
from thesis_lib.locomotion.batch import BatchTask
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.optimisation import run_episodes

RESOLUTION = 0.02
"""Spacing of the frequencies a spectrum is looked up at [Hz]."""

SLOWEST = 0.25
"""Frequencies from here on count as a beat; what is slower is drift [Hz]."""


def beat(angles: FloatArray, dt: float) -> float:
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
        When the time is too short for two beats of the slowest kind.
    """
    values = np.asarray(angles, dtype=np.float64)
    if len(values) * dt < 2 / SLOWEST:
        raise ValueError(
            f"{len(values) * dt:.2g} s of joint angles are too few: a beat of {SLOWEST:g} Hz "
            f"needs at least {2 / SLOWEST:g} s."
        )
    padded = max(len(values), round(1 / (RESOLUTION * dt)))
    frequency, power = signal.periodogram(
        values, fs=1 / dt, window="hann", nfft=padded, detrend="linear", axis=0
    )
    power = power.sum(axis=1)
    # A maximum at the bound is no peak but the flank of the drift below it.
    peaks, _ = signal.find_peaks(np.where(frequency < SLOWEST, np.inf, power))
    if len(peaks) == 0:
        raise ValueError("the joints do not swing: their spectrum has no peak.")
    return float(frequency[peaks[np.argmax(power[peaks])]])


@dataclass(frozen=True)
class GaitsConfig:
    """Settings of section-5.5.2-gaits."""

    search: Search = field(default_factory=Search)
    """As for the other tests of metronomes."""
    searches: int = 2
    """Independent searches for each robot."""
    learner: LiveConfig = field(default_factory=LiveConfig)
    """The runs of section-5.5.1-live, whose networks are watched."""
    worlds: int = 3
    """Episodes of each controller, which start from different states."""
    seconds: float = 12.0
    """Length of an episode [s]."""
    skip: float = 2.0
    """What is left out at its start [s]."""


def gaits(config: GaitsConfig, context: Context) -> pd.DataFrame:
    """Beat of the joint angles; columns are documented in :data:`SECTION_5_5_2_GAITS`."""

    def metronome(job: tuple[str, int]) -> list[dict[str, Any]]:
        robot, index = job
        batch = _batch(robot, config, context, 0, index)
        act = find_metronome(robot, config.search, context.seed, index).controller(config.worlds)
        angles, length = [], np.zeros(config.worlds, dtype=int)
        batch.reset()
        start, running = batch.qpos[:, 0], np.ones(config.worlds, dtype=bool)
        while running.any():
            angles.append(_joints(batch, robot))
            step = batch.step(act(len(angles) - 1))
            length[running] = len(angles)
            running &= ~(step.terminated | step.truncated)
        way = batch.qpos[:, 0] - start
        return _records(robot, "metronome", index, np.array(angles), length, way, config)

    def network(index: int) -> list[dict[str, Any]]:
        run = trained(config.learner.run(context.seed + index))
        robot = run.config.task
        batch = _batch(robot, config, context, 1, index)
        angles: list[FloatArray] = []
        places: list[FloatArray] = []

        def watch(running: NDArray[np.bool_]) -> None:
            angles.append(_joints(batch, robot))
            places.append(batch.qpos[:, 0])

        length = run_episodes(batch, run.policy, watch=watch).lengths
        way = batch.qpos[:, 0] - places[0]
        name = f"{run.config.architecture.upper()}, trained"
        return _records(robot, name, index, np.array(angles), length, way, config)

    jobs = [(robot, index) for robot in ROBOTS for index in range(config.searches)]
    found = context.map(metronome, jobs, "metronomes")
    found += context.map(network, range(config.learner.seeds), "networks")
    return rows([record for records in found for record in records])


def _batch(robot: str, config: GaitsConfig, context: Context, *key: int) -> BatchTask:
    (seed,) = context.seeds(1, 5, 11, list(ROBOTS).index(robot), *key)
    steps = round(config.seconds / ROBOTS[robot].control_dt)
    return BatchTask(robot, config.worlds, seed=seed, max_episode_steps=steps)


def _joints(batch: BatchTask, robot: str) -> FloatArray:
    """Angles of the joints with motors, which stand last in a robot's position, ``(n, J)``."""
    return np.array(batch.qpos[:, -ROBOTS[robot].action_size :])


def _records(
    robot: str,
    controller: str,
    index: int,
    angles: FloatArray,
    length: NDArray[np.int_],
    way: FloatArray,
    config: GaitsConfig,
) -> list[dict[str, Any]]:
    """One row a world; a robot that falls too early to beat twice has no frequency."""
    dt = ROBOTS[robot].control_dt
    skip = round(config.skip / dt)
    found = []
    for world, n in enumerate(length):
        long_enough = (n - skip) * dt >= 2 / SLOWEST
        found.append(
            {
                "robot": robot,
                "controller": controller,
                "index": index,
                "world": world,
                "seconds": n * dt,
                "distance": way[world],
                "frequency": beat(angles[skip:n, world], dt) if long_enough else np.nan,
            }
        )
    return found


SECTION_5_5_2_GAITS = Experiment(
    id="section-5.5.2-gaits",
    item="Section 5.5.2",
    title="Frequency of a gait: metronomes, and a network after a short training",
    function=gaits,
    budgets={
        "smoke": GaitsConfig(
            search=SMOKE_SEARCH,
            searches=1,
            learner=LiveConfig(iterations=1, batch_steps=200, horizon=100, seeds=1),
            worlds=1,
        ),
        "book": GaitsConfig(),
        "thesis": GaitsConfig(searches=10),
    },
    columns={
        "robot": "name",
        "controller": "metronome, or the network that was trained; greedy, on flat ground",
        "index": "index of the search, or of the run",
        "world": "episode",
        "seconds": "length of the episode; less than asked for after a fall",
        "distance": "way of the root along x [m]",
        "frequency": "place of the highest peak of the summed spectra of the joint angles [Hz]; "
        "empty after an early fall",
    },
    seconds={"smoke": 3, "book": 170, "thesis": 900},
)
