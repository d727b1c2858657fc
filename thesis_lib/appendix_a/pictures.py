"""How the domains of appendix A are drawn, and curves over their policies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from thesis_lib.arrays import FloatArray
from thesis_lib.domains import Domain, figure_a1, figure_a2, figure_a3
from thesis_lib.edition.drawings import (
    BLUE,
    INK,
    NODE,
    VERMILION,
    Line,
    Point,
    arrow,
    blank,
    fit,
    loop,
    node,
)
from thesis_lib.edition.plots import COLOURS
from thesis_lib.mdp.model import TabularMDP

ACTION_A: tuple[Line, str] = ("-", BLUE)
ACTION_B: tuple[Line, str] = ("--", VERMILION)
BOTH: tuple[Line, str] = ("-", "#767676")

TWO: tuple[Point, ...] = ((0.0, 0.0), (1.9, 0.0))
THREE: tuple[Point, ...] = ((0.0, 0.0), (2.6, 0.0), (1.3, -2.0))
FOUR: tuple[Point, ...] = ((0.0, 0.0), (2.6, 0.0), (0.0, -2.6), (2.6, -2.6))
"""Places for the states of figures A.1, A.2 and A.3."""

CHANCE = r"$p(\mathrm{B})$"

#: Lines of the states differ in dash as well as in colour.
LINES: dict[int, dict[str, Any]] = {
    state: {"color": colour, "linestyle": dash, "label": f"state {state}"}
    for state, colour, dash in zip(
        (1, 2, 3, 4), COLOURS, ("-", "--", "-.", (0, (1, 1))), strict=False
    )
}


def curves(table: pd.DataFrame, column: str = "value") -> tuple[FloatArray, FloatArray]:
    """Probabilities of B, shape ``(P,)``, and a column for each state, shape ``(P, S)``."""
    wide = table.pivot(index="p_b", columns="state", values=column)
    return wide.index.to_numpy(), wide.to_numpy()


def over_policies(ax: Axes, table: pd.DataFrame, column: str) -> None:
    """Draw a line for each state over p(B)."""
    for state, rows in table.groupby("state"):
        ax.plot(rows.p_b, rows[column], **LINES[int(str(state))])


def tabular(domain: Domain) -> list[TabularMDP]:
    """The tasks of a domain of this appendix, all of which are tables."""
    return [task for task in domain.tasks if isinstance(task, TabularMDP)]


def domain_1() -> Figure:
    """Figure A.1: the two tasks of fact 1, with R = 1."""
    return _side_by_side(figure_a1(), TWO, 2.4)


def domain_2() -> Figure:
    """Figure A.2: task 1 and the three variations of task 2, with x = 1."""
    figure, axes = plt.subplots(2, 2, figsize=(7.2, 6.4))
    draw_chain(tabular(figure_a2())[0], THREE, title="task 1", ax=axes[0, 0])
    places = {"a": THREE[:2], "b": THREE, "c": THREE}
    for ax, (second, at) in zip(axes.flat[1:], places.items(), strict=True):
        task = tabular(figure_a2(second))[1]  # type: ignore[arg-type]
        draw_chain(task, at, title=f"task 2{second}", ax=ax)
    for ax in axes[1]:
        action_legend(ax)
    return figure


def domain_3() -> Figure:
    """Figures A.3a and A.3b: the two tasks of fact 2, case 4."""
    return _side_by_side(figure_a3(), FOUR, 4.0)


def _side_by_side(domain: Domain, places: Sequence[Point], height: float) -> Figure:
    """The two tasks of a domain, in a figure of a height in inches."""
    figure, axes = plt.subplots(1, 2, figsize=(7.2, height))
    for m, (ax, task) in enumerate(zip(axes, tabular(domain), strict=True), start=1):
        draw_chain(task, places, title=f"task {m}", ax=ax)
        action_legend(ax)
    return figure


def draw_chain(
    task: TabularMDP,
    places: Sequence[Point],
    *,
    title: str = "",
    ax: Axes | None = None,
) -> Axes:
    """A small task as a graph (figures A.1 to A.3): A solid, B dashed.

    A state in which A and B do the same has one grey arrow for both.

    Parameters
    ----------
    task
        Its first two actions are drawn.
    places
        Where the states are.
    title
        Above the graph.
    ax
        Where to draw.

    Returns
    -------
    Axes
    """
    ax = blank(ax, 3.4, 3.0)
    middle = np.mean(places, axis=0)
    for s, at in enumerate(places):
        if task.terminal[s]:
            ax.add_patch(Circle(at, NODE + 0.07, facecolor="white", edgecolor=INK, linewidth=1.0))
        node(ax, at, str(s + 1))
    for s in range(task.n_states):
        if task.terminal[s]:
            continue
        same = bool(
            np.array_equal(task.transition[s, 0], task.transition[s, 1])
            and task.reward[s, 0] == task.reward[s, 1]
        )
        parallel = not same and np.array_equal(task.transition[s, 0], task.transition[s, 1])
        for a in range(1 if same else 2):
            style, colour = BOTH if same else (ACTION_A, ACTION_B)[a]
            reward = f"{task.reward[s, a]:+g}".replace("-", "\N{MINUS SIGN}")
            words = [reward] if task.reward[s, a] else []
            for target, p in enumerate(task.transition[s, a]):
                label = ", ".join([*words, f"p = {p:g}"] if p < 1 else words)
                if p > 0 and target == s:
                    out = np.array(places[s]) - middle
                    loop(ax, places[s], (out[0], out[1]), style=style, colour=colour, label=label)
                elif p > 0:
                    arrow(
                        ax, places[s], places[target], style=style, colour=colour,
                        bend=-0.6 if parallel and a == 0 else 0.2, label=label,
                    )  # fmt: skip
    fit(ax, places, 0.95)
    if title:
        ax.set_title(title)
    return ax


def action_legend(ax: Axes) -> None:
    """Name the lines of :func:`draw_chain` below the axes."""
    ax.legend(
        handles=[
            Line2D([], [], linestyle=style, color=colour, label=label)
            for (style, colour), label in ((ACTION_A, "A"), (ACTION_B, "B"), (BOTH, "A or B"))
        ],
        loc="upper center",
        bbox_to_anchor=(0.5, 0.02),
        ncols=3,
    )
