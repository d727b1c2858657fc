r"""Theorem 2 with a factor for each k, and what is left of k-relevance after its first term.

Where tasks share p(x|m), :math:`\rho_k = \rho_\infty + (\rho_1 - \rho_\infty)/k`, so

.. math:: \rho_{k+1} - \rho_k = \kappa_k (\rho_k - \rho_{k-1}), \qquad
          \kappa_k = \frac{k-1}{k+1} < 1.

No constant serves all k, as :math:`\kappa_k \to 1`; but the steps, :math:`\prod_{j \le k}
\kappa_j = 2/(k(k+1))` of the first, have a finite sum, and corollary 1 follows from that where
Banach's theorem does not apply.  Appendix B argues for no more than this: its inequalities hold
for each k by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from thesis_lib.chapter4.random_solutions import KINDS, Kind, random_solutions
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.relevance import domain_relevance, k_relevance, rate, second_rate

ROUNDING = 1e-6
"""Steps below this share of the largest relevance have no ratio worth the name."""


@dataclass(frozen=True)
class Config:
    """Random domains whose steps are compared."""

    domains: int = 500
    """Of each kind, with 2 to 5 tasks."""
    lengths: tuple[int, ...] = (2, 3, 4, 6, 10, 20, 50, 100, 1000)
    """Sequence lengths k."""


@dataclass(frozen=True)
class Step:
    """Steps of k-relevance at one k over the random domains of one kind."""

    kind: str
    """p(x|m): shared by all tasks; uniform on each task's own subset of pairs; any weights."""
    k: int
    """Sequence length."""
    kappa: float
    """(k - 1)/(k + 1)."""
    lowest: float
    """Least ratio of the step from k to k + 1 to that from k - 1 to k."""
    highest: float
    """Largest such ratio."""
    larger: float
    """Share of domains in which the step to k + 1 is larger than the one to k."""
    rest: float
    """Median of k^2 |rho_k - rho_inf - c/k| over the second coefficient; none with shared p."""
    n_domains: int
    """Domains with a step that is not rounding."""


@experiment(
    "ch4-each-k",
    item="Theorem 2 (a factor for each k)",
    smoke=Config(domains=6, lengths=(2, 10)),
    book=Config(),
    seconds=4,
)
def steps(config: Config, context: Context) -> list[Step]:
    """Ratio of successive steps of k-relevance, and the rest after c/k, in random domains."""
    lengths = np.array(config.lengths)
    around = np.concatenate([lengths - 1, lengths, lengths + 1])
    rows = []
    for kind in KINDS:

        def one(job: tuple[int, np.random.SeedSequence], kind: Kind = kind) -> np.ndarray:
            index, seed = job
            rng = np.random.default_rng(seed)
            solutions = random_solutions(rng, kind, 2 + index % 4)
            labels = rng.integers(0, 3, solutions.n_pairs)
            D = rng.dirichlet(np.ones(solutions.n_tasks))
            rho = k_relevance(solutions, labels, around, distribution=D).reshape(3, -1)
            first = float(k_relevance(solutions, labels, [1], distribution=D)[0])
            limit = domain_relevance(solutions, labels, distribution=D)
            c = rate(solutions, labels, distribution=D)
            second = abs(second_rate(solutions, labels, distribution=D))
            rest = np.abs(lengths**2 * (rho[1] - limit - c / lengths))
            ratio = rest / second if second > ROUNDING else np.full(len(lengths), np.nan)
            return np.array([*rho, ratio, np.full(len(lengths), first)])

        jobs = list(enumerate(context.seeds(config.domains, 21, KINDS.index(kind))))
        found = np.stack(context.map(one, jobs, kind))
        before, now, after, rest, first = found.transpose(1, 0, 2)
        size = np.maximum(first, np.abs(now)) / lengths**2
        moved = np.abs(now - before) > ROUNDING * size
        for i, k in enumerate(config.lengths):
            use = moved[:, i]
            ratio = ((after - now)[use, i] / (now - before)[use, i]) if use.any() else [np.nan]
            rows.append(
                Step(
                    kind=kind,
                    k=k,
                    kappa=(k - 1) / (k + 1),
                    lowest=float(np.min(ratio)),
                    highest=float(np.max(ratio)),
                    larger=float((np.abs(ratio) > 1 + 1e-9).mean()),
                    rest=float(np.nanmedian(rest[:, i])) if kind != "shared" else float("nan"),
                    n_domains=int(use.sum()),
                )
            )
    return rows


@criterion("B.1-each-k", steps)
def contracts_for_each_k(table: pd.DataFrame) -> Finding:
    """Whether every step is shorter than the one before, by the factor (k - 1)/(k + 1)."""
    shared = table[table.kind == "shared"]
    gap = float(
        np.maximum(
            (shared.highest - shared.kappa).abs(), (shared.lowest - shared.kappa).abs()
        ).max()
    )
    other = table[table.kind != "shared"]
    worst = other.loc[other.larger.idxmax()]
    verdict = Verdict.REFUTED
    if gap < 1e-3:
        verdict = Verdict.REPRODUCED if not other.larger.any() else Verdict.DIRECTION
    return Finding(
        verdict,
        f"With shared p(x|m) the ratio of steps is (k - 1)/(k + 1) to within {gap:.1g} for every k "
        f"up to {shared.k.max()}, in {shared.n_domains.min()} random domains or more. Where p(x|m) "
        f"differs a step is longer than the one before in up to {worst.larger:.1%} of the domains "
        f"(k = {worst.k}).",
        {"gap": gap, "larger": float(worst.larger)},
    )


@criterion("4.1.2-second-order", steps)
def rest_is_of_second_order(table: pd.DataFrame) -> Finding:
    """Whether k^2 times the rest after c/k comes to the coefficient derived."""
    last = table[(table.k == table.k.max()) & (table.kind != "shared")]
    good = bool(((last.rest - 1).abs() < 0.1).all())
    return Finding(
        Verdict.REPRODUCED if good else Verdict.REFUTED,
        f"At k = {table.k.max()} k^2 |rho_k - rho_inf - c/k| is in the median "
        f"{' and '.join(f'{r:.2f}' for r in last.rest)} times what the coefficient predicts, for "
        "the two kinds of differing p(x|m).",
        {"ratio": float(last.rest.max())},
    )
