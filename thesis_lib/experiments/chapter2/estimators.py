r"""Policy-gradient estimators, compared exactly (sections 2.3.4 and 2.3.5).

On a task small enough to list every trajectory, the expectation and the variance of an
estimator are sums, not samples: what each variance-reduction technique costs in bias can
then be said without an error bar.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.edition.experiment import Context, Experiment, rows

TRANSITION = np.array([[[0.8, 0.2], [0.1, 0.9]], [[0.3, 0.7], [0.6, 0.4]]])
REWARD = np.array([[1.0, 0.0], [0.0, 2.0]])
START = np.array([0.6, 0.4])
THETA = np.array([[0.5, -0.2], [0.1, 0.3]])
DIRECTION = np.array([1.0, -0.4, -0.7, 0.2])


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


@dataclass(frozen=True)
class EstimatorsConfig:
    """Settings of section-2.3.4."""

    steps: int = 6
    """Length of the episodes."""
    discount: float = 0.8
    """gamma of the discounted estimators."""


def estimators(config: EstimatorsConfig, context: Context) -> pd.DataFrame:
    """Bias and variance of the estimators of section 2.3.4, without sampling."""
    every = trajectories(config.steps)
    weight = every.probability
    score = scores(THETA)[every.states, every.actions]
    reward = REWARD[every.states, every.actions]
    power = config.discount ** np.arange(config.steps)

    def to_go(gamma: float) -> FloatArray:
        left = np.zeros_like(reward)
        total = np.zeros(len(reward))
        for t in reversed(range(config.steps)):
            total = reward[:, t] + gamma * total
            left[:, t] = total
        return left

    def value(gamma: float) -> FloatArray:
        left = state_values(config.steps, gamma)
        return left[np.arange(config.steps), every.states]

    whole = score.sum(axis=1) * reward.sum(axis=1)[:, None]
    whole_discounted = score.sum(axis=1) * (reward @ power)[:, None]
    truth = {"undiscounted": weight @ whole, "discounted": weight @ whole_discounted}

    def weighted(advantage: FloatArray) -> FloatArray:
        return (score * advantage[:, :, None]).sum(axis=1)

    def best(sample: FloatArray) -> FloatArray:
        """Subtract the baseline of state and time that leaves the least variance."""
        # Scores in one state at one time, zero elsewhere: what each entry of a baseline weighs.
        visits = every.states[:, :, None] == np.arange(2)
        parts = (score[:, :, None, :] * visits[..., None]).reshape(len(weight), -1, 4)
        gram = np.einsum("n,nki,nli->kl", weight, parts, parts)
        baseline = np.linalg.lstsq(gram, np.einsum("n,nki,ni->k", weight, parts, sample))[0]
        return np.asarray(sample - np.einsum("k,nki->ni", baseline, parts))

    gamma = config.discount
    samples = {
        "whole return": whole,
        "return to go": weighted(to_go(1.0)),
        "return to go, baseline": weighted(to_go(1.0) - value(1.0)),
        "return to go, best baseline": best(weighted(to_go(1.0))),
        "discounted whole return": whole_discounted,
        "discounted return to go, weighted": weighted(power * to_go(gamma)),
        "discounted return to go": weighted(to_go(gamma)),
        "discounted return to go, baseline": weighted(to_go(gamma) - value(gamma)),
    }
    advantage = to_go(gamma) - value(gamma)
    following = state_values(config.steps, gamma)[1:]
    td_error = reward - value(gamma)
    td_error[:, :-1] += gamma * following[np.arange(config.steps - 1), every.states[:, 1:]]
    samples["TD error"] = weighted(td_error)
    gap = advantage - td_error
    at_pair = [
        weight[here] @ gap[here, t] / weight[here].sum()
        for t in range(config.steps)
        for pair in range(4)
        if (here := 2 * every.states[:, t] + every.actions[:, t] == pair).any()
    ]
    slope = value_gradient(config.steps)
    records = []
    for name, sample in samples.items():
        mean = weight @ sample
        records.append(
            {
                "estimator": name,
                "bias": np.linalg.norm(mean - truth["undiscounted"]),
                "bias_discounted": np.linalg.norm(mean - truth["discounted"]),
                "variance": float(weight @ ((sample - mean) ** 2).sum(axis=1)),
                "gradient_norm": np.linalg.norm(mean),
                "slope_difference": np.linalg.norm(mean - slope),
                "td_difference": np.abs(gap).max() if name == "TD error" else np.nan,
                "td_mean_difference": np.abs(at_pair).max() if name == "TD error" else np.nan,
            }
        )
    return rows(records)


SECTION_2_3_4 = Experiment(
    id="section-2.3.4",
    item="Section 2.3.4",
    title="Bias and variance of policy-gradient estimators, over all trajectories of a small task",
    function=estimators,
    budgets={
        "smoke": EstimatorsConfig(steps=3),
        "book": EstimatorsConfig(),
        "thesis": EstimatorsConfig(),
    },
    columns={
        "estimator": "what multiplies the scores",
        "bias": "norm of its expectation less the gradient of the undiscounted return",
        "bias_discounted": "norm of its expectation less the gradient of the discounted return",
        "variance": "trace of the covariance matrix of one trajectory's estimate",
        "gradient_norm": "norm of its expectation",
        "slope_difference": "norm of its expectation less the differenced undiscounted value",
        "td_difference": "TD error only: largest difference from eq. 2.12 with the value baseline",
        "td_mean_difference": "TD error only: the same of their means given the pair at t",
    },
    seconds={"smoke": 0.1, "book": 0.1, "thesis": 0.1},
)


def kullback_leibler(p: FloatArray, q: FloatArray) -> FloatArray:
    r""":math:`D_{KL}(p\|q)` of each row, in nats; shape ``(S, A)`` to ``(S,)``."""
    return (p * np.log(p / q)).sum(axis=1)


def state_distribution(steps: int, theta: FloatArray = THETA) -> FloatArray:
    """How often the policy visits each state, on average over an episode, shape ``(2,)``."""
    policy = softmax_policy(theta)
    chain = np.einsum("sa,sat->st", policy, TRANSITION)
    now, total = START, np.zeros(2)
    for _ in range(steps):
        total = total + now
        now = now @ chain
    return total / steps


@dataclass(frozen=True)
class DivergenceConfig:
    """Settings of section-2.3.5."""

    steps: int = 6
    """Length of the episodes."""
    scales: tuple[float, ...] = tuple(np.logspace(-3, 0.5, 15).round(6).tolist())
    """Lengths of the step in parameter space."""


def divergence(config: DivergenceConfig, context: Context) -> pd.DataFrame:
    """KL divergence of a parameter step beside its quadratic approximation."""
    every = trajectories(config.steps)
    score = scores(THETA)
    occupancy = state_distribution(config.steps)
    old = softmax_policy(THETA)
    per_state = np.einsum("s,sa,sai,saj->ij", occupancy, old, score, score)
    along = score[every.states, every.actions].sum(axis=1)
    of_trajectory = np.einsum("n,ni,nj->ij", every.probability, along, along)
    unit = DIRECTION / np.linalg.norm(DIRECTION)
    records = []
    for scale in config.scales:
        step = scale * unit
        new = softmax_policy(THETA + step.reshape(THETA.shape))
        records.append(
            {
                "scale": scale,
                "kl_new_old": float(occupancy @ kullback_leibler(new, old)),
                "kl_old_new": float(occupancy @ kullback_leibler(old, new)),
                "half_quadratic": float(0.5 * step @ per_state @ step),
                "printed_quadratic": float(step @ per_state @ step),
                "trajectory_quadratic": float(step @ of_trajectory @ step),
                "steps": config.steps,
            }
        )
    return rows(records)


SECTION_2_3_5 = Experiment(
    id="section-2.3.5",
    item="Section 2.3.5",
    title="KL divergence of a policy step against its quadratic approximation",
    function=divergence,
    budgets={
        "smoke": DivergenceConfig(steps=3),
        "book": DivergenceConfig(),
        "thesis": DivergenceConfig(),
    },
    columns={
        "scale": "length of the step in parameter space",
        "kl_new_old": "mean over visited states of KL(new || old) [nat], the order of eq. 2.14",
        "kl_old_new": "mean over visited states of KL(old || new) [nat]",
        "half_quadratic": "one half step' F step, F per visited state [nat]",
        "printed_quadratic": "step' F step, as the thesis prints it, F per visited state [nat]",
        "trajectory_quadratic": "step' F step with the printed F, the score of a trajectory [nat]",
        "steps": "steps of an episode",
    },
    seconds={"smoke": 0.1, "book": 0.1, "thesis": 0.1},
)
