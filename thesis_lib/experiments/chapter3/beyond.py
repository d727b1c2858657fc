"""Beyond the thesis: scaled potentials, two value functions at once, other learners."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
import pandas as pd

from thesis_lib import potentials
from thesis_lib.arrays import FloatArray
from thesis_lib.domains import Domain
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.experiments.chapter3.common import (
    Learner,
    MuSearch,
    Potential,
    named_potentials,
    total_rewards,
)
from thesis_lib.experiments.chapter3.settings import SETTINGS
from thesis_lib.experiments.chapter3.table_3_1 import Config as Table31Config
from thesis_lib.experiments.chapter3.table_3_1 import run as run_table_3_1
from thesis_lib.mdp.learning import learn
from thesis_lib.stats import mean_ci


@dataclass(frozen=True)
class ScalingConfig:
    """Which factors each potential is multiplied by (the open question of section 3.6)."""

    domains: tuple[str, ...] = tuple(SETTINGS)
    """Domains of chapter 3."""
    names: tuple[Potential, ...] = ("Q_star", "Q_tilde", "Q_mu", "constant")
    """Potentials."""
    factors: tuple[float, ...] = (0.0, 0.25, 0.5, 0.75, 0.9, 1.0, 1.1, 1.25, 1.5, 2.0, 4.0)
    """Scale factors; 0 is no shaping, 1 the potential itself."""
    repeats: int = 25
    """Runs a task."""
    mu: MuSearch = field(default_factory=MuSearch)
    """The search for the cross-task policy."""


def run_scaling(config: ScalingConfig, context: Context) -> pd.DataFrame:
    """Return over the scale of the potential; columns in :data:`SCALING`.

    ``derived`` is the return, on each task, with the factor that is best on the mean of the
    other tasks: what an agent could know from its source tasks.
    """
    records = []
    for name in config.domains:
        domain = SETTINGS[name].domain()
        for learner in SETTINGS[name].learners:
            phi = named_potentials(
                domain, config.names, epsilon=learner.epsilon, mu=config.mu, seed=context.seed
            )
            keys = list(product(config.names, config.factors))
            cells = [(learner, factor * phi[potential]) for potential, factor in keys]
            totals = total_rewards(context, domain, cells, config.repeats, name)
            for i, potential in enumerate(config.names):
                own = totals[i * len(config.factors) : (i + 1) * len(config.factors)]
                derived = mean_ci(leave_one_out(own))
                for factor, total in zip(config.factors, own, strict=True):
                    summary = mean_ci(total)
                    records.append(
                        {
                            "domain": name,
                            "algorithm": learner.method,
                            "potential": potential,
                            "factor": factor,
                            "mean": summary.mean,
                            "ci95": summary.half_width,
                            "sd": float(total.std(ddof=1)),
                            "n_runs": summary.n,
                            "derived_mean": derived.mean,
                            "derived_ci95": derived.half_width,
                        }
                    )
    return rows(records)


def leave_one_out(totals: FloatArray) -> FloatArray:
    """Returns on each task with the factor that is best on the other tasks.

    Parameters
    ----------
    totals
        Return by factor, task and run, shape ``(F, M, R)``.

    Returns
    -------
    FloatArray
        Shape ``(M, R)``.
    """
    by_task = totals.mean(axis=2)
    n_tasks = by_task.shape[1]
    others = by_task.sum(axis=1, keepdims=True) - by_task
    best = np.argmax(others, axis=0)
    return np.stack([totals[best[m], m] for m in range(n_tasks)])


@dataclass(frozen=True)
class TwoValuesConfig:
    """How two value functions are learned at once (the suggestion of section 3.6)."""

    domains: tuple[str, ...] = tuple(SETTINGS)
    """Domains of chapter 3."""
    steps: tuple[int, ...] = (1_000, 10_000, 100_000, 1_000_000)
    """Learning steps on each source task."""
    alpha: float = 0.1
    """Learning rate of both value functions."""
    repeats: int = 10
    """Runs on each target task with the potential so obtained."""
    n_sources: int = 5
    """Independent sets of source solutions."""


def run_two_values(config: TwoValuesConfig, context: Context) -> pd.DataFrame:
    """Q~ learned by a Q-learner on the side, against the exact one (:data:`TWO_VALUES`)."""
    records = []
    for d, name in enumerate(config.domains):
        domain = SETTINGS[name].domain()
        target = next(x for x in SETTINGS[name].learners if x.method == "q_learning")
        # The source learner explores as the target learner will: the soft values are its own.
        exact = potentials.q_tilde(domain, target.epsilon)
        star = potentials.q_star(domain)
        spread = float(np.abs(exact - exact.mean()).max())
        for steps in config.steps:

            def source(
                seed: np.random.SeedSequence,
                steps: int = steps,
                domain: Domain = domain,
                target: Learner = target,
            ) -> tuple[FloatArray, FloatArray]:
                rng = np.random.default_rng(seed)
                own, side = [], []
                for task in domain.tasks:
                    learned = learn(
                        task,
                        "q_learning",
                        alpha=config.alpha,
                        epsilon=target.epsilon,
                        steps=steps,
                        companion="expected_sarsa",
                        rng=rng,
                    )
                    assert learned.companion is not None
                    own.append(learned.q)
                    side.append(learned.companion)
                return (
                    potentials.cross_task_values(domain, own),
                    potentials.cross_task_values(domain, side),
                )

            pairs = context.map(source, context.seeds(config.n_sources, 36, d, steps), name)
            for potential, learned, truth in (
                ("Q_star", [p[0] for p in pairs], star),
                ("Q_tilde", [p[1] for p in pairs], exact),
            ):
                # As many runs with the exact potential as with the learned ones.
                cells = [(target, phi) for phi in (*learned, *[truth] * len(learned))]
                totals = total_rewards(context, domain, cells, config.repeats, name)
                reached, best = mean_ci(totals[: len(learned)]), mean_ci(totals[len(learned) :])
                records.append(
                    {
                        "domain": name,
                        "potential": potential,
                        "steps": steps,
                        "relative_error": float(
                            np.mean([np.abs(phi - truth).mean() for phi in learned]) / spread
                        ),
                        "mean": reached.mean,
                        "ci95": reached.half_width,
                        "n_runs": reached.n,
                        "exact_mean": best.mean,
                        "exact_ci95": best.half_width,
                        "exact_n_runs": best.n,
                    }
                )
    return rows(records)


def run_learners(config: Table31Config, context: Context) -> pd.DataFrame:
    """Table 3.1 for learners the thesis does not try; columns in :data:`LEARNERS`."""
    table = run_table_3_1(config, context)
    return table.drop(columns=["printed_mean", "printed_ci95"])


@dataclass(frozen=True)
class AlphaConfig:
    """Learning rates over which unshaped learners are run on the episodic cliff."""

    alphas: tuple[float, ...] = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
    """Learning rates."""
    repeats: int = 25
    """Runs on each of the 8 tasks."""
    episodes: int = 600
    """Episodes a run."""


def run_alpha(config: AlphaConfig, context: Context) -> pd.DataFrame:
    """Total reward of unshaped learners over the learning rate (:data:`ALPHA`)."""
    domain = SETTINGS["episodic cliff"].domain()
    keys = list(product(("q_learning", "sarsa"), config.alphas))
    none = potentials.constant_potential(domain, 0.0)
    cells = [
        (Learner(method, alpha, 0.1, episodes=config.episodes), none)  # type: ignore[arg-type]
        for method, alpha in keys
    ]
    totals = total_rewards(context, domain, cells, config.repeats, "alpha") / 1e4
    records = []
    for (method, alpha), total in zip(keys, totals, strict=True):
        summary = mean_ci(total)
        records.append(
            {
                "algorithm": method,
                "alpha": alpha,
                "mean": summary.mean,
                "ci95": summary.half_width,
                "sd": float(total.std(ddof=1)),
                "n_runs": summary.n,
            }
        )
    return rows(records)


SCALING: Experiment[ScalingConfig] = Experiment(
    id="section-3.6-scaling",
    item="Section 3.6, scaling the potential",
    title="Return over a factor the potential is multiplied by.",
    function=run_scaling,
    budgets={
        "smoke": ScalingConfig(
            domains=("triangle",), factors=(0.0, 1.0), repeats=1, mu=MuSearch(restarts=1)
        ),
        "book": ScalingConfig(),
        "thesis": ScalingConfig(),
    },
    columns={
        "domain": "which domain",
        "algorithm": "the learner",
        "potential": "what is scaled",
        "factor": "0 is no shaping, 1 the potential itself",
        "mean": "mean total reward of a run",
        "ci95": "half-width of its 95% t interval over runs",
        "sd": "standard deviation over runs",
        "n_runs": "number of runs, all tasks together",
        "derived_mean": "mean return on each task with the factor best on the other tasks",
        "derived_ci95": "half-width of its 95% t interval",
    },
    seconds={"smoke": 1, "book": 60, "thesis": 60},
)

TWO_VALUES: Experiment[TwoValuesConfig] = Experiment(
    id="section-3.6-two-values",
    item="Section 3.6, two value functions at once",
    title="A Q-learner that learns the soft values on the side, against the exact potential.",
    function=run_two_values,
    budgets={
        "smoke": TwoValuesConfig(domains=("triangle",), steps=(100,), repeats=2, n_sources=2),
        "book": TwoValuesConfig(),
        "thesis": TwoValuesConfig(),
    },
    columns={
        "domain": "which domain",
        "potential": "Q_star from the learner's own values, Q_tilde from those on the side",
        "steps": "learning steps on each source task",
        "relative_error": "mean |learned - exact| over the largest deviation of the exact Q~",
        "mean": "mean total reward of a Q-learner with the learned potential",
        "ci95": "half-width of its 95% t interval over runs",
        "n_runs": "number of runs",
        "exact_mean": "the same with the exact potential",
        "exact_ci95": "half-width of its 95% t interval",
        "exact_n_runs": "number of runs with the exact potential",
    },
    seconds={"smoke": 1, "book": 40, "thesis": 40},
)

_OTHERS = Table31Config(
    algorithms=("expected_sarsa", "double_q_learning"),
    potentials=("none", "Q_star", "Q_tilde", "constant"),
)

LEARNERS: Experiment[Table31Config] = Experiment(
    id="table-3.1-learners",
    item="Table 3.1, other learners",
    title="Table 3.1 for Expected Sarsa and Double Q-learning.",
    function=run_learners,
    budgets={
        "smoke": replace(_OTHERS, n_runs=4, episodes=20),
        "book": replace(_OTHERS, n_runs=400),
        "thesis": _OTHERS,
    },
    columns={
        "potential": "none, Q_star, Q_tilde, or constant (our control)",
        "algorithm": "expected_sarsa or double_q_learning",
        "sensor": "whether the agent has the cliff sensor",
        "mean": "mean total reward of a run, in 10^4",
        "ci95": "half-width of its 95% t interval, in 10^4",
        "sd": "standard deviation over runs, in 10^4",
        "n_runs": "number of runs",
    },
    seconds={"smoke": 1, "book": 5, "thesis": 2},
)

ALPHA: Experiment[AlphaConfig] = Experiment(
    id="table-3.1-alpha",
    item="Table 3.1, its learning rates",
    title="Total reward of unshaped learners on the episodic cliff over the learning rate.",
    function=run_alpha,
    budgets={
        "smoke": AlphaConfig(alphas=(0.4, 1.0), repeats=1, episodes=10),
        "book": AlphaConfig(),
        "thesis": AlphaConfig(),
    },
    columns={
        "algorithm": "q_learning or sarsa",
        "alpha": "learning rate",
        "mean": "mean total reward of a run, in 10^4",
        "ci95": "half-width of its 95% t interval, in 10^4",
        "sd": "standard deviation over runs, in 10^4",
        "n_runs": "number of runs, all tasks together",
    },
    seconds={"smoke": 1, "book": 3, "thesis": 3},
)
