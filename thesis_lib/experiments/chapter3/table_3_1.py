"""Table 3.1: potentials on the episodic cliff (section 3.4.1)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
import pandas as pd
from scipy import stats

from thesis_lib import published
from thesis_lib.arrays import FloatArray
from thesis_lib.domains import Domain, episodic_cliff
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.experiments.chapter3.common import MuSearch, Potential, named_potentials
from thesis_lib.mdp.greedy import Exploration
from thesis_lib.mdp.learning import Method, learn
from thesis_lib.potentials.cross_task_policy import GeneticAlgorithm
from thesis_lib.stats import mean_ci

UNIT = 1e4
"""The thesis prints its numbers in units of 10^4."""


@dataclass(frozen=True)
class Cell:
    """One entry of the table."""

    potential: Potential
    algorithm: Method
    sensor: bool


@dataclass(frozen=True)
class Config:
    """Settings of Table 3.1; the defaults are the reading that fits its numbers."""

    n_runs: int = 100
    """Runs an entry, each on a task drawn from the domain."""
    episodes: int = 600
    """Episodes a run.  The text says 500; 600 fits what the table prints."""
    epsilon: float = 0.1
    """Exploration rate."""
    alpha_q_learning: float = 1.0
    """Learning rate of Q-learning and of Double Q-learning."""
    alpha_sarsa: float = 0.4
    """Learning rate of Sarsa and Expected Sarsa."""
    exploration: Exploration = "all"
    """What a random action is drawn from: all actions, or the others than the greedy one."""
    fall_reward: float = -1000.0
    """Reward of a fall."""
    fall_costs_step: bool = False
    """Whether a fall costs the step's -1 as well."""
    potentials: tuple[Potential, ...] = ("Q_mu", "none", "Q_star", "Q_tilde", "constant")
    """Rows.  ``constant`` is our control: the mean of Q_star at every pair."""
    algorithms: tuple[Method, ...] = ("q_learning", "sarsa")
    """Columns."""
    sensors: tuple[bool, ...] = (False, True)
    """Parts (a) and (b)."""
    mu: MuSearch = field(default_factory=lambda: MuSearch("ga"))
    """The search for the cross-task policy: the genetic algorithm of footnote 2."""

    def alpha(self, algorithm: Method) -> float:
        """Learning rate of an algorithm."""
        on_policy = algorithm in ("sarsa", "expected_sarsa")
        return self.alpha_sarsa if on_policy else self.alpha_q_learning

    def domain(self, sensor: bool) -> Domain:
        """The domain of part (a) or (b)."""
        return episodic_cliff(
            sensor, fall_reward=self.fall_reward, fall_costs_step=self.fall_costs_step
        )


def episode_returns(config: Config, cells: list[Cell], context: Context) -> FloatArray:
    """Return of every episode, shape ``(cells, runs, episodes)``, in units of 1.

    Every entry has seeds of its own, so that entries are independent samples.
    """
    domains = {sensor: config.domain(sensor) for sensor in {c.sensor for c in cells}}
    initial = {
        (name, sensor): domain.scatter_all(phi)
        for sensor, domain in domains.items()
        for name, phi in named_potentials(
            domain,
            {c.potential for c in cells if c.sensor == sensor},
            epsilon=config.epsilon,
            mu=config.mu,
            seed=context.seed,
        ).items()
    }

    def one(job: tuple[Cell, np.random.SeedSequence]) -> FloatArray:
        cell, seed = job
        rng = np.random.default_rng(seed)
        domain = domains[cell.sensor]
        task = int(domain.sample(1, rng)[0])
        learned = learn(
            domain.tasks[task],
            cell.algorithm,
            alpha=config.alpha(cell.algorithm),
            epsilon=config.epsilon,
            episodes=config.episodes,
            initial_q=initial[cell.potential, cell.sensor][task],
            exploration=config.exploration,
            rng=rng,
        )
        return learned.episode_returns

    jobs = [
        (cell, seed)
        for i, cell in enumerate(cells)
        for seed in context.seeds(config.n_runs, 3, 1, i)
    ]
    returns = np.array(context.map(one, jobs, "table 3.1"))
    return returns.reshape(len(cells), config.n_runs, config.episodes)


def printed() -> pd.DataFrame:
    """What the thesis prints, by potential, algorithm and sensor, in units of 10^4."""
    table = published.load("table-3.1").astype({"sensor": bool})
    table = table.rename(columns={"value": "printed_mean", "ci95": "printed_ci95"})
    return table[["potential", "algorithm", "sensor", "printed_mean", "printed_ci95"]]


def all_cells(config: Config) -> list[Cell]:
    """Every entry; the sensor part has no Q_mu row, as in the thesis."""
    return [
        Cell(p, a, s)
        for s, p, a in product(config.sensors, config.potentials, config.algorithms)
        if not (s and p == "Q_mu")
    ]


def run(config: Config, context: Context) -> pd.DataFrame:
    """Compute the table; columns are documented in :data:`TABLE_3_1`."""
    cells = all_cells(config)
    totals = episode_returns(config, cells, context).sum(axis=2) / UNIT
    records = []
    for cell, total in zip(cells, totals, strict=True):
        summary = mean_ci(total)
        records.append(
            {
                "potential": cell.potential,
                "algorithm": cell.algorithm,
                "sensor": cell.sensor,
                "mean": summary.mean,
                "ci95": summary.half_width,
                "sd": float(total.std(ddof=1)),
                "n_runs": summary.n,
            }
        )
    return rows(records).merge(printed(), how="left", on=["potential", "algorithm", "sensor"])


@dataclass(frozen=True)
class FitConfig:
    """Which readings are held against the printed numbers, and how."""

    n_runs: int = 400
    """Runs an entry and reading; more than the thesis's, to see the reading and not noise."""
    most_episodes: int = 700
    """Largest number of episodes."""
    every: int = 10
    """Spacing of the curve, in episodes."""


READINGS: dict[str, dict[str, float | str | bool]] = {
    "as fitted": {},
    "epsilon .12": {"epsilon": 0.12},
    "random action from the others": {"exploration": "others"},
    "random action from the others, epsilon .09": {"exploration": "others", "epsilon": 0.09},
    "fall costs 1200": {"fall_reward": -1200.0},
    "fall costs 1001": {"fall_costs_step": True},
}
"""Readings of section 3.4.1, one point varied at a time."""


def run_fit(config: FitConfig, context: Context) -> pd.DataFrame:
    """Goodness of fit of each reading over the number of episodes (:data:`TABLE_3_1_FIT`)."""
    records = []
    for name, changes in READINGS.items():
        settings = replace(
            Config(
                n_runs=config.n_runs,
                episodes=config.most_episodes,
                potentials=("none", "Q_star", "Q_tilde"),
            ),
            **changes,  # type: ignore[arg-type]
        )
        cells = all_cells(settings)
        target = printed().set_index(["potential", "algorithm", "sensor"])
        keys = [(c.potential, c.algorithm, c.sensor) for c in cells]
        wanted = target["printed_mean"].reindex(keys).to_numpy()
        wanted_se = target["printed_ci95"].reindex(keys).to_numpy() / stats.norm.ppf(0.975)
        totals = episode_returns(settings, cells, context).cumsum(axis=2) / UNIT
        for episodes in range(config.every, config.most_episodes + 1, config.every):
            total = totals[:, :, episodes - 1]
            se = total.std(axis=1, ddof=1) / np.sqrt(config.n_runs)
            z = (total.mean(axis=1) - wanted) / np.hypot(se, wanted_se)
            records.append(
                {
                    "reading": name,
                    "episodes": episodes,
                    "chi2": float((z**2).sum()),
                    "dof": len(cells),
                    "p_value": float(stats.chi2.sf((z**2).sum(), len(cells))),
                    "worst_z": float(np.abs(z).max()),
                    "n_runs": config.n_runs,
                }
            )
    return rows(records)


TABLE_3_1: Experiment[Config] = Experiment(
    id="table-3.1",
    item="Table 3.1",
    title="Total reward on the episodic cliff, by potential, learner and sensor.",
    function=run,
    budgets={
        "smoke": Config(
            n_runs=4, episodes=20, mu=MuSearch("ga", ga=GeneticAlgorithm(generations=5))
        ),
        "book": Config(n_runs=1000),
        "thesis": Config(),
    },
    columns={
        "potential": "none, Q_star, Q_tilde, Q_mu, or constant (our control)",
        "algorithm": "q_learning or sarsa",
        "sensor": "whether the agent has the cliff sensor",
        "mean": "mean total reward of a run, in 10^4",
        "ci95": "half-width of the 95% t interval of the mean, in 10^4",
        "sd": "standard deviation over runs, in 10^4",
        "n_runs": "number of runs",
        "printed_mean": "what the thesis prints, in 10^4; empty where it prints nothing",
        "printed_ci95": "the half-width it prints, in 10^4",
    },
    seconds={"smoke": 1, "book": 15, "thesis": 8},
)

TABLE_3_1_FIT: Experiment[FitConfig] = Experiment(
    id="table-3.1-fit",
    item="Table 3.1, its reading",
    title="How well readings of section 3.4.1 fit the printed numbers, over the episodes run.",
    function=run_fit,
    budgets={
        "smoke": FitConfig(n_runs=4, most_episodes=40, every=20),
        "book": FitConfig(),
        "thesis": FitConfig(),
    },
    columns={
        "reading": "what is varied",
        "episodes": "episodes a run",
        "chi2": "sum over the table's entries of ((ours - printed) / standard error)^2",
        "dof": "number of entries compared",
        "p_value": "of chi2 with dof degrees of freedom",
        "worst_z": "largest standardised difference of an entry",
        "n_runs": "runs an entry",
    },
    seconds={"smoke": 1, "book": 15, "thesis": 15},
)
