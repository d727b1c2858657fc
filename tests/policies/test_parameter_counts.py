"""Trainable parameters of every net on every task, as counted from the author's code."""

import pytest

from thesis_lib.policies import make_policy

NETS = ("dtrnn", "ctrnn", "lstm", "gru", "esn", "ffwd", "dffwd")
FULL = {  # (observations, actions), then the counts in the order of NETS
    "Swimmer": (20, 2, (196, 202, 208, 158, 412, 142, 8479)),
    "Hopper": (20, 3, (339, 348, 339, 258, 870, 222, 8506)),
    "HalfCheetah": (20, 6, (948, 966, 840, 642, 3540, 498, 8587)),
    "Walker2d": (21, 6, (966, 984, 864, 660, 3666, 516, 8687)),
    "Ant": (125, 8, (4024, 4048, 4624, 3488, None, 3232, 19141)),
}
SUBSETS = {  # number of features seen
    ("Swimmer", 5): (106, 112, 88, 68, 142),
    ("Swimmer", 3): (94, 100, 72, 56, 106),
    ("Hopper", 11): (258, 267, 231, 177, 546),
    ("Hopper", 17): (312, 321, 303, 231, 762),
}
RESERVOIRS = {
    ("Swimmer", 20): 136,
    ("Hopper", 20): 216,
    ("HalfCheetah", 20): 504,
    ("Walker2d", 21): 522,
    ("Swimmer", 5): 46,
    ("Swimmer", 3): 34,
    ("Hopper", 11): 135,
    ("Hopper", 17): 189,
}


def options(net: str) -> dict[str, bool]:
    # The author learned the reservoir's initial state too; ours is fixed unless asked.
    return {"trainable_initial_state": True} if net == "esn" else {}


@pytest.mark.parametrize("task", FULL)
def test_full_observations(task: str) -> None:
    observed, actions, counts = FULL[task]
    for net, count in zip(NETS, counts, strict=True):
        if count is not None:
            policy = make_policy(net, observed, actions, dt=0.02, **options(net))
            assert policy.n_trainable == count, net


@pytest.mark.parametrize(("task", "n_features"), SUBSETS)
def test_feature_subsets(task: str, n_features: int) -> None:
    observed, actions, _ = FULL[task]
    for net, count in zip(NETS[:5], SUBSETS[task, n_features], strict=True):
        policy = make_policy(
            net, observed, actions, dt=0.02, features=range(n_features), **options(net)
        )
        assert policy.n_trainable == count, net


@pytest.mark.parametrize(("task", "n_features"), RESERVOIRS)
def test_reservoirs(task: str, n_features: int) -> None:
    observed, actions, _ = FULL[task]
    policy = make_policy("esn", observed, actions, dt=0.02, features=range(n_features))
    n_units = RESERVOIRS[task, n_features]
    assert policy.hidden_size == n_units
    # readout, its bias and the standard deviations; the initial state is fixed
    assert policy.n_trainable == n_units * actions + 2 * actions


def test_the_reservoir_of_the_ant() -> None:
    # 3 dim(o) dim(a) + 4 dim(a)^2 = 3256 units; 29,320 learned numbers with the initial state
    policy = make_policy("esn", 125, 8, dt=0.02, spectral_radius=1.5, density=0.7)
    assert policy.hidden_size == 3256
    assert policy.n_trainable + 3256 == 29320
