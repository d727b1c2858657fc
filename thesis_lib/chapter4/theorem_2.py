"""Theorem 2: whether k-relevance is a strict contraction."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import pandas as pd

from thesis_lib.chapter4.random_domains import BOOK, ROUNDING, SMOKE, WEIGHTS, Config, random_curves
from thesis_lib.edition.criteria import EXACT, judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.words import several
from thesis_lib.relevance import Solutions, brute_force_k_relevance


@dataclass(frozen=True)
class Steps:
    """Steps of k-relevance in the random domains of one kind."""

    kind: str
    """p(x|m): shared by all tasks; uniform on each task's own subset of pairs; any weights."""
    n_domains: int
    """Number of random domains, each with a random abstraction and D."""
    steps_shrink: float
    """Share in which |rho_{k+1} - rho_k| <= |rho_k - rho_{k-1}| for all k."""
    contraction_80: float
    """Share in which kappa = .8 serves all k up to the largest."""
    last_ratio: float
    """Median ratio of the last two steps."""
    law_error: float
    """Largest |rho_k - (rho_inf + (rho_1 - rho_inf)/k)| over the largest rho."""
    brute_force_error: float
    """Largest difference from the sum over all sequences, k up to 4."""


@experiment("theorem-2", item="Theorem 2", smoke=SMOKE, book=BOOK, thesis=Config(), seconds=8)
def steps(config: Config, context: Context) -> list[Steps]:
    """Whether steps of k-relevance contract, and the law they follow, in random domains."""
    records = []
    for curves in random_curves(config, context):
        rho, limit = curves.rho[:, :-1], curves.limit[:, None]
        size = np.abs(curves.steps)
        before, after = size[:, :-1], size[:, 1:]
        moved = size[:, 0] > ROUNDING
        ratio = after / np.maximum(before, ROUNDING)
        law = limit + (rho[:, :1] - limit) / np.arange(1, config.longest + 1)
        contracts = (after <= 0.8 * before + ROUNDING).all(axis=1) | ~moved
        records.append(
            Steps(
                kind=curves.kind,
                n_domains=len(rho),
                steps_shrink=float((after <= before + ROUNDING).all(axis=1).mean()),
                contraction_80=float(contracts.mean()),
                last_ratio=float(np.median(ratio[moved, -1])) if moved.any() else np.nan,
                law_error=float((np.abs(rho - law) / curves.scale).max()),
                brute_force_error=curves.brute_force_error,
            )
        )
    return records


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


@dataclass(frozen=True)
class Example:
    """k-relevance of one example for one k."""

    example: str
    """What it shows."""
    k: int
    """Sequence length."""
    relevance: float
    """k-relevance, summed over all 2^k sequences."""
    fraction: str
    """The same as a fraction."""
    step: float
    """rho_k - rho_{k-1}."""


@experiment(
    "ch4-counterexamples",
    item="Theorem 2 (counterexamples)",
    smoke=ExampleConfig(longest=4),
    book=ExampleConfig(),
    seconds=0.07,
)
def counterexamples(config: ExampleConfig, context: Context) -> list[Example]:
    """k-relevance of three domains of two tasks, small enough to do by hand."""
    records = []
    for name, solutions in EXAMPLES.items():
        labels = np.zeros(solutions.n_pairs, dtype=np.int64)
        before = np.nan
        for k in range(1, config.longest + 1):
            rho = brute_force_k_relevance(solutions, labels, k)
            fraction = str(Fraction(rho).limit_denominator(10**6))
            records.append(Example(name, k, rho, fraction, rho - before))
            before = rho
    return records


@criterion("4.1.2-theorem-2", steps, counterexamples)
def is_no_contraction(table: pd.DataFrame, examples: pd.DataFrame) -> Finding:
    """Whether one constant below 1 serves all k: not by the law 1/k, nor where a step grows."""
    by = table.set_index("kind")
    example = examples.set_index(["example", "k"]).loc["a step grows from 0"]
    grown = abs(example.step[3]) > 1e-6 > abs(example.step[2])
    shared = by.loc["shared"]
    # Steps of a + b/k that are not 0 have a ratio that passes every constant.
    passes = shared.law_error < EXACT and shared.last_ratio > 0
    grows = grown or (by.steps_shrink < 1).any()
    lengthening = several(f"{1 - by.steps_shrink[kind]:.0%} ({WEIGHTS[kind]})" for kind in by.index)
    rho = several(example.fraction[k] for k in (1, 2, 3))
    return judged(
        (by.contraction_80 == 1).all() and not passes and not grows,
        f"With shared p(x|m), over {int(shared.n_domains)} random domains, k-relevance is a + b/k "
        f"up to {shared.law_error:.0g} of its largest value (the steps of that curve have the "
        f"ratio (k - 1)/(k + 1)); the last ratio computed is {shared.last_ratio:.3f} in the "
        f"median, and kappa = .8 serves all k computed in {shared.contraction_80:.0%}. A step is "
        f"longer than the one before in {lengthening} of the domains; two tasks on three pairs "
        f"have rho = {rho} for k = 1, 2 and 3.",
        {"ratio": float(shared.last_ratio), "law_error": float(shared.law_error)},
        otherwise=Verdict.REFUTED if passes or grows else Verdict.INCONCLUSIVE,
    )


@criterion("4.1.2-power-law", steps)
def is_a_power_law(table: pd.DataFrame) -> Finding:
    """Whether k-relevance is a + b/k to rounding where tasks share p(x|m)."""
    shared = table.set_index("kind").loc["shared"]
    return judged(
        shared.law_error < EXACT,
        f"In {int(shared.n_domains)} random domains with shared p(x|m) k-relevance differs from "
        f"a + b/k by at most {shared.law_error:.0g} of its largest value, for every k computed.",
        {"law_error": float(shared.law_error)},
    )


def shown(examples: pd.DataFrame) -> pd.DataFrame:
    """The counterexamples as a table: k-relevance as a fraction, one column a k up to 5."""
    wide = examples[examples.k <= 5].pivot(index="example", columns="k", values="fraction")
    wide.columns = [f"$\\rho_{k}$" for k in wide.columns]
    return wide.reset_index()


def both_shown(two: pd.DataFrame, three: pd.DataFrame) -> pd.DataFrame:
    """The tables of theorems 2 and 3 side by side."""
    return pd.DataFrame(
        {
            "weights": two.kind.map(WEIGHTS),
            "domains": two.n_domains,
            "steps shrink": two.steps_shrink,
            "error of law": two.law_error.map("{:.1g}".format),
            "only falls": three.decreasing,
            "only rises": three.increasing,
            "does both": three.not_monotone,
        }
    )
