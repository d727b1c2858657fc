"""Sections 3.3.5 and 3.3.6: the cross-task policy, and the choice of p(x|m)."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from itertools import product
from typing import Literal

import numpy as np
import pandas as pd

from thesis_lib import potentials
from thesis_lib.arrays import FloatArray
from thesis_lib.domains import Domain
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.experiments.chapter3.common import Learner, MuSearch, total_rewards
from thesis_lib.experiments.chapter3.settings import SETTINGS
from thesis_lib.mdp.greedy import epsilon_greedy, greedy_actions
from thesis_lib.potentials import WEIGHTINGS
from thesis_lib.potentials.cross_task_policy import CrossTaskProblem, GeneticAlgorithm, climb
from thesis_lib.stats import mean_ci


@dataclass(frozen=True)
class MuConfig:
    """How hard each search for the cross-task policy tries."""

    domains: tuple[str, ...] = tuple(SETTINGS)
    """Domains of chapter 3."""
    objectives: tuple[Literal["start", "stationary"], ...] = ("start", "stationary")
    """Equation 3.9 with start-state weights, and equation 3.11."""
    ga: GeneticAlgorithm = field(default_factory=GeneticAlgorithm)
    """The genetic algorithm of footnote 2."""
    ga_runs: int = 2
    """Runs of the genetic algorithm."""
    restarts: int = 20
    """Starting points of the exact gradient search."""


def run_mu(config: MuConfig, context: Context) -> pd.DataFrame:
    """What each search reaches, against the uniform policy and the tasks' own optima."""

    def one(job: tuple[str, Literal["start", "stationary"]]) -> list[dict[str, object]]:
        name, objective = job
        domain = SETTINGS[name].domain()
        problem = CrossTaskProblem(domain, objective)
        uniform = np.full(domain.shape, 1 / domain.shape[1])
        found: list[dict[str, object]] = []

        def note(method: str, value: float, seconds: float, spread: float, n: int) -> None:
            found.append(
                {
                    "domain": name,
                    "objective": objective,
                    "method": method,
                    "value": value,
                    "worst": spread,
                    "n": n,
                    "cpu_seconds": round(seconds, 2),
                }
            )

        note("uniform", float(problem.value(uniform)), 0.0, float(problem.value(uniform)), 1)
        seeds = context.seeds(config.ga_runs + 1, list(SETTINGS).index(name))
        clock = time.thread_time()
        genetic = [config.ga.search(problem, np.random.default_rng(s)).value for s in seeds[1:]]
        note("ga", max(genetic), time.thread_time() - clock, min(genetic), len(genetic))
        clock = time.thread_time()
        best = climb(problem, np.random.default_rng(seeds[0]), restarts=config.restarts)
        note(
            "gradient",
            best.value,
            time.thread_time() - clock,
            float(best.history.min()),
            len(best.history),
        )
        return found

    jobs = list(product(config.domains, config.objectives))
    return rows([r for records in context.map(one, jobs, "mu*") for r in records])


@dataclass(frozen=True)
class WeightingConfig:
    """Which p(x|m) are compared, and how often."""

    domains: tuple[str, ...] = tuple(SETTINGS)
    """Domains of chapter 3."""
    names: tuple[Literal["Q_star", "Q_tilde", "Q_mu"], ...] = ("Q_star", "Q_tilde", "Q_mu")
    """Potentials."""
    repeats: int = 50
    """Runs a task."""
    learning_steps: int = 20_000
    """T of the weighting that the learning process induces."""
    mu: MuSearch = field(default_factory=MuSearch)
    """The search for the cross-task policy; its ``weights`` are not used here."""


def potentials_by_weighting(
    domain: Domain, learner: Learner, config: WeightingConfig, seed: int
) -> dict[tuple[str, str], FloatArray]:
    """Each potential under each p(x|m) that applies to it (section 3.3.6)."""
    found: dict[tuple[str, str], FloatArray] = {}
    for name in config.names:
        if name == "Q_mu":
            mu = config.mu.policy(domain, seed)
            tables = potentials.policy_values(domain, mu)
            policies = potentials.task_policies(domain, mu)
        elif name == "Q_star":
            tables = potentials.optimal_solutions(domain)
            # Greedy but for a hair, so that the stationary distribution is unique.
            policies = [epsilon_greedy(q, 1e-6) for q in tables]
        else:
            tables = potentials.soft_solutions(domain, learner.epsilon)
            policies = [epsilon_greedy(q, learner.epsilon) for q in tables]
        for kind in WEIGHTINGS:
            if kind == "learning":
                if name == "Q_mu":  # "Clearly, this option does not apply"
                    continue
                weights = potentials.learning_weights(
                    domain,
                    learner.method,
                    alpha=learner.alpha,
                    epsilon=learner.epsilon,
                    steps=config.learning_steps,
                    rng=np.random.default_rng(seed),
                    snapshots=min(100, config.learning_steps),
                )
            else:
                weights = potentials.pair_weights(domain, kind, policies)  # type: ignore[arg-type]
            found[name, kind] = potentials.cross_task_values(domain, tables, weights)
    return found


def run_weightings(config: WeightingConfig, context: Context) -> pd.DataFrame:
    """Return under each choice of p(x|m); columns in :data:`WEIGHTINGS_COMPARED`."""
    records = []
    for name in config.domains:
        domain = SETTINGS[name].domain()
        for learner in SETTINGS[name].learners:
            phi = potentials_by_weighting(domain, learner, config, context.seed)
            totals = total_rewards(
                context, domain, [(learner, p) for p in phi.values()], config.repeats, name
            )
            for (potential, kind), total in zip(phi, totals, strict=True):
                summary = mean_ci(total)
                records.append(
                    {
                        "domain": name,
                        "algorithm": learner.method,
                        "potential": potential,
                        "weighting": kind,
                        "mean": summary.mean,
                        "ci95": summary.half_width,
                        "sd": float(total.std(ddof=1)),
                        "n_runs": summary.n,
                    }
                )
    return rows(records)


MU_STAR: Experiment[MuConfig] = Experiment(
    id="section-3.3.5",
    item="Section 3.3.5, the cross-task policy",
    title="Value of the best cross-task policy found by the thesis's GA and by exact gradients.",
    function=run_mu,
    budgets={
        "smoke": MuConfig(
            domains=("triangle",), ga=GeneticAlgorithm(generations=5), ga_runs=1, restarts=2
        ),
        "book": MuConfig(),
        "thesis": MuConfig(),
    },
    columns={
        "domain": "which domain",
        "objective": "start (3.9 with start-state weights) or stationary (3.11)",
        "method": "uniform policy, ga (footnote 2) or gradient (exact, with restarts)",
        "value": "best objective reached",
        "worst": "worst objective over runs or restarts",
        "n": "runs or restarts",
        "cpu_seconds": "processor time of them all",
    },
    seconds={"smoke": 1, "book": 90, "thesis": 90},
)

WEIGHTINGS_COMPARED: Experiment[WeightingConfig] = Experiment(
    id="section-3.3.6",
    item="Section 3.3.6, the choice of p(x|m)",
    title="Return of each potential under the four choices of p(x|m).",
    function=run_weightings,
    budgets={
        "smoke": WeightingConfig(
            domains=("triangle",), repeats=1, learning_steps=200, mu=MuSearch(restarts=1)
        ),
        "book": WeightingConfig(),
        "thesis": WeightingConfig(),
    },
    columns={
        "domain": "which domain",
        "algorithm": "the learner",
        "potential": "Q_star, Q_tilde or Q_mu",
        "weighting": "uniform, start, stationary or learning",
        "mean": "mean total reward of a run",
        "ci95": "half-width of its 95% t interval over runs",
        "sd": "standard deviation over runs",
        "n_runs": "number of runs, all tasks together",
    },
    seconds={"smoke": 1, "book": 30, "thesis": 30},
)


@dataclass(frozen=True)
class LevelsConfig:
    """Which domains the levels of the potentials are compared on."""

    domains: tuple[str, ...] = tuple(SETTINGS)
    """Domains of chapter 3."""
    mu: MuSearch = field(default_factory=MuSearch)
    """The search for the cross-task policy."""


def run_levels(config: LevelsConfig, context: Context) -> pd.DataFrame:
    """Level and ordering of the potentials, exact; columns in :data:`LEVELS`."""
    records = []
    for name in config.domains:
        domain = SETTINGS[name].domain()
        epsilon = SETTINGS[name].learners[0].epsilon
        # Averages of the same weights throughout, so that only the task values differ.
        policy = config.mu.policy(domain, context.seed)
        phi = {
            "Q_star": potentials.q_star(domain),
            "Q_tilde": potentials.q_tilde(domain, epsilon),
            "Q_mu": potentials.q_mu(domain, policy),
        }
        best = greedy_actions(phi["Q_star"])
        for potential, values in phi.items():
            gap = phi["Q_star"] - values
            records.append(
                {
                    "domain": name,
                    "potential": potential,
                    "mean": float(values.mean()),
                    "lowest": float(values.min()),
                    "highest": float(values.max()),
                    "largest_rise": float((-gap).max()),
                    "mean_gap": float(gap.mean()),
                    "same_greedy_actions": float(
                        (greedy_actions(values) == best).all(axis=1).mean()
                    ),
                }
            )
    return rows(records)


LEVELS: Experiment[LevelsConfig] = Experiment(
    id="section-3.3-levels",
    item="Section 3.3, the levels of the potentials",
    title="How high each potential is and which actions it prefers, exact.",
    function=run_levels,
    budgets={
        "smoke": LevelsConfig(domains=("triangle",), mu=MuSearch(restarts=1)),
        "book": LevelsConfig(),
        "thesis": LevelsConfig(),
    },
    columns={
        "domain": "which domain",
        "potential": "Q_star, Q_tilde or Q_mu, all with uniform p(x|m)",
        "mean": "mean over pairs",
        "lowest": "least value",
        "highest": "largest value",
        "largest_rise": "largest amount by which it exceeds Q_star at some pair",
        "mean_gap": "mean over pairs of Q_star less it",
        "same_greedy_actions": "share of observations with the same greedy actions as Q_star",
    },
    seconds={"smoke": 1, "book": 5, "thesis": 5},
)
