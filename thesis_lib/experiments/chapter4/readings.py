"""Which reading of FS-TEK and IBKR fits the rates printed for the triangle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from thesis_lib.domains import triangle
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.experiments.chapter4.curves import exact_solutions
from thesis_lib.selection import FSTEK, IBKR, ExactRelevance, Selector, rates, triangle_alpha

LITERAL = partial(triangle_alpha, first=4)
"""The level as the formula has it: .0601, not 1e-4, at five tasks."""


def _fstek(**options: Any) -> FSTEK:
    return FSTEK(**{"alpha": triangle_alpha, "flat": "unsure", **options})


READINGS: dict[str, Callable[[int], Selector]] = {
    "as used": lambda seed: _fstek(),
    "flat curves removed": lambda seed: _fstek(flat="limit"),
    "alpha(k) by the formula": lambda seed: _fstek(alpha=LITERAL),
    "one-sided": lambda seed: _fstek(tail="one-sided"),
    "interval of an observation": lambda seed: _fstek(interval="observation"),
    "alpha is the confidence": lambda seed: _fstek(alpha_is="confidence"),
    "retest kept features": lambda seed: _fstek(keep_for_good="never"),
    "5 sequences sampled": lambda seed: _fstek(max_seqs=5, random_state=seed),
    "IBKR, no interval": lambda seed: IBKR(),
    "IBKR, bootstrap": lambda seed: IBKR(0.15, interval="bootstrap", random_state=seed),
}
"""Selectors by reading, given a seed."""

PRINTED = (0.45, 1.0)
"""False and true positive rate printed for FS-TEK after five tasks."""


@dataclass(frozen=True)
class ReadingConfig:
    """Settings of the comparison of readings."""

    runs: int = 300
    """Sequences of tasks."""
    tasks_seen: tuple[int, ...] = (4, 5, 6, 8, 12)
    """Numbers of observed tasks."""


def run_readings(config: ReadingConfig, context: Context) -> pd.DataFrame:
    """Compare the readings; columns are documented in :data:`READINGS_COMPARED`."""
    solutions = exact_solutions(triangle())
    truth = ExactRelevance().fit(solutions).support_
    seeds = [int(s.generate_state(1)[0]) for s in context.seeds(config.runs, 6)]
    drawn = [
        np.random.default_rng(s).integers(solutions.n_tasks, size=max(config.tasks_seen))
        for s in seeds
    ]

    def one(job: tuple[str, int]) -> dict[str, float | str | int]:
        name, n = job
        support = [
            READINGS[name](seed).fit(solutions.take(tasks[:n])).support_
            for seed, tasks in zip(seeds, drawn, strict=True)
        ]
        fpr, tpr = rates(support, truth)
        return {"reading": name, "tasks_seen": n, "fpr": fpr, "tpr": tpr, "n_runs": config.runs}

    jobs = [(name, n) for name in READINGS for n in config.tasks_seen]
    return rows(context.map(one, jobs, "readings"))


READINGS_COMPARED: Experiment[ReadingConfig] = Experiment(
    id="figure-4.3-readings",
    item="Figure 4.3 (readings)",
    title="False and true positive rate on the triangle, by reading of FS-TEK and IBKR.",
    function=run_readings,
    budgets={
        "smoke": ReadingConfig(runs=2, tasks_seen=(5,)),
        "book": ReadingConfig(),
        "thesis": ReadingConfig(runs=500),
    },
    columns={
        "reading": "which option differs from the one used",
        "tasks_seen": "number of observed tasks n",
        "fpr": "false positive rate",
        "tpr": "true positive rate",
        "n_runs": "sequences of tasks",
    },
    seconds={"smoke": 1, "book": 35, "thesis": 60},
)
