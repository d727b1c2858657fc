"""A task small enough to list every trajectory (sections 2.3.4 and 2.3.5).

Expectations and variances over trajectories are sums here, not samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from thesis_lib.arrays import FloatArray, IntArray

TRANSITION = np.array([[[0.8, 0.2], [0.1, 0.9]], [[0.3, 0.7], [0.6, 0.4]]])
REWARD = np.array([[1.0, 0.0], [0.0, 2.0]])
START = np.array([0.6, 0.4])
THETA = np.array([[0.5, -0.2], [0.1, 0.3]])


def softmax_policy(theta: FloatArray) -> FloatArray:
    r"""Tabular softmax policy :math:`\pi_\theta(a|s) \propto e^{\theta_{sa}}`, shape ``(S, A)``."""
    weights = np.exp(theta - theta.max(axis=1, keepdims=True))
    return weights / weights.sum(axis=1, keepdims=True)


def scores(theta: FloatArray) -> FloatArray:
    r"""Score of each pair, :math:`\nabla_\theta \log\pi_\theta(a|s)`.

    Parameters
    ----------
    theta
        Parameters, shape ``(S, A)``.

    Returns
    -------
    FloatArray
        Shape ``(S, A, S * A)``: 1 for the pair itself less :math:`\pi_\theta(b|s)` for
        every action b of its state.
    """
    S, A = theta.shape
    policy = softmax_policy(theta)
    score = np.zeros((S, A, S, A))
    for s in range(S):
        score[s, :, s] = np.eye(A) - policy[s]
    return score.reshape(S, A, S * A)


@dataclass(frozen=True)
class Trajectories:
    """Every trajectory of the small task.

    Attributes
    ----------
    states, actions
        Shape ``(N, T)``.
    probability
        Shape ``(N,)``, summing to 1.
    """

    states: IntArray
    actions: IntArray
    probability: FloatArray


def trajectories(steps: int, theta: FloatArray = THETA) -> Trajectories:
    """List every trajectory of a number of steps with its probability under the policy.

    Parameters
    ----------
    steps
        Number of actions taken, at least 1; there are ``4**steps`` trajectories.
    theta
        Policy parameters, shape ``(2, 2)``.
    """
    pairs = np.stack(np.meshgrid(*[np.arange(4)] * steps, indexing="ij"), axis=-1)
    pairs = pairs.reshape(-1, steps)
    states, actions = pairs // 2, pairs % 2
    policy = softmax_policy(theta)
    probability = START[states[:, 0]] * policy[states, actions].prod(axis=1)
    for t in range(steps - 1):
        probability *= TRANSITION[states[:, t], actions[:, t], states[:, t + 1]]
    return Trajectories(states, actions, probability)


def state_values(steps: int, discount: float, theta: FloatArray = THETA) -> FloatArray:
    r"""Value :math:`V^\pi_t(s)` of what is left of the episode, by backward recursion.

    Returns
    -------
    FloatArray
        Shape ``(steps, 2)``; row t is the value with ``steps - t`` actions to go.
    """
    policy = softmax_policy(theta)
    values = np.zeros((steps + 1, 2))
    for t in reversed(range(steps)):
        values[t] = (policy * (REWARD + discount * TRANSITION @ values[t + 1])).sum(axis=1)
    return values[:-1]


def value_gradient(steps: int, theta: FloatArray = THETA, size: float = 1e-5) -> FloatArray:
    """Slope of the undiscounted value of an episode, by central differences, shape ``(4,)``.

    The value comes from a backward recursion: no score and no trajectory is involved.
    """
    slopes = []
    for i in range(theta.size):
        change = np.zeros(theta.size)
        change[i] = size
        ends = [START @ state_values(steps, 1.0, t)[0] for t in _about(theta, change)]
        slopes.append((ends[1] - ends[0]) / (2 * size))
    return np.array(slopes)


def _about(theta: FloatArray, change: FloatArray) -> tuple[FloatArray, FloatArray]:
    step = change.reshape(theta.shape)
    return theta - step, theta + step
