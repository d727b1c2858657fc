"""Checks of arguments shared by planning, learning and the environments."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import FloatArray
from thesis_lib.mdp.model import MDP

Schedule = float | ArrayLike | Callable[[np.ndarray], ArrayLike]
"""A constant, one value an episode or step, or a function from 0, 1, 2, ... to those values."""


def require_mdp(mdp: MDP) -> None:
    """Raise ValueError, saying what to pass instead, unless it is an MDP."""
    if isinstance(mdp, MDP):
        return
    inner = getattr(mdp, "unwrapped", None)
    if isinstance(getattr(inner, "mdp", None), MDP):
        instead = "its MDP, env.unwrapped.mdp"
    elif hasattr(inner, "P"):
        instead = "thesis_lib.mdp.environment.from_gymnasium(env, discount)"
    else:
        instead = "an MDP such as TabularMDP(transition, reward, start) or domain.tasks[0]"
    raise ValueError(f"a task is needed, but {mdp!r:.200} was given; pass {instead}.")


def schedule(
    name: str, value: Schedule, length: int, unit: str, *, zero_allowed: bool
) -> FloatArray:
    """Evaluate a learning rate or exploration rate.

    Parameters
    ----------
    name
        Name of the argument, for the message.
    value
        A number, ``length`` numbers, or a function from ``arange(length)`` to them.
    length
        Number of episodes or steps to be learned.
    unit
        ``"episode"`` or ``"step"``, for the message.
    zero_allowed
        Whether 0 is a legal value.

    Returns
    -------
    FloatArray
        Shape ``(1,)`` for a constant, else ``(length,)``.

    Raises
    ------
    ValueError
        When the shape is wrong or a value is outside the range.
    """
    raw = value(np.arange(length)) if callable(value) else value
    try:
        rates = np.array(raw, dtype=np.float64, ndmin=1)
    except (TypeError, ValueError):
        raise ValueError(
            f"{name} is {value!r}, but it must be a number, an array of one number "
            f"for each {unit}, or a function that returns one of these."
        ) from None
    if rates.shape not in ((1,), (length,)):
        raise ValueError(
            f"{name} has shape {rates.shape}, but it must be one number or one for each {unit}, "
            f"shape ({length},)."
        )
    legal = (rates <= 1) & ((rates >= 0) if zero_allowed else (rates > 0))
    if not legal.all():
        i = int(np.argmin(legal))
        where = f" at {unit} {i}" if rates.size > 1 else ""
        interval = "[0, 1]" if zero_allowed else "(0, 1]"
        raise ValueError(f"{name} is {rates[i]}{where}, but it must be in {interval}.")
    return rates


def table(name: str, values: ArrayLike, mdp: MDP) -> FloatArray:
    """Copy a table of one number a state-action pair, with 0 for terminal states.

    Parameters
    ----------
    name
        Name of the argument, for the message.
    values
        Shape ``(S, A)``.  Rows of terminal states are not read, as their value is 0
        by definition.
    mdp
        The task.

    Returns
    -------
    FloatArray
        A new array, shape ``(S, A)``.

    Raises
    ------
    ValueError
        When the shape is wrong or a non-terminal pair has no finite value.
    """
    array = np.array(values, dtype=np.float64, order="C")
    shape = (mdp.n_states, mdp.n_actions)
    if array.shape != shape:
        raise ValueError(
            f"{name} has shape {array.shape}, but {shape} is needed: one value for each state "
            "and action of the task."
        )
    array[mdp.terminal] = 0.0
    missing = ~np.isfinite(array)
    if missing.any():
        s, a = np.argwhere(missing)[0]
        raise ValueError(
            f"{name} of pair [state {s}, action {mdp.actions[a]}] is {array[s, a]} "
            f"({missing.sum()} such pairs), but every pair of a non-terminal state needs a finite "
            "value; give pairs that were never seen a number, such as 0."
        )
    return array


def state_values(name: str, values: ArrayLike, mdp: MDP) -> FloatArray:
    """Copy a table of one number a state, with 0 for terminal states; see :func:`table`."""
    array = np.array(values, dtype=np.float64)
    if array.shape != (mdp.n_states,):
        raise ValueError(
            f"{name} has shape {array.shape}, but ({mdp.n_states},) is needed: one value a state."
        )
    array[mdp.terminal] = 0.0
    if not np.isfinite(array).all():
        s = int(np.argmin(np.isfinite(array)))
        raise ValueError(f"{name} of state {s} is {array[s]}, but it must be finite.")
    return array


def policy_matrix(policy: ArrayLike, mdp: MDP) -> FloatArray:
    r"""Write a policy as action probabilities.

    Parameters
    ----------
    policy
        Action indices, shape ``(S,)`` of integers, or probabilities, shape ``(S, A)``.
    mdp
        The task.

    Returns
    -------
    FloatArray
        :math:`\pi(s, a)`, shape ``(S, A)``; uniform in terminal states, where no action
        matters.

    Raises
    ------
    ValueError
        When the shape is wrong, an index is no action, or a row of a non-terminal state
        is no probability distribution.
    """
    require_mdp(mdp)
    given = np.asarray(policy)
    S, A = mdp.n_states, mdp.n_actions
    if given.shape == (S,) and np.issubdtype(given.dtype, np.integer):
        wrong = (given < 0) | (given >= A)
        if wrong.any():
            s = int(np.argmax(wrong))
            raise ValueError(
                f"policy of state {s} is action {given[s]}, but actions are 0 to {A - 1}."
            )
        return np.eye(A)[given]
    if given.shape != (S, A):
        raise ValueError(
            f"policy has shape {given.shape} and type {given.dtype}, but it must be one action "
            f"index a state, shape ({S},), or action probabilities, shape ({S}, {A})."
        )
    matrix = np.array(given, dtype=np.float64)
    total = matrix.sum(axis=1)
    wrong = ~((matrix >= 0).all(axis=1) & (np.abs(total - 1) <= 1e-9)) & ~mdp.terminal
    if wrong.any():
        s = int(np.argmax(wrong))
        raise ValueError(
            f"policy of state {s} is {np.array2string(matrix[s], precision=6, threshold=8)}, but "
            "the probabilities of its actions must be at least 0 and sum to 1."
        )
    matrix[mdp.terminal] = 1 / A
    return matrix
