r"""Returns and advantages of a batch of episodes (sections 2.3.4 and 2.3.5).

Everything is float64 and works on rows laid out by
:class:`~thesis_lib.policies.Packing`, in which the episodes that have a step t + 1 are the
first of those that have a step t.
"""

from __future__ import annotations

import numpy as np

from thesis_lib.arrays import FloatArray
from thesis_lib.checks import probability
from thesis_lib.policies import Packing


def discounted_returns(rewards: FloatArray, packing: Packing, discount: float) -> FloatArray:
    r"""Return from every step on, :math:`R_t = \sum_{t'=t}^{T} \gamma^{t'-t} r_{t'}`.

    Parameters
    ----------
    rewards
        Reward of every step, shape ``(R,)``.
    packing
        Layout of the rows.
    discount
        :math:`\gamma` in [0, 1].

    Returns
    -------
    FloatArray
        Shape ``(R,)``.

    Notes
    -----
    Source: line 5 of algorithms 5 and 6.  What follows the last step counts as 0.
    """
    return _discounted_sums(_checked(rewards, packing), packing, probability("discount", discount))


def advantages(
    rewards: FloatArray,
    values: FloatArray,
    packing: Packing,
    discount: float,
    gae_lambda: float = 1.0,
    last_values: FloatArray | None = None,
) -> FloatArray:
    r"""Advantage estimate of every step.

    .. math::
        \hat A_t = \sum_{l \ge 0} (\gamma\lambda)^l \delta_{t+l},
        \qquad \delta_t = r_t + \gamma b(s_{t+1}) - b(s_t)

    With :math:`\lambda = 1` the sum telescopes to :math:`R_t - b(s_t)`, equation 2.12.

    Parameters
    ----------
    rewards
        Shape ``(R,)``.
    values
        Baseline :math:`b(s_t)`, shape ``(R,)``.
    packing
        Layout of the rows.
    discount
        :math:`\gamma` in [0, 1].
    gae_lambda
        :math:`\lambda` in [0, 1].
    last_values
        Value of the state each episode ended in, shape ``(B,)`` in the order in which
        the episodes were given; default 0, as in the author's code even where a time
        limit cut the episode.

    Returns
    -------
    FloatArray
        Shape ``(R,)``.

    Notes
    -----
    Source: line 6 of algorithms 5 and 6 for :math:`\lambda = 1`; otherwise generalised
    advantage estimation.
    """
    rewards, values = _checked(rewards, packing), _checked(values, packing)
    discount, gae_lambda = (
        probability("discount", discount),
        probability("gae_lambda", gae_lambda),
    )
    following = np.zeros_like(values)
    following[packing.previous] = values[packing.n_episodes :]
    if last_values is not None:
        following[packing.last] = last_values
    error = rewards + discount * following - values
    return _discounted_sums(error, packing, discount * gae_lambda)


def standardised(values: FloatArray) -> FloatArray:
    """Shift and scale to mean 0 and standard deviation 1 over all steps of the batch."""
    return (values - values.mean()) / (values.std() + 1e-8)


def _discounted_sums(values: FloatArray, packing: Packing, factor: float) -> FloatArray:
    total = values.copy()
    offsets = packing.offsets
    for t in range(packing.horizon - 2, -1, -1):
        start, middle, end = offsets[t], offsets[t + 1], offsets[t + 2]
        total[start : start + end - middle] += factor * total[middle:end]
    return total


def _checked(values: FloatArray, packing: Packing) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    if array.shape != (packing.n_steps,):
        raise ValueError(
            f"an array of shape {array.shape} was given, but the batch has {packing.n_steps} "
            "steps, one number each."
        )
    return array
