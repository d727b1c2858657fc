"""Section 3.4.2: where Sarsa ends up on the continuing cliff."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from thesis_lib.arrays import FloatArray
from thesis_lib.chapter3.huddle import reaches_goal
from thesis_lib.domains import Domain, continuing_cliff
from thesis_lib.edition.criteria import graded
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.words import number
from thesis_lib.mdp import planning
from thesis_lib.mdp.greedy import epsilon_greedy
from thesis_lib.mdp.learning import learn


@dataclass(frozen=True)
class Config:
    """How wrong the Sarsa solutions behind figure 3.1 are."""

    discounts: tuple[float, ...] = (0.9, 0.95, 0.99)
    """gamma."""
    epsilon: float = 0.01
    """Exploration rate."""
    alpha: float = 0.07
    """Learning rate."""
    steps: int = 10_000_000
    """Steps a task."""


def sarsa_solutions(
    domain: Domain, context: Context, *, alpha: float, epsilon: float, steps: int
) -> list[FloatArray]:
    """What Sarsa has learned of every task after so many steps, each ``(S_m, A)``."""

    def solve(job: tuple[int, np.random.SeedSequence]) -> FloatArray:
        m, seed = job
        learned = learn(
            domain.tasks[m],
            "sarsa",
            alpha=alpha,
            epsilon=epsilon,
            steps=steps,
            rng=np.random.default_rng(seed),
        )
        return learned.q

    jobs = list(enumerate(context.seeds(len(domain), 31)))
    return context.map(solve, jobs, "Sarsa solutions")


@dataclass(frozen=True)
class Solution:
    """What Sarsa has learned of one task."""

    discount: float
    """gamma."""
    task: str
    """Start and goal."""
    reward_per_step: float
    """Long-run reward per step of the policy learned, exact."""
    best_reward_per_step: float
    """That of the best soft policy, exact."""
    largest_error: float
    """Largest |Q - exact soft value| over the task's pairs."""
    reaches_goal: bool
    """Whether the greedy policy learned reaches the goal from the start."""
    reached_before: bool
    """Whether it did after half of the steps."""
    before_per_step: float
    """Long-run reward per step of the policy learned by then, exact."""
    moved: float
    """Mean |Q - Q by then| over the task's pairs, as a share of the mean |Q - exact soft value|."""


@experiment(
    "ch3-sarsa-solution",
    item="Section 3.4.2, Sarsa's solution",
    smoke=Config(discounts=(0.95,), steps=2000),
    book=Config(),
    seconds=6,
)
def learned(config: Config, context: Context) -> list[Solution]:
    """Where Sarsa ends up on the continuing cliff, against the exact soft optimum."""
    records = []
    for discount in config.discounts:
        domain = continuing_cliff(discount)
        tables = sarsa_solutions(
            domain, context, alpha=config.alpha, epsilon=config.epsilon, steps=config.steps
        )
        # The same runs, stopped half-way: whether their values have settled.
        half = sarsa_solutions(
            domain, context, alpha=config.alpha, epsilon=config.epsilon, steps=config.steps // 2
        )
        for m, (task, q, before) in enumerate(zip(domain.tasks, tables, half, strict=True)):
            best = planning.soft_policy_iteration(task, config.epsilon)
            own = epsilon_greedy(q, config.epsilon)
            inside = domain.observation_index[m] >= 0
            records.append(
                Solution(
                    discount=discount,
                    task=domain.task_names[m],
                    reward_per_step=planning.average_reward(task, own),
                    best_reward_per_step=planning.average_reward(task, best.policy),
                    largest_error=float(np.abs(q - best.q)[inside].max()),
                    reaches_goal=reaches_goal(domain, m, q),
                    reached_before=reaches_goal(domain, m, before),
                    before_per_step=planning.average_reward(
                        task, epsilon_greedy(before, config.epsilon)
                    ),
                    moved=float(
                        np.abs(q - before)[inside].mean() / np.abs(q - best.q)[inside].mean()
                    ),
                )
            )
    return records


SETTLED = 0.05
"""Values that move by less than this share of their error over the second half have settled."""


@criterion("3.4.2-sarsa-is-wrong", learned)
def sarsa_is_wrong(table: pd.DataFrame) -> Finding:
    """Whether Sarsa's values settle far from a soft optimum that earns."""
    stuck = int((~table.reaches_goal & ~table.reached_before).sum())
    worth, own = table.best_reward_per_step > 0, table.reward_per_step.mean()
    settled = table.moved < SETTLED
    sure = bool(worth.all() and settled.all())
    return Finding(
        graded(
            stuck == len(table) and sure,
            direction=stuck and sure,
            otherwise=Verdict.NOT_REPRODUCED if sure or not stuck else Verdict.INCONCLUSIVE,
        ),
        f"In {stuck} of {len(table)} solutions the greedy path reaches the goal neither half-way "
        f"nor at the end; in {int(settled.sum())} the values move in the second half by less than "
        f"{SETTLED:.0%} of their distance from the soft optimum, in none by more than "
        f"{table.moved.max():.1%}. "
        f"The policies earn {number(own)} a step, the best soft policies "
        f"{number(table.best_reward_per_step.mean())}, above 0 in {int(worth.sum())}.",
        {"stuck": stuck, "reward_per_step": float(own), "moved": float(table.moved.max())},
    )
