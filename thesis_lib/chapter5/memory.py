"""How long networks remember before training (sections 5.2.1 to 5.2.5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch

from thesis_lib.chapter5.networks import (
    NETS,
    low_to_high,
    policy_for,
    random_direction,
    untrained_net,
)
from thesis_lib.edition.criteria import exact
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, criterion
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.policies import LSTM, GaussianPolicy
from thesis_lib.policies.response import growth_at_rest, respond

OPEN_GATE = "LSTM, forget gate open"
"""A network in which nothing forgets: see :func:`open_lstm`."""

LEFT = 0.01
"""Share of the largest response below which an impulse counts as forgotten."""


def open_lstm(task: str, seed: int) -> GaussianPolicy:
    """An LSTM whose forget gates stay open and whose units do not hear each other.

    Its output gates hear nothing either, so that the action shows the cell alone.
    """
    net = policy_for("lstm", task, seed=seed, forget_bias=40.0, dtype=torch.float64)
    assert isinstance(net, LSTM)
    with torch.no_grad():
        net.recurrent.weight.zero_()
        # Gates are stacked in the order input, forget, output, cell.
        net.input.weight[net.units : 3 * net.units].zero_()
    return net


@dataclass(frozen=True)
class Config:
    """Which networks, and how long they are watched."""

    task: str = "Hopper"
    """Whose sizes and control step are used."""
    seeds: int = 10
    """Networks of each kind."""
    steps: int = 2000
    """Control steps after the impulse."""


@dataclass(frozen=True)
class Forgetting:
    """One network after an impulse."""

    net: str
    """A key of NETS, or an LSTM whose forget gates are open."""
    seed: int
    """Seed of the initial weights and of the direction of the impulse."""
    steps: float
    """Control steps until the response stays below 1% of its largest; empty if longer."""
    seconds: float
    """The same in seconds."""
    left: float
    """Share of the largest response that is left at the end."""
    growth: float
    """Factor a step of the slowest small change of the state at rest; above 1 the network is
    unstable there, 0 without a state."""
    limit: int
    """Control steps watched."""


@experiment(
    "ch5-memory",
    item="Sections 5.2.1 to 5.2.5",
    smoke=Config(seeds=1, steps=100),
    book=Config(),
    seconds=11,
)
def impulses(config: Config, context: Context) -> list[Forgetting]:
    """How long an impulse is felt in the action of every architecture, before training."""
    dt = ROBOTS[config.task].control_dt
    impulse = (np.arange(config.steps) == 0).astype(float)
    records = []
    for name in (*NETS, OPEN_GATE):
        for seed in range(config.seeds):
            if name == OPEN_GATE:
                net = open_lstm(config.task, seed)
            else:
                net = untrained_net(name, config.task, seed).double()
            along = random_direction(net.observation_size, context.seeds(1, seed)[0])
            with_and_without = respond(net, np.stack([impulse, 0 * impulse], axis=1), along)
            moved = with_and_without[:, 0] - with_and_without[:, 1]
            size = np.abs(moved).max(axis=1)
            felt = np.flatnonzero(size >= LEFT * size.max())[-1] + 1
            steps = float(felt) if felt < config.steps else np.nan
            left = size[-1] / size.max()
            growth = growth_at_rest(net)
            records.append(Forgetting(name, seed, steps, steps * dt, left, growth, config.steps))
    return records


@criterion("5.2.3-lstm-keeps", impulses)
def keeps_for_long(table: pd.DataFrame) -> Finding:
    """An impulse in an LSTM, at the start of training and with its forget gates open."""
    held = table[table.net == OPEN_GATE].left.min()
    parts = []
    for net in ("LSTM", "GRU", "DTRNN"):
        steps = table[table.net == net].steps
        parts.append(f"{net} {steps.count()} of {len(steps)} (median {steps.median():.0f} steps)")
    return exact(
        held > 0.99,
        f"With the forget gates open at least {held:.2%} of an impulse is left after "
        f"{table.limit.iloc[0]} steps. Before training less than 1% is left by then in: "
        f"{', '.join(parts)}; of the others {_unstable(table, ['LSTM', 'GRU', 'DTRNN'])}.",
    )


def _unstable(table: pd.DataFrame, nets: list[str]) -> str:
    """Of the networks that still feel the impulse, how many were unstable at rest."""
    still = table[table.steps.isna() & table.net.isin(nets)]
    if still.empty:
        return "there are none"
    return f"{(still.growth > 1).sum()} of {len(still)} are unstable at rest"


@dataclass(frozen=True)
class SlowestModes:
    """The slowest mode about rest of the CTRNNs with time constants of 1 s.

    Attributes
    ----------
    low, high
        Least and largest Re mu, of the eigenvalue of K behind it.
    median
        Of its time constant in units of tau, 1 / (1 - Re mu), where it fades.
    unstable
        How many networks have one that grows.
    late
        How many have not forgotten the impulse although theirs fades.
    """

    low: float
    high: float
    median: float
    unstable: int
    late: int


def slowest_modes(table: pd.DataFrame) -> SlowestModes:
    """What the growth at rest tells of the CTRNNs of 1 s."""
    own = table[table.net == "CTRNN, 1 s"]
    mu = 1 + np.log(own.growth) / ROBOTS[Config.task].control_dt
    return SlowestModes(
        low=mu.min(),
        high=mu.max(),
        median=(1 / (1 - mu[mu < 1])).median(),
        unstable=int((mu > 1).sum()),
        late=int((own.steps.isna() & (own.growth < 1)).sum()),
    )


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Steps and seconds until an impulse is forgotten: median, and range over networks.

    Then how many networks still feel it, apart for those that are stable at rest and for those
    that are not.
    """
    records = []
    for net, own in table.groupby("net", sort=False):
        still, unstable = own.steps.isna(), own.growth > 1
        n = own.steps.dropna()
        records.append(
            {
                "network": net,
                "steps": f"{n.median():.0f} ({low_to_high(n, 0)})" if len(n) else "–",
                "seconds": f"{own.seconds.median():.2f}" if len(n) else "–",
                "unstable at rest": f"{unstable.sum()} of {len(own)}",
                "of them still feel it": f"{(still & unstable).sum()}" if unstable.any() else "–",
                "stable ones that do": f"{(still & ~unstable).sum()} of {(~unstable).sum()}",
            }
        )
    return pd.DataFrame(records)
