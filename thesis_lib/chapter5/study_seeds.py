r"""Study 3 (ours): variance between seeds and between nets, and how many seeds a ranking needs."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.stats import nct, t

from thesis_lib.chapter5.cell_table import column
from thesis_lib.chapter5.cells import LEARNING_RUNS, NETS
from thesis_lib.chapter5.contrasts import Config
from thesis_lib.chapter5.judging import Said, both, of_source
from thesis_lib.chapter5.table_5_2 import entries
from thesis_lib.edition.criteria import graded
from thesis_lib.edition.experiment import Context, experiment

POWER = 0.8
"""Chance of finding a difference that counts as enough."""

MOST_SEEDS = 1000
"""Where the search for enough seeds stops."""


@dataclass(frozen=True)
class Pair:
    """Two nets on one row of table 5.2."""

    source: str
    """Printed or ours."""
    task: str
    """Robot."""
    trained_on: str
    """Flat or hill."""
    first: str
    """Net with the higher mean."""
    second: str
    """Net with the lower mean."""
    difference: float
    """Of their mean returns over learning."""
    sd: float
    """Root mean square of their standard deviations over seeds."""
    power: float
    """Chance that Welch's test at 5% finds it with as many seeds as the thesis had, were means and
    standard deviations the true ones."""
    seeds_needed: int
    """Seeds a net for a chance of 80%."""
    between_seeds: float
    """Variance of the row between seeds of a net, mean over nets."""
    between_nets: float
    """Variance of the row between nets, less what seeds add to it; 0 where seeds explain all."""
    units: int
    """Fewest seeds on the row."""
    printed_budget: bool
    """Whether they learned for as many steps as the thesis's."""


def power(difference: float, sd: float, n: int) -> float:
    """Power of a two-sided 5% t-test of two samples of n with a common standard deviation.

    Parameters
    ----------
    difference, sd
        Of the true means, and standard deviation of both.
    n
        Runs a sample, at least 2.
    """
    if sd == 0:
        return float(difference != 0)
    dof = 2 * (n - 1)
    shift = abs(difference) / (sd * (2 / n) ** 0.5)
    bound = t.ppf(0.975, dof)
    return float(nct.sf(bound, dof, shift) + nct.cdf(-bound, dof, shift))


def seeds_needed(difference: float, sd: float) -> int:
    """Fewest seeds a net with a power of :data:`POWER`; :data:`MOST_SEEDS` if it takes more."""
    low, high = 2, MOST_SEEDS
    if power(difference, sd, high) < POWER:
        return high
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if power(difference, sd, middle) >= POWER else (middle + 1, high)
    return low


@experiment("ch5-seeds", item="Study 3", smoke=Config(), book=Config(), seconds=1.4)
def pairs(config: Config, context: Context) -> list[Pair]:
    """Seeds that table 5.2's rankings need, from printed and from our variances."""
    table = entries.run(config=config).table
    rows: list[Pair] = []
    for source in ("printed", "ours"):
        for _, row in table.groupby(["trained_on", "task"], sort=False):
            rows += _pairs(source, row.set_index("architecture"))
    return rows


def _pairs(source: str, row: pd.DataFrame) -> Iterator[Pair]:
    value, error, _ = column(source)
    if row[error].isna().any() or (row[error] == 0).any():
        row = row[row[error] > 0]  # runs that were cut short have no spread
        if len(row) < len(NETS) - 1:
            return
    seeds = pd.Series(LEARNING_RUNS, row.index) if source == "printed" else row.seeds
    sd = row[error] * np.sqrt(seeds)
    between_seeds = float((sd**2).mean())
    between_nets = max(0.0, float(row[value].var(ddof=1) - (row[error] ** 2).mean()))
    for a, b in itertools.combinations(row.sort_values(value, ascending=False).index, 2):
        gap = float(row.loc[a, value] - row.loc[b, value])
        both_sd = float(np.sqrt((sd[a] ** 2 + sd[b] ** 2) / 2))
        yield Pair(
            source,
            row.task.iloc[0],
            row.trained_on.iloc[0],
            a,
            b,
            gap,
            both_sd,
            power(gap, both_sd, LEARNING_RUNS),
            seeds_needed(gap, both_sd),
            between_seeds,
            between_nets,
            int(seeds.min()),
            source == "printed" or bool(row.printed_budget.all()),
        )


@both("ch5-five-seeds", pairs, rows=of_source)
def five_seeds(rows: pd.DataFrame) -> Said:
    """Share of the pairs of nets that five seeds tell apart, and how many it takes."""
    enough = rows.power >= POWER
    verdict = graded(enough.mean() > 0.5, denied=enough.mean() <= 0.25)
    by_row = rows.drop_duplicates(["trained_on", "task"])
    share = by_row.between_nets / (by_row.between_nets + by_row.between_seeds)
    return verdict, (
        f"{LEARNING_RUNS} seeds tell {enough.sum()} of {len(rows)} pairs of nets apart with a "
        f"chance of {POWER:.0%}; half of the pairs need {rows.seeds_needed.median():.0f} seeds or "
        f"fewer, nine in ten {rows.seeds_needed.quantile(0.9):.0f} (counted up to {MOST_SEEDS}). "
        f"Nets explain {share.min():.0%} to {share.max():.0%} of a row's variance (median "
        f"{share.median():.0%}), seeds the rest."
    )
