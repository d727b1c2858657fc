r"""How long networks remember: gates before training, and reservoirs by spectral radius."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import torch

from thesis_lib.arrays import FloatArray
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.experiments.chapter5.architectures import (
    NETS,
    random_direction,
    untrained_net,
)
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.locomotion.tasks import make_task
from thesis_lib.policies import ESN, LSTM, GaussianPolicy, make_policy
from thesis_lib.policies.response import growth_at_rest, respond

OPEN_GATE = "LSTM, forget gate open"
"""A network in which nothing forgets: see :func:`open_lstm`."""

LEFT = 0.01
"""Share of the largest response below which an impulse counts as forgotten."""


def open_lstm(task: str, seed: int) -> GaussianPolicy:
    """An LSTM whose forget gates stay open and whose units do not hear each other.

    Its output gates hear nothing either, so that the action shows the cell alone.
    """
    made = make_task(task)
    net = make_policy(
        "lstm",
        made.observation_size,
        made.action_size,
        dt=ROBOTS[task].control_dt,
        seed=seed,
        forget_bias=40.0,
        dtype=torch.float64,
    )
    assert isinstance(net, LSTM)
    with torch.no_grad():
        net.recurrent.weight.zero_()
        # Gates are stacked in the order input, forget, output, cell.
        net.input.weight[net.units : 3 * net.units].zero_()
    return net


# -------------------------------------------------------------------------------------- impulse
@dataclass(frozen=True)
class ForgettingConfig:
    """Settings of section-5.2.3-memory."""

    task: str = "Hopper"
    """Whose sizes and control step are used."""
    seeds: int = 10
    """Networks of each kind."""
    steps: int = 2000
    """Control steps after the impulse."""


def forgetting(config: ForgettingConfig, context: Context) -> pd.DataFrame:
    """How long an impulse is felt in the action."""
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
            moved = respond(net, impulse, along) - respond(net, 0 * impulse, along)
            size = np.abs(moved).max(axis=1)
            felt = np.flatnonzero(size >= LEFT * size.max())[-1]
            over = felt + 1 < config.steps
            records.append(
                {
                    "net": name,
                    "seed": seed,
                    "steps": felt + 1 if over else np.nan,
                    "seconds": (felt + 1) * dt if over else np.nan,
                    "left": size[-1] / size.max(),
                    "growth": growth_at_rest(net),
                    "limit": config.steps,
                }
            )
    return rows(records)


SECTION_5_2_3_MEMORY = Experiment(
    id="section-5.2.3-memory",
    item="Sections 5.2.1 to 5.2.5",
    title="How long an impulse is felt in the action of every architecture, before training",
    function=forgetting,
    budgets={
        "smoke": ForgettingConfig(seeds=1, steps=100),
        "book": ForgettingConfig(),
        "thesis": ForgettingConfig(),
    },
    columns={
        "net": "a key of NETS, or an LSTM whose forget gates are open",
        "seed": "seed of the initial weights and of the direction of the impulse",
        "steps": "control steps until the response stays below 1% of its largest; empty if longer",
        "seconds": "the same in seconds",
        "left": "share of the largest response that is left at the end",
        "growth": "factor a step of the slowest small change of the state at rest; above 1 the "
        "network is unstable there, 0 without a state",
        "limit": "control steps watched",
    },
    seconds={"smoke": 1, "book": 25, "thesis": 25},
)


# ----------------------------------------------------------------------------------- reservoirs
@dataclass(frozen=True)
class RadiusConfig:
    """Settings of section-5.2.5-radius."""

    task: str = "Hopper"
    """Whose sizes are used."""
    radii: tuple[float, ...] = (0.5, 0.8, 0.95, 1.05, 1.1, 1.25, 1.5, 2.0)
    """Spectral radii; table 5.1 has 1.1, and 1.5 for the Ant."""
    leaks: tuple[float, ...] = (1.0, 0.5)
    """Leaks: the text's and the author's."""
    noises: tuple[float, ...] = (0.0, 0.1, 1.0)
    """Standard deviations of white noise on every input."""
    seeds: int = 5
    """Reservoirs."""
    settle: int = 300
    """Steps before anything is measured."""
    steps: int = 1000
    """Steps over which the exponent is averaged."""


def radius(config: RadiusConfig, context: Context) -> pd.DataFrame:
    """Largest Lyapunov exponent of reservoirs, with and without input."""
    made = make_task(config.task)
    records = []
    for seed in range(config.seeds):
        net = make_policy(
            "esn",
            made.observation_size,
            made.action_size,
            dt=ROBOTS[config.task].control_dt,
            seed=seed,
            spectral_radius=1.0,
            dtype=torch.float64,
        )
        assert isinstance(net, ESN)
        K, W = net.recurrent.weight.numpy(), net.input.weight.numpy()
        modes = net.eigenvalues()
        rng = np.random.default_rng(context.seeds(1, seed)[0])
        x = rng.standard_normal((config.settle + config.steps, net.input_size))
        start, change = rng.uniform(-1, 1, (2, net.units))
        for noise in config.noises:
            drives = noise * x @ W.T
            for leak in config.leaks:
                for size in config.radii:
                    rate = exponent(size * K, leak, drives, start, change, config.settle)
                    records.append(
                        {
                            "seed": seed,
                            "spectral_radius": size,
                            "leak": leak,
                            "noise": noise,
                            "exponent": rate,
                            "at_rest": np.log(np.abs(1 - leak + leak * size * modes).max()),
                        }
                    )
    return rows(records)


def exponent(
    K: FloatArray,
    leak: float,
    drives: FloatArray,
    start: FloatArray,
    change: FloatArray,
    settle: int,
) -> float:
    r"""Largest Lyapunov exponent of a driven reservoir, in 1/step.

    A small difference of the state is carried along by the slope of the map,
    :math:`d' = (1 - l) d + l\,(1 - f^2) \circ K d`, and its growth is averaged.

    Parameters
    ----------
    K
        Recurrent weights, shape ``(N, N)``.
    leak
        l.
    drives
        Input of the units, shape ``(T, N)``.
    start, change
        State and difference to start from, shape ``(N,)``.
    settle
        First steps, not averaged over.
    """
    h, d, total = start, change / np.linalg.norm(change), 0.0
    for t, drive in enumerate(drives):
        f = np.tanh(K @ h + drive)
        d = (1 - leak) * d + leak * (1 - f**2) * (K @ d)
        h = (1 - leak) * h + leak * f
        size = np.linalg.norm(d)
        d = d / size
        if t >= settle:
            total += np.log(size)
    return float(total / (len(drives) - settle))


SECTION_5_2_5_RADIUS = Experiment(
    id="section-5.2.5-radius",
    item="Section 5.2.5",
    title="Whether a reservoir forgets or magnifies, by spectral radius and input",
    function=radius,
    budgets={
        "smoke": RadiusConfig(radii=(0.8, 1.5), noises=(0.0, 1.0), seeds=1, settle=20, steps=50),
        "book": RadiusConfig(),
        "thesis": RadiusConfig(),
    },
    columns={
        "seed": "of weights and inputs",
        "spectral_radius": "of the recurrent weights",
        "leak": "1 in the text, 0.5 in the author's code",
        "noise": "standard deviation of white noise on every input",
        "exponent": "largest Lyapunov exponent [1/step]: below 0 the past is forgotten",
        "at_rest": "rate at which the fastest mode grows about rest, without input [1/step]",
    },
    seconds={"smoke": 0.3, "book": 30, "thesis": 30},
)

EXPERIMENTS: tuple[Experiment[Any], ...] = (SECTION_5_2_3_MEMORY, SECTION_5_2_5_RADIUS)
"""Those of this module."""
