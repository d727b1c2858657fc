"""Greedy and epsilon-greedy policies, and what counts as a tie (section 2.3.3)."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import BoolArray, FloatArray
from thesis_lib.checks import one_of, probability

Exploration = Literal["all", "others"]
"""What the random action is drawn from: all actions, or those that are not greedy."""

EXPLORATIONS: tuple[Exploration, ...] = ("all", "others")

RELATIVE_TIE = 1e-10
"""Two values closer than this times the largest magnitude in their table are a tie."""


def tie_tolerance(*tables: ArrayLike) -> float:
    """How close two values must be to count as equal when a greedy action is chosen.

    Solvers leave rounding errors of about 1e-13 of the magnitude of the values, and so
    does adding a potential to a value function.  Without a tolerance they, and not a
    fair draw, would settle every tie.

    Parameters
    ----------
    tables
        Values and rewards that set the scale; infinite ones are not counted.

    Returns
    -------
    float
        :data:`RELATIVE_TIE` times the largest magnitude.
    """
    magnitude = [np.abs(np.asarray(t, dtype=np.float64)) for t in tables]
    return RELATIVE_TIE * max(
        (float(np.max(m, where=np.isfinite(m), initial=0.0)) for m in magnitude), default=0.0
    )


def greedy_actions(q: FloatArray, tie: float | None = None) -> BoolArray:
    r"""Which actions are greedy, :math:`\arg\max_a Q(s, a)`.

    Parameters
    ----------
    q
        State-action values, shape ``(S, A)``.
    tie
        How close a value must be to the best one; default :func:`tie_tolerance` of ``q``.

    Returns
    -------
    BoolArray
        Shape ``(S, A)``; at least one True a row.
    """
    tolerance = tie_tolerance(q) if tie is None else tie
    return q >= q.max(axis=1, keepdims=True) - tolerance


def epsilon_greedy(
    q: FloatArray, epsilon: float, *, exploration: Exploration = "all", tie: float | None = None
) -> FloatArray:
    r"""Action probabilities of the epsilon-greedy policy (section 2.3.3).

    Parameters
    ----------
    q
        State-action values, shape ``(S, A)``.
    epsilon
        Probability of a random action, in [0, 1]; 0 gives the greedy policy.
    exploration
        ``"all"``: the random action is any of the A actions.  ``"others"``: it is one
        that is not greedy; where every action is greedy, any.
    tie
        See :func:`greedy_actions`.  Tied actions share the probability evenly.

    Returns
    -------
    FloatArray
        :math:`\pi(s, a)`, shape ``(S, A)``.

    Raises
    ------
    ValueError
        When ``epsilon`` is outside [0, 1] or ``exploration`` is unknown.
    """
    epsilon = probability("epsilon", epsilon)
    one_of("exploration", exploration, EXPLORATIONS)
    best = greedy_actions(q, tie)
    n_best = best.sum(axis=1, keepdims=True)
    A = q.shape[1]
    greedy = best / n_best
    if exploration == "all":
        return (1 - epsilon) * greedy + epsilon / A
    rest = np.where(n_best < A, ~best / np.maximum(A - n_best, 1), 1 / A)
    return (1 - epsilon) * greedy + epsilon * rest
