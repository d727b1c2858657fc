"""The architectures of section 5.2 drawn: the thesis's figure 5.2 and what it leaves out.

What stands where is in ``architectures.toml``, but for the reservoir, whose links are drawn by lot.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, FancyArrowPatch, Rectangle

from thesis_lib.edition.drawings import INK, PALE, Point
from thesis_lib.edition.plots import COLOURS

WEIGHTS: Mapping[str, str] = MappingProxyType(
    {"input": COLOURS[0], "recurrent": COLOURS[2], "output": COLOURS[1], "plain": INK}
)
"""Colours of links by what weighs them, if anything does."""


class _Sketch:
    """A panel of the drawing, 10 wide and 8 high."""

    def __init__(self, ax: Axes, title: str) -> None:
        self.ax = ax
        ax.set(xlim=(0, 10), ylim=(-0.1, 8.2), aspect="equal")
        ax.axis("off")
        ax.set_title(title, fontsize=12)

    def text(self, at: Point, text: str, look: Mapping[str, object] = MappingProxyType({})) -> None:
        usual = {"ha": "center", "va": "center", "fontsize": 11, "zorder": 6}
        self.ax.text(*at, text, **{**usual, **look})  # type: ignore[arg-type]

    def box(self, at: Point, text: str, width: float = 1.3) -> None:
        """An input, an output or a named operation."""
        corner = (at[0] - width / 2, at[1] - 0.5)
        self.ax.add_patch(
            Rectangle(corner, width, 1.0, facecolor="white", edgecolor=INK, lw=1, zorder=4)
        )
        self.text(at, text)

    def wave(self, at: Point, label: str = "", side: Literal["left", "right"] = "right") -> None:
        """Units with a nonlinearity: a circle with a wavy line."""
        self.ax.add_patch(Circle(at, 0.55, facecolor=PALE, edgecolor=INK, lw=1.2, zorder=4))
        x = np.linspace(-0.35, 0.35, 40)
        self.ax.plot(at[0] + x, at[1] + 0.3 * np.tanh(7 * x), color=INK, lw=1.4, zorder=5)
        if label:
            beside = {"right": (0.75, "left"), "left": (-0.75, "right")}
            shift, align = beside[side]
            self.text((at[0] + shift, at[1]), label, {"ha": align, "fontsize": 10})

    def sign(self, at: Point, text: str) -> None:
        """A sum or a product."""
        self.ax.add_patch(Circle(at, 0.38, facecolor="white", edgecolor=INK, lw=1.2, zorder=4))
        self.text(at, text)

    def delay(self, at: Point) -> None:
        """A delay of one step."""
        self.ax.add_patch(Rectangle((at[0] - 0.25, at[1] - 0.25), 0.5, 0.5, color=INK, zorder=5))

    def link(self, weights: str, *points: Point, fixed: bool = False) -> None:
        """A line along some points with an arrow at its end; dashed if it is not learned."""
        colour, style = WEIGHTS[weights], (0, (2, 1.5)) if fixed else "-"
        width = 1.1 if weights == "plain" else 1.9
        xy = np.array(points, dtype=float)
        if len(xy) > 2:
            self.ax.plot(*xy[:-1].T, color=colour, lw=width, ls=style, zorder=2)
        self.ax.add_patch(
            FancyArrowPatch(
                tuple(xy[-2]), tuple(xy[-1]), arrowstyle="-|>", mutation_scale=11, color=colour,
                lw=width, ls=style, shrinkA=0, shrinkB=0, zorder=2,
            )
        )  # fmt: skip


def figure() -> Figure:
    """All architectures of section 5.2: the thesis's figure 5.2 and what it leaves out."""
    fig, axes = plt.subplots(3, 2, figsize=(7.2, 9.2))
    words = Path(__file__).with_name("architectures.toml").read_text(encoding="utf-8")
    *spaces, last = axes.flat
    for ax, panel in zip(spaces, tomllib.loads(words)["panel"], strict=True):
        sketch = _Sketch(ax, panel["title"])
        for kind, *what in panel["draw"]:
            getattr(sketch, kind)(*what)
    _reservoir(last)
    handles = [
        Line2D([], [], color=WEIGHTS["input"], lw=2, label="input weights W"),
        Line2D([], [], color=WEIGHTS["recurrent"], lw=2, label="recurrent weights K"),
        Line2D([], [], color=WEIGHTS["output"], lw=2, label="output weights V"),
        Line2D([], [], color="0.5", lw=2, ls=(0, (2, 1.5)), label="dashed: not learned"),
        Line2D([], [], color=INK, marker="s", ls="", ms=7, label="delay of one step"),
        Line2D([], [], color=INK, lw=1.1, label="no weights"),
    ]
    fig.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=10)
    return fig


def _reservoir(ax: Axes) -> None:
    s = _Sketch(ax, "ESN")
    rng = np.random.default_rng(3)
    ring = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    spots = np.array([5 + 2.7 * np.cos(ring), 4.0 + 1.35 * np.sin(ring)]).T
    spots = np.vstack([spots, [[4.1, 4.0], [5.9, 4.0]]]) + rng.uniform(-0.15, 0.15, (10, 2))
    s.box((5, 0.6), "x")
    s.box((5, 7.4), r"$\mu$")
    for a, b in {tuple(sorted(rng.choice(10, 2, replace=False))) for _ in range(22)}:
        along = spots[b] - spots[a]
        trim = 0.36 * along / np.linalg.norm(along)
        s.link("recurrent", tuple(spots[a] + trim), tuple(spots[b] - trim), fixed=True)
    for place in spots:
        ax.add_patch(Circle(tuple(place), 0.33, facecolor=PALE, edgecolor=INK, lw=1, zorder=4))
        x = np.linspace(-0.2, 0.2, 20)
        ax.plot(place[0] + x, place[1] + 0.17 * np.tanh(12 * x), color=INK, lw=1, zorder=5)
    for i in (4, 5, 6, 7, 0):
        s.link("input", (5, 1.1), tuple(spots[i] - [0, 0.36]), fixed=True)
    for i in (4, 3, 2, 1, 0):
        s.link("output", tuple(spots[i] + [0, 0.36]), (5, 6.9))
