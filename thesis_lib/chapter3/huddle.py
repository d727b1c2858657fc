"""Section 3.4.2: how the best soft policy shies from the cliff, and from where it huddles."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.arrays import FloatArray
from thesis_lib.domains import Domain, continuing_cliff
from thesis_lib.edition.criteria import EXACT, exact, within
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, criterion
from thesis_lib.edition.plots import PRINTED
from thesis_lib.edition.words import number, several
from thesis_lib.mdp import planning
from thesis_lib.mdp.model import MDP


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
    """Whether the greedy policy ever reaches the goal from the start."""
    return path_length(domain.tasks[task], q) >= 0


@dataclass(frozen=True)
class Rates:
    """At which exploration rates greedy paths are measured."""

    discounts: tuple[float, ...] = (0.8, 0.9, 0.95, 0.99, 0.995)
    """gamma."""
    step: float = 0.001
    """Distance of exploration rates, from the first of them on."""
    most: float = 0.05
    """Highest one."""


@dataclass(frozen=True)
class Path:
    """The greedy path of one task's best soft policy."""

    discount: float
    """gamma."""
    task: str
    """Start and goal."""
    epsilon: float
    """Exploration rate."""
    steps: int
    """From start to goal; -1 where the goal is never reached."""


@experiment(
    "ch3-detours",
    item="Section 3.4.2, detours",
    smoke=Rates(discounts=(0.95,), step=0.01),
    book=Rates(),
    seconds=4,
)
def detours(config: Rates, context: Context) -> list[Path]:
    """Length of the greedy path of the optimal soft policy over the exploration rate, exact."""
    rates = np.arange(1, round(config.most / config.step) + 1) * config.step

    def along(job: tuple[float, int]) -> list[Path]:
        discount, m = job
        domain = continuing_cliff(discount)
        return [
            Path(discount, domain.task_names[m], float(epsilon), path_length(domain.tasks[m], q))
            for epsilon in rates
            for q in [planning.soft_policy_iteration(domain.tasks[m], float(epsilon)).q]
        ]

    jobs = list(product(config.discounts, range(8)))
    return [row for rows in context.map(along, jobs, "detours") for row in rows]


def path_length(mdp: MDP, q: FloatArray) -> int:
    """Steps of the greedy path from the start to the goal, -1 if it never gets there.

    Steps are deterministic, so the path either earns the goal's reward or comes back to a state
    it has been in.
    """
    state, path = int(np.argmax(mdp.start)), list[int]()
    while state not in path:
        path.append(state)
        action = int(np.argmax(q[state]))
        if mdp.reward[state, action] == mdp.reward.max():
            return len(path)
        state = int(mdp.outcomes().successor[state, action, 0])
    return -1


@criterion("3.4.2-detours", detours)
def ever_larger_detours(table: pd.DataFrame) -> Finding:
    """How the greedy path to the goal lengthens with the exploration rate, until there is none."""
    reached = table[table.steps >= 0].sort_values("epsilon")
    by = reached.groupby(["discount", "task"]).steps
    changes = by.apply(lambda steps: np.diff(steps.to_numpy()))
    rises = [int((change > 0).sum()) for change in changes]
    falls = sum(bool((change < 0).any()) for change in changes)
    lengths = several(f"{steps}" for steps in sorted(reached.steps.unique()))
    return exact(
        min(rises) >= 2 and not falls,
        f"Greedy paths to the goal have {lengths} steps; over the exploration rates at which there "
        f"is one they lengthen at least {min(rises)} times in each of {len(rises)} tasks and "
        f"gammas, and shorten in {falls or 'none'}.",
    )


@criterion("3.4.2-huddle", thresholds)
def huddle_threshold(table: pd.DataFrame) -> Finding:
    """Exploration rate at which the optimal soft policy gives up the goal, over gamma."""
    by = table.groupby("discount").threshold
    values = {f"gamma {gamma:g}": float(t) for gamma, t in by.mean().items()}
    spread = float((by.max() - by.min()).max())
    apart = "the same in all tasks"
    if spread > EXACT:
        apart = f"mean over tasks that differ by at most {number(spread, spread)}"
    return within(values, 0.035, 0.065, f"Exact thresholds, {apart}")


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
