"""k-relevance in random domains, which theorems 2 and 3 and corollary 1 are held against."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.chapter4.random_solutions import KINDS, Kind, random_solutions
from thesis_lib.edition.experiment import Context
from thesis_lib.relevance import brute_force_k_relevance, domain_relevance, k_relevance, rate

ROUNDING = 1e-10
"""A change below this share of the largest relevance is rounding."""

FLOOR = 1e-6
"""Relevances below this are rounding themselves, Q-values being of size 1."""

WEIGHTS: Mapping[str, str] = {
    "shared": "shared p(x|m)",
    "subsets": "uniform on subsets",
    "weights": "any weights",
}
"""How figures and tables name the kinds."""


@dataclass(frozen=True)
class Config:
    """Settings of the checks over random domains."""

    domains: int = 2000
    """Random domains of each kind."""
    longest: int = 20
    """Largest k."""
    brute_force: int = 50
    """Domains of each kind whose rho_1 .. rho_4 are also summed over all sequences."""

    @property
    def lengths(self) -> IntArray:
        """Sequence lengths k: 1 .. longest, and 1000."""
        return np.array([*range(1, self.longest + 1), 1000])


SMOKE = Config(domains=8, longest=5, brute_force=2)
BOOK = Config(domains=500, brute_force=30)


@dataclass(frozen=True)
class Curves:
    """k-relevance of a random abstraction in each of the random domains of one kind.

    Attributes
    ----------
    kind
        How tasks weight their pairs.
    rho
        k-relevance at :attr:`Config.lengths`, shape ``(domains, lengths)``.
    limit, slope
        Domain relevance, and the coefficient of 1/k, shape ``(domains,)``.
    brute_force_error
        Largest difference from the sum over all sequences.
    """

    kind: Kind
    rho: FloatArray
    limit: FloatArray
    slope: FloatArray
    brute_force_error: float

    @property
    def steps(self) -> FloatArray:
        """Steps of k-relevance up to the longest k, as shares of its largest value."""
        rho = self.rho[:, :-1]
        return np.diff(rho, axis=1) / self.scale

    @property
    def scale(self) -> FloatArray:
        """Largest k-relevance of each domain, shape ``(domains, 1)``."""
        return np.maximum(self.rho[:, :-1].max(axis=1), FLOOR)[:, None]


@cache
def random_curves(config: Config, context: Context) -> tuple[Curves, ...]:
    """k-relevance in random domains of every kind; three experiments judge the same."""
    found = []
    for kind in KINDS:

        def one(job: tuple[int, np.random.SeedSequence], kind: Kind = kind) -> FloatArray:
            index, seed = job
            rng = np.random.default_rng(seed)
            solutions = random_solutions(rng, kind, 2 + index % 4)
            labels: IntArray = rng.integers(0, 3, solutions.n_pairs)
            D = rng.dirichlet(np.ones(solutions.n_tasks))
            rho = k_relevance(solutions, labels, config.lengths, distribution=D)
            gaps = [
                abs(brute_force_k_relevance(solutions, labels, k, D) - rho[k - 1])
                for k in ((1, 2, 3, 4) if index < config.brute_force else ())
            ]
            limit = domain_relevance(solutions, labels, distribution=D)
            slope = rate(solutions, labels, distribution=D)
            return np.array([*rho, limit, slope, max(gaps, default=0.0)])

        seeds = context.seeds(config.domains, 2, KINDS.index(kind))
        *rho, limit, slope, gap = np.transpose(context.map(one, list(enumerate(seeds)), kind))
        found.append(Curves(kind, np.transpose(rho), limit, slope, float(gap.max())))
    return tuple(found)
