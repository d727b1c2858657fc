"""Fact 1: stochastic against deterministic policies on the domain of figure A.1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from thesis_lib.domains.appendix_a import figure_a1, policy, state_values
from thesis_lib.edition.experiment import Context, Experiment, rows


@dataclass(frozen=True)
class Config:
    """Which policies and discounts are evaluated."""

    penalty: float = 1.0
    """R of figure A.1."""
    discounts: tuple[float, ...] = (0.5, 0.9, 0.99, 0.999)
    """gamma."""
    policies: int = 101
    """Number of evenly spaced p(B) from 0 to 1; odd, so that the fair coin is among them."""

    def __post_init__(self) -> None:
        if self.policies < 3 or self.policies % 2 == 0:
            raise ValueError(
                f"policies is {self.policies}, but it must be odd and at least 3, so that p(B) = "
                "0, 1/2 and 1 are among them."
            )


def run(config: Config, context: Context) -> pd.DataFrame:
    """Value of state 1 for every policy and discount; columns in :data:`FIGURE_A_1`."""
    records = []
    for gamma in config.discounts:
        domain = figure_a1(config.penalty, gamma)
        for p_b in np.linspace(0, 1, config.policies):
            found = state_values(domain, policy(domain, p_b))
            records.append(
                {
                    "discount": gamma,
                    "penalty": config.penalty,
                    "p_b": p_b,
                    "task_1": found.task[0, 0],
                    "task_2": found.task[1, 0],
                    "value": found.domain[0],
                }
            )
    return rows(records)


FIGURE_A_1: Experiment[Config] = Experiment(
    id="figure-a.1",
    item="Figure A.1",
    title="Value of state 1 over p(B), deterministic and stochastic policies, exact.",
    function=run,
    budgets={
        "smoke": Config(policies=11),
        "book": Config(discounts=(0.1, 0.5, 0.8, 0.9, 0.95, 0.99, 0.999)),
        "thesis": Config(discounts=(0.1, 0.5, 0.8, 0.9, 0.95, 0.99, 0.999)),
    },
    columns={
        "discount": "gamma",
        "penalty": "R [reward]",
        "p_b": "probability of B in state 1",
        "task_1": "value of state 1 in task 1 [reward]",
        "task_2": "value of state 1 in task 2 [reward]",
        "value": "domain value of state 1, both tasks equally likely [reward]",
    },
    seconds={"smoke": 0.1, "book": 0.3, "thesis": 0.3},
)
