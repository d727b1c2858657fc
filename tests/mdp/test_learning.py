import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.mdp import reference
from tests.mdp.examples import chain, grid, random_mdp
from thesis_lib.mdp import (
    TabularMDP,
    epsilon_greedy,
    evaluate,
    learn,
    learning,
    soft_policy_iteration,
    solve,
    tie_tolerance,
)
from thesis_lib.mdp.learning import METHODS
from thesis_lib.mdp.sampling import cumulative, draw

ALPHA, EPSILON = 0.3, 0.2


def episodic(seed):
    return random_mdp(seed, n_states=6, n_actions=3, terminal=1)


@pytest.mark.parametrize("exploration", ["all", "others"])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("mdp", [episodic(1), grid(3), chain(4)], ids=["random", "grid", "chain"])
def test_equals_the_plain_python_algorithm_bit_for_bit(mdp, method, exploration):
    learned = learn(
        mdp, method, alpha=ALPHA, epsilon=EPSILON, episodes=40, rng=7, exploration=exploration
    )
    world = reference.World(
        mdp,
        EPSILON,
        tie_tolerance(mdp.outcomes().reward),
        np.random.default_rng(7),
        exploration == "others",
    )
    expected = getattr(reference, method)(world, ALPHA, 40)
    if method == "expected_sarsa":  # its mean is added up in another order
        np.testing.assert_allclose(learned.q, expected, rtol=1e-12, atol=1e-12)
    else:
        np.testing.assert_array_equal(learned.q, expected)


@pytest.mark.parametrize("method", METHODS)
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), scale=st.sampled_from([0.1, 1.0, 100.0]))
def test_shaping_equals_initialisation(method, seed, scale):
    mdp = episodic(seed) if seed % 2 else grid(3, discount=0.95)
    phi = scale * np.random.default_rng(seed).normal(size=(mdp.n_states, mdp.n_actions))
    options = {"alpha": 0.4, "epsilon": 0.1, "steps": 400, "rng": seed, "record": ["actions"]}
    shaped = learn(mdp, method, potential=phi, **options)
    initialised = learn(mdp, method, initial_q=phi, **options)
    np.testing.assert_array_equal(shaped.actions, initialised.actions)
    going_on = ~mdp.terminal
    np.testing.assert_allclose(
        (shaped.q + phi)[going_on], initialised.q[going_on], rtol=0, atol=1e-9 * scale
    )


def test_shaping_counts_the_same_rewards_and_errors():
    mdp = episodic(3)
    phi = np.random.default_rng(0).normal(size=(6, 3))
    options = {"alpha": 0.4, "epsilon": 0.1, "episodes": 30, "rng": 1, "record": ["td_errors"]}
    shaped = learn(mdp, potential=phi, **options)
    initialised = learn(mdp, initial_q=phi, **options)
    assert shaped.total_reward == initialised.total_reward
    np.testing.assert_array_equal(shaped.episode_returns, initialised.episode_returns)
    np.testing.assert_allclose(shaped.td_errors, initialised.td_errors, atol=1e-12)


def test_advice_without_action_bias_would_not_be_equivalent():
    """Why the behaviour must be biased by the potential: at first Q alone knows nothing."""
    phi = np.tile([0.0, 5.0], (5, 1))
    advised = learn(
        chain(4), alpha=0.5, epsilon=0.0, episodes=1, rng=0, potential=phi, record=["actions"]
    )
    np.testing.assert_array_equal(advised.actions, [1, 1, 1, 1])


def test_terminal_rows_of_tables_are_not_read():
    phi = np.ones((5, 2))
    phi[4] = np.nan
    options = {"alpha": 0.5, "epsilon": 0.1, "episodes": 5, "rng": 0}
    shaped = learn(chain(4), potential=phi, **options)
    initialised = learn(chain(4), initial_q=phi, **options)
    assert (shaped.q[4] == 0).all()
    assert (initialised.q[4] == 0).all()
    np.testing.assert_allclose((shaped.q + phi)[:4], initialised.q[:4], atol=1e-12)


class TestConvergence:
    def test_q_learning_finds_the_optimum_of_the_chain(self):
        # With alpha 1 and halves for a discount, floating point is exact.
        learned = learn(chain(4), "q_learning", alpha=1.0, epsilon=0.5, episodes=200, rng=0)
        np.testing.assert_array_equal(learned.q[:4], [[0.5, 1], [1, 2], [2, 4], [4, 8]])

    def test_sarsa_finds_the_soft_optimum_of_the_chain(self):
        # V(3) = .9 * 8 + .1 * Q(3, stay), Q(3, stay) = V(3) / 2: V(3) = 7.2 / .95.
        v = 7.2 / 0.95
        expected = [[v / 2, 8.0]]
        for _ in range(3):
            move = v / 2
            v = 0.9 * move / 0.95
            expected.insert(0, [v / 2, move])
        learned = learn(
            chain(4),
            "sarsa",
            alpha=lambda k: (1 + k / 50) ** -0.8,
            epsilon=0.2,
            episodes=300_000,
            rng=0,
        )
        np.testing.assert_allclose(learned.q[:4], expected, rtol=0.02)
        soft = soft_policy_iteration(chain(4), 0.2)
        np.testing.assert_allclose(soft.q[:4], expected, rtol=1e-12)

    def test_expected_sarsa_finds_it_without_noise(self):
        learned = learn(chain(4), "expected_sarsa", alpha=1.0, epsilon=0.2, episodes=2000, rng=0)
        np.testing.assert_allclose(learned.q, soft_policy_iteration(chain(4), 0.2).q, rtol=1e-12)

    @pytest.mark.parametrize("method", METHODS)
    def test_stochastic_task(self, method):
        mdp = random_mdp(0, discount=0.8)
        learned = learn(
            mdp, method, alpha=lambda t: (1 + t / 1000) ** -0.8, epsilon=0.3, steps=3_000_000, rng=1
        )
        off_policy = method in ("q_learning", "double_q_learning")
        exact = solve(mdp).q if off_policy else soft_policy_iteration(mdp, 0.3).q
        np.testing.assert_allclose(learned.q, exact, atol=0.03 * np.abs(exact).max())

    def test_rewards_of_outcomes_are_sampled(self):
        P = np.zeros((2, 1, 2))
        P[0, 0] = 0.75, 0.25
        P[1, 0, 1] = 1.0
        reward = np.zeros((2, 1, 2))
        reward[0, 0] = 4.0, -8.0
        mdp = TabularMDP(P, [[1.0], [0.0]], [1, 0], [False, True], 0.0, transition_reward=reward)
        learned = learn(
            mdp, alpha=0.001, epsilon=0.0, episodes=20_000, rng=0, record=["rewards", "states"]
        )
        assert set(learned.rewards) == {4.0, -8.0}
        # The last step of every episode, and no other, leads to the end.
        assert (learned.rewards == -8.0).sum() == 20_000
        assert learned.q[0, 0] == pytest.approx(1.0, abs=0.5)

    def test_maximisation_bias_of_q_learning_and_not_of_double_q_learning(self):
        # State 1 has 10 actions that end the episode with -1.1 or +.9, mean -.1.
        P = np.zeros((4, 10, 4))
        P[0, :, 1] = 1.0
        P[1, :, 2:] = 0.5
        P[2, :, 2] = P[3, :, 3] = 1.0
        reward = np.zeros((4, 10, 4))
        reward[1, :, 2], reward[1, :, 3] = -1.1, 0.9
        R = np.zeros((4, 10))
        R[1] = -0.1
        mdp = TabularMDP(
            P, R, [1, 0, 0, 0], [False, False, True, True], 1.0, transition_reward=reward
        )

        def first_value(method):
            runs = [
                learn(mdp, method, alpha=0.1, epsilon=0.1, episodes=200, rng=i).q[0].max()
                for i in range(200)
            ]
            return np.mean(runs)

        # Both have a standard error below .007; the true value is -.1.
        assert first_value("q_learning") > 0.0
        assert first_value("double_q_learning") < -0.05


class TestCompanion:
    @pytest.mark.parametrize("method", METHODS)
    @pytest.mark.parametrize("companion", ["sarsa", "q_learning", "expected_sarsa"])
    def test_does_not_influence_the_learner(self, method, companion):
        options = {"alpha": 0.3, "epsilon": 0.2, "episodes": 50, "rng": 4, "record": ["actions"]}
        alone = learn(episodic(5), method, **options)
        both = learn(episodic(5), method, companion=companion, companion_alpha=0.1, **options)
        np.testing.assert_array_equal(alone.actions, both.actions)
        np.testing.assert_array_equal(alone.q, both.q)

    @pytest.mark.parametrize("method", ["sarsa", "q_learning", "expected_sarsa"])
    def test_of_the_same_rule_learns_the_same(self, method):
        options = {"alpha": 0.3, "epsilon": 0.2, "episodes": 50, "rng": 4}
        learned = learn(episodic(6), method, companion=method, **options)
        np.testing.assert_allclose(learned.companion, learned.q, atol=1e-12)

    def test_a_q_learner_obtains_the_soft_values_on_the_side(self):
        mdp = chain(4)
        learned = learn(
            mdp,
            "q_learning",
            alpha=1.0,
            epsilon=0.2,
            episodes=2000,
            rng=0,
            companion="expected_sarsa",
        )
        np.testing.assert_allclose(learned.q, solve(mdp).q, rtol=1e-12)
        soft = soft_policy_iteration(mdp, 0.2).q
        np.testing.assert_allclose(learned.companion, soft, rtol=1e-12)

    def test_a_sarsa_companion_evaluates_the_behaviour(self):
        mdp = random_mdp(8, discount=0.8)
        learned = learn(
            mdp,
            "q_learning",
            alpha=lambda t: (1 + t / 1000) ** -0.8,
            epsilon=0.4,
            steps=3_000_000,
            rng=2,
            companion="sarsa",
        )
        behaviour = evaluate(mdp, epsilon_greedy(solve(mdp).q, 0.4)).q
        np.testing.assert_allclose(
            learned.companion, behaviour, atol=0.03 * np.abs(behaviour).max()
        )

    def test_starts_from_the_advice(self):
        phi = np.random.default_rng(1).normal(size=(6, 3))
        options = {"alpha": 0.3, "epsilon": 0.1, "episodes": 20, "rng": 3, "companion": "sarsa"}
        shaped = learn(episodic(1), "q_learning", potential=phi, **options)
        initialised = learn(episodic(1), "q_learning", initial_q=phi, **options)
        np.testing.assert_allclose(shaped.companion[:5], initialised.companion[:5], atol=1e-12)


def one_state(n_actions=2):
    """One state that never ends, reward 1, discount 0."""
    return TabularMDP(np.ones((1, n_actions, 1)), np.ones((1, n_actions)), [1.0], None, 0.0)


class TestChoice:
    def test_ties_are_broken_evenly(self):
        run = learn(one_state(3), alpha=1e-15, epsilon=0.0, steps=30_000, rng=0, record=["actions"])
        # The values stay tied, as 30,000 steps change them by 3e-11 at most.
        share = np.bincount(run.actions, minlength=3) / 30_000
        np.testing.assert_allclose(share, 1 / 3, atol=4 * np.sqrt(2 / 9 / 30_000))

    @pytest.mark.parametrize(
        ("exploration", "expected"), [("all", [0.2, 0.6, 0.2]), ("others", [0.3, 0.4, 0.3])]
    )
    def test_frequency_of_exploration(self, exploration, expected):
        run = learn(
            one_state(3),
            alpha=1e-12,
            epsilon=0.6,
            steps=30_000,
            rng=1,
            initial_q=[[0.0, 5.0, 1.0]],
            exploration=exploration,
        )
        np.testing.assert_allclose(run.visits[0] / 30_000, expected, atol=4 * 0.5 / 30_000**0.5)

    @pytest.mark.parametrize("method", METHODS)
    def test_the_epsilon_of_a_step_is_that_of_its_action(self, method):
        epsilon = np.array([0, 1, 0, 0, 1, 1, 0, 1.0])
        run = learn(
            one_state(),
            method,
            alpha=1e-6,
            epsilon=epsilon,
            steps=8,
            rng=0,
            initial_q=[[5.0, 0.0]],
            exploration="others",
            record=["actions"],
        )
        np.testing.assert_array_equal(run.actions, epsilon)

    @pytest.mark.parametrize("method", METHODS)
    def test_the_epsilon_of_an_episode_holds_for_all_its_steps(self, method):
        epsilon = np.array([0, 1, 1, 0.0])
        run = learn(
            one_state(),
            method,
            alpha=1e-6,
            epsilon=epsilon,
            episodes=4,
            max_episode_steps=3,
            rng=0,
            initial_q=[[5.0, 0.0]],
            exploration="others",
            record=["actions"],
        )
        np.testing.assert_array_equal(run.actions, np.repeat(epsilon, 3))


class TestSchedules:
    def test_alpha_of_each_step(self):
        # Q <- Q + alpha (1 - Q) from 0: .5, .625, 1; errors 1, .5, .375.
        run = learn(
            one_state(1), alpha=[0.5, 0.25, 1.0], epsilon=0.0, steps=3, rng=0, record=["td_errors"]
        )
        np.testing.assert_array_equal(run.td_errors, [1.0, 0.5, 0.375])
        assert run.q[0, 0] == 1.0

    def test_alpha_of_each_episode(self):
        run = learn(
            one_state(1),
            alpha=[0.5, 1.0],
            epsilon=0.0,
            episodes=2,
            max_episode_steps=2,
            rng=0,
            record=["td_errors"],
        )
        np.testing.assert_array_equal(run.td_errors, [1.0, 0.5, 0.25, 0.0])

    def test_a_function_is_evaluated_over_the_budget(self):
        options = {"epsilon": 0.1, "steps": 50, "rng": 0}
        by_function = learn(episodic(2), alpha=lambda t: 1 / (1 + t), **options)
        by_array = learn(episodic(2), alpha=1 / (1 + np.arange(50)), **options)
        np.testing.assert_array_equal(by_function.q, by_array.q)


class TestRecords:
    def test_chain_by_hand(self):
        # Advice to move on, followed greedily: 8 at the end of every episode of 4 steps.
        run = learn(
            chain(4),
            alpha=0.5,
            epsilon=0.0,
            episodes=3,
            rng=0,
            initial_q=np.tile([0.0, 20.0], (5, 1)),
            record=["rewards", "states", "actions"],
            checkpoint_every=5,
        )
        np.testing.assert_array_equal(run.episode_returns, [8, 8, 8])
        np.testing.assert_array_equal(run.episode_lengths, [4, 4, 4])
        assert not run.truncated.any()
        np.testing.assert_array_equal(run.rewards, [0, 0, 0, 8] * 3)
        np.testing.assert_array_equal(run.states, [0, 1, 2, 3] * 3)
        np.testing.assert_array_equal(run.actions, 1)
        np.testing.assert_array_equal(run.visits[:, 1], [3, 3, 3, 3, 0])
        np.testing.assert_array_equal(run.checkpoint_steps, [5, 10])
        np.testing.assert_array_equal(run.checkpoint_rewards, [8, 16])
        assert (run.n_steps, run.total_reward) == (12, 24.0)
        assert run.td_errors is None
        assert run.checkpoint_q is None

    def test_the_books_balance(self):
        run = learn(
            episodic(9),
            alpha=0.2,
            epsilon=0.3,
            steps=1000,
            rng=0,
            record=["rewards", "states", "actions", "q"],
            checkpoint_every=100,
        )
        assert run.rewards.size == run.n_steps == run.visits.sum() == 1000
        assert run.total_reward == pytest.approx(run.rewards.sum())
        done = int(run.episode_lengths.sum())
        assert done <= 1000
        assert run.episode_returns.sum() == pytest.approx(run.rewards[:done].sum())
        np.testing.assert_allclose(
            run.checkpoint_rewards, np.cumsum(run.rewards)[99::100], atol=1e-9
        )
        assert run.checkpoint_q.shape == (10, 6, 3)
        np.testing.assert_array_equal(run.checkpoint_q[-1], run.q)
        counted = np.zeros((6, 3), int)
        np.add.at(counted, (run.states, run.actions), 1)
        np.testing.assert_array_equal(counted, run.visits)

    @pytest.mark.parametrize("budget", [{"episodes": 60}, {"steps": 700}])
    @pytest.mark.parametrize("method", METHODS)
    def test_stretches_leave_no_seam(self, monkeypatch, method, budget):
        def run():
            return learn(
                episodic(4),
                method,
                alpha=0.2,
                epsilon=lambda k: 0.5 / (1 + k),
                rng=3,
                companion="sarsa",
                max_episode_steps=9,
                checkpoint_every=7,
                record=learning.RECORDABLE,
                **budget,
            )

        whole = run()
        for name, value in (("TRACED_STRETCH", 23), ("ENDS", 4), ("MARKS", 3)):
            monkeypatch.setattr(learning, name, value)
        pieces = run()
        for field in dataclasses.fields(whole):
            np.testing.assert_array_equal(
                getattr(whole, field.name), getattr(pieces, field.name), err_msg=field.name
            )

    def test_episodes_are_cut_off(self):
        run = learn(
            chain(4),
            alpha=0.5,
            epsilon=0.0,
            episodes=2,
            rng=0,
            initial_q=np.tile([1.0, 0.0], (5, 1)),
            max_episode_steps=3,
            record=["states", "td_errors"],
        )
        np.testing.assert_array_equal(run.truncated, [True, True])
        np.testing.assert_array_equal(run.episode_lengths, [3, 3])
        np.testing.assert_array_equal(run.states, 0)
        # Staying bootstraps from itself, at a cut too: Q falls from 1 by a quarter a step.
        np.testing.assert_allclose(run.td_errors, -0.5 * 0.75 ** np.arange(6))

    def test_same_seed_same_run(self):
        first, second = (
            learn(episodic(1), alpha=0.3, epsilon=0.2, episodes=20, rng=rng)
            for rng in (11, np.random.default_rng(11))
        )
        np.testing.assert_array_equal(first.q, second.q)

    def test_the_given_tables_are_not_changed(self):
        q = np.zeros((5, 2))
        learn(chain(4), alpha=0.5, epsilon=0.1, episodes=5, rng=0, initial_q=q)
        assert (q == 0).all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"alpha": 0.0}, r"alpha is 0.0, but it must be in \(0, 1\]"),
        ({"alpha": 1.5}, r"alpha is 1.5"),
        ({"alpha": float("nan")}, "alpha is nan"),
        ({"alpha": "fast"}, "alpha is 'fast', but it must be a number"),
        ({"alpha": [0.1, 0.2]}, r"alpha has shape \(2,\).*each episode, shape \(5,\)"),
        ({"alpha": [0.1, 0.2, 0.0, 0.1, 0.1]}, "alpha is 0.0 at episode 2"),
        ({"epsilon": -0.1}, r"epsilon is -0.1, but it must be in \[0, 1\]"),
        ({"epsilon": 1.01}, "epsilon is 1.01"),
        ({"rng": -1}, "rng is -1, but it must be a numpy Generator or a seed"),
        ({"rng": 0.5}, "rng is 0.5"),
        ({"episodes": 0}, "episodes is 0, but it must be an integer of at least 1"),
        ({"episodes": 2.0}, "episodes is 2.0"),
        ({"episodes": None}, "neither of episodes and steps"),
        ({"steps": 3}, "both of episodes and steps"),
        ({"max_episode_steps": 0}, "max_episode_steps is 0"),
        ({"checkpoint_every": -1}, "checkpoint_every is -1"),
        ({"method": "td"}, "method 'td' does not exist: choose one of sarsa, q_learning"),
        ({"exploration": "softmax"}, "exploration 'softmax' does not exist"),
        ({"companion": "double_q_learning"}, "companion 'double_q_learning' does not exist"),
        ({"companion_alpha": 0.1}, "companion_alpha is given, but no companion"),
        ({"companion": "sarsa", "companion_alpha": 0}, r"companion_alpha is 0.0.*\(0, 1\]"),
        ({"record": ["returns"]}, "record 'returns' does not exist: choose one of rewards"),
        ({"record": ["q"]}, "give checkpoint_every"),
        ({"potential": np.zeros((5, 3))}, r"potential has shape \(5, 3\), but \(5, 2\)"),
        (
            {"potential": [[0, np.nan]] * 5},
            r"potential of pair \[state 0, action 1\].*4 such pairs",
        ),
        ({"initial_q": [[0, np.inf]] * 5}, r"initial_q of pair \[state 0, action 1\] is inf"),
    ],
)
def test_bad_arguments_are_named(change, words):
    options = {"alpha": 0.1, "epsilon": 0.1, "episodes": 5, "rng": 0, **change}
    with pytest.raises(ValueError, match=words):
        learn(chain(4), **options)


def test_episodes_that_cannot_end():
    with pytest.raises(ValueError, match=r"no terminal state.*give steps instead"):
        learn(random_mdp(0), alpha=0.1, epsilon=0.1, episodes=5, rng=0)


def test_start_in_a_terminal_state():
    mdp = chain(4)
    ended = TabularMDP(mdp.transition, mdp.reward, np.eye(5)[4], mdp.terminal, 0.5)
    with pytest.raises(ValueError, match="start gives terminal state 4"):
        learn(ended, alpha=0.1, epsilon=0.1, episodes=5, rng=0)


@given(seed=st.integers(0, 10**6), n=st.integers(1, 12), zeros=st.floats(0, 0.9))
@settings(max_examples=50, deadline=None)
def test_a_draw_is_the_first_outcome_above_the_number(seed, n, zeros):
    rng = np.random.default_rng(seed)
    p = rng.random(n) * (rng.random(n) >= zeros)
    if p.sum() == 0:
        p[rng.integers(n)] = 1.0
    p /= p.sum()
    row = cumulative(p)
    assert row[-1] == 1.0
    for u in [0.0, *rng.random(20), np.nextafter(1.0, 0.0)]:
        k = draw(row, u)
        assert p[k] > 0
        assert k == np.searchsorted(row, u, side="right")
