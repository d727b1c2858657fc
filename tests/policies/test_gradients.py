"""Both products with the Jacobian, for every network, against four independent ways."""

import pytest
import torch
from torch import Tensor
from torch.func import functional_call

from tests.policies.networks import (
    VARIANTS,
    block,
    double_backpropagation,
    network,
    relative,
)
from thesis_lib.policies import DTRNN, DualLinearised, GaussianPolicy, Sequences
from thesis_lib.policies.recurrent import Recur


def direction(policy: GaussianPolicy, seed: int = 5) -> Tensor:
    draw = torch.Generator().manual_seed(seed)
    return torch.randn(policy.n_trainable, generator=draw, dtype=torch.float64)


def weights(policy: GaussianPolicy, sequences: Sequences, seed: int = 6) -> Tensor:
    draw = torch.Generator().manual_seed(seed)
    shape = (sequences.packing.n_steps, policy.action_size)
    return torch.randn(shape, generator=draw, dtype=torch.float64)


@pytest.mark.parametrize("variant", VARIANTS)
def test_against_double_backpropagation(variant: str) -> None:
    policy = network(variant)
    sequences, _ = block(policy)
    v = direction(policy)
    reference = double_backpropagation(policy, sequences, v)
    precision = torch.exp(-2 * policy.deviation().detach()) / sequences.packing.n_steps
    for linearised in (policy.linearise(sequences), DualLinearised(policy, sequences)):
        product = linearised.vjp(linearised.jvp(v) * precision)
        product = product + policy.join({"log_std": 2 * policy.split(v)["log_std"]})
        assert relative(product, reference) < 1e-12


@pytest.mark.parametrize("variant", VARIANTS)
def test_gradient_against_backpropagation(variant: str) -> None:
    policy = network(variant)
    sequences, _ = block(policy)
    u = weights(policy, sequences)
    mean = policy.means(sequences)
    parameters = policy.trainable()
    gradient = torch.autograd.grad(mean, list(parameters.values()), u, allow_unused=True)
    named = zip(parameters, gradient, strict=True)
    reference = policy.join({name: g for name, g in named if g is not None})
    linearised = policy.linearise(sequences)
    assert relative(linearised.mean, mean.detach()) < 1e-14
    assert relative(linearised.vjp(u), reference) < 1e-13


@pytest.mark.parametrize("variant", VARIANTS)
def test_against_finite_differences(variant: str) -> None:
    policy = network(variant)
    sequences, _ = block(policy)
    theta, v, width = policy.parameter_vector(), direction(policy), 1e-6
    # time constants stay above the step, so that setting parameters does not project
    linearised = policy.linearise(sequences)
    means = []
    with torch.no_grad():
        for sign in (1, -1):
            policy.set_parameter_vector(theta + sign * width * v)
            means.append(policy.means(sequences))
    slope = (means[0] - means[1]) / (2 * width)
    assert relative(linearised.jvp(v), slope) < 1e-7
    # each parameter by itself, against the transpose
    u = weights(policy, sequences)
    expected = torch.zeros_like(theta)
    with torch.no_grad():
        for i in range(0, len(theta), max(1, len(theta) // 60)):
            step = torch.zeros_like(theta)
            step[i] = width
            policy.set_parameter_vector(theta + step)
            up = (policy.means(sequences) * u).sum()
            policy.set_parameter_vector(theta - step)
            expected[i] = (up - (policy.means(sequences) * u).sum()) / (2 * width)
            ours = linearised.vjp(u)[i]
            assert float(ours - expected[i]) == pytest.approx(0, abs=1e-6)


class Means(torch.nn.Module):
    def __init__(self, policy: GaussianPolicy) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, sequences: Sequences) -> Tensor:
        return self.policy.means(sequences)


def complex_step(policy: GaussianPolicy, sequences: Sequences, v: Tensor) -> Tensor:
    """Imaginary part of the mean at theta + i eps v, over eps: exact to rounding."""
    width = 1e-30
    if getattr(policy, "activation", None) is torch.nn.functional.softplus:
        policy.activation = lambda z: torch.log(1 + torch.exp(z))  # has a complex version
    tangents = policy.split(v)
    state = {
        f"policy.{name}": torch.complex(p.detach(), width * tangents[name])
        if name in tangents
        else p.detach().to(torch.complex128)
        for name, p in policy.named_parameters()
    }
    state |= {f"policy.{n}": b.to(torch.complex128) for n, b in policy.named_buffers()}
    hidden = None if sequences.hidden is None else sequences.hidden.to(torch.complex128)
    inputs = Sequences(sequences.inputs.to(torch.complex128), sequences.packing, hidden)
    with torch.no_grad():
        return functional_call(Means(policy), state, (inputs,)).imag / width


@pytest.mark.parametrize("variant", [v for v in VARIANTS if v != "ctrnn softplus"])
def test_against_complex_step(variant: str) -> None:
    policy = network(variant)
    sequences, _ = block(policy)
    v = direction(policy)
    expected = policy.linearise(sequences).jvp(v)
    assert relative(expected, complex_step(policy, sequences, v)) < 1e-12


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_two_products_are_transposes(variant: str) -> None:
    policy = network(variant)
    sequences, _ = block(policy, lengths=(1, 1, 4))
    linearised = policy.linearise(sequences)
    v, u = direction(policy), weights(policy, sequences)
    left, right = float((linearised.jvp(v) * u).sum()), float(linearised.vjp(u) @ v)
    assert left == pytest.approx(right, rel=1e-12)


def test_a_cell_must_start_from_its_state() -> None:
    class Wrong(DTRNN):
        def cell(self, drive: Tensor, state: Tensor, recur: Recur, *coefficients: Tensor) -> Tensor:
            return torch.tanh(drive + recur(2 * state))

    policy = Wrong(4, 2, units=3)
    sequences, _ = block(policy)
    with pytest.raises(ValueError, match="the first call of recur must be on h"):
        policy.linearise(sequences)


def test_a_network_of_your_own() -> None:
    # the general way needs nothing but torch operations: here a layer normalisation mixes units
    class Normalised(DTRNN):
        def cell(self, drive: Tensor, state: Tensor, recur: Recur, *coefficients: Tensor) -> Tensor:
            z = drive + recur(state)
            return torch.tanh(z - z.mean(-1, keepdim=True))

        def linearise(self, sequences: Sequences) -> DualLinearised:
            return DualLinearised(self, sequences)

    policy = Normalised(4, 2, units=3, dtype=torch.float64)
    sequences, _ = block(policy)
    v = direction(policy)
    linearised = policy.linearise(sequences)
    precision = torch.ones(2, dtype=torch.float64) / sequences.packing.n_steps
    product = linearised.vjp(linearised.jvp(v) * precision)
    product = product + policy.join({"log_std": 2 * policy.split(v)["log_std"]})
    assert relative(product, double_backpropagation(policy, sequences, v)) < 1e-12


@pytest.mark.parametrize("variant", ["dffwd", "ctrnn", "lstm"])
def test_float32_is_close(variant: str) -> None:
    policy = network(variant)
    sequences, _ = block(policy)
    v = direction(policy)
    exact = policy.linearise(sequences).jvp(v)
    single = policy.float()
    inputs = Sequences(sequences.inputs.float(), sequences.packing)
    product = single.linearise(inputs).jvp(v.float())
    assert product.dtype == torch.float32
    assert relative(product.double(), exact) < 1e-5
