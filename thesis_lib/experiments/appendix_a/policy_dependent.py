"""Fact 2, case 4: weights d(m|s) that depend on the policy, on the domain of figure A.3."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
import pandas as pd

from thesis_lib.arrays import FloatArray
from thesis_lib.domains.appendix_a import figure_a3, policy, state_values
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.potentials.cross_task_policy import CrossTaskProblem

STATES = 4


@dataclass(frozen=True)
class Config:
    """The numbers of the domain and the policies that are evaluated."""

    loss: float = 1.0
    """What B costs in task 1."""
    gain: float = 6.0
    """What B earns in task 2."""
    discount: float = 0.9
    """gamma."""
    detour: float = 0.05
    """Probability of going from 3 to 4 in task 1, and of leaving 4 in task 2."""
    policies: int = 501
    """Number of evenly spaced p(B) from 0 to 1."""


def run(config: Config, context: Context) -> pd.DataFrame:
    """Values and weights of all states for every policy; columns in :data:`FIGURE_A_3`."""
    domain = figure_a3(config.loss, config.gain, config.discount, config.detour)
    start, average = (CrossTaskProblem(domain, of) for of in ("start", "stationary"))
    records = []
    for p_b in np.linspace(0, 1, config.policies):
        mu = policy(domain, p_b)
        found = state_values(domain, mu, "occupancy")
        at_start = float(start.value(mu))
        per_step = (1 - config.discount) * float(average.value(mu))
        for s in range(STATES):
            records.append(
                {
                    "p_b": p_b,
                    "state": s + 1,
                    "task_1": found.task[0, s],
                    "task_2": found.task[1, s],
                    "weight_1": found.weight[0, s],
                    "weight_2": found.weight[1, s],
                    "value": found.domain[s],
                    "start_value": at_start,
                    "average_reward": per_step,
                }
            )
    return rows(records)


FIGURE_A_3: Experiment[Config] = Experiment(
    id="figure-a.3",
    item="Figure A.3",
    title="Values of all states over p(B) with weights that depend on the policy, exact.",
    function=run,
    budgets={"smoke": Config(policies=41), "book": Config(), "thesis": Config()},
    columns={
        "p_b": "probability of B in state 1",
        "state": "1, 2, 3 or 4",
        "task_1": "value in task 1 [reward]",
        "task_2": "value in task 2 [reward]",
        "weight_1": "d(m1|s, mu), from the stationary distribution",
        "weight_2": "d(m2|s, mu)",
        "value": "domain value of the state [reward]",
        "start_value": "one number a policy: expected value of the first state (3.9) [reward]",
        "average_reward": "one number a policy: reward a step, what (3.11) ranks by [reward]",
    },
    seconds={"smoke": 0.1, "book": 0.3, "thesis": 0.3},
)


@dataclass(frozen=True)
class NumbersConfig:
    """Which numbers are tried in place of those of the domain."""

    gains: tuple[float, ...] = tuple(np.arange(1.0, 12.01, 0.25))
    """What B earns in task 2, for each unit it costs in task 1."""
    detours: tuple[float, ...] = (0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.08, 0.1, 0.15, 0.2, 0.3)
    """Probability of going from 3 to 4 in task 1, and of leaving 4 in task 2."""
    discounts: tuple[float, ...] = (0.5, 0.8, 0.9, 0.95, 0.99)
    """gamma."""
    policies: int = 101
    """Number of evenly spaced p(B) from 0 to 1."""


def crossing(p_b: FloatArray, value: FloatArray) -> float:
    """Where a curve that ends above 0 last turns positive, by linear interpolation.

    Parameters
    ----------
    p_b, value
        The curve, shape ``(n,)`` each.

    Returns
    -------
    float
        NaN when it ends at or below 0, or is nowhere below.
    """
    below = np.flatnonzero(value < 0)
    if value[-1] <= 0 or not len(below):
        return float("nan")
    i = below[-1]
    return float(p_b[i] - value[i] * (p_b[i + 1] - p_b[i]) / (value[i + 1] - value[i]))


def statements(p_b: FloatArray, value: FloatArray) -> Mapping[str, bool]:
    """Which statements of the proof hold of curves of domain values.

    Parameters
    ----------
    p_b
        Probabilities of B, rising from 0 to 1, shape ``(P,)``.
    value
        Domain values, shape ``(P, 4)``.

    Returns
    -------
    Mapping of str to bool
        ``conflict``: no policy is best in all states.  ``first_step``: making B possible
        lowers states 1 to 3 and raises state 4.  ``state_4_rises`` and
        ``state_3_falls``: throughout.  ``state_2_turns``: V(s2) ends above 0 after having
        been below.
    """
    step = np.diff(value, axis=0)
    highest = value.max(axis=0)
    best = np.isclose(value, highest, rtol=0, atol=1e-12 * max(1.0, np.abs(value).max()))
    return {
        "conflict": not best.all(axis=1).any(),
        "first_step": bool((step[0, :3] < 0).all() and step[0, 3] > 0),
        "state_4_rises": bool((step[:, 3] > 0).all()),
        "state_3_falls": bool((step[:, 2] < 0).all()),
        "state_2_turns": bool(not np.isnan(crossing(p_b, value[:, 1]))),
    }


def run_numbers(config: NumbersConfig, context: Context) -> pd.DataFrame:
    """Which statements hold with other numbers; columns in :data:`FIGURE_A_3_NUMBERS`."""
    p_b = np.linspace(0, 1, config.policies)
    records = []
    for gamma, detour in product(config.discounts, config.detours):
        # Task 2's values are proportional to the gain, so that one evaluation serves them all.
        domain = figure_a3(1.0, 1.0, gamma, detour)
        found = [state_values(domain, policy(domain, p), "occupancy") for p in p_b]
        loss, gain = (np.array([f.weight[m] * f.task[m] for f in found]) for m in range(2))
        for g in config.gains:
            value = loss + g * gain
            records.append(
                {
                    "discount": gamma,
                    "detour": detour,
                    "gain": g,
                    **statements(p_b, value),
                    "crossing": crossing(p_b, value[:, 1]),
                }
            )
    return rows(records)


FIGURE_A_3_NUMBERS: Experiment[NumbersConfig] = Experiment(
    id="figure-a.3-numbers",
    item="Figure A.3, other numbers",
    title="Which statements about figure A.3 hold for other rewards, probabilities and discounts.",
    function=run_numbers,
    budgets={
        "smoke": NumbersConfig(
            gains=(3.0, 6.0, 9.0), detours=(0.02, 0.05, 0.2), discounts=(0.9,), policies=21
        ),
        "book": NumbersConfig(),
        "thesis": NumbersConfig(),
    },
    columns={
        "discount": "gamma",
        "detour": "probability of going from 3 to 4 in task 1, and of leaving 4 in task 2",
        "gain": "what B earns in task 2 for each unit it costs in task 1",
        "conflict": "whether no policy is best in all states",
        "first_step": "whether making B possible lowers states 1 to 3 and raises state 4",
        "state_4_rises": "whether V(s4) rises throughout",
        "state_3_falls": "whether V(s3) falls throughout",
        "state_2_turns": "whether V(s2) ends above 0 after having been below",
        "crossing": "p(B) from which V(s2) is above 0; empty when it never is",
    },
    seconds={"smoke": 0.1, "book": 2, "thesis": 2},
)
