r"""Interquartile means and probabilities of improvement, beside the thesis's tests (section 5.5).

As Agarwal et al. (2021) define them.  The interquartile mean is that of the middle half of all
runs on all tasks; the probability that net X improves on net Y is the mean over the M tasks of

.. math:: P(X_m > Y_m) = \frac{1}{N K} \sum_{i,j}
          \left( [x_{m,i} > y_{m,j}] + \tfrac12 [x_{m,i} = y_{m,j}] \right) ,

with runs i of X and j of Y.  Both need single runs, which the thesis does not print.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.stats import trim_mean

from thesis_lib.arrays import FloatArray
from thesis_lib.chapter5 import cells
from thesis_lib.chapter5.cells import NETS, ROBOTS, Cells, interval
from thesis_lib.chapter5.contrasts import SMOKE, Config
from thesis_lib.chapter5.runs import ENOUGH
from thesis_lib.edition.criteria import LEVEL
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.words import with_interval
from thesis_lib.robustness import CONDITIONS, PERTURBATIONS, TRAINED_ON, score
from thesis_lib.stats import leading


@dataclass(frozen=True)
class Aggregate:
    """One net over all rows (robot and ground trained on) that every net has run."""

    measure: str
    """Learning or test (runs as shares of the best net's mean return on their row), noise or
    switch (equation 5.4)."""
    architecture: str
    """Net."""
    iqm: float
    """Interquartile mean of its runs."""
    low: float
    """Lower end of the 95% interval, runs resampled within rows."""
    high: float
    """Upper end."""
    better: float
    """Probability that it improves on another net, mean over these."""
    better_low: float
    """Lower end of its 95% interval, runs of both nets resampled within rows."""
    better_high: float
    """Upper end."""
    leads: int
    """Rows on which no net is significantly better (Kruskal-Wallis followed by Welch)."""
    rows: int
    """Rows."""
    seeds: int
    """Runs a net on each row: the first ones, as many as the net with the fewest has."""


@experiment("ch5-aggregates", item="Section 5.5", smoke=SMOKE, book=Config(), seconds=4)
def aggregates(config: Config, context: Context) -> list[Aggregate]:
    """Interquartile means and probabilities of improvement over rows, of our runs."""
    store = config.runs()
    learning, tests, draws = (np.random.default_rng(s) for s in context.seeds(3))
    learned = cells.from_learning(store, learning, 1)
    tested = cells.from_tests(store, tests, 1)
    rows = list(_of_measure("learning", _shares(learned), draws, config.resamples))
    rows += _of_measure("test", _shares(tested), draws, config.resamples)
    for perturbation in PERTURBATIONS:
        found = _scores(tested, perturbation)
        rows += _of_measure(perturbation, found, draws, config.resamples)
    return rows


def _rows(made: Cells) -> list[tuple[int, int]]:
    """Ground and robot of the rows on which every net has enough runs."""
    return [
        (i, k)
        for i in range(len(TRAINED_ON))
        for k in range(len(ROBOTS))
        if made.units[i, k].min() >= ENOUGH and made.mean[i, 0, k].max() > 0
    ]


def _shares(made: Cells) -> FloatArray:
    """Runs as shares of the best mean on their row, shape ``(nets, rows, seeds)``."""
    rows = _rows(made)
    return _matrix(
        [
            [made.runs[i, k, m][:, 0] / made.mean[i, 0, k].max() for i, k in rows]
            for m in range(len(NETS))
        ]
    )


def _scores(made: Cells, perturbation: str) -> FloatArray:
    """Equation 5.4 by run, scaled by the best of the nets' means; shape as :func:`_shares`."""
    base, other = CONDITIONS.index("base"), CONDITIONS.index(perturbation)
    best = {(i, k): made.mean[i, [base, other], k].max() for i, k in _rows(made)}
    return _matrix(
        [
            [
                score(made.runs[i, k, m][:, base], made.runs[i, k, m][:, other], best[i, k])
                for i, k in best
            ]
            for m in range(len(NETS))
        ]
    )


def _matrix(runs: list[list[FloatArray]]) -> FloatArray:
    """The first runs of each net and row, as many as there are of all."""
    seeds = min((len(own) for net in runs for own in net), default=0)
    return np.array([[own[:seeds] for own in net] for net in runs])


def iqm(scores: FloatArray) -> FloatArray:
    """Interquartile mean over the last two axes, rows and runs.

    Parameters
    ----------
    scores
        Shape ``(..., rows, runs)``.
    """
    mean: FloatArray = trim_mean(scores.reshape(*scores.shape[:-2], -1), 0.25, axis=-1)
    return mean


def improvement(first: FloatArray, second: FloatArray) -> FloatArray:
    """Probability that a run of the first is better than one of the second, mean over rows.

    Parameters
    ----------
    first, second
        Shapes ``(..., rows, runs)``; the numbers of runs may differ.
    """
    gap = np.sign(first[..., :, None] - second[..., None, :])
    found: FloatArray = (0.5 + 0.5 * gap).mean(axis=(-3, -2, -1))
    return found


def _of_measure(
    measure: str, runs: FloatArray, rng: np.random.Generator, n: int
) -> Iterator[Aggregate]:
    """All nets by one measure; runs have shape ``(nets, rows, seeds)``."""
    if not runs.size:
        return
    nets, rows, seeds = runs.shape
    chosen = rng.integers(seeds, size=(n, *runs.shape))
    drawn = np.take_along_axis(runs[None], chosen, axis=-1)
    lead = [
        name
        for row in range(rows)
        for name in leading({net: runs[m, row] for m, net in enumerate(NETS)}, LEVEL)
    ]
    for m, net in enumerate(NETS):
        others = [o for o in range(nets) if o != m]
        better = np.mean([improvement(runs[m], runs[o]) for o in others])
        over = np.mean([improvement(drawn[:, m], drawn[:, o]) for o in others], axis=0)
        yield Aggregate(
            measure,
            net,
            float(iqm(runs[m])),
            *interval(iqm(drawn[:, m])),
            float(better),
            *interval(over),
            lead.count(net),
            rows,
            seeds,
        )


def shown(table: pd.DataFrame, measure: str) -> pd.DataFrame:
    """One measure: interquartile mean, probability of improvement, rows with none better."""
    own = table[table.measure == measure]
    return pd.DataFrame(
        {
            "net": own.architecture,
            "IQM": _cells(own, "iqm"),
            "better than another": _cells(own, "better"),
            "among the best": [
                f"{lead} of {rows}" for lead, rows in zip(own.leads, own.rows, strict=True)
            ],
        }
    )


def across(table: pd.DataFrame, value: str, *measures: str) -> pd.DataFrame:
    """Several measures side by side, by net.

    Parameters
    ----------
    table
        Of :data:`aggregates`.
    value
        ``iqm`` or ``better``.
    measures
        Columns.
    """
    columns: dict[str, list[str | None]] = {"net": [*NETS]}
    for measure in measures:
        own = table[table.measure == measure].set_index("architecture").reindex(list(NETS))
        columns[measure] = _cells(own, value)
    return pd.DataFrame(columns)


def _cells(own: pd.DataFrame, value: str) -> list[str | None]:
    bounds = ["low", "high"] if value == "iqm" else ["better_low", "better_high"]
    rows = own[[value, *bounds]].itertuples(index=False)
    return [None if np.isnan(v) else with_interval(v, a, b, ".2f") for v, a, b in rows]


def reading(table: pd.DataFrame, *measures: str) -> str:
    """How many rows and runs are behind the table, and who is surely better than another."""
    own = table[table.measure.isin(measures)]
    if own.empty:
        return "No row has enough runs of every net yet."
    first = own.iloc[0]
    sure = [
        f"{name}: {', '.join(part.architecture[part.better_low > 0.5]) or 'none'}"
        for name, part in own.groupby("measure", sort=False)
    ]
    return (
        f"On {first.rows} rows, with the first {first.seeds} runs a net, these are more likely "
        f"than not to improve on another net, by the whole interval ({'; '.join(sure)})."
    )
