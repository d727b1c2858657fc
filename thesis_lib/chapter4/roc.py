"""The place of the selectors in ROC space, on domains that led to none of them too."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.arrays import BoolArray
from thesis_lib.chapter4 import looks
from thesis_lib.chapter4.figure_4_4 import POSITION
from thesis_lib.chapter4.looks import SYMBOLS, two_rates
from thesis_lib.chapter4.runs import Placed, exact_solutions, place
from thesis_lib.domains import Domain, continuing_cliff, stock, triangle
from thesis_lib.domains.planted import random_domain, torus
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.plots import legend_of, unclutter
from thesis_lib.relevance import Solutions
from thesis_lib.selection import (
    FSTEK,
    IBKR,
    ExactRelevance,
    JackknifeF,
    LeaveOneTaskOut,
    Selector,
    triangle_alpha,
)

FAMILIES: Mapping[str, Callable[[], Domain]] = {
    "triangle": triangle,
    "cliff": continuing_cliff,
    "stock G=1": lambda: stock(1, 2, 1),
    "stock G=3": lambda: stock(1, 2, 3),
    "stock S=2": lambda: stock(2, 2, 1),
    "random MDP a": lambda: random_domain(101),
    "random MDP b": lambda: random_domain(202, relevant=3, irrelevant=2, signal=1.0),
    "torus": torus,
}
"""Domains of the thesis, and three families of ours: stock with two sectors, random MDPs with
planted features, and a gridworld with distractors."""

NEW = ("stock S=2", "random MDP a", "random MDP b", "torus")
"""Domains that neither the thesis nor our earlier work used."""

SELECTORS: Mapping[str, Callable[[], Selector]] = {
    "fs-tek": lambda: FSTEK(1e-4),
    "fs-tek schedule": lambda: FSTEK(triangle_alpha),
    "ibkr": lambda: IBKR(),
    "jackknife": lambda: JackknifeF(),
    "jackknife box": lambda: JackknifeF(null="box"),
    "cross-validation": lambda: LeaveOneTaskOut(),
    "cross-validation, mean": lambda: LeaveOneTaskOut("mean"),
    "cross-validation, coarser": lambda: LeaveOneTaskOut("coarser"),
}
"""Selectors compared in ROC space; cross-validation of a potential that is 0 where no task was,
as in the figures of section 4.3, and of two others."""


@dataclass(frozen=True)
class Config:
    """Settings of the comparison in ROC space."""

    runs: int = 200
    """Sequences of tasks a domain."""
    tasks_seen: tuple[int, ...] = (4, 6, 8, 12, 20)
    """Numbers of observed tasks."""
    domains: tuple[str, ...] = tuple(FAMILIES)
    """Domains."""


@dataclass(frozen=True)
class Place(Placed):
    """One selector after one number of tasks on one domain."""

    domain: str
    """Name."""
    new: bool
    """Whether neither the thesis nor the earlier notes used it."""
    method: str
    """Selector; fs-tek at 1e-4 or by the triangle's schedule."""
    exact: float
    """Share of runs with exactly the relevant features kept."""


def labelled(name: str) -> tuple[Solutions, BoolArray]:
    """Solutions of a domain, and which features are relevant there, the cliff's position not."""
    solutions = exact_solutions(FAMILIES[name]())
    truth = ExactRelevance().fit(solutions).support_
    return solutions, truth & ~solutions.mask(POSITION) if name == "cliff" else truth


@experiment(
    "ch4-roc",
    item="Jackknife F (ROC)",
    smoke=Config(runs=2, tasks_seen=(4,), domains=("triangle", "random MDP a")),
    book=Config(runs=30),
    thesis=Config(runs=500),
    seconds=26,
)
def places(config: Config, context: Context) -> list[Place]:
    """False and true positive rates of FS-TEK, IBKR, F-test and cross-validation, on 8 domains."""

    def one(name: str) -> list[Place]:
        solutions, truth = labelled(name)
        shape = len(SELECTORS), len(config.tasks_seen), config.runs, len(truth)
        support = np.empty(shape, dtype=bool)
        # A stream of its own: no experiment that led to the selector has used it.
        seeds = context.seeds(config.runs, 8, tuple(FAMILIES).index(name))
        most = max(config.tasks_seen)
        for r, seed in enumerate(seeds):
            tasks = np.random.default_rng(seed).integers(solutions.n_tasks, size=most)
            for j, n in enumerate(config.tasks_seen):
                seen = solutions.take(tasks[:n])
                for i, make in enumerate(SELECTORS.values()):
                    support[i, j, r] = make().fit(seen).support_
        return [
            Place(
                domain=name,
                new=name in NEW,
                method=method,
                tasks_seen=n,
                exact=float((support[i, j] == truth).all(axis=1).mean()),
                **place(support[i, j], truth),
            )
            for (i, method), (j, n) in product(enumerate(SELECTORS), enumerate(config.tasks_seen))
        ]

    return [row for part in context.map(one, config.domains, "roc") for row in part]


def figure(table: pd.DataFrame) -> Figure:
    """ROC space of every domain, one panel each."""
    domains = table.domain.unique()
    columns = min(4, len(domains))
    n_rows = -(-len(domains) // columns)
    size = (7.2, 0.8 + 2.0 * n_rows)
    fig, axes = plt.subplots(n_rows, columns, figsize=size, sharex=True, sharey=True, squeeze=False)
    methods = ("fs-tek", "fs-tek schedule", "ibkr", "jackknife", "cross-validation")
    for ax, domain in zip(axes.flat, domains, strict=False):
        own = table[table.domain == domain]
        looks.roc(ax, own, methods, near=0.15)
        ax.set_title(domain + (" (new)" if own.new.any() else ""), fontsize=8)
        ax.tick_params(labelsize=7)
        ax.set(xlabel="", ylabel="")
    for ax in axes.flat[len(domains) :]:
        ax.axis("off")
    for ax in axes[-1]:
        ax.set_xlabel("false positive rate", fontsize=8)
    for ax in axes[:, 0]:
        ax.set_ylabel("true positive rate", fontsize=8)
    legend_of(axes[0, 0], 5, fontsize=8)
    return unclutter(fig)


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Rates after few and after the most tasks, one row a domain."""
    grid = sorted(table.tasks_seen.unique())
    at = (grid[len(grid) // 4], grid[-1])
    own = table[
        table.method.isin(("fs-tek schedule", "jackknife", "cross-validation"))
        & table.tasks_seen.isin(at)
    ]
    wide = own.assign(cell=two_rates(own)).pivot(
        index="domain", columns=["tasks_seen", "method"], values="cell"
    )
    wide.columns = [f"{SYMBOLS[method]}, n = {n}" for n, method in wide]
    return wide.reindex(table.domain.unique()).reset_index()


def charged(table: pd.DataFrame) -> pd.DataFrame:
    """By how much cross-validation keeps less if features are charged where no task was.

    Returns
    -------
    DataFrame
        By domain, of those where that tells, the mean over numbers of tasks of the ``fpr`` and
        ``tpr`` with the coarser cell's value there less those with 0.
    """
    by = table.set_index(["method", "domain", "tasks_seen"])[["fpr", "tpr"]]
    less = by.loc["cross-validation, coarser"] - by.loc["cross-validation"]
    told = less[(less != 0).any(axis=1)].index.unique("domain")
    return less.groupby("domain", sort=False).mean().loc[[d for d in FAMILIES if d in told]]


def against_the_schedule(table: pd.DataFrame) -> dict[str, int]:
    """Where the jackknife F differs significantly from FS-TEK with its schedule.

    Returns
    -------
    dict
        Number of ``cells`` of domain and number of tasks, and in how many the jackknife F has a
        lower ``fpr`` and a lower ``tpr``.
    """
    by = table.set_index(["method", "domain", "tasks_seen"])
    ours, theirs = by.loc["jackknife"], by.loc["fs-tek schedule"]
    lower = {
        rate: int(
            (
                theirs[rate] - ours[rate] > np.hypot(theirs[f"{rate}_ci95"], ours[f"{rate}_ci95"])
            ).sum()
        )
        for rate in ("fpr", "tpr")
    }
    return {"cells": len(ours), **lower}
