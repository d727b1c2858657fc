"""Figures 4.7 and 4.8: feature selection with function approximation, on the heat domain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Literal, get_args

import numpy as np
import pandas as pd

from thesis_lib.arrays import BoolArray, FloatArray, IntArray
from thesis_lib.domains.heat import HeatTask
from thesis_lib.domains.heat_learning import HeatLearned
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.experiments.chapter4.heat_worlds import HeatLearner, HeatSpace
from thesis_lib.experiments.chapter4.protocol import (
    COLUMNS,
    Level,
    Protocol,
    selectors,
    summarise,
)
from thesis_lib.mdp.checks import one_of
from thesis_lib.selection import rates

RELEVANT = ("heat", "a")
"""What counts as domain relevant; see the experiment ``section-4.3-heat``."""

Lessons = Literal["plain", "shaped"]
"""Learn observed tasks from weights 0, or each from the potential of those before it."""

TASKS_SEEN = (3, 4, 5, 6, 7, 8, 10, 12)


@dataclass(frozen=True)
class HeatConfig:
    """Settings of figures 4.7 and 4.8."""

    space: HeatSpace = field(default_factory=HeatSpace)
    """The domain, its learner and its features; sigma_slip is .1."""
    sensors: tuple[float, ...] = (0.01, 0.02, 0.04, 0.06)
    """Values of sigma_sensor."""
    protocol: Protocol = field(default_factory=lambda: Protocol(tasks_seen=TASKS_SEEN))
    """Sizes."""
    first: int = 5
    """Episodes of a test task that the left panel counts."""
    followed: int = 100
    """Episodes of a test task that the right panel follows; 0 for none."""
    followed_sensor: float = 0.02
    """sigma_sensor of the right panel."""
    followed_at: tuple[int, ...] = (4, 5, 6, 8, 12)
    """Numbers of observed tasks of the right panel."""
    fstek: Level = "schedule"
    """Level of FS-TEK; not printed for this domain."""
    lessons: Lessons = "plain"
    """How the observed tasks are learned."""
    relevant: tuple[str, ...] = RELEVANT
    """Truth labels of ROC space, and what ``fixed`` keeps."""


@dataclass(frozen=True)
class Runs:
    """What the runs at one level of noise give.

    Attributes
    ----------
    sensor
        sigma_sensor.
    returns
        Return of each test episode, mean over test tasks, shape ``(runs, methods, numbers
        of tasks, episodes)``; NaN for episodes that were not run.
    support
        Features kept, shape ``(runs, methods, numbers of tasks, F)``.
    unsure
        Number of features FS-TEK was unsure about, shape ``(runs, methods, numbers)``.
    """

    sensor: float
    returns: FloatArray
    support: BoolArray
    unsure: IntArray


def measure_heat(config: HeatConfig, space: HeatSpace, context: Context, test: bool) -> Runs:
    """Run the protocol at one level of noise.

    Every run learns its own observed tasks afresh.  Within a run all
    methods see the same tasks, test on the same tasks and draw the same random numbers.

    Parameters
    ----------
    config
        Settings.
    space
        The domain, with its noise.
    context
        Seed and workers.  Levels of noise share the seed, hence the tasks.
    test
        Whether to learn the test tasks; without, returns are NaN.
    """
    protocol, grid = config.protocol, config.protocol.tasks_seen
    follow = config.followed > 0 and space.world.sensor == config.followed_sensor
    length = max(config.first, config.followed if follow else 0)

    def one(seed: np.random.SeedSequence) -> tuple[FloatArray, BoolArray, IntArray]:
        rng, lessons, picks = (np.random.default_rng(s) for s in seed.spawn(3))
        observed = space.sample_tasks(max(grid), rng)
        seen = space.solutions(learn_in_turn(space, observed, lessons, config.lessons))
        available = selectors(config.fstek, "unsure", config.relevant, picks)
        shape = len(protocol.methods), len(grid)
        returns = np.full((*shape, length), np.nan)
        support = np.empty((*shape, seen.n_features), dtype=bool)
        unsure = np.zeros(shape, dtype=np.int64)
        for j, n in enumerate(grid):
            solutions = seen.take(np.arange(n))
            tests = space.sample_tasks(protocol.tests, rng)
            draws = rng.integers(2**63, size=protocol.tests)
            episodes = length if follow and n in config.followed_at else config.first
            known: dict[bytes, FloatArray] = {}
            for i, method in enumerate(protocol.methods):
                selector = available[method].fit(solutions)
                support[i, j] = selector.support_
                unsure[i, j] = len(getattr(selector, "unsure_", ()))
                if not test:
                    continue
                code = selector.support_.tobytes()
                if code not in known:
                    phi = space.potential(solutions, selector.support_)
                    known[code] = np.mean(
                        [
                            space.learn(
                                task, int(draw), episodes=episodes, initial_weights=phi
                            ).episode_returns
                            for task, draw in zip(tests, draws, strict=True)
                        ],
                        axis=0,
                    )
                returns[i, j, :episodes] = known[code]
        return returns, support, unsure

    label = f"heat, sensor noise {space.world.sensor:g}"
    results = context.map(one, context.seeds(protocol.runs, 4, 20), label)
    returns, support, unsure = (np.stack(part) for part in zip(*results, strict=True))
    return Runs(space.world.sensor, returns, support, unsure)


def learn_in_turn(
    space: HeatSpace, tasks: Sequence[HeatTask], rng: np.random.Generator, lessons: Lessons
) -> list[HeatLearned]:
    """Learn the observed tasks, in their order.

    Parameters
    ----------
    space
        The domain and its learner.
    tasks
        The tasks.
    rng
        Goes on from task to task.
    lessons
        ``"shaped"`` starts each task from the potential, without selection, of the tasks
        before it.
    """
    one_of("lessons", lessons, get_args(Lessons))
    learned: list[HeatLearned] = []
    for task in tasks:
        start = None
        if lessons == "shaped" and learned:
            before = space.solutions(learned)
            start = space.potential(before, np.ones(before.n_features, dtype=bool))
        learned.append(space.learn(task, rng, initial_weights=start))
    return learned


def run_figure_4_7(config: HeatConfig, context: Context) -> pd.DataFrame:
    """Compute figure 4.7; columns are documented in :data:`FIGURE_4_7`."""
    records: list[dict[str, float | str | int]] = []
    for sensor in config.sensors:
        space = config.space.with_noise(sensor)
        runs = measure_heat(config, space, context, test=True)
        truth = _truth(config, space)
        records += _records(runs, "first episodes", (1, config.first), config.protocol, truth)
        if sensor != config.followed_sensor or not config.followed:
            continue
        at = [j for j, n in enumerate(config.protocol.tasks_seen) if n in config.followed_at]
        part = Runs(sensor, runs.returns[:, :, at], runs.support[:, :, at], runs.unsure[:, :, at])
        size = replace(config.protocol, tasks_seen=tuple(config.protocol.tasks_seen[j] for j in at))
        records += _records(part, "all followed", (1, config.followed), size, truth)
        for block in blocks(config.followed):
            records += _records(part, "by episode", block, size, truth)
    return rows(records)


def blocks(last: int) -> list[tuple[int, int]]:
    """Blocks of episodes that widen in proportion, as pairs of first and last, from 1 on."""
    edges = np.unique(np.geomspace(1, last + 1, 18).round().astype(int)).tolist()
    return [(a, b - 1) for a, b in pairwise(edges)]


def _records(
    runs: Runs, panel: str, span: tuple[int, int], size: Protocol, truth: BoolArray
) -> list[dict[str, float | str | int]]:
    """Rows on the total return of the episodes of a span."""
    first, last = span
    total = runs.returns[..., first - 1 : last].sum(axis=-1)
    told = summarise(size, total, runs.support, runs.unsure, truth)
    head: dict[str, float | str | int] = {
        "sensor": runs.sensor,
        "panel": panel,
        "first_episode": first,
        "last_episode": last,
    }
    return [{**head, **record} for record in told]


def run_figure_4_8(config: HeatConfig, context: Context) -> pd.DataFrame:
    """Compute figure 4.8; columns are documented in :data:`FIGURE_4_8`."""
    records = []
    for sensor in config.sensors:
        space = config.space.with_noise(sensor)
        runs = measure_heat(config, space, context, test=False)
        truth = _truth(config, space)
        for i, method in enumerate(config.protocol.methods):
            for j, n in enumerate(config.protocol.tasks_seen):
                own = runs.support[:, i, j]
                fpr, tpr = rates(own, truth)
                records.append(
                    {
                        "sensor": sensor,
                        "method": method,
                        "tasks_seen": n,
                        "fpr": fpr,
                        "tpr": tpr,
                        "fpr_ci95": _half_width(own[:, ~truth]),
                        "tpr_ci95": _half_width(own[:, truth]),
                        **{
                            f"keeps_{name}": float(own[:, f].mean())
                            for f, name in enumerate(space.feature_names)
                        },
                        "unsure": float(runs.unsure[:, i, j].mean()),
                        "n_runs": len(own),
                    }
                )
    return rows(records)


def _half_width(kept: BoolArray) -> float:
    """Half-width of a normal 95% interval of a rate, with runs as the independent units."""
    share = kept.mean(axis=1)
    return float(1.96 * share.std(ddof=1) / np.sqrt(len(share)))


def _truth(config: HeatConfig, space: HeatSpace) -> BoolArray:
    return np.isin(space.feature_names, config.relevant)


SMALL = HeatConfig(
    space=HeatSpace(learner=HeatLearner(episodes=20)),
    sensors=(0.02, 0.06),
    protocol=Protocol(runs=2, tests=1, tasks_seen=(3, 4, 5)),
    first=2,
    followed=8,
    followed_at=(3, 5),
)

BOOK = HeatConfig(protocol=Protocol(runs=30, tasks_seen=TASKS_SEEN))

HEAD = {
    "sensor": "sigma_sensor; sigma_slip is .1",
    "panel": "first episodes (left), by episode (right), or all followed, their total",
    "first_episode": "first episode of a test task that counts, from 1",
    "last_episode": "last episode that counts",
}

FIGURE_4_7: Experiment[HeatConfig] = Experiment(
    id="figure-4.7",
    item="Figure 4.7",
    title="Feature selection on the heat domain: return of the first episodes, and by episode.",
    function=run_figure_4_7,
    budgets={"smoke": SMALL, "book": BOOK, "thesis": HeatConfig()},
    columns={
        **HEAD,
        **COLUMNS,
        "mean_return": "mean total reward of these episodes of a test task, over runs",
    },
    seconds={"smoke": 1, "book": 60, "thesis": 1000},
)

FIGURE_4_8: Experiment[HeatConfig] = Experiment(
    id="figure-4.8",
    item="Figure 4.8",
    title="Feature selection on the heat domain: ROC space by sensor noise, over tasks seen.",
    function=run_figure_4_8,
    budgets={"smoke": SMALL, "book": BOOK, "thesis": HeatConfig()},
    columns={
        "sensor": HEAD["sensor"],
        "method": COLUMNS["method"],
        "tasks_seen": COLUMNS["tasks_seen"],
        "fpr": COLUMNS["fpr"],
        "tpr": COLUMNS["tpr"],
        "fpr_ci95": "half-width of its normal 95% interval over runs",
        "tpr_ci95": "half-width of its normal 95% interval over runs",
        "keeps_x": "share of runs that keep x",
        "keeps_y": "share of runs that keep y",
        "keeps_heading": "share of runs that keep the heading",
        "keeps_heat": "share of runs that keep the heat",
        "keeps_a": "share of runs that keep the action",
        "unsure": COLUMNS["unsure"],
        "n_runs": COLUMNS["n_runs"],
    },
    seconds={"smoke": 1, "book": 26, "thesis": 430},
)
