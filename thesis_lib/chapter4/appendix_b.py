"""Appendix B: equations 4.4 and B.4, lemmas 1 and 2, over random domains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.chapter4.random_solutions import KINDS, Kind, random_solutions
from thesis_lib.edition.criteria import EXACT, judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.relevance import (
    Solutions,
    cross_task_q,
    relevance,
    relevance_by_variance,
    sequence_covariance,
)

STATEMENTS = (
    "eq. 4.4: relevance is a sum of variances",
    "eq. B.4 as printed: relevance is the mean covariance",
    "eq. B.4 corrected: with weights p(y|c_i)/p(y|c)",
    "lemma 1: E[Q^c_i] = E[Q_i]",
    "lemma 2 as printed: |E[Q_i Q_j]| grows by (k+1)/k at most",
    "lemma 2 corrected: E|Q_i Q_j| grows by (k+1)/k at most",
    "shared p: E[Q_i Q_j] does not change",
)


@dataclass(frozen=True)
class Config:
    """Settings of the checks of appendix B."""

    domains: int = 2000
    """Random domains of each kind."""


@dataclass(frozen=True)
class Statement:
    """One statement in the random domains of one kind."""

    kind: str
    """p(x|m): shared by all tasks; uniform on each task's own subset of pairs; any weights."""
    statement: str
    """What is checked."""
    holds: float
    """Share of the domains in which it holds to 1e-9, for every pair of tasks."""
    largest_error: float
    """By how much it fails at most."""
    n_domains: int
    """Number of random domains."""


@experiment(
    "lemmas-1-2", item="Appendix B (steps)", smoke=Config(domains=10), book=Config(), seconds=5
)
def statements(config: Config, context: Context) -> list[Statement]:
    """Equations 4.4 and B.4 and lemmas 1 and 2 over random domains, from two tasks to three."""
    records = []
    for kind in KINDS:
        seeds = context.seeds(config.domains, 3, KINDS.index(kind))
        errors = np.array([_errors(kind, seed) for seed in seeds])
        for statement, column in zip(STATEMENTS, errors.T, strict=True):
            holds, largest = float((column <= 1e-9).mean()), float(column.max())
            records.append(Statement(kind, statement, holds, largest, config.domains))
    return records


def _errors(kind: Kind, seed: np.random.SeedSequence) -> list[float]:
    """By how much each statement fails in one random domain of three tasks."""
    rng = np.random.default_rng(seed)
    solutions = random_solutions(rng, kind, 3)
    labels: IntArray = rng.integers(0, 3, solutions.n_pairs)
    c, longer = [0, 1], [0, 1, 2]
    q, p = cross_task_q(solutions, c)
    rho = relevance(labels, q, p)
    plain = np.where(solutions.p > 0, solutions.p * solutions.q, 0.0).sum(axis=1)
    mean = _rescaled(solutions, c) @ p
    (before, before_abs), (after, after_abs) = (_products(solutions, s) for s in (c, longer))
    growth = np.abs(after) - 1.5 * np.abs(before)
    growth_abs = after_abs - 1.5 * before_abs
    printed, corrected = (
        float(sequence_covariance(solutions, labels, c, as_printed=flag).mean())
        for flag in (True, False)
    )
    return [
        abs(relevance_by_variance(labels, q, p) - rho),
        abs(printed - rho),
        abs(corrected - rho),
        float(np.abs(mean - plain[c]).max()),
        max(float(growth.max()), 0.0),
        max(float(growth_abs.max()), 0.0),
        float(np.abs(after - before).max()),
    ]


def _rescaled(solutions: Solutions, c: list[int]) -> FloatArray:
    """Q^c_{c_i}(x) of equation B.2, shape ``(k, N)``."""
    p = solutions.p[c]
    weighted = np.where(p > 0, p * solutions.q[c], 0.0)
    mean = p.mean(axis=0)
    return np.divide(weighted, mean, out=np.zeros_like(weighted), where=mean > 0)


def _products(solutions: Solutions, c: list[int]) -> tuple[FloatArray, FloatArray]:
    """E[Q_i Q_j] and E|Q_i Q_j| of the first two tasks of a sequence, each ``(2, 2)``."""
    scaled, mean = _rescaled(solutions, c)[:2], solutions.p[c].mean(axis=0)
    return (scaled * mean) @ scaled.T, (np.abs(scaled) * mean) @ np.abs(scaled).T


def _by_kind(table: pd.DataFrame, start: str) -> pd.DataFrame:
    """The rows of the statement that starts so, by kind."""
    return table[table.statement.str.startswith(start)].set_index("kind")


@criterion("4.1-two-forms", statements)
def two_forms_agree(table: pd.DataFrame) -> Finding:
    """Relevance by definition 4 and as a sum of variances."""
    own = _by_kind(table, "eq. 4.4")
    worst = float(own.largest_error.max())
    return judged(
        worst < 1e-12,
        f"Over {own.n_domains.sum()} random domains the two forms differ by at most {worst:.1g}.",
        {"error": worst},
        otherwise=Verdict.REFUTED if worst > EXACT else Verdict.INCONCLUSIVE,
    )


@criterion("B.1-lemma-1", statements)
def lemma_1(table: pd.DataFrame) -> Finding:
    """Lemma 1 in random domains."""
    own = _by_kind(table, "lemma 1")
    worst = float(own.largest_error.max())
    return judged(
        (own.holds == 1).all(),
        f"Over {own.n_domains.sum()} random domains the two differ by at most {worst:.0g}.",
        {"error": worst},
        otherwise=Verdict.REFUTED,
    )


@criterion("B.1-lemma-2", statements)
def lemma_2(table: pd.DataFrame) -> Finding:
    """Lemma 2 as printed, in random domains."""
    holds = _by_kind(table, "lemma 2 as printed").holds
    corrected = float(_by_kind(table, "lemma 2 corrected").holds.min())
    return judged(
        (holds == 1).all(),
        f"It holds in {holds['weights']:.0%} of the random domains with any weights; for the mean "
        f"of the absolute product, whose terms cannot cancel, the bound holds in {corrected:.0%}.",
        {"printed": float(holds["weights"]), "corrected": corrected},
        otherwise=Verdict.REFUTED,
    )


@criterion("B.1-equation-B4", statements)
def equation_b4(table: pd.DataFrame) -> Finding:
    """Equation B.4 as printed, in random domains without shared p(x|m)."""
    holds = _by_kind(table, "eq. B.4 as printed").holds
    corrected = float(_by_kind(table, "eq. B.4 corrected").holds.min())
    return judged(
        (holds == 1).all(),
        f"It holds in {holds['shared']:.0%} of the random domains with shared p(x|m) and in "
        f"{holds['weights']:.1%} of those with any weights; with the factors p(y|c_i)/p(y|c), "
        f"which the printed terms lack, in {corrected:.0%}.",
        {"printed": float(holds["weights"]), "corrected": corrected},
        otherwise=Verdict.REFUTED,
    )
