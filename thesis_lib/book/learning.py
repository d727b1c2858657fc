"""Figures and tables of section 5.5.1: networks that learn."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy import stats

from thesis_lib.book.architectures import NETWORKS
from thesis_lib.book.style import COLOURS, PRINTED
from thesis_lib.experiments.training import OUR_DELTA, table_5_1
from thesis_lib.locomotion.robots import ROBOTS

STYLES: dict[str, tuple[str, str]] = {
    "dtrnn": (COLOURS[0], "-"),
    "ctrnn": (COLOURS[5], "-"),
    "lstm": (COLOURS[2], "-"),
    "gru": (COLOURS[2], "--"),
    "esn": (COLOURS[3], "-"),
    "ffwd": (COLOURS[4], "-"),
    "dffwd": (COLOURS[1], "-"),
    "ffwd-400": (COLOURS[4], "--"),
    "dffwd-softplus": (COLOURS[1], "--"),
}
"""Colour and line of each network: one colour a family, dashes for the second of one."""


def live(curves: pd.DataFrame) -> Figure:
    """Return and divergence of a few runs, iteration by iteration.

    Parameters
    ----------
    curves
        Table ``section-5.5.1-live``.
    """
    fig, (left, right) = plt.subplots(1, 2, figsize=(7.2, 3.3))
    steps = curves.groupby("iteration").steps.mean() / 1000
    for _, own in curves.groupby("seed"):
        left.plot(own.steps / 1000, own.mean_return, color=COLOURS[0], lw=0.9, alpha=0.7)
        right.plot(own.iteration, own.kl, "o", color=COLOURS[0], ms=3, mfc="none")
    left.plot(steps, curves.groupby("iteration").mean_return.mean(), color=COLOURS[0], lw=2.2)
    right.axhline(curves.delta_kl.iloc[0], color=PRINTED, ls="--", lw=1.2, label=r"$\delta_{KL}$")
    left.set(xlabel="thousands of control steps", ylabel="mean return of an episode")
    right.set(xlabel="update", ylabel="divergence [nat]")
    right.set_ylim(0, 1.15 * max(curves.delta_kl.iloc[0], curves.kl.max()))
    right.legend(loc="lower right")
    return fig


def progress_figure(curves: pd.DataFrame) -> Figure:
    """Learning curves of all networks: a panel a task, a line a network.

    Parameters
    ----------
    curves
        Columns ``task``, ``architecture``, ``seed``, ``steps``, ``mean_return``; where there
        are several seeds, lines are means.
    """
    tasks = [task for task in ROBOTS if task in set(curves.task)]
    lines = -(-(len(tasks) + 1) // 3)
    fig, axes = plt.subplots(lines, 3, figsize=(7.2, 2.7 * lines), squeeze=False)
    for ax in axes.flat[len(tasks) :]:
        ax.axis("off")
    for ax, task in zip(axes.flat, tasks, strict=False):
        own = curves[curves.task == task]
        for net, (colour, style) in STYLES.items():
            one = own[own.architecture == net].groupby("iteration")[["steps", "mean_return"]].mean()
            ax.plot(one.steps / 1000, one.mean_return, style, color=colour, lw=1.2)
        ax.set_title(task, fontsize=10)
        ax.tick_params(labelsize=8.5)
    spare = axes.flat[len(tasks)]
    for net, (colour, style) in STYLES.items():
        spare.plot([], [], style, color=colour, label=NETWORKS[net])
    spare.legend(loc="center", fontsize=8.5)
    fig.supxlabel("thousands of control steps", fontsize=11)
    fig.supylabel("mean return of an episode", fontsize=11)
    return fig


def progress_table(curves: pd.DataFrame, last: int = 5) -> pd.DataFrame:
    """Return of the first batch and of the last ones, networks by tasks.

    Parameters
    ----------
    curves
        See :func:`progress_figure`.
    last
        Batches at the end that are averaged.
    """
    by = curves.sort_values("iteration").groupby(["architecture", "task"])
    first = by.mean_return.first()
    end = curves[curves.iteration > curves.iteration.max() - last]
    final = end.groupby(["architecture", "task"]).mean_return.mean()
    cells = [
        f"{a:.1f} → {b:.1f}".replace("-", "−")
        for a, b in zip(first, final[first.index], strict=True)
    ]
    wide = pd.Series(cells, index=first.index).unstack()
    tasks = [task for task in ROBOTS if task in wide]
    wide = wide.reindex(index=[n for n in NETWORKS if n in wide.index], columns=tasks)
    return (
        wide.rename(index=NETWORKS).rename_axis(None, axis=1).rename_axis("network").reset_index()
    )


def time_table(curves: pd.DataFrame) -> pd.DataFrame:
    """Processor seconds of a whole run, sampling and updates, networks by tasks."""
    spent = curves.sampling_seconds + curves.update_seconds
    total = spent.groupby([curves.architecture, curves.task, curves.seed]).sum()
    wide = total.groupby(level=[0, 1]).mean().unstack()
    tasks = [task for task in ROBOTS if task in wide]
    wide = wide.reindex(index=[n for n in NETWORKS if n in wide.index], columns=tasks)
    shown = wide.map("{:.0f}".format)
    return (
        shown.rename(index=NETWORKS).rename_axis(None, axis=1).rename_axis("network").reset_index()
    )


def improvement(curves: pd.DataFrame, last: int = 5) -> pd.DataFrame:
    """Gain in return from the first batch to the last ones, and whether it could be chance.

    Returns
    -------
    pandas.DataFrame
        Indexed by ``task``, ``architecture``; columns ``first``, ``last``, ``p``: of a Welch
        test of the episodes of the first batch against those of the last ones, from their
        means and standard deviations.
    """
    records = []
    for (task, net), own in curves.groupby(["task", "architecture"]):
        own = own.sort_values("iteration")
        start, end = own.iloc[0], own.iloc[-last:]
        result = stats.ttest_ind_from_stats(
            end.mean_return.mean(),
            np.sqrt((end.std_return**2).mean()),
            int(end.episodes.sum()),
            start.mean_return,
            start.std_return,
            int(start.episodes),
            equal_var=False,
        )
        records.append((task, net, start.mean_return, end.mean_return.mean(), result.pvalue))
    columns = ["task", "architecture", "first", "last", "p"]
    return pd.DataFrame(records, columns=columns).set_index(["task", "architecture"])


def delta_table() -> pd.DataFrame:
    """Step sizes of table 5.1, tasks by networks, with ours in bold where it has none."""
    records = []
    for task in ROBOTS:
        row: dict[str, object] = {"task": task}
        for net in ("ctrnn", "dtrnn", "gru", "esn", "lstm", "ffwd", "dffwd"):
            printed = table_5_1(task, net, "delta_kl")
            row[NETWORKS[net]] = f"**{OUR_DELTA:g}**" if printed is None else f"{printed:g}"
        records.append(row)
    return pd.DataFrame(records)
