"""Figure 3.3: Q-learning on the triangle over the learning rate."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations

import pandas as pd
from matplotlib.figure import Figure
from scipy import stats

from thesis_lib.chapter3.runs import (
    POTENTIALS,
    SHAPED,
    MuSearch,
    SweepReturn,
    at_best,
    compared,
    learning_rate_figure,
    sweep,
)
from thesis_lib.domains import triangle
from thesis_lib.edition.criteria import differ_but_one, equivalent
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, criterion


@dataclass(frozen=True)
class Config:
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


@experiment(
    "figure-3.3",
    item="Figure 3.3",
    smoke=Config(repeats=2, epsilons=(0.01,), alphas=(0.5,), mu=MuSearch(restarts=1)),
    book=Config(),
    thesis=Config(repeats=1),
    seconds=2,
)
def by_alpha(config: Config, context: Context) -> list[SweepReturn]:
    """Return of Q-learning on the triangle over the learning rate, by potential."""
    found = sweep(
        context,
        triangle(discount=config.discount),
        names=config.names,
        alphas=config.alphas,
        epsilons=config.epsilons,
        mu=config.mu,
        repeats=config.repeats,
        episodes=config.episodes,
    )
    return [SweepReturn(**row) for row in found]


@criterion("3.4.3-no-difference", by_alpha)
def no_difference(table: pd.DataFrame) -> Finding:
    """Potentials on the triangle at their best alpha: equivalent within 5%?"""
    best = at_best(table[table.epsilon == 0.01])
    pairs = [compared(best, b, a) for a, b in combinations(SHAPED, 2)]
    return equivalent(pairs, 0.05, "at each potential's best alpha")


@criterion("3.4.3-caption", by_alpha)
def all_but_one(table: pd.DataFrame) -> Finding:
    """The caption of figure 3.3: every difference significant but that of Q~ and Q^mu."""
    best = at_best(table[table.epsilon == 0.01])
    alike = ("Q_tilde", "Q_mu")
    names = [pair for pair in combinations(("none", *SHAPED), 2) if pair != alike]
    return differ_but_one([compared(best, a, b) for a, b in names], compared(best, *alike))


def power(table: pd.DataFrame, runs: int) -> float:
    """Chance that so many runs a point show Q^mu's difference from Q*, at 5% (two-sided t)."""
    best = at_best(table[table.epsilon == 0.01])
    pair = compared(best, "Q_mu", "Q_star")
    sd = (pair.first.sd**2 + pair.second.sd**2) ** 0.5
    shift = abs(pair.first.mean - pair.second.mean) * runs**0.5 / sd
    dof = 2 * runs - 2
    limit = stats.t.isf(0.025, dof)
    return float(stats.nct.sf(limit, dof, shift) + stats.nct.cdf(-limit, dof, shift))


def figure(table: pd.DataFrame) -> Figure:
    """Return over the learning rate, a panel an exploration rate."""
    panels = {rf"$\varepsilon = {e:g}$": table.epsilon == e for e in sorted(table.epsilon.unique())}
    return learning_rate_figure(table, panels, "return of 10 episodes")
