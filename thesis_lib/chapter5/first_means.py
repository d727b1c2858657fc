"""Mean actions of networks before training, on the states they visit (section 5.4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch

from thesis_lib.chapter5.networks import NAMES, low_to_high
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.optimisation import collect, make_batch
from thesis_lib.policies import ARCHITECTURES
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.parts import make_batch_task, make_run_policy

SLOW_TO_MAKE = ("Ant", "esn")
"""A reservoir of 3256 units, left out: it takes as long as all other networks together."""


@dataclass(frozen=True)
class Config:
    """Which networks, and how many states."""

    robots: tuple[str, ...] = tuple(ROBOTS)
    """Robots."""
    architectures: tuple[str, ...] = tuple(ARCHITECTURES)
    """Networks."""
    seeds: int = 3
    """Networks of each kind."""
    steps: int = 1000
    """Control steps: whole episodes of at most 500, as in training."""


@dataclass(frozen=True)
class Size:
    """The mean action of one network."""

    task: str
    """Robot."""
    architecture: str
    """Network."""
    seed: int
    """Of the initial weights and of the worlds."""
    rms: float
    """Root mean square of the mean action over states and motors; 1 is full torque, and the
    standard deviation of the noise."""
    bias: float
    """The same of its average over states: what does not depend on the state."""
    steps: int
    """States visited."""


@experiment(
    "ch5-first-means",
    item="Section 5.4",
    smoke=Config(("Hopper",), ("ffwd", "dtrnn", "ctrnn", "esn"), 1, 50),
    book=Config(seeds=1),
    seconds=12,
)
def sizes(config: Config, context: Context) -> list[Size]:
    """Mean actions of every network before training, on the states it visits."""

    def measure(job: tuple[str, str, int]) -> Size:
        task, net, index = job
        run = TrainConfig(
            task=task, architecture=net, seed=context.seed + index, batch_steps=config.steps
        )
        batch_task, policy = make_batch_task(run), make_run_policy(run)
        (noise,) = context.seeds(1, 5, 12, list(ROBOTS).index(task), index)
        rollouts = collect(batch_task, policy, config.steps, np.random.default_rng(noise))
        batch = make_batch(policy, rollouts, np.zeros(len(rollouts.rewards)))
        with torch.no_grad():
            mean = policy.means(batch.sequences).double().numpy()
        size, bias = (np.sqrt(np.mean(m**2)) for m in (mean, mean.mean(axis=0)))
        return Size(task, net, run.seed, size, bias, len(mean))

    jobs = [
        (task, net, index)
        for task in config.robots
        for net in config.architectures
        for index in range(config.seeds)
        if (task, net) != SLOW_TO_MAKE
    ]
    return context.map(measure, jobs, "networks")


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Size of the mean action before training: mean, and range over robots and networks."""
    columns = {"rms": "mean action", "bias": "of it, the same everywhere"}
    return pd.DataFrame(
        [
            {"network": name}
            | {
                title: f"{own[column].mean():.2f} ({low_to_high(own[column])})"
                for column, title in columns.items()
            }
            for net, name in NAMES.items()
            if len(own := table[table.architecture == net])
        ]
    )


def reading(table: pd.DataFrame) -> str:
    """Which networks act little before training, and which much, in a sentence."""
    size = table.groupby("architecture").rms.mean().sort_values()
    names = [NAMES[str(net)] for net in size.index]
    rest = size.iloc[1:-1]
    return (
        f"It is smallest beside the noise in the {names[0]}, with {size.iloc[0]:.2f}; in the "
        f"others it is {rest.min():.2f} to {rest.max():.2f}, and largest in the network "
        f"{names[-1]}, with {size.iloc[-1]:.2f}, where 1 is all the motors can do."
    )
