"""Whether the jackknife F-test holds its level, and what power it has.

Beside its two null laws stands the rotation test, exact for this Gaussian scatter where tasks
share p(x|m), whatever the number of values.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any, Literal

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import binomtest

from thesis_lib.chapter4.random_solutions import planted_solutions
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.plots import COLOURS, PRINTED
from thesis_lib.selection import JackknifeF, SignFlips
from thesis_lib.selection.base import BackwardElimination

Null = Literal["t2", "box", "rotations"]


@dataclass(frozen=True)
class Config:
    """Settings of the calibration."""

    runs: int = 1000
    """Samples of tasks at each point."""
    tasks_seen: tuple[int, ...] = (3, 4, 5, 6, 8, 12, 20)
    """Numbers of observed tasks."""
    alphas: tuple[float, ...] = (0.01, 0.05, 0.2)
    """Levels of the test."""
    effects: tuple[float, ...] = (0.5, 1.0, 2.0)
    """Mean effect of the relevant feature, in standard deviations between tasks."""
    levels: tuple[int, ...] = (2, 6)
    """Values of the irrelevant feature: its scatter has one direction less."""


@dataclass(frozen=True)
class Kept:
    """How often one feature is kept at one point."""

    null: str
    """Null law: t2, the default, box, or rotations of the tasks' contributions."""
    shared: bool
    """Whether tasks share p(x|m)."""
    levels: int
    """Values of the irrelevant feature."""
    effect: float
    """Mean effect of the relevant feature, in standard deviations between tasks."""
    alpha: float
    """Level of the test."""
    tasks_seen: int
    """Number of observed tasks n."""
    feature: str
    """Relevant or irrelevant."""
    kept: float
    """Share of runs in which it is kept: power, or the size of the test."""
    low: float
    """Low end of the exact 95% binomial interval."""
    high: float
    """Its high end."""
    n_runs: int
    """Samples of n tasks."""


@experiment(
    "ch4-calibration",
    item="Jackknife F (calibration)",
    smoke=Config(runs=5, tasks_seen=(4,), alphas=(0.05,), effects=(1.0,), levels=(2,)),
    book=Config(runs=400),
    thesis=Config(runs=2000),
    seconds=40,
)
def kept(config: Config, context: Context) -> list[Kept]:
    """How often the jackknife F-test keeps an irrelevant and a relevant feature."""

    def one(job: tuple[Null, bool, int, float, int]) -> list[Kept]:
        null, shared, levels, effect, n = job
        counts = np.zeros((len(config.alphas), 2), dtype=int)
        seeds = context.seeds(config.runs, 7, n, round(10 * effect), levels, int(shared))
        for rng in map(np.random.default_rng, seeds):
            solutions = planted_solutions(rng, n, effect, levels=levels, shared=shared)
            for i, alpha in enumerate(config.alphas):
                if null == "rotations":
                    selector: BackwardElimination = SignFlips(alpha, null)
                else:
                    selector = JackknifeF(alpha, null=null)
                counts[i] += selector.fit(solutions).support_
        records = []
        for alpha, own in zip(config.alphas, counts.tolist(), strict=True):
            for feature, count in zip(("relevant", "irrelevant"), own, strict=True):
                ends = binomtest(count, config.runs).proportion_ci(0.95)
                share = (count / config.runs, float(ends.low), float(ends.high), config.runs)
                records.append(Kept(null, shared, levels, effect, alpha, n, feature, *share))
        return records

    nulls: tuple[Null, ...] = ("t2", "box", "rotations")
    jobs = [
        (null, shared, levels, effect, n)
        for null, shared, levels, effect, n in product(
            nulls, (True, False), config.levels, config.effects, config.tasks_seen
        )
        # The other null laws are shown where they differ, and power once.
        if (effect == config.effects[-1] or (shared and levels == 2 and null == "t2"))
    ]
    return [row for part in context.map(one, jobs, "calibration") for row in part]


def _with_interval(ax: Axes, own: pd.DataFrame, shift: float, **look: Any) -> None:
    ends = [own.kept - own.low, own.high - own.kept]
    ax.errorbar(own.tasks_seen + shift, own.kept, yerr=ends, marker="o", ms=3, capsize=2, **look)


def figure(table: pd.DataFrame, alpha: float) -> Figure:
    """Size of the test on irrelevant features, a panel a number of values, and its power."""
    at = table[table.alpha == alpha]
    null = at[(at.feature == "irrelevant") & (at.effect == at.effect.max())]
    panels = list(null.groupby("levels"))
    fig, axes = plt.subplots(1, len(panels) + 1, figsize=(7.2, 3.4), squeeze=False)
    for ax, (levels, own) in zip(axes.flat, panels, strict=False):
        for j, ((law, shared), line) in enumerate(own.groupby(["null", "shared"])):
            look = {
                "color": COLOURS[int(shared)],
                "ls": {"t2": "-", "box": "--", "rotations": ":"}[law],
                "lw": 1,
            }
            label = f"{law}, {'shared' if shared else 'own'} p"
            # Side by side, so that the intervals can be told apart.
            _with_interval(ax, line, 0.13 * (j - 2.5), label=label, **look)
        ax.axhline(alpha, color=PRINTED, lw=1)
        ax.set_title(f"irrelevant, {levels} values", fontsize=9)
        ax.set_ylim(0, 1.05 * null.high.max())
    power = at[(at.feature == "relevant") & at.shared & (at.null == "t2")]
    power = power[power.levels == power.levels.min()]
    last = axes[0, -1]
    for i, (size, own) in enumerate(power.groupby("effect")):
        _with_interval(last, own, 0.0, color=COLOURS[i + 2], label=f"effect {size:g} sd")
    last.set_title("relevant", fontsize=9)
    last.set_ylim(0, 1.05)
    for ax in axes.flat:
        ax.set_xlabel("observed tasks n", fontsize=9)
    axes[0, 0].set_ylabel("share of samples kept")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    more = last.get_legend_handles_labels()
    shown = (handles + more[0], labels + more[1])
    fig.legend(*shown, loc="outside lower center", ncols=4, fontsize=8)
    return fig


def size(
    table: pd.DataFrame, levels: int, *, shared: bool, alpha: float = 0.05, null: Null = "t2"
) -> pd.DataFrame:
    """How often a test keeps the irrelevant feature, by number of tasks.

    Returns
    -------
    DataFrame
        Columns ``kept``, ``low`` and ``high``, at the largest effect of the relevant feature.
    """
    own = table[
        (table.feature == "irrelevant")
        & (table.null == null)
        & (table.alpha == alpha)
        & (table.levels == levels)
        & (table.shared == shared)
        & (table.effect == table.effect.max())
    ]
    return own.set_index("tasks_seen")[["kept", "low", "high"]]
