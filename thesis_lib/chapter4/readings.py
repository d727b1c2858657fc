"""Which reading of FS-TEK and IBKR fits the rates printed for the triangle."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from thesis_lib.chapter4.looks import two_rates
from thesis_lib.chapter4.runs import Kept, exact_solutions
from thesis_lib.domains import triangle
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Effect, effect_of
from thesis_lib.edition.words import several
from thesis_lib.selection import FSTEK, IBKR, ExactRelevance, Selector, rates, triangle_alpha


def _fstek(**options: Any) -> FSTEK:
    return FSTEK(**{"alpha": triangle_alpha, "flat": "unsure", **options})


READINGS: Mapping[str, Callable[[int], Selector]] = {
    "as used": lambda seed: _fstek(),
    "flat curves removed": lambda seed: _fstek(flat="limit"),
    # The formula's level is .0601, not 1e-4, at five tasks.
    "alpha(k) by the formula": lambda seed: _fstek(alpha=partial(triangle_alpha, first=4)),
    "one-sided": lambda seed: _fstek(tail="one-sided"),
    "interval of an observation": lambda seed: _fstek(interval="observation"),
    "alpha is the confidence": lambda seed: _fstek(alpha_is="confidence"),
    "retest kept features": lambda seed: _fstek(keep_for_good="never"),
    "5 sequences sampled": lambda seed: _fstek(max_seqs=5, random_state=seed),
    "IBKR, no interval": lambda seed: IBKR(),
    "IBKR, bootstrap": lambda seed: IBKR(0.15, interval="bootstrap", random_state=seed),
}
"""Selectors by reading, given a seed."""


@dataclass(frozen=True)
class Config:
    """Settings of the comparison of readings."""

    runs: int = 300
    """Sequences of tasks."""
    tasks_seen: tuple[int, ...] = (4, 5, 6, 8, 12)
    """Numbers of observed tasks."""


@dataclass(frozen=True)
class Rates(Kept):
    """One reading after one number of tasks."""

    reading: str
    """Which option differs from the one used."""
    n_runs: int
    """Sequences of tasks."""


@experiment(
    "ch4-readings",
    item="Figure 4.3 (readings)",
    smoke=Config(runs=2, tasks_seen=(5,)),
    book=Config(runs=150),
    thesis=Config(runs=500),
    seconds=18,
)
def by_reading(config: Config, context: Context) -> list[Rates]:
    """False and true positive rate on the triangle, by reading of FS-TEK and IBKR."""
    solutions = exact_solutions(triangle())
    truth = ExactRelevance().fit(solutions).support_
    seeds = [int(s.generate_state(1)[0]) for s in context.seeds(config.runs, 6)]
    most = max(config.tasks_seen)
    drawn = [np.random.default_rng(s).integers(solutions.n_tasks, size=most) for s in seeds]

    def one(job: tuple[str, int]) -> Rates:
        reading, n = job
        support = [
            READINGS[reading](seed).fit(solutions.take(tasks[:n])).support_
            for seed, tasks in zip(seeds, drawn, strict=True)
        ]
        return Rates(n, *rates(support, truth), reading=reading, n_runs=config.runs)

    return context.map(one, product(READINGS, config.tasks_seen), "readings")


def _effect(difference: str, *readings: str) -> Effect:
    """Tells what readings do to the rates after five tasks."""

    def rates_of(table: pd.DataFrame) -> str:
        by = two_rates(table[table.tasks_seen == 5].set_index("reading"))
        return (
            "False/true positive rate on the triangle after five tasks (printed: about .45/1): "
            f"{several(f'{reading} {by[reading]}' for reading in readings)}."
        )

    return effect_of(difference, by_reading)(rates_of)


interval = _effect("4.2-interval", "as used", "interval of an observation", "one-sided")
alpha_means = _effect("4.2-alpha-means", "as used", "alpha is the confidence")
schedule = _effect("4.3-schedule", "as used", "alpha(k) by the formula")
unsure = _effect("4.3-unsure", "as used", "flat curves removed")
max_seqs = _effect("4.2-max-seqs", "as used", "5 sequences sampled")
ibkr_level = _effect("4.3-ibkr-level", "IBKR, no interval", "IBKR, bootstrap")


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Rates by reading, one column a number of tasks."""
    wide = table.assign(cell=two_rates(table)).pivot(
        index="reading", columns="tasks_seen", values="cell"
    )
    wide = wide.reindex(table.reading.unique())
    wide.columns = [f"n = {n}" for n in wide.columns]
    return wide.reset_index()
