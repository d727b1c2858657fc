"""Figure 4.6: feature selection on stock trading with 1 to 5 global factors."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.chapter3.runs import SETTINGS, TabularLearner
from thesis_lib.chapter4 import looks
from thesis_lib.chapter4.looks import SYMBOLS
from thesis_lib.chapter4.protocol import (
    SMALL,
    Flat,
    Level,
    Protocol,
    Selected,
    ahead,
    behind,
    measure,
    wider,
)
from thesis_lib.chapter4.runs import Source, solve_domain
from thesis_lib.domains import stock
from thesis_lib.edition.criteria import graded, judged, positive
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.plots import legend_of, unclutter
from thesis_lib.edition.words import plus_minus, several
from thesis_lib.stats import power_within

RIVALS = ("ibkr", "none", "random", "fixed")
"""The methods of the thesis beside FS-TEK."""

MARGIN = 0.05
"""Difference of returns that counts as none, as a share of the return."""


@dataclass(frozen=True)
class Config:
    """Settings of figure 4.6."""

    global_factors: tuple[int, ...] = (1, 2, 3, 4, 5)
    """G."""
    protocol: Protocol = field(default_factory=Protocol)
    """Sizes."""
    learner: TabularLearner = SETTINGS["stock"].learners[0]
    """Learning and exploration rate: the best of figure 3.4."""
    discount: float = 0.9
    """gamma, not printed."""
    low: Level = 1e-4
    """Level of FS-TEK for G < 4."""
    high: Level = "schedule"
    """Level for G >= 4: one "that increases with k", its formula not printed."""
    flat: Flat = "limit"
    """Ownership has relevance 0 exactly; learned values would give it a small falling one."""
    source: Source = "exact"
    """Exact solutions of the observed tasks, or learned ones."""


@dataclass(frozen=True)
class StockSelected(Selected):
    """One method after one number of observed tasks, for one number of factors."""

    global_factors: int
    """G."""


@experiment(
    "figure-4.6",
    item="Figure 4.6",
    smoke=Config(global_factors=(1, 4), protocol=SMALL),
    book=Config(protocol=Protocol(runs=60)),
    thesis=Config(),
    seconds=26,
)
def by_factors(config: Config, context: Context) -> list[StockSelected]:
    """Feature selection on stock trading with 1 to 5 global factors."""
    records = []
    for g in config.global_factors:
        domain = stock(1, 2, g, discount=config.discount)
        solved = solve_domain(domain, config.learner, context, source=config.source)
        level = config.low if g < 4 else config.high
        sizes = (config.learner, config.protocol, level, config.flat)
        records += [
            StockSelected(global_factors=g, **fields)
            for fields in measure(solved, *sizes, context, 10 + g)
        ]
    return records


def control(table: pd.DataFrame) -> dict[str, int]:
    """In how many cells of factors and number of tasks a constant potential earns more, or less.

    Parameters
    ----------
    table
        Of :class:`StockSelected`.

    Returns
    -------
    dict
        Number of ``cells``; in how many the constant earns significantly more than no selection
        (``over_none``, paired), and more and less than fixed features (``over_fixed`` and
        ``under_fixed``, as if the two were unpaired), by 95% intervals, not corrected.
    """
    own = table[table.method == "constant"]
    by = table.set_index(["global_factors", "tasks_seen", "method"])
    earned, half = by.mean_return.unstack(), by.ci95.unstack()
    gap, error = earned.constant - earned.fixed, np.hypot(half.constant, half.fixed)
    return {
        "cells": len(own),
        "over_none": int(behind(own, "none_minus").sum()),
        "over_fixed": int((gap > error).sum()),
        "under_fixed": int((gap < -error).sum()),
    }


def _rivals(table: pd.DataFrame, *methods: str) -> pd.DataFrame:
    """Rows of some methods from 4 tasks on, and whether FS-TEK is better or worse there."""
    own = table[table.method.isin(methods) & (table.tasks_seen >= 4)]
    return own.assign(better=ahead(own), worse=behind(own))


@criterion("4.3-stock-outperforms", by_factors)
def outperforms(table: pd.DataFrame) -> Finding:
    """In how many comparisons with each rival FS-TEK is significantly better, G < 4."""
    own = _rivals(table[table.global_factors < 4], *RIVALS, "constant")
    by = own.groupby("method")[["better", "worse"]].mean()
    listed = several(
        f"{by.better[m]:.0%} and {by.worse[m]:.0%} (against {SYMBOLS[m]})"
        for m in (*RIVALS, "constant")
    )
    better = by.better[list(RIVALS)]
    beside = own[own.method.isin(RIVALS)]
    above = (beside.fstek_minus > 0).groupby(beside.method).mean()
    lost, close = (
        which.groupby(beside.method).mean() for which in (_surely_worse(beside), _no_better(beside))
    )
    means = several(f"{above[m]:.0%} (against {SYMBOLS[m]})" for m in RIVALS)
    counted = several(f"{lost[m]:.0%} and {close[m]:.0%} (against {SYMBOLS[m]})" for m in RIVALS)
    return Finding(
        graded(
            (better > 0.5).all(),
            direction=(better[["ibkr", "none"]] > 0.3).all() and (above > 0.5).all(),
            denied=(lost > 0.5).any(),
            otherwise=Verdict.NOT_REPRODUCED if (close > 0.5).any() else Verdict.INCONCLUSIVE,
        ),
        "Share of the comparisons in which FS-TEK is better and in which it is worse (G = 1 to 3, "
        f"4 tasks or more, paired 95% intervals): {listed}. In the mean it is ahead in {means}. "
        f"Corrected for all {len(beside)}, it is worse, and shown to be at most {MARGIN:.0%} "
        f"better, in {counted}.",
        dict(by.better),
    )


def _surely_worse(rows: pd.DataFrame) -> pd.Series:
    """Whether FS-TEK's paired gain is below 0, row by row (Bonferroni over the rows)."""
    return rows.fstek_minus + rows.fstek_minus_ci95 * wider(len(rows)) < 0


def _no_better(rows: pd.DataFrame) -> pd.Series:
    """Whether it is not above 0 and shown to be at most 5% of the return, row by row."""
    half = rows.fstek_minus_ci95 * wider(len(rows))
    return (rows.fstek_minus + half < MARGIN * rows.mean_return.abs()) & ~rows.better


@criterion("4.3-stock-deteriorates", by_factors)
def deteriorates(table: pd.DataFrame) -> Finding:
    """FS-TEK's gain over IBKR and no selection for G of 4 and more, and at G = 1."""
    own = _rivals(table, "ibkr", "none")
    low, high = own[own.global_factors == 1], own[own.global_factors >= 4]
    # Numbers of tasks share runs, so their errors may be fully correlated: they are averaged.
    (first, half), (last, error) = (
        at[["fstek_minus", "fstek_minus_ci95"]].mean() for at in (low, high)
    )
    gap, margin = high.fstek_minus.abs(), MARGIN * high.mean_return.abs()
    near = float((gap + high.fstek_minus_ci95 < margin).mean())
    far = float((gap - high.fstek_minus_ci95 > margin).mean())
    falls = first - last > np.hypot(half, error)
    return judged(
        near > 0.5 and falls,
        f"Mean paired gain {plus_minus(first, half)} at G = 1 and {plus_minus(last, error)} from "
        f"G = 4 on, where the paired 95% interval lies within {MARGIN:.0%} of the rival's return "
        f"in {near:.0%} of the comparisons and beyond it in {far:.0%}; "
        f"without any difference it would lie within, in half of them, in at least "
        f"{np.median(power_within(margin, high.fstek_minus_ci95)):.0%} of samples.",
        {"first": first, "last": last, "near": near},
        direction=falls,
        otherwise=Verdict.REFUTED if far > 0.5 else Verdict.INCONCLUSIVE,
    )


@criterion("4.3-stock-fixed", by_factors)
def beats_fixed_features(table: pd.DataFrame) -> Finding:
    """FS-TEK against fixed features at G = 1, paired."""
    own = _rivals(table[table.global_factors == 1], "fixed")
    listed = several(
        f"{r.fstek_minus:+.1f} ± {r.fstek_minus_ci95:.1f} at {r.tasks_seen}"
        for r in own.itertuples()
    )
    surely = own.fstek_minus > own.fstek_minus_ci95 * wider(len(own))
    lost, close = _surely_worse(own), _no_better(own)
    return Finding(
        graded(
            own.better.mean() > 0.5 and not own.worse.any(),
            direction=surely.any(),
            denied=lost.mean() > 0.5,
            otherwise=Verdict.NOT_REPRODUCED if close.mean() > 0.5 else Verdict.INCONCLUSIVE,
        ),
        f"Paired gain over fixed features at G = 1: {listed}. Corrected for the {len(own)} numbers "
        f"of tasks, it is above 0 at {surely.sum()}, below at {lost.sum()} and shown to be at most "
        f"{MARGIN:.0%} at {close.sum()}.",
        {"better": float(own.better.mean()), "worse": float(own.worse.mean())},
    )


@criterion("4.3-stock-importance", by_factors)
def what_matters(table: pd.DataFrame) -> Finding:
    """A constant potential beside one on all features: false against true positives, over G."""
    own = table[table.method == "constant"]
    # Numbers of tasks share runs, so their errors may be fully correlated: they are averaged.
    by = own.groupby("global_factors")[["none_minus", "none_minus_ci95"]].mean()
    low, high = by.index.min(), by.index.max()
    contrasts = {
        f"G = {g}, {name}": (sign * float(by.none_minus[g]), float(by.none_minus_ci95[g]) / 1.96)
        for g, sign, name in ((low, -1, "none over all"), (high, 1, "all over none"))
    }
    found = positive(
        contrasts,
        "Paired return, mean over the numbers of tasks, of selecting no feature (0/0, a constant "
        "potential) over selecting all (1/1), and the reverse",
    )
    mean = table.groupby(["global_factors", "method"]).mean_return.mean().unstack()
    gap = (mean.fixed - mean.constant) / mean.constant.abs()
    listed = several(f"{v:+.0%} at G = {g}" for g, v in gap.items())
    return replace(
        found,
        evidence=f"{found.evidence} Return of the relevant features relative to a constant "
        f"potential: {listed} (below 0 it pays to remove the relevant ones too).",
    )


def figure(table: pd.DataFrame) -> Figure:
    """Returns and ROC space on stock, one row a number of global factors."""
    sizes = sorted(table.global_factors.unique())
    size = (7.2, 0.8 + 1.9 * len(sizes))
    fig, axes = plt.subplots(len(sizes), 2, figsize=size, sharex="col", squeeze=False)
    for (left, right), g in zip(axes, sizes, strict=True):
        own = table[table.global_factors == g]
        looks.returns(left, own)
        looks.roc(right, own, near=0.12)
        left.set_ylabel(f"return, G = {g}", fontsize=9)
        right.set_ylabel("TPR", fontsize=9)
    for ax in axes.flat:
        ax.tick_params(labelsize=8)
    for ax in axes[:-1].flat:
        ax.set_xlabel("")
    legend_of(axes[0, 0], 4, fontsize=8)
    return unclutter(fig)
