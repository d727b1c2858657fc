"""Options, the distribution and bad input."""

import math

import numpy as np
import pytest
import torch
from scipy import stats

from tests.policies.networks import network
from thesis_lib.policies import (
    ARCHITECTURES,
    Packing,
    entropy,
    kl_divergence,
    log_likelihood,
    make_policy,
)


@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_the_seed_decides_and_nothing_global_does(architecture: str) -> None:
    torch.manual_seed(0)
    before = torch.get_rng_state()
    one = make_policy(architecture, 4, 2, dt=0.1, seed=5)
    assert torch.equal(torch.get_rng_state(), before)
    torch.manual_seed(1)
    two = make_policy(architecture, 4, 2, dt=0.1, seed=5)
    other = make_policy(architecture, 4, 2, dt=0.1, seed=6)
    assert torch.equal(one.parameter_vector(), two.parameter_vector())
    assert not torch.equal(one.parameter_vector(), other.parameter_vector())
    # the number type rounds the same draw
    wide = make_policy(architecture, 4, 2, dt=0.1, seed=5, dtype=torch.float64)
    torch.testing.assert_close(wide.parameter_vector().float(), one.parameter_vector())


@pytest.mark.parametrize("architecture", ARCHITECTURES)
@pytest.mark.parametrize("seed", [2**64, -1, 1.0, True])
def test_seeds_that_there_are_not(architecture: str, seed: object) -> None:
    with pytest.raises(ValueError, match="must be an integer of at least 0 and below"):
        make_policy(architecture, 4, 2, dt=0.1, seed=seed)
    make_policy(architecture, 4, 2, dt=0.1, seed=2**64 - 1)


@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_the_scale_of_the_head_is_that_of_the_mean(architecture: str) -> None:
    whole = make_policy(architecture, 4, 2, dt=0.1, dtype=torch.float64)
    tenth = make_policy(architecture, 4, 2, dt=0.1, head_scale=0.1, dtype=torch.float64)
    draw = torch.Generator().manual_seed(0)
    observations = torch.randn((3, 2, 4), generator=draw, dtype=torch.float64)
    actions = torch.randn((3, 2, 2), generator=draw, dtype=torch.float64)
    # initial biases of the head are 0, so that the mean is linear in its weights
    torch.testing.assert_close(
        tenth(observations, actions)[0], 0.1 * whole(observations, actions)[0]
    )


def test_orthogonal_weights_keep_lengths_up_to_the_gain() -> None:
    net = make_policy("dffwd", 20, 3, dt=0.1, initialisation="orthogonal", dtype=torch.float64)
    hidden = [layer.weight.detach() for layer in net.layers]
    assert [tuple(w.shape) for w in hidden] == [(100, 20), (50, 100), (25, 50)]
    # gain sqrt(2): W^T W = 2 I on the shorter side, I for the head
    torch.testing.assert_close(hidden[0].T @ hidden[0], 2 * torch.eye(20, dtype=torch.float64))
    torch.testing.assert_close(hidden[1] @ hidden[1].T, 2 * torch.eye(50, dtype=torch.float64))
    head = net.head.weight.detach()
    torch.testing.assert_close(head @ head.T, torch.eye(3, dtype=torch.float64))


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"head_scale": -1.0}, "head_scale is -1.0"),
        ({"head_scale": float("nan")}, "head_scale is nan"),
        ({"initialisation": "zeros"}, "choose one of glorot, orthogonal"),
    ],
)
def test_bad_initial_weights(options: dict, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        make_policy("dffwd", 4, 2, dt=0.1, **options)


@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_features_are_chosen_in_order(architecture: str) -> None:
    seen = make_policy(architecture, 5, 2, dt=0.1, features=[4, 0, 2])
    alone = make_policy(architecture, 3, 2, dt=0.1)
    draw = torch.Generator().manual_seed(0)
    observations = torch.randn((4, 2, 5), generator=draw)
    actions = torch.randn((4, 2, 2), generator=draw)
    chosen = observations[..., [4, 0, 2]]
    torch.testing.assert_close(seen(observations, actions)[0], alone(chosen, actions)[0])
    assert seen.select(np.arange(5)).tolist() == [4, 0, 2]


@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_only_recurrent_nets_get_the_previous_action(architecture: str) -> None:
    policy = make_policy(architecture, 4, 2, dt=0.1)
    recurrent = policy.state_size > 0
    assert policy.previous_action == recurrent
    observations = torch.ones(3, 1, 4)
    one, _ = policy(observations, torch.zeros(3, 1, 2))
    two, _ = policy(observations, torch.ones(3, 1, 2))
    assert torch.equal(one, two) != recurrent


def test_sequences_shift_actions_by_one_step() -> None:
    policy = network("dtrnn")
    packing = Packing(np.array([3, 2]))
    actions = np.arange(10.0).reshape(5, 2)
    sequences = policy.sequences(np.zeros((5, 4)), actions, packing)
    # rows: t=0 of both episodes, t=1 of both, t=2 of the first
    expected = [[0, 0], [0, 0], [0, 1], [2, 3], [4, 5]]
    assert sequences.inputs[:, 4:].tolist() == expected


def test_floor_of_the_deviation() -> None:
    policy = make_policy("ffwd", 4, 2, dt=0.1)
    with torch.no_grad():
        policy.log_std.copy_(torch.tensor([-100.0, 0.5]))
    assert torch.exp(policy.deviation()).tolist() == pytest.approx([1e-6, np.exp(0.5)])
    free = make_policy("dtrnn", 4, 2, dt=0.1, initial_log_std=-100.0)
    assert free.deviation().tolist() == [-100.0, -100.0]


def test_parameter_vector_round_trip() -> None:
    policy = network("lstm with learned start")
    theta = policy.parameter_vector()
    assert torch.equal(policy.join(policy.split(theta)), theta)
    policy.set_parameter_vector(2 * theta)
    assert torch.equal(policy.parameter_vector(), 2 * theta)
    partial = policy.join({"head.bias": torch.ones(2, dtype=torch.float64)})
    assert float(partial.sum()) == 2


# ---------------------------------------------------------------------------------- distribution
def test_densities_against_scipy() -> None:
    rng = np.random.default_rng(0)
    mean, actions = rng.normal(size=(2, 5, 3))
    log_std = rng.normal(size=3)
    expected = stats.norm(mean, np.exp(log_std)).logpdf(actions).sum(axis=1)
    ours = log_likelihood(*(torch.as_tensor(x) for x in (actions, mean, log_std)))
    np.testing.assert_allclose(ours, expected, rtol=1e-12)
    joint = stats.multivariate_normal(np.zeros(3), np.diag(np.exp(2 * log_std)))
    assert float(entropy(torch.as_tensor(log_std))) == pytest.approx(joint.entropy(), rel=1e-12)


def test_divergence_against_its_integral() -> None:
    p, q = stats.norm(0.3, 0.7), stats.norm(-0.4, 1.2)
    expected = p.expect(lambda x: p.logpdf(x) - q.logpdf(x))
    args = (torch.tensor([[v]], dtype=torch.float64) for v in (0.3, -0.4))
    mean, mean_q = args
    log_std, log_std_q = (torch.tensor([np.log(v)], dtype=torch.float64) for v in (0.7, 1.2))
    ours = kl_divergence(mean, log_std, mean_q, log_std_q)
    assert float(ours) == pytest.approx(expected, rel=1e-8)
    assert float(kl_divergence(mean, log_std, mean, log_std)) == 0


# -------------------------------------------------------------------------------------- bad input
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("transformer", 4, 2, {}),
            "architecture 'transformer' does not exist: choose one of ffwd",
        ),
        (("gru", 0, 2, {}), "observation_size is 0"),
        (("gru", 4, 0, {}), "units is 0"),
        (("gru", 4, 2, {"units": 0}), "at least 1 hidden unit"),
        (("gru", 4, 2, {"features": [4]}), "feature 4 does not exist"),
        (("gru", 4, 2, {"features": [1, 1]}), "names an observation twice"),
        (("gru", 4, 2, {"features": []}), "at least one observation"),
        (("gru", 4, 2, {"leak": 0.5}), "architecture 'gru' does not take this"),
        (("gru", 4, 2, {"initialisation": "zeros"}), "choose one of glorot, orthogonal"),
        (("lstm", 4, 2, {"candidate": "relu"}), "choose one of tanh, logistic"),
        (("ctrnn", 4, 2, {"integrator": "rk4"}), "choose one of heun, euler, midpoint"),
        (("ctrnn", 4, 2, {"constraint": "none"}), "choose one of clamp, softplus, exponential"),
        (("ctrnn", 4, 2, {"time_constant": 0.05}), "at least the control step of 0.1 s"),
        (
            ("ctrnn", 4, 2, {"time_constant": 0.1, "constraint": "softplus"}),
            "above the control step",
        ),
        (("esn", 4, 2, {"density": 0.0}), "density is 0.0"),
        (("esn", 4, 2, {"leak": 1.5}), "leak is 1.5"),
        (("esn", 4, 2, {"spectral_radius": -1.0}), "spectral_radius is -1.0"),
        (("ffwd", 4, 2, {"activation": "relu"}), "choose one of tanh, softplus"),
        (("dffwd", 4, 2, {"hidden": (10, 0)}), "a layer of 0 units"),
        (("dffwd", 4, 2, {"units": 5}), "units is 5, but dffwd has layers of its own"),
        (("dffwd-softplus", 4, 2, {"units": 5}), "dffwd-softplus has layers of its own"),
        (
            ("ffwd", 4, 2, {"units": 8, "hidden": (4, 4)}),
            r"units is 8, but hidden gives the layers of ffwd, \(4, 4\): leave one of them out",
        ),
        (
            ("ctrnn", 4, 2, {"time_constant": 0.15, "time_constant_spread": 9.0}),
            r"0.15 s \(smallest 0.05 s\), but it must be at least the control step of 0.1 s",
        ),
        (("ctrnn", 4, 2, {"time_constant_spread": 0.5}), "time_constant_spread is 0.5, but the"),
        (("ctrnn", 4, 2, {"time_constant": math.inf}), "time_constant is inf s, but it must be a"),
        (("ctrnn", 4, 2, {"time_constant": math.nan}), "time_constant is nan s, but it must be a"),
        (("ctrnn", 4, 2, {"time_constant": 1e40}), r"of seconds up to 3\.4e\+38"),
    ],
)
def test_bad_arguments(arguments: tuple, message: str) -> None:
    architecture, observed, actions, options = arguments
    with pytest.raises(ValueError, match=message):
        make_policy(architecture, observed, actions, dt=0.1, **options)


def test_bad_step() -> None:
    with pytest.raises(ValueError, match="dt is -1"):
        make_policy("ctrnn", 4, 2, dt=-1)


def test_wrong_observation() -> None:
    with pytest.raises(ValueError, match="has 3 entries, but the policy was made for 4"):
        network("gru").step(torch.zeros(1, 3), torch.zeros(1, 2), torch.zeros(1, 2))


def test_a_parameter_that_is_not_finite_is_named() -> None:
    policy = network("gru")
    policy.check_finite()
    with torch.no_grad():
        policy.head.bias[0] = float("nan")
    with pytest.raises(FloatingPointError, match=r"parameter 'head\.bias' of the gru"):
        policy.check_finite()


@pytest.mark.parametrize(("constraint", "after"), [("clamp", 0.1), ("softplus", 0.02)])
def test_only_the_clamp_projects_time_constants_to_the_step(constraint, after):
    policy = make_policy("ctrnn", 3, 2, dt=0.1, units=2, constraint=constraint)
    with torch.no_grad():
        policy.tau_raw.copy_(torch.tensor([0.02, 0.7]))
    policy.project_()
    torch.testing.assert_close(policy.tau_raw.detach(), torch.tensor([after, 0.7]))


def test_a_net_without_limits_on_its_parameters_projects_nothing():
    policy = make_policy("dtrnn", 3, 2, dt=0.1)
    before = policy.parameter_vector()
    policy.project_()
    assert torch.equal(policy.parameter_vector(), before)
