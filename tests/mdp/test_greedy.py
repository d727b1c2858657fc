import numpy as np
import pytest

from thesis_lib.mdp import epsilon_greedy, greedy_actions, tie_tolerance

Q = np.array([[1.0, 3.0, 3.0, 0.0], [5.0, 1.0, 2.0, 3.0], [2.0, 2.0, 2.0, 2.0]])


def test_all_actions_may_be_the_random_one():
    expected = [[0.1, 0.4, 0.4, 0.1], [0.7, 0.1, 0.1, 0.1], [0.25] * 4]
    np.testing.assert_allclose(epsilon_greedy(Q, 0.4), expected)


def test_only_the_others_may_be_the_random_one():
    expected = [[0.2, 0.3, 0.3, 0.2], [0.6, 0.4 / 3, 0.4 / 3, 0.4 / 3], [0.25] * 4]
    np.testing.assert_allclose(epsilon_greedy(Q, 0.4, exploration="others"), expected)


def test_extremes():
    np.testing.assert_allclose(epsilon_greedy(Q, 1.0), np.full((3, 4), 0.25))
    np.testing.assert_allclose(epsilon_greedy(Q, 0.0)[:2], [[0, 0.5, 0.5, 0], [1, 0, 0, 0]])


def test_a_tie_is_relative_to_the_magnitude_of_the_table():
    near = np.array([[1000.0, 1000.0 + 1e-8, 999.0]])
    np.testing.assert_array_equal(greedy_actions(near), [[True, True, False]])
    np.testing.assert_array_equal(greedy_actions(near * 1e-9), [[True, True, False]])
    np.testing.assert_array_equal(greedy_actions(near - 1000), [[False, True, False]])
    np.testing.assert_array_equal(greedy_actions(near, tie=0.0), [[False, True, False]])


def test_the_scale_of_ties_leaves_infinite_values_out():
    assert tie_tolerance([1.0, -np.inf], [[-200.0, np.nan]]) == pytest.approx(2e-8)


@pytest.mark.parametrize("epsilon", [-0.1, 1.1, float("nan")])
def test_epsilon_must_be_a_probability(epsilon):
    with pytest.raises(ValueError, match=r"epsilon is .* must be in \[0, 1\]"):
        epsilon_greedy(Q, epsilon)


def test_unknown_exploration():
    with pytest.raises(
        ValueError, match="exploration 'some' does not exist: choose one of all, others"
    ):
        epsilon_greedy(Q, 0.1, exploration="some")
