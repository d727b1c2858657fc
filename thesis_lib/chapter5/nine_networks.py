"""Nine networks on the five flat tasks, at a budget that a reader can repeat (section 5.5.1)."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.chapter5.committed import experiment_of
from thesis_lib.chapter5.networks import NAMES, STYLES, by_network
from thesis_lib.edition.criteria import LEVEL
from thesis_lib.edition.plots import panels
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.stats import Summary, holm, welch

curves = experiment_of(
    *("ch5-curves", "learning/curves"),
    "Learning curves of nine networks on the five flat tasks (committed with the book).",
)


def improvement(table: pd.DataFrame, last: int = 5) -> pd.DataFrame:
    """Gain in return from the first batch to the last ones, and whether it could be chance.

    Parameters
    ----------
    table
        One run of each network on each task, with ``mean_return``, ``std_return`` and
        ``episodes`` of every batch.
    last
        Batches at the end that are taken together.

    Returns
    -------
    pandas.DataFrame
        Indexed by ``task``, ``architecture``; columns ``first``, ``last``, ``p`` (Welch test
        of the episodes of the first batch against those of the last ones, Holm-corrected
        over all runs) and ``learned`` (a gain with p < .05).
    """
    records = []
    for (task, net), own in table.groupby(["task", "architecture"]):
        own = own.sort_values("iteration")
        start, end = own.iloc[0], own.iloc[-last:]
        n = int(end.episodes.sum())
        mean = float(np.average(end.mean_return, weights=end.episodes))
        square = np.average(end.std_return**2 + end.mean_return**2, weights=end.episodes)
        sd = float(np.sqrt((square - mean**2) * n / (n - 1)))
        few = int(start.episodes)
        before = Summary(start.mean_return, start.std_return * np.sqrt(few / (few - 1)), few)
        result = welch(Summary(mean, sd, n), before)
        records.append((task, net, start.mean_return, mean, result.p_value))
    made = pd.DataFrame(records, columns=["task", "architecture", "first", "last", "p"])
    made["p"] = holm(made.p)
    made["learned"] = (made["last"] > made["first"]) & (made.p < LEVEL)
    return made.set_index(["task", "architecture"])


def figure(table: pd.DataFrame) -> Figure:
    """Learning curves of all networks: a panel a task, a line a network.

    Parameters
    ----------
    table
        Columns ``task``, ``architecture``, ``seed``, ``steps``, ``mean_return``; where there
        are several seeds, lines are means.
    """
    tasks = [task for task in ROBOTS if task in set(table.task)]
    fig, (*axes, spare) = panels(len(tasks) + 1, 3, 2.7)
    for ax, task in zip(axes, tasks, strict=True):
        own = table[table.task == task]
        for net, (colour, style) in STYLES.items():
            one = own[own.architecture == net].groupby("iteration")[["steps", "mean_return"]].mean()
            ax.plot(one.steps / 1000, one.mean_return, style, color=colour, lw=1.2)
        ax.set_title(task, fontsize=10)
        ax.tick_params(labelsize=8.5)
    spare.axis("off")
    for net, (colour, style) in STYLES.items():
        spare.plot([], [], style, color=colour, label=NAMES[net])
    spare.legend(loc="center", fontsize=8.5)
    fig.supxlabel("thousands of control steps", fontsize=11)
    fig.supylabel("mean return of an episode", fontsize=11)
    return fig


def shown(table: pd.DataFrame, last: int = 5) -> pd.DataFrame:
    """Return of the first batch and of the last ones, networks by tasks; a significant gain bold.

    Parameters
    ----------
    table
        One run of each network on each task; see :func:`improvement`.
    last
        Batches at the end that are averaged.
    """
    gained = improvement(table, last)
    ends = gained[["first", "last"]].round() + 0.0  # no minus zero
    cells = [
        f"{first:.0f} → **{last:.0f}**" if learned else f"{first:.0f} → {last:.0f}"
        for first, last, learned in zip(ends["first"], ends["last"], gained.learned, strict=True)
    ]
    return by_network(pd.Series(cells, index=gained.index))


def times(table: pd.DataFrame) -> pd.DataFrame:
    """Processor seconds of a run and, in brackets, wall-clock seconds, networks by tasks."""
    spent = pd.DataFrame(
        {
            "processor": table.sampling_seconds + table.update_seconds,
            "wall": table.wall_seconds,
        }
    )
    runs = spent.groupby([table.task, table.architecture, table.seed]).sum()
    mean = runs.groupby(level=[0, 1]).mean()
    return by_network(
        mean.processor.map("{:.0f}".format) + " (" + mean.wall.map("{:.0f}".format) + ")"
    )
