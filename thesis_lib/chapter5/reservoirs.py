"""Reservoirs and their spectral radius (section 5.2.5)."""

from __future__ import annotations

from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import torch
from matplotlib.figure import Figure

from thesis_lib.arrays import FloatArray
from thesis_lib.chapter5.networks import policy_for, untrained_net
from thesis_lib.edition.criteria import exact, judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, criterion, effect_of
from thesis_lib.edition.plots import COLOURS, PRINTED
from thesis_lib.policies import ESN

LEAK = 0.5
"""The author's leak."""


# ------------------------------------------------------------------------------ eigenvalues
@dataclass(frozen=True)
class EigenvaluesConfig:
    """Which weights."""

    seed: int = 0
    """Of the weights."""
    ant_units: int = 800
    """Units of the Ant's reservoir here; its 3256 take minutes and look the same."""


@dataclass(frozen=True)
class Eigenvalue:
    """One eigenvalue of recurrent weights."""

    net: str
    """Architecture and task."""
    spectral_radius: float
    """Asked for; empty for the vanilla net."""
    density: float
    """Share of weights that are not 0."""
    real: float
    """Real part of an eigenvalue."""
    imaginary: float
    """Its imaginary part."""


@experiment(
    "ch5-eigenvalues",
    item="Section 5.2.5",
    smoke=EigenvaluesConfig(ant_units=50),
    book=EigenvaluesConfig(),
    seconds=0.8,
)
def eigenvalues(config: EigenvaluesConfig, context: Context) -> list[Eigenvalue]:
    """Eigenvalues of echo state networks, and of a vanilla net before training."""
    weights = {}
    for task, radius, density, units in (
        ("Hopper", 1.1, 1.0, None),
        ("Ant", 1.5, 0.7, config.ant_units),
    ):
        net = policy_for(
            "esn", task, seed=config.seed, units=units, spectral_radius=radius, density=density
        )
        assert isinstance(net, ESN)
        weights[f"ESN, {task}", radius, density] = net.recurrent.weight
    vanilla = untrained_net("DTRNN", "Ant", config.seed)
    weights["DTRNN, Ant", np.nan, 1.0] = vanilla.get_parameter("recurrent.weight").detach()
    return [
        Eigenvalue(*key, value.real, value.imag)
        for key, weight in weights.items()
        for value in np.linalg.eigvals(weight.double().numpy())
    ]


def plane_figure(table: pd.DataFrame) -> Figure:
    """Eigenvalues in the complex plane, with the unit circle and the spectral radius."""
    nets = list(dict.fromkeys(table.net))
    fig, axes = plt.subplots(1, len(nets), figsize=(7.2, 3.0), sharex=True, sharey=True)
    turn = np.linspace(0, 2 * np.pi, 200)
    for ax, net in zip(axes, nets, strict=True):
        own = table[table.net == net]
        ax.plot(np.cos(turn), np.sin(turn), color=PRINTED, lw=1, ls=":")
        radius = own.spectral_radius.iloc[0]
        if np.isfinite(radius):
            ax.plot(radius * np.cos(turn), radius * np.sin(turn), color=COLOURS[1], lw=1.2)
        ax.plot(own.real, own.imaginary, ".", ms=2.5, color=COLOURS[0])
        ax.set_title(f"{net}: {len(own)} units", fontsize=10)
        ax.set(aspect="equal", xlabel="real part")
    axes[0].set_ylabel("imaginary part")
    return fig


# -------------------------------------------------------------------------------- exponents
@dataclass(frozen=True)
class Config:
    """Which reservoirs are driven, and how."""

    task: str = "Hopper"
    """Whose sizes are used."""
    radii: tuple[float, ...] = (0.5, 0.8, 0.95, 1.05, 1.1, 1.25, 1.5, 2.0)
    """Spectral radii; table 5.1 has 1.1, and 1.5 for the Ant."""
    leaks: tuple[float, ...] = (1.0, LEAK)
    """Leaks: the text's and the author's."""
    noises: tuple[float, ...] = (0.0, 0.1, 1.0)
    """Standard deviations of white noise on every input."""
    seeds: int = 5
    """Reservoirs."""
    settle: int = 300
    """Steps before anything is measured."""
    steps: int = 1000
    """Steps over which the exponent is averaged."""


@dataclass(frozen=True)
class Exponent:
    """One driven reservoir."""

    seed: int
    """Of weights and inputs."""
    spectral_radius: float
    """Of the recurrent weights."""
    leak: float
    """1 in the text, 0.5 in the author's code."""
    noise: float
    """Standard deviation of white noise on every input."""
    exponent: float
    """Largest Lyapunov exponent [1/step]: below 0 the past is forgotten."""
    at_rest: float
    """Rate at which the fastest mode grows about rest, without input [1/step]."""


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


@experiment(
    "ch5-radius",
    item="Section 5.2.5",
    smoke=Config(radii=(0.8, 1.5), noises=(0.0, 1.0), seeds=1, settle=20, steps=50),
    book=Config(),
    seconds=10,
)
def exponents(config: Config, context: Context) -> list[Exponent]:
    """Whether a reservoir forgets or magnifies, by spectral radius and input."""
    records = []
    for seed in range(config.seeds):
        net = policy_for("esn", config.task, seed=seed, spectral_radius=1.0, dtype=torch.float64)
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
                    at_rest = np.log(np.abs(1 - leak + leak * size * modes).max())
                    records.append(Exponent(seed, size, leak, noise, rate, at_rest))
    return records


@criterion("5.2.5-small-radius", exponents)
def small_radius_forgets(table: pd.DataFrame) -> Finding:
    """Lyapunov exponents of reservoirs with a spectral radius below 1."""
    below = table[table.spectral_radius < 1]
    worst = below.exponent.max()
    evidence = f"The largest exponent of {len(below)} runs is {worst:.3f} a step"
    if worst < 0:
        evidence += f", so that the slowest difference halves in {np.log(2) / -worst:.0f} steps"
    return exact(worst < 0, f"{evidence}.")


def grows(table: pd.DataFrame) -> pd.Series:
    """Share of the runs with a radius above 1 that have a positive exponent, by noise."""
    above = table[table.spectral_radius > 1]
    return (above.exponent > 0).groupby(above.noise).mean()


@criterion("5.2.5-large-radius", exponents)
def large_radius_magnifies(table: pd.DataFrame) -> Finding:
    """Lyapunov exponents of reservoirs with a spectral radius above 1, with and without input."""
    above = table[table.spectral_radius > 1]
    share = grows(table)
    quiet, loud = share.index.min(), share.index.max()
    rest = (above.at_rest > 0).mean()
    used = above[(above.spectral_radius == 1.1) & (above.leak == LEAK)].groupby("noise")
    evidence = (
        f"Of the runs with a radius above 1 {share[quiet]:.0%} have a positive exponent without "
        f"input and {share[loud]:.0%} with noise of standard deviation {loud:g} on every input; "
        f"about rest differences grow in {rest:.0%} of them."
    )
    if used.ngroups:
        mean = used.exponent.mean()
        evidence += (
            f" With the values used in most tasks, 1.1 and a leak of {LEAK:g}, the exponents are "
            f"{mean[quiet]:.3f} and {mean[loud]:.3f} a step."
        )
    return judged(share[quiet] > 0.5 and share[loud] > 0.5, evidence, direction=rest > 0.5)


@effect_of("5.2.5-leak", exponents)
def with_leak(table: pd.DataFrame) -> str:
    """Exponents of noisy reservoirs with the author's leak and without."""
    at = table[(table.spectral_radius == 1.1) & (table.noise == table.noise.max())]
    mean = at.groupby("leak").exponent.mean()
    return (
        "The leak makes the reservoir a bank of low-pass filters of two steps. With noise on every "
        f"input and a radius of 1.1 the largest exponent is {mean[LEAK]:.3f} a step with the leak "
        f"and {mean[1.0]:.3f} without."
    )


def figure(table: pd.DataFrame) -> Figure:
    """Largest Lyapunov exponent of reservoirs by spectral radius, leak and input."""
    noises = sorted(table.noise.unique())
    fig, axes = plt.subplots(1, len(noises), figsize=(7.2, 3.2), sharey=True)
    for ax, noise in zip(np.atleast_1d(axes), noises, strict=True):
        for (leak, own), colour in zip(
            table[table.noise == noise].groupby("leak", sort=False), COLOURS, strict=False
        ):
            ax.plot(own.spectral_radius, own.exponent, "o", ms=3.5, mfc="none", color=colour)
            middle = own.groupby("spectral_radius").exponent.mean()
            ax.plot(middle.index, middle, color=colour, lw=1.2, label=f"leak {leak:g}")
            if not noise:
                rest = own.groupby("spectral_radius").at_rest.mean()
                ax.plot(rest.index, rest, color=colour, lw=1.2, ls="--")
        ax.axhline(0, color=PRINTED, lw=1)
        ax.axvline(1, color=PRINTED, lw=1, ls=":")
        ax.set(xlabel="spectral radius", title=f"noise {noise:g}" if noise else "no input")
    np.atleast_1d(axes)[0].set_ylabel("largest Lyapunov exponent [1/step]")
    np.atleast_1d(axes)[0].legend(loc="lower right", fontsize=9)
    return fig
