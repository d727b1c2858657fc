"""The protocol of section 4.3: select features after each task, shape, and measure the return."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal

import numpy as np
import pandas as pd
from scipy.stats import norm

from thesis_lib.arrays import BoolArray
from thesis_lib.chapter3.runs import TabularLearner
from thesis_lib.chapter4.runs import Rated, Run, SolvedDomain, run_selectors
from thesis_lib.edition.experiment import Context
from thesis_lib.selection import (
    FSTEK,
    IBKR,
    FixedFeatures,
    JackknifeF,
    NoSelection,
    RandomSelection,
    Selector,
    triangle_alpha,
)

Level = float | Literal["schedule"]
"""A constant level, or the rising schedule the thesis prints for the triangle."""

Flat = Literal["limit", "unsure"]
"""What FS-TEK makes of a relevance that is the same for every k; see its parameter ``flat``."""

METHODS = ("fs-tek", "ibkr", "jackknife", "fixed", "random", "none", "constant")

FEW = 6
"""Largest number of tasks that counts as few."""


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


SMALL = Protocol(runs=2, tests=1, tasks_seen=(3, 4, 5))
"""At the smoke budget."""


@dataclass(frozen=True)
class Selected(Rated):
    """One method after one number of observed tasks."""

    method: str
    """fs-tek, ibkr, jackknife (this edition's), fixed, random, none, constant."""
    features_kept: float
    """Mean number of features kept."""
    unsure: float
    """Mean number of features the selector is unsure about, and keeps."""
    fstek_minus: float
    """FS-TEK's return less this method's, paired by run, mean."""
    fstek_minus_ci95: float
    """Half-width of its 95% t interval."""
    none_minus: float
    """Return without selection less this method's, paired by run, mean."""
    none_minus_ci95: float
    """Half-width of its 95% t interval."""


def measure(
    solved: SolvedDomain,
    learner: TabularLearner,
    protocol: Protocol,
    fstek: Level,
    flat: Flat,
    context: Context,
    key: int,
) -> list[dict[str, Any]]:
    """Run the protocol on one domain; see :func:`~thesis_lib.chapter4.runs.run_selectors`.

    Parameters
    ----------
    solved
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
    list of dict
        Fields of :class:`Selected`, one row a method and number of tasks.
    """

    def one(seed: np.random.SeedSequence) -> Run:
        rng, picks = (np.random.default_rng(s) for s in seed.spawn(2))
        available = selectors(fstek, flat, solved.relevant, picks)
        own = [available[method] for method in protocol.methods]
        sizes = (learner, protocol.tasks_seen, protocol.tests)
        return run_selectors(solved, *sizes, rng, lambda: own, protocol.unseen)

    runs = context.map(one, context.seeds(protocol.runs, 4, key), solved.domain.name)
    return summarise(protocol, Run.stack(runs), solved.truth)


def summarise(protocol: Protocol, runs: Run, truth: BoolArray) -> list[dict[str, Any]]:
    """Fields of :class:`Selected`, one row a method and number of tasks.

    Parameters
    ----------
    protocol
        Its numbers of tasks and methods name the axes.
    runs
        Stacked.
    truth
        Which features are domain relevant, shape ``(F,)``.
    """
    fstek, none = (protocol.methods.index(other) for other in ("fs-tek", "none"))
    records = []
    for (i, method), (j, n) in product(enumerate(protocol.methods), enumerate(protocol.tasks_seen)):
        by_fstek, by_none = (runs.ahead_of(j, other, i) for other in (fstek, none))
        records.append(
            {
                "method": method,
                "tasks_seen": n,
                "features_kept": float(runs.support[:, j, i].sum(axis=-1).mean()),
                "unsure": float(runs.unsure[:, j, i].mean()),
                "fstek_minus": by_fstek.mean,
                "fstek_minus_ci95": by_fstek.half_width,
                "none_minus": by_none.mean,
                "none_minus_ci95": by_none.half_width,
                **runs.rated(j, i, truth),
            }
        )
    return records


def row(table: pd.DataFrame, method: str, n: int) -> pd.Series:
    """A method's row after n tasks, of a table of :class:`Selected`."""
    return table[(table.method == method) & (table.tasks_seen == n)].iloc[0]


def gains(table: pd.DataFrame) -> pd.DataFrame:
    """FS-TEK's paired gain over no selection by number of tasks, from 4 on, where it can be."""
    own = table[(table.method == "none") & (table.tasks_seen >= 4)]
    return own.set_index("tasks_seen")[["fstek_minus", "fstek_minus_ci95"]]


def ahead(rows: pd.DataFrame, gap: str = "fstek_minus") -> pd.Series:
    """Whether a paired difference lies above 0 by its 95% interval, row by row."""
    return rows[gap] > rows[f"{gap}_ci95"]


def behind(rows: pd.DataFrame, gap: str = "fstek_minus") -> pd.Series:
    """Whether a paired difference lies below 0 by its 95% interval, row by row."""
    return -rows[gap] > rows[f"{gap}_ci95"]


def beside_fstek(
    tables: Iterable[pd.DataFrame], method: str, tasks_seen: Iterable[int]
) -> dict[str, int]:
    """In how many cells of figures 4.3 to 4.6 a method earns more, or less, than FS-TEK.

    Parameters
    ----------
    tables
        Of :class:`Selected`, one row a method, number of tasks and, in figure 4.6, of factors.
    method
        Compared by paired 95% intervals, not corrected.
    tasks_seen
        Numbers of tasks that count.

    Returns
    -------
    dict
        Number of ``cells``, and in how many it earns ``more`` and ``less``.
    """
    few = list(tasks_seen)
    own = pd.concat([t[(t.method == method) & t.tasks_seen.isin(few)] for t in tables])
    return {"cells": len(own), "more": int(behind(own).sum()), "less": int(ahead(own).sum())}


def wider(choices: int) -> float:
    """Factor of a normal 95% interval that was looked at with others (Bonferroni).

    >>> round(wider(1), 3), round(wider(4), 3)
    (1.0, 1.274)
    """
    return float(norm.isf(0.025 / max(choices, 1)) / norm.isf(0.025))


def share_interval(share: pd.Series, runs: pd.Series | int, choices: int = 1) -> pd.DataFrame:
    """Wilson's 95% interval of a share of features kept or removed, row by row.

    As if the features of a run went together, which is the most that they can vary.

    Parameters
    ----------
    share
        In [0, 1].
    runs
        Over how many runs, at least 1.
    choices
        With how many others each was looked at (Bonferroni).

    Returns
    -------
    DataFrame
        Columns ``low`` and ``high``, with the index of the shares.

    Examples
    --------
    >>> share_interval(pd.Series([0.4, 1.0]), pd.Series([120, 120])).round(3).values.tolist()
    [[0.317, 0.489], [0.969, 1.0]]
    """
    squared = norm.isf(0.025 / max(choices, 1)) ** 2 / runs
    middle = (share + squared / 2) / (1 + squared)
    half = (squared * share * (1 - share) + squared**2 / 4) ** 0.5 / (1 + squared)
    return pd.DataFrame({"low": middle - half, "high": middle + half})
