"""The grid of chapter 5 as numbers: robots by nets, as printed and from runs of ours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from thesis_lib import published
from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.chapter5.runs import DEFAULT, ENOUGH, PRINTED_STEPS, Runs, plain
from thesis_lib.robustness import CONDITIONS, TRAINED_ON
from thesis_lib.stats import parametric_bootstrap

ROBOTS = tuple(published.TASKS)
NETS = ("CTRNN", "DTRNN", "ESN", "DFFWD", "FFWD", "GRU", "LSTM")
EXTRA_NETS = ("DFFWD-SOFTPLUS", "FFWD-400")
"""The two further nets of figure 5.5."""

GROUPS: Mapping[str, tuple[str, ...]] = {
    **{net: (net,) for net in NETS},
    "FNNs": ("DFFWD", "FFWD"),
    "RNNs": ("CTRNN", "DTRNN", "ESN", "GRU", "LSTM"),
    "vanilla RNNs": ("CTRNN", "DTRNN"),
    "gated RNNs": ("GRU", "LSTM"),
    "simple nets": ("CTRNN", "DTRNN", "DFFWD", "FFWD"),
    "FNNs and CTRNN": ("CTRNN", "DFFWD", "FFWD"),
    "other RNNs": ("DTRNN", "ESN", "GRU", "LSTM"),
}
"""Sets of nets that the text compares."""

TESTED: Mapping[str, str] = dict(
    zip(CONDITIONS, ("table-c.1", "table-c.2", "table-c.3"), strict=True)
)
"""Printed table of each test."""

LEARNING_RUNS, TEST_RUNS = 5, 20
"""Runs behind a printed cell: of learning (section 5.4), and of a test of one policy."""


@dataclass(frozen=True)
class Cells:
    """Numbers for every ground trained on, condition, robot and net.

    Attributes
    ----------
    source
        ``printed`` or ``ours``.
    mean
        Shape ``(2, C, robots, nets)``; C is 1 for learning and 3 for tests; NaN where there is
        none.
    draws
        Resamples of the means, shape ``(n_resamples, 2, C, robots, nets)``: normal ones by the
        printed standard errors, or the seeds of ours drawn with replacement (all conditions of a
        seed together), spread by sqrt(n / (n - 1)) so that their variance is unbiased.  NaN where
        fewer than :data:`ENOUGH` seeds are there.
    units
        Runs behind each cell, shape ``(2, robots, nets)``: the printed ones, or seeds.
    printed_budget
        Whether they learned for as many steps as the thesis's, same shape.
    runs
        Of ours, one row a seed and one column a condition, by (trained on, robot, net) indices.
    """

    source: str
    mean: FloatArray
    draws: FloatArray
    units: IntArray
    printed_budget: IntArray
    runs: Mapping[tuple[int, int, int], FloatArray] = field(default_factory=dict)


def as_published(table: str) -> pd.DataFrame:
    """A printed table of cells by ground trained on, robot and net."""
    robots = {printed: robot for robot, printed in published.TASKS.items()}
    cells = published.load(table).replace({"task": robots})
    return cells.set_index(["trained_on", "task", "architecture"])


def printed_cells(tables: tuple[str, ...]) -> tuple[FloatArray, FloatArray]:
    """Printed means and standard errors, each shape ``(2, tables, 5, 7)``."""
    shape = len(TRAINED_ON), len(ROBOTS), len(NETS)
    order = pd.MultiIndex.from_product([TRAINED_ON, ROBOTS, NETS])
    cells = [as_published(name).loc[order] for name in tables]
    mean, error = (
        np.stack([c[column].to_numpy().reshape(shape) for c in cells], axis=1)
        for column in ("value", "standard_error")
    )
    return mean, error


def printed(
    tables: tuple[str, ...], rng: np.random.Generator, n_resamples: int, error_factor: float = 1.0
) -> Cells:
    """The printed numbers with resamples of their means.

    Parameters
    ----------
    tables
        ``("table-5.2",)`` or those of :data:`TESTED`.
    rng, n_resamples
        Source and number of resamples.
    error_factor
        By which printed standard errors are multiplied.
    """
    mean, error = printed_cells(tables)
    draws = parametric_bootstrap(mean, error_factor * error, rng=rng, n_resamples=n_resamples)
    runs = LEARNING_RUNS if tables == ("table-5.2",) else TEST_RUNS
    shape = (2, len(ROBOTS), len(NETS))
    return Cells("printed", mean, draws, np.full(shape, runs), np.ones(shape, dtype=int))


def from_learning(store: Runs, rng: np.random.Generator, n_resamples: int) -> Cells:
    """Mean return over learning by seed, from runs of ours, on both grounds at one budget."""
    table = store.learning(across=["terrain"]).assign(condition="learning")
    table = table.rename(columns={"mean_return": "return"})
    return _ours(table, ("learning",), NETS, rng, n_resamples)


def from_tests(
    store: Runs,
    rng: np.random.Generator,
    n_resamples: int,
    nets: tuple[str, ...] = NETS,
    across: Sequence[str] = ("terrain",),
) -> Cells:
    """Returns of tests by seed, from runs of ours, on both grounds at one budget.

    Parameters
    ----------
    store
        Our runs.
    rng, n_resamples
        Source and number of resamples.
    nets
        In the order of the last axis.
    across
        What is compared, so that one budget counts (:meth:`~thesis_lib.chapter5.runs.Runs.depths`).
    """
    table = store.only(architectures=[net.lower() for net in nets]).returns(across=across)
    return _ours(plain(table), CONDITIONS, nets, rng, n_resamples)


def _ours(
    table: pd.DataFrame,
    conditions: tuple[str, ...],
    nets: tuple[str, ...],
    rng: np.random.Generator,
    n_resamples: int,
) -> Cells:
    shape = (2, len(conditions), len(ROBOTS), len(nets))
    mean = np.full(shape, np.nan)
    draws = np.full((n_resamples, *shape), np.nan)
    units = np.zeros((2, len(ROBOTS), len(nets)), dtype=int)
    whole = np.zeros_like(units)
    runs = {}
    table = table[(table.variant == DEFAULT) & table.condition.isin(conditions)]
    for (ground, robot, architecture), cell in table.groupby(["terrain", "task", "architecture"]):
        if architecture.upper() not in nets:
            continue
        at = TRAINED_ON.index(ground), ROBOTS.index(robot), nets.index(architecture.upper())
        wide = cell.pivot(index="seed", columns="condition", values="return")
        x = wide.reindex(columns=list(conditions)).dropna().to_numpy()
        n = len(x)
        if not n:
            continue
        runs[at], units[at] = x, n
        mean[at[0], :, at[1], at[2]] = x.mean(axis=0)
        whole[at] = (cell.iterations * cell.batch_steps).min() >= PRINTED_STEPS
        if n >= ENOUGH:
            chosen = x[rng.integers(n, size=(n_resamples, n))].mean(axis=1)
            spread = np.sqrt(n / (n - 1)) * (chosen - x.mean(axis=0))
            draws[:, at[0], :, at[1], at[2]] = x.mean(axis=0) + spread
    return Cells("ours", mean, draws, units, whole, runs)


def interval(draws: FloatArray, units: int = ENOUGH) -> tuple[float, float]:
    """95% percentile interval of resamples, shape ``(n_resamples,)``; resamples of NaN left out.

    NaN where fewer than :data:`ENOUGH` runs, ``units``, are behind them.
    """
    if units < ENOUGH:
        return np.nan, np.nan
    low, high = np.nanquantile(draws, [0.025, 0.975])
    return float(low), float(high)


def weights(group: str) -> FloatArray:
    """Mean over the nets of one of :data:`GROUPS`, as weights of the seven nets."""
    members = np.isin(NETS, GROUPS[group])
    mean: FloatArray = members / members.sum()
    return mean


def shares(returns: FloatArray, mean: FloatArray) -> FloatArray:
    """Returns as shares of the best net's mean return on each row.

    The measure behind statements on averages over tasks whose returns differ in size.

    Parameters
    ----------
    returns
        Means or their resamples, shape ``(..., nets)``.
    mean
        Means, whose best is the measure: that of each resample would be too high.

    Returns
    -------
    FloatArray
        Shape of ``returns``; NaN on a row with a net that has not been run, or without a positive
        return.
    """
    best = mean.max(axis=-1, keepdims=True)
    share: FloatArray = returns / np.where(best > 0, best, np.nan)
    return share
