r"""Policy-gradient algorithms on a task with two parameters (sections 2.3.4 and 2.3.5).

The task is to regulate a scalar linear system; the policy is :math:`a \sim N(ks, \sigma^2)`
with the gain k and :math:`\log\sigma` to be learned.  Returns, state distribution and
divergences have closed forms (see :mod:`thesis_lib.optimisation.regulator`), so that every
step an algorithm makes from samples can be judged without error.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import torch

from thesis_lib.arrays import FloatArray
from thesis_lib.edition.experiment import Context
from thesis_lib.edition.plots import COLOURS
from thesis_lib.optimisation import (
    PPO,
    TRPO,
    VPG,
    Learner,
    LinearQuadraticTask,
    NaturalPG,
    UpdateReport,
    collect,
)
from thesis_lib.optimisation.problem import Algorithm
from thesis_lib.policies import FeedforwardPolicy, kl_divergence

HORIZON = 20

NAMES: Mapping[str, str] = {
    "vpg": "vanilla policy gradient",
    "natural": "natural gradient, fixed rate",
    "natural_delta": "natural gradient, fixed length",
    "trpo": "TRPO",
    "ppo": "PPO",
}
"""What each key of the column ``algorithm`` stands for."""

COLOUR = {
    "vpg": COLOURS[1],
    "natural": COLOURS[3],
    "natural_delta": COLOURS[2],
    "trpo": COLOURS[0],
    "ppo": COLOURS[4],
}
"""One colour an algorithm, in every figure."""


@dataclass(frozen=True)
class Rates:
    """Settings of the algorithms."""

    delta_kl: float = 0.05
    """Bound of TRPO, and length of the natural gradient of fixed length [nat]."""
    vpg_rate: float = 0.02
    """alpha of algorithm 5; 0.06 diverges from the default start."""
    natural_rate: float = 0.5
    """alpha of the natural gradient of fixed rate."""
    ppo_rate: float = 0.01
    """Adam's rate in PPO."""

    def algorithms(self, seed: int) -> dict[str, Algorithm]:
        """A new algorithm of every kind, by the keys of :data:`NAMES`."""
        return {
            "vpg": VPG(learning_rate=self.vpg_rate),
            "natural": NaturalPG(learning_rate=self.natural_rate),
            "natural_delta": NaturalPG(delta=self.delta_kl),
            "trpo": TRPO(delta=self.delta_kl),
            "ppo": PPO(learning_rate=self.ppo_rate, seed=seed),
        }


def linear_policy(gain: float, log_std: float) -> FeedforwardPolicy:
    r"""The policy :math:`a \sim N(ks, \sigma^2)`, in float64."""
    policy = FeedforwardPolicy(
        1, 1, hidden=(), bias=False, initial_log_std=log_std, dtype=torch.float64
    )
    with torch.no_grad():
        policy.head.weight.fill_(gain)
    return policy


def parameters(policy: FeedforwardPolicy) -> tuple[float, float]:
    """The gain and the log standard deviation of a policy."""
    return float(policy.head.weight.detach()), float(policy.log_std.detach())


def expected_return(gain: float, log_std: float) -> float:
    """Exact undiscounted return of an episode."""
    task = LinearQuadraticTask(1, horizon=HORIZON)
    return float(task.expected_return(_matrix(gain), _vector(log_std)))


def expected_divergence(old: tuple[float, float], new: tuple[float, float]) -> float:
    """Exact mean divergence old from new over the states the old policy visits [nat]."""
    square = mean_square_state(*old)
    # the mean's difference is (k - k') s, whose mean square is (k - k')^2 E[s^2]
    zero, gap = _matrix(0.0), _matrix((new[0] - old[0]) * np.sqrt(square))
    return float(kl_divergence(zero, _vector(old[1]), gap, _vector(new[1])))


def mean_square_state(gain: float, log_std: float) -> float:
    """Exact mean of the squared state over the steps of an episode."""
    task = LinearQuadraticTask(1, horizon=HORIZON)
    moments = task.state_moments(_matrix(gain), _vector(log_std))
    return float(np.mean([float(m) for m in moments]))


def fisher(gain: float, log_std: float) -> FloatArray:
    r"""Exact Fisher information of the policy, shape ``(2, 2)``.

    The score is :math:`(zs/\sigma,\; z^2 - 1)` with z standard normal, so that the matrix is
    :math:`\mathrm{diag}(E[s^2]/\sigma^2,\; 2)`.
    """
    return np.diag([mean_square_state(gain, log_std) * np.exp(-2 * log_std), 2.0])


def best_return() -> float:
    """Return of the best gain without any noise, found on a fine grid."""
    return max(expected_return(k, -20.0) for k in np.linspace(-2, 0, 401))


def _matrix(value: float) -> torch.Tensor:
    return torch.tensor([[value]], dtype=torch.float64)


def _vector(value: float) -> torch.Tensor:
    return torch.tensor([value], dtype=torch.float64)


@dataclass(frozen=True)
class Runs:
    """How much is learned, and from where."""

    iterations: int = 40
    """Iterations of each run."""
    batch_steps: int = 1000
    """Steps of an iteration."""
    runs: int = 10
    """Runs of each setting."""
    start: tuple[float, float] = (0.0, 0.0)
    """Gain and log standard deviation to start from."""

    def updates(
        self, algorithm: Algorithm, context: Context, run: int
    ) -> Iterator[tuple[tuple[float, float], UpdateReport | None, tuple[float, float]]]:
        """Parameters before each update, its report, and parameters after it; last no update.

        The random numbers are those of the run: all algorithms start from the same noise.
        """
        task_seed, noise_seed = context.seeds(2, run)
        task = LinearQuadraticTask(50, horizon=HORIZON, seed=task_seed)
        generator = np.random.default_rng(noise_seed)
        policy = linear_policy(*self.start)
        learner = Learner(policy, algorithm, discount=1.0)
        for _ in range(self.iterations):
            old = parameters(policy)
            report = learner.improve(collect(task, policy, self.batch_steps, generator))
            yield old, report, parameters(policy)
        yield parameters(policy), None, parameters(policy)
