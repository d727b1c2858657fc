"""Figure 3.4: Q-learning on stock trading over the learning rate."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations, product
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
from thesis_lib.edition.criteria import (
    LEVEL,
    best,
    differ_but_one,
    equivalent,
    graded,
    ordered,
    positive,
)
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion, effect_of
from thesis_lib.edition.words import number, probability, several, span
from thesis_lib.stats import equivalence, welch


@dataclass(frozen=True)
class Config:
    """Settings of figure 3.4."""

    sizes: tuple[tuple[int, int, int], ...] = ((1, 2, 2), (1, 3, 2))
    """<S, E, G>: the text prints E = 3, but 240 runs are 20 on each of 12 tasks, hence E = 2."""
    steps: int = 300
    """Learning steps a run."""
    repeats: int = 20
    """Runs a task; the thesis has 20."""
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
    book=Config(repeats=80),
    seconds=24,
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


def of_size(table: pd.DataFrame, stocks: int) -> pd.DataFrame:
    """Each potential at every alpha, for one E and the least exploration."""
    return table[(table.stocks == stocks) & (table.epsilon == table.epsilon.min())]


def two_stocks(table: pd.DataFrame) -> pd.DataFrame:
    """Each potential at its best alpha, for E = 2 and the least exploration."""
    return at_best(of_size(table, 2))


SIZES = {3: "E = 3, as printed", 2: "E = 2, as the number of runs says"}


@criterion("3.4.4-best", by_alpha)
def q_star_and_q_tilde_are_best(table: pd.DataFrame) -> Finding:
    """Q* and Q~ above no shaping and above Q^mu on stock, each at its best alpha, for both E."""
    pairs = [
        compared(at_best(of_size(table, size)), a, b, where)
        for size, where in SIZES.items()
        for a in ("Q_star", "Q_tilde")
        for b in ("none", "Q_mu")
    ]
    return ordered(pairs, "return at each potential's best alpha")


@criterion("3.4.4-tilde-superior", by_alpha)
def q_tilde_is_as_good_as_q_star(table: pd.DataFrame) -> Finding:
    """Q~ against Q* on stock at their best alphas: equivalent within 5%?"""
    pairs = [compared(at_best(of_size(table, e)), "Q_tilde", "Q_star", w) for e, w in SIZES.items()]
    return equivalent(pairs, 0.05, "return at the best alphas")


@criterion("3.4.4-resistant", by_alpha)
def q_mu_resists_changes_of_alpha(table: pd.DataFrame) -> Finding:
    """How much less Q^mu loses than Q* and Q~ from its best alpha to the mean over all."""
    contrasts = {}
    for size, where in SIZES.items():
        lost = {}
        for name, own in of_size(table, size).groupby("potential"):
            se, top = own.sd / own.n_runs**0.5, own.mean_return.idxmax()
            share = 1 / len(own)  # the best point is one of those in the mean
            spread = (se**2).sum() * share**2 + (1 - 2 * share) * se[top] ** 2
            lost[name] = (own.mean_return.max() - own.mean_return.mean(), float(spread))
        for other in ("Q_star", "Q_tilde"):
            gap = lost[other][0] - lost["Q_mu"][0]
            contrasts[f"{NAMES[other]} ({where})"] = (
                gap,
                (lost[other][1] + lost["Q_mu"][1]) ** 0.5,
            )
    return positive(
        contrasts, "Q^μ loses less return than the other from its best alpha to the mean"
    )


@criterion("3.4.4-high-alpha", by_alpha)
def differences_vanish_at_high_alpha(table: pd.DataFrame) -> Finding:
    """Q^mu against Q* and Q~ at the highest learning rate: equivalent within 5%?"""
    high = table[table.alpha == table.alpha.max()]
    pairs = [
        compared(of_size(high, size), other, "Q_mu", where)
        for size, where in SIZES.items()
        for other in ("Q_star", "Q_tilde")
    ]
    return equivalent(pairs, 0.05, f"return at alpha {high.alpha.iloc[0]:g}")


@criterion("3.4.4-caption", by_alpha)
def all_but_q_tilde_and_q_star(table: pd.DataFrame) -> Finding:
    """The caption of figure 3.4 at the E its number of runs says."""
    at, alike = two_stocks(table), ("Q_star", "Q_tilde")
    names = [pair for pair in combinations(("none", *SHAPED), 2) if pair != alike]
    return differ_but_one([compared(at, a, b) for a, b in names], compared(at, *alike))


@criterion("3.4.4-constant", by_alpha)
def constant_wins(table: pd.DataFrame) -> Finding:
    """Our control: a constant potential against the best of the thesis's three."""
    at = two_stocks(table)
    top = best(at[at.potential.isin(SHAPED)]).potential
    pair = compared(at, "constant", top)
    test = welch(pair.first, pair.second)
    explained = test.difference > 0 and test.p_value < LEVEL
    alike = equivalence(pair.first, pair.second, 0.05 * abs(pair.second.mean)).p_value < LEVEL
    # The best of the three is chosen after looking: any of them might have been it.
    below = test.difference < 0 and len(SHAPED) * test.p_value < LEVEL
    half = (test.high - test.low) / 2
    return Finding(
        graded(below and not alike, denied=explained or alike, otherwise=Verdict.INCONCLUSIVE),
        f"At the best alphas, with the best of the three: {pair}; difference "
        f"{number(test.difference, half, sign=True)} (95% interval {span(test.low, test.high)}, "
        f"Welch, {probability(test.p_value)}), {'equivalent' if alike else 'not equivalent'} "
        "within 5% (two one-sided tests).",
        {"difference": test.difference, "p": test.p_value, "equivalent": float(alike)},
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
