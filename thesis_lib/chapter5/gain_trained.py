"""What training makes of networks as filters (section 5.2)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.chapter5.gain import Point, Spectrum, bands, logarithmic, low_pass, net_panels
from thesis_lib.chapter5.networks import (
    GAIT,
    SLOW,
    gain_shares,
    low_to_high,
    random_direction,
)
from thesis_lib.checkout import repository_root
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, criterion
from thesis_lib.edition.plots import COLOURS
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.training.parts import make_run_policy
from thesis_lib.training.trained import Trained, TrainedPolicies

POLICIES = "results/trained/policies.pt"
"""The policies committed with the book: recurrent networks on one task."""


def committed(policies: str) -> list[Trained]:
    """The runs in a file of ``thesis sweep``, below the checkout unless its path is absolute."""
    file = TrainedPolicies(repository_root() / Path(policies))
    return [file.load(name) for name in file.names]


def net_name(run: Trained) -> str:
    """Name of a run's network; of a CTRNN with the initial time constant."""
    name = run.config.architecture.upper()
    return f"{name}, {run.config.time_constant:g} s" if name == "CTRNN" else name


@dataclass(frozen=True)
class Config(Spectrum):
    """Which trained policies are measured, and how."""

    steps: int = 2**14
    """Length of the noise."""
    policies: str = POLICIES
    """A file of ``thesis sweep`` with runs on one task; below the checkout unless absolute."""


@dataclass(frozen=True)
class StagePoint(Point):
    """Gain of one network at one frequency, before or after training."""

    task: str
    """Robot."""
    stage: str
    """before or after training."""


@experiment(
    "ch5-gain-trained",
    item="Section 5.2",
    smoke=Config(steps=2048, segment=256),
    book=Config(steps=2**13),
    thesis=Config(steps=2**15),
    seconds=25,
)
def before_and_after(config: Config, context: Context) -> list[StagePoint]:
    """Gain of the recurrent architectures over frequency, before and after training."""

    def measure(run: Trained) -> list[StagePoint]:
        task, seed = run.config.task, run.config.seed
        dt = ROBOTS[task].control_dt
        along, noise = context.seeds(2, seed)
        direction = random_direction(run.policy.observation_size, along)
        stages = {"before": make_run_policy(run.config), "after": run.policy}
        return [
            StagePoint(net_name(run), seed, *point, task=task, stage=stage)
            for stage, policy in stages.items()
            for point in config.points(policy, dt, direction, np.random.default_rng(noise))
        ]

    runs = committed(config.policies)
    return [point for found in context.map(measure, runs, "networks") for point in found]


@criterion("5.2-low-pass-trained", before_and_after)
def low_pass_after_training(table: pd.DataFrame) -> Finding:
    """Gain at the frequencies of noise over that of slow signals, after training."""
    return low_pass(table[table.stage == "after"], "after training")


STAGES = {"before": (COLOURS[5], "--"), "after": (COLOURS[1], "-")}
"""Colour and line of networks before and after training."""


def figure(table: pd.DataFrame) -> Figure:
    """Gain over frequency, over that at the lowest frequencies, before and after training.

    Lines are geometric means over networks, and bands go from the least to the largest.
    """
    fig, axes, legend = net_panels(table.net.unique(), 2.2, spare=False)
    for ax, (_, own) in zip(axes, table.groupby("net", sort=False), strict=True):
        for stage, (colour, style) in STAGES.items():
            wide = own[own.stage == stage].pivot(index="frequency", columns="seed", values="gain")
            wide /= wide[wide.index < SLOW].mean()
            parts = logarithmic(len(wide))
            logs = np.log(np.array([wide.iloc[p].mean() for p in parts]))
            x = [wide.index[p].to_numpy().mean() for p in parts]
            ax.loglog(x, np.exp(logs.mean(axis=1)), style, color=colour, lw=1.4)
            low, high = np.exp(logs.min(axis=1)), np.exp(logs.max(axis=1))
            ax.fill_between(x, low, high, color=colour, alpha=0.2, lw=0)
    axes[0].set(ylim=(5e-3, 12), xlim=(table.frequency.min(), table.frequency.max()))
    for stage, (colour, style) in STAGES.items():
        legend.plot([], ls=style, color=colour, label=f"{stage} training")
    legend.legend(loc="lower left", fontsize=8.5)
    fig.supxlabel("frequency [Hz]", fontsize=11)
    fig.supylabel(f"gain / gain below {SLOW:g} Hz", fontsize=11)
    return fig


def shown(table: pd.DataFrame, gait: float = GAIT) -> pd.DataFrame:
    """What each network leaves of a gait and of noise: means before and after, range after.

    Parameters
    ----------
    table
        Of :data:`before_and_after`.
    gait
        Frequency of the robot's gait [Hz].
    """
    records = []
    for net, own in table.groupby("net", sort=False):
        before, after = (gain_shares(own[own.stage == stage], gait) for stage in STAGES)
        record: dict[str, object] = {"network": net}
        for column, heading in bands(gait).items():
            record[heading] = (
                f"{before[column].mean():.2f} → {after[column].mean():.2f} "
                f"({low_to_high(after[column])})"
            )
        records.append(record)
    return pd.DataFrame(records)
