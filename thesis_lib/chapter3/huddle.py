"""Section 3.4.2: from which exploration rate the best soft policy huddles in a corner."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.arrays import FloatArray
from thesis_lib.domains import Domain, continuing_cliff
from thesis_lib.edition.criteria import within
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, criterion
from thesis_lib.edition.plots import PRINTED
from thesis_lib.mdp import planning


@dataclass(frozen=True)
class Config:
    """Over which exploration rates and discounts the optimal soft policy is solved."""

    discounts: tuple[float, ...] = (0.8, 0.9, 0.95, 0.99, 0.995)
    """gamma."""
    low: float = 0.001
    """Lowest exploration rate tried."""
    high: float = 0.2
    """Highest one."""
    tolerance: float = 1e-4
    """Precision of the threshold."""


@dataclass(frozen=True)
class Threshold:
    """Where one task's best soft policy gives up the goal."""

    discount: float
    """gamma."""
    task: str
    """Start and goal."""
    threshold: float
    """Exploration rate above which the greedy path never reaches the goal."""
    reward_below: float
    """Long-run reward per step of the optimal soft policy just below."""
    reward_above: float
    """The same just above."""


@experiment(
    "ch3-huddle",
    item="Section 3.4.2, the huddle",
    smoke=Config(discounts=(0.95,), tolerance=0.02),
    book=Config(),
    seconds=0.6,
    was="section-3.4.2-huddle",
)
def thresholds(config: Config, context: Context) -> list[Threshold]:
    """Exploration rate from which the optimal soft policy stays in a corner, exact.

    Bisection on the exact solution of every task; above the threshold the greedy actions
    of the optimal soft policy never lead to the goal.
    """

    def threshold(job: tuple[float, int]) -> Threshold:
        discount, m = job
        domain = continuing_cliff(discount)
        task = domain.tasks[m]

        def reaches(epsilon: float) -> bool:
            return reaches_goal(domain, m, planning.soft_policy_iteration(task, epsilon).q)

        low, high = config.low, config.high
        if not reaches(low) or reaches(high):
            raise RuntimeError(f"no threshold between {low} and {high} at gamma {discount}.")
        while high - low > config.tolerance:
            middle = (low + high) / 2
            low, high = (middle, high) if reaches(middle) else (low, middle)
        below = planning.soft_policy_iteration(task, low)
        above = planning.soft_policy_iteration(task, high)
        return Threshold(
            discount=discount,
            task=domain.task_names[m],
            threshold=(low + high) / 2,
            reward_below=planning.average_reward(task, below.policy),
            reward_above=planning.average_reward(task, above.policy),
        )

    jobs = list(product(config.discounts, range(8)))
    return context.map(threshold, jobs, "huddle")


def reaches_goal(domain: Domain, task: int, q: FloatArray) -> bool:
    """Whether the greedy policy ever reaches the goal from the start.

    Steps are deterministic, so the greedy path either earns the goal's reward or comes
    back to a state it has been in.
    """
    mdp = domain.tasks[task]
    state, seen = int(np.argmax(mdp.start)), set()
    goal_reward = mdp.reward.max()
    while state not in seen:
        seen.add(state)
        action = int(np.argmax(q[state]))
        if mdp.reward[state, action] == goal_reward:
            return True
        state = int(mdp.outcomes().successor[state, action, 0])
    return False


@criterion("3.4.2-huddle", thresholds)
def huddle_threshold(table: pd.DataFrame) -> Finding:
    """Exploration rate at which the optimal soft policy gives up the goal, over gamma."""
    by = table.groupby("discount").threshold.mean()
    values = {f"gamma {gamma:g}": float(t) for gamma, t in by.items()}
    return within(values, 0.035, 0.065, "Exact thresholds, the same in all eight tasks")


def figure(table: pd.DataFrame) -> Figure:
    """Exact thresholds over the discount, and the printed one."""
    by = table.groupby("discount").threshold.max()
    fig, ax = plt.subplots(figsize=(7.2, 2.8))
    ax.plot(range(len(by)), by, "o", label="exact threshold")
    ax.set_xticks(range(len(by)), [f"{g:g}" for g in by.index])
    ax.axhline(0.05, color=PRINTED, ls=":", label="printed: around .05")
    ax.set(xlabel="discount", ylabel="exploration rate", ylim=(0, 0.06))
    ax.legend(loc="lower right")
    return fig
