"""The Q^mu row of Table 3.1: which reading could explain its size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
import pandas as pd

from thesis_lib import potentials
from thesis_lib.arrays import FloatArray
from thesis_lib.chapter3 import table_3_1
from thesis_lib.chapter3.runs import LEARNERS, MuSearch
from thesis_lib.chapter3.table_3_1 import UNIT, printed
from thesis_lib.domains import Domain
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import effect_of
from thesis_lib.edition.words import plus_minus, several
from thesis_lib.mdp.learning import Method, learn
from thesis_lib.mdp.model import TabularMDP
from thesis_lib.potentials.cross_task_policy import GeneticAlgorithm
from thesis_lib.stats import mean_ci


@dataclass(frozen=True)
class Reading:
    """One way to read how Q^mu was made and used.

    Attributes
    ----------
    search
        How mu is found and its values averaged; None for the uniform policy.
    kind
        Which potential: Q_mu, or Q_star to see what the reading does to its entry.
    goal_keeps_potential
        Whether the goal cell keeps the potential it has in tasks where it is no goal, so
        that entering it is worth that much instead of 0.
    """

    search: MuSearch | None = None
    kind: str = "Q_mu"
    goal_keeps_potential: bool = False


GA = MuSearch("ga")
READINGS: Mapping[str, Reading] = {
    "GA": Reading(GA),
    "GA, uniform p(x|m)": Reading(replace(GA, weights="uniform")),
    "GA, start-state objective": Reading(replace(GA, objective="start")),
    "GA, 10 generations": Reading(replace(GA, ga=GeneticAlgorithm(generations=10))),
    "GA, 100 generations": Reading(replace(GA, ga=GeneticAlgorithm(generations=100))),
    "GA, tournaments": Reading(replace(GA, ga=GeneticAlgorithm(selection="tournament"))),
    "exact gradients": Reading(MuSearch("gradient")),
    "uniform policy": Reading(),
    "GA, goal keeps its potential": Reading(GA, goal_keeps_potential=True),
    "Q*, goal keeps its potential": Reading(kind="Q_star", goal_keeps_potential=True),
}
"""Readings tried, one point varied at a time."""


@dataclass(frozen=True)
class Config:
    """How often each reading is run."""

    n_runs: int = 100
    """Runs an entry."""
    readings: tuple[str, ...] = tuple(READINGS)
    """Which readings."""
    table: table_3_1.Config = field(default_factory=table_3_1.Config)
    """Everything else, as in Table 3.1."""
    most_steps: int = 200_000
    """An episode is cut off here: a learner that shuns the goal may never end it."""


def reading_potential(reading: Reading, domain: Domain, seed: int) -> FloatArray:
    """The potential of a reading, shape ``(O, A)``."""
    if reading.kind == "Q_star":
        return potentials.q_star(domain)
    if reading.search is None:
        uniform = np.full(domain.shape, 1 / domain.shape[1])
        return potentials.q_mu(domain, uniform)
    return reading.search.potential(domain, seed)


def worth_of_goal(domain: Domain, m: int, phi: FloatArray) -> float:
    """Potential, of the best action, at the cell that is the goal of task m."""
    task = domain.tasks[m]
    goal = int(np.argmax(task.terminal))
    cell = [task.features[name][goal] for name in domain.feature_names]
    at = np.flatnonzero((domain.observations == cell).all(axis=1))
    return float(phi[at[0]].max())


def with_goal_worth(task: TabularMDP, worth: float) -> TabularMDP:
    """The task with ``worth`` added to the reward of every step into the goal."""
    goal = int(np.argmax(task.terminal))
    reward = task.reward + worth * task.transition[:, :, goal]
    reward[goal] = 0.0
    return replace(task, reward=reward)


@dataclass(frozen=True)
class Return:
    """Total reward of a learner under one reading; rewards in units of 10^4."""

    reading: str
    """What is varied."""
    algorithm: str
    """q_learning or sarsa."""
    mean_return: float
    """Mean total reward of a run, in 10^4."""
    ci95: float
    """Half-width of its 95% t interval, in 10^4."""
    median: float
    """Median total reward, in 10^4."""
    lowest_potential: float
    """Least value of the potential."""
    highest_potential: float
    """Largest value of the potential."""
    n_runs: int
    """Number of runs."""
    printed_mean: float
    """What the thesis prints for the potential, in 10^4."""
    printed_ci95: float
    """The half-width it prints, in 10^4."""


@experiment(
    "ch3-q-mu-row",
    item="Table 3.1, its Q^mu row",
    smoke=Config(
        n_runs=2,
        readings=("uniform policy", "Q*, goal keeps its potential"),
        table=table_3_1.Config(episodes=5),
        most_steps=200,
    ),
    book=Config(),
    seconds=6,
)
def returns(config: Config, context: Context) -> list[Return]:
    """Total reward with Q^mu on the episodic cliff under several readings."""
    domain = config.table.domain(sensor=False)
    target = printed().set_index(["potential", "algorithm", "sensor"])
    records = []
    for i, name in enumerate(config.readings):
        reading = READINGS[name]
        phi = reading_potential(reading, domain, context.seed)
        worths = [
            worth_of_goal(domain, m, phi) if reading.goal_keeps_potential else 0.0
            for m in range(len(domain))
        ]
        tasks = [
            with_goal_worth(task, worth)  # type: ignore[arg-type]
            for task, worth in zip(domain.tasks, worths, strict=True)
        ]
        initial = domain.scatter_all(phi)

        def one(
            job: tuple[Method, np.random.SeedSequence],
            tasks: list[TabularMDP] = tasks,
            worths: list[float] = worths,
            initial: list[FloatArray] = initial,
        ) -> float:
            method, seed = job
            rng = np.random.default_rng(seed)
            m = int(domain.sample(1, rng)[0])
            learned = learn(
                tasks[m],
                method,
                alpha=config.table.alpha(method),
                epsilon=config.table.epsilon,
                episodes=config.table.episodes,
                max_episode_steps=config.most_steps,
                initial_q=initial[m],
                rng=rng,
            )
            ended = int((~learned.truncated).sum())
            return learned.total_reward - ended * worths[m]

        methods: tuple[Method, ...] = ("q_learning", "sarsa")
        for j, method in enumerate(methods):
            seeds = context.seeds(config.n_runs, 3, 12, i, j)
            totals = np.array(context.map(one, list(product((method,), seeds)), name)) / UNIT
            summary = mean_ci(totals)
            entry = target.loc[(reading.kind, method, False)]
            records.append(
                Return(
                    reading=name,
                    algorithm=method,
                    mean_return=summary.mean,
                    ci95=summary.half_width,
                    median=float(np.median(totals)),
                    lowest_potential=float(phi.min()),
                    highest_potential=float(phi.max()),
                    n_runs=summary.n,
                    printed_mean=float(entry.printed_mean),
                    printed_ci95=float(entry.printed_ci95),
                )
            )
    return records


@effect_of("3.4.1-q-mu-row", returns)
def q_mu_readings(table: pd.DataFrame) -> str:
    """How far each reading's Q^mu row is from the printed one."""
    table = table[table.reading.str.startswith(("GA", "exact", "uniform"))]
    told = []
    for algorithm, own in table.groupby("algorithm"):
        near = own.loc[(own.mean_return - own.printed_mean).abs().idxmin()]
        told.append(
            f"{LEARNERS[algorithm]}: from {own.mean_return.max():.1f} to "
            f"{own.mean_return.min():.1f}, nearest to the printed {near.printed_mean:g} under "
            f"“{near.reading}”"
        )
    return f"Mean total reward (10⁴) over {table.reading.nunique()} readings: {'; '.join(told)}."


@effect_of("3.4.1-terminal-potential", returns)
def goal_keeps_potential(table: pd.DataFrame) -> str:
    """What a non-zero potential at the goal does to Q^mu and to Q*."""
    own = table[table.reading.str.endswith("goal keeps its potential")]
    told = [
        f"{reading}: " + several(f"{LEARNERS[r.algorithm]} {r.mean_return:.2f}" for r in rows)
        for reading, group in own.groupby("reading", sort=False)
        for rows in [list(group.itertuples())]
    ]
    return f"Mean total reward in 10⁴: {'; '.join(told)}."


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Ours under each reading, and what the thesis prints in the last row."""
    cells = [plus_minus(m, c) for m, c in zip(table.mean_return, table.ci95, strict=True)]
    named = table.assign(learner=table.algorithm.map(LEARNERS), cell=cells)
    wide = named.pivot(index="reading", columns="learner", values="cell")
    wide = wide.reindex(list(dict.fromkeys(table.reading)))
    wide.loc["the thesis prints"] = [
        f"{own.printed_mean.iloc[0]:g} ± {own.printed_ci95.iloc[0]:g}"
        for _, own in named.groupby("learner")
    ]
    return wide.reset_index()
