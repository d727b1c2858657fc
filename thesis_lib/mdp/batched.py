"""Many tasks learned in one compiled call, for experiments that need total rewards alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.compiled import njit
from thesis_lib.mdp.checks import generator, one_of, positive_integer, schedule
from thesis_lib.mdp.greedy import RELATIVE_TIE
from thesis_lib.mdp.learning import DOUBLE_Q_LEARNING, ENDS, METHODS, STRETCH, Method, _run
from thesis_lib.mdp.model import MDP
from thesis_lib.mdp.sampling import sampler


class TaskBatch:
    """Several tasks made ready to be learned together, as often as asked.

    The numbers are those of :func:`~thesis_lib.mdp.learning.learn` called on each task, to
    the last bit: the same compiled loop runs with the same random numbers.  What is saved is
    all that Python does around it, and the interpreter's lock is free for the whole batch.

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
        self._tasks = (
            tuple(s.successor for s in samplers),
            tuple(s.cumulative for s in samplers),
            tuple(s.reward for s in samplers),
            tuple(s.terminal for s in samplers),
            tuple(s.start for s in samplers),
            tuple(s.start_cumulative for s in samplers),
            tuple(np.require(rows, np.int64, ["C", "W"]) for rows in index),
            np.array([task.discount for task in tasks]),
            np.array([_reward_scale(t, s.reward) for t, s in zip(tasks, samplers, strict=True)]),
        )
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
        totals = np.empty(self.n_tasks)
        _run_all(
            self._rule,
            *self._tasks,
            values,
            *self._rates,
            *self._budget,
            tuple(generator(rng) for rng in rngs),
            totals,
        )
        return totals


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
def _run_all(  # type: ignore[no-untyped-def]
    rule, successor, cumulative, reward, terminal, start, start_cumulative, index, discount, scale,
    function, rate, explore, n_episodes, n_steps, rngs, totals,
):  # fmt: skip
    """Run the loop of :func:`learn` on every task."""
    A = function.shape[1]
    ends = np.empty((ENDS, 3))
    marks = np.empty(0)
    numbers = np.empty((0, 2))
    indices = np.empty((0, 2), np.int32)
    for i in range(len(successor)):
        rows = index[i]
        S = rows.shape[0]
        q = np.zeros((S, A))
        for s in range(S):
            if rows[s] >= 0:
                q[s] = function[rows[s]]
        # ``learn`` clears terminal rows; an index of -1 stands for them here as well.
        for s in range(S):
            if terminal[i][s]:
                q[s] = 0.0
        phi = np.zeros((S, A))
        pair = np.zeros((2, 0, 0))
        if rule == DOUBLE_Q_LEARNING:
            pair = np.zeros((2, S, A))
            pair[0] = q
            pair[1] = q
        nothing = np.zeros((0, 0))
        tie = RELATIVE_TIE * max(scale[i], _largest(q))
        whole = np.array([0, -1, 0, 0, 0])
        sums = np.zeros(2)
        advised = q + phi
        visits = np.zeros((S, A), np.int64)
        while whole[2] != n_steps and whole[3] != n_episodes:
            until = n_steps if n_steps >= 0 else whole[2] + STRETCH
            _run(
                rule, -1,
                successor[i], cumulative[i], reward[i], terminal[i], start[i],
                start_cumulative[i], discount[i],
                q, phi, advised, pair, nothing, nothing, visits,
                rate, explore, rate, False, tie,
                n_episodes, n_steps, 0, 0,
                whole, sums,
                ends, marks, np.empty((0, S, A)), numbers, indices,
                until, rngs[i],
            )  # fmt: skip
        totals[i] = sums[0]
