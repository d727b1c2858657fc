"""Gains against filters whose gain is known."""

import numpy as np
import pytest
import torch

from thesis_lib.policies import CTRNN, GaussianPolicy, make_policy
from thesis_lib.policies.response import measured_gain, respond, small_signal_gain

DT = 0.02


def low_pass(tau: float = 0.2) -> CTRNN:
    """One unit without recurrence, read out directly: a first-order low-pass filter."""
    policy = make_policy(
        "ctrnn",
        1,
        1,
        dt=DT,
        units=1,
        integrator="euler",
        time_constant=tau,
        previous_action=False,
        dtype=torch.float64,
    )
    assert isinstance(policy, CTRNN)
    with torch.no_grad():
        policy.recurrent.weight.zero_()
        policy.input.weight.fill_(1.0)
        policy.head.weight.fill_(1.0)
    return policy


def low_pass_gain(frequency: np.ndarray, tau: float = 0.2) -> np.ndarray:
    # h' = (1 - a) h + a x, read after the step: |H| = |a z / (z - (1 - a))|
    a, z = DT / tau, np.exp(2j * np.pi * frequency * DT)
    return np.abs(a * z / (z - (1 - a)))


def test_small_signals_through_a_low_pass() -> None:
    frequency = np.array([0.1, 1.0, 5.0, 20.0])
    gain = small_signal_gain(low_pass(), DT, [1.0], frequency)
    np.testing.assert_allclose(gain[:, 0], low_pass_gain(frequency), rtol=1e-10)
    # and, for slow signals, the continuous filter's 1 / sqrt(1 + (omega tau)^2)
    slow = 1 / np.sqrt(1 + (2 * np.pi * frequency[:2] * 0.2) ** 2)
    np.testing.assert_allclose(gain[:2, 0], slow, rtol=0.1)


def test_noise_through_a_low_pass() -> None:
    rng = np.random.default_rng(0)
    frequency, gain = measured_gain(low_pass(), DT, [1.0], amplitude=0.01, generator=rng)
    middle = (frequency > 0.1) & (frequency < 24)
    np.testing.assert_allclose(gain[middle, 0], low_pass_gain(frequency[middle]), rtol=0.05)


def test_a_linear_policy_passes_everything() -> None:
    policy = make_policy("ffwd", 3, 2, dt=DT, hidden=(), dtype=torch.float64, seed=1)
    direction = np.array([0.5, -1.0, 2.0])
    expected = np.abs(policy.head.weight.detach().numpy() @ direction)
    gain = small_signal_gain(policy, DT, direction, [0.0, 3.0])
    np.testing.assert_allclose(gain, [expected, expected], rtol=1e-12)
    rng = np.random.default_rng(1)
    _, measured = measured_gain(policy, DT, direction, amplitude=1.0, generator=rng, steps=4096)
    np.testing.assert_allclose(measured[5:], np.tile(expected, (508, 1)), rtol=1e-9)


def test_response_to_a_step() -> None:
    signal = 1e-3 * (np.arange(50) >= 5)
    response = respond(low_pass(), signal, [1.0])[:, 0] / 1e-3
    a, expected, h = DT / 0.2, [], 0.0
    for x in signal / 1e-3:
        h = (1 - a) * h + a * x
        expected.append(h)
    np.testing.assert_allclose(response, expected, atol=1e-6)


def test_the_policy_is_left_as_it_was() -> None:
    policy = make_policy("gru", 3, 2, dt=DT)
    small_signal_gain(policy, DT, np.ones(3), [1.0])
    assert policy.dtype == torch.float32


def test_the_loop_is_open() -> None:
    # A unit that hears nothing but its previous action, which stays 0, says nothing.
    deaf = make_policy("dtrnn", 1, 1, dt=DT, units=1, dtype=torch.float64)
    hears = make_policy("dtrnn", 1, 1, dt=DT, units=1, dtype=torch.float64)
    with torch.no_grad():
        for net, weights in ((deaf, [[0.0, 5.0]]), (hears, [[1.0, 5.0]])):
            net.get_parameter("input.weight").copy_(torch.tensor(weights))
            net.get_parameter("recurrent.weight").zero_()
            net.head.weight.fill_(2.0)
    signal = np.array([0.3, -0.2, 0.0, 0.1])
    assert respond(deaf, signal, [1.0]).tolist() == [[0.0]] * 4
    np.testing.assert_allclose(respond(hears, signal, [1.0])[:, 0], 2 * np.tanh(signal))
    # at rest the slope of tanh is 1
    np.testing.assert_allclose(small_signal_gain(hears, DT, [1.0], [1.0, 9.0]), [[2.0], [2.0]])


def unstable(architecture: str) -> GaussianPolicy:
    policy = make_policy(architecture, 2, 1, dt=DT, units=2, dtype=torch.float64)
    with torch.no_grad():
        turn = torch.tensor([[0.0, -3.0], [3.0, 0.0]], dtype=torch.float64)
        policy.get_parameter("recurrent.weight").copy_(turn)
    return policy


def test_a_network_that_is_not_at_rest() -> None:
    with pytest.raises(ValueError, match="unstable at rest"):
        small_signal_gain(unstable("dtrnn"), DT, np.ones(2), [1.0])
    moving = unstable("dtrnn")
    with torch.no_grad():
        moving.get_parameter("input.bias").fill_(0.5)
    with pytest.raises(ValueError, match="still moves by"):
        small_signal_gain(moving, DT, np.ones(2), [1.0], settle=500)


def test_a_signal_too_short() -> None:
    with pytest.raises(ValueError, match="at least two segments of 1024"):
        measured_gain(
            low_pass(), DT, [1.0], amplitude=1.0, generator=np.random.default_rng(), steps=1500
        )
