"""Pictures of example tasks: figures 3.3a and 3.4a, the cliff and the heat domain.

Every function returns the axes it draws into: those it is given, or those of a new figure.
"""

from __future__ import annotations

from typing import Literal

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, FancyArrowPatch, Rectangle
from numpy.typing import ArrayLike

from thesis_lib.arrays import FloatArray
from thesis_lib.domains.cliff import MOVES, CliffLayout
from thesis_lib.domains.heat import HeatTask
from thesis_lib.domains.stock import StockMDP
from thesis_lib.domains.triangle import STATES, TriangleLayout
from thesis_lib.edition.plots import COLOURS

BLUE, VERMILION, GREEN = COLOURS[:3]
INK = "#222222"
PALE = "#eef3f7"
EARTH = "#8a6d5a"
NODE = 0.3
"""Radius of a drawn state."""

REACH = 0.34
"""How far an arrow from a state to itself goes from it."""

Point = tuple[float, float]
Line = Literal["-", "--", ":"]

HELPS: tuple[Line, str] = ("-", GREEN)
HINDERS: tuple[Line, str] = ("--", VERMILION)


def blank(ax: Axes | None, width: float, height: float) -> Axes:
    """Axes without frame and ticks, with equal scales."""
    if ax is None:
        _, ax = plt.subplots(figsize=(width, height))
    ax.set_aspect("equal")
    ax.axis("off")
    return ax


def node(ax: Axes, at: Point, label: str, *, face: str = PALE, radius: float = NODE) -> None:
    """A state: a circle with its name."""
    ax.add_patch(Circle(at, radius, facecolor=face, edgecolor=INK, linewidth=1.2, zorder=3))
    ax.text(at[0], at[1], label, ha="center", va="center", zorder=4)


def arrow(
    ax: Axes,
    start: Point,
    end: Point,
    *,
    style: Line = "-",
    colour: str = INK,
    bend: float = 0.0,
    radius: float = NODE,
    label: str = "",
) -> None:
    """An arrow from the rim of one node to the rim of another, bent to its right."""
    a, b = np.array(start, dtype=float), np.array(end, dtype=float)
    chord = b - a
    middle = (a + b) / 2 + bend * np.array([chord[1], -chord[0]])
    # Trim the quadratic curve a, middle, b by the two circles.
    t = np.linspace(0, 1, 201)[:, None]
    curve = (1 - t) ** 2 * a + 2 * t * (1 - t) * middle + t**2 * b
    outside = (np.hypot(*(curve - a).T) > radius) & (np.hypot(*(curve - b).T) > radius + 0.04)
    _draw(ax, curve[outside], 4, style, colour)
    if label:
        # Nearer to the start, so that arrows there and back keep their words apart.
        x, y = curve[len(curve) // 3]
        write(ax, x, y, label, colour)


def _draw(ax: Axes, curve: FloatArray, head: int, style: Line, colour: str) -> None:
    """A curve with an arrow's head over the last ``head`` of its points."""
    ax.plot(*curve[:-head].T, linestyle=style, color=colour, linewidth=1.6, zorder=2)
    ax.add_patch(
        FancyArrowPatch(
            tuple(curve[-head - 4]), tuple(curve[-1]), arrowstyle="-|>", mutation_scale=13,
            color=colour, linewidth=0, shrinkA=0, shrinkB=0, zorder=2,
        )
    )  # fmt: skip


def write(ax: Axes, x: float, y: float, text: str, colour: str) -> None:
    """A word on an arrow, on a white ground."""
    box = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
    ax.text(x, y, text, ha="center", va="center", color=colour, fontsize=9, zorder=5, bbox=box)


def loop(
    ax: Axes,
    at: Point,
    towards: Point,
    *,
    style: Line = "-",
    colour: str = INK,
    label: str = "",
) -> None:
    """An arrow from a node to itself, on the side of the direction ``towards``."""
    out = np.array(towards, dtype=float) / np.hypot(*towards)
    across = np.array([-out[1], out[0]])
    centre = np.array(at) + (NODE + 0.55 * REACH) * out
    turn = np.linspace(-0.80 * np.pi, 0.80 * np.pi, 121)
    size = 0.62 * REACH
    curve = centre + size * (np.outer(np.cos(turn), out) + np.outer(np.sin(turn), across))
    _draw(ax, curve, 6, style, colour)
    if label:
        x, y = centre + (size + 0.18 + 0.03 * len(label) * abs(out[0])) * out
        write(ax, x, y, label, colour)


def fit(ax: Axes, points: ArrayLike, margin: float) -> None:
    """Show all points, shape ``(n, 2)``, with a margin around them."""
    low, high = np.min(points, axis=0) - margin, np.max(points, axis=0) + margin
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])


def draw_cliff(
    layout: CliffLayout,
    *,
    policy: ArrayLike | None = None,
    values: ArrayLike | None = None,
    ax: Axes | None = None,
) -> Axes:
    """One cliff task as a grid.

    Parameters
    ----------
    layout
        The task.
    policy
        Action probabilities, shape ``(S, 4)``; an arrow for each action that is chosen
        with at least half the probability of the likeliest one.
    values
        One number a state, shape ``(S,)``, written into the cells.
    ax
        Where to draw.

    Returns
    -------
    Axes
    """
    ax = blank(ax, 3.0, 3.0)
    n = layout.size
    for x in range(n):
        for y in range(n):
            cell, s = (x, y), layout.state((x, y))
            face = EARTH if cell in layout.cliff else "white"
            face = {layout.start: PALE, layout.goal: "#d9efe6"}.get(cell, face)
            ax.add_patch(Rectangle((x, y), 1, 1, facecolor=face, edgecolor=INK, linewidth=0.8))
            if cell in layout.cliff:
                continue
            if cell in (layout.start, layout.goal):
                letter = "S" if cell == layout.start else "G"
                ax.text(x + 0.06, y + 0.94, letter, ha="left", va="top", weight="bold")
            if values is not None and cell != layout.goal:
                number = f"{np.asarray(values)[s]:.3g}".replace("-", "\N{MINUS SIGN}")
                ax.text(x + 0.94, y + 0.07, number, ha="right", va="bottom", fontsize=8)
            if policy is not None and cell != layout.goal:
                row = np.asarray(policy, dtype=float)[s]
                for a in np.flatnonzero(row >= row.max() / 2):
                    dx, dy = MOVES[a]
                    middle = np.array([x + 0.5, y + 0.5])
                    reach = 0.3 * np.array([dx, dy])
                    from_middle = (row >= row.max() / 2).sum() > 1
                    ax.annotate(
                        "",
                        tuple(middle + reach),
                        tuple(middle if from_middle else middle - reach),
                        arrowprops={"arrowstyle": "-|>", "color": BLUE, "shrinkA": 0, "shrinkB": 0},
                        zorder=4,
                    )
    (x0, y0), (x1, y1) = layout.cliff[0], layout.cliff[-1]
    ax.text(
        (x0 + x1 + 1) / 2,
        (y0 + y1 + 1) / 2,
        "cliff",
        color="white",
        ha="center",
        va="center",
        rotation=0 if y0 == y1 else 90,
    )
    ax.set_xlim(-0.03, n + 0.03)
    ax.set_ylim(-0.03, n + 0.03)
    return ax


def draw_triangle(layout: TriangleLayout, *, ax: Axes | None = None) -> Axes:
    """One triangle task (figure 3.3a): L dashed, R solid, U dotted.

    Parameters
    ----------
    layout
        The task; a red one has red states.
    ax
        Where to draw.

    Returns
    -------
    Axes
    """
    ax = blank(ax, 3.4, 3.4)
    face = "#f6d5c4" if layout.red else "#cfe8dc"
    # State 1 bottom left, 2 top, 3 bottom right; counting up walks clockwise.
    angle = {1: 210, 2: 90, 3: 330}
    if layout.shape == "line":
        at = {s: (1.6 * (s - 2), 0.0) for s in STATES}
        outward = dict.fromkeys(STATES, (0.0, 1.0))
    else:
        at = {s: (np.cos(np.radians(angle[s])), np.sin(np.radians(angle[s]))) for s in STATES}
        outward = at
    goal = tuple(np.array(at[layout.goal]) + 1.15 * np.array(outward[layout.goal]))
    sides: dict[str, tuple[Line, str]] = {"L": ("--", BLUE), "R": ("-", INK), "U": (":", VERMILION)}
    for s in STATES:
        node(ax, at[s], str(s), face=face)
        for action in ("L", "R"):
            style, colour = sides[action]
            target = layout.neighbour(s, action)
            if target == s:
                out = (-1.0, 0.0) if s == 1 else (1.0, 0.0)
                loop(ax, at[s], out, style=style, colour=colour)
            else:
                arrow(ax, at[s], at[target], style=style, colour=colour, bend=0.16)
        style, colour = sides["U"]
        if s == layout.goal:
            arrow(ax, at[s], goal, style=style, colour=colour)
        else:
            loop(ax, at[s], outward[s], style=style, colour=colour)
    node(ax, goal, "goal", face="white", radius=NODE)
    fit(ax, [*at.values(), goal, (1.6, 0), (-1.6, 0)], 0.75)
    handles = [
        Line2D([], [], linestyle=style, color=colour, linewidth=1.6, label=action)
        for action, (style, colour) in sides.items()
    ]
    ax.legend(handles=handles, loc="upper right", handlelength=2.4)
    return ax


def draw_stock(task: StockMDP) -> Axes:
    """One stock task (figure 3.4a): which stocks and globals influence which sector."""
    size = task.size
    S, E, G = size.sectors, size.stocks, size.global_factors
    ax = blank(None, max(3.2, 1.9 * max(S, G / 2)), 3.0)
    width = max(1.9, 0.8 * E + 0.5)
    x_sector = [i * (width + 0.7) for i in range(S)]
    centre = (x_sector[0] + x_sector[-1] + width) / 2
    for s in range(S):
        box = Rectangle((x_sector[s], 0), width, 1.75, facecolor=PALE, edgecolor=INK, linewidth=1.0)
        ax.add_patch(box)
        middle, title = x_sector[s] + width / 2, f"$s_{{{s + 1}}}$"
        ax.text(middle, -0.24, title, ha="center", va="center", fontsize=10)
        target = (x_sector[s] + width / 2, 1.35)
        node(ax, target, f"$P_{{{s + 1}}}$", face="white", radius=0.24)
        for e in range(E):
            at = (x_sector[s] + (e + 0.5) * width / E, 0.42)
            node(ax, at, f"$e_{{{e + 1}}}$", face="white", radius=0.27)
            if task.influence[s, e]:
                arrow(ax, at, target, colour=GREEN, radius=0.27)
    for g in range(G):
        at = (centre + 1.15 * (g - (G - 1) / 2), 2.75)
        node(ax, at, f"$g_{{{g + 1}}}$", face="#fdf3d8", radius=0.33)
        style, colour = HELPS if task.rising_helps[g] else HINDERS
        for s in range(S):
            target = (x_sector[s] + width / 2, 1.35)
            arrow(ax, at, target, colour=colour, style=style, radius=0.33)
    ax.legend(
        handles=[
            Line2D([], [], color=GREEN, label="rising helps"),
            Line2D([], [], color=VERMILION, linestyle="--", label="falling helps"),
        ],
        loc="lower center",
        bbox_to_anchor=(0.5, -0.12),
        ncols=2,
    )
    low = min(x_sector[0], centre - 0.6 * G)
    high = max(x_sector[-1] + width, centre + 0.6 * G)
    ax.set_xlim(low - 0.2, high + 0.2)
    ax.set_ylim(-0.75, 3.2)
    return ax


def draw_heat(
    task: HeatTask,
    *,
    robot: ArrayLike = (3.0, 3.0, 0.6),
    path: ArrayLike | None = None,
    ax: Axes | None = None,
) -> Axes:
    """One heat task: the walled area, the heat, the source and the robot.

    Parameters
    ----------
    task
        The task.
    robot
        x, y and heading of the robot.
    path
        Positions visited, shape ``(n, 2)``, drawn as a line that ends at the robot.
    ax
        Where to draw.

    Returns
    -------
    Axes
    """
    ax = blank(ax, 3.6, 3.6)
    size, radius = task.world.size, task.world.radius
    grid = np.linspace(0, size, 101)
    x, y = np.meshgrid(grid, grid)
    warmth = task.world.heat(np.hypot(x - task.source[0], y - task.source[1]))
    ax.contourf(x, y, warmth, levels=np.linspace(0, 1, 11), cmap="OrRd", alpha=0.75, zorder=0)
    ax.add_patch(Rectangle((0, 0), size, size, fill=False, edgecolor=INK, linewidth=3))
    ax.plot(*task.source, marker="*", color=INK, markersize=15, zorder=5)
    write(ax, task.source[0], task.source[1] + 0.75, "source", INK)
    at_x, at_y, heading = np.asarray(robot, dtype=float)
    if path is not None:
        ax.plot(*np.asarray(path, dtype=float).T, color=BLUE, linewidth=1.4, zorder=2)
    ax.add_patch(
        Circle((at_x, at_y), radius, facecolor=PALE, edgecolor=BLUE, linewidth=2, zorder=3)
    )
    tip = (at_x + radius * np.cos(heading), at_y + radius * np.sin(heading))
    ax.plot([at_x, tip[0]], [at_y, tip[1]], color=BLUE, linewidth=2.4, zorder=4)
    ax.set_xlim(-0.15, size + 0.15)
    ax.set_ylim(-0.15, size + 0.15)
    return ax
