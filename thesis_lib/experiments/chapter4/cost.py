"""What k-relevance costs: algorithm 8 against the exact law."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd

from thesis_lib.experiments.base import Context, Experiment, rows
from thesis_lib.mdp.model import FloatArray
from thesis_lib.relevance import Estimate, Solutions, ground
from thesis_lib.relevance.estimators import compare
from thesis_lib.selection import bkr


@dataclass(frozen=True)
class CostConfig:
    """Settings of the timings."""

    bits: tuple[int, ...] = (8, 10, 12, 14, 16)
    """Binary features; there are 2^bits pairs."""
    tasks: tuple[int, ...] = (5, 10, 20, 40)
    """Observed tasks, at the middle number of features."""
    max_seqs: tuple[int, ...] = (10, 30, 100, 300)
    """Sequences of algorithm 8, at the middle number of features and most tasks."""
    repeats: int = 2
    """The least of so many timings counts."""


def random_tables(bits: int, n_tasks: int, rng: np.random.Generator) -> Solutions:
    """Gaussian Q-functions over binary features, one uniform p(x|m)."""
    n = 2**bits
    features = (np.arange(n)[:, None] >> np.arange(bits)) & 1
    p = np.broadcast_to(np.full(n, 1.0 / n), (n_tasks, n))
    names = tuple(f"f{i}" for i in range(bits))
    return Solutions(rng.normal(size=(n_tasks, n)), p, features, names)


def run_cost(config: CostConfig, context: Context) -> pd.DataFrame:
    """Time both; columns are documented in :data:`COST`."""
    rng = np.random.default_rng(context.seed)
    middle = config.bits[len(config.bits) // 2]
    plan = [("pairs", bits, 10, 100) for bits in config.bits]
    plan += [("tasks", middle, n, 100) for n in config.tasks]
    # So many tasks that there are more combinations than are sampled.
    plan += [("max_seqs", middle, max(config.tasks), size) for size in config.max_seqs]
    records = []
    for varied, bits, n, size in plan:
        solutions = random_tables(bits, n, rng)
        timed: dict[str, Callable[[], object]] = {
            "algorithm 8": partial(_by_sampling, solutions, size),
            "exact law": partial(_by_the_law, solutions),
        }
        for method, work in timed.items():
            records.append(
                {
                    "method": method,
                    "varied": varied,
                    "pairs": 2**bits,
                    "features": bits,
                    "tasks": n,
                    "max_seqs": size,
                    "cpu_seconds": _least(work, config.repeats),
                }
            )
    return rows(records)


def _by_the_law(solutions: Solutions) -> list[Estimate]:
    """Relevance of every feature for all k: U and b of each."""
    cells = ground(solutions)
    return [compare(cells, cells.drop(i)) for i in cells.features]


def _by_sampling(solutions: Solutions, max_seqs: int) -> list[FloatArray]:
    """Relevance of every feature for k = 1 .. n, from sampled combinations."""
    return [bkr(solutions, (), max_seqs, k, 0) for k in range(1, solutions.n_tasks + 1)]


def _least(work: Callable[[], object], repeats: int) -> float:
    """Least processor time of several calls, seconds."""
    times = []
    for _ in range(repeats):
        # A clock of this thread alone: other threads may work beside it.
        start = time.thread_time()
        work()
        times.append(time.thread_time() - start)
    return min(times)


COST: Experiment[CostConfig] = Experiment(
    id="k-relevance-cost",
    item="Complexity of BKR",
    title="Time of the k-relevance of all features for all k, by algorithm 8 and by the law.",
    function=run_cost,
    budgets={
        "smoke": CostConfig(bits=(12, 13), tasks=(4, 8), max_seqs=(10, 20), repeats=1),
        "book": CostConfig(),
        "thesis": CostConfig(bits=(8, 10, 12, 14, 16, 18)),
    },
    columns={
        "method": "algorithm 8 for k = 1 .. n, or the exact law, which gives every k",
        "varied": "what changes along the curve",
        "pairs": "state-action pairs N",
        "features": "features P",
        "tasks": "observed tasks n",
        "max_seqs": "sequences sampled by algorithm 8, M",
        "cpu_seconds": "processor time of relevance of all features",
    },
    seconds={"smoke": 1, "book": 15, "thesis": 60},
)
