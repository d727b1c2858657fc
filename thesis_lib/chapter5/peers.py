"""Our learner beside sb3-contrib's TRPO (section 5.5.1)."""

from __future__ import annotations

from collections.abc import Mapping

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.chapter5.committed import band, experiment_of
from thesis_lib.edition.plots import COLOURS
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.stats import welch

COLUMNS: Mapping[str, str] = {
    "task": "robot",
    "bound": "nats: both bound the divergence by .05; dimension: by .05 an action dimension",
    "side": "ours (neural baseline), linear (ours, linear baseline) or peer (sb3-contrib's TRPO)",
    "seed": "seed of the run",
    "batch": "batches so far",
    "steps": "steps asked for so far; whole episodes of ours take a little more",
    "mean_return": "mean return of the batch's episodes; of the peer, of those that ended in it",
}
"""Columns of the comparison, which ``benchmarks/sb3_learners.py`` makes."""

LEARNERS = {
    ("peer", "dimension"): ("sb3-contrib", COLOURS[1], "-"),
    ("ours", "dimension"): ("ours", COLOURS[0], "-"),
    ("linear", "dimension"): ("ours, linear baseline", COLOURS[5], "-"),
    ("ours", "nats"): (r"ours, $\delta_{KL} = .05$", COLOURS[0], ":"),
}
"""Name, colour and line of the learners compared, by baseline and bound on the divergence."""


curves = experiment_of(
    *("ch5-peers", "peers/curves"),
    "Learning curves of TRPO, ours and sb3-contrib's (committed with the book).",
    COLUMNS,
)


def differences(table: pd.DataFrame, last: int = 10) -> pd.DataFrame:
    """Return of our learners and of another library, at the end and over the whole curve.

    Parameters
    ----------
    table
        Of :data:`curves`.
    last
        Batches at the end that are averaged.

    Returns
    -------
    pandas.DataFrame
        Indexed by ``task``, ``side``, ``bound`` and ``part`` (``end`` or ``curve``); columns
        ``n`` seeds of each, mean return ``ours`` and ``peer``, their ``difference`` with ``low``
        and ``high`` of its 95% Welch interval, and ``p`` of Welch's test.
    """
    records = []
    for task, own in table.groupby("task", sort=False):
        wide = own.pivot(index="batch", columns=["side", "bound", "seed"], values="mean_return")
        for part, rows in (("end", wide.iloc[-last:]), ("curve", wide)):
            mean = rows.mean().sort_index()
            theirs = mean["peer", "dimension"]
            for side, bound in LEARNERS:
                if side == "peer":
                    continue
                mine = mean[side, bound]
                test = welch(mine, theirs)
                means = (len(mine), mine.mean(), theirs.mean())
                gap = (test.difference, test.low, test.high, test.p_value)
                records.append((task, side, bound, part, *means, *gap))
    keys = ["task", "side", "bound", "part"]
    values = ["n", "ours", "peer", "difference", "low", "high", "p"]
    return pd.DataFrame(records, columns=[*keys, *values]).set_index(keys)


def reading(table: pd.DataFrame, part: str) -> str:
    """p-values of the difference under the same bound, by task, in words."""
    found = differences(table).p.xs(("ours", "dimension", part), level=["side", "bound", "part"])
    return ", ".join(f"{p:.2f} on the {task}" for task, p in found.items())


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """The comparison of :func:`differences`, for reading."""
    found = differences(table).reset_index()
    parts = {"end": "last tenth", "curve": "whole curve"}
    cells = {
        "task": found.task,
        "learner": [LEARNERS[key][0] for key in zip(found.side, found.bound, strict=True)],
        "return over": found.part.map(parts),
        "its mean": found.ours.map("{:.0f}".format),
        "sb3-contrib": found.peer.map("{:.0f}".format),
        "difference (95%)": [
            f"{d:.0f} ({low:.0f} to {high:.0f})"
            for d, low, high in zip(found.difference, found.low, found.high, strict=True)
        ],
        "p": found.p.map("{:.2g}".format),
    }
    return pd.DataFrame(cells)


def figure(table: pd.DataFrame) -> Figure:
    """Learning curves of ours and of another library, a panel a task."""
    tasks = [task for task in ROBOTS if task in set(table.task)]
    fig, axes = plt.subplots(1, len(tasks), figsize=(7.2, 3.5), squeeze=False)
    for ax, task in zip(axes.flat, tasks, strict=True):
        own = table[table.task == task]
        for (side, bound), (label, colour, style) in LEARNERS.items():
            one = own[(own.side == side) & (own.bound == bound)]
            band(ax, one, "batch", colour, label, style)
        ax.set_title(task, fontsize=10)
    axes[0, 0].legend(fontsize=8.5)
    axes[0, 0].set_ylabel("mean return of an episode")
    fig.supxlabel("thousands of control steps", fontsize=11)
    return fig
