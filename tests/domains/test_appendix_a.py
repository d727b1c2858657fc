"""Facts 1 and 2 of appendix A: closed forms by hand, and every statement made in the text."""

import numpy as np
import pytest

from thesis_lib.domains.appendix_a import (
    figure_a1,
    figure_a2,
    figure_a3,
    policy,
    state_values,
)
from thesis_lib.domains.domain import Domain
from thesis_lib.mdp.model import TabularMDP


def values(domain, p_b, weighting="uniform"):
    return state_values(domain, policy(domain, p_b), weighting).domain


@pytest.mark.parametrize("gamma", [0.1, 0.5, 0.9, 0.99])
@pytest.mark.parametrize("penalty", [0.5, 10.0])
def test_fact_1_in_closed_form(gamma, penalty):
    domain = figure_a1(penalty, gamma)
    always_a, always_b, coin = (values(domain, p)[0] for p in (0.0, 1.0, 0.5))
    # V(1) = -R/2(1 - gamma) when deterministic, -R/(2 - gamma) when a fair coin decides.
    assert always_a == pytest.approx(-penalty / (2 - 2 * gamma))
    assert always_b == pytest.approx(always_a)
    assert coin == pytest.approx(-penalty / (2 - gamma))
    assert coin > always_a


def test_fact_1_is_arbitrarily_better():
    # The ratio of the two costs, (2 - gamma)/(2 - 2 gamma), grows without bound as gamma -> 1.
    ratio = [
        values(figure_a1(1, g), 0.0)[0] / values(figure_a1(1, g), 0.5)[0] for g in (0.9, 0.999)
    ]
    assert ratio == pytest.approx([1.1 / 0.2, 1.001 / 0.002])


def test_fact_2a_in_closed_form():
    # Task 1 earns -bx every third step from state 1, task 2a +bx every other step; uniform
    # p(s|m) is 1/3 and 1/2, so d(m|s) = .4 and .6 in states 1 and 2.
    g, b = 0.9, 0.7
    got = values(figure_a2("a", 2.0, g), b)
    one, two = -2 * b / (1 - g**3), 2 * b / (1 - g**2)
    expected = [0.4 * one + 0.6 * two, 0.4 * g**2 * one + 0.6 * g * two, g * one]
    np.testing.assert_allclose(got, expected)


def test_fact_2b_in_closed_form():
    g, b = 0.8, 0.3
    one, two = -b / (1 - g**3), b / (1 - g**2)
    got = values(figure_a2("b", 1.0, g), b)
    np.testing.assert_allclose(got, [(one + two) / 2, (g**2 * one + g * two) / 2, g * one / 2])


@pytest.mark.parametrize("second", ["a", "b", "c"])
@pytest.mark.parametrize("gamma", [0.5, 0.9, 0.95])
def test_fact_2_cases_1_to_3_b_helps_state_1_and_harms_state_3(second, gamma):
    domain = figure_a2(second, discount=gamma)
    curve = np.array([values(domain, p) for p in np.linspace(0, 1, 11)])
    assert (np.diff(curve[:, 0]) > 0).all()
    assert (np.diff(curve[:, 2]) < 0).all()


def test_the_uniform_weighting_is_what_case_3_needs():
    # Both tasks of A.2d are ergodic for every policy; d(m|s) there is 1/2 everywhere.
    domain = figure_a2("c")
    weight = state_values(domain, policy(domain, 0.4)).weight
    assert (weight == 0.5).all()
    for task in domain.tasks:
        power = np.linalg.matrix_power(task.transition[:, 0], 50)
        assert (power @ np.ones(3) > 0.999).all()
        assert ((power + task.transition[:, 0] @ power + power @ power) > 0).all()


def test_case_2_cuts_state_3_off_in_task_2b():
    domain = figure_a2("b")
    occupied = state_values(domain, policy(domain, 0.5), "occupancy")
    assert occupied.weight[:, 2].tolist() == [1, 0]
    assert occupied.domain[2] == pytest.approx(occupied.task[0, 2])


def fork(p):
    """From state 0 to 1 with probability p, else to 2; there the task stays."""
    transition = np.array([[[0, p, 1 - p]] * 2, [[0, 1, 0]] * 2, [[0, 0, 1]] * 2])
    return TabularMDP(transition, np.zeros((3, 2)), [1, 0, 0], discount=0.5, actions=("A", "B"))


def test_occupancy_of_two_closed_sets_is_how_often_each_is_entered():
    domain = Domain("forks", (fork(0.3), fork(0.6)))
    weight = state_values(domain, np.full((3, 2), 0.5), "occupancy").weight
    np.testing.assert_allclose(weight[:, 1:], [[1 / 3, 7 / 11], [2 / 3, 4 / 11]])
    assert np.isnan(weight[:, 0]).all()


@pytest.mark.parametrize(
    ("mu", "told"),
    [
        ([[5.0, 7.0]] * 4, r"mu of observation 0 is \[5. 7.\], but the probabilities of its"),
        ([[0.5, 0.5]] * 3 + [[1.5, -0.5]], r"mu of observation 3 is \[ 1.5 -0.5\], but"),
        (np.full((2, 4), 0.5), r"mu has shape \(2, 4\), but domain .* = \(..., 4, 2\)"),
        (np.full((3, 4, 2), 0.5), r"mu has shape \(3, 4, 2\), but one policy is needed"),
    ],
)
def test_what_is_no_policy(mu, told):
    with pytest.raises(ValueError, match=told):
        state_values(figure_a3(), mu)


class TestFigureA3:
    grid = np.linspace(0, 1, 101)

    def curve(self):
        domain = figure_a3()
        return [state_values(domain, policy(domain, p), "occupancy") for p in self.grid]

    def test_values_are_flat_at_zero_for_a(self):
        np.testing.assert_allclose(self.curve()[0].domain, 0, atol=1e-12)

    def test_b_lowers_all_values_but_that_of_state_4(self):
        v = np.array([c.domain for c in self.curve()])
        assert (np.diff(v[:21], axis=0)[:, :3] < 0).all()
        assert (np.diff(v[:, 0]) < 0).all()
        assert (np.diff(v[:, 3]) > 0).all()

    def test_state_3_keeps_decreasing(self):
        v = np.array([c.domain for c in self.curve()])
        assert (np.diff(v[:, 2]) < 0).all()

    def test_state_2_turns_positive_around_095(self):
        v = np.array([c.domain for c in self.curve()])[:, 1]
        crossing = self.grid[np.flatnonzero(v > 0)[0]]
        assert 0.94 <= crossing <= 0.97
        assert (v[1:94] < 0).all()
        assert (v[97:] > 0).all()

    def test_weights_are_as_the_proof_says(self):
        w = np.array([c.weight for c in self.curve()])
        assert (w[:, 1, 3] > 10 * w[:, 0, 3]).all()  # d(m2|s4) >> d(m1|s4)
        assert (w[:, 0, 0] > 5 * w[:, 1, 0]).all()  # d(m1|s1) >> d(m2|s1)
        assert (np.diff(w[:, 0, 1]) < 0).all()  # d(m1|s2) goes to 0
        assert w[-1, 0, 1] == pytest.approx(0, abs=1e-12)

    def test_in_task_2_state_4_rises_because_state_1_does(self):
        task_2 = np.array([c.task[1] for c in self.curve()])
        assert (np.diff(task_2[:, 0]) > 0).all()
        np.testing.assert_allclose(
            task_2[:, 3], 0.9 * 0.05 * task_2[:, 0] / (1 - 0.9 * 0.95), rtol=1e-12
        )

    def test_no_policy_is_best_in_every_state(self):
        v = np.array([c.domain for c in self.curve()])
        assert v[:, 0].argmax() == 0
        assert v[:, 3].argmax() == 100

    def test_occupancy_is_where_the_chain_settles(self):
        domain = figure_a3()
        mu = policy(domain, 0.6)
        chains = [np.einsum("sa,sat->st", mu, task.transition) for task in domain.tasks]
        share = np.array([np.linalg.matrix_power(chain, 4096)[0] for chain in chains])
        got = state_values(domain, mu, "occupancy").weight
        np.testing.assert_allclose(got, share / share.sum(axis=0), atol=1e-9)


def test_bad_input_is_one_sentence():
    domain = figure_a1()
    with pytest.raises(ValueError, match="terminal states, and so no stationary distribution"):
        state_values(domain, policy(domain, 0.5), "occupancy")
    with pytest.raises(ValueError, match="weighting 'even' does not exist"):
        state_values(domain, policy(domain, 0.5), "even")
    with pytest.raises(ValueError, match=r"weighting has shape \(2,\)"):
        state_values(domain, policy(domain, 0.5), [0.5, 0.5])
    with pytest.raises(ValueError, match="mu has shape"):
        state_values(domain, [[0.5, 0.5]] * 2)
    with pytest.raises(ValueError, match=r"p_b is 1\.2"):
        policy(domain, 1.2)
    with pytest.raises(ValueError, match=r"discount is 1\.0"):
        figure_a2(discount=1.0)
    with pytest.raises(ValueError, match="second 'd' does not exist"):
        figure_a2("d")
    with pytest.raises(ValueError, match="penalty is 0"):
        figure_a1(0)
