"""What section 4.3 says of each domain's features: exact task and domain relevance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import get_args

import numpy as np
import pandas as pd

from thesis_lib.domains import Domain, continuing_cliff, episodic_cliff, stock, triangle
from thesis_lib.domains.stock import RewardTiming
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.experiments.chapter4.curves import exact_solutions
from thesis_lib.relevance import domain_relevance, k_relevance, remove


@dataclass(frozen=True)
class DomainConfig:
    """Settings of the comparison."""

    global_factors: tuple[int, ...] = (1, 2, 3, 4, 5)
    """G of the stock domains."""


def run_relevances(config: DomainConfig, context: Context) -> pd.DataFrame:
    """Compute the relevances; columns are documented in :data:`RELEVANCES`."""
    makers: Mapping[tuple[str, str], Callable[[], Domain]] = {
        ("triangle", "as used"): triangle,
        ("triangle", "on a line"): partial(triangle, shape="line"),
        ("continuing cliff", "as used"): continuing_cliff,
        ("episodic cliff", "as used"): partial(episodic_cliff, True),
        **{(f"stock G={g}", "after_next"): partial(stock, 1, 2, g) for g in config.global_factors},
        **{
            ("stock G=2", timing): partial(stock, 1, 2, 2, reward_timing=timing)
            for timing in get_args(RewardTiming)
            if timing != "after_next"
        },
    }
    records = []
    for (name, reading), make in makers.items():
        domain = make()
        solutions = exact_solutions(domain)
        nothing = np.zeros(solutions.n_pairs, dtype=np.int64)
        total = domain_relevance(solutions, nothing)
        for feature in solutions.feature_names:
            labels = remove(solutions, [feature])
            limit = max(domain_relevance(solutions, labels), 0.0)
            records.append(
                {
                    "domain": name,
                    "reading": reading,
                    "n_tasks": len(domain),
                    "n_pairs": solutions.n_pairs,
                    "feature": feature,
                    "task_relevance": max(float(k_relevance(solutions, labels, 1)), 0.0),
                    "domain_relevance": limit,
                    "share": limit / total,
                }
            )
    return rows(records)


RELEVANCES: Experiment[DomainConfig] = Experiment(
    id="section-4.3-relevance",
    item="Section 4.3 (domains)",
    title="Exact task and domain relevance of every feature of the thesis's domains.",
    function=run_relevances,
    budgets={
        "smoke": DomainConfig(global_factors=(1, 2)),
        "book": DomainConfig(),
        "thesis": DomainConfig(),
    },
    columns={
        "domain": "name",
        "reading": "for stock, when the reward is paid; for the triangle, its shape",
        "n_tasks": "|M|",
        "n_pairs": "|X|",
        "feature": "removed alone from the full set",
        "task_relevance": "rho_1, squared reward",
        "domain_relevance": "rho_infinity, squared reward",
        "share": "domain relevance over that of removing every feature",
    },
    seconds={"smoke": 1, "book": 2, "thesis": 2},
)
