"""Iterations of learning, on the linear-quadratic task."""

import dataclasses

import numpy as np
import pytest
import torch

from thesis_lib.optimisation import (
    PPO,
    TRPO,
    VPG,
    Algorithm,
    Learner,
    LinearBaseline,
    LinearQuadraticTask,
    NaturalPG,
    Rollouts,
    UpdateReport,
    collect,
)
from thesis_lib.optimisation.problem import Batch
from thesis_lib.policies import ARCHITECTURES, DEEP_NETS, GaussianPolicy, Packing, make_policy


def learn(
    architecture: str, n_iterations: int, algorithm: Algorithm | None = None, seed: int = 0
) -> tuple[list[float], GaussianPolicy]:
    """Mean return of every iteration."""
    task = LinearQuadraticTask(40, A=0.5, B=0.2, R=0.5, seed=seed)
    units = None if architecture in ("ffwd-400", *DEEP_NETS) else 6
    policy = make_policy(architecture, 1, 1, dt=0.1, seed=seed, units=units)
    learner = Learner(policy, algorithm or TRPO(delta=0.05))
    rng = np.random.default_rng(seed)
    curve = []
    for _ in range(n_iterations):
        rollouts = collect(task, policy, 800, rng)
        curve.append(float(rollouts.episode_returns.mean()))
        learner.improve(rollouts)
    return curve, policy


@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_same_seed_same_curve(architecture: str) -> None:
    one, first = learn(architecture, 3)
    two, second = learn(architecture, 3)
    assert one == two
    assert torch.equal(first.parameter_vector(), second.parameter_vector())
    other, _ = learn(architecture, 3, seed=1)
    assert other != one


@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_every_net_learns(architecture: str) -> None:
    curve, _ = learn(architecture, 20)
    # doing nothing is near the best here, and the noise of the first policy costs most
    assert np.mean(curve[-3:]) > 0.8 * curve[0]


@pytest.mark.parametrize(
    "algorithm",
    [
        VPG(learning_rate=2e-2),
        NaturalPG(delta=0.05),
        NaturalPG(learning_rate=0.1),
        PPO(learning_rate=1e-2),
    ],
    ids=["vpg", "natural, fixed divergence", "natural, fixed rate", "ppo"],
)
def test_every_algorithm_learns(algorithm: Algorithm) -> None:
    curve, _ = learn("ffwd", 20, algorithm)
    assert np.mean(curve[-3:]) > 0.8 * curve[0]


class Recorder:
    """An algorithm that keeps what it is given and changes nothing."""

    def __init__(self) -> None:
        self.batches: list[Batch] = []

    def update(self, policy: GaussianPolicy, batch: Batch) -> UpdateReport:
        self.batches.append(batch)
        return UpdateReport(0.0, 0.0, 0.0, 0.0, True, 0, 0.0)


def two_episodes(rewards: tuple[float, ...]) -> Rollouts:
    packing = Packing(np.array([2, 2]))
    return Rollouts(
        packing=packing,
        observations=np.zeros((4, 1)),
        actions=np.zeros((4, 1)),
        rewards=packing.pack(np.reshape(rewards, (2, 2))),
        terminated=np.zeros(2, dtype=bool),
        final_observations=np.zeros((2, 1)),
    )


def test_the_baseline_is_that_of_the_rollouts_before() -> None:
    # line 6 uses b before line 7 fits it: the first advantages are the plain returns
    recorder = Recorder()
    policy = make_policy("ffwd", 1, 1, dt=0.1, dtype=torch.float64)
    learner = Learner(policy, recorder, discount=0.5, standardise=False)
    learner.baseline = LinearBaseline(ridge=1e-9)
    learner.improve(two_episodes((1.0, 3.0, 2.0, 4.0)))
    assert recorder.batches[0].advantages.tolist() == [2.0, 5.0, 2.0, 4.0]
    # the fit finds the mean return of either time: 3.5 and 3
    learner.improve(two_episodes((1.0, 3.0, 2.0, 4.0)))
    expected = [2.0 - 3.5, 5.0 - 3.5, 2.0 - 3.0, 4.0 - 3.0]
    assert recorder.batches[1].advantages.tolist() == pytest.approx(expected, abs=1e-4)


def test_standardised_advantages_and_bootstrap() -> None:
    recorder = Recorder()
    policy = make_policy("ffwd", 1, 1, dt=0.1, dtype=torch.float64)
    learner = Learner(policy, recorder, discount=0.5, bootstrap=True)
    rollouts = two_episodes((1.0, 3.0, 2.0, 4.0))
    learner.improve(rollouts)
    assert recorder.batches[0].advantages.mean() == pytest.approx(0, abs=1e-12)
    assert recorder.batches[0].advantages.numpy().std() == pytest.approx(1, abs=1e-6)
    weights = learner.baseline.weights
    assert weights is not None
    learner.standardise = False
    learner.improve(rollouts)
    # both episodes were cut, at time 2: the last step is credited with half of b(s_2)
    s = 2 / 100
    last = weights @ [0, 0, s, s**2, s**3, 1]
    first = weights @ [0, 0, 0.01, 1e-4, 1e-6, 1]
    expected = 4.0 + 0.5 * last - first
    assert float(recorder.batches[1].advantages[3]) == pytest.approx(expected, abs=1e-9)


def test_an_episode_that_ended_by_itself_is_not_credited() -> None:
    recorder = Recorder()
    policy = make_policy("ffwd", 1, 1, dt=0.1, dtype=torch.float64)
    learner = Learner(policy, recorder, discount=0.5, bootstrap=True, standardise=False)
    rollouts = two_episodes((1.0, 3.0, 2.0, 4.0))
    rollouts = dataclasses.replace(rollouts, terminated=np.array([True, False]))
    learner.improve(rollouts)
    weights = learner.baseline.weights
    assert weights is not None
    learner.improve(rollouts)
    s = 2 / 100
    first = weights @ [0, 0, 0.01, 1e-4, 1e-6, 1]
    last = weights @ [0, 0, s, s**2, s**3, 1]
    assert abs(last) > 1  # else there would be nothing to see
    # the last steps: of the first episode, which fell over, and of the second, cut at time 2
    expected = [2.0 - first, 4.0 + 0.5 * last - first]
    assert recorder.batches[1].advantages[2:].tolist() == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("name", ["discount", "gae_lambda"])
def test_fractions(name: str) -> None:
    policy = make_policy("ffwd", 1, 1, dt=0.1)
    with pytest.raises(ValueError, match=rf"{name} is 1\.5, but it must be in \[0, 1\]"):
        Learner(policy, Recorder(), **{name: 1.5})
