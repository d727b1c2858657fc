"""Drawing start states and transitions, one uniform number a draw."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from thesis_lib.arrays import BoolArray, FloatArray
from thesis_lib.compiled import njit
from thesis_lib.mdp.model import MDP

CACHED_OUTCOMES = 2**18
"""Samplers of more outcomes than this are rebuilt when asked for, not kept in memory."""


class Sampler(NamedTuple):
    """The distributions of a task, in the form and order in which the compiled loops take them.

    A draw takes one uniform number u in [0, 1) and returns the first outcome whose
    cumulative probability is above u.  Where there is one outcome only, none is taken.

    Attributes
    ----------
    successor
        Next state of each outcome, shape ``(S, A, K)``.
    cumulative
        Cumulative probability of each outcome, shape ``(S, A, K)``; exactly 1 from the
        last possible outcome on.
    reward
        Reward of each outcome, shape ``(S, A, K)``.
    terminal
        Absorbing states, shape ``(S,)``.
    start
        Possible start states, shape ``(N,)``.
    start_cumulative
        Their cumulative probability, shape ``(N,)``.
    """

    successor: NDArray[np.int32]
    cumulative: FloatArray
    reward: FloatArray
    terminal: BoolArray
    start: NDArray[np.int32]
    start_cumulative: FloatArray


def sampler(mdp: MDP) -> Sampler:
    """Prepare drawing from a task.

    Parameters
    ----------
    mdp
        The task.  The sampler of a small task is kept with it.

    Raises
    ------
    ValueError
        When an episode would start in a terminal state.
    """
    kept = mdp.__dict__.get("_sampler")
    if isinstance(kept, Sampler):
        return kept
    outcomes = mdp.outcomes()
    start = np.flatnonzero(mdp.start > 0)
    ended = mdp.terminal[start]
    if ended.any():
        raise ValueError(
            f"start gives terminal state {start[ended][0]} probability "
            f"{mdp.start[start[ended][0]]:.6g}, but an episode must start in a non-terminal state."
        )
    built = Sampler(
        loop_array(outcomes.successor, np.int32),
        cumulative(outcomes.probability),
        loop_array(outcomes.reward, np.float64),
        loop_array(mdp.terminal, np.bool_),
        start.astype(np.int32),
        cumulative(mdp.start[start]),
    )
    if built.successor.size <= CACHED_OUTCOMES:
        mdp.__dict__["_sampler"] = built
    return built


def loop_array(array: NDArray[Any], dtype: type[np.generic]) -> NDArray[Any]:
    """Return an array in the one form the loops are compiled for, copied only if need be.

    Numba would compile a loop anew for a read-only array or another memory order.
    """
    return np.require(array, dtype, ["C", "W"])


def cumulative(probability: FloatArray) -> FloatArray:
    """Cumulative sums over the last axis, exactly 1 from the last possible outcome on.

    Parameters
    ----------
    probability
        Rows of probabilities, shape ``(..., K)``.

    Returns
    -------
    FloatArray
        Shape ``(..., K)``.
    """
    total = np.cumsum(probability, axis=-1)
    width = probability.shape[-1]
    last = width - 1 - np.argmax(probability[..., ::-1] > 0, axis=-1)
    # A row may sum to 1 - 1e-16: without this a draw could fall off its end.
    total[np.arange(width) >= last[..., None]] = 1.0
    return total


@njit()
def draw(row, u):  # type: ignore[no-untyped-def]
    """Index of the first entry of the cumulative ``row`` above ``u``, by bisection.

    The cached loops that call this do not notice a change here: after one, delete the
    ``__pycache__`` of this folder.
    """
    low = 0
    high = row.shape[0] - 1
    while low < high:
        middle = (low + high) >> 1
        if row[middle] > u:
            high = middle
        else:
            low = middle + 1
    return low
