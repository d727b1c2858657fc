"""What noise of standard deviation 1 is to each sensor (section 5.1)."""

from __future__ import annotations

from dataclasses import dataclass, field

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.arrays import FloatArray
from thesis_lib.chapter5.open_loop import CONTROLLERS, NAME, SMOKE_SEARCH, Search, find_gait
from thesis_lib.chapter5.untrained import run_episodes, untrained
from thesis_lib.edition.criteria import exact, judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, criterion
from thesis_lib.edition.plots import PRINTED, legend_of
from thesis_lib.locomotion.batch import BatchTask
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.locomotion.tasks import HORIZON

SIGNIFICANT_SHARE = 0.5
"""Noise counts as a significant perturbation of a sensor from this share of its own standard
deviation on: it then takes a fifth of what the sensor's variance tells."""


@dataclass(frozen=True)
class Config:
    """What is watched to learn how far each sensor ranges."""

    search: Search = field(default_factory=Search)
    n_episodes: int = 50
    horizon: int = HORIZON
    sigma: float = 1.0


@dataclass(frozen=True)
class Sensor:
    """One sensor under one controller."""

    task: str
    """Name."""
    controller: str
    """untrained or open-loop gait, on flat ground."""
    index: int
    """Place in the observation."""
    sensor: str
    """Name."""
    group: str
    """Kind of sensor."""
    unit: str
    """Of the sensor and of the next columns."""
    observations: int
    """How many were watched."""
    sd: float
    """Standard deviation over all of them."""
    low: float
    """Least value seen."""
    high: float
    """Greatest value seen."""
    zero: float
    """Share of observations that are exactly 0."""
    sigma: float
    """Standard deviation of the noise."""


@experiment(
    "ch5-noise",
    item="Section 5.1, Sensor noise",
    smoke=Config(search=SMOKE_SEARCH, n_episodes=3, horizon=40),
    book=Config(n_episodes=20),
    thesis=Config(n_episodes=400),
    seconds=4,
)
def by_sensor(config: Config, context: Context) -> list[Sensor]:
    """How far each sensor ranges by itself, beside noise of standard deviation 1."""

    def measure(job: tuple[str, str]) -> list[Sensor]:
        robot, controller = job
        n, cell = config.n_episodes, list(ROBOTS).index(robot)
        (seed,) = context.seeds(1, 5, 9, cell)
        if controller == NAME:
            act = find_gait(robot, config.search, context.seed).controller(n)
        else:
            act = untrained(robot, context.seeds(n, 5, 10, cell))
        batch = BatchTask(robot, n, seed=seed, max_episode_steps=config.horizon)
        seen: list[FloatArray] = []
        run_episodes(batch, act, config.horizon, watch=seen.append)
        values = np.concatenate(seen)
        return [
            Sensor(
                *(robot, controller, i, sensor.name, sensor.group, sensor.unit, len(values)),
                sd=values[:, i].std(),
                low=values[:, i].min(),
                high=values[:, i].max(),
                zero=(values[:, i] == 0).mean(),
                sigma=config.sigma,
            )
            for i, sensor in enumerate(batch.task.sensors)
        ]

    jobs = [(robot, controller) for robot in ROBOTS for controller in CONTROLLERS]
    return [record for found in context.map(measure, jobs, "noise") for record in found]


@criterion("5.1-joint-angles", by_sensor)
def joint_angle_range(table: pd.DataFrame) -> Finding:
    """Largest joint angle seen in each robot."""
    angles = table[table.group == "joint angle"]
    largest = angles[["low", "high"]].abs().max(axis=1).groupby(angles.task).max()
    beyond = largest[largest > np.pi / 2]
    parts = ", ".join(f"{robot} {value:.2f}" for robot, value in largest.items())
    evidence = f"Largest joint angles seen, rad, to be compared with π/2 = 1.57: {parts}."
    if len(beyond):
        evidence += f" {', '.join(beyond.index)} go beyond, within their limits."
    return exact(beyond.empty, evidence)


@criterion("5.1-joint-velocities", by_sensor)
def velocities_range_wider(table: pd.DataFrame) -> Finding:
    """Spread of joint velocities over that of joint angles, by robot and controller."""
    spread = table.groupby(["task", "controller", "group"]).sd.median().unstack()
    ratio = spread["joint velocity"] / spread["joint angle"]
    return judged(
        (ratio > 1).all(),
        "Numbers in rad/s spread "
        f"{ratio.min():.1f} to {ratio.max():.1f} times as wide as numbers in rad, over "
        f"{len(ratio)} pairs of robot and controller.",
    )


def hit(table: pd.DataFrame) -> pd.Series:
    """Share of a robot's moving sensors that the noise hits significantly, under the gait."""
    own = table[(table.controller == NAME) & (table.sd > 0)]
    return (own.sigma / own.sd >= SIGNIFICANT_SHARE).groupby(own.task).mean()


@criterion("5.1-sigma-significant", by_sensor)
def sigma_is_significant(table: pd.DataFrame) -> Finding:
    """Share of sensors whose own spread is at most twice the noise, by robot."""
    share = hit(table)
    parts = ", ".join(f"{robot} {value:.0%}" for robot, value in share.items())
    return judged(
        (share > 0.5).all(),
        f"Sensors hit by at least {SIGNIFICANT_SHARE:g} of their own standard deviation under the "
        f"{NAME}: {parts}; sensors that never move are left out.",
    )


@criterion("5.1-contacts-sparse", by_sensor)
def contacts_are_sparse(table: pd.DataFrame) -> Finding:
    """Share of the ant's contact entries that are exactly zero."""
    zero = table[table.group == "contact force"].groupby("controller", sort=False).zero.mean()
    parts = ", ".join(f"{controller} {share:.0%}" for controller, share in zero.items())
    return judged(
        (zero > 0.5).all(),
        f"Share of the ant's contact entries that are exactly 0: {parts}.",
    )


def figure(table: pd.DataFrame) -> Figure:
    """Noise over each moving sensor's own spread, by kind of sensor, one panel a robot."""
    table = table[table.sd > 0].assign(share=lambda t: t.sigma / t.sd)
    groups = list(dict.fromkeys(table.group))
    fig, axes = plt.subplots(1, len(ROBOTS), sharey=True, sharex=True, figsize=(7.2, 3.6))
    for ax, robot in zip(axes, ROBOTS, strict=True):
        own = table[table.task == robot]
        for offset, (controller, colour) in zip((0.15, -0.15), CONTROLLERS.items(), strict=True):
            at = own[own.controller == controller]
            y = np.array([groups.index(g) for g in at.group])
            ax.plot(at.share, -y + offset, "o", ms=3, mfc="none", mew=0.7, color=colour)
            middle = at.groupby("group").share.median()
            places = [-groups.index(str(g)) + offset for g in middle.index]
            ax.plot(middle, places, "|", ms=9, mew=2.2, color=colour)
        ax.axvline(1, color=PRINTED, lw=1, ls=":")
        ax.set_xscale("log")
        ax.set_title(robot, fontsize=9)
        ax.tick_params(labelsize=8)
        ax.set_xticks([0.1, 10, 1000], ["0.1", "10", "1000"])
        ax.minorticks_off()
    axes[0].set_yticks([-i for i in range(len(groups))], groups)
    fig.supxlabel("noise / the sensor's own standard deviation", fontsize=10)
    for controller, colour in CONTROLLERS.items():
        axes[0].plot([], "o", mfc="none", color=colour, label=controller)
    legend_of(axes[0], 2, "upper right")
    return fig


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Median of noise over spread under the gait, by kind of sensor (rows) and robot (columns)."""
    own = table[(table.sd > 0) & (table.controller == NAME)]
    share = (own.sigma / own.sd).groupby([own.group, own.task], sort=False).median()
    wide = share.unstack()[list(ROBOTS)]
    return wide.rename_axis(None, axis=1).rename_axis("kind of sensor").reset_index()
