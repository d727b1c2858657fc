"""Figures of the heat domain, section 4.3."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from thesis_lib.arrays import FloatArray
from thesis_lib.book.chapter4 import returns, roc
from thesis_lib.domains.heat import HeatTask
from thesis_lib.edition.drawings import draw_heat
from thesis_lib.edition.plots import COLOURS, PRINTED
from thesis_lib.experiments.chapter4.heat_worlds import HeatSpace
from thesis_lib.experiments.chapter4.protocol import SYMBOLS

CLOCKWISE = ((0, 0), (0, 1), (1, 1), (1, 0))
"""Panels of figure 4.8 in the order of the noise: "clockwise starting in the top left"."""


def world(task: HeatTask, states: FloatArray, lengths: Sequence[int]) -> Figure:
    """A trained robot's way to the source, and how long its episodes took while it learned.

    Parameters
    ----------
    task
        The task.
    states
        x, y and heading at each step, shape ``(T, 3)``.
    lengths
        Steps of each episode.
    """
    fig, axes = plt.subplots(1, 2, figsize=(7.2, 3.6), width_ratios=(1, 1.1))
    draw_heat(task, robot=states[-1], path=states[:, :2], ax=axes[0])
    x, y, heading = states.T
    axes[0].quiver(
        x,
        y,
        np.cos(heading),
        np.sin(heading),
        color=COLOURS[0],
        angles="xy",
        scale_units="xy",
        scale=2.2,
        width=0.006,
        zorder=3,
    )
    axes[0].plot(x[0], y[0], "o", color=COLOURS[0], ms=6, zorder=4)
    axes[0].set_aspect("equal")
    episodes = np.arange(1, len(lengths) + 1)
    axes[1].loglog(episodes, lengths, ".", ms=2, color=COLOURS[0], alpha=0.5)
    smooth = pd.Series(lengths).rolling(20, min_periods=1).mean()
    axes[1].plot(episodes, smooth, color=COLOURS[1], label="mean of the last 20")
    axes[1].legend(fontsize=8)
    axes[1].set(xlabel="episode", ylabel="steps to the source")
    return fig


def potentials(
    space: HeatSpace,
    weights: tuple[FloatArray, FloatArray],
    titles: tuple[str, str],
    task: HeatTask,
    sources: Sequence[tuple[float, float]],
) -> Figure:
    """Greedy value of two potentials over the area, mean over headings, and their difference.

    Parameters
    ----------
    space
        The domain's features.
    weights
        Potentials, each ``(n_features, 4)``.
    titles
        Their names.
    task
        The new task, whose source heats the sensor.
    sources
        Where the sources of the observed tasks were.
    """
    low, high = space.world.radius, space.world.size - space.world.radius
    at = np.linspace(low, high, 41)
    x, y = np.meshgrid(at, at)
    heat = space.world.heat(np.hypot(x - task.source[0], y - task.source[1]))
    maps = []
    for table in weights:
        total = np.zeros_like(x)
        for heading in np.arange(16) * np.pi / 8 + 0.1:
            point = np.stack([x, y, np.full_like(x, heading), heat], axis=-1).reshape(-1, 4)
            q = table[space.coding.active(point)].sum(axis=1)
            total += q.max(axis=1).reshape(x.shape) / 16
        maps.append(total)
    gap = maps[0] - maps[1]
    limits = min(m.min() for m in maps), max(m.max() for m in maps)
    ranges = [limits, limits, (-np.abs(gap).max(), np.abs(gap).max())]
    fig, axes = plt.subplots(1, 3, figsize=(7.2, 3.6), sharey=True)
    for ax, values, (least, most), title in zip(
        axes, [*maps, gap], ranges, [*titles, "difference"], strict=True
    ):
        colours = "RdBu_r" if values is gap else "viridis"
        shown = ax.pcolormesh(x, y, values, vmin=least, vmax=most, cmap=colours)
        ax.plot(*task.source, marker="*", ms=12, color="w", mec=PRINTED)
        ax.plot(*np.transpose(sources), "o", ms=6, mfc="none", mec=PRINTED)
        ax.set(title=title, xlabel="x", aspect="equal", xlim=(0, 10), ylim=(0, 10))
        ax.grid(False)
        if ax is not axes[0]:
            spread = axes[:2] if ax is axes[1] else [ax]
            fig.colorbar(shown, ax=spread, location="bottom", label="potential [reward]", aspect=30)
    axes[0].set_ylabel("y")
    return fig


def figure_4_7(table: pd.DataFrame) -> Figure:
    """FS-TEK's gain over no selection: first episodes by noise, and episode by episode."""
    own = table[table.method == "none"]
    left, right = own[own.panel == "first episodes"], own[own.panel == "by episode"]
    fig, axes = plt.subplots(1, 2, figsize=(7.2, 3.8))
    for i, (sensor, at) in enumerate(left.groupby("sensor")):
        axes[0].errorbar(
            at.tasks_seen + 0.06 * (i - 1.5),
            at.fstek_minus,
            yerr=at.fstek_minus_ci95,
            color=COLOURS[i],
            marker="o",
            ms=3,
            capsize=2,
            lw=1.2,
            label=rf"$\sigma_{{sensor}}$ = {sensor:g}",
        )
    last = int(left.last_episode.max())
    axes[0].set(xlabel="tasks seen", ylabel=f"gain in the first {last} episodes [reward]")
    _by_episode(axes[1], right, "fstek_minus", 1)
    for ax in axes:
        ax.axhline(0, color=PRINTED, lw=0.8)
        ax.legend(fontsize=7, ncols=2 if ax is axes[1] else 1)
    return fig


def by_episode(table: pd.DataFrame, methods: tuple[str, ...]) -> Figure:
    """Gain over no selection episode by episode, one panel a method."""
    own = table[table.panel == "by episode"]
    fig, axes = plt.subplots(1, len(methods), figsize=(7.2, 3.6), sharey=True, squeeze=False)
    for ax, method in zip(axes[0], methods, strict=True):
        _by_episode(ax, own[own.method == method], "none_minus", -1)
        ax.axhline(0, color=PRINTED, lw=0.8)
        ax.set_title(SYMBOLS[method])
    for ax in axes[0, 1:]:
        ax.set_ylabel("")
    axes[0, 0].legend(fontsize=7, ncols=2)
    return fig


def _by_episode(ax: Axes, rows: pd.DataFrame, gap: str, sign: int) -> None:
    """Gain an episode over blocks of episodes, one line a number of tasks."""
    grid = sorted(rows.tasks_seen.unique())
    for i, n in enumerate(grid):
        at = rows[rows.tasks_seen == n].sort_values("first_episode")
        length = at.last_episode - at.first_episode + 1
        middle, mean = (at.first_episode + at.last_episode) / 2, sign * at[gap] / length
        half = at[f"{gap}_ci95"] / length
        colour = plt.get_cmap("viridis")(0.9 * i / max(len(grid) - 1, 1))
        ax.plot(middle, mean, "o-", ms=2.5, color=colour, lw=1.2, label=f"{n} tasks")
        ax.fill_between(middle, mean - half, mean + half, color=colour, alpha=0.15, lw=0)
    ax.set(xlabel="episode", ylabel="gain an episode [reward]", xscale="log")
    ax.set_yscale("symlog", linthresh=10.0)


def all_methods(table: pd.DataFrame) -> Figure:
    """Return of the first episodes for all methods, one panel a level of noise."""
    own = table[table.panel == "first episodes"]
    fig, axes = _by_noise(own, returns, height=5.6, legend_columns=4)
    for ax in axes[:, 0]:
        ax.set_ylabel("return, first episodes")
    return fig


def figure_4_8(table: pd.DataFrame) -> Figure:
    """ROC space, one panel a level of noise, clockwise from the top left."""
    fig, axes = _by_noise(table, roc, height=6.0, legend_columns=3)
    for ax in axes[:, 1]:
        ax.set_ylabel("")
    return fig


def _by_noise(
    table: pd.DataFrame,
    draw: Callable[[Axes, pd.DataFrame], object],
    *,
    height: float,
    legend_columns: int,
) -> tuple[Figure, Any]:
    """One panel a level of noise, clockwise, with one legend; figure and axes."""
    fig, axes = plt.subplots(2, 2, figsize=(7.2, height), sharex=True, sharey=True)
    for at, (sensor, part) in zip(CLOCKWISE, table.groupby("sensor"), strict=False):
        draw(axes[at], part)
        axes[at].set_title(rf"$\sigma_{{sensor}}$ = {sensor:g}", fontsize=9)
    for ax in axes[0]:
        ax.set_xlabel("")
    handles = axes[0, 0].get_legend_handles_labels()
    fig.legend(*handles, loc="outside lower center", ncols=legend_columns, fontsize=8)
    return fig, axes
