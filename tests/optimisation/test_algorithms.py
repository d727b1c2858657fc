"""Algorithms 5 and 6, the natural gradient and PPO."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from tests.optimisation.batches import batch_for
from tests.policies.networks import VARIANTS, network, relative
from thesis_lib.optimisation import (
    PPO,
    TRPO,
    VPG,
    Algorithm,
    Batch,
    LocalProblem,
    NaturalPG,
)
from thesis_lib.optimisation.natural import natural_direction
from thesis_lib.policies import ARCHITECTURES, GaussianPolicy, Packing, log_likelihood


def explicit_fisher(policy: GaussianPolicy, problem: LocalProblem) -> Tensor:
    columns = torch.eye(policy.n_trainable, dtype=torch.float64)
    return torch.stack([problem.fisher_product(v) for v in columns], dim=1)


# ------------------------------------------------------------------------------------------ VPG
def test_vpg_steps_along_equation_2_13() -> None:
    policy = network("dtrnn")
    batch = batch_for(policy)
    # < grad sum_t log pi A_t > over 5 trajectories, by backpropagation
    likelihood = log_likelihood(batch.actions, policy.means(batch.sequences), policy.deviation())
    objective = (likelihood * batch.advantages).sum() / 5
    parameters = policy.trainable()
    gradient = torch.autograd.grad(objective, list(parameters.values()))
    expected = policy.join(dict(zip(parameters, gradient, strict=True)))
    before = policy.parameter_vector()
    report = VPG(learning_rate=1e-3).update(policy, batch)
    moved = policy.parameter_vector() - before
    assert relative(moved, 1e-3 * expected) < 1e-10
    assert report.step_norm == pytest.approx(float(moved.norm()), rel=1e-12)
    assert report.surrogate > 0


def test_vpg_averages_differ_by_the_mean_length() -> None:
    steps = []
    for average in ("trajectories", "steps"):
        policy = network("gru")
        before = policy.parameter_vector()
        VPG(learning_rate=1e-3, average=average).update(policy, batch_for(policy))
        steps.append(policy.parameter_vector() - before)
    assert relative(steps[0], steps[1] * 23 / 5) < 1e-9


# ------------------------------------------------------------------------------ natural gradient
@pytest.mark.parametrize("variant", ["ffwd", "dtrnn", "ctrnn", "lstm"])
def test_natural_gradient_solves_equation_2_15(variant: str) -> None:
    policy = network(variant)
    batch = batch_for(policy, (9, 12, 5, 11))
    problem = LocalProblem(policy, batch)
    damping = 1e-2
    damped = explicit_fisher(policy, problem) + damping * torch.eye(policy.n_trainable)
    gradient = problem.gradient()
    natural = torch.linalg.solve(damped, gradient)
    before = policy.parameter_vector()
    NaturalPG(learning_rate=0.1, cg_iterations=400, damping=damping).update(policy, batch)
    assert relative(policy.parameter_vector() - before, 0.1 * natural) < 1e-3
    policy.set_parameter_vector(before)
    NaturalPG(delta=1e-3, cg_iterations=400, damping=damping).update(policy, batch)
    length = math.sqrt(2 * 1e-3 / float(gradient @ natural))
    assert relative(policy.parameter_vector() - before, length * natural) < 1e-3


@pytest.mark.parametrize("iterations", [1, 2, 5])
def test_conjugate_gradient_makes_as_many_steps_as_asked_for(iterations: int) -> None:
    policy = network("dtrnn")
    problem = LocalProblem(policy, batch_for(policy))
    gradient, damping = problem.gradient(), 1e-3
    solution = natural_direction(problem, gradient, iterations, damping)
    assert solution.iterations == iterations
    # the minimum of 1/2 x F x - g x over the Krylov space g, Fg, F^2 g, ...
    damped = explicit_fisher(policy, problem) + damping * torch.eye(policy.n_trainable)
    powers = [gradient / gradient.norm()]
    for _ in range(iterations - 1):
        powers.append(damped @ powers[-1] / (damped @ powers[-1]).norm())
    q, _ = torch.linalg.qr(torch.stack(powers, dim=1))
    expected = q @ torch.linalg.solve(q.T @ damped @ q, q.T @ gradient)
    assert relative(solution.x, expected) < 1e-6


# ----------------------------------------------------------------------------------------- TRPO
@given(
    st.sampled_from(["linear", "ffwd", "dtrnn", "ctrnn", "gru", "lstm", "esn"]),
    st.floats(1e-4, 3.0),
    st.integers(0, 10_000),
    st.sampled_from(["old_new", "new_old"]),
)
@settings(max_examples=60, deadline=None)
def test_the_line_search_keeps_its_promise(
    variant: str, delta: float, seed: int, kl_direction: str
) -> None:
    policy = network(variant, seed)
    batch = batch_for(policy, seed=seed)
    before = policy.parameter_vector()
    start = LocalProblem(policy, batch, kl_direction)
    report = TRPO(delta=delta, max_backtracks=4, kl_direction=kl_direction).update(policy, batch)
    now = start.value()  # measured anew, against the policy before the update
    assert report.kl == pytest.approx(now.kl, rel=1e-9, abs=1e-14)
    if report.accepted:
        assert now.kl <= delta
        assert now.surrogate > start.start().surrogate
        assert report.surrogate == pytest.approx(now.surrogate - start.start().surrogate)
    else:
        assert torch.equal(policy.parameter_vector(), before)
        assert report.surrogate == report.kl == report.step_norm == 0


def test_the_first_step_that_passes_is_taken() -> None:
    taken = set()
    for seed in range(12):
        policy = network("dtrnn", seed)
        batch = batch_for(policy, seed=seed)
        before = policy.parameter_vector()
        problem = LocalProblem(policy, batch)
        gradient = problem.gradient()
        damped = explicit_fisher(policy, problem) + 1e-5 * torch.eye(policy.n_trainable)
        report = TRPO(delta=1.0, cg_iterations=100).update(policy, batch)
        step = policy.parameter_vector() - before
        # undo the shortening: the full step reaches the bound of the quadratic approximation
        full = step / 0.8**report.backtracks
        assert 0.5 * float(full @ damped @ full) == pytest.approx(1.0, rel=1e-3)
        assert float(gradient @ step) > 0
        for k in range(report.backtracks):
            value = problem.move(0.8**k * full)
            assert value.kl > 1.0 or value.surrogate <= 0 + problem.start().surrogate
        taken.add(report.backtracks)
    assert len(taken) > 1


def test_nothing_passes_when_nothing_can_improve() -> None:
    # advantages of 0: the surrogate is flat
    policy = network("gru")
    batch = batch_for(policy)
    flat = Batch(batch.sequences, batch.actions, torch.zeros_like(batch.advantages))
    before = policy.parameter_vector()
    report = TRPO().update(policy, flat)
    assert not report.accepted
    assert report.backtracks == 15
    assert torch.equal(policy.parameter_vector(), before)


def test_time_constants_are_projected_inside_the_line_search() -> None:
    policy = network("ctrnn", 3)
    with torch.no_grad():
        policy.get_parameter("tau_raw").fill_(0.1)  # at the step: half of all moves are cut
    batch = batch_for(policy, seed=3)
    problem = LocalProblem(policy, batch)
    report = TRPO(delta=0.05).update(policy, batch)
    assert report.accepted
    assert (policy.get_parameter("tau_raw") >= 0.1).all()
    assert problem.value().kl == pytest.approx(report.kl, rel=1e-9)
    assert report.kl <= 0.05


# ------------------------------------------------------------------------------------ invariance
def permuted(policy: GaussianPolicy, batch: Batch, order: np.ndarray) -> Batch:
    return batch.episodes(order)


ALGORITHMS: dict[str, Algorithm] = {
    "vpg": VPG(learning_rate=0.01),
    "natural": NaturalPG(delta=0.01),
    "trpo": TRPO(delta=0.05),
}


@pytest.mark.parametrize("name", ALGORITHMS)
@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_the_order_of_episodes_does_not_matter(architecture: str, name: str) -> None:
    moved = []
    for order in (np.arange(5), np.array([4, 2, 0, 1, 3])):
        policy = network(architecture)
        batch = permuted(policy, batch_for(policy), order)
        before = policy.parameter_vector()
        ALGORITHMS[name].update(policy, batch)
        moved.append(policy.parameter_vector() - before)
    assert relative(moved[1], moved[0]) < 1e-6


@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_padding_does_not_matter(architecture: str) -> None:
    # the same episodes from padded arrays with rubbish in the padding
    policy = network(architecture)
    batch = batch_for(policy)
    packing = batch.packing
    rng = np.random.default_rng(0)
    observations = rng.normal(size=(10, 5, 4))
    actions = packing.unpack(batch.actions.numpy())
    mask = np.zeros((10, 5), dtype=bool)
    mask[:7] = packing.mask()
    wide = rng.normal(size=(10, 5, 2)) * 1e6
    wide[:7][packing.mask()] = actions[packing.mask()]
    moved = []
    for rubbish in (0.0, 1e6):
        theirs = Packing(mask.sum(axis=0))
        inputs = np.where(mask[..., None], observations, rubbish)
        policy = network(architecture)
        sequences = policy.sequences(theirs.pack(inputs), theirs.pack(wide), theirs)
        before = policy.parameter_vector()
        TRPO(delta=0.05).update(policy, Batch(sequences, batch.actions, batch.advantages))
        moved.append(policy.parameter_vector() - before)
    assert torch.equal(moved[0], moved[1])


# ------------------------------------------------------------------------------------------ PPO
def test_ppo_first_step_is_adam_on_the_surrogate() -> None:
    # with one epoch and one part nothing is clipped, and Adam's first step is the sign
    policy = network("gru")
    batch = batch_for(policy)
    gradient = LocalProblem(policy, batch).gradient()
    before = policy.parameter_vector()
    PPO(learning_rate=1e-3, epochs=1, minibatches=1).update(policy, batch)
    moved = policy.parameter_vector() - before
    torch.testing.assert_close(moved, 1e-3 * torch.sign(gradient), rtol=1e-3, atol=1e-8)


def test_ppo_clips() -> None:
    def distance(clip: float) -> float:
        policy = network("ffwd")
        return PPO(clip=clip, learning_rate=0.02, epochs=40).update(policy, batch_for(policy)).kl

    assert distance(0.01) < distance(0.2) < distance(100.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_ppo_clips_on_either_side(sign: float) -> None:
    # Good actions become more likely up to 1 + eps, bad ones less likely down to 1 - eps; from
    # there on nothing pushes.
    def distance(clip: float) -> float:
        policy = network("ffwd")
        batch = batch_for(policy)
        same = Batch(batch.sequences, batch.actions, sign * torch.ones_like(batch.advantages))
        return PPO(clip=clip, learning_rate=0.01, epochs=100).update(policy, same).kl

    assert distance(0.05) < 0.1 * distance(1e6)


def test_ppo_keeps_time_constants_at_or_above_the_step() -> None:
    policy = network("ctrnn", 3)
    tau = policy.get_parameter("tau_raw")
    with torch.no_grad():
        tau.fill_(0.1)  # at the step: half of all moves lead below it
    PPO(learning_rate=0.01, epochs=3).update(policy, batch_for(policy, seed=3))
    assert (tau >= 0.1).all()
    assert (tau == 0.1).any()
    assert (tau > 0.1).any()


def test_ppo_goes_on_where_it_stopped() -> None:
    batches = [batch_for(network("dtrnn"), seed=s) for s in range(4)]
    whole, policy = PPO(seed=1), network("dtrnn")
    for batch in batches:
        whole.update(policy, batch)
    first, resumed = PPO(seed=1), network("dtrnn")
    for batch in batches[:2]:
        first.update(resumed, batch)
    second = PPO(seed=9)
    second.load_state_dict(first.state_dict())
    for batch in batches[2:]:
        second.update(resumed, batch)
    assert torch.equal(resumed.parameter_vector(), policy.parameter_vector())


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_network_can_be_updated_by_every_algorithm(variant: str) -> None:
    for algorithm in (*ALGORITHMS.values(), PPO(epochs=2)):
        policy = network(variant)
        report = algorithm.update(policy, batch_for(policy))
        assert math.isfinite(report.kl)
        assert report.kl >= 0
        assert report.step_norm > 0 or not report.accepted


# ------------------------------------------------------------------------------------- bad input
@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: TRPO(delta=0.0), r"delta is 0\.0, but it must be positive"),
        (lambda: TRPO(delta=-1.0), "delta is -1"),
        (lambda: TRPO(delta=math.nan), "delta is nan"),
        (lambda: TRPO(damping=0.0), "damping is 0"),
        (lambda: TRPO(backtrack_ratio=1.0), "must be below 1"),
        (lambda: VPG(learning_rate=0.0), "learning_rate is 0"),
        (lambda: VPG(average="all"), "choose one of trajectories, steps"),
        (lambda: NaturalPG(), "exactly one of them"),
        (lambda: NaturalPG(learning_rate=0.1, delta=0.1), "exactly one of them"),
        (lambda: NaturalPG(delta=-0.1), r"delta is -0\.1"),
        (lambda: PPO(clip=0.0), "clip is 0"),
    ],
)
def test_bad_arguments(make: object, message: str) -> None:
    assert callable(make)
    with pytest.raises(ValueError, match=message):
        make()
