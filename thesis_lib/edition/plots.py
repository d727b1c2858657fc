"""One look for every figure of the book: opaque, readable, safe for colour-blind readers."""

from __future__ import annotations

from itertools import pairwise, product
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Annotation, Text
from matplotlib.transforms import Bbox, BboxBase

from thesis_lib.arrays import FloatArray

_STYLE = mpl.rc_params_from_file(
    Path(__file__).with_name("thesis.mplstyle"), use_default_template=False
)

#: Okabe and Ito's eight: blue, vermilion, green, purple, orange, sky blue, yellow and black.
COLOURS: tuple[str, ...] = tuple(_STYLE["axes.prop_cycle"].by_key()["color"])

#: Colour of a value the thesis prints, in every figure that shows one beside ours.
PRINTED = "#000000"


def use_style() -> None:
    """Set matplotlib's defaults for the book's figures, whatever a user's own are.

    They stand in ``thesis.mplstyle`` beside this file, which others can use as well.
    """
    mpl.rcdefaults()
    mpl.rcParams.update(_STYLE)


def panels(
    n: int,
    columns: int,
    height: float,
    margin: float = 0.0,
    *,
    sharex: bool = False,
    sharey: bool = False,
) -> tuple[Figure, list[Axes]]:
    """A figure as wide as the text with small panels side by side, row by row.

    Parameters
    ----------
    n
        Panels, at least 1; places that they leave over in the last row are blank.
    columns
        Panels in a row, at most.
    height, margin
        Inches of a row, and of what stands above and below all rows.
    sharex, sharey
        As of :func:`matplotlib.pyplot.subplots`.
    """
    columns = min(columns, n)
    rows = -(-n // columns)
    size = (7.2, margin + height * rows)
    fig, grid = plt.subplots(
        rows, columns, figsize=size, squeeze=False, sharex=sharex, sharey=sharey
    )
    for ax in grid.flat[n:]:
        ax.axis("off")
    return fig, list(grid.flat[:n])


def legend_of(ax: Axes, ncols: int, where: str = "lower center", **look: Any) -> None:
    """The legend of one of a figure's panels, outside all of them, for the whole figure."""
    handles, labels = ax.get_legend_handles_labels()
    placed: dict[str, Any] = {"loc": f"outside {where}", "ncols": ncols, **look}
    ax.figure.legend(handles, labels, **placed)


def band(ax: Axes, table: pd.DataFrame, x: str, unit: float = 1.0, **look: Any) -> None:
    """Draw ``mean_return`` over a column, with a band of ``ci95`` on either side.

    Parameters
    ----------
    ax
        Where.
    table
        One row a point, in order.
    x
        The column along the axis.
    unit
        What the returns are divided by.
    **look
        Of the line.
    """
    mean, half = table.mean_return / unit, table.ci95 / unit
    (line,) = ax.plot(table[x], mean, **look)
    ax.fill_between(table[x], mean - half, mean + half, color=line.get_color(), alpha=0.2, lw=0)


#: How far from its point a number may stand, in points, the nearest first.
DISTANCES = (6.5, 9.0, 12.0, 16.0, 21.0, 27.0, 34.0)


def beside(
    ax: Axes, text: str, at: tuple[float, float], offset: tuple[float, float], **look: Any
) -> Annotation:
    """A number beside a point, which :func:`unclutter` may move and then ties to the point.

    Parameters
    ----------
    ax, text
        Where, and what.
    at
        The point, in data.
    offset
        From the point to the middle of the number, in points: the place that it would have alone.
    **look
        Of the number.
    """
    tie = {"arrowstyle": "-", "lw": 0.4, "color": look.get("color"), "shrinkA": 0, "shrinkB": 2}
    note = ax.annotate(
        *(text, at), xytext=offset, textcoords="offset points", ha="center", va="center",
        arrowprops={**tie, "relpos": (0.5, 0.5), "alpha": 0.6}, **look,
    )  # fmt: skip
    note.set_in_layout(False)  # it will stand inside the axes
    return note


def unclutter(fig: Figure) -> Figure:
    """A figure whose numbers beside points lie on no other number, and on few lines and marks.

    Each number of :func:`beside`, in the order they were written, takes the place that costs
    least among those around its point: near it, in the asked direction, off marks and lines.
    One for which there is no place left goes.
    """
    fig.draw_without_rendering()
    pixel = fig.dpi / 72
    for ax in fig.axes:
        ink = [_ink(line, 2 * pixel) for line in ax.lines]
        kept: list[Bbox] = []
        for note in [text for text in ax.texts if isinstance(text, Annotation)]:
            size = np.asarray(Text.get_window_extent(note).size) + pixel
            x, y = ax.transData.transform(note.xy)
            asked = np.asarray(note.xyann, dtype=float)
            turns = np.arctan2(asked[1], asked[0]) + np.linspace(0, 2 * np.pi, 16, endpoint=False)
            best: tuple[float, Bbox, FloatArray] | None = None
            for distance, turn in product(DISTANCES, turns):
                # Further by half the width where it stands beside, so that the gap is the same.
                step = distance * np.array([np.cos(turn), np.sin(turn)])
                step[0] += np.cos(turn) * max(0.0, size[0] - size[1]) / 2 / pixel
                box = Bbox.from_bounds(*((x, y) + step * pixel - size / 2), *size)
                if box.count_overlaps(kept) or not _within(box, ax.bbox):
                    continue
                covered = sum(_covered(box, *points) for points in ink)
                cost = distance + 1.5 * (1 - np.cos(turn - turns[0])) + covered
                if best is None or cost < best[0]:
                    best = cost, box, step
            if best is None:
                note.remove()
            else:
                kept.append(best[1])
                note.xyann = (float(best[2][0]), float(best[2][1]))
    return fig


def _within(box: Bbox, frame: BboxBase) -> bool:
    """Whether a box lies in another."""
    return bool(np.all(box.min >= frame.min) and np.all(box.max <= frame.max))


def _ink(line: Line2D, gap: float) -> tuple[FloatArray, FloatArray]:
    """Where a line has its marks, shape ``(n, 2)``, and points along it, ``(m, 2)``, in pixels."""
    marks = line.get_transform().transform(np.column_stack(line.get_data()).astype(float))
    if line.get_linestyle() == "None" or len(marks) < 2:
        return marks, marks[:0]
    pieces = [
        np.linspace(a, b, 1 + int(np.hypot(*(b - a)) / gap))
        for a, b in pairwise(marks)
        if np.isfinite([a, b]).all()
    ]
    return marks, np.concatenate(pieces) if pieces else marks[:0]


def _covered(box: Bbox, marks: FloatArray, along: FloatArray) -> float:
    """What it costs to cover marks, and a line, whose length counts."""
    wide = box.padded(0.4 * box.height)
    on_marks = ((marks >= wide.min) & (marks <= wide.max)).all(axis=1).sum()
    on_line = ((along >= box.min) & (along <= box.max)).all(axis=1).sum()
    return float(6 * on_marks + 4 * (on_line > 0) + 0.3 * on_line)
