"""Drawings of the heat domain: a robot's walk, and potentials over the area."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.arrays import FloatArray
from thesis_lib.chapter4.heat_space import HeatSpace
from thesis_lib.domains.heat import HeatTask
from thesis_lib.edition.drawings import draw_heat
from thesis_lib.edition.plots import COLOURS, PRINTED


def walk(task: HeatTask, states: FloatArray, lengths: Sequence[int]) -> Figure:
    """A trained robot's walk to the source, and how long its episodes took while it learned.

    Parameters
    ----------
    task
        The task.
    states
        x, y and heading at each step, shape ``(T, 3)``.
    lengths
        Steps of each episode.
    """
    fig, (left, right) = plt.subplots(1, 2, figsize=(7.2, 3.6), width_ratios=(1, 1.1))
    draw_heat(task, robot=states[-1], path=states[:, :2], ax=left)
    x, y, heading = states.T
    size: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 2.2, "width": 0.006}
    left.quiver(x, y, np.cos(heading), np.sin(heading), color=COLOURS[0], zorder=3, **size)
    left.plot(x[0], y[0], "o", color=COLOURS[0], ms=6, zorder=4)
    left.set_aspect("equal")
    right.loglog(np.arange(1, len(lengths) + 1), lengths, ".", ms=2, color=COLOURS[0], alpha=0.5)
    smooth = pd.Series(lengths).rolling(20, min_periods=1).mean()
    right.plot(
        np.arange(1, len(lengths) + 1), smooth, color=COLOURS[1], label="mean of the last 20"
    )
    right.legend(fontsize=8)
    right.set(xlabel="episode", ylabel="steps to the source")
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
        ax.set_xticks((0, 5, 10))
        ax.grid(False)
        if ax is not axes[0]:
            spread = axes[:2] if ax is axes[1] else [ax]
            fig.colorbar(shown, ax=spread, location="bottom", label="potential [reward]", aspect=30)
    axes[0].set_ylabel("y")
    return fig
