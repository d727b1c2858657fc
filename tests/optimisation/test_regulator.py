"""The linear-quadratic task, and policy gradients against its exact ones."""

import numpy as np
import pytest
import torch

from thesis_lib.optimisation import (
    TRPO,
    Learner,
    LinearQuadraticTask,
    LocalProblem,
    Rollouts,
    collect,
    discounted_returns,
    make_batch,
)
from thesis_lib.policies import GaussianPolicy, make_policy

GAIN, LOG_STD = -0.4, -0.5


def linear_policy(gain: float = GAIN, log_std: float = LOG_STD) -> GaussianPolicy:
    """Two parameters: the gain and the log standard deviation."""
    policy = make_policy(
        "ffwd",
        1,
        1,
        dt=1.0,
        hidden=(),
        bias=False,
        initial_log_std=log_std,
        dtype=torch.float64,
    )
    with torch.no_grad():
        policy.head.weight.fill_(gain)
    assert policy.n_trainable == 2
    return policy


def sample(policy: GaussianPolicy, n_episodes: int, seed: int = 0) -> Rollouts:
    task = LinearQuadraticTask(n_episodes, horizon=10, seed=seed)
    return collect(task, policy, 10 * n_episodes, np.random.default_rng(seed + 1))


def exact(gain: torch.Tensor, log_std: torch.Tensor) -> torch.Tensor:
    return LinearQuadraticTask(1, horizon=10).expected_return(gain, log_std)


def test_one_step_by_hand() -> None:
    # horizon 1 and s_0 ~ N(0, 1): E[r] = -(1 + 0.1 (k^2 + sigma^2))
    task = LinearQuadraticTask(1, horizon=1)
    value = task.expected_return(torch.tensor([[2.0]]).double(), torch.tensor([0.0]).double())
    assert float(value) == pytest.approx(-1.5, rel=1e-14)


def test_exact_return_against_samples() -> None:
    rollouts = sample(linear_policy(), 20_000)
    returns = rollouts.episode_returns
    expected = exact(torch.tensor([[GAIN]]).double(), torch.tensor([LOG_STD]).double())
    error = returns.std() / np.sqrt(len(returns))
    assert returns.mean() == pytest.approx(float(expected), abs=4 * error)
    seconds = rollouts.padded("observations")[..., 0] ** 2
    moments = LinearQuadraticTask(1, horizon=10).state_moments(
        torch.tensor([[GAIN]]).double(), torch.tensor([LOG_STD]).double()
    )
    np.testing.assert_allclose(seconds.mean(axis=1), [float(m) for m in moments], rtol=0.05)


def test_policy_gradient_against_the_exact_gradient() -> None:
    # equation 2.13 with discount 1 and no baseline is an unbiased estimate of grad V
    policy = linear_policy()
    estimates = []
    for seed in range(30):
        rollouts = sample(policy, 400, seed=10 * seed)
        returns = discounted_returns(rollouts.rewards, rollouts.packing, 1.0)
        problem = LocalProblem(policy, make_batch(policy, rollouts, returns))
        named = policy.split(problem.gradient() * 10)  # steps of a trajectory
        estimates.append([float(named["head.weight"]), float(named["log_std"])])
    gain = torch.tensor([[GAIN]], dtype=torch.float64, requires_grad=True)
    log_std = torch.tensor([LOG_STD], dtype=torch.float64, requires_grad=True)
    exact(gain, log_std).backward()
    mean = np.mean(estimates, axis=0)
    error = np.std(estimates, axis=0, ddof=1) / np.sqrt(len(estimates))
    for ours, spread, true in zip(mean, error, (gain.grad, log_std.grad), strict=True):
        assert ours == pytest.approx(float(true), abs=4 * spread)
        assert spread < 0.1 * abs(float(true))


def test_fisher_matrix_of_the_two_parameter_policy() -> None:
    # E[s^2] / sigma^2 for the gain, 2 for log sigma, nothing between them
    policy = linear_policy()
    rollouts = sample(policy, 50)
    problem = LocalProblem(policy, make_batch(policy, rollouts, np.zeros(rollouts.n_steps)))
    gain = policy.join({"head.weight": torch.ones(1, dtype=torch.float64)})
    log_std = policy.join({"log_std": torch.ones(1, dtype=torch.float64)})
    curvature = float((rollouts.observations**2).mean() / np.exp(2 * LOG_STD))
    torch.testing.assert_close(problem.fisher_product(gain), curvature * gain)
    torch.testing.assert_close(problem.fisher_product(log_std), 2 * log_std)


def test_trpo_finds_the_best_gain() -> None:
    policy = linear_policy(gain=0.0, log_std=0.0)
    learner = Learner(policy, TRPO(delta=0.02), discount=1.0)
    task = LinearQuadraticTask(100, horizon=10, seed=3)
    rng = np.random.default_rng(4)
    for _ in range(60):
        assert learner.improve(collect(task, policy, 1000, rng)).kl <= 0.02
    gains = torch.linspace(-2, 0, 401, dtype=torch.float64)
    silent = torch.tensor([-20.0], dtype=torch.float64)
    best = max(float(exact(g.view(1, 1), silent)) for g in gains)
    found = float(exact(policy.head.weight.detach(), policy.log_std.detach()))
    start = float(exact(torch.zeros(1, 1).double(), torch.zeros(1).double()))
    assert (found - start) / (best - start) > 0.97


def test_a_vector_system() -> None:
    # a double integrator: the exact value agrees with samples
    def make(n: int) -> LinearQuadraticTask:
        return LinearQuadraticTask(
            n, A=[[1, 0.1], [0, 1]], B=[[0], [0.1]], Q=np.diag([1, 0.1]), R=0.01, horizon=30
        )

    policy = make_policy("ffwd", 2, 1, dt=0.1, hidden=(), bias=False, dtype=torch.float64)
    with torch.no_grad():
        policy.head.weight.copy_(torch.tensor([[-1.0, -1.5]]))
    returns = collect(make(4000), policy, 120_000, np.random.default_rng(0)).episode_returns
    expected = make(1).expected_return(policy.head.weight.detach(), policy.log_std.detach())
    assert returns.mean() == pytest.approx(
        float(expected), abs=4 * returns.std() / np.sqrt(len(returns))
    )


def test_bad_arguments() -> None:
    with pytest.raises(ValueError, match="num_envs is 0"):
        LinearQuadraticTask(0)
    with pytest.raises(ValueError, match=r"Q has shape \(2, 2\)"):
        LinearQuadraticTask(1, Q=np.identity(2))
