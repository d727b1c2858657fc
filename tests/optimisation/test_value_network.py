"""The neural baseline, and what a baseline may be fitted to."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

from thesis_lib.optimisation import (
    VPG,
    Baseline,
    Learner,
    LinearBaseline,
    LinearQuadraticTask,
    ValueNetwork,
    collect,
)
from thesis_lib.optimisation.value_network import set_gradient
from thesis_lib.policies import make_policy

torch.set_num_threads(1)


def batch(n: int = 1500, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values the linear baseline cannot represent: a wave along the first sensor."""
    rng = np.random.default_rng(seed)
    observations = rng.uniform(-1, 1, (n, 2))
    return observations, np.zeros(n, dtype=np.int64), np.sin(4 * observations[:, 0])


def error(baseline: Baseline, fits: int) -> float:
    """Root mean square error on new steps."""
    for _ in range(fits):
        baseline.fit(*batch())
    observations, time, values = batch(seed=1)
    return float(np.sqrt(np.mean((baseline.predict(observations, time) - values) ** 2)))


def test_it_finds_a_value_the_linear_baseline_cannot() -> None:
    network = ValueNetwork()
    assert (network.predict(*batch()[:2]) == 0).all()
    # the best line through sin(4x) on [-1, 1] leaves more than half of the wave
    assert error(LinearBaseline(), 1) > 0.4
    assert error(network, 60) < 0.1


@pytest.mark.parametrize("hidden", [(), (4,), (7, 5, 3)])
def test_its_gradient_is_that_of_automatic_differentiation(hidden: tuple[int, ...]) -> None:
    widths = [3, *hidden, 1]
    layers = [nn.Linear(i, o, dtype=torch.float64) for i, o in pairwise(widths)]
    generator = torch.Generator().manual_seed(0)
    x = torch.randn((11, 3), generator=generator, dtype=torch.float64)
    target = torch.randn(11, generator=generator, dtype=torch.float64)
    parameters = [p for layer in layers for p in layer.parameters()]
    h = x
    for layer in layers[:-1]:
        h = torch.tanh(layer(h))
    loss = (layers[-1](h)[:, 0] - target).square().mean()
    expected = torch.autograd.grad(loss, parameters)
    for p in parameters:
        p.grad = torch.full_like(p, np.nan)
    set_gradient(layers, x, target)
    for p, gradient in zip(parameters, expected, strict=True):
        torch.testing.assert_close(p.grad, gradient, rtol=1e-12, atol=1e-14)


def test_it_goes_on_from_where_it_was() -> None:
    network = ValueNetwork(seed=1)
    assert error(network, 1) > error(network, 10)


def test_an_interrupted_fit_goes_on_to_the_same_bits() -> None:
    whole, first = ValueNetwork(seed=3), ValueNetwork(seed=3)
    for _ in range(2):
        whole.fit(*batch())
    first.fit(*batch())
    second = ValueNetwork(seed=8)
    second.load_state_dict(first.state_dict())
    second.fit(*batch())
    observations, time, _ = batch(seed=2)
    assert (second.predict(observations, time) == whole.predict(observations, time)).all()
    untrained = ValueNetwork()
    untrained.load_state_dict(ValueNetwork().state_dict())
    assert (untrained.predict(observations, time) == 0).all()


def test_its_number_type_is_the_one_asked_for() -> None:
    observations, time, _ = batch(seed=2)
    values = {}
    for dtype in (torch.float32, torch.float64):
        network = ValueNetwork(seed=1, dtype=dtype)
        network.fit(*batch())
        values[dtype] = network.predict(observations, time)
        state = network.state_dict()
        assert {w.dtype for w in state["net"].values()} == {dtype}
        assert {s["exp_avg"].dtype for s in state["adam"]["state"].values()} == {dtype}
    # what a float32 network predicts is a float32 number, and nearly nothing else is
    rounded = {dtype: v.astype(np.float32) for dtype, v in values.items()}
    assert (values[torch.float32] == rounded[torch.float32]).all()
    assert np.mean(values[torch.float64] == rounded[torch.float64]) < 0.01
    with pytest.raises(ValueError, match=r"is of type torch\.float64, but this one has"):
        ValueNetwork().load_state_dict(state)


class Noted:
    """A baseline of 2 everywhere that notes what it is fitted to."""

    def fit(self, observations: np.ndarray, time: np.ndarray, returns: np.ndarray) -> None:
        self.target = returns

    def predict(self, observations: np.ndarray, time: np.ndarray) -> np.ndarray:
        return np.full(len(observations), 2.0)

    def state_dict(self) -> dict[str, Any]:
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None: ...


@pytest.mark.parametrize(
    ("gae_lambda", "targets"), [(0.0, "lambda"), (1.0, "lambda"), (0.0, "returns")]
)
def test_targets_by_hand(gae_lambda: float, targets: str) -> None:
    task = LinearQuadraticTask(4, A=0.5, B=0.2, R=0.5, seed=0)
    policy = make_policy("ffwd", 1, 1, dt=0.1, units=2)
    rollouts = collect(task, policy, 20, np.random.default_rng(0))
    noted = Noted()
    Learner(
        policy, VPG(), discount=0.5, gae_lambda=gae_lambda, baseline=noted, targets=targets
    ).improve(rollouts)
    packing, rewards = rollouts.packing, rollouts.rewards
    expected = np.empty(len(rewards))
    for episode in range(packing.n_episodes):
        rows = [
            packing.offsets[t] + list(packing.order).index(episode)
            for t in range(packing.lengths[episode])
        ]
        total = 0.0
        for k in reversed(range(len(rows))):
            after = 2.0 if k + 1 < len(rows) else 0.0
            total = rewards[rows[k]] + 0.5 * total
            expected[rows[k]] = (
                rewards[rows[k]] + 0.5 * after
                if (gae_lambda, targets) == (0.0, "lambda")
                else total
            )
    np.testing.assert_allclose(noted.target, expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"learning_rate": 0.0}, "learning_rate is 0.0"),
        ({"epochs": 0}, "epochs is 0"),
        ({"minibatch": -1}, "minibatch is -1"),
        ({"hidden": (10, 0)}, "hidden is 0"),
    ],
)
def test_bad_settings(options: dict[str, Any], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        ValueNetwork(**options)


def test_bad_targets() -> None:
    policy = make_policy("ffwd", 1, 1, dt=0.1, units=2)
    with pytest.raises(ValueError, match="choose one of returns, lambda"):
        Learner(policy, VPG(), targets="rewards")
