"""The gradient and the Fisher matrix of equations 2.13 to 2.15, by independent ways."""

import numpy as np
import pytest
import torch
from torch import Tensor

from tests.optimisation.batches import batch_for
from tests.policies.networks import VARIANTS, double_backpropagation, network, relative
from thesis_lib.optimisation import TRPO, Batch, LocalProblem, Rollouts, make_batch
from thesis_lib.optimisation.problem import report
from thesis_lib.policies import (
    GaussianPolicy,
    Packing,
    kl_divergence,
    log_likelihood,
    make_policy,
)


def direction(policy: GaussianPolicy, seed: int = 3) -> Tensor:
    draw = torch.Generator().manual_seed(seed)
    return torch.randn(policy.n_trainable, generator=draw, dtype=torch.float64)


def scores(policy: GaussianPolicy, batch: Batch, actions: Tensor) -> Tensor:
    """grad log pi(a_t | s_t) of every step, ``(R, P)``, by backpropagation step by step."""
    mean, log_std = policy.means(batch.sequences), policy.deviation()
    likelihood = log_likelihood(actions, mean, log_std)
    parameters = policy.trainable()
    rows = []
    for value in likelihood:
        gradients = torch.autograd.grad(
            value, list(parameters.values()), retain_graph=True, allow_unused=True
        )
        named = zip(parameters, gradients, strict=True)
        rows.append(policy.join({name: g for name, g in named if g is not None}))
    return torch.stack(rows)


def fisher_matrix(policy: GaussianPolicy, batch: Batch) -> Tensor:
    r"""Mean over steps of E_a[score score^T], the integral over actions by quadrature.

    Scores are quadratic in the action and their products of fourth degree, so that
    Gauss-Hermite quadrature with 5 nodes for each entry is exact.
    """
    nodes, weights = np.polynomial.hermite_e.hermegauss(5)
    weights = weights / weights.sum()
    mean, std = policy.means(batch.sequences).detach(), torch.exp(policy.deviation()).detach()
    total = torch.zeros((policy.n_trainable, policy.n_trainable), dtype=torch.float64)
    for i, x in enumerate(nodes):
        for j, y in enumerate(nodes):
            z = torch.tensor([x, y], dtype=torch.float64)
            s = scores(policy, batch, mean + std * z)
            total += weights[i] * weights[j] * s.T @ s / len(s)
    return total


@pytest.mark.parametrize(
    "variant", ["ffwd", "deep and small", "dtrnn", "ctrnn", "gru", "lstm", "esn"]
)
def test_against_the_explicit_fisher_matrix(variant: str) -> None:
    policy = network(variant)
    batch = batch_for(policy, (3, 1, 4))
    matrix = fisher_matrix(policy, batch)
    problem = LocalProblem(policy, batch)
    for seed in range(3):
        v = direction(policy, seed)
        assert relative(problem.fisher_product(v), matrix @ v) < 1e-11


@pytest.mark.parametrize("variant", VARIANTS)
def test_against_double_backpropagation(variant: str) -> None:
    policy = network(variant)
    batch = batch_for(policy)
    v = direction(policy)
    reference = double_backpropagation(policy, batch.sequences, v)
    assert relative(LocalProblem(policy, batch).fisher_product(v), reference) < 1e-10


@pytest.mark.parametrize("variant", VARIANTS)
def test_gradient_of_the_surrogate(variant: str) -> None:
    # by autograd through the likelihood ratio of equation 2.14
    policy = network(variant)
    batch = batch_for(policy)
    likelihood = log_likelihood(batch.actions, policy.means(batch.sequences), policy.deviation())
    surrogate = (torch.exp(likelihood - likelihood.detach()) * batch.advantages).mean()
    parameters = policy.trainable()
    gradients = torch.autograd.grad(surrogate, list(parameters.values()), allow_unused=True)
    named = zip(parameters, gradients, strict=True)
    reference = policy.join({name: g for name, g in named if g is not None})
    assert relative(LocalProblem(policy, batch).gradient(), reference) < 1e-12


def test_gradient_is_that_of_the_log_likelihood() -> None:
    # equation 2.13, per step: < A_t grad log pi(a_t | s_t) >
    policy = network("dtrnn")
    batch = batch_for(policy)
    s = scores(policy, batch, batch.actions)
    expected = (batch.advantages[:, None] * s).mean(0)
    assert relative(LocalProblem(policy, batch).gradient(), expected) < 1e-12


def test_gradient_by_finite_differences_of_the_surrogate() -> None:
    policy = network("ctrnn")
    problem = LocalProblem(policy, batch_for(policy))
    gradient = problem.gradient()
    for seed in range(3):
        v = 1e-5 * direction(policy, seed)
        slope = (problem.move(v).surrogate - problem.move(-v).surrogate) / 2
        assert float(gradient @ v) == pytest.approx(slope, rel=1e-7)


@pytest.mark.parametrize("kl_direction", ["old_new", "new_old"])
def test_the_quadratic_approximation(kl_direction: str) -> None:
    # D_KL = 1/2 dtheta^T F dtheta + third order, in either direction
    policy = network("gru")
    problem = LocalProblem(policy, batch_for(policy), kl_direction)
    v = direction(policy)
    v = v / v.norm()
    curvature = float(v @ problem.fisher_product(v))
    errors = []
    for size in (1e-2, 1e-3):
        kl = problem.move(size * v).kl
        errors.append(abs(kl - 0.5 * size**2 * curvature))
    assert errors[0] / errors[1] == pytest.approx(1000, rel=0.1)


def test_value_by_definition() -> None:
    policy = network("dtrnn")
    batch = batch_for(policy)
    problem = LocalProblem(policy, batch)
    mean, log_std = policy.means(batch.sequences).detach(), policy.deviation().detach().clone()
    value = problem.move(0.1 * direction(policy))
    new_mean, new_log_std = policy.means(batch.sequences), policy.deviation()
    old = log_likelihood(batch.actions, mean, log_std)
    new = log_likelihood(batch.actions, new_mean, new_log_std)
    expected = float((torch.exp(new - old) * batch.advantages).mean().detach())
    assert value.surrogate == pytest.approx(expected, rel=1e-12)
    kl = kl_divergence(mean, log_std, new_mean, new_log_std).mean()
    assert value.kl == pytest.approx(float(kl.detach()), rel=1e-12)
    problem.restore()
    assert problem.value() == problem.start()
    assert problem.start().kl == 0


def test_a_deviation_on_its_floor_does_not_move() -> None:
    policy = make_policy("ffwd", 4, 2, dt=0.1, dtype=torch.float64)
    with torch.no_grad():
        policy.log_std[0] = -20.0
    batch = batch_for(policy)
    problem = LocalProblem(policy, batch)
    v = direction(policy)
    assert policy.split(problem.gradient())["log_std"][0] == 0
    assert policy.split(problem.fisher_product(v))["log_std"][0] == 0
    reference = double_backpropagation(policy, batch.sequences, v)
    assert relative(problem.fisher_product(v), reference) < 1e-10


@pytest.mark.parametrize("architecture", ["dffwd", "dtrnn", "ctrnn", "gru", "lstm", "esn"])
def test_float32_products_are_close(architecture: str) -> None:
    products = []
    for dtype in (torch.float64, torch.float32):
        policy = make_policy(architecture, 4, 2, dt=0.1, seed=1, dtype=dtype)
        batch = batch_for(policy)
        v = direction(policy)
        products.append(LocalProblem(policy, batch).fisher_product(v))
    assert relative(products[1], products[0]) < 1e-5


def test_part_of_a_batch() -> None:
    policy = network("lstm")
    batch = batch_for(policy)
    chosen = np.array([3, 0])
    part = batch.episodes(chosen)
    assert part.packing.lengths.tolist() == [7, 3]
    whole = policy.means(batch.sequences)
    mine = policy.means(part.sequences)
    for new, old in enumerate(chosen):
        rows, old_rows = part.packing.episode == new, batch.packing.episode == old
        torch.testing.assert_close(mine[rows], whole[old_rows])
        torch.testing.assert_close(part.advantages[rows], batch.advantages[old_rows])


def test_rollouts_become_a_batch() -> None:
    policy = make_policy("dtrnn", 1, 1, dt=0.1)
    packing = Packing(np.array([2, 1]))
    actions = np.array([[1.0], [2.0], [3.0]])
    rollouts = Rollouts(
        packing=packing,
        observations=np.zeros((3, 1)),
        actions=actions,
        rewards=np.zeros(3),
        terminated=np.zeros(2, dtype=bool),
        final_observations=np.zeros((2, 1)),
    )
    batch = make_batch(policy, rollouts, np.arange(3.0))
    assert batch.actions.dtype == batch.advantages.dtype == torch.float32
    assert batch.sequences.inputs[:, 1].tolist() == [0, 0, 1]


def test_an_update_that_spoils_a_parameter_is_not_reported() -> None:
    policy = network("gru")
    problem = LocalProblem(policy, batch_for(policy))
    assert report(problem, problem.start()).step_norm == 0
    with torch.no_grad():
        policy.head.weight[1, 0] = float("nan")
    with pytest.raises(FloatingPointError, match=r"parameter 'head\.weight' of the gru"):
        report(problem, problem.start())


def test_bad_arguments() -> None:
    policy = network("gru")
    with pytest.raises(ValueError, match="choose one of old_new, new_old"):
        LocalProblem(policy, batch_for(policy), "both")
    with pytest.raises(ValueError, match="choose one of old_new, new_old"):
        TRPO(kl_direction="both")
    batch = batch_for(policy)
    batch.advantages[0] = float("nan")
    with pytest.raises(FloatingPointError, match="the gradient of parameter"):
        LocalProblem(policy, batch).gradient()
