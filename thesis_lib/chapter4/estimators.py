"""Estimates of domain relevance from few tasks: whether U is unbiased."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import pandas as pd

from thesis_lib.chapter4.looks import PM
from thesis_lib.chapter4.runs import exact_solutions
from thesis_lib.domains import stock, triangle
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.relevance import domain_relevance, estimate, finite_domain, remove

CASES = (("stock", "s1e1"), ("stock", "g1"), ("triangle", "x2"), ("triangle", "x1"))
"""Domains, and the feature that the abstraction removes."""


@dataclass(frozen=True)
class Config:
    """Settings of the check that U is unbiased."""

    runs: int = 4000
    """Sequences of tasks drawn at each size."""
    tasks_seen: tuple[int, ...] = (3, 5, 8)
    """Numbers of observed tasks n."""


@dataclass(frozen=True)
class Bias:
    """One estimate of one relevance from n tasks."""

    domain: str
    """Stock with G = 2 shares p(x|m); the triangle does not."""
    feature: str
    """Removed by the abstraction."""
    drawn: str
    """Tasks drawn with or without replacement."""
    n: int
    """Observed tasks."""
    estimator: str
    """V_n, the relevance observed (IBKR's); U, the jackknife; finite, with the correction for a
    finite domain."""
    bias: float
    """Mean error over the relevance of removing every feature."""
    bias_ci95: float
    """Half-width of its 95% interval."""
    rmse: float
    """Root mean square error, the same unit."""
    truth: float
    """Domain relevance, the same unit."""
    n_runs: int
    """Sequences drawn."""


@experiment(
    "ch4-estimators",
    item="Estimator U",
    smoke=Config(runs=5, tasks_seen=(3,)),
    book=Config(runs=1000),
    thesis=Config(),
    seconds=12,
)
def biases(config: Config, context: Context) -> list[Bias]:
    """Bias and error of three estimates of domain relevance from n observed tasks."""
    domains = {"stock": stock(1, 2, 2), "triangle": triangle()}
    records = []
    for case, (name, feature) in enumerate(CASES):
        solutions = exact_solutions(domains[name])
        n_tasks, labels = solutions.n_tasks, remove(solutions, [feature])
        truth = domain_relevance(solutions, labels)
        total = domain_relevance(solutions, np.zeros(solutions.n_pairs, dtype=np.int64))
        for replacement, n in product((True, False), config.tasks_seen):
            values = np.empty((config.runs, 3))
            for r, seed in enumerate(context.seeds(config.runs, 5, case, int(replacement), n)):
                rng = np.random.default_rng(seed)
                found = estimate(
                    solutions.take(rng.choice(n_tasks, n, replace=replacement)), labels
                )
                corrected = finite_domain(found.domain, found.domain + found.spread, n_tasks)
                values[r] = found.observed, found.domain, corrected
            for label, column in zip(("V_n", "U", "finite"), values.T, strict=True):
                half = float(1.96 * column.std(ddof=1)) / total / np.sqrt(config.runs)
                records.append(
                    Bias(
                        domain=name,
                        feature=feature,
                        drawn="with" if replacement else "without",
                        n=n,
                        estimator=label,
                        bias=float(column.mean() - truth) / total,
                        bias_ci95=half,
                        rmse=float(np.sqrt(((column - truth) ** 2).mean())) / total,
                        truth=truth / total,
                        n_runs=config.runs,
                    )
                )
    return records


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Biases from the fewest tasks, one column an estimate."""
    own = table[table.n == table.n.min()]
    cell = own.bias.map("{:+.3f}".format) + PM + own.bias_ci95.map("{:.3f}".format)
    wide = own.assign(cell=cell).pivot(
        index=["domain", "feature", "drawn"], columns="estimator", values="cell"
    )[["V_n", "U", "finite"]]
    wide.columns = ["$V_n$ (IBKR)", "U or J", "finite-domain"]
    return wide.reset_index()
