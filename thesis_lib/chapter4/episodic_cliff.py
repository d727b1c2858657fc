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
from thesis_lib.chapter4.protocol import Protocol, Selected, ahead, behind, wider
from thesis_lib.chapter4.runs import Target
from thesis_lib.edition.criteria import LEVEL, graded, judged, summary
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion, effect_of
from thesis_lib.edition.plots import legend_of
from thesis_lib.stats import welch

MARGIN = 0.05
"""Share of the return within which two are alike."""


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
    own = star[star.method == "none"].sort_values("tasks_seen")
    first, last = (_no_higher(own, end) for end in (own.iloc[0], own.iloc[-1]))
    one_way = max(first, last) == len(own) - 1
    return judged(
        continuing,
        f"{words} Of the {len(own) - 1} other returns on the continuing cliff {first} are shown "
        f"to be at most {MARGIN:.0%} above the first, and {last} above the last (one-sided Welch).",
        {"no higher than the first": first, "no higher than the last": last},
        direction=other,
        otherwise=Verdict.NOT_REPRODUCED if one_way else Verdict.INCONCLUSIVE,
    )


def _no_higher(own: pd.DataFrame, end: pd.Series) -> int:
    """How many other returns are shown to be at most 5% of one above it.

    Where all are, the return does not rise from that end, or fall to it: since each must be shown,
    none of the tests is corrected for the others.
    """
    others = own[own.tasks_seen != end.tasks_seen]
    tests = (welch(summary(r), summary(end), level=1 - 2 * LEVEL) for _, r in others.iterrows())
    return sum(t.high < MARGIN * abs(end.mean_return) for t in tests)


@effect_of("4.3-cliff-domain", figure_4_4.with_q_star, with_either)
def which_cliff(star: pd.DataFrame, episodic: pd.DataFrame) -> str:
    """What becomes of the return without selection on either cliff."""
    words = _turns(star, episodic)[1]
    return f"Return without selection over the number of tasks, with Q*. {words}"


@criterion("4.3-cliff-random", figure_4_4.with_q_star, figure_4_4.with_q_tilde, with_either)
def random_is_inferior(star: pd.DataFrame, tilde: pd.DataFrame, episodic: pd.DataFrame) -> Finding:
    """Random features against no selection, paired, on either cliff."""
    tables = dict(zip(NAMES, (star, tilde), strict=True))
    rows = pd.concat(
        [t[t.method == "random"].assign(target=name) for name, t in tables.items()],
        ignore_index=True,
    )
    inferior = ahead(rows, "none_minus")
    listed = "; ".join(
        f"{name}: worse at {worse.sum()} of {len(worse)} numbers of tasks"
        for name, worse in inferior.groupby(rows.target, sort=False)
    )
    late = rows[rows.tasks_seen >= 2]
    better = -late.none_minus > late.none_minus_ci95 * wider(len(late))
    margin = MARGIN * (late.mean_return + late.none_minus).abs()
    alike = ~inferior[late.index] & (late.none_minus.abs() + late.none_minus_ci95 < margin)
    mostly = (alike.groupby(late.target).mean() > 0.5).any()
    own = episodic[(episodic.method == "random") & (episodic.potential == "Q_star")]
    return Finding(
        graded(
            inferior[late.index].all(),
            denied=better.any(),
            otherwise=Verdict.NOT_REPRODUCED if mostly else Verdict.INCONCLUSIVE,
        ),
        f"Continuing cliff, {listed}. From two tasks on they are better at {better.sum()} "
        f"(corrected for all {len(late)}) and shown to be within {MARGIN:.0%} of the return "
        f"without selection at {alike.sum()}. On the episodic cliff with Q* random features are "
        f"better at {behind(own, 'none_minus').sum()} of {len(own)}.",
        {"worse": int(inferior[late.index].sum()), "better": int(better.sum())},
    )


def figure(table: pd.DataFrame) -> Figure:
    """Returns with either potential, in units of 10^4."""
    fig, axes = plt.subplots(1, 2, figsize=(7.2, 3.6), sharey=True)
    titles = {"Q_star": "$Q^*_d$", "Q_tilde": r"$\tilde Q_d$"}
    for ax, (target, title) in zip(axes, titles.items(), strict=True):
        looks.returns(ax, table[table.potential == target], unit=1e4)
        ax.set_title(title)
    axes[0].set_ylabel("return of a run [$10^4$]")
    legend_of(axes[0], 3, fontsize=8)
    return fig
