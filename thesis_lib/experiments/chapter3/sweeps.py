"""Figures 3.3 and 3.4: Q-learning on the triangle and on stock trading."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product
from typing import Literal

import pandas as pd

from thesis_lib.domains import Domain, stock, triangle
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.experiments.chapter3.common import (
    POTENTIALS,
    Learner,
    MuSearch,
    log_grid,
    named_potentials,
    total_rewards,
)
from thesis_lib.mdp.learning import Method
from thesis_lib.stats import mean_ci


@dataclass(frozen=True)
class TriangleConfig:
    """Settings of figure 3.3."""

    episodes: int = 10
    """Episodes a run."""
    repeats: int = 40
    """Runs a task; the thesis has 1, hence 12 runs a point."""
    epsilons: tuple[float, ...] = (0.01, 0.1)
    """Exploration rates; .01 is "the best-performing setting"."""
    alphas: tuple[float, ...] = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
    """Learning rates."""
    discount: float = 1.0
    """gamma, as printed."""
    names: tuple[str, ...] = POTENTIALS
    """Potentials."""
    mu: MuSearch = field(default_factory=MuSearch)
    """The search for the cross-task policy."""


@dataclass(frozen=True)
class StockConfig:
    """Settings of figure 3.4."""

    sizes: tuple[tuple[int, int, int], ...] = ((1, 2, 2), (1, 3, 2))
    """<S, E, G>: the text prints E = 3, but 240 runs are 20 on each of 12 tasks, hence E = 2."""
    steps: int = 300
    """Learning steps a run."""
    repeats: int = 20
    """Runs a task."""
    epsilons: tuple[float, ...] = (0.01, 0.1)
    """Exploration rates, not printed."""
    alphas: tuple[float, ...] = log_grid(0.02, 1.0, 10)
    """Learning rates."""
    discounts: tuple[float, ...] = (0.9,)
    """gamma, not printed."""
    reward_timings: tuple[
        Literal["after_next", "after_current", "before_next", "before_current"], ...
    ] = ("after_next",)
    """Which ownership and which prices earn the reward."""
    names: tuple[str, ...] = POTENTIALS
    """Potentials."""
    mu: MuSearch = field(default_factory=lambda: MuSearch(restarts=3))
    """The search for the cross-task policy."""


def sweep(
    context: Context,
    domain: Domain,
    *,
    method: Method,
    names: tuple[str, ...],
    alphas: tuple[float, ...],
    epsilons: tuple[float, ...],
    mu: MuSearch,
    repeats: int,
    episodes: int | None = None,
    steps: int | None = None,
) -> list[dict[str, float | str | int]]:
    """Return of one learner over learning and exploration rates, one record a cell."""
    keys = list(product(epsilons, names, alphas))
    phi = {
        epsilon: named_potentials(domain, names, epsilon=epsilon, mu=mu, seed=context.seed)
        for epsilon in epsilons
    }
    cells = [
        (Learner(method, alpha, epsilon, episodes=episodes, steps=steps), phi[epsilon][name])
        for epsilon, name, alpha in keys
    ]
    totals = total_rewards(context, domain, cells, repeats, domain.name)
    records: list[dict[str, float | str | int]] = []
    for (epsilon, name, alpha), total in zip(keys, totals, strict=True):
        summary = mean_ci(total)
        records.append(
            {
                "algorithm": method,
                "epsilon": epsilon,
                "potential": name,
                "alpha": alpha,
                "mean": summary.mean,
                "ci95": summary.half_width,
                "sd": float(total.std(ddof=1)),
                "n_runs": summary.n,
            }
        )
    return records


def run_figure_3_3(config: TriangleConfig, context: Context) -> pd.DataFrame:
    """Compute figure 3.3; columns are documented in :data:`FIGURE_3_3`."""
    return rows(
        sweep(
            context,
            triangle(discount=config.discount),
            method="q_learning",
            names=config.names,
            alphas=config.alphas,
            epsilons=config.epsilons,
            mu=config.mu,
            repeats=config.repeats,
            episodes=config.episodes,
        )
    )


def run_figure_3_4(config: StockConfig, context: Context) -> pd.DataFrame:
    """Compute figure 3.4; columns are documented in :data:`FIGURE_3_4`."""
    records = []
    for size, discount, timing in product(config.sizes, config.discounts, config.reward_timings):
        domain = stock(*size, discount=discount, reward_timing=timing)
        found = sweep(
            context,
            domain,
            method="q_learning",
            names=config.names,
            alphas=config.alphas,
            epsilons=config.epsilons,
            mu=config.mu,
            repeats=config.repeats,
            steps=config.steps,
        )
        setting = {
            "sectors": size[0],
            "stocks": size[1],
            "global_factors": size[2],
            "discount": discount,
            "reward_timing": timing,
        }
        records += [{**setting, **record} for record in found]
    return rows(records)


SWEEP_COLUMNS = {
    "algorithm": "q_learning",
    "epsilon": "exploration rate",
    "potential": "none, Q_star, Q_tilde, Q_mu, constant",
    "alpha": "learning rate",
    "mean": "mean total reward of a run",
    "ci95": "half-width of its 95% t interval over runs",
    "sd": "standard deviation over runs",
    "n_runs": "number of runs, all tasks together",
}

FIGURE_3_3: Experiment[TriangleConfig] = Experiment(
    id="figure-3.3",
    item="Figure 3.3",
    title="Return of Q-learning on the triangle over the learning rate, by potential.",
    function=run_figure_3_3,
    budgets={
        "smoke": TriangleConfig(
            repeats=2, epsilons=(0.01,), alphas=(0.5,), mu=MuSearch(restarts=1)
        ),
        "book": TriangleConfig(),
        "thesis": TriangleConfig(repeats=1),
    },
    columns=SWEEP_COLUMNS,
    seconds={"smoke": 1, "book": 8, "thesis": 1},
)

FIGURE_3_4: Experiment[StockConfig] = Experiment(
    id="figure-3.4",
    item="Figure 3.4",
    title="Return of Q-learning on stock trading over the learning rate, by potential.",
    function=run_figure_3_4,
    budgets={
        "smoke": StockConfig(
            sizes=((1, 2, 1),),
            steps=30,
            repeats=1,
            epsilons=(0.1,),
            alphas=(0.5,),
            mu=MuSearch(restarts=1),
        ),
        "book": StockConfig(),
        "thesis": StockConfig(),
    },
    columns={
        "sectors": "S",
        "stocks": "E, stocks in a sector",
        "global_factors": "G",
        "discount": "gamma",
        "reward_timing": "ownership before or after the action, times current or next prices",
        **SWEEP_COLUMNS,
    },
    seconds={"smoke": 1, "book": 20, "thesis": 20},
)
