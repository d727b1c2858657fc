"""Figures 3.1 and 3.2 and the huddle of section 3.4.2: the continuing cliff."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import numpy as np
import pandas as pd

from thesis_lib import potentials
from thesis_lib.arrays import FloatArray
from thesis_lib.domains import Domain, continuing_cliff
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.experiments.chapter3.common import (
    Learner,
    MuSearch,
    log_grid,
    named_potentials,
    total_rewards,
)
from thesis_lib.mdp import planning
from thesis_lib.mdp.greedy import epsilon_greedy
from thesis_lib.mdp.learning import Method, learn
from thesis_lib.stats import mean_ci


@dataclass(frozen=True)
class Figure31Config:
    """Settings of figure 3.1."""

    discounts: tuple[float, ...] = (0.9, 0.95, 0.99)
    """gamma, which the thesis does not print."""
    epsilon: float = 0.01
    """Exploration rate."""
    steps: int = 100_000
    """Learning steps a run."""
    repeats: int = 5
    """Runs a task; the thesis has 1, hence 8 runs a point."""
    alphas: tuple[float, ...] = log_grid(0.01, 1.0, 13)
    """Learning rates."""
    methods: tuple[Method, ...] = ("sarsa", "q_learning")
    """Learners."""
    names: tuple[str, ...] = ("none", "Q_star", "Q_tilde", "Q_tilde_sarsa", "Q_mu", "constant")
    """Potentials; Q_tilde_sarsa averages what Sarsa has learned."""
    sarsa_steps: int = 10_000_000
    """Steps of the Sarsa runs behind Q_tilde_sarsa, one run a task."""
    sarsa_alpha: float = 0.07
    """Their learning rate."""
    mu: MuSearch = field(default_factory=MuSearch)
    """The search for the cross-task policy."""


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


def run_figure_3_1(config: Figure31Config, context: Context) -> pd.DataFrame:
    """Return over learning rate, potential, learner and discount (:data:`FIGURE_3_1`)."""
    records = []
    for discount in config.discounts:
        domain = continuing_cliff(discount)
        exact = [n for n in config.names if n != "Q_tilde_sarsa"]
        phi = named_potentials(
            domain, exact, epsilon=config.epsilon, mu=config.mu, seed=context.seed
        )
        if "Q_tilde_sarsa" in config.names:
            learned = sarsa_solutions(
                domain,
                context,
                alpha=config.sarsa_alpha,
                epsilon=config.epsilon,
                steps=config.sarsa_steps,
            )
            phi["Q_tilde_sarsa"] = potentials.cross_task_values(domain, learned)
        keys = list(product(config.methods, config.names, config.alphas))
        cells = [
            (Learner(method, alpha, config.epsilon, steps=config.steps), phi[name])
            for method, name, alpha in keys
        ]
        totals = total_rewards(context, domain, cells, config.repeats, f"gamma {discount}")
        for (method, name, alpha), total in zip(keys, totals, strict=True):
            summary = mean_ci(total)
            records.append(
                {
                    "discount": discount,
                    "algorithm": method,
                    "potential": name,
                    "alpha": alpha,
                    "mean": summary.mean,
                    "ci95": summary.half_width,
                    "sd": float(total.std(ddof=1)),
                    "n_runs": summary.n,
                }
            )
    return rows(records)


@dataclass(frozen=True)
class SarsaSolutionConfig:
    """How wrong the Sarsa solutions behind figure 3.1 are."""

    discounts: tuple[float, ...] = (0.9, 0.95, 0.99)
    """gamma."""
    epsilon: float = 0.01
    """Exploration rate."""
    alpha: float = 0.07
    """Learning rate."""
    steps: int = 10_000_000
    """Steps a task."""


def run_sarsa_solution(config: SarsaSolutionConfig, context: Context) -> pd.DataFrame:
    """Sarsa's solution of every task against the exact soft values (:data:`SARSA_SOLUTION`)."""
    records = []
    for discount in config.discounts:
        domain = continuing_cliff(discount)
        learned = sarsa_solutions(
            domain, context, alpha=config.alpha, epsilon=config.epsilon, steps=config.steps
        )
        for m, (task, q) in enumerate(zip(domain.tasks, learned, strict=True)):
            best = planning.soft_policy_iteration(task, config.epsilon)
            own = epsilon_greedy(q, config.epsilon)
            inside = domain.observation_index[m] >= 0
            records.append(
                {
                    "discount": discount,
                    "task": domain.task_names[m],
                    "reward_per_step": planning.average_reward(task, own),
                    "best_reward_per_step": planning.average_reward(task, best.policy),
                    "largest_error": float(np.abs(q - best.q)[inside].max()),
                    "reaches_goal": reaches_goal(domain, m, q),
                }
            )
    return rows(records)


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


@dataclass(frozen=True)
class Figure32Config:
    """Settings of figure 3.2."""

    discount: float = 0.95
    """gamma, which the thesis does not print."""
    epsilon: float = 0.01
    """Exploration rate."""
    alpha: float = 0.07
    """Learning rate; the thesis does not print the one of this figure."""
    steps: int = 100_000
    """Steps a run."""
    n_runs: int = 100
    """Runs the mean is over, each on a task drawn from the domain."""
    points: int = 200
    """Points of a curve."""
    names: tuple[str, ...] = ("none", "Q_star", "Q_tilde", "Q_tilde_sarsa")
    """Potentials."""
    sarsa_steps: int = 10_000_000
    """Steps of the Sarsa runs behind Q_tilde_sarsa."""
    stasis: int = 10_000
    """A stretch of so many steps without reaching the goal counts as stasis."""


def figure_3_2_potentials(config: Figure32Config, context: Context) -> dict[str, FloatArray]:
    """The potentials of figure 3.2 by name."""
    domain = continuing_cliff(config.discount)
    names = [n for n in config.names if n != "Q_tilde_sarsa"]
    phi = named_potentials(domain, names, epsilon=config.epsilon, mu=MuSearch(), seed=context.seed)
    if "Q_tilde_sarsa" in config.names:
        learned = sarsa_solutions(
            domain, context, alpha=0.07, epsilon=config.epsilon, steps=config.sarsa_steps
        )
        phi["Q_tilde_sarsa"] = potentials.cross_task_values(domain, learned)
    return phi


def run_figure_3_2(config: Figure32Config, context: Context) -> pd.DataFrame:
    """Mean cumulative reward over learning, and stasis (:data:`FIGURE_3_2`)."""
    domain = continuing_cliff(config.discount)
    phi = figure_3_2_potentials(config, context)
    every = config.steps // config.points
    records = []
    for name, potential in phi.items():
        initial = domain.scatter_all(potential)

        def one(
            seed: np.random.SeedSequence, initial: list[FloatArray] = initial
        ) -> tuple[FloatArray, float]:
            rng = np.random.default_rng(seed)
            m = int(domain.sample(1, rng)[0])
            learned = learn(
                domain.tasks[m],
                "sarsa",
                alpha=config.alpha,
                epsilon=config.epsilon,
                steps=config.steps,
                initial_q=initial[m],
                rng=rng,
                checkpoint_every=every,
                record={"rewards"},
            )
            assert learned.rewards is not None
            return learned.checkpoint_rewards, stasis_share(learned.rewards, config.stasis)

        results = context.map(one, context.seeds(config.n_runs, 32), name)
        curves = np.array([curve for curve, _ in results])
        stasis = mean_ci([share for _, share in results])
        for point in range(config.points):
            summary = mean_ci(curves[:, point])
            records.append(
                {
                    "potential": name,
                    "step": (point + 1) * every,
                    "mean": summary.mean,
                    "ci95": summary.half_width,
                    "sd": float(curves[:, point].std(ddof=1)),
                    "stasis_share": stasis.mean,
                    "stasis_ci95": stasis.half_width,
                    "n_runs": config.n_runs,
                }
            )
    return rows(records)


def stasis_share(rewards: FloatArray, length: int) -> float:
    """Share of a run spent in stretches of at least ``length`` steps without a goal."""
    goals = np.flatnonzero(rewards > 0)
    gaps = np.diff(np.concatenate([[-1], goals, [len(rewards)]])) - 1
    return float(gaps[gaps >= length].sum() / len(rewards))


def run_figure_3_2_runs(config: Figure32Config, context: Context) -> pd.DataFrame:
    """Single runs: cumulative reward and TD error (:data:`FIGURE_3_2_RUNS`).

    The same task and seed for every potential: the domain's first task.
    """
    domain = continuing_cliff(config.discount)
    every = config.steps // config.points
    records = []
    for name, potential in figure_3_2_potentials(config, context).items():
        learned = learn(
            domain.tasks[0],
            "sarsa",
            alpha=config.alpha,
            epsilon=config.epsilon,
            steps=config.steps,
            initial_q=domain.scatter(potential, 0),
            rng=np.random.default_rng(context.seeds(1, 33)[0]),
            record={"rewards", "td_errors"},
        )
        assert learned.rewards is not None
        assert learned.td_errors is not None
        cumulative = np.cumsum(learned.rewards)
        size = np.abs(learned.td_errors[: every * config.points]).reshape(config.points, every)
        records += [
            {
                "potential": name,
                "step": (i + 1) * every,
                "cumulative_reward": cumulative[(i + 1) * every - 1],
                "td_error": size[i].mean(),
                "largest_td_error": size[i].max(),
            }
            for i in range(config.points)
        ]
    return rows(records)


@dataclass(frozen=True)
class HuddleConfig:
    """Over which exploration rates and discounts the optimal soft policy is solved."""

    discounts: tuple[float, ...] = (0.8, 0.9, 0.95, 0.99, 0.995)
    """gamma."""
    low: float = 0.001
    """Lowest exploration rate tried."""
    high: float = 0.2
    """Highest one."""
    tolerance: float = 1e-4
    """Precision of the threshold."""


def run_huddle(config: HuddleConfig, context: Context) -> pd.DataFrame:
    """Exploration rate from which the best soft policy gives up the goal (:data:`HUDDLE`).

    Bisection on the exact solution of every task; above the threshold the greedy actions
    of the optimal soft policy never lead to the goal.
    """

    def threshold(job: tuple[float, int]) -> dict[str, float | str]:
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
        return {
            "discount": discount,
            "task": domain.task_names[m],
            "threshold": (low + high) / 2,
            "reward_below": planning.average_reward(task, below.policy),
            "reward_above": planning.average_reward(task, above.policy),
        }

    jobs = list(product(config.discounts, range(8)))
    return rows(context.map(threshold, jobs, "huddle"))


FIGURE_3_1: Experiment[Figure31Config] = Experiment(
    id="figure-3.1",
    item="Figure 3.1",
    title="Return on the continuing cliff over the learning rate, by potential and learner.",
    function=run_figure_3_1,
    budgets={
        "smoke": Figure31Config(
            discounts=(0.95,),
            steps=500,
            repeats=1,
            alphas=(0.05, 0.5),
            sarsa_steps=2000,
            mu=MuSearch(restarts=1),
        ),
        "book": Figure31Config(),
        "thesis": Figure31Config(),
    },
    columns={
        "discount": "gamma",
        "algorithm": "sarsa or q_learning",
        "potential": "none, Q_star, Q_tilde (exact), Q_tilde_sarsa (learned), Q_mu, constant",
        "alpha": "learning rate",
        "mean": "mean cumulative reward of a run",
        "ci95": "half-width of its 95% t interval over runs",
        "sd": "standard deviation over runs",
        "n_runs": "number of runs, all tasks together",
    },
    seconds={"smoke": 2, "book": 90, "thesis": 90},
)

SARSA_SOLUTION: Experiment[SarsaSolutionConfig] = Experiment(
    id="section-3.4.2-sarsa",
    item="Section 3.4.2, Sarsa's solution",
    title="Where Sarsa ends up on the continuing cliff, against the exact soft optimum.",
    function=run_sarsa_solution,
    budgets={
        "smoke": SarsaSolutionConfig(discounts=(0.95,), steps=2000),
        "book": SarsaSolutionConfig(),
        "thesis": SarsaSolutionConfig(),
    },
    columns={
        "discount": "gamma",
        "task": "start and goal",
        "reward_per_step": "long-run reward per step of the policy learned, exact",
        "best_reward_per_step": "that of the best soft policy, exact",
        "largest_error": "largest |Q - exact soft value| over the task's pairs",
        "reaches_goal": "whether the greedy policy learned reaches the goal from the start",
    },
    seconds={"smoke": 1, "book": 10, "thesis": 10},
)

FIGURE_3_2: Experiment[Figure32Config] = Experiment(
    id="figure-3.2",
    item="Figure 3.2",
    title="Cumulative reward of Sarsa on the continuing cliff while it learns, mean of runs.",
    function=run_figure_3_2,
    budgets={
        "smoke": Figure32Config(n_runs=3, steps=1000, points=10, sarsa_steps=2000, stasis=100),
        "book": Figure32Config(),
        "thesis": Figure32Config(),
    },
    columns={
        "potential": "none, Q_star, Q_tilde (exact), Q_tilde_sarsa (learned)",
        "step": "learning steps taken",
        "mean": "mean cumulative reward up to the step",
        "ci95": "half-width of its 95% t interval over runs",
        "sd": "standard deviation over runs",
        "stasis_share": "share of the whole run in stretches without a goal, mean over runs",
        "stasis_ci95": "half-width of its 95% t interval",
        "n_runs": "number of runs",
    },
    seconds={"smoke": 1, "book": 10, "thesis": 10},
)

FIGURE_3_2_RUNS: Experiment[Figure32Config] = Experiment(
    id="figure-3.2-runs",
    item="Figure 3.2, single runs",
    title="Cumulative reward and TD error of single runs of Sarsa on the continuing cliff.",
    function=run_figure_3_2_runs,
    budgets={
        "smoke": Figure32Config(n_runs=3, steps=1000, points=10, sarsa_steps=2000, stasis=100),
        "book": Figure32Config(),
        "thesis": Figure32Config(),
    },
    columns={
        "potential": "as in figure-3.2",
        "step": "learning steps taken",
        "cumulative_reward": "up to the step",
        "td_error": "mean |TD error| since the point before",
        "largest_td_error": "largest |TD error| since the point before",
    },
    seconds={"smoke": 1, "book": 5, "thesis": 5},
)

HUDDLE: Experiment[HuddleConfig] = Experiment(
    id="section-3.4.2-huddle",
    item="Section 3.4.2, the huddle",
    title="Exploration rate from which the optimal soft policy stays in a corner, exact.",
    function=run_huddle,
    budgets={
        "smoke": HuddleConfig(discounts=(0.95,), tolerance=0.02),
        "book": HuddleConfig(),
        "thesis": HuddleConfig(),
    },
    columns={
        "discount": "gamma",
        "task": "start and goal",
        "threshold": "exploration rate above which the greedy path never reaches the goal",
        "reward_below": "long-run reward per step of the optimal soft policy just below",
        "reward_above": "the same just above",
    },
    seconds={"smoke": 1, "book": 5, "thesis": 5},
)
