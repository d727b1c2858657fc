"""The heat domain as a table, for planning: cells of position, sectors of heading (section 4.3)."""

from __future__ import annotations

from itertools import product

import numpy as np

from thesis_lib.arrays import FloatArray
from thesis_lib.checks import positive_integer
from thesis_lib.domains.domain import Domain
from thesis_lib.domains.heat import ACTIONS, LAYOUTS, HeatWorld
from thesis_lib.mdp.model import TabularMDP

POINTS = 8
"""Of each quadrature: headings in a sector, and slips."""


def heat_table(cells: int = 5, headings: int = 4, discount: float = 0.95) -> Domain:
    """Four heat sources, one in each quarter of the area, with the robot's state in cells.

    An action leads where it leads on the average over a state that is spread evenly over its
    cell of position and its sector of heading.  An episode ends in the cells whose centre is
    within the robot's radius of the source.

    Parameters
    ----------
    cells
        A side, of where the robot's centre can be; at least 3.
    headings
        Sectors of heading, at least 3.
    discount
        gamma.

    Returns
    -------
    Domain
        States in the order of heading, y and x.  Features: ``x``, ``y``, ``heading``, and
        ``heat`` at the cell's centre, in the intervals of the learner's tilings.

    Raises
    ------
    ValueError
        For fewer cells or headings.
    """
    world = HeatWorld(sensor=0.0)
    if positive_integer("cells", cells) < 3 or positive_integer("headings", headings) < 3:
        raise ValueError(
            f"cells is {cells} and headings {headings}, but a heat table needs at least 3 of each."
        )
    n = cells * cells
    heading, y, x = (part.ravel() for part in np.indices((headings, cells, cells)))
    transition = np.zeros((headings * n, len(ACTIONS), headings * n))
    for h in range(headings):
        own = slice(h * n, (h + 1) * n)
        for action, sign in enumerate((1, -1)):
            transition[own, action, own] = _strides(world, cells, headings, h, sign)
    for action, sign in ((2, 1), (3, -1)):
        transition[:, action] = np.kron(_turns(world, headings, sign), np.eye(n))

    centre = world.radius + (np.arange(cells) + 0.5) * (world.size - 2 * world.radius) / cells
    intervals = LAYOUTS["headings"][3]
    stays = np.broadcast_to(np.eye(len(x))[:, None], transition.shape)
    tasks = []
    for source in product(centre[[1, -2]], repeat=2):
        distance = np.hypot(centre[x] - source[0], centre[y] - source[1])
        terminal = distance <= world.radius
        heat = np.minimum(intervals * world.heat(distance), intervals - 1).astype(np.int64)
        tasks.append(
            TabularMDP(
                np.where(terminal[:, None, None], stays, transition),
                np.outer(~terminal * world.step_reward, np.ones(len(ACTIONS))),
                ~terminal / np.count_nonzero(~terminal),
                terminal,
                discount=discount,
                features={"x": x, "y": y, "heading": heading, "heat": heat},
                actions=ACTIONS,
            )
        )
    return Domain("heat", tasks)


def _strides(world: HeatWorld, cells: int, headings: int, h: int, sign: int) -> FloatArray:
    """Where a stride leads from each cell with a heading in sector h, shape ``(cells^2,) * 2``."""
    width = (world.size - 2 * world.radius) / cells
    angle = 2 * np.pi * (h + (np.arange(POINTS) + 0.5) / POINTS) / headings
    slips, weights = _slips(world)
    out = np.zeros((cells * cells, cells * cells))
    for a, (slip, weight) in product(angle, zip(slips, weights, strict=True)):
        far = sign * (world.stride + slip) / width
        up, along = (_moved(far * part, cells) for part in (np.sin(a), np.cos(a)))
        out += weight / POINTS * np.kron(up, along)
    return out


def _moved(far: float, cells: int) -> FloatArray:
    """Share of each cell of a line that a shift, in cells, brings into each; walls stop it."""
    low = np.arange(cells)[:, None] + far
    edges = np.arange(cells + 1.0)
    edges[0], edges[-1] = -np.inf, np.inf
    return np.clip(np.minimum(low + 1, edges[1:]) - np.maximum(low, edges[:-1]), 0.0, None)


def _turns(world: HeatWorld, headings: int, sign: int) -> FloatArray:
    """Where a turn leads from each sector, shape ``(headings, headings)``."""
    out, stay = np.zeros((headings, headings)), np.eye(headings)
    for slip, weight in zip(*_slips(world), strict=True):
        whole, part = divmod(sign * (world.turn + slip) * headings / (2 * np.pi), 1)
        out += weight * (
            (1 - part) * np.roll(stay, int(whole), axis=1)
            + part * np.roll(stay, int(whole) + 1, axis=1)
        )
    return out


def _slips(world: HeatWorld) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights of the mean over the slip of an action (Gauss and Hermite)."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(POINTS)
    return world.slip * nodes, weights / weights.sum()
