"""Figures of the policy-gradient sections of chapter 2, from their tidy tables."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy import stats

from thesis_lib.edition.plots import COLOURS, PRINTED
from thesis_lib.experiments.chapter2.policy_search import NAMES, fisher

COLOUR = {
    "vpg": COLOURS[1],
    "natural": COLOURS[3],
    "natural_delta": COLOURS[2],
    "trpo": COLOURS[0],
    "ppo": COLOURS[4],
}
"""One colour an algorithm, in every figure."""


def policy_steps(landscape: pd.DataFrame, steps: pd.DataFrame) -> Figure:
    """Steps in the plane of the two parameters, over the return and the bound.

    Parameters
    ----------
    landscape
        Table ``section-2.3.5-landscape``.
    steps
        Table ``section-2.3.5-steps``.
    """
    starts = sorted(steps.start.unique())
    fig, axes = plt.subplots(1, len(starts), figsize=(7.2, 3.7))
    delta = steps.delta_kl.iloc[0]
    for ax, start in zip(axes, starts, strict=True):
        own = landscape[landscape.start == start]
        value = own.pivot(index="log_std", columns="gain", values="expected_return")
        kl = own.pivot(index="log_std", columns="gain", values="kl")
        ax.contourf(value.columns, value.index, value, 16, cmap="Greys_r", alpha=0.5)
        ax.contour(kl.columns, kl.index, kl, [delta], colors="k", linewidths=1.3)
        made = steps[steps.start == start]
        origin = np.array([made.gain.iloc[0], made.log_std.iloc[0]])
        _ellipse(ax, origin, delta)
        for name, group in made.groupby("algorithm", sort=False):
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


def learning(curves: pd.DataFrame) -> Figure:
    """What is left of the possible gain, and the divergence of every update.

    Parameters
    ----------
    curves
        Table ``section-2.3.5-learning``.
    """
    first = curves[curves.iteration == 0].expected_return.iloc[0]
    curves = curves.assign(
        left=(curves.best_return - curves.expected_return) / (curves.best_return - first)
    )
    last = curves.iteration.max()
    fig, (left, right) = plt.subplots(1, 2, figsize=(7.2, 4.0))
    for name, group in curves.groupby("algorithm", sort=False):
        colour = COLOUR[str(name)]
        by = group.groupby("iteration").left
        mean, half = by.mean(), by.sem() * stats.t.ppf(0.975, by.count() - 1)
        left.semilogy(mean.index, mean, color=colour, label=NAMES[str(name)])
        left.fill_between(mean.index, mean - half, mean + half, color=colour, alpha=0.2, lw=0)
        made = group.dropna(subset="kl_sampled").groupby("iteration").kl_sampled
        right.semilogy(made.median().index + 1, made.median(), color=colour)
        low, high = made.min(), made.max()
        right.fill_between(low.index + 1, low, high, color=colour, alpha=0.15, lw=0)
    right.axhline(curves.delta_kl.iloc[0], xmax=0.95, color=PRINTED, lw=1.2, ls="--")
    right.set(
        xlabel="update",
        ylabel="divergence on its batch [nat]",
        ylim=(1e-4, 10),
        xlim=(0, 1.1 * last),
    )
    left.set(xlabel="updates made", ylabel="share of the possible gain left", ylim=(1e-4, 1.5))
    right.text(1.02 * last, curves.delta_kl.iloc[0], r"$\delta_{KL}$", va="center", fontsize=10)
    fig.legend(loc="outside lower center", ncols=3, fontsize=9)
    return fig


def settings(table: pd.DataFrame) -> Figure:
    """When each run arrives, by setting; runs that do not are told apart above.

    Parameters
    ----------
    table
        Table ``section-2.3.5-settings``.
    """
    limit = table.iterations.iloc[0]
    never, worse = 1.15 * limit, 1.32 * limit
    labels = {"vpg": r"rate $\alpha$", "natural": r"rate $\alpha$", "trpo": r"bound $\delta_{KL}$"}
    fig, axes = plt.subplots(1, len(labels), figsize=(7.2, 3.3), sharey=True)
    for ax, (name, text) in zip(axes, labels.items(), strict=True):
        own = table[table.algorithm == name]
        height = own.arrived.fillna(never).where(~((own.last_share < 0) | own.lost), worse)
        spread = 10 ** (0.02 * (own.run - own.run.mean()))
        ax.semilogx(own.setting * spread, height, "o", ms=3.5, mfc="none", color=COLOUR[name])
        middle = height.groupby(own.setting).median()
        ax.plot(middle.index, middle, color=COLOUR[name], lw=1)
        ax.set(title=NAMES[name].split(",")[0], xlabel=text)
        ax.axhspan(1.07 * limit, 1.4 * limit, color="0.93", zorder=0)
        ax.tick_params(labelsize=8)
    ticks = np.linspace(0, limit, 4).round().astype(int)
    axes[0].set_yticks([*ticks, never, worse], [*map(str, ticks), "not yet", "worse"])
    axes[0].set(ylabel="updates to 90% of the gain", ylim=(0, 1.4 * limit))
    return fig
