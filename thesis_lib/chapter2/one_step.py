"""One step of every policy-gradient algorithm, seen from above (section 2.3.5)."""

from __future__ import annotations

from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from thesis_lib.chapter2.two_parameters import (
    COLOUR,
    HORIZON,
    NAMES,
    Rates,
    expected_divergence,
    expected_return,
    fisher,
    linear_policy,
    parameters,
)
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.optimisation import Learner, LinearQuadraticTask, collect

STARTS = ((0.0, 0.0), (-0.2, -2.3), (-1.9, -0.8))
"""Policies (gain, log sigma) from which one step is made: exploring much, hardly, and too hard."""

Window = tuple[tuple[float, float], tuple[float, float]]


@dataclass(frozen=True)
class LandscapeConfig:
    """Which maps are drawn."""

    starts: tuple[tuple[float, float], ...] = STARTS
    """Policies about which return and divergence are mapped."""
    windows: tuple[Window, ...] = (
        ((-0.45, 0.35), (-0.35, 0.3)),
        ((-0.4, -0.05), (-2.75, -1.95)),
        ((-2.4, -1.4), (-1.15, -0.5)),
    )
    """Lowest and highest gain and log standard deviation of each map."""
    resolution: int = 57
    """Values along each side of a map."""


@dataclass(frozen=True)
class Place:
    """A policy near one of the starts."""

    gain: float
    """k."""
    log_std: float
    """log sigma."""
    expected_return: float
    """Exact undiscounted return of an episode."""
    start: int
    """Number of the policy the divergence is from, as in ch2-steps."""
    kl: float
    """Divergence of that policy from this one over its own states [nat]."""


@experiment(
    "ch2-landscape",
    item="Section 2.3.5",
    smoke=LandscapeConfig(resolution=9),
    book=LandscapeConfig(),
    seconds=11,
)
def landscape(config: LandscapeConfig, context: Context) -> list[Place]:
    """Return of two-parameter policies, and their divergence from where steps start."""
    return [
        Place(
            gain,
            log_std,
            expected_return=expected_return(gain, log_std),
            start=i,
            kl=expected_divergence(start, (gain, log_std)),
        )
        for i, (start, window) in enumerate(zip(config.starts, config.windows, strict=True))
        for gain in np.linspace(*window[0], config.resolution)
        for log_std in np.linspace(*window[1], config.resolution)
    ]


@dataclass(frozen=True)
class Config(Rates):
    """Rates of the algorithms, and batches a step is made from."""

    starts: tuple[tuple[float, float], ...] = STARTS
    """Policies (gain, log sigma) from which one step is made."""
    batch_steps: int = 20_000
    """Steps the direction is estimated from."""
    repeats: int = 10
    """Independent batches."""


@dataclass(frozen=True)
class Step:
    """One algorithm's step from one batch, exactly judged."""

    algorithm: str
    """A key of NAMES."""
    start: int
    """Number of the starting policy."""
    repeat: int
    """Number of the batch."""
    gain: float
    """k before the step."""
    log_std: float
    """log sigma before the step."""
    new_gain: float
    """k after it."""
    new_log_std: float
    """log sigma after it."""
    kl_sampled: float
    """Divergence of the step on its batch, old from new [nat]."""
    kl_exact: float
    """The same in expectation over the old policy's states [nat]."""
    gain_in_return: float
    """Exact return after the step less that before."""
    backtracks: int
    """Times the line search shortened it."""
    delta_kl: float
    """The bound [nat]."""


@experiment(
    "ch2-steps",
    item="Section 2.3.5",
    smoke=Config(batch_steps=400, repeats=2),
    book=Config(),
    seconds=4,
)
def steps(config: Config, context: Context) -> list[Step]:
    """The step each policy-gradient algorithm makes in a two-parameter policy."""
    records = []
    for i, start in enumerate(config.starts):
        for repeat in range(config.repeats):
            task_seed, noise_seed = context.seeds(2, i, repeat)
            task = LinearQuadraticTask(100, horizon=HORIZON, seed=task_seed)
            generator = np.random.default_rng(noise_seed)
            rollouts = collect(task, linear_policy(*start), config.batch_steps, generator)
            for key, algorithm in config.algorithms(repeat).items():
                policy = linear_policy(*start)
                report = Learner(policy, algorithm, discount=1.0).improve(rollouts)
                end = parameters(policy)
                records.append(
                    Step(
                        *(key, i, repeat, *start, *end),
                        kl_sampled=report.kl,
                        kl_exact=expected_divergence(start, end),
                        gain_in_return=expected_return(*end) - expected_return(*start),
                        backtracks=report.backtracks,
                        delta_kl=config.delta_kl,
                    )
                )
    return records


def figure(places: pd.DataFrame, made: pd.DataFrame) -> Figure:
    """Steps in the plane of the two parameters, over the return and the bound.

    Parameters
    ----------
    places
        Table of :func:`landscape`.
    made
        Table of :func:`steps`.
    """
    groups = made.groupby("start")
    fig, axes = plt.subplots(1, len(groups), figsize=(7.2, 3.7))
    delta = made.delta_kl.iloc[0]
    for ax, (start, steps_here) in zip(axes, groups, strict=True):
        own = places[places.start == start]
        value = own.pivot(index="log_std", columns="gain", values="expected_return")
        kl = own.pivot(index="log_std", columns="gain", values="kl")
        ax.contourf(value.columns, value.index, value, 16, cmap="Greys_r", alpha=0.5)
        ax.contour(kl.columns, kl.index, kl, [delta], colors="k", linewidths=1.3)
        origin = np.array([steps_here.gain.iloc[0], steps_here.log_std.iloc[0]])
        _ellipse(ax, origin, delta)
        for name, group in steps_here.groupby("algorithm", sort=False):
            _arrow(ax, origin, group[["new_gain", "new_log_std"]].to_numpy(), COLOUR[str(name)])
        ax.plot(*origin, "o", color="k", ms=4, zorder=6)
        ax.set(xlim=value.columns[[0, -1]], ylim=value.index[[0, -1]], xlabel="gain $k$")
        ax.tick_params(labelsize=8)
        ax.grid(False)
    axes[0].set_ylabel(r"$\log\sigma$")
    handles = [Line2D([], [], color=c, lw=2, label=NAMES[a]) for a, c in COLOUR.items()]
    handles += [
        Line2D([], [], color="k", lw=1.3, label=r"divergence $=\delta_{KL}$"),
        Line2D([], [], color="k", lw=1.3, ls=":", label=r"quadratic form $=\delta_{KL}$"),
    ]
    fig.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=8.5)
    return fig


def _ellipse(ax: Axes, origin: np.ndarray, delta: float) -> None:
    """Where half the quadratic form with the exact Fisher matrix is at the bound."""
    turn = np.linspace(0, 2 * np.pi, 200)
    radii = np.sqrt(2 * delta / np.diag(fisher(*origin)))
    ax.plot(origin[0] + radii[0] * np.cos(turn), origin[1] + radii[1] * np.sin(turn), "k:", lw=1.3)


def _arrow(ax: Axes, origin: np.ndarray, ends: np.ndarray, colour: str) -> None:
    """The mean step as an arrow, and every batch's step as a dot."""
    ax.plot(*ends.T, ".", color=colour, ms=3, alpha=0.7, zorder=4)
    ax.annotate(
        "",
        tuple(ends.mean(axis=0)),
        tuple(origin),
        arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.8, "shrinkA": 0, "shrinkB": 0},
        zorder=5,
    )
