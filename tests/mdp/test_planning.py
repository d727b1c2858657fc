import itertools

import numpy as np
import pytest
import quantecon as qe
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from tests.mdp.examples import Factored, chain, grid, random_mdp, reversed_chain
from thesis_lib.mdp import (
    TabularMDP,
    epsilon_greedy,
    evaluate,
    greedy_actions,
    policy_iteration,
    soft_policy_iteration,
    solve,
    value_iteration,
)

seeds = st.integers(0, 2**32 - 1)


def by_linear_programme(mdp):
    """V* as the smallest v with v >= R + gamma P v, found by an LP solver."""
    S = mdp.n_states
    rows = mdp.discount * mdp.transition - np.eye(S)[:, None, :]
    keep = ~mdp.terminal
    found = linprog(
        np.ones(S),
        A_ub=rows[keep].reshape(-1, S),
        b_ub=-mdp.reward[keep].reshape(-1),
        bounds=[(0, 0) if t else (None, None) for t in mdp.terminal],
    )
    assert found.success
    return found.x


class TestExact:
    @pytest.mark.parametrize("seed", range(8))
    def test_agrees_with_quantecon(self, seed):
        mdp = random_mdp(seed, n_states=9, n_actions=4, discount=0.97)
        peer = qe.markov.DiscreteDP(mdp.reward, mdp.transition, mdp.discount).solve(
            method="policy_iteration"
        )
        ours = solve(mdp)
        np.testing.assert_allclose(ours.v, peer.v, rtol=1e-9)
        np.testing.assert_array_equal(ours.greedy, peer.sigma)

    @pytest.mark.parametrize("discount", [0.9, 1.0])
    @pytest.mark.parametrize("seed", range(4))
    def test_agrees_with_a_linear_programme(self, seed, discount):
        mdp = random_mdp(seed, n_states=6, terminal=1, discount=discount)
        expected = by_linear_programme(mdp)
        np.testing.assert_allclose(solve(mdp).v, expected, rtol=1e-6, atol=1e-6)

    @settings(max_examples=40, deadline=None)
    @given(seed=seeds, discount=st.floats(0.0, 0.99), terminal=st.integers(0, 2))
    def test_bellman_residual_is_zero_at_the_optimum(self, seed, discount, terminal):
        mdp = random_mdp(seed, discount=discount, terminal=terminal)
        q = solve(mdp).q
        residual = (mdp.lookahead(q.max(axis=1)) - q)[~mdp.terminal]
        assert np.abs(residual).max() < 1e-10 * (1 + np.abs(q).max())

    def test_grid_values_are_distances(self):
        expected = [-(6 - s % 4 - s // 4) for s in range(16)]
        np.testing.assert_allclose(solve(grid(4)).v, expected, atol=1e-12)

    def test_expectations_alone_are_enough(self):
        for mdp in (random_mdp(5, n_states=30, discount=0.95), grid(5)):
            np.testing.assert_allclose(solve(Factored(mdp)).q, solve(mdp).q, atol=1e-9)
            np.testing.assert_allclose(
                soft_policy_iteration(Factored(mdp), 0.2).q,
                soft_policy_iteration(mdp, 0.2).q,
                rtol=1e-9,
                atol=1e-9,
            )

    def test_equal_actions_do_not_make_it_run_for_ever(self):
        mdp = random_mdp(1)
        flat = TabularMDP(mdp.transition, np.ones((5, 3)), mdp.start, None, 0.9)
        np.testing.assert_allclose(solve(flat).v, 10.0)
        np.testing.assert_array_equal(solve(flat).greedy, 0)

    def test_an_endless_task_cannot_be_undiscounted(self):
        with pytest.raises(ValueError, match="no policy reaches a terminal state"):
            solve(random_mdp(0, discount=1.0))

    def test_values_that_grow_without_bound_are_refused(self):
        P = np.zeros((2, 2, 2))
        P[0, 0, 0] = P[0, 1, 1] = P[1, :, 1] = 1.0
        endless_gain = TabularMDP(P, [[1.0, 0.0], [0.0, 0.0]], [1, 0], [False, True])
        with pytest.raises(ValueError, match="value is not finite"):
            solve(endless_gain)


class TestOperator:
    @settings(max_examples=40, deadline=None)
    @given(seed=seeds, discount=st.floats(0.0, 1.0))
    def test_one_synchronous_sweep_contracts_by_gamma(self, seed, discount):
        mdp = random_mdp(seed, discount=discount)
        rng = np.random.default_rng(seed)
        q1, q2 = rng.normal(size=(2, 5, 3)) * 10
        after = [mdp.lookahead(q.max(axis=1)) for q in (q1, q2)]
        assert np.abs(after[0] - after[1]).max() <= discount * np.abs(q1 - q2).max() + 1e-12

    @settings(max_examples=25, deadline=None)
    @given(seed=seeds, discount=st.floats(0.1, 0.97), scale=st.floats(0.1, 50))
    def test_theorem_1_bounds_the_sweeps(self, seed, discount, scale):
        mdp = random_mdp(seed, discount=discount)
        q_star = solve(mdp).q
        initial = q_star + scale * np.random.default_rng(seed).uniform(-1, 1, q_star.shape)
        epsilon = 1e-3
        found = value_iteration(
            mdp, synchronous=True, initial_q=initial, optimum=q_star, tolerance=epsilon
        )
        delta = np.abs(q_star - initial).max()
        enough = max(0, int(np.ceil(np.log(epsilon / delta) / np.log(discount) - 1e-9)))
        assert found.n_sweeps <= enough
        assert found.errors[-1] <= epsilon
        assert (found.errors[:-1] > epsilon).all()
        assert (found.errors <= delta * discount ** np.arange(found.n_sweeps + 1) + 1e-9).all()


class TestValueIteration:
    def test_history_on_a_chain_by_hand(self):
        # States are swept upwards, so the 8 at the end moves back one state a sweep.
        found = value_iteration(chain(4), history=True)
        np.testing.assert_array_equal(found.deltas, [8, 4, 2, 1, 0])
        assert found.n_sweeps == 5
        np.testing.assert_array_equal(
            found.values,
            [
                [0, 0, 0, 0, 0],
                [0, 0, 0, 8, 0],
                [0, 0, 4, 8, 0],
                [0, 2, 4, 8, 0],
                [1, 2, 4, 8, 0],
                [1, 2, 4, 8, 0],
            ],
        )
        np.testing.assert_array_equal(found.policy[:4], 1)

    def test_sweeps_are_in_place(self):
        # Numbered from the end, one sweep in place carries the 8 all the way.
        found = value_iteration(reversed_chain(4))
        np.testing.assert_array_equal(found.deltas, [8, 0])
        synchronous = value_iteration(reversed_chain(4), synchronous=True)
        np.testing.assert_array_equal(synchronous.deltas, [8, 4, 2, 1, 0.5, 0])

    @pytest.mark.parametrize("synchronous", [False, True])
    @pytest.mark.parametrize("seed", range(4))
    def test_converges_to_the_optimum(self, seed, synchronous):
        mdp = random_mdp(seed, terminal=seed % 2)
        found = value_iteration(mdp, tolerance=1e-12, synchronous=synchronous)
        exact = solve(mdp)
        np.testing.assert_allclose(found.q, exact.q, atol=1e-10)
        np.testing.assert_allclose(found.v, exact.v, atol=1e-10)
        np.testing.assert_array_equal(found.policy[~mdp.terminal], exact.greedy[~mdp.terminal])

    def test_starting_at_the_optimum_takes_no_sweep(self):
        mdp = random_mdp(2)
        q = solve(mdp).q
        for synchronous in (False, True):
            found = value_iteration(
                mdp, initial_q=q, optimum=q, tolerance=1e-9, synchronous=synchronous
            )
            assert found.n_sweeps == 0
            assert found.errors.shape == (1,)

    def test_in_place_starts_from_given_values(self):
        found = value_iteration(chain(4), initial_v=[1, 2, 4, 8, 7], history=True)
        np.testing.assert_array_equal(found.values, [[1, 2, 4, 8, 0]] * 2)

    @pytest.mark.parametrize(
        ("options", "words"),
        [
            ({"tolerance": 0}, "tolerance is 0, but it must be positive"),
            ({"max_sweeps": 0}, "max_sweeps is 0"),
            ({"initial_v": np.zeros(3)}, r"initial_v has shape \(3,\)"),
            ({"initial_v": np.full(5, np.nan)}, "initial_v of state 0 is nan"),
            ({"initial_q": np.zeros((5, 3))}, r"initial_q has shape \(5, 3\)"),
            ({"optimum": np.full((5, 2), np.nan)}, "optimum of pair .state 0, action 0. is nan"),
            ({"initial_v": np.zeros(5), "synchronous": True}, "initial_v is for the in-place form"),
        ],
    )
    def test_bad_arguments(self, options, words):
        with pytest.raises(ValueError, match=words):
            value_iteration(chain(4), **options)

    def test_too_few_sweeps(self):
        with pytest.raises(RuntimeError, match="not done after 3 sweeps"):
            value_iteration(chain(4), max_sweeps=3)


class TestPolicyIteration:
    def test_history_on_a_chain_by_hand(self):
        # All stay at first.  Each improvement finds one more state that gains by moving,
        # from the end backwards; the next evaluation raises it and takes a sweep to notice
        # that nothing else changes.
        found = policy_iteration(chain(4))
        np.testing.assert_array_equal(
            found.policies[:, :4],
            [[0, 0, 0, 0], [0, 0, 0, 1], [0, 0, 1, 1], [0, 1, 1, 1], [1, 1, 1, 1], [1, 1, 1, 1]],
        )
        assert found.sweeps == (1, 2, 2, 2, 2)
        assert found.n_sweeps == 9
        for deltas, expected in zip(
            found.deltas, [[0], [8, 0], [4, 0], [2, 0], [1, 0]], strict=True
        ):
            np.testing.assert_array_equal(deltas, expected)
        np.testing.assert_array_equal(found.values[2], [0, 0, 4, 8, 0])
        np.testing.assert_array_equal(found.v, [1, 2, 4, 8, 0])

    def test_evaluation_stops_below_theta(self):
        # Staying for ever at reward 1 and discount 1/2: V = 1, 1.5, 1.75, ... changes by
        # 1, 1/2, 1/4, ...; the first change below 1/4 is 1/8.
        mdp = TabularMDP([[[1.0]]], [[1.0]], [1.0], None, 0.5)
        found = policy_iteration(mdp, theta=0.25)
        np.testing.assert_array_equal(found.deltas[0], [1, 0.5, 0.25, 0.125])

    @pytest.mark.parametrize("seed", range(5))
    def test_converges_to_the_optimum(self, seed):
        mdp = random_mdp(seed, terminal=seed % 2)
        found = policy_iteration(mdp, theta=1e-12)
        np.testing.assert_allclose(found.q, solve(mdp).q, atol=1e-10)
        values = [evaluate(mdp, p).v for p in found.policies]
        for before, after in itertools.pairwise(values):
            assert (after >= before - 1e-10).all()

    def test_undiscounted_tasks_start_from_a_policy_that_ends(self):
        found = policy_iteration(grid(4))
        np.testing.assert_allclose(found.v, [-(6 - s % 4 - s // 4) for s in range(16)])

    def test_an_initial_policy_that_never_ends_is_refused(self):
        with pytest.raises(ValueError, match="never reaches a terminal state"):
            policy_iteration(grid(4), initial_policy=np.zeros(16, int))

    def test_a_soft_initial_policy_is_refused(self):
        with pytest.raises(ValueError, match="one action a state"):
            policy_iteration(grid(4), initial_policy=np.full((16, 4), 0.25))

    def test_too_few_sweeps(self):
        with pytest.raises(RuntimeError, match="not done after 4 sweeps"):
            policy_iteration(chain(4), max_sweeps=4)

    def test_equal_actions_keep_the_initial_policy(self):
        mdp = random_mdp(1)
        flat = TabularMDP(mdp.transition, np.ones((5, 3)), mdp.start, None, 0.9)
        start = np.array([2, 0, 1, 2, 1])
        found = policy_iteration(flat, initial_policy=start, theta=1e-12)
        np.testing.assert_array_equal(found.policies, [start, start])


class TestSoft:
    @pytest.mark.parametrize("exploration", ["all", "others"])
    @pytest.mark.parametrize(("discount", "terminal"), [(0.9, 0), (1.0, 1)])
    @pytest.mark.parametrize("seed", range(3))
    def test_beats_every_epsilon_greedy_policy(self, seed, discount, terminal, exploration):
        mdp = random_mdp(seed, n_states=4, discount=discount, terminal=terminal)
        epsilon, A = 0.3, 3
        found = soft_policy_iteration(mdp, epsilon, exploration=exploration)
        best = np.full(4, -np.inf)
        for preferred in itertools.product(range(A), repeat=4 - terminal):
            preferred = np.array([*preferred, *[0] * terminal])
            pi = np.full((4, A), epsilon / (A if exploration == "all" else A - 1))
            pi[np.arange(4), preferred] = 1 - epsilon * ((A - 1) / A if exploration == "all" else 1)
            best = np.maximum(best, evaluate(mdp, pi).v)
        np.testing.assert_allclose(found.v, best, atol=1e-10)

    @settings(max_examples=30, deadline=None)
    @given(seed=seeds, epsilon=st.floats(0, 1), terminal=st.integers(0, 2))
    def test_soft_bellman_equation(self, seed, epsilon, terminal):
        mdp = random_mdp(seed, terminal=terminal)
        found = soft_policy_iteration(mdp, epsilon)
        mixed = (1 - epsilon) * found.q.max(axis=1) + epsilon * found.q.mean(axis=1)
        np.testing.assert_allclose(found.v, mixed, atol=1e-10)
        going_on = ~mdp.terminal
        np.testing.assert_allclose(found.q[going_on], mdp.lookahead(mixed)[going_on], atol=1e-10)
        again = evaluate(mdp, epsilon_greedy(found.q, epsilon))
        np.testing.assert_allclose(again.q, found.q, atol=1e-9)

    def test_extremes(self):
        mdp = random_mdp(3)
        np.testing.assert_allclose(soft_policy_iteration(mdp, 0.0).q, solve(mdp).q)
        uniform = evaluate(mdp, np.full((5, 3), 1 / 3))
        np.testing.assert_allclose(soft_policy_iteration(mdp, 1.0).q, uniform.q)

    def test_one_action_is_taken_however_it_explores(self):
        # 1 / (1 - gamma) on from each state; epsilon_greedy and learn take it so as well.
        task = TabularMDP(np.eye(2)[::-1][:, None], np.ones((2, 1)), [1, 0], None, 0.9)
        found = soft_policy_iteration(task, 0.3, exploration="others")
        np.testing.assert_allclose(found.v, 10.0)
        np.testing.assert_array_equal(found.policy, 1.0)

    def test_values_fall_as_exploration_grows(self):
        mdp = random_mdp(6)
        values = [soft_policy_iteration(mdp, e).v for e in (0, 0.1, 0.3, 0.7)]
        for before, after in itertools.pairwise(values):
            assert (after <= before + 1e-12).all()

    def test_ties_end(self):
        mdp = random_mdp(1)
        flat = TabularMDP(mdp.transition, np.ones((5, 3)), mdp.start, None, 0.9)
        found = soft_policy_iteration(flat, 0.5)
        assert found.n_improvements == 0
        np.testing.assert_array_equal(found.greedy, 0)

    @pytest.mark.parametrize(
        ("epsilon", "exploration", "words"),
        [
            (1.5, "all", "epsilon is 1.5"),
            (-0.1, "all", "epsilon is -0.1"),
            (0.7, "others", "epsilon is 0.7.*at most 0.666667"),
            (0.1, "none", "exploration 'none' does not exist"),
        ],
    )
    def test_bad_arguments(self, epsilon, exploration, words):
        with pytest.raises(ValueError, match=words):
            soft_policy_iteration(random_mdp(0), epsilon, exploration=exploration)


class TestShaping:
    @settings(max_examples=30, deadline=None)
    @given(seed=seeds, scale=st.floats(0.1, 100), terminal=st.integers(0, 2))
    def test_a_potential_over_states_keeps_the_optimal_policy(self, seed, scale, terminal):
        """Ng et al.'s theorem, which section 3.1 quotes: F = gamma Phi(s') - Phi(s)."""
        mdp = random_mdp(seed, terminal=terminal, discount=1.0 if terminal else 0.9)
        phi = np.where(mdp.terminal, 0, scale * np.random.default_rng(seed).normal(size=5))
        shaping = mdp.discount * mdp.expectation(phi) - phi[:, None]
        reward = np.where(mdp.terminal[:, None], 0, mdp.reward + shaping)
        shaped = TabularMDP(mdp.transition, reward, mdp.start, mdp.terminal, mdp.discount)
        plain, changed = solve(mdp), solve(shaped)
        going_on = ~mdp.terminal
        size = 1 + np.abs(plain.q).max() + scale
        np.testing.assert_allclose(
            changed.q[going_on], (plain.q - phi[:, None])[going_on], rtol=0, atol=1e-9 * size
        )
        np.testing.assert_array_equal(
            greedy_actions(changed.q, tie=1e-7)[going_on],
            greedy_actions(plain.q, tie=1e-7)[going_on],
        )

    @settings(max_examples=20, deadline=None)
    @given(seed=seeds)
    def test_a_shaping_reward_that_is_no_potential_can_change_it(self, seed):
        """The control: the same size of reward for visiting states, without the difference."""
        P = np.zeros((2, 2, 2))
        P[0, 0, 0] = P[0, 1, 1] = P[1, :, 1] = 1.0
        bonus = np.random.default_rng(seed).uniform(2, 5)
        mdp = TabularMDP(P, [[-1.0, 0.0], [0.0, 0.0]], [1, 0], [False, True], 0.9)
        bribed = TabularMDP(P, [[-1.0 + bonus, 0.0], [0.0, 0.0]], [1, 0], [False, True], 0.9)
        assert solve(mdp).greedy[0] == 1
        assert solve(bribed).greedy[0] == 0
