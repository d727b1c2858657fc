"""Sizes of the networks, by the rules of section 5.4."""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd

from thesis_lib.chapter5.networks import by_network, policy_for
from thesis_lib.edition.criteria import exact
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, criterion, effect_of
from thesis_lib.locomotion.perturbations import occlusion
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.locomotion.tasks import make_task
from thesis_lib.policies import ARCHITECTURES, RECURRENT_NETS, recurrent_units

SAME_SIZE = (0.75, 4 / 3)
"""Two networks have roughly the same number of parameters if the ratio lies between these."""


@dataclass(frozen=True)
class Config:
    """Which networks are built."""

    largest_reservoir: int = 4000
    """Reservoirs of more units are not built and their rows left out."""


@dataclass(frozen=True)
class Size:
    """One network on one task."""

    task: str
    """Name of the robot."""
    architecture: str
    """Network."""
    features: int
    """Observations the network sees."""
    thesis: bool
    """Whether table 5.1 lets it see just these."""
    units: int
    """Units of the last hidden layer."""
    learned: int
    """Learned parameters, standard deviations included."""
    fixed: int
    """Weights that are drawn and never learned."""
    actions: int
    """dim(a)."""


def count(architecture: str, inputs: int, actions: int, units: int) -> int:
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


@experiment(
    "ch5-sizes",
    item="Section 5.4",
    smoke=Config(largest_reservoir=300),
    book=Config(),
    seconds=4,
)
def sizes(config: Config, context: Context) -> list[Size]:
    """Units and learned parameters of every network on every task."""
    records = []
    for task in ROBOTS:
        made, subset = make_task(task), occlusion(task)
        for net in ARCHITECTURES:
            choices: list[list[int] | None] = [None]
            if subset is not None and net in RECURRENT_NETS:
                choices.append([int(i) for i in subset.keep])
            for features in choices:
                seen = made.observation_size if features is None else len(features)
                units = recurrent_units(net, seen, made.action_size)
                if net == "esn" and units > config.largest_reservoir:
                    continue
                policy = policy_for(net, task, features=features)
                total = sum(p.numel() for n, p in policy.named_parameters() if n != "h0")
                counted = sum(p.numel() for n, p in policy.trainable().items() if n != "h0")
                records.append(
                    Size(
                        *(task, net, seen, features is not None or len(choices) == 1),
                        units=policy.hidden_size,
                        learned=policy.n_trainable,
                        fixed=total - counted,
                        actions=made.action_size,
                    )
                )
    return records


def over_lstm(table: pd.DataFrame) -> pd.DataFrame:
    """Learned parameters over those of the LSTM: tasks by nets, as the thesis sets them up."""
    learned = table[table.thesis].set_index(["task", "architecture"]).learned.unstack()
    return learned.div(learned.lstm, axis=0)


@criterion("5.4-vanilla-size", sizes)
def vanilla_as_large_as_lstm(table: pd.DataFrame) -> Finding:
    """Parameters of DTRNN, CTRNN and GRU over those of the LSTM."""
    ratio = over_lstm(table)[["dtrnn", "ctrnn", "gru"]]
    near = (ratio >= SAME_SIZE[0]) & (ratio <= SAME_SIZE[1])
    parts = ", ".join(f"{n.upper()} {ratio[n].min():.2f} to {ratio[n].max():.2f}" for n in ratio)
    return exact(
        near[["dtrnn", "ctrnn"]].all(axis=None),
        f"Learned parameters over those of the LSTM, by task: {parts}.",
    )


@criterion("5.4-esn-size", sizes)
def reservoir_as_large_as_lstm(table: pd.DataFrame) -> Finding:
    """Learned parameters of the ESN over those of the LSTM."""
    ratio = over_lstm(table)["esn"].dropna()
    parts = ", ".join(f"{task} {value:.1f}" for task, value in ratio.items())
    return exact(
        ratio.between(*SAME_SIZE).all(),
        f"Learned parameters over those of the LSTM: {parts}. The formula counts the weights of a "
        "GRU and gives the reservoir that many units, each of which has a weight to every action.",
    )


@criterion("5.4-ant-reservoir", sizes)
def ant_reservoir(table: pd.DataFrame) -> Finding:
    """Units of the Ant's reservoir by the formula of section 5.4."""
    units = int(table.set_index(["task", "architecture"]).units["Ant", "esn"])
    return exact(
        units == 3328,
        f"The formula of section 5.4 gives {units} for 125 observations and 8 actions; 3328 would "
        "need 128 observations.",
    )


@criterion("5.4-largest-dtrnn", sizes)
def largest_vanilla(table: pd.DataFrame) -> Finding:
    """Units of the largest DTRNN."""
    units = table[table.architecture == "dtrnn"].groupby("task").units.max()
    return exact(
        units.max() == 24,
        f"The largest, that of the {units.idxmax()}, has {units.max()} hidden units.",
    )


@effect_of("5.2-initial-state", sizes)
def initial_states(table: pd.DataFrame) -> str:
    """How many numbers a learned initial state of the reservoir would add."""
    units = table[(table.architecture == "esn") & table.thesis].units
    return (
        f"{units.min()} to {units.max()} more learned numbers in the author's code, for something "
        "that a reservoir forgets; learning them needs backpropagation through the reservoir."
    )


@effect_of("5.2-previous-action", sizes)
def previous_action(table: pd.DataFrame) -> str:
    """Share of a DTRNN's parameters that read the previous action."""
    own = table[(table.architecture == "dtrnn") & table.thesis]
    share = own.actions * own.units / own.learned
    return (
        f"{share.min():.0%} to {share.max():.0%} of a DTRNN's parameters read the previous action."
    )


def agreeing(table: pd.DataFrame) -> str:
    """How many recurrent networks have the parameters that :func:`count` gives."""
    own = table[table.architecture.isin(["dtrnn", "ctrnn", "lstm", "gru"])]
    by_hand = [
        count(r.architecture, r.features + r.actions, r.actions, r.units) for r in own.itertuples()
    ]
    return f"{(own.learned == by_hand).sum()} of {len(own)}"


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Learned parameters and, in brackets, hidden units of every network on every task."""
    own = table[table.thesis].set_index(["architecture", "task"])
    return by_network(own.learned.map("{:,}".format) + " (" + own.units.map("{:,}".format) + ")")
