"""Section 3.4.1: whether the learning rates of Table 3.1 are the best ones."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib import potentials
from thesis_lib.chapter3 import table_3_1
from thesis_lib.chapter3.runs import LEARNERS, SETTINGS, TabularLearner, total_rewards
from thesis_lib.edition.criteria import Pair, best, no_greater, summary
from thesis_lib.edition.experiment import Context, experiment, returns
from thesis_lib.edition.ledger import Finding, criterion
from thesis_lib.edition.plots import PRINTED
from thesis_lib.mdp.learning import Method

METHODS: tuple[Method, ...] = ("q_learning", "sarsa")


@dataclass(frozen=True)
class Config:
    """Learning rates over which unshaped learners are run on the episodic cliff."""

    alphas: tuple[float, ...] = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
    """Learning rates."""
    repeats: int = 25
    """Runs on each of the 8 tasks."""
    episodes: int = 600
    """Episodes a run."""


@dataclass(frozen=True)
class Return:
    """Total reward at one learning rate, in units of 10^4."""

    algorithm: str
    """q_learning or sarsa."""
    alpha: float
    """Learning rate."""
    mean_return: float
    """Mean total reward of a run, in 10^4."""
    ci95: float
    """Half-width of its 95% t interval, in 10^4."""
    sd: float
    """Standard deviation over runs, in 10^4."""
    n_runs: int
    """Number of runs, all tasks together."""


@experiment(
    "ch3-learning-rates",
    item="Table 3.1, its learning rates",
    smoke=Config(alphas=(0.4, 1.0), repeats=1, episodes=10),
    book=Config(),
    seconds=1,
)
def by_alpha(config: Config, context: Context) -> list[Return]:
    """Total reward of unshaped learners on the episodic cliff over the learning rate."""
    domain = SETTINGS["episodic cliff"].domain()
    keys = list(product(METHODS, config.alphas))
    none = potentials.constant_potential(domain, 0.0)
    cells = [
        (TabularLearner(method, alpha, 0.1, episodes=config.episodes), none)
        for method, alpha in keys
    ]
    totals = total_rewards(context, domain, cells, config.repeats, "alpha") / table_3_1.UNIT
    return [Return(*key, **returns(total)) for key, total in zip(keys, totals, strict=True)]


@criterion("3.4.1-learning-rates", by_alpha)
def learning_rates_are_best(table: pd.DataFrame) -> Finding:
    """The best learning rate of each learner against the printed one: better by at most 3%?"""
    pairs = []
    for algorithm in METHODS:
        own, stated = table[table.algorithm == algorithm], table_3_1.Config().alpha(algorithm)
        top, printed = best(own), best(own[own.alpha == stated])
        names = (f"best at alpha {top.alpha:g}", f"at the printed alpha {stated:g}")
        pairs.append(Pair(summary(top), summary(printed), names, LEARNERS[algorithm]))
    return no_greater(pairs, 0.03, "total reward in 10⁴", choices=table.alpha.nunique() - 1)


def figure(table: pd.DataFrame, printed: pd.DataFrame) -> Figure:
    """Total reward over the learning rate; ``printed`` is Table 3.1."""
    fig, ax = plt.subplots(figsize=(7.2, 3))
    for method, own in table.groupby("algorithm"):
        label = LEARNERS[method]
        ax.errorbar(own.alpha, own.mean_return, own.ci95, capsize=2, marker="o", ms=4, label=label)
    unshaped = printed[(printed.potential == "none") & ~printed.sensor]
    rates = [table_3_1.Config().alpha(method) for method in unshaped.algorithm]
    ax.plot(rates, unshaped.printed_mean, "D", color=PRINTED, label="printed")
    ax.set(xlabel="learning rate", ylabel="total reward [$10^4$]")
    ax.legend()
    return fig
