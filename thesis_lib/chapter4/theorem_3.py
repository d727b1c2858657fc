"""Theorem 3: whether k-relevance is monotone."""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd

from thesis_lib.chapter4.random_domains import BOOK, ROUNDING, SMOKE, Config, random_curves
from thesis_lib.edition.criteria import judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion


@dataclass(frozen=True)
class Monotone:
    """Which way k-relevance goes in the random domains of one kind."""

    kind: str
    """p(x|m): shared by all tasks; uniform on each task's own subset of pairs; any weights."""
    n_domains: int
    """Number of random domains."""
    decreasing: float
    """Share in which rho_k only falls."""
    increasing: float
    """Share in which rho_k only rises."""
    constant: float
    """Share in which it does neither."""
    not_monotone: float
    """Share in which it does both."""


@experiment("theorem-3", item="Theorem 3", smoke=SMOKE, book=BOOK, thesis=Config(), seconds=6)
def directions(config: Config, context: Context) -> list[Monotone]:
    """In what share of random domains k-relevance is monotone, and which way."""
    records = []
    for curves in random_curves(config, context):
        rises = (curves.steps > ROUNDING).any(axis=1)
        falls = (curves.steps < -ROUNDING).any(axis=1)
        records.append(
            Monotone(
                kind=curves.kind,
                n_domains=len(curves.rho),
                decreasing=float((falls & ~rises).mean()),
                increasing=float((rises & ~falls).mean()),
                constant=float((~rises & ~falls).mean()),
                not_monotone=float((rises & falls).mean()),
            )
        )
    return records


@criterion("4.1.2-theorem-3", directions)
def is_monotone(table: pd.DataFrame) -> Finding:
    """Share of random domains with shared p(x|m) in which k-relevance is monotone."""
    row = table.set_index("kind").loc["shared"]
    return judged(
        row.not_monotone == 0,
        f"Of {row.n_domains:.0f} random domains with shared p(x|m) it is monotone in "
        f"{1 - row.not_monotone:.0%}; the law rho_inf + (rho_1 - rho_inf)/k is.",
        {"not_monotone": float(row.not_monotone)},
        otherwise=Verdict.REFUTED,
    )


@criterion("4.1.2-increasing", directions)
def may_increase(table: pd.DataFrame) -> Finding:
    """Whether any domain with shared p(x|m) has a rising k-relevance."""
    row = table.set_index("kind").loc["shared"]
    return judged(
        row.increasing > 0,
        f"It occurs in {row.increasing:.0%} of {row.n_domains:.0f} random domains. By the law its "
        "fall, rho_1 - rho_inf, is the mean of B(Q_m - Q_d, Q_m - Q_d), a mean of squares.",
        {"increasing": float(row.increasing)},
        otherwise=Verdict.REFUTED,
    )
