import copy
import pickle

import numpy as np
import pytest

from tests.mdp.examples import chain, random_mdp
from thesis_lib.mdp import TabularMDP


def parts(**changes):
    """The arguments of a legal task of two states and two actions, the second terminal."""
    P = np.zeros((2, 2, 2))
    P[0, 0] = 0.5, 0.5
    P[0, 1] = P[1, :] = 0.0, 1.0
    return {
        "transition": P,
        "reward": np.array([[1.0, 2.0], [0.0, 0.0]]),
        "start": np.array([1.0, 0.0]),
        "terminal": np.array([False, True]),
        "discount": 0.9,
        **changes,
    }


def changed(array, index, value):
    array = array.copy()
    array[index] = value
    return array


def test_defaults():
    mdp = TabularMDP(**parts())
    assert (mdp.n_states, mdp.n_actions) == (2, 2)
    assert mdp.actions == ("0", "1")
    assert list(mdp.features) == ["state"]
    np.testing.assert_array_equal(mdp.features["state"], [0, 1])


P = parts()["transition"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"transition": changed(P, (0, 0, 0), 0.4)}, r"\[state 0, action 0\] sums to 0.9"),
        ({"transition": changed(P, (0, 1), [-0.5, 1.5])}, r"\[state 0, action 1\].*negative"),
        ({"transition": changed(P, (0, 1, 0), np.nan)}, r"\[state 0, action 1\].*not finite"),
        ({"transition": P[0]}, r"shape \(2, 2\).*\(S, A, S\)"),
        ({"reward": np.zeros((2, 3))}, r"reward has shape \(2, 3\).*\(2, 2\)"),
        ({"reward": changed(np.zeros((2, 2)), (0, 1), np.inf)}, r"\[state 0, action 1\] is inf"),
        ({"reward": np.ones((2, 2))}, "terminal state 1 is not absorbing"),
        ({"terminal": [True, True]}, "terminal state 0 is not absorbing"),
        ({"start": [0.5, 0.4]}, r"\[start\] sums to 0.9"),
        ({"discount": 1.5}, r"discount is 1.5.*\[0, 1\]"),
        ({"discount": float("nan")}, "discount is nan"),
        ({"actions": ("a",)}, r"actions has shape \(1,\)"),
        ({"features": {"x": [0, 1, 2]}}, r"feature 'x' has shape \(3,\)"),
        ({"features": {"x": [0.5, 1.5]}}, "feature 'x' has values of type float64"),
        ({"transition_reward": np.ones((2, 2, 2))}, r"\[state 0, action 1\] has expectation 1"),
        ({"transition_reward": np.ones((2, 2))}, r"transition_reward has shape \(2, 2\)"),
    ],
)
def test_bad_parts_are_named(change, words):
    with pytest.raises(ValueError, match=words):
        TabularMDP(**parts(**change))


def test_arrays_are_copied_and_read_only():
    given = parts()
    mdp = TabularMDP(**given)
    given["transition"][0, 0] = 1.0, 0.0
    np.testing.assert_array_equal(mdp.transition[0, 0], [0.5, 0.5])
    with pytest.raises(ValueError, match="read-only"):
        mdp.reward[0, 0] = 3.0


def test_lookahead_is_equation_2_6():
    mdp = TabularMDP(**parts())
    # R + .9 * sum P v with v = (10, 20): 1 + .9 * 15 and 2 + .9 * 20; 0 + .9 * 20 in state 1.
    expected = [[14.5, 20.0], [18.0, 18.0]]
    np.testing.assert_allclose(mdp.lookahead(np.array([10.0, 20.0])), expected)


def test_outcomes_list_the_possible_successors_first():
    listed = TabularMDP(**parts()).outcomes()
    assert listed.successor.shape == (2, 2, 2)
    np.testing.assert_array_equal(listed.successor[0, 0], [0, 1])
    np.testing.assert_array_equal(listed.probability[0], [[0.5, 0.5], [1.0, 0.0]])
    assert listed.successor[0, 1, 0] == 1
    np.testing.assert_array_equal(listed.reward[0], [[1.0, 1.0], [2.0, 2.0]])


def test_outcomes_carry_the_reward_of_the_transition():
    reward = np.zeros((2, 2, 2))
    reward[0, 0] = -1.0, 3.0
    reward[0, 1, 1] = 2.0
    listed = TabularMDP(**parts(transition_reward=reward)).outcomes()
    np.testing.assert_array_equal(listed.reward[0, 0], [-1.0, 3.0])


def test_outcomes_rebuild_the_transition_matrix():
    mdp = random_mdp(3, terminal=2)
    listed = mdp.outcomes()
    rebuilt = np.zeros_like(mdp.transition)
    s, a, k = np.indices(listed.successor.shape)
    np.add.at(rebuilt, (s, a, listed.successor[s, a, k]), listed.probability)
    np.testing.assert_array_equal(rebuilt, mdp.transition)


def test_deterministic_task_has_one_outcome_a_pair():
    assert chain().outcomes().successor.shape == (5, 2, 1)


@pytest.mark.parametrize("clone", [copy.deepcopy, lambda m: pickle.loads(pickle.dumps(m))])
def test_copies_are_equal_and_read_only(clone):
    mdp = random_mdp(3, terminal=1)
    mdp.outcomes()
    other = clone(mdp)
    for name in ("transition", "reward", "start", "terminal"):
        np.testing.assert_array_equal(getattr(other, name), getattr(mdp, name))
        assert not getattr(other, name).flags.writeable
    assert list(other.features) == ["state"]
    np.testing.assert_array_equal(other.outcomes().successor, mdp.outcomes().successor)
    with pytest.raises(TypeError):
        other.features["state"] = np.zeros(5)
