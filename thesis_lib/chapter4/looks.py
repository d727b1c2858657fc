"""How chapter 4 draws methods: returns over the tasks seen, and places in ROC space."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from thesis_lib.edition.plots import COLOURS, PRINTED, band, beside, unclutter

SYMBOLS: Mapping[str, str] = {
    "fs-tek": "FS-TEK",
    "fs-tek schedule": "FS-TEK, schedule",
    "ibkr": "IBKR",
    "jackknife": "jackknife F",
    "jackknife box": "jackknife F, box",
    "cross-validation": "cross-validation",
    "fixed": "fixed features",
    "random": "random features",
    "none": "no selection",
    "constant": "constant",
}
"""How figures and sentences name the methods."""

COLOUR: Mapping[str, str] = {
    **{"fs-tek": COLOURS[0], "fs-tek schedule": COLOURS[5], "ibkr": COLOURS[1]},
    **{"jackknife": COLOURS[2], "jackknife box": COLOURS[4], "fixed": COLOURS[7]},
    **{"random": COLOURS[4], "none": "#404040", "constant": COLOURS[3]},
    "cross-validation": COLOURS[4],
}
DASH: Mapping[str, str] = {"none": ":", "constant": "--", "fixed": "-.", "random": ":"}
MARKER: Mapping[str, str] = {"fs-tek": "o", "ibkr": "s", "jackknife": "^", "fs-tek schedule": "v"}

PM = "\u00a0± "
"""Between a number and its half-width: a narrow cell breaks after the sign, not before."""

BESIDE: Mapping[str, tuple[float, float]] = {
    **{"fs-tek": (4.0, 5.0), "fs-tek schedule": (-4.0, 5.0)},
    **{"ibkr": (-4.0, -5.0), "jackknife": (4.0, -5.0), "cross-validation": (6.5, 0.0)},
}
"""Where a method's numbers stand beside its markers where there is room, in points."""


def two_rates(rows: pd.DataFrame) -> pd.Series:
    """False and true positive rate of each row, as ``0.45/1.00``."""
    return rows.fpr.map("{:.2f}".format) + "/" + rows.tpr.map("{:.2f}".format)


def returns(ax: Axes, table: pd.DataFrame, unit: float = 1.0) -> None:
    """Mean return over tasks seen with 95% bands, one line a method."""
    for method, own in table.groupby("method", sort=False):
        name = str(method)
        look: dict[str, Any] = {
            "color": COLOUR[name],
            "ls": DASH.get(name, "-"),
            "label": SYMBOLS[name],
            # Where a method removes nothing, its curve lies on that of no selection.
            "zorder": 4 if name == "none" else 2,
        }
        band(ax, own.sort_values("tasks_seen"), "tasks_seen", unit, lw=1.6, **look)
    ax.set_xlabel("tasks seen")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))


def roc(
    ax: Axes,
    table: pd.DataFrame,
    methods: Iterable[str] = ("fs-tek", "ibkr", "jackknife"),
    printed: tuple[float, float] | None = None,
    near: float = 0.06,
) -> None:
    """Points in ROC space, joined in the order of tasks seen, with the numbers beside them.

    Parameters
    ----------
    ax, table, methods
        Where, and which rows.
    printed
        Rates that the thesis prints for five tasks.
    near
        Points within so much of one another, in both rates, share one label.
    """
    for method in methods:
        own = table[table.method == method].sort_values("tasks_seen")
        look: dict[str, Any] = {"color": COLOUR[method], "marker": MARKER.get(method, "d")}
        ax.plot(own.fpr, own.tpr, ms=4, lw=0.8, label=SYMBOLS[method], **look)
        _number(ax, own, COLOUR[method], BESIDE.get(method, (0.0, 6.5)), near)
    if printed is not None:
        ax.plot(*printed, "D", color=PRINTED, ms=6, label="thesis, 5 tasks", ls="none")
    ax.set(xlabel="false positive rate", ylabel="true positive rate")
    ax.set(xlim=(-0.04, 1.06), ylim=(-0.04, 1.08))


def _number(
    ax: Axes, own: pd.DataFrame, colour: str, offset: tuple[float, float], near: float
) -> None:
    """Write the tasks seen beside the points; runs of points in one place get one label."""
    points = list(zip(own.fpr, own.tpr, own.tasks_seen, strict=True))
    while points:
        x, y, first = points[0]
        same = [n for u, v, n in points if abs(u - x) < near and abs(v - y) < near]
        # Points that follow one another only: a path that comes back is labelled again.
        count = next(
            (i for i, (*_, n) in enumerate(points) if i >= len(same) or n != same[i]), len(points)
        )
        text = str(first) if count == 1 else f"{first}–{points[count - 1][2]}"
        halo = [withStroke(linewidth=1.5, foreground="white")]
        beside(ax, text, (x, y), offset, fontsize=6, color=colour, path_effects=halo)
        points = points[count:]


def selection(
    table: pd.DataFrame,
    *,
    unit: float = 1.0,
    printed: tuple[float, float] | None = None,
    left_out: tuple[str, ...] = (),
) -> Figure:
    """A figure as 4.3 to 4.5: returns on the left, ROC space on the right.

    Parameters
    ----------
    table
        One row a method and number of tasks.
    unit
        What the returns are divided by.
    printed
        Rates that the thesis prints for five tasks.
    left_out
        Methods far below the others, which without them can be told apart; the left axis then
        holds the bands from three tasks on.
    """
    fig, axes = plt.subplots(1, 2, figsize=(7.2, 3.8))
    drawn = table[~table.method.isin(left_out)]
    returns(axes[0], drawn, unit)
    held = drawn[drawn.tasks_seen >= 3]
    if left_out and len(held):
        low = (held.mean_return - held.ci95).min() / unit
        high = (held.mean_return + held.ci95).max() / unit
        axes[0].set_ylim(low - 0.05 * (high - low), high + 0.05 * (high - low))
    axes[0].set_ylabel("mean return" + (f" / {unit:g}" if unit != 1 else ""))
    roc(axes[1], table, printed=printed)
    handles, labels = axes[0].get_legend_handles_labels()
    if printed is not None:
        extra = axes[1].get_legend_handles_labels()
        handles, labels = [*handles, extra[0][-1]], [*labels, extra[1][-1]]
    fig.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8)
    return unclutter(fig)
