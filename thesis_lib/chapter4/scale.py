"""Whole selections on ever larger tables of fifty tasks."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.relevance import Solutions
from thesis_lib.selection import FSTEK, JackknifeF, Selector


@dataclass(frozen=True)
class Config:
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


@dataclass(frozen=True)
class Selection:
    """One selection on one table."""

    method: str
    """jackknife (F) or fs-tek."""
    pairs: int
    """State-action pairs N."""
    tasks: int
    """Observed tasks n."""
    features: int
    """Features P."""
    relevant_kept: int
    """Relevant features kept, of 5."""
    irrelevant_kept: int
    """Irrelevant features kept, of the others."""
    cpu_seconds: float
    """Processor time of the selection."""


def planted_table(config: Config, bits: int, rng: np.random.Generator) -> Solutions:
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


@experiment(
    "ch4-scale",
    item="Selection at scale",
    smoke=Config(bits=(8, 10)),
    book=Config(bits=(12, 14, 16, 18)),
    thesis=Config(),
    seconds=6,
)
def selections(config: Config, context: Context) -> list[Selection]:
    """Time of a whole selection on tables of 50 tasks and more and more pairs."""
    methods: dict[str, Selector] = {"jackknife": JackknifeF(), "fs-tek": FSTEK(config.alpha)}
    records = []
    for bits in config.bits:
        solutions = planted_table(config, bits, np.random.default_rng(context.seed))
        for name, selector in methods.items():
            # A new object, so that nothing computed before is used again.
            fresh = solutions.take(np.arange(config.tasks))
            start = time.thread_time()
            kept = selector.fit(fresh).support_
            seconds = time.thread_time() - start
            records.append(
                Selection(
                    method=name,
                    pairs=2**bits,
                    tasks=config.tasks,
                    features=bits,
                    relevant_kept=int(kept[: config.relevant].sum()),
                    irrelevant_kept=int(kept[config.relevant :].sum()),
                    cpu_seconds=seconds,
                )
            )
    return records
