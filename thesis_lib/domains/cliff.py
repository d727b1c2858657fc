"""The cliff domain: eight tasks on a 4 x 4 grid (sections 3.4.1 and 3.4.2).

The start lies in one corner, the goal in another corner of the same row or column,
and the cells in between are a cliff.  Four corners times two directions make eight
tasks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from thesis_lib.arrays import BoolArray
from thesis_lib.domains.domain import Domain
from thesis_lib.mdp.model import TabularMDP

SIZE = 4
ACTIONS = ("N", "E", "S", "W")
MOVES = ((0, 1), (1, 0), (0, -1), (-1, 0))


@dataclass(frozen=True)
class CliffLayout:
    """Where the start, the goal and the cliff of one task lie; cells are ``(x, y)``.

    Attributes
    ----------
    start, goal
        Corner cells in the same row or column.
    size
        Cells a side.
    """

    start: tuple[int, int]
    goal: tuple[int, int]
    size: int = SIZE

    @property
    def cliff(self) -> tuple[tuple[int, int], ...]:
        """The cells strictly between start and goal."""
        (x0, y0), (x1, y1) = self.start, self.goal
        dx, dy = np.sign(x1 - x0), np.sign(y1 - y0)
        steps = range(1, max(abs(x1 - x0), abs(y1 - y0)))
        return tuple((int(x0 + i * dx), int(y0 + i * dy)) for i in steps)

    @property
    def name(self) -> str:
        """Start and goal as text, such as ``(0,0)->(3,0)``."""
        return "({},{})->({},{})".format(*self.start, *self.goal)

    def cell(self, state: int) -> tuple[int, int]:
        """The cell (x, y) of a state; states count along x first."""
        return state % self.size, state // self.size

    def state(self, cell: tuple[int, int]) -> int:
        """The state of a cell (x, y)."""
        return cell[1] * self.size + cell[0]

    def neighbour(self, cell: tuple[int, int], action: int) -> tuple[int, int]:
        """The cell an action leads to; a step off the grid stays."""
        x, y = (c + d for c, d in zip(cell, MOVES[action], strict=True))
        return (x, y) if 0 <= x < self.size and 0 <= y < self.size else cell

    def sensor(self, cell: tuple[int, int]) -> int:
        """What the cliff sensor reads: 1..4 if the cliff is next to the cell to N, E, S, W, else 0.

        The cliff is a straight line, so no cell outside it has cliff on two sides.
        """
        near = [a + 1 for a in range(4) if self.neighbour(cell, a) in self.cliff]
        return near[0] if near and cell not in self.cliff else 0


def layouts(size: int = SIZE) -> tuple[CliffLayout, ...]:
    """All eight layouts: each corner as the start, both neighbouring corners as the goal.

    Parameters
    ----------
    size
        Cells a side, at least 3 (with 2 there is no cell for a cliff).

    Returns
    -------
    tuple[CliffLayout, ...]
    """
    if size < 3:
        raise ValueError(f"size is {size}, but a cliff needs at least 3 cells a side.")
    far = size - 1
    corners = ((0, 0), (far, 0), (0, far), (far, far))
    return tuple(
        CliffLayout(start, goal, size)
        for start in corners
        for goal in corners
        if (start[0] == goal[0]) != (start[1] == goal[1])
    )


def cliff_task(
    layout: CliffLayout,
    *,
    continuing: bool = False,
    sensor: bool = True,
    discount: float = 1.0,
    fall_reward: float = -1000.0,
    step_reward: float | None = None,
    goal_reward: float | None = None,
    fall_costs_step: bool = False,
) -> TabularMDP:
    """One cliff task.

    A fall earns ``fall_reward`` and teleports to the start.  In the episodic task every
    other step costs 1, the one into the goal too, and the goal is terminal.  In the
    continuing task a step earns 0 and reaching the goal earns 10 and teleports to the
    start.

    Parameters
    ----------
    layout
        Where things lie.
    continuing
        The task of section 3.4.2 instead of 3.4.1.
    sensor
        Whether the cliff sensor is among the features.
    discount
        gamma; 1 in section 3.4.1, not printed for 3.4.2.
    fall_reward, step_reward, goal_reward
        Rewards; default -1000, and -1, -1 (episodic) or 0, 10 (continuing).
    fall_costs_step
        Whether a fall costs the step penalty as well.  The text does not say; without
        it Table 3.1 is met (see "Differences from the thesis").

    Returns
    -------
    TabularMDP
        States are cells, counted along x first; features ``x``, ``y`` (and ``cliff``).
    """
    step = (0.0 if continuing else -1.0) if step_reward is None else step_reward
    goal_r = (10.0 if continuing else step) if goal_reward is None else goal_reward
    n = layout.size**2
    goal, start = layout.state(layout.goal), layout.state(layout.start)
    transition = np.zeros((n, 4, n))
    reward = np.full((n, 4), step)
    terminal = np.zeros(n, dtype=bool)
    for s in range(n):
        for a in range(4):
            cell = layout.neighbour(layout.cell(s), a)
            target = layout.state(cell)
            if cell in layout.cliff:
                reward[s, a] = fall_reward + (step if fall_costs_step else 0.0)
                target = start
            elif cell == layout.goal:
                reward[s, a] = goal_r
                target = start if continuing else goal
            transition[s, a, target] = 1.0
    if not continuing:
        terminal[goal] = True
        transition[goal], reward[goal] = 0.0, 0.0
        transition[goal, :, goal] = 1.0
    cells = [layout.cell(s) for s in range(n)]
    features = {"x": np.array([c[0] for c in cells]), "y": np.array([c[1] for c in cells])}
    if sensor:
        features["cliff"] = np.array([layout.sensor(c) for c in cells])
    return TabularMDP(
        transition=transition,
        reward=reward,
        start=np.eye(n)[start],
        terminal=terminal,
        discount=discount,
        features=features,
        actions=ACTIONS,
    )


def members(layout: CliffLayout) -> BoolArray:
    """The states an agent can act in: all but the cliff and the goal, shape ``(S,)``."""
    inside = [layout.cell(s) for s in range(layout.size**2)]
    return np.array([c not in layout.cliff and c != layout.goal for c in inside])


def episodic_cliff(sensor: bool = False, *, size: int = SIZE, **options: float) -> Domain:
    """The episodic cliff domain of section 3.4.1: 8 tasks, uniform D.

    Parameters
    ----------
    sensor
        Whether the agent has the cliff sensor (Table 3.1b).
    size
        Cells a side.
    **options
        Passed to :func:`cliff_task`.

    Returns
    -------
    Domain
    """
    name = "episodic cliff" + (" with sensor" if sensor else "")
    return _domain(name, size, sensor=sensor, continuing=False, **options)


def continuing_cliff(
    discount: float = 0.95, sensor: bool = True, *, size: int = SIZE, **options: float
) -> Domain:
    """The continuing cliff domain of section 3.4.2: 8 tasks with the sensor, uniform D.

    Parameters
    ----------
    discount
        gamma, which the thesis does not print.
    sensor
        Whether the agent has the cliff sensor.
    size
        Cells a side.
    **options
        Passed to :func:`cliff_task`.

    Returns
    -------
    Domain

    Examples
    --------
    >>> domain = continuing_cliff()
    >>> len(domain), domain.shape, domain.feature_names
    (8, (32, 4), ('x', 'y', 'cliff'))
    """
    return _domain(
        "continuing cliff", size, sensor=sensor, continuing=True, discount=discount, **options
    )


def _domain(name: str, size: int, **options: float) -> Domain:
    all_layouts = layouts(size)
    return Domain(
        name=name,
        tasks=tuple(cliff_task(layout, **options) for layout in all_layouts),  # type: ignore[arg-type]
        members=tuple(members(layout) for layout in all_layouts),
        task_names=tuple(layout.name for layout in all_layouts),
    )
