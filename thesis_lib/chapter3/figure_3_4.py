"""Figure 3.4: Q-learning on stock trading over the learning rate."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product
from typing import Any, Literal

import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.chapter3.runs import (
    NAMES,
    POTENTIALS,
    SHAPED,
    MuSearch,
    SweepReturn,
    at_best,
    compared,
    learning_rate_figure,
    log_grid,
    sweep,
)
from thesis_lib.domains import stock
from thesis_lib.edition.criteria import LEVEL, best, ordered
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion, effect_of
from thesis_lib.edition.words import number, probability, several, span
from thesis_lib.stats import welch


@dataclass(frozen=True)
class Config:
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


@dataclass(frozen=True)
class Return(SweepReturn):
    """The same on one stock domain."""

    sectors: int
    """S."""
    stocks: int
    """E, stocks in a sector."""
    global_factors: int
    """G."""
    discount: float
    """gamma."""
    reward_timing: str
    """Ownership before or after the action, times current or next prices."""


@experiment(
    "figure-3.4",
    item="Figure 3.4",
    smoke=Config(
        sizes=((1, 2, 1),),
        steps=30,
        repeats=1,
        epsilons=(0.1,),
        alphas=(0.5,),
        mu=MuSearch(restarts=1),
    ),
    book=Config(),
    seconds=20,
)
def by_alpha(config: Config, context: Context) -> list[Return]:
    """Return of Q-learning on stock trading over the learning rate, by potential."""
    records = []
    for size, discount, timing in product(config.sizes, config.discounts, config.reward_timings):
        found = sweep(
            context,
            stock(*size, discount=discount, reward_timing=timing),
            names=config.names,
            alphas=config.alphas,
            epsilons=config.epsilons,
            mu=config.mu,
            repeats=config.repeats,
            steps=config.steps,
        )
        setting: dict[str, Any] = {
            **{"sectors": size[0], "stocks": size[1], "global_factors": size[2]},
            **{"discount": discount, "reward_timing": timing},
        }
        records += [Return(**setting, **row) for row in found]
    return records


def two_stocks(table: pd.DataFrame) -> pd.DataFrame:
    """Each potential at its best alpha, for E = 2 and the least exploration."""
    own = table[(table.stocks == 2) & (table.epsilon == table.epsilon.min())]
    return at_best(own)


@criterion("3.4.4-best", by_alpha)
def q_star_and_q_tilde_are_best(table: pd.DataFrame) -> Finding:
    """Q* and Q~ above no shaping and above Q^mu on stock, each at its best alpha."""
    at = two_stocks(table)
    pairs = [compared(at, a, b) for a in ("Q_star", "Q_tilde") for b in ("none", "Q_mu")]
    return ordered(pairs, "return at each potential's best alpha")


@criterion("3.4.4-constant", by_alpha)
def constant_wins(table: pd.DataFrame) -> Finding:
    """Our control: a constant potential against the best of the thesis's three."""
    at = two_stocks(table)
    top = best(at[at.potential.isin(SHAPED)]).potential
    pair = compared(at, "constant", top)
    test = welch(pair.first, pair.second)
    explained = test.difference > 0 and test.p_value < LEVEL
    half = (test.high - test.low) / 2
    return Finding(
        Verdict.REFUTED if explained else Verdict.REPRODUCED,
        f"At the best alphas, with the best of the three: {pair}; difference "
        f"{number(test.difference, half, sign=True)} (95% interval {span(test.low, test.high)}, "
        f"Welch, {probability(test.p_value)}).",
        {"difference": test.difference, "p": test.p_value},
    )


@effect_of("3.4.4-size", by_alpha)
def e_of_stock(table: pd.DataFrame) -> str:
    """Return of every potential for both readings of E."""
    own = table[table.epsilon == table.epsilon.min()]
    told = []
    for stocks, group in own.groupby("stocks"):
        rows = at_best(group).itertuples()
        cells = several(f"{NAMES[r.potential]} {number(r.mean_return, r.ci95)}" for r in rows)
        told.append(f"E = {stocks}: {cells}")
    return f"Best mean returns: {'; '.join(told)}."


def figure(table: pd.DataFrame) -> Figure:
    """Return over the learning rate at the least exploration, a panel a number of stocks."""
    own = table[table.epsilon == table.epsilon.min()]
    panels = {f"E = {e}": own.stocks == e for e in sorted(own.stocks.unique())}
    return learning_rate_figure(own, panels, "return of a run", log=True)
