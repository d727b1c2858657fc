"""The statements of section 4.1.2 and appendix B, over random domains and in hand-worked ones."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import combinations_with_replacement

import numpy as np
import pandas as pd

from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.domains import stock, triangle
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.experiments.chapter4.curves import exact_solutions
from thesis_lib.experiments.chapter4.families import KINDS, Kind, random_solutions
from thesis_lib.relevance import (
    Solutions,
    brute_force_k_relevance,
    cross_task_q,
    domain_relevance,
    estimate,
    finite_domain,
    k_relevance,
    rate,
    relevance,
    relevance_by_variance,
    remove,
    sequence_covariance,
)

TINY = 1e-10
"""A change below this share of the largest relevance is rounding."""

FLOOR = 1e-6
"""Relevances below this are rounding themselves, Q-values being of size 1."""


@dataclass(frozen=True)
class TheoremConfig:
    """Settings of the checks over random domains."""

    domains: int = 2000
    """Random domains of each kind."""
    longest: int = 20
    """Largest k."""
    brute_force: int = 50
    """Domains of each kind whose rho_1 .. rho_4 are also summed over all sequences."""


@dataclass(frozen=True)
class _Curve:
    rho: FloatArray
    limit: float
    slope: float
    brute: float


@cache
def _curves(kind: Kind, config: TheoremConfig, context: Context) -> list[_Curve]:
    """k-relevance of random abstractions of random domains, for k = 1 .. longest and 1000.

    Three experiments judge the same curves, which are computed once.
    """
    k = np.array([*range(1, config.longest + 1), 1000])

    def one(job: tuple[int, np.random.SeedSequence]) -> _Curve:
        index, seed = job
        rng = np.random.default_rng(seed)
        solutions = random_solutions(rng, kind, 2 + index % 4)
        labels: IntArray = rng.integers(0, 3, solutions.n_pairs)
        D = rng.dirichlet(np.ones(solutions.n_tasks))
        rho = k_relevance(solutions, labels, k, distribution=D)
        gap = 0.0
        if index < config.brute_force:
            for i in range(4):
                listed = brute_force_k_relevance(solutions, labels, i + 1, D)
                gap = max(gap, abs(listed - float(rho[i])))
        limit = domain_relevance(solutions, labels, distribution=D)
        return _Curve(rho, limit, rate(solutions, labels, distribution=D), gap)

    seeds = context.seeds(config.domains, 2, KINDS.index(kind))
    return context.map(one, list(enumerate(seeds)), kind)


def run_theorem_2(config: TheoremConfig, context: Context) -> pd.DataFrame:
    """Check theorem 2; columns are documented in :data:`THEOREM_2`."""
    records = []
    for kind in KINDS:
        curves = _curves(kind, config, context)
        rho = np.array([c.rho[:-1] for c in curves])
        limit = np.array([c.limit for c in curves])
        scale = np.maximum(rho.max(axis=1), FLOOR)[:, None]
        step = np.abs(np.diff(rho, axis=1)) / scale
        moved = step[:, 0] > TINY
        shrinks = (step[:, 1:] <= step[:, :-1] + TINY).all(axis=1)
        ratio = step[:, 1:] / np.maximum(step[:, :-1], TINY)
        k = np.arange(1, config.longest + 1)
        law = limit[:, None] + (rho[:, :1] - limit[:, None]) / k
        records.append(
            {
                "kind": kind,
                "n_domains": len(curves),
                "steps_shrink": float(shrinks.mean()),
                "contraction_80": float(
                    ((step[:, 1:] <= 0.8 * step[:, :-1] + TINY).all(axis=1) | ~moved).mean()
                ),
                "last_ratio": float(np.median(ratio[moved, -1])) if moved.any() else np.nan,
                "law_error": float((np.abs(rho - law) / scale).max()),
                "brute_force_error": max(c.brute for c in curves),
            }
        )
    return rows(records)


def run_theorem_3(config: TheoremConfig, context: Context) -> pd.DataFrame:
    """Check theorem 3; columns are documented in :data:`THEOREM_3`."""
    records = []
    for kind in KINDS:
        rho = np.array([c.rho[:-1] for c in _curves(kind, config, context)])
        step = np.diff(rho, axis=1) / np.maximum(rho.max(axis=1), FLOOR)[:, None]
        rises, falls = (step > TINY).any(axis=1), (step < -TINY).any(axis=1)
        records.append(
            {
                "kind": kind,
                "n_domains": len(rho),
                "decreasing": float((falls & ~rises).mean()),
                "increasing": float((rises & ~falls).mean()),
                "constant": float((~rises & ~falls).mean()),
                "not_monotone": float((rises & falls).mean()),
            }
        )
    return rows(records)


def run_corollary_1(config: TheoremConfig, context: Context) -> pd.DataFrame:
    """Check corollary 1; columns are documented in :data:`COROLLARY_1`."""
    records = []
    for kind in KINDS:
        curves = _curves(kind, config, context)
        rho = np.array([c.rho for c in curves])
        limit = np.array([c.limit for c in curves])
        slope = np.array([c.slope for c in curves])
        for column, k in enumerate([*range(1, config.longest + 1), 1000]):
            gap = rho[:, column] - limit
            records.append(
                {
                    "kind": kind,
                    "k": k,
                    "mean_distance": float(np.abs(gap).mean()),
                    "mean_rest": float(np.abs(gap - slope / k).mean()),
                    "n_domains": len(curves),
                }
            )
    return rows(records)


THEOREM_BUDGETS = {
    "smoke": TheoremConfig(domains=8, longest=5, brute_force=2),
    "book": TheoremConfig(),
    "thesis": TheoremConfig(),
}
KIND_COLUMN = "p(x|m): shared by all tasks; uniform on each task's own subset of pairs; any weights"

THEOREM_2: Experiment[TheoremConfig] = Experiment(
    id="theorem-2",
    item="Theorem 2",
    title="Whether steps of k-relevance contract, and the law they follow, in random domains.",
    function=run_theorem_2,
    budgets=THEOREM_BUDGETS,
    columns={
        "kind": KIND_COLUMN,
        "n_domains": "number of random domains, each with a random abstraction and D",
        "steps_shrink": "share in which |rho_{k+1} - rho_k| <= |rho_k - rho_{k-1}| for all k",
        "contraction_80": "share in which kappa = .8 serves all k up to the largest",
        "last_ratio": "median ratio of the last two steps",
        "law_error": "largest |rho_k - (rho_inf + (rho_1 - rho_inf)/k)| over the largest rho",
        "brute_force_error": "largest difference from the sum over all sequences, k up to 4",
    },
    seconds={"smoke": 1, "book": 15, "thesis": 15},
)

THEOREM_3: Experiment[TheoremConfig] = Experiment(
    id="theorem-3",
    item="Theorem 3",
    title="In what share of random domains k-relevance is monotone, and which way.",
    function=run_theorem_3,
    budgets=THEOREM_BUDGETS,
    columns={
        "kind": KIND_COLUMN,
        "n_domains": "number of random domains",
        "decreasing": "share in which rho_k only falls",
        "increasing": "share in which rho_k only rises",
        "constant": "share in which it does neither",
        "not_monotone": "share in which it does both",
    },
    seconds={"smoke": 1, "book": 15, "thesis": 15},
)

COROLLARY_1: Experiment[TheoremConfig] = Experiment(
    id="corollary-1",
    item="Corollary 1",
    title="Distance of k-relevance from domain relevance, over k, in random domains.",
    function=run_corollary_1,
    budgets=THEOREM_BUDGETS,
    columns={
        "kind": KIND_COLUMN,
        "k": "sequence length",
        "mean_distance": "mean |rho_k - rho_inf|",
        "mean_rest": "mean |rho_k - rho_inf - c/k|, c the exact rate",
        "n_domains": "number of random domains",
    },
    seconds={"smoke": 1, "book": 15, "thesis": 15},
)


@dataclass(frozen=True)
class ExampleConfig:
    """Settings of the hand-worked examples."""

    longest: int = 6
    """Largest k."""


def _tasks(*tables: dict[int, int], pairs: int = 2) -> Solutions:
    """Tasks that visit the listed pairs equally often, with the values given."""
    q = np.array([[table.get(x, np.nan) for x in range(pairs)] for table in tables], dtype=float)
    p = np.isfinite(q) / np.isfinite(q).sum(axis=1, keepdims=True)
    return Solutions(q, p, np.arange(pairs)[:, None], ("x",))


EXAMPLES: dict[str, Solutions] = {
    "ratio of steps tends to 1": _tasks({0: 1, 1: -1}, {0: -1, 1: 1}),
    "a step grows from 0": _tasks({0: 0, 1: 0, 2: 0}, {0: 3, 1: 1}, pairs=3),
    "relevance rises": _tasks({0: 1}, {1: -1}),
}
"""Two tasks each; the abstraction merges all pairs."""


def run_examples(config: ExampleConfig, context: Context) -> pd.DataFrame:
    """Compute the examples; columns are documented in :data:`COUNTEREXAMPLES`."""
    records = []
    for name, solutions in EXAMPLES.items():
        labels = np.zeros(solutions.n_pairs, dtype=np.int64)
        rho = [brute_force_k_relevance(solutions, labels, k) for k in range(1, config.longest + 1)]
        for k, value in enumerate(rho, 1):
            records.append(
                {
                    "example": name,
                    "k": k,
                    "relevance": value,
                    "fraction": str(Fraction(value).limit_denominator(10**6)),
                    "step": value - rho[k - 2] if k > 1 else np.nan,
                }
            )
    return rows(records)


COUNTEREXAMPLES: Experiment[ExampleConfig] = Experiment(
    id="theorem-2-examples",
    item="Theorem 2 (counterexamples)",
    title="k-relevance of three domains of two tasks, small enough to do by hand.",
    function=run_examples,
    budgets={
        "smoke": ExampleConfig(longest=4),
        "book": ExampleConfig(),
        "thesis": ExampleConfig(),
    },
    columns={
        "example": "what it shows",
        "k": "sequence length",
        "relevance": "k-relevance, summed over all 2^k sequences",
        "fraction": "the same as a fraction",
        "step": "rho_k - rho_{k-1}",
    },
    seconds={"smoke": 1, "book": 1, "thesis": 1},
)


@dataclass(frozen=True)
class LemmaConfig:
    """Settings of the checks of appendix B."""

    domains: int = 2000
    """Random domains of each kind."""


def run_lemmas(config: LemmaConfig, context: Context) -> pd.DataFrame:
    """Check the lemmas; columns are documented in :data:`LEMMAS`."""
    records = []
    for kind in KINDS:
        seeds = context.seeds(config.domains, 3, KINDS.index(kind))
        errors = np.array([list(_lemma_errors(kind, seed).values()) for seed in seeds])
        for statement, column in zip(STATEMENTS, errors.T, strict=True):
            records.append(
                {
                    "kind": kind,
                    "statement": statement,
                    "holds": float((column <= 1e-9).mean()),
                    "largest_error": float(column.max()),
                    "n_domains": config.domains,
                }
            )
    return rows(records)


STATEMENTS = (
    "eq. 4.4: relevance is a sum of variances",
    "eq. B.4 as printed: relevance is the mean covariance",
    "eq. B.4 corrected: with weights p(y|c_i)/p(y|c)",
    "lemma 1: E[Q^c_i] = E[Q_i]",
    "lemma 2 as printed: |E[Q_i Q_j]| grows by (k+1)/k at most",
    "lemma 2 corrected: E|Q_i Q_j| grows by (k+1)/k at most",
    "shared p: E[Q_i Q_j] does not change",
)


def _lemma_errors(kind: Kind, seed: np.random.SeedSequence) -> dict[str, float]:
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
    values = (
        abs(relevance_by_variance(labels, q, p) - rho),
        abs(printed - rho),
        abs(corrected - rho),
        float(np.abs(mean - plain[c]).max()),
        max(float(growth.max()), 0.0),
        max(float(growth_abs.max()), 0.0),
        float(np.abs(after - before).max()),
    )
    return dict(zip(STATEMENTS, values, strict=True))


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


LEMMAS: Experiment[LemmaConfig] = Experiment(
    id="lemmas-1-2",
    item="Appendix B (steps)",
    title="Equations 4.4 and B.4 and lemmas 1 and 2 over random domains, from two tasks to three.",
    function=run_lemmas,
    budgets={
        "smoke": LemmaConfig(domains=10),
        "book": LemmaConfig(),
        "thesis": LemmaConfig(),
    },
    columns={
        "kind": KIND_COLUMN,
        "statement": "what is checked",
        "holds": "share of the domains in which it holds to 1e-9, for every pair of tasks",
        "largest_error": "by how much it fails at most",
        "n_domains": "number of random domains",
    },
    seconds={"smoke": 1, "book": 5, "thesis": 5},
)


@dataclass(frozen=True)
class CountConfig:
    """Settings of the counting of lemma 3."""

    tasks: tuple[int, ...] = (2, 3, 5)
    """N."""
    longest: int = 6
    """Largest k."""


def run_lemma_3(config: CountConfig, context: Context) -> pd.DataFrame:
    """Count the elements of lemma 3; columns are documented in :data:`LEMMA_3`."""
    records = []
    for n in config.tasks:
        for k in range(2, config.longest + 1):
            # Every sequence of k - 1 tasks by its counts o_m, every task appended to each.
            ratios = {
                Fraction(sum(2 * c.count(m) + 1 for m in range(n)), n * (2 * k - 1))
                for c in combinations_with_replacement(range(n), k - 1)
            }
            formula = Fraction(2 * (k - 1) + n, n * (2 * k - 1))
            records.append(
                {
                    "n_tasks": n,
                    "k": k,
                    "counted": float(max(ratios)),
                    "formula": float(formula),
                    "same": ratios == {formula},
                }
            )
    return rows(records)


LEMMA_3: Experiment[CountConfig] = Experiment(
    id="lemma-3",
    item="Lemma 3",
    title="Share of variances among new covariances, counted over all sequences.",
    function=run_lemma_3,
    budgets={
        "smoke": CountConfig(tasks=(2,), longest=3),
        "book": CountConfig(),
        "thesis": CountConfig(),
    },
    columns={
        "n_tasks": "N",
        "k": "sequence length",
        "counted": "type 1 covariances among the new ones, counted",
        "formula": "equation B.7",
        "same": "whether every sequence of k - 1 tasks gives exactly the formula",
    },
    seconds={"smoke": 1, "book": 1, "thesis": 1},
)


@dataclass(frozen=True)
class EstimatorConfig:
    """Settings of the check that U is unbiased."""

    runs: int = 4000
    """Sequences of tasks drawn at each size."""
    tasks_seen: tuple[int, ...] = (3, 5, 8)
    """Numbers of observed tasks n."""


def run_estimators(config: EstimatorConfig, context: Context) -> pd.DataFrame:
    """Compare estimators of domain relevance; columns are documented in :data:`ESTIMATORS`."""
    cases = (
        ("stock", stock(1, 2, 2), "s1e1"),
        ("stock", stock(1, 2, 2), "g1"),
        ("triangle", triangle(), "x2"),
        ("triangle", triangle(), "x1"),
    )
    records = []
    for case, (name, domain, feature) in enumerate(cases):
        solutions = exact_solutions(domain)
        labels = remove(solutions, [feature])
        truth = domain_relevance(solutions, labels)
        total = domain_relevance(solutions, np.zeros(solutions.n_pairs, dtype=np.int64))
        for replacement in (True, False):
            for n in config.tasks_seen:
                seeds = context.seeds(config.runs, 5, case, int(replacement), n)
                values = np.empty((config.runs, 3))
                for r, seed in enumerate(seeds):
                    rng = np.random.default_rng(seed)
                    tasks = rng.choice(len(domain), n, replace=replacement)
                    found = estimate(solutions.take(tasks), labels)
                    single = found.domain + found.spread
                    corrected = finite_domain(found.domain, single, len(domain))
                    values[r] = found.observed, found.domain, corrected
                for label, column in zip(("V_n", "U", "finite"), values.T, strict=True):
                    records.append(
                        {
                            "domain": name,
                            "feature": feature,
                            "drawn": "with" if replacement else "without",
                            "n": n,
                            "estimator": label,
                            "bias": float(column.mean() - truth) / total,
                            "bias_ci95": float(1.96 * column.std(ddof=1))
                            / total
                            / np.sqrt(config.runs),
                            "rmse": float(np.sqrt(((column - truth) ** 2).mean())) / total,
                            "truth": truth / total,
                            "n_runs": config.runs,
                        }
                    )
    return rows(records)


ESTIMATORS: Experiment[EstimatorConfig] = Experiment(
    id="estimator-u",
    item="Estimator U",
    title="Bias and error of three estimates of domain relevance from n observed tasks.",
    function=run_estimators,
    budgets={
        "smoke": EstimatorConfig(runs=5, tasks_seen=(3,)),
        "book": EstimatorConfig(),
        "thesis": EstimatorConfig(),
    },
    columns={
        "domain": "stock with G = 2 shares p(x|m); the triangle does not",
        "feature": "removed by the abstraction",
        "drawn": "tasks drawn with or without replacement",
        "n": "observed tasks",
        "estimator": "V_n, the relevance observed (IBKR's); U, the jackknife; finite, with the "
        "correction for a finite domain",
        "bias": "mean error over the relevance of removing every feature",
        "bias_ci95": "half-width of its 95% interval",
        "rmse": "root mean square error, the same unit",
        "truth": "domain relevance, the same unit",
        "n_runs": "sequences drawn",
    },
    seconds={"smoke": 1, "book": 40, "thesis": 40},
)
