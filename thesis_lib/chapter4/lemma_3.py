"""Lemma 3: the share of variances among the covariances that one more task adds."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations_with_replacement, product

import pandas as pd

from thesis_lib.edition.criteria import judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.words import several


@dataclass(frozen=True)
class Config:
    """Settings of the counting of lemma 3."""

    tasks: tuple[int, ...] = (2, 3, 5)
    """N."""
    longest: int = 6
    """Largest k."""


@dataclass(frozen=True)
class Count:
    """The share for one number of tasks and one k."""

    n_tasks: int
    """N."""
    k: int
    """Sequence length."""
    counted: float
    """Type 1 covariances among the new ones, counted."""
    formula: float
    """Equation B.7."""
    same: bool
    """Whether every sequence of k - 1 tasks gives exactly the formula."""


@experiment(
    "lemma-3", item="Lemma 3", smoke=Config(tasks=(2,), longest=3), book=Config(), seconds=0.006
)
def counts(config: Config, context: Context) -> list[Count]:
    """Share of variances among new covariances, counted over all sequences."""
    records = []
    for n, k in product(config.tasks, range(2, config.longest + 1)):
        # Every sequence of k - 1 tasks by its counts o_m, every task appended to each.
        ratios = {
            Fraction(sum(2 * c.count(m) + 1 for m in range(n)), n * (2 * k - 1))
            for c in combinations_with_replacement(range(n), k - 1)
        }
        formula = Fraction(2 * (k - 1) + n, n * (2 * k - 1))
        records.append(Count(n, k, float(max(ratios)), float(formula), ratios == {formula}))
    return records


@criterion("B.2-lemma-3", counts)
def lemma_3(table: pd.DataFrame) -> Finding:
    """Lemma 3 by counting."""
    falls = all(own.counted.is_monotonic_decreasing for _, own in table.groupby("n_tasks"))
    sizes = several(str(n) for n in table.n_tasks.unique())
    return judged(
        table.same.all() and falls,
        f"Counted over all sequences for N = {sizes} and k up to {table.k.max()}: the formula is "
        f"exact in {table.same.sum()} of {len(table)} cases. It weighs all tasks equally; with "
        "unequal D the sum of D(m)^2 takes the place of 1/N.",
        {"exact": int(table.same.sum())},
        otherwise=Verdict.REFUTED,
    )
