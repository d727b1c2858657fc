"""Q-learning on an abstract table."""

import numpy as np
import pytest

from thesis_lib.domains import stock, triangle
from thesis_lib.mdp import TabularMDP, learn, solve
from thesis_lib.mdp.aggregated import learn_aggregated


@pytest.mark.parametrize("make", [triangle, lambda: stock(1, 2, 1)], ids=["triangle", "stock"])
def test_cells_of_one_state_give_plain_q_learning_to_the_last_bit(make):
    task = make().tasks[1]
    phi = np.random.default_rng(0).normal(size=(task.n_states, task.n_actions))
    ours = learn_aggregated(
        task,
        np.arange(task.n_states),
        alpha=0.3,
        epsilon=0.1,
        steps=1000,
        every=100,
        rng=5,
        potential=phi,
    )
    plain = learn(
        task,
        "q_learning",
        alpha=0.3,
        epsilon=0.1,
        steps=1000,
        checkpoint_every=100,
        rng=5,
        potential=phi,
    )
    live = ~task.terminal
    assert np.array_equal(ours.q[live], plain.q[live])
    assert ours.total_reward == pytest.approx(plain.total_reward, rel=1e-12)
    np.testing.assert_allclose(np.cumsum(ours.rewards), plain.checkpoint_rewards, rtol=1e-12)


def test_on_an_exact_abstraction_it_finds_the_optimal_values():
    # Ownership is irrelevant on stock with one sector: the two halves of the states are alike.
    task = stock(1, 2, 1).tasks[2]
    labels = np.arange(task.n_states) % (task.n_states // 2)
    found = learn_aggregated(
        task, labels, alpha=0.005, epsilon=0.5, steps=400_000, every=1000, rng=0
    )
    exact = solve(task).q
    np.testing.assert_allclose(exact[: len(found.q)], exact[len(found.q) :], atol=1e-9)
    assert np.abs(found.q - exact[: len(found.q)]).max() < 0.5


def test_merged_states_share_one_value_by_hand():
    # Two states, one action: 0 earns 1 and leads to 1, which earns 3 and leads to 0.
    # One value v for both, discount 0, rate 1/2: v goes 0, .5, 1.75, 1.375, 2.1875.
    task = TabularMDP(
        np.array([[[0.0, 1.0]], [[1.0, 0.0]]]),
        np.array([[1.0], [3.0]]),
        np.array([1.0, 0.0]),
        discount=0.0,
    )
    found = learn_aggregated(task, [0, 0], alpha=0.5, epsilon=0.1, steps=4, every=2, rng=0)
    assert found.q.tolist() == [[2.1875]]
    assert found.rewards.tolist() == [4.0, 4.0]
    assert found.total_reward == 8.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"labels": [0, 1]}, "one cell number"),
        ({"labels": [-1, 0, 0, 0]}, "at least 0"),
        ({"alpha": 0.0}, "alpha is 0"),
        ({"epsilon": 2.0}, "epsilon is 2"),
        ({"steps": 0}, "steps"),
        ({"every": 0}, "every"),
        ({"potential": np.zeros((2, 2))}, "potential has shape"),
    ],
)
def test_bad_arguments_are_refused(change, message):
    task = triangle().tasks[0]
    given = {
        "labels": np.arange(task.n_states),
        "alpha": 0.5,
        "epsilon": 0.1,
        "steps": 5,
        "every": 1,
        "rng": 0,
        **change,
    }
    with pytest.raises(ValueError, match=message):
        learn_aggregated(task, given.pop("labels"), **given)
