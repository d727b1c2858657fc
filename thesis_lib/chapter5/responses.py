"""What an impulse and a step do to untrained networks (section 5.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.chapter5.gain import net_panels
from thesis_lib.chapter5.networks import NETS, random_direction, rms, untrained_net
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.plots import COLOURS
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.policies.response import respond


@dataclass(frozen=True)
class Config:
    """Which networks, and which signals."""

    task: str = "Hopper"
    """Whose sizes and control step are used."""
    seeds: int = 5
    """Networks of each kind."""
    size: float = 1.0
    """Height of impulse and step."""
    onset: int = 10
    """Control step at which they come."""
    steps: int = 200
    """Control steps shown."""


@dataclass(frozen=True)
class Moment:
    """The response of one network at one time."""

    net: str
    """A key of NETS."""
    seed: int
    """Seed of the initial weights and of the direction of the input."""
    signal: str
    """impulse or step."""
    time: float
    """Since the signal came [s]."""
    response: float
    """Root mean square over the actions of what the signal changes in the mean action."""


@experiment(
    "ch5-responses",
    item="Section 5.2",
    smoke=Config(seeds=1, steps=40),
    book=Config(),
    seconds=0.8,
)
def moments(config: Config, context: Context) -> list[Moment]:
    """Response of every architecture to an impulse and a step, before training."""
    steps = np.arange(config.steps)
    signals = {"impulse": steps == config.onset, "step": steps >= config.onset}
    seconds = (steps - config.onset) * ROBOTS[config.task].control_dt
    records = []
    for name in NETS:
        for seed in range(config.seeds):
            policy = untrained_net(name, config.task, seed)
            direction = random_direction(policy.observation_size, context.seeds(1, seed)[0])
            quiet = respond(policy, np.zeros(config.steps), direction)
            for signal, shape in signals.items():
                moved = rms(respond(policy, config.size * shape, direction) - quiet)
                records += [
                    Moment(name, seed, signal, time, response)
                    for time, response in zip(seconds, moved, strict=True)
                ]
    return records


def figure(table: pd.DataFrame) -> Figure:
    """Response to an impulse and to a step, each over its largest value; one line a network."""
    fig, axes, spare = net_panels(table.net.unique(), 1.8)
    colours = {"impulse": COLOURS[1], "step": COLOURS[0]}
    for ax, (_, own) in zip(axes, table.groupby("net", sort=False), strict=True):
        for signal, colour in colours.items():
            chosen = own[own.signal == signal]
            for _, one in chosen.groupby("seed"):
                ax.plot(one.time, one.response / one.response.max(), color=colour, lw=0.9)
    axes[0].set(ylim=(-0.03, 1.05), xlim=(table.time.min(), table.time.max()))
    for signal, colour in colours.items():
        spare.plot([], color=colour, label=signal)
    spare.legend(loc="center", title="response to")
    fig.supxlabel("time since the signal came [s]", fontsize=11)
    fig.supylabel("response / largest response", fontsize=11)
    return fig
