"""Figures of the heat domain, section 4.3."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.book.chapter4 import returns, roc
from thesis_lib.book.drawings import draw_heat
from thesis_lib.book.style import COLOURS, PRINTED
from thesis_lib.domains.heat import HeatTask
from thesis_lib.experiments.chapter4.heat_worlds import HeatSpace
from thesis_lib.mdp.model import FloatArray

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
    axes[1].loglog(episodes, lengths, ".", ms=3, color=COLOURS[0])
    axes[1].set(xlabel="episode", ylabel="steps to the source")
    return fig


def potentials(
    space: HeatSpace, weights: Sequence[FloatArray], titles: Sequence[str], task: HeatTask
) -> Figure:
    """Greedy value of some potentials over the area, mean over headings, in one new task.

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
    limits = min(m.min() for m in maps), max(m.max() for m in maps)
    fig, axes = plt.subplots(1, len(maps), figsize=(7.2, 3.0), sharey=True, squeeze=False)
    for ax, values, title in zip(axes[0], maps, titles, strict=True):
        shown = ax.pcolormesh(x, y, values, vmin=limits[0], vmax=limits[1], cmap="viridis")
        ax.plot(*task.source, marker="*", ms=13, color="w", mec=PRINTED)
        ax.set(title=title, xlabel="x", aspect="equal", xlim=(0, 10), ylim=(0, 10))
        ax.grid(False)
    axes[0, 0].set_ylabel("y")
    fig.colorbar(shown, ax=axes, shrink=0.8, label="potential [reward]")
    return fig


def figure_4_7(table: pd.DataFrame) -> Figure:
    """FS-TEK's gain over no selection: first episodes by noise, and episode by episode."""
    own = table[table.method == "none"]
    single = own.first_episode == own.last_episode
    fig, axes = plt.subplots(1, 2, figsize=(7.2, 3.8))
    for i, (sensor, at) in enumerate(own[~single].groupby("sensor")):
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
    last = int(own[~single].last_episode.max())
    axes[0].set(xlabel="tasks seen", ylabel=f"gain in the first {last} episodes [reward]")
    followed = own[single]
    grid = sorted(followed.tasks_seen.unique())
    for i, n in enumerate(grid):
        at = followed[followed.tasks_seen == n].sort_values("first_episode")
        x, mean, half = _binned(at)
        colour = plt.get_cmap("viridis")(0.9 * i / max(len(grid) - 1, 1))
        axes[1].plot(x, mean, color=colour, lw=1.2, label=f"{n} tasks")
        axes[1].fill_between(x, mean - half, mean + half, color=colour, alpha=0.15, lw=0)
    axes[1].set(xlabel="episode", ylabel="gain an episode [reward]", xscale="log")
    axes[1].set_yscale("symlog", linthresh=1.0)
    for ax in axes:
        ax.axhline(0, color=PRINTED, lw=0.8)
        ax.legend(fontsize=7, ncols=2)
    return fig


def _binned(at: pd.DataFrame) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Gains in bins of episodes that widen, with the mean half-width as a bound."""
    episode = at.first_episode.to_numpy()
    edges = np.unique(np.geomspace(1, episode.max() + 1, 22).astype(int))
    labels = np.digitize(episode, edges)
    by = at.groupby(labels)
    columns = (by[c].mean().to_numpy() for c in ("first_episode", "fstek_minus"))
    x, mean = columns
    return x, mean, by.fstek_minus_ci95.mean().to_numpy()


def all_methods(table: pd.DataFrame) -> Figure:
    """Return of the first episodes for all methods, one panel a level of noise."""
    own = table[(table.first_episode == 1) & (table.last_episode > 1)]
    own = own[own.last_episode == own.last_episode.min()]
    fig, axes = plt.subplots(2, 2, figsize=(7.2, 5.6), sharex=True, sharey=True)
    for at, (sensor, part) in zip(CLOCKWISE, own.groupby("sensor"), strict=False):
        returns(axes[at], part)
        axes[at].set_title(rf"$\sigma_{{sensor}}$ = {sensor:g}", fontsize=9)
    for ax in axes[0]:
        ax.set_xlabel("")
    for ax in axes[:, 0]:
        ax.set_ylabel("return, first episodes")
    handles = axes[0, 0].get_legend_handles_labels()
    fig.legend(*handles, loc="outside lower center", ncols=4, fontsize=8)
    return fig


def figure_4_8(table: pd.DataFrame) -> Figure:
    """ROC space, one panel a level of noise, clockwise from the top left."""
    fig, axes = plt.subplots(2, 2, figsize=(7.2, 6.0), sharex=True, sharey=True)
    for at, (sensor, part) in zip(CLOCKWISE, table.groupby("sensor"), strict=False):
        roc(axes[at], part)
        axes[at].set_title(rf"$\sigma_{{sensor}}$ = {sensor:g}", fontsize=9)
    for ax in axes[0]:
        ax.set_xlabel("")
    for ax in axes[:, 1]:
        ax.set_ylabel("")
    handles = axes[0, 0].get_legend_handles_labels()
    fig.legend(*handles, loc="outside lower center", ncols=3, fontsize=8)
    return fig
