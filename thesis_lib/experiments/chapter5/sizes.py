"""Sizes of the networks, by the rules of section 5.4."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pandas as pd

from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.locomotion.perturbations import occlusion
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.locomotion.tasks import make_task
from thesis_lib.policies import ARCHITECTURES, make_policy, recurrent_units

RECURRENT = ("dtrnn", "ctrnn", "lstm", "gru", "esn")
"""Networks with a state, which table 5.1 gives fewer sensors on two tasks."""


@dataclass(frozen=True)
class SizesConfig:
    """Settings of section-5.4-sizes."""

    largest_reservoir: int = 4000
    """Reservoirs of more units are not built and their rows left out."""


def learned(architecture: str, inputs: int, actions: int, units: int) -> int:
    """Number of learned parameters, counted from the equations of section 5.2.

    Parameters
    ----------
    architecture
        ``dtrnn``, ``ctrnn``, ``lstm``, ``gru``, ``esn`` or ``ffwd``.
    inputs
        Length of the network's input, previous action included where it is used.
    actions
        dim(a).
    units
        N.

    Returns
    -------
    int
        Weights, biases, learned initial states and time constants, the output layer and
        the standard deviations.
    """
    output = units * actions + 2 * actions
    layer = inputs * units + units
    if architecture == "ffwd":
        return layer + output
    if architecture == "esn":
        return output
    recurrent = layer + units * units
    gates = {"lstm": 4, "gru": 3}.get(architecture, 1)
    start = units if architecture in ("dtrnn", "ctrnn") else 0
    time_constants = units if architecture == "ctrnn" else 0
    return gates * recurrent + start + time_constants + output


def sizes(config: SizesConfig, context: Context) -> pd.DataFrame:
    """Units and parameters of every network on every task."""
    records = []
    for task, robot in ROBOTS.items():
        made = make_task(task)
        subset = occlusion(task)
        for net in ARCHITECTURES:
            choices: list[list[int] | None] = [None]
            if subset is not None and net in RECURRENT:
                choices.append([int(i) for i in subset.keep])
            for features in choices:
                seen = made.observation_size if features is None else len(features)
                units = recurrent_units(net, seen, made.action_size)
                if net == "esn" and units > config.largest_reservoir:
                    continue
                policy = make_policy(
                    net,
                    made.observation_size,
                    made.action_size,
                    dt=robot.control_dt,
                    features=features,
                )
                total = sum(p.numel() for n, p in policy.named_parameters() if n != "h0")
                counted = sum(p.numel() for n, p in policy.trainable().items() if n != "h0")
                records.append(
                    {
                        "task": task,
                        "net": net,
                        "features": seen,
                        "thesis": features is not None or len(choices) == 1,
                        "units": policy.hidden_size,
                        "learned": policy.n_trainable,
                        "fixed": total - counted,
                        "actions": made.action_size,
                    }
                )
    return rows(records)


SECTION_5_4_SIZES = Experiment(
    id="section-5.4-sizes",
    item="Section 5.4",
    title="Units and learned parameters of every network on every task",
    function=sizes,
    budgets={
        "smoke": SizesConfig(largest_reservoir=300),
        "book": SizesConfig(),
        "thesis": SizesConfig(),
    },
    columns={
        "task": "name of the robot",
        "net": "architecture",
        "features": "observations the network sees",
        "thesis": "whether table 5.1 lets it see just these",
        "units": "units of the last hidden layer",
        "learned": "learned parameters, standard deviations included",
        "fixed": "weights that are drawn and never learned",
        "actions": "dim(a)",
    },
    seconds={"smoke": 0.3, "book": 10, "thesis": 10},
)

EXPERIMENTS: tuple[Experiment[Any], ...] = (SECTION_5_4_SIZES,)
"""Those of this module."""
