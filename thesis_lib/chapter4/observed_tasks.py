"""k-relevance from few observed tasks: combinations without repeats against sequences (4.2)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from thesis_lib.chapter4.runs import exact_solutions
from thesis_lib.domains import Domain, stock, triangle
from thesis_lib.domains.planted import random_domain, torus
from thesis_lib.edition.criteria import positive
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, criterion
from thesis_lib.relevance import domain_relevance, k_relevance, remove
from thesis_lib.stats import mean_ci

DOMAINS: Mapping[str, Callable[[], Domain]] = {
    "triangle": triangle,
    "stock G = 1": lambda: stock(1, 2, 1),
    "random MDPs": lambda: random_domain(303),
    "torus": torus,
}
"""Tasks of stock and random MDPs share p(x|m)."""


@dataclass(frozen=True)
class Config:
    """How often and on how many tasks relevance is estimated."""

    domains: tuple[str, ...] = tuple(DOMAINS)
    """Names in :data:`DOMAINS`."""
    tasks_seen: tuple[int, ...] = (3, 5, 8)
    """Numbers of observed tasks n."""
    runs: int = 200
    """Samples of tasks."""


@dataclass(frozen=True)
class Error:
    """Error of the relevance of every feature for all k up to the number of observed tasks."""

    domain: str
    """Which domain."""
    tasks_seen: int
    """Number of observed tasks n."""
    sequences: float
    """Root mean square error over k, features and runs, of the mean over all sequences of k of
    the observed tasks, as a share of the relevance of all features."""
    combinations: float
    """The same of the mean over all combinations of k different ones."""
    lead: float
    """Mean square error of sequences less that of combinations, paired by run."""
    lead_ci95: float
    """Half-width of its 95% t interval."""


@experiment(
    "ch4-observed-tasks",
    item="Section 4.2 (combinations)",
    smoke=Config(("triangle",), (3,), 5),
    book=Config(),
    seconds=8,
)
def errors(config: Config, context: Context) -> list[Error]:
    """Error of k-relevance from few tasks, by combinations without repeats and by sequences."""
    rows = []
    for i, name in enumerate(config.domains):
        domain = DOMAINS[name]()
        solutions = exact_solutions(domain)
        total = domain_relevance(solutions, np.zeros(solutions.n_pairs, dtype=np.int64))
        labels = [remove(solutions, [f]) for f in solutions.feature_names]
        most = np.arange(1, max(config.tasks_seen) + 1)
        true = np.stack(
            [k_relevance(solutions, own, most, distribution=domain.distribution) for own in labels]
        )
        for n in config.tasks_seen:
            found = []
            for seed in context.seeds(config.runs, 42, i, n):
                seen = solutions.take(domain.sample(n, np.random.default_rng(seed)))
                off = [
                    np.stack([k_relevance(seen, own, most[:n], replacement=r) for own in labels])
                    - true[:, :n]
                    for r in (True, False)
                ]
                found.append([float((e**2).mean()) for e in off])
            squared = np.array(found) / total**2
            lead = mean_ci(squared[:, 0] - squared[:, 1])
            root = np.sqrt(squared.mean(axis=0))
            rows.append(Error(name, n, float(root[0]), float(root[1]), lead.mean, lead.half_width))
    return rows


@criterion("4.2-combinations", errors)
def combinations_are_nearer(table: pd.DataFrame) -> Finding:
    """Mean square error of sequences less that of combinations, in every domain for every n."""
    return positive(
        {
            f"{r.domain}, n = {r.tasks_seen}": (r.lead, r.lead_ci95 / 1.96)
            for r in table.itertuples()
        },
        "Mean square error of the relevance by sequences less that by combinations, in squares of "
        "the relevance of all features",
    )
