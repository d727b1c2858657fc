"""Each network against its printed equation, an independent library or a differential equation."""

import math
from itertools import combinations, pairwise

import numpy as np
import pytest
import torch
from scipy import stats
from scipy.integrate import solve_ivp
from torch import Tensor

from tests.policies.networks import ACTIONS, DT, OBSERVED, RECURRENT, VARIANTS, network
from thesis_lib.policies import CTRNN, ESN, GRU, LSTM, GaussianPolicy, make_policy
from thesis_lib.policies import spectral_radius as radius


def padded(policy: GaussianPolicy, n_steps: int = 6, n_episodes: int = 3) -> tuple[Tensor, Tensor]:
    draw = torch.Generator().manual_seed(9)
    shape = (n_steps, n_episodes)
    observations = torch.randn(
        (*shape, policy.observation_size), generator=draw, dtype=torch.float64
    )
    actions = torch.randn((*shape, policy.action_size), generator=draw, dtype=torch.float64)
    return observations, torch.cat([torch.zeros_like(actions[:1]), actions[:-1]])


def weights(policy: GaussianPolicy) -> dict[str, np.ndarray]:
    return {name: p.detach().numpy() for name, p in policy.named_parameters()}


# --------------------------------------------------------------------- one definition, two uses
@pytest.mark.parametrize("variant", VARIANTS)
def test_steps_and_blocks_agree(variant: str) -> None:
    policy = network(variant)
    observations, before = padded(policy)
    with torch.no_grad():
        block, last = policy(observations, before)
        state = policy.initial_state(observations.shape[1])
        for t in range(len(observations)):
            mean, state = policy.step(observations[t], before[t], state)
            torch.testing.assert_close(mean, block[t], rtol=1e-12, atol=1e-12)
    torch.testing.assert_close(state, last, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("variant", VARIANTS)
def test_padding_changes_nothing_before_it(variant: str) -> None:
    policy = network(variant)
    observations, before = padded(policy)
    with torch.no_grad():
        short, _ = policy(observations[:4], before[:4])
        observations[4:] = 1e6
        long, _ = policy(observations, before)
    torch.testing.assert_close(long[:4], short, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_state_carries_on(variant: str) -> None:
    policy = network(variant)
    observations, before = padded(policy)
    with torch.no_grad():
        whole, _ = policy(observations, before)
        first, state = policy(observations[:2], before[:2])
        rest, _ = policy(observations[2:], before[2:], state)
    torch.testing.assert_close(torch.cat([first, rest]), whole, rtol=1e-12, atol=1e-12)


# ------------------------------------------------------------------------------------ equations
def test_feedforward_by_hand() -> None:
    policy = network("dffwd")
    w = weights(policy)
    observations, before = padded(policy)
    h = observations.numpy()
    for i in range(3):
        h = np.tanh(h @ w[f"layers.{i}.weight"].T + w[f"layers.{i}.bias"])
    expected = h @ w["head.weight"].T + w["head.bias"]
    np.testing.assert_allclose(policy(observations, before)[0].detach(), expected, rtol=1e-12)


def test_softplus_by_hand() -> None:
    policy = network("dffwd-softplus")
    w = weights(policy)
    observations, before = padded(policy)
    h = observations.numpy()
    for i in range(3):
        h = np.log(1 + np.exp(h @ w[f"layers.{i}.weight"].T + w[f"layers.{i}.bias"]))
    expected = h @ w["head.weight"].T + w["head.bias"]
    np.testing.assert_allclose(policy(observations, before)[0].detach(), expected, rtol=1e-12)


def inputs_of(policy: GaussianPolicy) -> tuple[Tensor, Tensor, np.ndarray]:
    observations, before = padded(policy)
    return observations, before, np.concatenate([observations, before], axis=-1)


def test_dtrnn_is_equation_5_1() -> None:
    policy = network("dtrnn")
    w = weights(policy)
    observations, before, x = inputs_of(policy)
    h = np.tile(w["h0"], (3, 1))
    expected = []
    for t in range(len(x)):
        h = np.tanh(x[t] @ w["input.weight"].T + w["input.bias"] + h @ w["recurrent.weight"].T)
        expected.append(h @ w["head.weight"].T + w["head.bias"])
    np.testing.assert_allclose(policy(observations, before)[0].detach(), expected, rtol=1e-11)


def test_esn_leaks_and_has_no_bias() -> None:
    policy = network("esn")
    assert isinstance(policy, ESN)
    assert policy.input.bias is None
    w = weights(policy)
    observations, before, x = inputs_of(policy)
    h = np.zeros((3, policy.units))
    expected = []
    for t in range(len(x)):
        f = np.tanh(x[t] @ w["input.weight"].T + h @ w["recurrent.weight"].T)
        h = 0.5 * h + 0.5 * f
        expected.append(h @ w["head.weight"].T + w["head.bias"])
    np.testing.assert_allclose(policy(observations, before)[0].detach(), expected, rtol=1e-11)


def test_lstm_against_torch() -> None:
    policy = network("lstm")
    assert isinstance(policy, LSTM)
    n = policy.units
    theirs = torch.nn.LSTM(policy.input_size, n).double()
    # torch stacks input, forget, cell, output; ours is input, forget, output, cell
    order = torch.cat([torch.arange(i * n, (i + 1) * n) for i in (0, 1, 3, 2)])
    with torch.no_grad():
        theirs.weight_ih_l0.copy_(policy.input.weight[order])
        theirs.weight_hh_l0.copy_(policy.recurrent.weight[order])
        theirs.bias_ih_l0.copy_(policy.input.bias[order])
        theirs.bias_hh_l0.zero_()
        theirs.bias_hh_l0[n : 2 * n] = 1.0  # the constant in our forget gate
    observations, before = padded(policy)
    hidden, _ = theirs(torch.cat([observations, before], -1))
    torch.testing.assert_close(policy(observations, before)[0], policy.head(hidden))


def test_lstm_of_the_text_has_logistic_cells() -> None:
    # with all weights 0 and forget bias 1: c_1 = sigma(0) sigma(0) = 1/4, and
    # c_2 = sigma(1) / 4 + 1/4; h = tanh(c) sigma(0)
    policy = make_policy("lstm", 1, 1, dt=DT, candidate="logistic", dtype=torch.float64)
    policy.set_parameter_vector(torch.zeros(policy.n_trainable, dtype=torch.float64))
    with torch.no_grad():
        _, state = policy(torch.zeros(2, 1, 1), torch.zeros(2, 1, 1))
    cell = 0.25 / (1 + math.exp(-1)) + 0.25
    assert state[0].tolist() == pytest.approx([math.tanh(cell) / 2, cell], rel=1e-14)


def test_gru_against_torch() -> None:
    policy = network("gru")
    assert isinstance(policy, GRU)
    theirs = torch.nn.GRU(policy.input_size, policy.units).double()
    with torch.no_grad():
        theirs.weight_ih_l0.copy_(policy.input.weight)
        theirs.weight_hh_l0.copy_(policy.recurrent.weight)
        theirs.bias_ih_l0.copy_(policy.input.bias)
        theirs.bias_hh_l0.zero_()
    observations, before = padded(policy)
    hidden, _ = theirs(torch.cat([observations, before], -1))
    torch.testing.assert_close(policy(observations, before)[0], policy.head(hidden))


# ---------------------------------------------------------------------- continuous time, eq. 5.2
def ctrnn(integrator: str, dt: float, tau: float = 0.3) -> CTRNN:
    """The same continuous network whatever the integrator and its step."""
    policy = make_policy(
        "ctrnn",
        OBSERVED,
        ACTIONS,
        dt=dt,
        seed=4,
        dtype=torch.float64,
        integrator=integrator,
        time_constant=tau,
        previous_action=False,
    )
    assert isinstance(policy, CTRNN)
    with torch.no_grad():
        policy.tau_raw.copy_(tau * torch.linspace(1, 2, policy.units, dtype=torch.float64))
        policy.h0.copy_(torch.linspace(-1, 1, policy.units, dtype=torch.float64))
        policy.recurrent.weight.mul_(3)
    return policy


def integrate(policy: CTRNN, x: Tensor, time: float) -> np.ndarray:
    """State after holding one input for a time."""
    steps = round(time / policy.dt)
    with torch.no_grad():
        _, state = policy(x.expand(steps, 1, -1), torch.zeros(steps, 1, ACTIONS))
    return state[0].numpy()


def exact(policy: CTRNN, x: Tensor, time: float) -> np.ndarray:
    w = weights(policy)
    drive = w["input.weight"] @ x.numpy() + w["input.bias"]

    def flow(_: float, h: np.ndarray) -> np.ndarray:
        return (-h + np.tanh(w["recurrent.weight"] @ h + drive)) / w["tau_raw"]

    solution = solve_ivp(flow, (0, time), w["h0"], method="DOP853", rtol=1e-12, atol=1e-13)
    return solution.y[:, -1]


@pytest.mark.parametrize(("integrator", "order"), [("euler", 1), ("heun", 2), ("midpoint", 2)])
def test_ctrnn_converges_to_the_differential_equation(integrator: str, order: int) -> None:
    x = torch.tensor([0.5, -1.0, 0.3, 2.0], dtype=torch.float64)
    errors = []
    for dt in (0.02, 0.01, 0.005):
        policy = ctrnn(integrator, dt)
        errors.append(np.abs(integrate(policy, x, 0.6) - exact(policy, x, 0.6)).max())
    assert errors[-1] < (1e-2 if order == 1 else 1e-4)
    for coarse, fine in pairwise(errors):
        assert math.log2(coarse / fine) == pytest.approx(order, abs=0.15)


@pytest.mark.parametrize("integrator", ["euler", "heun", "midpoint"])
def test_ctrnn_step_by_hand(integrator: str) -> None:
    policy = ctrnn(integrator, dt=0.1)
    w = weights(policy)
    x = torch.tensor([0.5, -1.0, 0.3, 2.0], dtype=torch.float64)
    a, h = 0.1 / w["tau_raw"], w["h0"]

    def d(h: np.ndarray) -> np.ndarray:
        drive = w["input.weight"] @ x.numpy() + w["input.bias"]
        return a * (-h + np.tanh(w["recurrent.weight"] @ h + drive))

    expected = {
        "euler": h + d(h),
        "heun": h + 0.5 * d(h) + 0.5 * d(h + d(h)),  # what the author calls midpoint
        "midpoint": h + d(h + 0.5 * d(h)),
    }[integrator]
    np.testing.assert_allclose(integrate(policy, x, 0.1), expected, rtol=1e-13)


def test_euler_with_the_step_as_time_constant_is_the_dtrnn() -> None:
    # section 5.2.2: for dt = tau the discrete-time approximation reduces to equation 5.1
    fast = make_policy(
        "ctrnn", OBSERVED, ACTIONS, dt=DT, time_constant=DT, integrator="euler", seed=1
    )
    discrete = make_policy("dtrnn", OBSERVED, ACTIONS, dt=DT, seed=1)
    observations, before = (x.float() for x in padded(fast))
    torch.testing.assert_close(fast(observations, before), discrete(observations, before))


@pytest.mark.parametrize("constraint", ["clamp", "softplus", "exponential"])
def test_time_constants_stay_at_or_above_the_step(constraint: str) -> None:
    policy = make_policy("ctrnn", OBSERVED, ACTIONS, dt=DT, constraint=constraint)
    assert isinstance(policy, CTRNN)
    torch.testing.assert_close(policy.time_constants(), torch.ones(6))
    policy.set_parameter_vector(policy.parameter_vector() - 1000.0)
    assert (policy.time_constants() >= DT).all()


@pytest.mark.parametrize("constraint", ["clamp", "softplus", "exponential"])
@pytest.mark.parametrize("seconds", [0.1 + 1e-6, 3.0, 800.0, 1e30])
def test_any_time_constant_can_be_the_first(constraint: str, seconds: float) -> None:
    policy = make_policy(
        "ctrnn", 4, 2, dt=0.1, constraint=constraint, time_constant=seconds, dtype=torch.float64
    )
    assert isinstance(policy, CTRNN)
    np.testing.assert_allclose(policy.time_constants().detach(), seconds, rtol=1e-9)


@pytest.mark.parametrize("constraint", ["clamp", "softplus", "exponential"])
def test_time_constants_are_spread_evenly_in_their_logarithm(constraint: str) -> None:
    policy = make_policy(
        "ctrnn", 4, 1, dt=0.1, constraint=constraint, time_constant=0.4, time_constant_spread=4.0
    )
    assert isinstance(policy, CTRNN)
    # N = 3: half of .4, .4 and twice .4
    torch.testing.assert_close(policy.time_constants().detach(), torch.tensor([0.2, 0.4, 0.8]))


def test_the_clamp_leaves_other_time_constants_alone() -> None:
    policy = make_policy("ctrnn", OBSERVED, ACTIONS, dt=DT)
    assert isinstance(policy, CTRNN)
    theta = policy.split(policy.parameter_vector())
    theta["tau_raw"] = torch.tensor([0.05, 0.2, -1.0, 3.0, 0.1, 0.5])
    policy.set_parameter_vector(policy.join(theta))
    expected = torch.tensor([DT, 0.2, DT, 3.0, 0.1, 0.5])
    torch.testing.assert_close(policy.time_constants().detach(), expected)


# ------------------------------------------------------------------------------------ reservoirs
@pytest.mark.parametrize(("spectral_radius", "density"), [(1.1, 1.0), (1.5, 0.7), (0.3, 0.1)])
def test_reservoir_has_its_radius_and_density(spectral_radius: float, density: float) -> None:
    policy = make_policy(
        "esn",
        6,
        3,
        dt=DT,
        spectral_radius=spectral_radius,
        density=density,
        dtype=torch.float64,
        seed=2,
    )
    assert isinstance(policy, ESN)
    weight = policy.recurrent.weight.numpy()
    assert np.abs(np.linalg.eigvals(weight)).max() == pytest.approx(spectral_radius, rel=1e-9)
    n = policy.units
    assert (weight == 0).sum() == int((1 - density) * n**2)
    assert np.abs(policy.input.weight.numpy()).max() <= 0.5
    assert np.abs(policy.eigenvalues()).max() == pytest.approx(spectral_radius, rel=1e-9)


def test_radius_of_a_large_matrix() -> None:
    rng = np.random.default_rng(3)
    weight = rng.uniform(-0.5, 0.5, (1050, 1050))
    dense = np.abs(np.linalg.eigvals(weight)).max()
    assert radius(weight) == pytest.approx(dense, rel=1e-8)


def test_the_reservoir_does_not_learn() -> None:
    policy = network("esn")
    assert set(policy.trainable()) == {"log_std", "head.weight", "head.bias"}


# ----------------------------------------------------------------------------------- first values
@pytest.mark.parametrize("architecture", RECURRENT)
def test_initial_weights(architecture: str) -> None:
    policy = make_policy(architecture, 20, 6, dt=DT, seed=3)
    w = weights(policy)
    assert (w["log_std"] == 0).all()
    assert (w["head.bias"] == 0).all()
    assert (w["h0"] == 0).all()
    glorot = math.sqrt(6 / (policy.hidden_size + 6))
    assert 0.8 * glorot < np.abs(w["head.weight"]).max() <= glorot
    if architecture != "esn":
        assert (w["input.bias"] == 0).all()
        n = policy.hidden_size
        bound = math.sqrt(6 / (26 + n))
        for gate in np.split(w["input.weight"], len(w["input.weight"]) // n):
            assert 0.8 * bound < np.abs(gate).max() <= bound


def gates(policy: GaussianPolicy, layer: str) -> list[np.ndarray]:
    """Weights of each gate, ``(N, inputs)``."""
    weight = weights(policy)[f"{layer}.weight"]
    return np.split(weight, len(weight) // policy.hidden_size)


def is_uniform(block: np.ndarray, bound: float) -> bool:
    """Whether a block looks drawn from U(-bound, bound).

    With more than a thousand numbers the test of Kolmogorov and Smirnov sees a bound that is
    20% off, and other laws.
    """
    assert block.size > 1000
    inside = np.abs(block).max() <= bound * (1 + 1e-6)
    test = stats.kstest(block.ravel(), "uniform", (-bound, 2 * bound))
    return bool(inside and test.pvalue > 1e-3)


def glorot(block: np.ndarray) -> float:
    """Bound of Glorot's law for a weight of shape ``(outputs, inputs)``."""
    return math.sqrt(6 / sum(block.shape))


@pytest.mark.parametrize("architecture", ["dtrnn", "ctrnn", "gru", "lstm", "esn"])
def test_laws_of_the_recurrent_nets(architecture: str) -> None:
    # as in the author's code; fan-in and fan-out are those of one gate
    policy = make_policy(architecture, 60, 30, dt=DT, units=50, seed=1, dtype=torch.float64)
    n_gates = {"gru": 3, "lstm": 4}.get(architecture, 1)
    received, recurrent = gates(policy, "input"), gates(policy, "recurrent")
    assert [b.shape for b in received] == [(50, 90)] * n_gates
    assert [b.shape for b in recurrent] == [(50, 50)] * n_gates
    for block in received:
        assert is_uniform(block, 0.5 if architecture == "esn" else glorot(block))
    for block in recurrent:
        if architecture == "lstm":
            np.testing.assert_allclose(block @ block.T, 1.1**2 * np.identity(50), atol=1e-12)
        elif architecture == "esn":  # U(-0.5, 0.5), scaled to its radius
            assert is_uniform(block, np.abs(block).max())
        else:
            assert is_uniform(block, glorot(block))
    head = weights(policy)["head.weight"]
    assert is_uniform(head, glorot(head))
    for one, two in combinations([*received, *recurrent], 2):
        assert abs(np.corrcoef(one[:, :50].ravel(), two[:, :50].ravel())[0, 1]) < 0.1
    for name in ("h0", "log_std", "head.bias"):
        assert (weights(policy)[name] == 0).all()


@pytest.mark.parametrize("architecture", ["ffwd", "ffwd-400", "dffwd", "dffwd-softplus"])
def test_laws_of_the_feedforward_nets(architecture: str) -> None:
    units = 70 if architecture == "ffwd" else None
    policy = make_policy(architecture, 60, 50, dt=DT, units=units, seed=1, dtype=torch.float64)
    w = weights(policy)
    layers = [value for name, value in w.items() if name.endswith(".weight")]
    widths = {"ffwd": [70], "ffwd-400": [400]}.get(architecture, [100, 50, 25])
    assert sorted(b.shape for b in layers) == sorted(
        (out, into) for into, out in pairwise([60, *widths, 50])
    )
    for block in layers:
        assert is_uniform(block, glorot(block))
    for name, value in w.items():
        assert name.endswith(".weight") or (value == 0).all()


def test_orthogonal_gates() -> None:
    policy = make_policy("lstm", 20, 6, dt=DT, seed=3, dtype=torch.float64)
    for gate in policy.get_parameter("recurrent.weight").detach().chunk(4):
        torch.testing.assert_close(gate @ gate.T, 1.1**2 * torch.eye(6, dtype=torch.float64))
