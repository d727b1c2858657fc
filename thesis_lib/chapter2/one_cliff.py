"""One cliff task, and where a greedy policy leads on it (section 2.3.3).

The eight tasks of the cliff domain are mirror images of each other, so one of them, start
in the lower left corner and goal in the lower right one, stands for all.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from thesis_lib.arrays import FloatArray
from thesis_lib.domains.cliff import CliffLayout, cliff_task, layouts
from thesis_lib.mdp.model import TabularMDP

Algorithm = Literal["q_learning", "sarsa"]

LEARNERS: Mapping[Algorithm, str] = {"q_learning": "Q-learning", "sarsa": "Sarsa"}
"""The algorithms compared, and how figures and tables name them."""

LONGEST_PATH = 100
"""A greedy path that has not ended by then goes in circles."""


def layout() -> CliffLayout:
    """The task of this module: start (0, 0), goal (3, 0), cliff between."""
    return layouts()[0]


def task(discount: float = 1.0) -> TabularMDP:
    """Its MDP, without the sensor."""
    return cliff_task(layout(), sensor=False, discount=discount)


@dataclass(frozen=True)
class GreedyPath:
    """Where the greedy policy leads from the start of a deterministic task.

    Attributes
    ----------
    states
        Up to the terminal state, or up to the first state met again.
    earned
        Sum of rewards on the way; where the path goes in circles, of
        :data:`LONGEST_PATH` steps.
    ends
        Whether it reaches a terminal state.
    """

    states: tuple[int, ...]
    earned: float
    ends: bool


def greedy_path(mdp: TabularMDP, q: FloatArray) -> GreedyPath:
    """Follow the greedy policy of ``q`` from the start state; the first of tied actions.

    Parameters
    ----------
    mdp
        A task with one start state and deterministic transitions.
    q
        State-action values, shape ``(S, A)``.
    """
    greedy = q.argmax(axis=1)
    s = int(mdp.start.argmax())
    states, earned = [s], 0.0
    for _ in range(LONGEST_PATH):
        a = greedy[s]
        earned += mdp.reward[s, a]
        s = int(mdp.transition[s, a].argmax())
        states.append(s)
        if mdp.terminal[s]:
            return GreedyPath(tuple(states), float(earned), True)
    first = {s: states.index(s) for s in states}
    again = next(i for i, s in enumerate(states) if first[s] < i)
    return GreedyPath(tuple(states[: again + 1]), float(earned), False)


def cells_at_edge(path: GreedyPath, where: CliffLayout) -> int:
    """How many cells of the path, start and goal apart, have the cliff next to them."""
    cells = {where.cell(s) for s in path.states} - {where.start, where.goal}
    return sum(where.sensor(cell) > 0 for cell in cells)
