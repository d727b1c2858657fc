"""Figures 4.4 and 4.5 on the other cliff, and what depends on which cliff is meant."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import get_args

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.chapter3.runs import SETTINGS, TabularLearner
from thesis_lib.chapter4 import figure_4_4, looks
from thesis_lib.chapter4.figure_4_4 import METHODS, NAMES, SMALL, turns
from thesis_lib.chapter4.protocol import Protocol, Selected, ahead, behind
from thesis_lib.chapter4.runs import Target
from thesis_lib.edition.criteria import judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, criterion, effect_of


@dataclass(frozen=True)
class Config:
    """Settings of figures 4.4 and 4.5 on the other cliff."""

    star: figure_4_4.Config = field(
        default_factory=lambda: figure_4_4.Config(
            cliff="episodic",
            learner=SETTINGS["episodic cliff with sensor"].learners[0],
            protocol=Protocol(runs=100, tasks_seen=(1, 2, 3, 4, 5, 8, 12), methods=METHODS),
        )
    )
    """With Q*; the same is run with Q~."""


@dataclass(frozen=True)
class PotentialSelected(Selected):
    """One method with one potential after one number of observed tasks."""

    potential: str
    """Q_star or Q_tilde."""


SMOKE = figure_4_4.Config(
    cliff="episodic",
    learner=TabularLearner("q_learning", 1.0, 0.1, episodes=20),
    protocol=SMALL,
)


@experiment(
    "ch4-episodic-cliff",
    item="Figures 4.4 and 4.5 on the episodic cliff",
    smoke=Config(SMOKE),
    book=Config(),
    seconds=15,
)
def with_either(config: Config, context: Context) -> list[PotentialSelected]:
    """Feature selection on the episodic cliff with sensor, with either potential."""
    return [
        PotentialSelected(potential=target, **fields)
        for target in get_args(Target)
        for fields in figure_4_4.measured(replace(config.star, target=target), context)
    ]


def _turns(star: pd.DataFrame, episodic: pd.DataFrame) -> tuple[list[bool], str]:
    """Whether the return with Q* turns on the continuing and on the episodic cliff."""
    own = turns(star), turns(episodic[episodic.potential == "Q_star"])
    words = f"Continuing cliff: {own[0][1]}. Episodic cliff: {own[1][1]}."
    return [turn for turn, _ in own], words


@criterion("4.3-cliff-turns", figure_4_4.with_q_star, with_either)
def q_star_turns(star: pd.DataFrame, episodic: pd.DataFrame) -> Finding:
    """The rise and decline of Q* without selection, on either cliff."""
    (continuing, other), words = _turns(star, episodic)
    return judged(continuing, words, direction=other)


@effect_of("4.3-cliff-domain", figure_4_4.with_q_star, with_either)
def which_cliff(star: pd.DataFrame, episodic: pd.DataFrame) -> str:
    """What becomes of the return without selection on either cliff."""
    words = _turns(star, episodic)[1]
    return f"Return without selection over the number of tasks, with Q*. {words}"


@criterion("4.3-cliff-random", figure_4_4.with_q_star, figure_4_4.with_q_tilde, with_either)
def random_is_inferior(star: pd.DataFrame, tilde: pd.DataFrame, episodic: pd.DataFrame) -> Finding:
    """Random features against no selection, paired, on either cliff."""
    listed, holds = [], []
    for name, table in zip(NAMES, (star, tilde), strict=True):
        own = table[table.method == "random"]
        inferior = ahead(own, "none_minus")
        holds.append(bool((inferior | (own.tasks_seen < 2)).all()))
        listed.append(f"{name}: worse at {inferior.sum()} of {len(own)} numbers of tasks")
    own = episodic[(episodic.method == "random") & (episodic.potential == "Q_star")]
    return judged(
        all(holds),
        f"Continuing cliff, {'; '.join(listed)}. On the episodic cliff with Q* random features are "
        f"better at {behind(own, 'none_minus').sum()} of {len(own)}.",
    )


def figure(table: pd.DataFrame) -> Figure:
    """Returns with either potential, in units of 10^4."""
    fig, axes = plt.subplots(1, 2, figsize=(7.2, 3.6), sharey=True)
    titles = {"Q_star": "$Q^*_d$", "Q_tilde": r"$\tilde Q_d$"}
    for ax, (target, title) in zip(axes, titles.items(), strict=True):
        looks.returns(ax, table[table.potential == target], unit=1e4)
        ax.set_title(title)
    axes[0].set_ylabel("return of a run [$10^4$]")
    handles = axes[0].get_legend_handles_labels()
    fig.legend(*handles, ncols=3, loc="outside lower center", fontsize=8)
    return fig
