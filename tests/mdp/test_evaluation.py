import numpy as np
import pytest
import quantecon as qe

from tests.mdp.examples import Factored, chain, grid, random_mdp, simulate
from thesis_lib.mdp import epsilon_greedy, evaluate, start_value
from thesis_lib.mdp.evaluation import ends, proper_policy


def random_policy(mdp, seed):
    return np.random.default_rng(seed).dirichlet(np.ones(mdp.n_actions), size=mdp.n_states)


def test_chain_by_hand():
    # Moving on is worth 8 * .5^(steps before the last): 1, 2, 4, 8; staying first halves it.
    values = evaluate(chain(4), [1, 1, 1, 1, 0])
    np.testing.assert_allclose(values.v, [1, 2, 4, 8, 0], atol=1e-14)
    np.testing.assert_allclose(values.q[:, 0], [0.5, 1, 2, 4, 0], atol=1e-14)
    np.testing.assert_allclose(values.q[:, 1], [1, 2, 4, 8, 0], atol=1e-14)


def test_a_coin_that_ends_by_hand():
    # Staying or moving on with 1/2 each: a step takes 2 tries on average, so with
    # discount 1 every state is worth 8.
    mdp = chain(3, discount=1.0)
    np.testing.assert_allclose(evaluate(mdp, np.full((4, 2), 0.5)).v, [8, 8, 8, 0], atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_agrees_with_quantecon(seed):
    mdp = random_mdp(seed, n_states=8, n_actions=4, discount=0.95)
    policy = np.random.default_rng(seed).integers(4, size=8)
    peer = qe.markov.DiscreteDP(mdp.reward, mdp.transition, mdp.discount).evaluate_policy(policy)
    np.testing.assert_allclose(evaluate(mdp, policy).v, peer, rtol=1e-10)


@pytest.mark.parametrize(
    "mdp",
    [
        random_mdp(1, terminal=1, discount=1.0),
        random_mdp(2, terminal=2, discount=0.8),
        grid(3),
        chain(3),
    ],
    ids=["undiscounted", "discounted", "grid", "chain"],
)
def test_monte_carlo_returns_agree_with_the_exact_value(mdp):
    pi = random_policy(mdp, 0)
    returns, _ = simulate(mdp, pi, 40_000, seed=5)
    standard_error = returns.std(ddof=1) / np.sqrt(returns.size)
    assert abs(returns.mean() - start_value(mdp, pi)) < 4 * standard_error


@pytest.mark.parametrize("seed", range(5))
def test_bellman_equation_2_6_holds(seed):
    mdp = random_mdp(seed, terminal=1, discount=1.0)
    pi = random_policy(mdp, seed)
    values = evaluate(mdp, pi)
    going_on = ~mdp.terminal
    follow = (pi * values.q).sum(axis=1)
    np.testing.assert_allclose(values.v, follow, atol=1e-10)
    np.testing.assert_allclose(values.q[going_on], mdp.lookahead(follow)[going_on], atol=1e-10)
    assert (values.q[mdp.terminal] == 0).all()


@pytest.mark.parametrize(
    "mdp",
    [
        random_mdp(1, n_states=40, discount=0.99),
        random_mdp(2, n_states=12, terminal=3, discount=1.0),
        grid(6),
    ],
    ids=["continuing", "episodic", "grid"],
)
def test_expectations_alone_give_the_same_values(mdp):
    pi = random_policy(mdp, 0)
    direct, iterated = evaluate(mdp, pi), evaluate(Factored(mdp), pi)
    scale = np.abs(direct.q).max()
    np.testing.assert_allclose(iterated.q, direct.q, rtol=0, atol=1e-9 * scale)
    np.testing.assert_allclose(iterated.v, direct.v, rtol=0, atol=1e-9 * scale)


def test_slow_chains_converge_too():
    # Under the random policy the end of a chain of 60 is reached after about 60^2 steps.
    mdp = Factored(grid(8))
    pi = epsilon_greedy(np.tile([0.0, 0.0, 1.0, 1.0], (64, 1)), 0.5)  # drifts away from the goal
    values = evaluate(mdp, pi)
    residual = (pi * mdp.lookahead(values.v)).sum(axis=1) - values.v
    assert np.abs(residual).max() < 1e-8 * np.abs(values.v).max()


def test_start_value_weighs_the_start_states():
    mdp = random_mdp(4)
    pi = random_policy(mdp, 4)
    assert start_value(mdp, pi) == pytest.approx(float(mdp.start @ evaluate(mdp, pi).v))


@pytest.mark.parametrize("wrap", [lambda mdp: mdp, Factored])
def test_a_policy_that_never_ends_has_no_value_without_discounting(wrap):
    mdp = wrap(chain(3, discount=1.0))
    with pytest.raises(ValueError, match=r"from state 0 \(2 such states\).*discount below 1"):
        evaluate(mdp, [0, 0, 1, 0])


def test_a_continuing_task_has_no_values_without_discounting():
    with pytest.raises(ValueError, match="never reaches a terminal state"):
        evaluate(random_mdp(0, discount=1.0), np.zeros(5, int))


def test_ends_is_about_possibility():
    mdp = chain(3)
    stay_at_1 = np.array([[0, 1.0], [1.0, 0], [0.99, 0.01], [1.0, 0]])
    np.testing.assert_array_equal(ends(mdp, stay_at_1), [False, False, True, True])


def test_proper_policy_ends_from_everywhere():
    mdp = grid(5)
    policy = proper_policy(mdp)
    # Each action leads a step closer, so the distance to the far corner is the cost.
    steps = [8 - s % 5 - s // 5 for s in range(25)]
    np.testing.assert_allclose(evaluate(mdp, policy).v, -np.array(steps))


def test_proper_policy_says_where_there_is_none():
    mdp = random_mdp(0, discount=1.0)
    with pytest.raises(ValueError, match="from state 0 no policy reaches a terminal state"):
        proper_policy(mdp)


@pytest.mark.parametrize(
    ("policy", "words"),
    [
        (np.zeros(4, int), r"policy has shape \(4,\)"),
        (np.zeros(5), "type float64"),
        (np.array([0, 1, 2, 0, 0]), "state 2 is action 2, but actions are 0 to 1"),
        (np.full((5, 2), 0.6), r"policy of state 0 is \[0.6 0.6\]"),
        (np.array([[0.5, 0.5]] * 3 + [[1.5, -0.5]] * 2), "policy of state 3"),
    ],
)
def test_malformed_policies(policy, words):
    with pytest.raises(ValueError, match=words):
        evaluate(chain(4), policy)


def test_the_policy_of_terminal_states_is_not_read():
    pi = np.tile([0.0, 1.0], (5, 1))
    pi[4] = np.nan
    np.testing.assert_allclose(evaluate(chain(4), pi).v, [1, 2, 4, 8, 0])
