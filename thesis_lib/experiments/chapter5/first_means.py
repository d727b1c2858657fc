"""Mean actions of networks before training, on the states they visit (section 5.4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import torch

from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.optimisation import collect, make_batch
from thesis_lib.policies import ARCHITECTURES
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.parts import make_batch_task, make_run_policy

SLOW_TO_MAKE = ("Ant", "esn")
"""A reservoir of 3256 units, left out: it takes as long as all other networks together."""


@dataclass(frozen=True)
class FirstMeansConfig:
    """Settings of section-5.4-first-means."""

    robots: tuple[str, ...] = tuple(ROBOTS)
    """Robots."""
    architectures: tuple[str, ...] = tuple(ARCHITECTURES)
    """Networks."""
    seeds: int = 3
    """Networks of each kind."""
    steps: int = 1000
    """Control steps: whole episodes of at most 500, as in training."""


def first_means(config: FirstMeansConfig, context: Context) -> pd.DataFrame:
    """Size of the mean action before training; columns as in :data:`SECTION_5_4_FIRST_MEANS`."""

    def measure(job: tuple[str, str, int]) -> dict[str, Any]:
        robot, net, index = job
        run = TrainConfig(
            task=robot, architecture=net, seed=context.seed + index, batch_steps=config.steps
        )
        task = make_batch_task(run)
        policy = make_run_policy(run)
        (noise,) = context.seeds(1, 5, 12, list(ROBOTS).index(robot), index)
        rollouts = collect(task, policy, config.steps, np.random.default_rng(noise))
        batch = make_batch(policy, rollouts, np.zeros(len(rollouts.rewards)))
        with torch.no_grad():
            mean = policy.means(batch.sequences).double().numpy()
        return {
            "robot": robot,
            "net": net,
            "seed": run.seed,
            "rms": np.sqrt(np.mean(mean**2)),
            "lean": np.sqrt(np.mean(mean.mean(axis=0) ** 2)),
            "steps": len(mean),
        }

    jobs = [
        (robot, net, index)
        for robot in config.robots
        for net in config.architectures
        for index in range(config.seeds)
        if (robot, net) != SLOW_TO_MAKE
    ]
    return rows(context.map(measure, jobs, "networks"))


SECTION_5_4_FIRST_MEANS = Experiment(
    id="section-5.4-first-means",
    item="Section 5.4",
    title="Mean actions of every network before training, on the states it visits",
    function=first_means,
    budgets={
        "smoke": FirstMeansConfig(("Hopper",), ("ffwd", "dtrnn", "ctrnn", "esn"), 1, 50),
        "book": FirstMeansConfig(),
        "thesis": FirstMeansConfig(),
    },
    columns={
        "robot": "name",
        "net": "architecture",
        "seed": "of the initial weights and of the worlds",
        "rms": "root mean square of the mean action over states and motors; 1 is full torque, and "
        "the standard deviation of the noise",
        "lean": "the same of its average over states: what does not depend on the state",
        "steps": "states visited",
    },
    seconds={"smoke": 0.5, "book": 10, "thesis": 10},
)
