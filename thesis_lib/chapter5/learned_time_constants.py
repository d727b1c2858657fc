"""The time constants that training ends with (section 5.2.2)."""

from __future__ import annotations

from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.chapter5.gain_trained import POLICIES, committed, net_name
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.plots import COLOURS, PRINTED
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.policies import CTRNN


@dataclass(frozen=True)
class Config:
    """Which trained policies are read."""

    policies: str = POLICIES
    """A file of ``thesis sweep`` with runs on one task; below the checkout unless absolute."""


@dataclass(frozen=True)
class Unit:
    """One hidden unit of one CTRNN."""

    task: str
    """Robot."""
    net: str
    """Network, with the initial time constant."""
    seed: int
    """Seed of the run."""
    unit: int
    """Hidden unit."""
    initial: float
    """Time constant before training [s]."""
    learned: float
    """After training [s]."""


@experiment(
    "ch5-time-constants",
    item="Section 5.2.2",
    smoke=Config(),
    book=Config(),
    seconds=0.9,
)
def by_unit(config: Config, context: Context) -> list[Unit]:
    """Time constants that training ends with."""
    return [
        Unit(run.config.task, net_name(run), run.config.seed, i, run.config.time_constant, tau)
        for run in committed(config.policies)
        if isinstance(run.policy, CTRNN)
        for i, tau in enumerate(run.policy.time_constants().detach().double().tolist())
    ]


def figure(table: pd.DataFrame) -> Figure:
    """Share of units with a time constant below x, a line a network, by the initial value."""
    dt = ROBOTS[table.task.iloc[0]].control_dt
    starts = sorted(table.initial.unique(), reverse=True)
    fig, axes = plt.subplots(1, len(starts), figsize=(7.2, 2.9), sharey=True, squeeze=False)
    for ax, start in zip(axes.flat, starts, strict=True):
        for _, own in table[table.initial == start].groupby("seed"):
            ordered = np.sort(own.learned)
            share = np.arange(1, len(ordered) + 1) / len(ordered)
            ax.step(ordered, share, where="post", color=COLOURS[0], lw=1.0)
        ax.axvline(start, color=PRINTED, ls="--", lw=1, label="before training")
        ax.axvline(dt, color=COLOURS[1], ls=":", lw=1.2, label="control step")
        ax.set(xscale="log", xlabel=r"time constant $\tau$ [s]")
        ax.set_title(f"starting at {start:g} s", fontsize=10)
    axes[0, 0].set_ylabel("share of units")
    axes[0, 0].legend(fontsize=8.5)
    return fig


def reading(table: pd.DataFrame) -> str:
    """Where the time constants end, by where they start, in sentences."""
    step = ROBOTS[table.task.iloc[0]].control_dt
    sentences = []
    for start, own in sorted(table.groupby("initial").learned, reverse=True):
        held = int((own <= 1.001 * step).sum())
        sentences.append(
            f"Of those that start at {start:g} s {(own < 0.5 * start).mean():.0%} end below half "
            f"of it, the median at {own.median():.2f} s and the longest at {own.max():.2f} s; the "
            f"clamp holds {held} of {len(own)} at the control step."
        )
    return " ".join(sentences)
