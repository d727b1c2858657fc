"""Figure 4.2: what the relevance of a sequence of tasks is made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from thesis_lib.chapter4.runs import exact_solutions
from thesis_lib.domains import stock
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.relevance import list_sequences, remove, sequence_covariance


@dataclass(frozen=True)
class Config:
    """Settings of figure 4.2."""

    tasks: tuple[int, int, int] = (0, 1, 4)
    """Three tasks of stock trading with G = 1 that make the domain; they share p(x|m)."""
    distribution: tuple[float, float, float] = (0.5, 0.25, 0.25)
    """D, as printed."""
    removed: str = "a"
    """The abstraction removes this feature."""
    longest: int = 3
    """Largest k."""


@dataclass(frozen=True)
class Element:
    """One element of the covariance matrix of one sequence."""

    k: int
    """Sequence length."""
    sequence: str
    """Tasks 1, 2, 3 in order."""
    probability: float
    """Of the sequence under D."""
    i: int
    """Row of the covariance matrix."""
    j: int
    """Column."""
    covariance: float
    """Element, squared reward; its weight is 1/k^2."""
    relevance: float
    """Of the sequence: the mean of its matrix."""


@experiment("figure-4.2", item="Figure 4.2", smoke=Config(longest=2), book=Config(), seconds=0.02)
def elements(config: Config, context: Context) -> list[Element]:
    """Sequences of three stock tasks: probabilities, covariance matrices, relevance."""
    solutions = exact_solutions(stock(1, 2, 1)).take(np.array(config.tasks))
    labels = remove(solutions, [config.removed])
    records = []
    for k in range(1, config.longest + 1):
        sequences, probability = list_sequences(3, k, config.distribution)
        for c, p in zip(sequences, probability, strict=True):
            matrix = sequence_covariance(solutions, labels, c)
            name, mean = "".join(str(i + 1) for i in c), float(matrix.mean())
            records += [
                Element(k, name, float(p), i + 1, j + 1, float(matrix[i, j]), mean)
                for i, j in product(range(k), repeat=2)
            ]
    return records


def figure(table: pd.DataFrame, bold: Sequence[str]) -> Figure:
    """Areas of the sequences for each k, and the covariance matrices of some of them.

    Parameters
    ----------
    table
        Of :data:`elements`.
    bold
        Sequences with a bold border, whose matrices are drawn.
    """
    lengths = sorted(table.k.unique())
    fig, axes = plt.subplots(1, len(lengths) + 1, figsize=(7.2, 3.2))
    shade = plt.cm.ScalarMappable(cmap="RdBu_r")
    shade.set_clim(-table.covariance.abs().max(), table.covariance.abs().max())
    for ax, k in zip(axes, lengths, strict=False):
        own = table[table.k == k].drop_duplicates("sequence").set_index("sequence")
        _areas(ax, own, shade, bold)
        ax.set_title(f"k = {k}", fontsize=10)
    _matrices(axes[-1], table, [c for c in bold if c in set(table.sequence)], shade)
    bar = fig.colorbar(shade, ax=axes, shrink=0.7, label="covariance, relevance")
    bar.ax.tick_params(labelsize=7)
    return fig


def _areas(ax: Axes, own: pd.DataFrame, shade: plt.cm.ScalarMappable, bold: Sequence[str]) -> None:
    """A unit square split by the tasks of the sequences in turn, across and then down."""
    share = own.probability.to_dict()
    dark = 0.6 * shade.get_clim()[1]

    def split(prefix: str, x: float, y: float, w: float, h: float) -> None:
        if prefix in share:
            value, edge = own.relevance[prefix], 2.0 if prefix in bold else 0.4
            ax.add_patch(Rectangle((x, y), w, h, fc=shade.to_rgba(value), ec="k", lw=edge))
            if len(prefix) < 3:
                centre: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 6}
                ink = "w" if abs(value) > dark else "k"
                ax.text(x + w / 2, y + h / 2, prefix, color=ink, **centre)
            return
        mass = {m: sum(p for c, p in share.items() if c.startswith(prefix + m)) for m in "123"}
        total = sum(mass.values())
        for m, part in mass.items():
            if len(prefix) % 2 == 0:
                split(prefix + m, x, y, w * part / total, h)
                x += w * part / total
            else:
                split(prefix + m, x, y, w, h * part / total)
                y += h * part / total

    split("", 0.0, 0.0, 1.0, 1.0)
    ax.set(xlim=(0, 1), ylim=(1, 0), xticks=[], yticks=[], aspect="equal")
    ax.grid(False)
    for side in ax.spines.values():
        side.set_visible(True)


def _matrices(
    ax: Axes, table: pd.DataFrame, sequences: Sequence[str], shade: plt.cm.ScalarMappable
) -> None:
    """Covariance matrices of some sequences, one below the other."""
    y = 0.0
    for c in sequences:
        for row in table[table.sequence == c].itertuples():
            corner, colour = (row.j - 1, y + row.i - 1), shade.to_rgba(row.covariance)
            ax.add_patch(Rectangle(corner, 1, 1, fc=colour, ec="k", lw=0.4))
        ax.text(len(c) + 0.2, y + len(c) / 2, f"({', '.join(c)})", va="center", fontsize=7)
        y += len(c) + 0.6
    ax.set(xlim=(0, 5.5), ylim=(max(y, 1.0), 0), xticks=[], yticks=[], aspect="equal")
    ax.set_title("matrices", fontsize=10)
    ax.grid(False)
    for side in ax.spines.values():
        side.set_visible(False)
