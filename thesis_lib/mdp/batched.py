"""Many tasks learned again and again, for experiments that need total rewards alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.checks import generator, one_of, positive_integer
from thesis_lib.compiled import njit
from thesis_lib.mdp.checks import schedule
from thesis_lib.mdp.greedy import RELATIVE_TIE
from thesis_lib.mdp.learning import DOUBLE_Q_LEARNING, ENDS, METHODS, STRETCH, Method, _run
from thesis_lib.mdp.model import MDP
from thesis_lib.mdp.sampling import sampler


class TaskBatch:
    """Several tasks made ready to be learned together, as often as asked.

    The numbers are those of :func:`~thesis_lib.mdp.learning.learn` called on each task, to
    the last bit: the same compiled loop runs with the same random numbers.  What is saved is
    nearly all that Python does around it.

    Parameters
    ----------
    tasks
        T tasks with equal actions and discount.
    index
        For each task the row of the initial function of every state, shape ``(S_m,)``; -1
        for states whose values start at 0.
    method
        The learning rule.
    alpha, epsilon
        Constant learning rate and probability of a random action.
    episodes, steps
        The budget: exactly one of the two.

    Raises
    ------
    ValueError
        When lengths disagree or an argument is out of range.
    """

    def __init__(
        self,
        tasks: Sequence[MDP],
        index: Sequence[IntArray],
        method: Method,
        *,
        alpha: float,
        epsilon: float,
        episodes: int | None = None,
        steps: int | None = None,
    ) -> None:
        one_of("method", method, METHODS)
        if (episodes is None) == (steps is None):
            given = "neither" if episodes is None else "both"
            raise ValueError(f"{given} of episodes and steps given, but exactly one is the budget.")
        if len(tasks) == 0 or len(index) != len(tasks):
            raise ValueError(
                f"there are {len(tasks)} tasks and {len(index)} indices, but one index a task is "
                "needed for at least one task."
            )
        for m, (task, rows) in enumerate(zip(tasks, index, strict=True)):
            if rows.shape != (task.n_states,) or rows.min() < -1:
                raise ValueError(
                    f"index {m} has shape {rows.shape} and smallest entry {rows.min()}, but one "
                    f"row of at least -1 for each of {task.n_states} states is needed."
                )
        unit, length = "step", 0
        if episodes is not None:
            unit, length = "episode", positive_integer("episodes", episodes)
            endless = [m for m, task in enumerate(tasks) if not task.terminal.any()]
            if endless:
                raise ValueError(
                    f"task {endless[0]} has no terminal state; give steps, not episodes."
                )
        elif steps is not None:
            length = positive_integer("steps", steps)
        samplers = [sampler(task) for task in tasks]
        self.n_tasks = len(tasks)
        self._shape = max(int(rows.max()) for rows in index) + 1, tasks[0].n_actions
        self._tasks = [
            (
                *s,
                float(task.discount),
                np.require(rows, np.int64, ["C", "W"]),
                _reward_scale(task, s.reward),
            )
            for task, s, rows in zip(tasks, samplers, index, strict=True)
        ]
        self._rule = METHODS.index(method)
        self._rates = (
            schedule("alpha", alpha, length, unit, zero_allowed=False),
            schedule("epsilon", epsilon, length, unit, zero_allowed=True),
        )
        self._budget = (length, -1) if unit == "episode" else (-1, length)

    def total_rewards(
        self, function: ArrayLike, rngs: Sequence[np.random.Generator | int]
    ) -> FloatArray:
        """Total reward on each task when it is learned from initial values.

        Parameters
        ----------
        function
            Initial Q-values on the pairs that the tasks share, shape ``(O, A)``.
        rngs
            Generator or seed of each task.

        Returns
        -------
        FloatArray
            Shape ``(T,)``.

        Raises
        ------
        ValueError
            When a shape is wrong or the function is not finite.
        """
        values = np.require(function, np.float64, ["C"])
        least, n_actions = self._shape
        if values.ndim != 2 or len(values) < least or values.shape[1] != n_actions:
            raise ValueError(
                f"function has shape {values.shape}, but at least {least} rows and {n_actions} "
                "columns are needed: one value for each pair that the indices name."
            )
        if not np.isfinite(values).all():
            raise ValueError(
                "function is not finite everywhere, but every pair needs an initial value; "
                "replace missing ones, for instance by 0."
            )
        if len(rngs) != self.n_tasks:
            raise ValueError(
                f"there are {self.n_tasks} tasks and {len(rngs)} generators, but one a task is "
                "needed."
            )
        own = (self._rule, values, *self._rates, *self._budget)
        return np.array(
            [_run_one(*own, *task, generator(g)) for task, g in zip(self._tasks, rngs, strict=True)]
        )


def _reward_scale(task: MDP, reward: FloatArray) -> float:
    """Largest magnitude of a task's rewards, kept with the task like its sampler."""
    kept = task.__dict__.get("_reward_scale")
    if kept is None:
        finite = np.isfinite(reward)
        kept = float(np.max(np.abs(reward), where=finite, initial=0.0))
        task.__dict__["_reward_scale"] = kept
    return float(kept)


@njit(error_model="numpy")
def _largest(table):  # type: ignore[no-untyped-def]
    """Largest finite magnitude, or 0, as in ``tie_tolerance``."""
    out = 0.0
    for value in table.flat:
        size = abs(value)
        if np.isfinite(size) and size > out:
            out = size
    return out


@njit(error_model="numpy")
def _run_one(  # type: ignore[no-untyped-def]
    rule, function, rate, explore, n_episodes, n_steps,
    successor, cumulative, reward, terminal, start, start_cumulative, discount, rows, scale, rng,
):  # fmt: skip
    """Total reward of the loop of :func:`learn` on one task."""
    S, A = rows.shape[0], function.shape[1]
    q = np.zeros((S, A))
    for s in range(S):
        # ``learn`` clears terminal rows; an index of -1 stands for them here as well.
        if rows[s] >= 0 and not terminal[s]:
            q[s] = function[rows[s]]
    phi = np.zeros((S, A))
    pair = np.zeros((2, 0, 0))
    if rule == DOUBLE_Q_LEARNING:
        pair = np.zeros((2, S, A))
        pair[0] = q
        pair[1] = q
    nothing = np.zeros((0, 0))
    tie = RELATIVE_TIE * max(scale, _largest(q))
    whole = np.array([0, -1, 0, 0, 0])
    sums = np.zeros(2)
    advised = q + phi
    visits = np.zeros((S, A), np.int64)
    ends = np.empty((ENDS, 3))
    while whole[2] != n_steps and whole[3] != n_episodes:
        until = n_steps if n_steps >= 0 else whole[2] + STRETCH
        _run(
            rule, -1,
            successor, cumulative, reward, terminal, start, start_cumulative, discount,
            q, phi, advised, pair, nothing, nothing, visits,
            rate, explore, rate, False, tie,
            n_episodes, n_steps, 0, 0,
            whole, sums,
            ends, np.empty(0), np.empty((0, S, A)), np.empty((0, 2)), np.empty((0, 2), np.int32),
            until, rng,
        )  # fmt: skip
    return sums[0]
