"""The architectures of section 5.2 drawn: the thesis's figure 5.2 and what it leaves out."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, FancyArrowPatch, Rectangle

from thesis_lib.edition.drawings import INK, PALE, Point
from thesis_lib.edition.plots import COLOURS

INPUT, RECURRENT, OUTPUT = COLOURS[0], COLOURS[2], COLOURS[1]
"""Colours of input, recurrent and output weights."""


class _Sketch:
    """A panel of the drawing, 10 wide and 8 high."""

    def __init__(self, ax: Axes, title: str) -> None:
        self.ax = ax
        ax.set(xlim=(0, 10), ylim=(-0.1, 8.2), aspect="equal")
        ax.axis("off")
        ax.set_title(title, fontsize=12)

    def text(self, at: Point, text: str, **options: object) -> None:
        defaults = {"ha": "center", "va": "center", "fontsize": 11, "zorder": 6}
        self.ax.text(*at, text, **(defaults | options))  # type: ignore[arg-type]

    def box(self, at: Point, text: str, width: float = 1.3) -> None:
        """An input, an output or a named operation."""
        corner = (at[0] - width / 2, at[1] - 0.5)
        self.ax.add_patch(
            Rectangle(corner, width, 1.0, facecolor="white", edgecolor=INK, lw=1, zorder=4)
        )
        self.text(at, text)

    def wave(self, at: Point, label: str = "", *, right: bool = True) -> None:
        """Units with a nonlinearity: a circle with a wavy line."""
        self.ax.add_patch(Circle(at, 0.55, facecolor=PALE, edgecolor=INK, lw=1.2, zorder=4))
        x = np.linspace(-0.35, 0.35, 40)
        self.ax.plot(at[0] + x, at[1] + 0.3 * np.tanh(7 * x), color=INK, lw=1.4, zorder=5)
        if label:
            side = 0.75 if right else -0.75
            place = (at[0] + side, at[1])
            self.text(place, label, ha="left" if right else "right", fontsize=10)

    def sign(self, at: Point, text: str) -> None:
        """A sum or a product."""
        self.ax.add_patch(Circle(at, 0.38, facecolor="white", edgecolor=INK, lw=1.2, zorder=4))
        self.text(at, text, fontsize=11)

    def delay(self, at: Point) -> None:
        """A delay of one step."""
        self.ax.add_patch(Rectangle((at[0] - 0.25, at[1] - 0.25), 0.5, 0.5, color=INK, zorder=5))

    def link(self, points: Sequence[Point], colour: str = INK, *, fixed: bool = False) -> None:
        """A line along some points with an arrow at its end; dashed if it is not learned."""
        weighted = colour != INK
        style = (0, (2, 1.5)) if fixed else "-"
        width = 1.9 if weighted else 1.1
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
    for ax, draw in zip(
        axes.flat, (_feedforward, _discrete, _continuous, _lstm, _gru, _reservoir), strict=True
    ):
        draw(ax)
    handles = [
        Line2D([], [], color=INPUT, lw=2, label="input weights W"),
        Line2D([], [], color=RECURRENT, lw=2, label="recurrent weights K"),
        Line2D([], [], color=OUTPUT, lw=2, label="output weights V"),
        Line2D([], [], color="0.5", lw=2, ls=(0, (2, 1.5)), label="dashed: not learned"),
        Line2D([], [], color=INK, marker="s", ls="", ms=7, label="delay of one step"),
        Line2D([], [], color=INK, lw=1.1, label="no weights"),
    ]
    fig.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=10)
    return fig


def _feedforward(ax: Axes) -> None:
    s = _Sketch(ax, "FFWD (left), DFFWD (right)")
    for x, layers in ((2.3, ((4.0, "3 dim(a)"),)), (6.6, ((2.4, "100"), (4.0, "50"), (5.6, "25")))):
        s.box((x, 0.6), "o")
        below = 1.1
        for y, label in layers:
            s.link([(x, below), (x, y - 0.55)], INPUT)
            s.wave((x, y), label)
            below = y + 0.55
        s.link([(x, below), (x, 6.9)], OUTPUT)
        s.box((x, 7.4), r"$\mu$")


def _loop(s: _Sketch) -> None:
    """What the networks of panels B and F share: hidden units fed back through a delay."""
    s.link([(4.4, 5.5), (7.6, 5.5), (7.6, 2.6), (4.8, 2.6)], RECURRENT)
    s.delay((7.6, 4.1))
    s.text((6.2, 3.0), "K", color=RECURRENT)


def _discrete(ax: Axes) -> None:
    s = _Sketch(ax, "DTRNN")
    s.box((4.4, 0.6), "x")
    s.link([(4.4, 1.1), (4.4, 2.2)], INPUT)
    s.sign((4.4, 2.6), "+")
    s.link([(4.4, 3.0), (4.4, 3.65)])
    s.wave((4.4, 4.2), "h", right=False)
    s.link([(4.4, 4.75), (4.4, 6.9)], OUTPUT)
    s.box((4.4, 7.4), r"$\mu$")
    _loop(s)


def _continuous(ax: Axes) -> None:
    s = _Sketch(ax, "CTRNN")
    s.box((2.2, 0.6), "x")
    s.link([(2.2, 1.1), (2.2, 1.95)], INPUT)
    s.sign((2.2, 2.3), "+")
    s.link([(2.2, 2.7), (2.2, 3.25)])
    s.wave((2.2, 3.8), "f", right=False)
    s.link([(2.2, 4.35), (2.2, 5.1)])
    s.sign((2.2, 5.5), "+")
    s.link([(2.6, 5.5), (3.7, 5.5)])
    s.box((4.8, 5.5), r"$\int\!/\tau$", 2.2)
    s.link([(5.9, 5.5), (8.6, 5.5), (8.6, 6.9)], OUTPUT)
    s.text((7.0, 5.85), "h")
    s.link([(6.5, 5.5), (6.5, 7.0), (2.2, 7.0), (2.2, 5.88)])
    s.text((4.4, 7.35), "leak: −h", fontsize=10)
    s.link([(7.4, 5.5), (7.4, 2.3), (2.6, 2.3)], RECURRENT)
    s.text((5.0, 2.7), "K", color=RECURRENT)
    s.box((8.6, 7.4), r"$\mu$")


def _lstm(ax: Axes) -> None:
    s = _Sketch(ax, "LSTM")
    s.box((3.2, 0.5), r"$x_n$", 1.5)
    s.box((6.8, 0.5), r"$h_{n-1}$", 1.9)
    gates = {"cell": 1.1, "input": 3.5, "forget": 6.1, "output": 8.7}
    for name, x in gates.items():
        s.link([(3.2, 1.0), (x - 0.12, 2.25)], INPUT)
        s.link([(6.8, 1.0), (x + 0.12, 2.25)], RECURRENT)
        s.wave((x, 2.8))
        s.text((x + 0.62, 3.2), name, ha="left", fontsize=9)
    s.sign((2.3, 4.3), r"$\circ$")
    s.link([(1.2, 3.35), (1.2, 4.3), (1.92, 4.3)])
    s.link([(3.4, 3.35), (3.4, 4.3), (2.68, 4.3)])
    s.sign((6.1, 4.3), r"$\circ$")
    s.link([(6.1, 3.35), (6.1, 3.92)])
    s.sign((4.2, 5.3), "+")
    s.link([(2.3, 4.68), (2.3, 5.3), (3.82, 5.3)])
    s.link([(5.72, 4.3), (4.2, 4.3), (4.2, 4.92)])
    s.link([(4.58, 5.3), (7.4, 5.3), (7.4, 4.3), (6.48, 4.3)])
    s.delay((7.4, 4.85))
    s.text((5.7, 5.6), "c", fontsize=10)
    s.link([(4.2, 5.68), (4.2, 6.15)])
    s.wave((4.2, 6.7))
    s.link([(4.75, 6.7), (8.22, 6.7)])
    s.sign((8.6, 6.7), r"$\circ$")
    s.link([(8.6, 3.35), (8.6, 6.32)])
    s.link([(8.6, 7.08), (8.6, 7.9)])
    s.text((9.2, 7.5), r"$h_n$")


def _gru(ax: Axes) -> None:
    s = _Sketch(ax, "GRU")
    s.box((3.0, 0.5), r"$x_n$", 1.5)
    s.box((7.0, 0.5), r"$h_{n-1}$", 1.9)
    s.wave((1.2, 2.6), "")
    s.text((1.45, 3.55), "update", ha="left", fontsize=9)
    s.wave((8.8, 2.6), "")
    s.text((9.0, 3.5), "reset", fontsize=9)
    s.link([(2.6, 1.0), (1.35, 2.07)], INPUT)
    s.link([(6.1, 0.9), (1.62, 2.25)], RECURRENT)
    s.link([(3.7, 0.9), (8.38, 2.25)], INPUT)
    s.link([(7.5, 1.0), (8.65, 2.07)], RECURRENT)
    s.sign((6.6, 3.2), r"$\circ$")
    s.link([(6.8, 1.0), (6.65, 2.82)], RECURRENT)
    s.link([(8.35, 2.9), (6.98, 3.15)])
    s.wave((4.4, 4.4), "")
    s.text((3.7, 4.55), r"$\tilde h_n$", ha="right", fontsize=10)
    s.link([(3.1, 1.0), (4.2, 3.87)], INPUT)
    s.link([(6.3, 3.42), (4.9, 4.15)])
    s.box((4.9, 6.2), r"mix: $g h + (1-g)\,\tilde h$", 6.6)
    s.link([(4.4, 4.95), (4.4, 5.7)])
    s.link([(1.2, 3.15), (1.2, 6.2), (1.6, 6.2)])
    s.link([(7.95, 0.5), (9.75, 0.5), (9.75, 6.2), (8.2, 6.2)])
    s.link([(4.4, 6.7), (4.4, 7.7)])
    s.text((5.0, 7.4), r"$h_n$")


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
        s.link([tuple(spots[a] + trim), tuple(spots[b] - trim)], RECURRENT, fixed=True)
    for place in spots:
        ax.add_patch(Circle(tuple(place), 0.33, facecolor=PALE, edgecolor=INK, lw=1, zorder=4))
        x = np.linspace(-0.2, 0.2, 20)
        ax.plot(place[0] + x, place[1] + 0.17 * np.tanh(12 * x), color=INK, lw=1, zorder=5)
    for i in (4, 5, 6, 7, 0):
        s.link([(5, 1.1), tuple(spots[i] - [0, 0.36])], INPUT, fixed=True)
    for i in (4, 3, 2, 1, 0):
        s.link([tuple(spots[i] + [0, 0.36]), (5, 6.9)], OUTPUT)
