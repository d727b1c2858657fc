"""Time constants shorter than the step (section 5.2.2)."""

from __future__ import annotations

from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

from thesis_lib.chapter5.networks import untrained_net
from thesis_lib.edition.criteria import EXACT, judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.plots import COLOURS, PRINTED
from thesis_lib.locomotion.robots import ROBOTS

ALONE = "leak alone"
"""A network without recurrent weights, K = 0."""


@dataclass(frozen=True)
class Config:
    """Which networks, and which time constants."""

    ratios: tuple[float, ...] = (0.3, 0.4, 0.45, 0.55, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5, 2.0)
    """Time constants over the step."""
    seeds: int = 100
    """Networks for each task."""


@dataclass(frozen=True)
class Mode:
    """The worst mode of one network at one time constant."""

    task: str
    """Task whose sizes the untrained network has, or leak alone (K = 0)."""
    seed: int
    """Of the weights."""
    integrator: str
    """euler, or heun; the true midpoint has the same factors as heun."""
    ratio: float
    """Time constant over step."""
    growth: float
    """Factor a step, of the worst mode that decays in continuous time; about rest."""


def growth(eigenvalues: NDArray[np.complex128], ratio: float, integrator: str) -> float:
    r"""Factor by which a step multiplies the worst mode that should decay.

    A mode of :math:`\dot h = (K - I)h/\tau` with eigenvalue :math:`\mu` of K decays if the
    real part of :math:`\mu` is below 1.  A step multiplies it by :math:`1 + z` (Euler) or
    :math:`1 + z + z^2/2` (Heun, midpoint), :math:`z = (\mu - 1)\Delta t/\tau`.

    Parameters
    ----------
    eigenvalues
        Of K, shape ``(N,)``.
    ratio
        :math:`\tau/\Delta t`.
    integrator
        ``euler``, ``heun`` or ``midpoint``.
    """
    z = (eigenvalues[eigenvalues.real < 1] - 1) / ratio
    factors = 1 + z if integrator == "euler" else 1 + z + z**2 / 2
    return float(np.abs(factors).max(initial=0.0))


@experiment(
    "ch5-stability",
    item="Section 5.2.2",
    smoke=Config(ratios=(0.45, 0.9, 1.0, 1.2), seeds=2),
    book=Config(),
    seconds=0.9,
)
def modes(config: Config, context: Context) -> list[Mode]:
    """Whether a continuous-time network is stable when its time constants are below the step."""
    eigenvalues = {(ALONE, 0): np.zeros(1, dtype=complex)}
    for task in ROBOTS:
        for seed in range(config.seeds):
            net = untrained_net("CTRNN, 1 s", task, seed)
            K = net.get_parameter("recurrent.weight").detach().double().numpy()
            eigenvalues[task, seed] = np.linalg.eigvals(K).astype(complex)
    return [
        Mode(*net, integrator, ratio, growth(values, ratio, integrator))
        for net, values in eigenvalues.items()
        for ratio in config.ratios
        for integrator in ("euler", "heun")
    ]


def unstable(table: pd.DataFrame) -> pd.DataFrame:
    """Share of networks with a growing mode, ratios by integrators."""
    own = table[table.task != ALONE]
    return (own.growth > 1 + EXACT).groupby([own.ratio, own.integrator]).mean().unstack()


def longest_unstable_leak(table: pd.DataFrame) -> pd.Series:
    """Largest time constant over step at which the leak by itself grows, by integrator."""
    own = table[(table.task == ALONE) & (table.growth > 1 + EXACT)]
    return own.groupby("integrator").ratio.max()


@criterion("5.2.2-instability", modes)
def short_time_constants(table: pd.DataFrame) -> Finding:
    """Share of networks with a mode that an integrator lets grow, by time constant."""
    share, leak = unstable(table), longest_unstable_leak(table)
    below, above = share[share.index < 1], share[share.index >= 1]
    names = {"euler": "Euler", "heun": "the author's midpoint, Heun"}
    parts = "; ".join(
        f"{names[str(name)]}: " + ", ".join(f"{s:.0%} at {ratio:g}" for ratio, s in own.items())
        for name, own in share.items()
    )
    evidence = (
        "Share of untrained networks with a mode about rest that should decay and grows, by time "
        f"constant over step, {parts}. The leak by itself grows at {leak['euler']:g} of a step by "
        f"Euler's method and at {leak['heun']:g} by Heun's, and at nothing longer that was tried."
    )
    return judged(
        (below > 0.5).all(axis=None) and (above < 0.5).all(axis=None),
        evidence,
        direction=(below.max() > 0.5).all(),
        otherwise=Verdict.REFUTED,
    )


def reading(table: pd.DataFrame) -> str:
    """Shares below the step, at it, next above it and at the longest, in a sentence."""
    share = unstable(table)
    places = [share.index[share.index < 1].max(), *share.index[share.index >= 1][:2]]
    parts = [
        f"at {ratio:g} of the step {share.euler[ratio]:.1%} and {share.heun[ratio]:.1%}"
        for ratio in dict.fromkeys([*places, share.index.max()])
    ]
    return (
        "Networks with such a mode, under Euler's method and under Heun's: with all time "
        f"constants {'; '.join(parts)}."
    )


def figure(table: pd.DataFrame) -> Figure:
    """Share of networks with a growing mode, by time constant over step."""
    fig, ax = plt.subplots(figsize=(7.2, 3.2))
    nets = table[table.task != ALONE]
    for (task, own), colour in zip(nets.groupby("task", sort=False), COLOURS, strict=False):
        share = unstable(own)
        ax.plot(share.index, share.euler, "-", color=colour, lw=1.3, label=task)
        ax.plot(share.index, share.heun, "--", color=colour, lw=1.3)
    ax.plot([], color="0.3", label="Euler")
    ax.plot([], color="0.3", ls="--", label="Heun")
    ax.axvline(1, color=PRINTED, lw=1, ls=":")
    ax.set(xlabel="time constant / step", ylabel="share of networks", ylim=(-0.03, 1.03))
    ax.legend(fontsize=9, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return fig
