"""One look for every figure of the book: opaque, readable, safe for colour-blind readers."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import pandas as pd
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from matplotlib.transforms import Bbox

#: Okabe and Ito's eight colours, black last, in an order whose neighbours differ in lightness too.
COLOURS: tuple[str, ...] = (
    "#0072B2",  # blue
    "#D55E00",  # vermilion
    "#009E73",  # green
    "#CC79A7",  # purple
    "#E69F00",  # orange
    "#56B4E9",  # sky blue
    "#F0E442",  # yellow
    "#000000",  # black
)

#: Colour of a value the thesis prints, in every figure that shows one beside ours.
PRINTED = "#000000"


def use_style() -> None:
    """Set matplotlib's defaults for the book's figures, whatever a user's own are.

    Figures are opaque white, because a dark theme shows a transparent one as a grey slab, and
    at most 7.2 inches wide at 200 dots an inch, which is the text column at twice its pixels.
    """
    mpl.rcdefaults()
    mpl.rcParams.update(
        {
            "figure.figsize": (7.2, 3.6),
            "figure.dpi": 200,
            "figure.facecolor": "white",
            "figure.constrained_layout.use": True,
            "savefig.facecolor": "white",
            "savefig.dpi": 200,
            "axes.facecolor": "white",
            "axes.prop_cycle": cycler(color=COLOURS),
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.grid": True,
            "axes.axisbelow": True,
            "axes.titlesize": 11,
            "axes.labelsize": 11,
            "xtick.labelsize": 10,
            "ytick.labelsize": 10,
            "legend.fontsize": 10,
            "legend.frameon": False,
            "font.size": 11,
            "font.family": "DejaVu Sans",  # ships with matplotlib: the same picture everywhere
            "grid.color": "#d9d9d9",
            "grid.linewidth": 0.6,
            "lines.linewidth": 1.8,
            "image.cmap": "cividis",
            "svg.hashsalt": "thesis_lib",
        }
    )


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


def unclutter(fig: Figure) -> Figure:
    """A figure less the numbers beside its points that would lie on one before them."""
    fig.draw_without_rendering()
    for ax in fig.axes:
        kept: list[Bbox] = []
        for note in [text for text in ax.texts if isinstance(text, Annotation)]:
            box = note.get_window_extent()
            if box.count_overlaps(kept):
                note.remove()
            else:
                kept.append(box)
    return fig
