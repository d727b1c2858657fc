import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.mdp.examples import chain, grid, random_mdp, simulate, two_rooms
from thesis_lib.mdp import TabularMDP, average_reward, stationary_distribution
from thesis_lib.mdp.model import MDP
from thesis_lib.mdp.occupancy import transition_matrix

seeds = st.integers(0, 2**32 - 1)


def random_policy(mdp, seed):
    return np.random.default_rng(seed).dirichlet(np.ones(mdp.n_actions), size=mdp.n_states)


def one_action(P, start, terminal=None, discount=0.9):
    P = np.asarray(P, dtype=float)[:, None, :]
    return TabularMDP(P, np.zeros(P.shape[:2]), start, terminal, discount)


class TestStationary:
    def test_two_states_by_hand(self):
        mdp = one_action([[0.9, 0.1], [0.3, 0.7]], [1, 0])
        np.testing.assert_allclose(stationary_distribution(mdp, [0, 0]), [0.75, 0.25])

    def test_a_cycle_is_uniform_although_periodic(self):
        mdp = one_action([[0, 1, 0], [0, 0, 1], [1, 0, 0]], [1, 0, 0])
        np.testing.assert_allclose(stationary_distribution(mdp, [0, 0, 0]), [1 / 3] * 3)

    def test_several_closed_sets_count_by_the_chance_to_enter_them(self):
        found = stationary_distribution(two_rooms(), [0, 0, 0, 0])
        np.testing.assert_allclose(found, [0, 0.25, 0.375, 0.375], atol=1e-15)
        # .25 of the time at reward 1, and .375 of it at reward 2.
        assert average_reward(two_rooms(), [0, 0, 0, 0]) == pytest.approx(1.0)

    def test_an_episode_is_restarted_at_its_end(self):
        # Moving on visits each state of the chain once; staying with 1/2 in state 1 twice.
        np.testing.assert_allclose(
            stationary_distribution(chain(4), [1, 1, 1, 1, 0]), [0.25] * 4 + [0]
        )
        pi = np.tile([0.0, 1.0], (5, 1))
        pi[1] = 0.5, 0.5
        np.testing.assert_allclose(
            stationary_distribution(chain(4), pi), [0.2, 0.4, 0.2, 0.2, 0], atol=1e-15
        )

    def test_a_policy_that_gets_stuck_stays_where_it_is_stuck(self):
        np.testing.assert_allclose(
            stationary_distribution(chain(4), [1, 1, 0, 1, 0]), [0, 0, 1, 0, 0], atol=1e-15
        )

    @settings(max_examples=30, deadline=None)
    @given(seed=seeds)
    def test_is_invariant(self, seed):
        mdp = random_mdp(seed)
        pi = random_policy(mdp, seed)
        p = stationary_distribution(mdp, pi)
        np.testing.assert_allclose(p @ transition_matrix(mdp, pi), p, atol=1e-12)
        assert p.sum() == pytest.approx(1.0)

    @settings(max_examples=20, deadline=None)
    @given(seed=seeds)
    def test_of_an_episodic_task_is_its_normalised_visits(self, seed):
        mdp = random_mdp(seed, terminal=1, discount=1.0)
        pi = random_policy(mdp, seed)
        # Expected visits: those of the start, and of wherever a visited state leads.
        P = transition_matrix(mdp, pi) * ~mdp.terminal
        visits = np.linalg.solve(np.eye(mdp.n_states) - P.T, mdp.start)
        np.testing.assert_allclose(
            stationary_distribution(mdp, pi), visits / visits.sum(), atol=1e-10
        )

    def test_agrees_with_simulated_visits(self):
        mdp = grid(3)
        pi = random_policy(mdp, 0)
        _, visits = simulate(mdp, pi, 20_000, seed=1)
        share = visits / visits.sum()
        np.testing.assert_allclose(share, stationary_distribution(mdp, pi)[:, None] * pi, atol=0.01)

    def test_start_must_not_be_terminal(self):
        mdp = chain(4)
        ended = TabularMDP(mdp.transition, mdp.reward, np.eye(5)[4], mdp.terminal, 0.5)
        with pytest.raises(ValueError, match="start gives terminal state 4"):
            stationary_distribution(ended, [1, 1, 1, 1, 0])


class Listed(MDP):
    """A task without a matrix whose outcomes are listed, as a stock task is."""

    def __init__(self, mdp):
        self._inner = mdp
        for name in ("reward", "start", "terminal", "discount", "actions", "features"):
            setattr(self, name, getattr(mdp, name))

    def expectation(self, values):
        return self._inner.expectation(values)

    def outcomes(self):
        return self._inner.outcomes()


def test_transition_matrix_from_the_list_of_outcomes():
    mdp = random_mdp(7, terminal=1)
    pi = random_policy(mdp, 7)
    np.testing.assert_allclose(
        transition_matrix(Listed(mdp), pi), transition_matrix(mdp, pi), atol=1e-15
    )
