"""Figure 5.3: mean learning curves, whose printed measure is table 5.2 (section 5.5.1)."""

from __future__ import annotations

from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.chapter5.cells import NETS, ROBOTS, as_published
from thesis_lib.chapter5.contrasts import Config
from thesis_lib.chapter5.networks import STYLES
from thesis_lib.chapter5.runs import CELL, DEFAULT
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.plots import legend_of
from thesis_lib.robustness import TRAINED_ON
from thesis_lib.stats import mean_ci

POINTS = 50
"""Points of a curve; each is the mean of as many iterations as that takes."""


@dataclass(frozen=True)
class Point:
    """Some iterations of a learning curve; a cell that has not been run has one row without."""

    task: str
    """Robot."""
    trained_on: str
    """Flat or hill."""
    architecture: str
    """Net."""
    iteration: float
    """Mean of the iterations."""
    mean_return: float
    """Mean return over these iterations and over seeds."""
    low: float
    """Lower end of its 95% Student interval over seeds."""
    high: float
    """Upper end."""
    seeds: int
    """Seeds; 0 where it has not been run."""
    iterations: int
    """Iterations of the runs."""
    batch_steps: int
    """Control steps of an iteration."""
    printed: float
    """Mean over the first 500 iterations by table 5.2; the printed curves are a picture."""


@experiment("figure-5.3", item="Figure 5.3", smoke=Config(), book=Config(), seconds=1.7)
def curves(config: Config, context: Context) -> list[Point]:
    """Learning curves by robot, ground and net at the deepest budget there is."""
    store = config.runs()
    cells = by_cell(store.curves, store.deepest())
    published_by = as_published("table-5.2").value
    rows = []
    for ground in TRAINED_ON:
        for robot in ROBOTS:
            for net in NETS:
                printed = float(published_by[ground, robot, net])
                runs = cells.get((robot, ground, net))
                if runs is None:
                    rows.append(Point(robot, ground, net, *(np.nan,) * 4, 0, 0, 0, printed))
                else:
                    rows += [Point(robot, ground, net, *p, printed) for p in _points(runs)]
    return rows


def by_cell(
    curves: pd.DataFrame, budgets: pd.DataFrame
) -> dict[tuple[str, str, str], pd.DataFrame]:
    """Curves by robot, ground and net, of the default settings, each at one budget.

    Parameters
    ----------
    curves
        Of :class:`~thesis_lib.chapter5.runs.Runs`.
    budgets
        One row a cell, as :meth:`~thesis_lib.chapter5.runs.Runs.deepest` gives them.
    """
    keys = [*CELL, "layer"]
    own = curves.merge(budgets[[*keys, "iterations", "batch_steps"]], on=keys)
    own = own[own.variant == DEFAULT]
    own = own.assign(architecture=own.architecture.str.upper())
    return dict(list(own.groupby(["task", "terrain", "architecture"])))


def bins(iteration: pd.Series) -> pd.Series:
    """Which point of its curve each iteration belongs to."""
    width = max(1, -(-int(iteration.max()) // POINTS))
    return (iteration - 1) // width


def _points(runs: pd.DataFrame) -> list[tuple[float, float, float, float, int, int, int]]:
    """Iteration, mean, low, high, seeds and budget of each point of one cell's curve."""
    iterations, batch = int(runs.iterations.max()), int(runs.batch_steps.max())
    binned = runs.assign(bin=bins(runs.iteration))
    by_seed = binned.groupby(["bin", "seed"])[["iteration", "mean_return"]].mean()
    found = []
    for _, point in by_seed.groupby("bin"):
        n = len(point)
        half = mean_ci(point.mean_return).half_width if n > 1 else np.nan
        mean = point.mean_return.mean()
        place = point.iteration.mean()
        found.append((place, mean, mean - half, mean + half, n, iterations, batch))
    return found


def draw(table: pd.DataFrame) -> Figure:
    """Learning curves, a row a robot that has been run, with table 5.2's means at the right edge.

    The axes are those of the means: bands over few seeds may reach beyond.
    """
    run = table[table.seeds > 0]
    robots = [robot for robot in ROBOTS if robot in set(run.task)] or [ROBOTS[0]]
    fig, axes = plt.subplots(
        *(len(robots), 2),
        figsize=(7.2, 0.6 + 2.4 * len(robots)),
        sharey="row",
        squeeze=False,
    )
    for row, robot in zip(axes, robots, strict=True):
        both = table[table.task == robot]
        for ax, ground in zip(row, TRAINED_ON, strict=True):
            cell = both[both.trained_on == ground]
            for net in NETS:
                colour, style = STYLES[net.lower()]
                own = cell[cell.architecture == net]
                steps = own.iteration * own.batch_steps / 1e6
                ax.plot(steps, own.mean_return, style, color=colour, label=net)
                ax.fill_between(steps, own.low, own.high, color=colour, alpha=0.15, lw=0)
                ax.plot(
                    [1.02],
                    [own.printed.iloc[0]],
                    "<",
                    color=colour,
                    mfc=colour if style == "-" else "white",
                    clip_on=False,
                    transform=ax.get_yaxis_transform(),
                )
            ax.set_title(f"{robot}, {ground}")
            ax.set_xlim(0, max(1, (cell.iterations * cell.batch_steps).max() / 1e6))
            if cell.mean_return.isna().all():
                ax.text(0.5, 0.5, "not run yet", transform=ax.transAxes, ha="center")
        low, high = both.mean_return.min(), max(both.mean_return.max(), both.printed.max())
        if np.isfinite(low):
            row[0].set_ylim(low - 0.1 * (high - low), high + 0.1 * (high - low))
        row[0].set_ylabel("mean return")
    for ax in axes[-1]:
        ax.set_xlabel("million control steps")
    legend_of(axes[0, 0], 7, columnspacing=1.0, handlelength=1.6)
    return fig
