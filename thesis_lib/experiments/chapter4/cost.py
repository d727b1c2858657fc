"""What k-relevance costs: algorithm 8 against the exact law, and selection on large tables."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd

from thesis_lib.arrays import FloatArray
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.relevance import Estimate, Solutions, ground
from thesis_lib.relevance.estimators import compare
from thesis_lib.selection import FSTEK, JackknifeF, bkr


@dataclass(frozen=True)
class CostConfig:
    """Settings of the timings."""

    bits: tuple[int, ...] = (8, 10, 12, 14, 16)
    """Binary features; there are 2^bits pairs."""
    tasks: tuple[int, ...] = (5, 10, 20, 40)
    """Observed tasks, at the middle number of features."""
    features: tuple[int, ...] = (4, 8, 16, 32)
    """Features of one and the same 4096 pairs."""
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


def same_pairs(n_features: int, n_tasks: int, rng: np.random.Generator) -> Solutions:
    """Gaussian Q-functions on 4096 pairs, told apart by few features or described by many.

    Parameters
    ----------
    n_features
        Fewer than 12 merge bits into larger features, more repeat random bits.
    n_tasks
        n.
    rng
        Source of the numbers.
    """
    base = random_tables(12, n_tasks, rng)
    if n_features < 12:
        parts = np.array_split(np.arange(12), n_features)
        columns = [base.features[:, i] @ (1 << np.arange(len(i))) for i in parts]
    else:
        extra = rng.integers(2, size=(base.n_pairs, n_features - 12))
        columns = [*base.features.T, *extra.T]
    names = tuple(f"f{i}" for i in range(n_features))
    return Solutions(base.q, base.p, np.stack(columns, axis=1), names)


def run_cost(config: CostConfig, context: Context) -> pd.DataFrame:
    """Time both; columns are documented in :data:`COST`."""
    rng = np.random.default_rng(context.seed)
    middle = config.bits[len(config.bits) // 2]
    plan = [("pairs", bits, 10, 100) for bits in config.bits]
    plan += [("tasks", middle, n, 100) for n in config.tasks]
    # So many tasks that there are more combinations than are sampled.
    plan += [("max_seqs", middle, max(config.tasks), size) for size in config.max_seqs]
    plan += [("features", count, 10, 100) for count in config.features]
    records = []
    for varied, bits, n, size in plan:
        if varied == "features":
            solutions = same_pairs(bits, n, rng)
        else:
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
                    "pairs": solutions.n_pairs,
                    "features": bits,
                    "tasks": n,
                    "max_seqs": size,
                    "cpu_seconds": _least(work, config.repeats),
                }
            )
    return rows(records)


def _by_the_law(solutions: Solutions) -> list[Estimate]:
    """Relevance of every feature for all k: U and b of each."""
    # A new object, so that nothing computed before is used again.
    cells = ground(solutions.take(np.arange(solutions.n_tasks)))
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
        "smoke": CostConfig(
            bits=(12, 13), tasks=(4, 8), features=(4, 8), max_seqs=(10, 20), repeats=1
        ),
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
    seconds={"smoke": 1, "book": 20, "thesis": 65},
)


@dataclass(frozen=True)
class ScaleConfig:
    """Settings of selection on ever larger tables."""

    bits: tuple[int, ...] = (12, 14, 16, 18, 20)
    """Binary features; there are 2^bits pairs."""
    tasks: int = 50
    """Observed tasks."""
    relevant: int = 5
    """Features with an effect of mean 1 and standard deviation .3; the others have mean 0 and
    standard deviation 1."""
    alpha: float = 1e-3
    """Level of FS-TEK."""


def planted_table(config: ScaleConfig, bits: int, rng: np.random.Generator) -> Solutions:
    """Tasks with a linear effect of every feature, a few of them relevant.

    Parameters
    ----------
    config
        Number of tasks and of relevant features.
    bits
        Number of features.
    rng
        Source of the effects.
    """
    n = 2**bits
    features: np.ndarray = ((np.arange(n)[:, None] >> np.arange(bits)[::-1]) & 1).astype(np.int8)
    effects = rng.normal(0, 1, (config.tasks, bits))
    effects[:, : config.relevant] = rng.normal(1, 0.3, (config.tasks, config.relevant))
    p = np.broadcast_to(np.full(n, 1 / n), (config.tasks, n))
    return Solutions(effects @ features.T, p, features, tuple(f"f{i}" for i in range(bits)))


def run_scale(config: ScaleConfig, context: Context) -> pd.DataFrame:
    """Time whole selections; columns are documented in :data:`SCALE`."""
    records = []
    for bits in config.bits:
        solutions = planted_table(config, bits, np.random.default_rng(context.seed))
        for name, selector in (("jackknife", JackknifeF()), ("fs-tek", FSTEK(config.alpha))):
            # A new object, so that nothing computed before is used again.
            fresh = solutions.take(np.arange(config.tasks))
            start = time.thread_time()
            kept = selector.fit(fresh).support_
            seconds = time.thread_time() - start
            records.append(
                {
                    "method": name,
                    "pairs": 2**bits,
                    "tasks": config.tasks,
                    "features": bits,
                    "relevant_kept": int(kept[: config.relevant].sum()),
                    "irrelevant_kept": int(kept[config.relevant :].sum()),
                    "cpu_seconds": seconds,
                }
            )
    return rows(records)


SCALE: Experiment[ScaleConfig] = Experiment(
    id="selection-at-scale",
    item="Selection at scale",
    title="Time of a whole selection on tables of up to 2^20 pairs and 50 tasks.",
    function=run_scale,
    budgets={
        "smoke": ScaleConfig(bits=(8, 10)),
        "book": ScaleConfig(),
        "thesis": ScaleConfig(),
    },
    columns={
        "method": "jackknife (F) or fs-tek",
        "pairs": "state-action pairs N",
        "tasks": "observed tasks n",
        "features": "features P",
        "relevant_kept": "relevant features kept, of 5",
        "irrelevant_kept": "irrelevant features kept, of the others",
        "cpu_seconds": "processor time of the selection",
    },
    seconds={"smoke": 1, "book": 16, "thesis": 16},
)
