"""Fact 2, cases 1 to 3: no policy maximises all states at once on the domains of figure A.2."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import pandas as pd

from thesis_lib.arrays import FloatArray
from thesis_lib.domains.appendix_a import SecondTask, Weighting, figure_a2, policy, state_values
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.mdp.model import TabularMDP


@dataclass(frozen=True)
class Config:
    """Which domains, weightings and policies are evaluated."""

    second: tuple[SecondTask, ...] = ("a", "b", "c")
    """Variations of task 2."""
    weightings: tuple[Weighting, ...] = ("uniform", "occupancy")
    """p(s|m)."""
    discounts: tuple[float, ...] = (0.5, 0.9, 0.99)
    """gamma."""
    policies: int = 21
    """Number of evenly spaced p(B) from 0 to 1."""


def communicating(transition: FloatArray) -> bool:
    """Whether every state can be reached from every other, given a chain ``(S, S)``."""
    reached = np.eye(len(transition)) + (transition > 0)
    return bool((np.linalg.matrix_power(reached, len(transition)) > 0).all())


def _chains(task: TabularMDP) -> list[FloatArray]:
    """The chains of the two deterministic choices in state 1."""
    return [task.transition[:, a] for a in range(2)]


def run(config: Config, context: Context) -> pd.DataFrame:
    """Values of all states for every domain and policy; columns in :data:`FIGURE_A_2`."""
    records = []
    for second, weighting, gamma in product(config.second, config.weightings, config.discounts):
        domain = figure_a2(second, discount=gamma)
        ergodic = [
            isinstance(t, TabularMDP) and all(map(communicating, _chains(t))) for t in domain.tasks
        ]
        for p_b in np.linspace(0, 1, config.policies):
            found = state_values(domain, policy(domain, p_b), weighting)
            for s in range(domain.n_observations):
                records.append(
                    {
                        "second": second,
                        "weighting": weighting,
                        "discount": gamma,
                        "p_b": p_b,
                        "state": s + 1,
                        "task_1": found.task[0, s],
                        "task_2": found.task[1, s],
                        "weight_1": found.weight[0, s],
                        "weight_2": found.weight[1, s],
                        "value": found.domain[s],
                        "same_states": bool(domain.present.all()),
                        "ergodic_1": ergodic[0],
                        "ergodic_2": ergodic[1],
                    }
                )
    return rows(records)


FIGURE_A_2: Experiment[Config] = Experiment(
    id="figure-a.2",
    item="Figure A.2",
    title="Values of all states over p(B) on the three domains of cases 1 to 3, exact.",
    function=run,
    budgets={
        "smoke": Config(discounts=(0.9,), policies=5),
        "book": Config(),
        "thesis": Config(),
    },
    columns={
        "second": "variation of task 2: a (no state 3), b (state 3 cut off) or c (ergodic)",
        "weighting": "p(s|m): uniform over the states of a task, or the policy's occupancy",
        "discount": "gamma",
        "p_b": "probability of B in state 1",
        "state": "1, 2 or 3",
        "task_1": "value in task 1 [reward]",
        "task_2": "value in task 2 [reward], empty where the task lacks the state",
        "weight_1": "d(m1|s)",
        "weight_2": "d(m2|s)",
        "value": "domain value of the state [reward]",
        "same_states": "whether both tasks have the same states",
        "ergodic_1": "whether task 1 is ergodic: all its states communicate under every policy",
        "ergodic_2": "the same of task 2",
    },
    seconds={"smoke": 0.1, "book": 0.2, "thesis": 0.2},
)
