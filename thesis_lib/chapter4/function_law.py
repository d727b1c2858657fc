"""Section 4.5: the law for linear functions, and how far small networks follow it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement, product
from math import factorial

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.arrays import BoolArray, FloatArray, IntArray
from thesis_lib.chapter4.runs import exact_solutions
from thesis_lib.domains import stock
from thesis_lib.edition.criteria import judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, criterion
from thesis_lib.edition.plots import COLOURS
from thesis_lib.edition.words import several
from thesis_lib.relevance import Solutions, feature_basis, fit_networks, keep, relevance


@dataclass(frozen=True)
class Config:
    """Settings of the test of the law."""

    factors: int = 1
    """G of the stock domain."""
    longest: int = 6
    """Largest k."""
    removed: tuple[str, ...] = ("g1", "s1e1")
    """Features removed, one at a time: an irrelevant and a relevant one."""
    hidden: tuple[int, ...] = (1, 2, 4)
    """Hidden units of the networks."""
    seeds: int = 4
    """Random starts of the networks."""


@dataclass(frozen=True)
class Point:
    """One function without one feature, for one k."""

    function: str
    """table; linear (columns of features and their products with the action); weight or squared
    weight of the feature's product with the action in the linear function; network fitted to
    the cross-task Q-function."""
    hidden: int
    """Hidden units of the network, 0 for the others."""
    seed: int
    """Random start of the network."""
    feature: str
    """Removed."""
    k: int
    """Sequence length."""
    value: float
    """Expectation over all sequences of k tasks, listed: of the rise of the mean squared error, or
    of the weight."""
    fitted: float
    """Least-squares fit of a + b/k over the lengths."""
    misfit: float
    """Distance of the two, over the value at k = 1."""


def multisets(n_tasks: int, k: int) -> tuple[IntArray, FloatArray]:
    """Sequences of k equally likely tasks up to order, ``(S, k)``, and their probabilities.

    Parameters
    ----------
    n_tasks
        Tasks in the domain.
    k
        Length.
    """
    drawn = list(combinations_with_replacement(range(n_tasks), k))
    orders = [
        factorial(k) / np.prod([factorial(tasks.count(m)) for m in set(tasks)]) for tasks in drawn
    ]
    return np.array(drawn), np.array(orders) / n_tasks**k


def points_on_a_curve(
    function: str, hidden: int, seed: int, feature: str, curve: FloatArray
) -> list[Point]:
    """A curve over k = 1, 2, ... beside the nearest of the form a + b/k."""
    k = np.arange(1, len(curve) + 1)
    slopes = np.column_stack([np.ones(len(k)), 1 / k])
    fitted = slopes @ np.linalg.lstsq(slopes, curve, rcond=None)[0]
    misfit = np.abs(curve - fitted) / max(abs(curve[0]), np.finfo(float).tiny)
    numbers = np.column_stack([curve, fitted, misfit]).tolist()
    return [Point(function, hidden, seed, feature, i, *three) for i, three in enumerate(numbers, 1)]


@experiment(
    "ch4-function-law",
    item="Section 4.5 (law)",
    smoke=Config(longest=3, hidden=(2,), seeds=1),
    book=Config(seeds=2),
    thesis=Config(seeds=20),
    seconds=18,
)
def curves(config: Config, context: Context) -> list[Point]:
    """k-relevance of a linear function and of small networks against a + b/k."""
    solutions = exact_solutions(stock(1, 2, config.factors))
    mixes = [multisets(solutions.n_tasks, k) for k in range(1, config.longest + 1)]
    # The cross-task Q-function of every sequence, all lengths together.
    means = np.concatenate([solutions.q[tasks].mean(axis=1) for tasks, _ in mixes])
    ends = np.cumsum([len(tasks) for tasks, _ in mixes])[:-1]

    def expected(values: FloatArray) -> FloatArray:
        parts = np.split(values, ends)
        return np.array([p @ part for part, (_, p) in zip(parts, mixes, strict=True)])

    records: list[Point] = []
    basis = feature_basis(solutions, "action")
    weights = np.linalg.lstsq(basis.columns, means.T, rcond=None)[0]
    for feature in config.removed:
        kept = ~solutions.mask([feature])
        labels = keep(solutions, np.flatnonzero(kept).tolist())
        lost, full = (
            mean_square(basis.columns[:, basis.within(own)], means)
            for own in (kept, np.ones_like(kept))
        )
        at = int(np.flatnonzero(basis.uses[:, solutions.index(feature)])[-1])
        functions = {
            "table": np.array([relevance(labels, q, solutions.p[0]) for q in means]),
            "linear": lost - full,
            "weight": weights[at],
            "squared weight": weights[at] ** 2,
        }
        for function, values in functions.items():
            records += points_on_a_curve(function, 0, 0, feature, expected(values))

    def networks(job: tuple[int, int]) -> list[Point]:
        full = _network_errors(solutions, means, np.ones(solutions.n_features, bool), *job, context)
        points = []
        for feature in config.removed:
            kept = ~solutions.mask([feature])
            lost = _network_errors(solutions, means, kept, *job, context) - full
            points += points_on_a_curve("network", *job, feature, expected(lost))
        return points

    jobs = product(config.hidden, range(config.seeds))
    return records + [p for part in context.map(networks, jobs, "networks") for p in part]


def mean_square(columns: FloatArray, targets: FloatArray) -> FloatArray:
    """Mean squared error of the least-squares fit of each row of targets, shape ``(S,)``."""
    weights = np.linalg.lstsq(columns, targets.T, rcond=None)[0]
    return ((targets.T - columns @ weights) ** 2).mean(axis=0)


def _network_errors(
    solutions: Solutions,
    targets: FloatArray,
    kept: BoolArray,
    hidden: int,
    seed: int,
    context: Context,
) -> FloatArray:
    """Mean squared error of a network on some features, fitted to each row of targets."""
    basis = feature_basis(solutions, "none")
    reads = basis.uses.any(axis=1) & basis.within(kept)
    rng = np.random.default_rng(np.random.SeedSequence(context.seed, spawn_key=(30, hidden, seed)))
    inputs = basis.columns[:, reads]
    fitted = fit_networks(inputs, targets, hidden, rng, iterations=100)
    return ((fitted(inputs) - targets) ** 2).mean(axis=1)


@criterion("4.5-weights", curves)
def weights_extrapolate(table: pd.DataFrame) -> Finding:
    """Whether weights of a linear function, and their squares, change with k by the law."""
    weights = table[table.function == "weight"].groupby("feature").value
    change = float((weights.max() - weights.min()).max())
    squares = table[table.function == "squared weight"]
    misfit = float(squares.misfit.max())
    listed = several(
        f"from {own.value.iloc[0]:.4f} to {own.value.iloc[-1]:.4f} ({feature})"
        for feature, own in squares.groupby("feature")
    )
    return judged(
        misfit < 1e-12 and change > 1e-9,
        f"Expected weights change with k by {change:.0e} at most. Expected squared weights differ "
        f"from a + b/k by {misfit:.0e} at most, and go, up to k = {table.k.max()}, {listed}.",
        {"change": change, "misfit": misfit},
        direction=misfit < 1e-12,
    )


def figure(table: pd.DataFrame, feature: str) -> Figure:
    """k-relevance of networks over 1/k, and how far every function is from the law.

    Parameters
    ----------
    table
        Of :data:`curves`.
    feature
        Removed, on the left.
    """
    fig, axes = plt.subplots(1, 2, figsize=(7.2, 3.6))
    nets = table[(table.function == "network") & (table.feature == feature)]
    exact = table[(table.function == "table") & (table.feature == feature)]
    axes[0].plot(1 / exact.k, exact.value, "k--", lw=1, label="table, linear", zorder=4)
    for i, (hidden, own) in enumerate(nets[nets.seed == nets.seed.min()].groupby("hidden")):
        name = f"{hidden} hidden unit{'s' if hidden > 1 else ''}"
        axes[0].plot(1 / own.k, own.value, "o", ms=5, color=COLOURS[i], label=name)
        axes[0].plot(1 / own.k, own.fitted, "-", lw=1, color=COLOURS[i])
    axes[0].set(xlabel="1/k", ylabel=f"k-relevance of {feature} [squared reward]", ylim=(0, None))
    axes[0].legend(fontsize=8)
    worst = table.groupby(["function", "hidden", "feature", "seed"]).misfit.max().reset_index()
    groups = [("table", 0), ("linear", 0), *(("network", h) for h in sorted(nets.hidden.unique()))]
    for i, name in enumerate(sorted(table.feature.unique())):
        for x, (function, hidden) in enumerate(groups):
            own = worst[(worst.function == function) & (worst.hidden == hidden)]
            own = own[own.feature == name].misfit.clip(lower=1e-17)
            at = np.full(len(own), x + (0.12 if name == feature else -0.12))
            label = f"without {name}" if x == 0 else None
            axes[1].semilogy(at, own, "o^sD"[i], ms=5, color=COLOURS[i], label=label)
    labels = [function if not h else f"network,\n{h}" for function, h in groups]
    axes[1].set_xticks(range(len(groups)), labels, fontsize=8)
    axes[1].set(ylabel=r"largest misfit of $a + b/k$ / $\rho_1$")
    axes[1].legend(fontsize=8)
    return fig
