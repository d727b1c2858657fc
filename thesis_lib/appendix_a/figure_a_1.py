"""Fact 1: stochastic against deterministic policies on the domain of figure A.1."""

from __future__ import annotations

from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.appendix_a.pictures import CHANCE
from thesis_lib.domains.appendix_a import figure_a1, policy, state_values
from thesis_lib.edition.criteria import EXACT, exact
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, criterion
from thesis_lib.edition.plots import COLOURS
from thesis_lib.edition.words import number, several


@dataclass(frozen=True)
class Config:
    """Which policies and discounts are evaluated."""

    penalty: float = 1.0
    """R of figure A.1."""
    discounts: tuple[float, ...] = (0.5, 0.9, 0.99, 0.999)
    """gamma."""
    policies: int = 101
    """Number of evenly spaced p(B) from 0 to 1; odd, so that the fair coin is among them."""

    def __post_init__(self) -> None:
        if self.policies < 3 or self.policies % 2 == 0:
            raise ValueError(
                f"policies is {self.policies}, but it must be odd and at least 3, so that p(B) = "
                "0, 1/2 and 1 are among them."
            )


@dataclass(frozen=True)
class Value:
    """Value of state 1 under one policy [reward]."""

    discount: float
    """gamma."""
    penalty: float
    """R [reward]."""
    p_b: float
    """Probability of B in state 1."""
    task_1: float
    """Value of state 1 in task 1 [reward]."""
    task_2: float
    """Value of state 1 in task 2 [reward]."""
    value: float
    """Domain value of state 1, both tasks equally likely [reward]."""


@experiment(
    "figure-a.1",
    item="Figure A.1",
    smoke=Config(policies=11),
    book=Config(discounts=(0.1, 0.5, 0.8, 0.9, 0.95, 0.99, 0.999)),
    seconds=0.1,
)
def by_policy(config: Config, context: Context) -> list[Value]:
    """Value of state 1 over p(B), deterministic and stochastic policies, exact."""
    records = []
    for gamma in config.discounts:
        domain = figure_a1(config.penalty, gamma)
        for p_b in np.linspace(0, 1, config.policies):
            found = state_values(domain, policy(domain, p_b))
            first, second = found.task[:, 0]
            records.append(Value(gamma, config.penalty, p_b, first, second, value=found.domain[0]))
    return records


@criterion("A.1-values", by_policy)
def values(table: pd.DataFrame) -> Finding:
    """Values of the deterministic policies and of the fair coin against the formulas."""
    gamma, cost = table.discount, table.penalty
    formula = pd.Series(np.nan, table.index)
    formula[table.p_b.isin([0.0, 1.0])] = -cost / (2 - 2 * gamma)
    formula[table.p_b == 0.5] = -cost / (2 - gamma)
    gap = (abs(table.value / formula - 1)).dropna()
    return exact(
        (gap < EXACT).all(),
        f"Over {table.discount.nunique()} discounts the solved values differ from the formulas by "
        f"{f'at most {gap.max():.1g} of their size' if gap.any() else 'nothing'}.",
    )


@criterion("A.1-arbitrarily-better", by_policy)
def arbitrarily_better(table: pd.DataFrame) -> Finding:
    """Whether the coin is best of all policies, by a factor that grows as gamma nears 1."""
    best = table.loc[table.groupby("discount").value.idxmax()].set_index("discount")
    ends = table[table.p_b.isin([0.0, 1.0])].groupby("discount").value.max()
    ratio = (ends / best.value).sort_index()
    coin = bool((best.p_b == 0.5).all())
    grows = bool((np.diff(ratio) > 0).all() and (ratio > 1).all())
    formula = (2 - ratio.index) / (2 - 2 * ratio.index)
    same = bool((abs(ratio / formula - 1) < EXACT).all())
    parts = several(f"{number(r)} at gamma {g:g}" for g, r in ratio.items())
    return exact(
        coin and grows and same,
        f"The best policy found is {'' if coin else 'not '}the fair coin at every discount; the "
        f"best deterministic policy costs {parts} times as much.",
    )


def figure(table: pd.DataFrame, discount: float) -> Figure:
    """Value of state 1 over p(B) at one discount (left), and the ratio over discounts."""
    figure, (left, right) = plt.subplots(1, 2)
    at = table[np.isclose(table.discount, discount)]
    left.plot(at.p_b, at.task_1, color=COLOURS[0], ls="--", label="task 1")
    left.plot(at.p_b, at.task_2, color=COLOURS[1], ls="-.", label="task 2")
    left.plot(at.p_b, at.value, color="k", lw=2.4, label="domain")
    coin = at[np.isclose(at.p_b, 0.5)]
    left.plot(coin.p_b, coin.value, "o", color="k", ms=7)
    left.set(xlabel=CHANCE, ylabel="value of state 1 [reward]", title=f"$\\gamma$ = {discount:g}")
    left.legend(loc="lower center")
    values = table.set_index(["discount", "p_b"]).value.unstack()
    gamma = values.index.to_numpy()
    solved = values[[0.0, 1.0]].max(axis=1) / values.max(axis=1)
    line = 1 - np.geomspace(1 - gamma.min(), 1 - gamma.max(), 50)
    right.loglog(1 - line, (2 - line) / (2 - 2 * line), color="0.5", label="formula")
    right.loglog(1 - gamma, solved, "o", color="k", label="solved")
    right.set(xlabel=r"$1 - \gamma$", ylabel="cost of the best deterministic\npolicy / of the coin")
    right.invert_xaxis()
    right.legend()
    return figure
