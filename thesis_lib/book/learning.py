"""Figures and tables of section 5.5.1: networks that learn."""

from __future__ import annotations

import textwrap

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import stats

from thesis_lib.book.architectures import NETWORKS
from thesis_lib.edition.plots import COLOURS, PRINTED
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.stats import Summary, holm, mean_ci, welch
from thesis_lib.training.config import TrainConfig, step_size, table_5_1
from thesis_lib.training.curves import summary
from thesis_lib.training.grid import DEFAULT, parse_variant

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
        left.plot(
            own.steps / 1000, own.mean_return, ".-", ms=2, color=COLOURS[0], lw=0.9, alpha=0.7
        )
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
        One run of each network on each task; see :func:`progress_figure`.
    last
        Batches at the end that are averaged.

    Returns
    -------
    pandas.DataFrame
        The end is bold where the gain is significant: see :func:`improvement`.
    """
    gained = improvement(curves, last)
    ends = gained[["first", "last"]].round() + 0.0  # no minus zero
    cells = [
        f"{first:.0f} → **{last:.0f}**" if learned else f"{first:.0f} → {last:.0f}"
        for first, last, learned in zip(ends["first"], ends["last"], gained.learned, strict=True)
    ]
    return _by_network(pd.Series(cells, index=gained.index).str.replace("-", "−"))


def _by_network(cells: pd.Series) -> pd.DataFrame:
    """A table of networks by tasks from cells indexed by task and architecture."""
    wide = cells.unstack("task")
    wide = wide.reindex(
        index=[n for n in NETWORKS if n in wide.index], columns=[t for t in ROBOTS if t in wide]
    )
    wide = wide.rename(index=NETWORKS).rename_axis(None, axis=1).rename_axis("network")
    return wide.reset_index().fillna("–")


def time_table(curves: pd.DataFrame) -> pd.DataFrame:
    """Processor seconds of a run and, in brackets, wall-clock seconds, networks by tasks."""
    spent = pd.DataFrame(
        {
            "processor": curves.sampling_seconds + curves.update_seconds,
            "wall": curves.wall_seconds,
        }
    )
    runs = spent.groupby([curves.task, curves.architecture, curves.seed]).sum()
    mean = runs.groupby(level=[0, 1]).mean()
    return _by_network(
        mean.processor.map("{:.0f}".format) + " (" + mean.wall.map("{:.0f}".format) + ")"
    )


def improvement(curves: pd.DataFrame, last: int = 5) -> pd.DataFrame:
    """Gain in return from the first batch to the last ones, and whether it could be chance.

    Parameters
    ----------
    curves
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
    for (task, net), own in curves.groupby(["task", "architecture"]):
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
    made["learned"] = (made["last"] > made["first"]) & (made.p < 0.05)
    return made.set_index(["task", "architecture"])


def first_and_last(curves: pd.DataFrame, last: int = 5) -> pd.DataFrame:
    """Return of the first batch and of the last ones by bound on the divergence.

    Parameters
    ----------
    curves
        Several seeds of one network on one task with variants of ``delta_kl``, as a sweep
        merges them.
    last
        Batches at the end that are averaged.

    Returns
    -------
    pandas.DataFrame
        A row a bound, the largest first: the bound, the number of runs, mean returns with the
        half-width of their 95% Student interval, and in how many runs the end is above the
        start.
    """
    run = curves.iloc[0]
    plain = step_size(TrainConfig(task=run.task, architecture=run.architecture))
    records = []
    for name, ends in summary(curves, last).groupby("variant"):
        delta = plain if name == DEFAULT else float(parse_variant(str(name))["delta_kl"])
        row: dict[str, object] = {"bound [nat]": delta, "runs": len(ends)}
        for heading, part in (("first batch", "first_return"), (f"last {last}", "last_return")):
            found = mean_ci(ends[part])
            row[heading] = f"{found.mean:.1f} ± {found.half_width:.1f}".replace("-", "−")
        row["gained"] = f"{int((ends.last_return > ends.first_return).sum())} of {len(ends)}"
        records.append(row)
    return pd.DataFrame(records).sort_values("bound [nat]", ascending=False, ignore_index=True)


def delta_table() -> pd.DataFrame:
    """Step sizes of table 5.1, tasks by networks, with those used where it has none in bold."""
    records = []
    for task in ROBOTS:
        row: dict[str, object] = {"task": task}
        for net in ("ctrnn", "dtrnn", "gru", "esn", "lstm", "ffwd", "dffwd"):
            printed = table_5_1(task, net, "delta_kl")
            used = step_size(TrainConfig(task=task, architecture=net))
            row[NETWORKS[net]] = f"**{used:g}**" if printed is None else f"{used:g}"
        records.append(row)
    return pd.DataFrame(records)


def _band(
    ax: Axes, curves: pd.DataFrame, iteration: str, colour: str, label: str, style: str = "-"
) -> None:
    """Mean of the seeds' curves with its 95% Student interval."""
    by = curves.groupby(iteration)
    steps, mean = by.steps.mean() / 1000, by.mean_return.mean()
    half = by.mean_return.sem() * stats.t.ppf(0.975, by.mean_return.count() - 1)
    ax.plot(steps, mean, style, color=colour, label=label, lw=1.4)
    ax.fill_between(steps, mean - half, mean + half, color=colour, alpha=0.2, lw=0)


def precision_figure(curves: pd.DataFrame) -> Figure:
    """Mean learning curves with 95% bands by number type of the network."""
    fig, ax = plt.subplots(figsize=(7.2, 3.3))
    for (name, own), colour in zip(curves.groupby("precision"), COLOURS, strict=False):
        _band(ax, own, "iteration", colour, str(name))
    ax.set(xlabel="thousands of control steps", ylabel="mean return of an episode")
    ax.legend()
    return fig


def precision_compared(curves: pd.DataFrame, margin: float = 0.1) -> dict[str, float]:
    """Return averaged over all iterations, float32 against float64.

    Parameters
    ----------
    curves
        Several seeds of both number types.  Runs of one seed start from the same network and
        draw the same random numbers, so that they are compared seed by seed.
    margin
        Share of the mean return of float64 by which the two may differ and count as equal.

    Returns
    -------
    dict
        ``n`` seeds, mean returns of ``float32`` and ``float64``, their mean ``difference`` with
        the ``half_width`` of its 95% interval, ``p_equivalence`` (paired TOST) and ``margin``.
    """
    average = curves.groupby(["precision", "seed"]).mean_return.mean().unstack("precision")
    gap = mean_ci(average.float32 - average.float64)
    bound = margin * abs(float(average.float64.mean()))
    scale = gap.half_width / float(stats.t.ppf(0.975, gap.n - 1))
    return {
        "n": gap.n,
        "float32": float(average.float32.mean()),
        "float64": float(average.float64.mean()),
        "difference": gap.mean,
        "half_width": gap.half_width,
        "p_equivalence": float(stats.t.sf((bound - abs(gap.mean)) / scale, gap.n - 1)),
        "margin": bound,
    }


LEARNERS = {
    ("peer", "dimension"): ("sb3-contrib", COLOURS[1], "-"),
    ("ours", "dimension"): ("ours", COLOURS[0], "-"),
    ("linear", "dimension"): ("ours, linear baseline", COLOURS[5], "-"),
    ("ours", "nats"): (r"ours, $\delta_{KL} = .05$", COLOURS[0], ":"),
}
"""Name, colour and line of the learners compared, by baseline and bound on the divergence."""


def peers_figure(curves: pd.DataFrame) -> Figure:
    """Learning curves of ours and of another library, a panel a task.

    Parameters
    ----------
    curves
        Columns ``task``, ``bound``, ``side``, ``seed``, ``batch``, ``steps``, ``mean_return``.
    """
    tasks = [task for task in ROBOTS if task in set(curves.task)]
    fig, axes = plt.subplots(1, len(tasks), figsize=(7.2, 3.5), squeeze=False)
    for ax, task in zip(axes.flat, tasks, strict=True):
        own = curves[curves.task == task]
        for (side, bound), (label, colour, style) in LEARNERS.items():
            one = own[(own.side == side) & (own.bound == bound)]
            _band(ax, one, "batch", colour, label, style)
        ax.set_title(task, fontsize=10)
    axes[0, 0].legend(fontsize=8.5)
    axes[0, 0].set_ylabel("mean return of an episode")
    fig.supxlabel("thousands of control steps", fontsize=11)
    return fig


def peers_compared(curves: pd.DataFrame, last: int = 10) -> pd.DataFrame:
    """Return of our learners and of another library, at the end and over the whole curve.

    Parameters
    ----------
    curves
        See :func:`peers_figure`.
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
    for task, own in curves.groupby("task", sort=False):
        wide = own.pivot(index="batch", columns=["side", "bound", "seed"], values="mean_return")
        for part, rows in (("end", wide.iloc[-last:]), ("curve", wide)):
            mean = rows.mean().sort_index()
            theirs = mean["peer", "dimension"]
            for side, bound in LEARNERS:
                if side == "peer":
                    continue
                mine = mean[side, bound]
                test = welch(mine, theirs)
                keys = {"task": task, "side": side, "bound": bound, "part": part}
                found = {
                    "n": len(mine),
                    "ours": mine.mean(),
                    "peer": theirs.mean(),
                    "difference": test.difference,
                    "low": test.low,
                    "high": test.high,
                    "p": test.p_value,
                }
                records.append(keys | found)
    return pd.DataFrame(records).set_index(["task", "side", "bound", "part"])


def peers_table(curves: pd.DataFrame) -> pd.DataFrame:
    """The comparison of :func:`peers_compared`, for reading."""
    found = peers_compared(curves).reset_index()
    parts = {"end": "last tenth", "curve": "whole curve"}
    cells = {
        "task": found.task,
        "learner": [LEARNERS[key][0] for key in zip(found.side, found.bound, strict=True)],
        "return over": found.part.map(parts),
        "its mean": found.ours.map("{:.0f}".format),
        "sb3-contrib": found.peer.map("{:.0f}".format),
        "difference (95%)": [
            f"{d:.0f} ({low:.0f} to {high:.0f})".replace("-", "−")
            for d, low, high in zip(found.difference, found.low, found.high, strict=True)
        ],
        "p": found.p.map("{:.2g}".format),
    }
    return pd.DataFrame(cells)


def options_figure(compared: pd.DataFrame, margin: float = 0.1) -> Figure:
    """What changing a setting does to the return, beside a share of the default's: a row a setting.

    Parameters
    ----------
    compared
        Columns ``task``, ``architecture``, ``changed``, ``mean_reference``, ``difference``,
        ``low``, ``high`` and ``p_holm``, as ``thesis sweep`` writes them to ``variants.csv``.
    margin
        Share within which a difference counts as none.
    """
    fig, ax = plt.subplots(figsize=(7.2, 1.0 + 0.27 * len(compared)))
    ax.axvline(0, color=PRINTED, lw=1)
    names = []
    for place, row in enumerate(compared.itertuples()):
        colour = STYLES[row.architecture][0]
        none = margin * abs(row.mean_reference)
        ax.plot([-none, none], [place, place], color="#d0d0d0", lw=7, solid_capstyle="butt")
        ax.plot([row.low, row.high], [place, place], color=colour, lw=1.4)
        sure = row.p_holm < 0.05
        ax.plot(row.difference, place, "o", color=colour, mfc=colour if sure else "white")
        changed = row.changed.replace("_", " ").replace("=", " ")
        names.append(textwrap.fill(f"{NETWORKS[row.architecture]}: {changed}", 36))
    ax.set_yticks(range(len(names)), names, fontsize=8.5)
    ax.set(ylim=(len(names) - 0.5, -0.5), xlabel="difference in return")
    ax.grid(axis="y", visible=False)
    return fig
