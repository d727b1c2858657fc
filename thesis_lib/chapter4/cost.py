"""What k-relevance costs: algorithm 8 against the exact law."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator
from scipy.stats import t

from thesis_lib.arrays import FloatArray
from thesis_lib.chapter4.looks import SYMBOLS
from thesis_lib.edition.criteria import graded
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.plots import COLOURS, PRINTED
from thesis_lib.edition.words import number, plus_minus
from thesis_lib.relevance import Estimate, Solutions, ground
from thesis_lib.relevance.estimators import compare
from thesis_lib.selection import bkr

LARGE = 2**12
"""Pairs from which on what is done for each outweighs what is done once."""

LINEAR = 1.3
"""Largest power that counts as linear: sorting adds a logarithm, large tables leave the cache."""

GROWS = 0.25
"""Least power that counts as growth: what is done once bends a curve, and hardly flattens it."""


@dataclass(frozen=True)
class Config:
    """Settings of the timings."""

    bits: tuple[int, ...] = (8, 10, 12, 14, 16)
    """Binary features; there are 2^bits pairs."""
    tasks: tuple[int, ...] = (5, 10, 20, 40)
    """Observed tasks, at the middle number of features."""
    features: tuple[int, ...] = (4, 8, 16, 32)
    """Features of one and the same 4096 pairs."""
    max_seqs: tuple[int, ...] = (10, 30, 100, 300)
    """Sequences of algorithm 8, at the middle number of features and most tasks."""
    n_tasks: int = 10
    """Observed tasks where they do not vary."""
    n_seqs: int = 100
    """Sequences of algorithm 8 where they do not vary."""
    repeats: int = 2
    """The least of so many timings counts."""


@dataclass(frozen=True)
class Timing:
    """One method on one table."""

    method: str
    """Algorithm 8 for k = 1 .. n, or the exact law, which gives every k."""
    varied: str
    """What changes along the curve."""
    pairs: int
    """State-action pairs N."""
    features: int
    """Features P."""
    tasks: int
    """Observed tasks n."""
    max_seqs: int
    """Sequences sampled by algorithm 8, M."""
    cpu_seconds: float
    """Processor time of relevance of all features."""


def random_tables(bits: int, n_tasks: int, rng: np.random.Generator) -> Solutions:
    """Gaussian Q-functions over binary features, one uniform p(x|m)."""
    n = 2**bits
    features = (np.arange(n)[:, None] >> np.arange(bits)) & 1
    p = np.broadcast_to(np.full(n, 1.0 / n), (n_tasks, n))
    names = tuple(f"f{i}" for i in range(bits))
    return Solutions(rng.normal(size=(n_tasks, n)), p, features, names)


def same_pairs(n_features: int, n_tasks: int, rng: np.random.Generator) -> Solutions:
    """Gaussian Q-functions on 4096 pairs, told apart by few features or described by many.

    Parameters
    ----------
    n_features
        Fewer than 12 merge bits into larger features, more repeat random bits.
    n_tasks
        n.
    rng
        Source of the numbers.
    """
    base = random_tables(12, n_tasks, rng)
    if n_features < 12:
        parts = np.array_split(np.arange(12), n_features)
        columns = [base.features[:, i] @ (1 << np.arange(len(i))) for i in parts]
    else:
        extra = rng.integers(2, size=(base.n_pairs, n_features - 12))
        columns = [*base.features.T, *extra.T]
    names = tuple(f"f{i}" for i in range(n_features))
    return Solutions(base.q, base.p, np.stack(columns, axis=1), names)


@experiment(
    "ch4-cost",
    item="Complexity of BKR",
    smoke=Config(
        bits=(12, 13),
        tasks=(4, 8),
        features=(4, 8),
        max_seqs=(10, 20),
        n_tasks=3,
        n_seqs=10,
        repeats=1,
    ),
    book=Config(),
    thesis=Config(bits=(8, 10, 12, 14, 16, 18)),
    seconds=20,
)
def timings(config: Config, context: Context) -> list[Timing]:
    """Time of the k-relevance of all features for all k, by algorithm 8 and by the law."""
    rng = np.random.default_rng(context.seed)
    middle = config.bits[len(config.bits) // 2]
    n, size = config.n_tasks, config.n_seqs
    plan = [("pairs", bits, n, size) for bits in config.bits]
    plan += [("tasks", middle, tasks, size) for tasks in config.tasks]
    # So many tasks that there are more combinations than are sampled.
    plan += [("max_seqs", middle, max(config.tasks), size) for size in config.max_seqs]
    plan += [("features", count, n, size) for count in config.features]
    records = []
    for varied, bits, n, size in plan:
        make = same_pairs if varied == "features" else random_tables
        solutions = make(bits, n, rng)
        methods: dict[str, Callable[[], object]] = {
            "algorithm 8": partial(_by_sampling, solutions, size),
            "exact law": partial(_by_the_law, solutions),
        }
        for method, work in methods.items():
            seconds = _least(work, config.repeats)
            records.append(Timing(method, varied, solutions.n_pairs, bits, n, size, seconds))
    return records


def _by_the_law(solutions: Solutions) -> list[Estimate]:
    """Relevance of every feature for all k: U and b of each."""
    # A new object, so that nothing computed before is used again.
    cells = ground(solutions.take(np.arange(solutions.n_tasks)))
    return [compare(cells, cells.drop(i)) for i in cells.features]


def _by_sampling(solutions: Solutions, max_seqs: int) -> list[FloatArray]:
    """Relevance of every feature for k = 1 .. n, from sampled combinations."""
    return [bkr(solutions, (), max_seqs, k, 0) for k in range(1, solutions.n_tasks + 1)]


def _least(work: Callable[[], object], repeats: int) -> float:
    """Least processor time of several calls, seconds."""
    times = []
    for _ in range(repeats):
        # A clock of this thread alone: other threads may work beside it.
        start = time.thread_time()
        work()
        times.append(time.thread_time() - start)
    return min(times)


def slopes(table: pd.DataFrame, method: str) -> dict[str, tuple[float, float]]:
    """Slope of log time a feature over the log of what varies, each with a 95% half-width.

    The curves over pairs and over max_seqs have a line each and one variance about their lines,
    so that the intervals are t intervals of all their points.
    """
    fits, squares, free = {}, 0.0, 0
    for varied in ("pairs", "max_seqs"):
        at = table[(table.method == method) & (table.varied == varied)]
        if varied == "pairs":
            at = at[at.pairs >= LARGE]
        x, y = np.log(at[varied].to_numpy(float)), np.log(at.cpu_seconds / at.features)
        line = np.polyfit(x, y, 1)
        squares += float(((y - np.polyval(line, x)) ** 2).sum())
        free += len(x) - 2
        fits[varied] = float(line[0]), float(((x - x.mean()) ** 2).sum())
    # Two points a line leave nothing to tell their scatter by.
    half = float(t.ppf(0.975, free)) * (squares / free) ** 0.5 if free else np.inf
    return {varied: (steep, half / spread**0.5) for varied, (steep, spread) in fits.items()}


@criterion("4.2-complexity", timings)
def bkr_is_linear(table: pd.DataFrame) -> Finding:
    """Growth of algorithm 8's time with N and with max_seqs, by intervals of the slopes."""
    by = slopes(table, "algorithm 8")
    low, high = (np.array([m + sign * half for m, half in by.values()]) for sign in (-1, 1))
    steep = {varied: m for varied, (m, _) in by.items()}
    pairs, seqs = (
        plus_minus(m, half) if 0 < half < np.inf else number(m) for m, half in by.values()
    )
    flat = Verdict.NOT_REPRODUCED if (high < GROWS).any() else Verdict.INCONCLUSIVE
    return Finding(
        graded(
            (low > GROWS).all() and (high <= LINEAR).all(),
            denied=(low > LINEAR).any(),
            otherwise=flat,
        ),
        f"The time a feature grows with the power {pairs} of the number of pairs (from {LARGE} on) "
        f"and {seqs} of the number of sequences sampled (95% intervals).",
        steep,
    )


def figure(table: pd.DataFrame, scale: pd.DataFrame) -> Figure:
    """Time of relevance over pairs, tasks, features and sequences, and of whole selections.

    Parameters
    ----------
    table
        Of :data:`timings`.
    scale
        Of :data:`thesis_lib.chapter4.scale.selections`.
    """
    fig, axes = plt.subplots(2, 3, figsize=(7.2, 5.0))
    labels = {
        **{"pairs": "pairs N", "tasks": "tasks n"},
        **{"features": "features P", "max_seqs": "max_seqs M"},
    }
    for ax, (varied, label) in zip(axes.flat, labels.items(), strict=False):
        own = table[table.varied == varied]
        # The pairs double with every feature, so there the time is that of one.
        share = own.features if varied == "pairs" else 1
        own = own.assign(seconds=own.cpu_seconds / share)
        for i, (method, curve) in enumerate(own.groupby("method")):
            ax.loglog(curve[varied], curve.seconds, "o-", ms=4, color=COLOURS[i], label=str(method))
        _linear(ax, own[own.method == "algorithm 8"], varied)
        if varied in ("tasks", "features"):
            ax.set_xticks(sorted(own[varied].unique()), sorted(own[varied].unique()))
            ax.xaxis.set_minor_locator(NullLocator())
        ax.set_xlabel(label)
        ax.set_ylabel("seconds a feature" if varied == "pairs" else "seconds", fontsize=9)
    ax = axes.flat[4]
    scale = scale.assign(seconds=scale.cpu_seconds)
    for i, (method, curve) in enumerate(scale.groupby("method")):
        label = f"select: {SYMBOLS[str(method)]}"
        ax.loglog(curve.pairs, curve.seconds, "s-", ms=4, color=COLOURS[2 + i], label=label)
    _linear(ax, scale[scale.method == "jackknife"], "pairs")
    ax.set_xlabel(f"pairs N, {scale.tasks.max()} tasks")
    ax.set_ylabel("seconds a selection", fontsize=9)
    axes.flat[5].axis("off")
    handles = {}
    for ax in axes.flat[:5]:
        handles.update(dict(zip(*ax.get_legend_handles_labels()[::-1], strict=True)))
        ax.tick_params(labelsize=8)
    axes.flat[5].legend(handles.values(), handles, loc="center", fontsize=8)
    return fig


def _linear(ax: Axes, curve: pd.DataFrame, varied: str) -> None:
    """A line of slope 1 through the last point."""
    last = curve.sort_values(varied).iloc[-1]
    x = curve[varied].to_numpy(dtype=float)
    ax.loglog(x, last.seconds * x / last[varied], ":", color=PRINTED, lw=1, label="slope 1")
