"""The protocol of section 4.3: select features after each task, shape, and measure the return."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd

from thesis_lib.arrays import BoolArray, FloatArray, IntArray
from thesis_lib.chapter3.runs import Learner
from thesis_lib.edition.experiment import Context, rows
from thesis_lib.experiments.chapter4.worlds import World
from thesis_lib.mdp.batched import TaskBatch
from thesis_lib.selection import (
    FSTEK,
    IBKR,
    FixedFeatures,
    JackknifeF,
    NoSelection,
    RandomSelection,
    Selector,
    rates,
    triangle_alpha,
)
from thesis_lib.stats import mean_ci

Level = float | Literal["schedule"]
"""A constant level, or the rising schedule the thesis prints for the triangle."""

Flat = Literal["limit", "unsure"]
"""What FS-TEK makes of a relevance that is the same for every k; see its parameter ``flat``."""

METHODS = ("fs-tek", "ibkr", "jackknife", "fixed", "random", "none", "constant")

SYMBOLS: Mapping[str, str] = {
    "fs-tek": "FS-TEK",
    "fs-tek schedule": "FS-TEK, schedule",
    "ibkr": "IBKR",
    "jackknife": "jackknife F",
    "jackknife box": "jackknife F, box",
    "fixed": "fixed features",
    "random": "random features",
    "none": "no selection",
    "constant": "constant",
}
"""How figures name the methods."""


def level(value: Level) -> float | Callable[[int], float]:
    """The level as a selector wants it."""
    return triangle_alpha if value == "schedule" else value


def selectors(
    fstek: Level, flat: Flat, relevant: tuple[str, ...], rng: np.random.Generator
) -> dict[str, Selector]:
    """A selector for each method, in the order of :data:`METHODS`.

    Parameters
    ----------
    fstek, flat
        Level of FS-TEK, and what a constant relevance is to it.
    relevant
        Names of the features that ``fixed`` keeps.
    rng
        Draws the features of ``random``.
    """
    return {
        "fs-tek": FSTEK(alpha=level(fstek), flat=flat),
        "ibkr": IBKR(),
        "jackknife": JackknifeF(),
        "fixed": FixedFeatures(relevant),
        "random": RandomSelection(random_state=rng),
        "none": NoSelection(),
        "constant": FixedFeatures(()),
    }


@dataclass(frozen=True)
class Protocol:
    """How often and when a domain's selectors are measured."""

    runs: int = 500
    """Independent sequences of tasks."""
    tests: int = 10
    """Tasks drawn from the domain to learn with each potential."""
    tasks_seen: tuple[int, ...] = (3, 4, 5, 6, 7, 8, 10, 12, 15, 20)
    """Numbers of observed tasks after which to measure."""
    methods: tuple[str, ...] = METHODS
    """Selectors compared."""
    unseen: float = 0.0
    """Potential of pairs that no observed task visits."""


def measure(
    world: World,
    learner: Learner,
    protocol: Protocol,
    fstek: Level,
    flat: Flat,
    context: Context,
    key: int,
) -> pd.DataFrame:
    """Run the protocol on one domain.

    Within a run all methods see the same tasks, test on the same tasks and draw the same
    random numbers, so that differences between methods are paired.

    Parameters
    ----------
    world
        The domain with its solutions.
    learner
        Learns the test tasks.
    protocol
        Sizes.
    fstek, flat
        Level of FS-TEK, and what a constant relevance is to it.
    context
        Seed and workers.
    key
        Sets this domain's randomness apart from others'.

    Returns
    -------
    pandas.DataFrame
        One row a method and number of tasks; columns :data:`COLUMNS`.
    """
    names = world.solutions.feature_names
    relevant = tuple(n for n, true in zip(names, world.truth, strict=True) if true)
    grid = protocol.tasks_seen

    def one(seed: np.random.SeedSequence) -> tuple[FloatArray, BoolArray, IntArray]:
        rng, picks = (np.random.default_rng(s) for s in seed.spawn(2))
        seen = world.domain.sample(max(grid), rng)
        available = selectors(fstek, flat, relevant, picks)
        shape = len(protocol.methods), len(grid)
        returns = np.empty(shape)
        support = np.empty((*shape, len(names)), dtype=bool)
        unsure = np.zeros(shape, dtype=int)
        for j, n in enumerate(grid):
            solutions = world.solutions.take(seen[:n])
            tests = world.domain.sample(protocol.tests, rng)
            trial = Trial(world, learner, tests, rng.integers(2**63, size=protocol.tests))
            known: dict[bytes, float] = {}
            for i, method in enumerate(protocol.methods):
                selector = available[method]
                if n < selector.min_tasks:
                    selector = NoSelection()
                kept = selector.fit(solutions).support_
                support[i, j] = kept
                unsure[i, j] = len(getattr(selector, "unsure_", ()))
                code = kept.tobytes()
                if code not in known:
                    phi = world.potential(seen[:n], kept, protocol.unseen)
                    known[code] = trial.mean_return(phi)
                returns[i, j] = known[code]
        return returns, support, unsure

    results = context.map(one, context.seeds(protocol.runs, 4, key), world.domain.name)
    returns, support, unsure = (np.stack(part) for part in zip(*results, strict=True))
    return rows(summarise(protocol, returns, support, unsure, world.truth))


def summarise(
    protocol: Protocol,
    returns: FloatArray,
    support: BoolArray,
    unsure: IntArray,
    truth: BoolArray,
) -> list[dict[str, float | str | int]]:
    """Rows of :data:`COLUMNS` from the runs, one a method and number of tasks.

    Parameters
    ----------
    protocol
        Its methods and numbers of tasks name the axes.
    returns
        Mean return of the test tasks, shape ``(runs, methods, numbers of tasks)``.
    support
        Features kept, shape ``(runs, methods, numbers of tasks, F)``.
    unsure
        Number of features kept for want of a reliable estimate, shaped as ``returns``.
    truth
        Which features are domain relevant, shape ``(F,)``.
    """
    records = []
    for i, method in enumerate(protocol.methods):
        for j, n in enumerate(protocol.tasks_seen):
            fpr, tpr = rates(support[:, i, j], truth)
            own = mean_ci(returns[:, i, j])
            record: dict[str, float | str | int] = {
                "method": method,
                "tasks_seen": n,
                "fpr": fpr,
                "tpr": tpr,
                "mean_return": own.mean,
                "ci95": own.half_width,
                "sd": float(returns[:, i, j].std(ddof=1)),
                "n_runs": own.n,
                "features_kept": float(support[:, i, j].sum(axis=-1).mean()),
                "unsure": float(unsure[:, i, j].mean()),
            }
            for label, other in (("fstek_minus", "fs-tek"), ("none_minus", "none")):
                gap = mean_ci(returns[:, protocol.methods.index(other), j] - returns[:, i, j])
                record[label] = gap.mean
                record[f"{label}_ci95"] = gap.half_width
            records.append(record)
    return records


class Trial:
    """Tasks to be learned from one potential after another, with the same random numbers.

    Parameters
    ----------
    world
        The domain.
    learner
        How tasks are learned.
    tasks
        Their indices.
    seeds
        One a task.
    """

    def __init__(self, world: World, learner: Learner, tasks: IntArray, seeds: IntArray) -> None:
        self._batch = TaskBatch(
            [world.domain.tasks[m] for m in tasks],
            [world.rows(int(m)) for m in tasks],
            learner.method,
            alpha=learner.alpha,
            epsilon=learner.epsilon,
            episodes=learner.episodes,
            steps=learner.steps,
        )
        self._rngs = [np.random.default_rng(int(seed)) for seed in seeds]
        self._starts = [rng.bit_generator.state for rng in self._rngs]

    def mean_return(self, phi: FloatArray) -> float:
        """Mean total reward of the tasks.

        Parameters
        ----------
        phi
            The potential, shape ``(O, A)``.
        """
        for rng, start in zip(self._rngs, self._starts, strict=True):
            rng.bit_generator.state = start
        rewards = self._batch.total_rewards(phi, self._rngs)
        return sum(rewards.tolist()) / self._batch.n_tasks


COLUMNS = {
    "method": "fs-tek, ibkr, jackknife (this edition's), fixed, random, none, constant",
    "tasks_seen": "number of observed tasks n",
    "fpr": "share of the domain-irrelevant features kept, over all runs",
    "tpr": "share of the domain-relevant features kept, over all runs",
    "mean_return": "mean total reward of the test tasks, over runs",
    "ci95": "half-width of its 95% t interval over runs",
    "sd": "standard deviation over runs of a run's mean",
    "n_runs": "number of runs",
    "features_kept": "mean number of features kept",
    "unsure": "mean number of features the selector is unsure about, and keeps",
    "fstek_minus": "FS-TEK's return less this method's, paired by run, mean",
    "fstek_minus_ci95": "half-width of its 95% t interval",
    "none_minus": "return without selection less this method's, paired by run, mean",
    "none_minus_ci95": "half-width of its 95% t interval",
}
