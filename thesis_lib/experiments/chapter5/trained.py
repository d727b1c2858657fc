"""Trained networks as filters: what training makes of gains and time constants (section 5.2)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from thesis_lib.checkout import repository_root
from thesis_lib.edition.experiment import Context, Experiment
from thesis_lib.experiments.chapter5.architectures import GainConfig, gains_of, random_direction
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.policies import CTRNN
from thesis_lib.training.parts import make_run_policy
from thesis_lib.training.trained import Trained, TrainedPolicies


@dataclass(frozen=True)
class TrainedConfig:
    """Settings of the experiments with trained policies."""

    policies: str = "results/trained/policies.pt"
    """A file of ``thesis sweep`` with runs on one task; below the checkout unless absolute."""
    amplitude: float = 1.0
    """Standard deviation of the noise: the perturbation of section 5.4."""
    steps: int = 2**14
    """Length of the noise."""
    segment: int = 512
    """Steps of a segment of the spectrum."""


def _saved(config: TrainedConfig) -> list[Trained]:
    file = TrainedPolicies(repository_root() / Path(config.policies))
    return [file.load(name) for name in file.names]


def net_name(run: Trained) -> str:
    """Name of a run's network; of a CTRNN with the initial time constant."""
    name = run.config.architecture.upper()
    return f"{name}, {run.config.time_constant:g} s" if name == "CTRNN" else name


def gains(config: TrainedConfig, context: Context) -> pd.DataFrame:
    """Gain over frequency of every network, before and after training."""
    measured = GainConfig(amplitude=config.amplitude, steps=config.steps, segment=config.segment)

    def measure(run: Trained) -> pd.DataFrame:
        seed = run.config.seed
        dt = ROBOTS[run.config.task].control_dt
        along, noise = context.seeds(2, seed)
        direction = random_direction(run.policy.observation_size, along)
        stages = {"before": make_run_policy(run.config), "after": run.policy}
        tables = [
            gains_of(policy, dt, direction, np.random.default_rng(noise), measured).assign(
                stage=stage
            )
            for stage, policy in stages.items()
        ]
        keys = {"task": run.config.task, "net": net_name(run), "seed": seed}
        return pd.concat(tables, ignore_index=True).assign(**keys)

    return pd.concat(context.map(measure, _saved(config), "networks"), ignore_index=True)


SECTION_5_2_GAIN_TRAINED = Experiment(
    id="section-5.2-gain-trained",
    item="Section 5.2",
    title="Gain of the recurrent architectures over frequency, before and after training",
    function=gains,
    budgets={
        "smoke": TrainedConfig(steps=2048, segment=256),
        "book": TrainedConfig(),
        "thesis": TrainedConfig(steps=2**15),
    },
    columns={
        "task": "robot",
        "net": "network, with the initial time constant of a CTRNN",
        "seed": "seed of the run and of the direction of the input",
        "stage": "before or after training",
        "frequency": "Hz",
        "gain": "measured with white noise, root mean square over the actions",
        "small_signal_gain": "of the network linearised at rest; empty if it is unstable there",
    },
    seconds={"smoke": 15, "book": 60, "thesis": 120},
)


def time_constants(config: TrainedConfig, context: Context) -> pd.DataFrame:
    """Time constants of every CTRNN's units after training."""
    tables = []
    for run in _saved(config):
        if isinstance(run.policy, CTRNN):
            learned = run.policy.time_constants().detach().double().numpy()
            keys = {"task": run.config.task, "net": net_name(run), "seed": run.config.seed}
            ends = {"initial": run.config.time_constant, "learned": learned}
            tables.append(pd.DataFrame({"unit": np.arange(len(learned)), **ends}).assign(**keys))
    return pd.concat(tables, ignore_index=True)


SECTION_5_2_2_TIME_CONSTANTS = Experiment(
    id="section-5.2.2-time-constants",
    item="Section 5.2.2",
    title="Time constants that training ends with",
    function=time_constants,
    budgets={"smoke": TrainedConfig(), "book": TrainedConfig(), "thesis": TrainedConfig()},
    columns={
        "task": "robot",
        "net": "network, with the initial time constant",
        "seed": "seed of the run",
        "unit": "hidden unit",
        "initial": "time constant before training [s]",
        "learned": "after training [s]",
    },
    seconds={"smoke": 3, "book": 3, "thesis": 3},
)
