"""The triangle domain: twelve episodic tasks with three states each (section 3.4.3).

Three states stand in a ring and one of them touches the goal.  Actions L and R walk
round the ring, U reaches for the goal.  Three places for the goal, two directions and
two colours make twelve tasks.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.checks import one_of
from thesis_lib.domains.domain import Domain
from thesis_lib.mdp.model import TabularMDP

STATES = (1, 2, 3)
ACTIONS = ("L", "R", "U")
Shape = Literal["ring", "line"]

DISTANCE_CODE = 36
"""Feature x2 is coded as the integer 36 / distance**2 (36, 9 or 4), so that x2 is code / 36."""


@dataclass(frozen=True)
class TriangleLayout:
    """Where the goal of one task is and what its actions do.

    Attributes
    ----------
    goal
        The state (1, 2 or 3) that touches the goal.
    reversed
        Whether L and R have changed places.
    red
        The colour: red (True) or green.
    shape
        ``"ring"``, or ``"line"`` for the reading in which state 1 and state 3 are ends,
        at which L or R stays.
    """

    goal: int
    reversed: bool = False
    red: bool = False
    shape: Shape = "ring"

    @property
    def name(self) -> str:
        """The layout as text, such as ``goal 2, red, reversed``."""
        words = [f"goal {self.goal}", "red" if self.red else "green"]
        return ", ".join(words + ["reversed"] * self.reversed)

    def neighbour(self, state: int, action: str) -> int:
        """The state that L or R leads to."""
        step = 1 if (action == "R") != self.reversed else -1
        if self.shape == "line":
            return min(max(state + step, 1), 3)
        return (state - 1 + step) % 3 + 1

    def distance(self, state: int) -> int:
        """Steps from a state to the goal, at least 1."""
        apart = abs(state - self.goal)
        return 1 + (min(apart, 3 - apart) if self.shape == "ring" else apart)


def layouts(shape: Shape = "ring") -> tuple[TriangleLayout, ...]:
    """All twelve layouts: goal, direction, colour.

    Parameters
    ----------
    shape
        ``"ring"`` or ``"line"``.

    Returns
    -------
    tuple[TriangleLayout, ...]
    """
    one_of("shape", shape, get_args(Shape))
    return tuple(
        TriangleLayout(goal, reverse, red, shape)
        for goal in STATES
        for reverse in (False, True)
        for red in (False, True)
    )


def triangle_task(
    layout: TriangleLayout,
    *,
    discount: float = 1.0,
    step_reward: float = -1.0,
    red_penalty: float = 10.0,
    start: ArrayLike | None = None,
) -> TabularMDP:
    """One triangle task.

    Every step earns ``step_reward``, the one into the goal too.  A self-transition in a
    red task earns ``red_penalty`` less.

    Parameters
    ----------
    layout
        Goal, direction and colour.
    discount
        gamma; 1 in the thesis.
    step_reward
        Reward of every step.
    red_penalty
        What a self-transition costs in a red task, on top of the step; 10 in the thesis.
    start
        Start-state distribution over states 1, 2, 3; default uniform, as the thesis does
        not say where an episode starts.

    Returns
    -------
    TabularMDP
        States 0, 1, 2 stand for 1, 2, 3 and state 3 is terminal.  Features ``x1`` (the
        state's number), ``x2`` (``DISTANCE_CODE`` times the inverse squared distance to
        the goal) and ``x3`` (1 red, 0 green); all are 0 in the terminal state.
    """
    transition = np.zeros((4, 3, 4))
    reward = np.full((4, 3), float(step_reward))
    for s in STATES:
        for a, action in enumerate(ACTIONS):
            if action == "U":
                target = 4 if s == layout.goal else s
            else:
                target = layout.neighbour(s, action)
            transition[s - 1, a, target - 1] = 1.0
            if target == s and layout.red:
                reward[s - 1, a] -= red_penalty
    transition[3, :, 3] = 1.0
    reward[3] = 0.0
    weights = np.full(3, 1 / 3) if start is None else np.asarray(start, dtype=float)
    if weights.shape != (3,):
        raise ValueError(
            f"start has shape {weights.shape}, but one probability for each of the states 1, 2 "
            "and 3 is needed, shape (3,)."
        )
    code = [DISTANCE_CODE // layout.distance(s) ** 2 for s in STATES]
    return TabularMDP(
        transition=transition,
        reward=reward,
        start=np.append(weights, 0.0),
        terminal=np.array([False, False, False, True]),
        discount=discount,
        features={
            "x1": np.array([*STATES, 0]),
            "x2": np.array([*code, 0]),
            "x3": np.array([int(layout.red)] * 3 + [0]),
        },
        actions=ACTIONS,
    )


def triangle(
    *,
    shape: Shape = "ring",
    discount: float = 1.0,
    step_reward: float = -1.0,
    red_penalty: float = 10.0,
    start: ArrayLike | None = None,
) -> Domain:
    """The triangle domain of section 3.4.3: 12 tasks, uniform D, 36 state-action pairs.

    The text gives the distances of one task only.  In a ring they come out as printed and
    every task has 9 of 36 state-action pairs; on a line the tasks with the goal at an end
    have a third distance and the domain has 48 pairs.

    Parameters
    ----------
    shape
        ``"ring"``, or ``"line"`` for the other reading.
    discount, step_reward, red_penalty, start
        See :func:`triangle_task`.

    Returns
    -------
    Domain

    Examples
    --------
    >>> domain = triangle()
    >>> len(domain), domain.shape
    (12, (12, 3))
    >>> domain.actions
    ('L', 'R', 'U')
    """
    all_layouts = layouts(shape)
    tasks = tuple(
        triangle_task(
            layout,
            discount=discount,
            step_reward=step_reward,
            red_penalty=red_penalty,
            start=start,
        )
        for layout in all_layouts
    )
    return Domain(
        name="triangle" if shape == "ring" else "triangle on a line",
        tasks=tasks,
        task_names=tuple(layout.name for layout in all_layouts),
    )
