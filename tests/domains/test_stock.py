"""The stock domain against its worked example, its own dense form, and hand calculation."""

from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from thesis_lib.domains import StockMDP, stock
from thesis_lib.domains.stock import RewardTiming, StockSize
from thesis_lib.mdp import soft_policy_iteration, solve

SIZES = [(1, 1, 0), (1, 2, 1), (1, 3, 2), (2, 2, 1), (3, 1, 2)]


def example_task(**options):
    # Figure 3.4a: telecom is moved by its stock 2, pharma by its stock 1; oil helps when falling.
    return StockMDP([[0, 1], [1, 0]], [False], **options)


def test_the_worked_example():
    # Telecom (1, 1), pharma (0, 1) owned, oil rising: P_telecom = .1 + .8 (1 + 3*0)/(1 + 3) = .3.
    task = example_task()
    state = task.size.state([0, 1], [1, 1, 0, 1], [1])
    assert task.rise_probability()[state, 0] == pytest.approx(0.3, abs=1e-15)
    # Pharma's stock of influence falls and oil does not help: .1 + .8 * 0.
    assert task.rise_probability()[state, 1] == pytest.approx(0.1, abs=1e-15)
    # The stated rule gives +1 - 1 = 0 for pharma (0, 1), where the text prints 1.
    now = example_task(reward_timing="before_current")
    assert now.reward[state].tolist() == [0, 0, 0, 0]


def test_oil_falling_helps():
    task = example_task()
    state = task.size.state([0, 1], [1, 1, 0, 1], [0])
    # .1 + .8 (1 + 3)/(1 + 3) and .1 + .8 (0 + 3)/(1 + 3)
    assert task.rise_probability()[state].tolist() == pytest.approx([0.9, 0.7])


def test_numbers_of_states_tasks_and_actions():
    # |X| = 32 and 6 tasks for G = 1, doubling up to 512 and 96 for G = 5 (section 4.3).
    for g in range(1, 6):
        domain = stock(1, 2, g)
        assert domain.n_observations * len(domain.actions) == 32 * 2 ** (g - 1)
        assert len(domain) == 6 * 2 ** (g - 1)
    assert stock(2, 2, 1).actions == ("buy 1", "sell 1", "buy 2", "sell 2")
    assert len(stock(2, 2, 1)) == (2**2 - 1) * 2
    assert len(stock(2, 2, 1, influence="per_sector")) == (2**2 - 1) ** 2 * 2


def test_tasks_are_all_different_and_influence_is_never_empty():
    domain = stock(2, 2, 1, influence="per_sector")
    seen = {(t.influence.tobytes(), t.rising_helps.tobytes()) for t in domain.tasks}
    assert len(seen) == len(domain)
    assert all(task.influence.any(axis=1).all() for task in domain.tasks)
    for task in stock(2, 2, 1).tasks:
        assert (task.influence == task.influence[0]).all()


def test_each_global_helps_in_half_the_tasks():
    helps = np.array([task.rising_helps for task in stock(1, 2, 3).tasks])
    assert (helps.mean(axis=0) == 0.5).all()


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("timing", get_args(RewardTiming))
@pytest.mark.parametrize("persistence", [0.5, 0.8])
def test_factored_expectation_equals_the_dense_one(size, timing, persistence):
    domain = stock(
        *size, influence="per_sector", reward_timing=timing, global_persistence=persistence
    )
    task = domain.tasks[len(domain) // 2]
    dense = task.to_tabular()  # its constructor checks that rows and rewards agree
    values = np.random.default_rng(1).normal(size=task.n_states)
    np.testing.assert_allclose(task.expectation(values), dense.expectation(values), atol=1e-13)
    np.testing.assert_array_equal(task.outcomes().probability.sum(axis=2).round(12), 1)


@settings(max_examples=25, deadline=None)
@given(st.data())
def test_a_transition_probability_by_the_formula(data):
    # One entry of the matrix, multiplied up from the text's formula with plain numbers.
    sizes = data.draw(st.sampled_from(SIZES))
    domain = stock(*sizes, influence="per_sector")
    task = domain.tasks[data.draw(st.integers(0, len(domain) - 1))]
    size = task.size
    now = data.draw(st.integers(0, size.n_states - 1))
    later = data.draw(st.integers(0, size.n_states - 1))
    action = data.draw(st.integers(0, len(size.actions) - 1))
    S, E, G = sizes
    old = [int(c) for c in format(now, f"0{size.bits}b")]
    new = [int(c) for c in format(later, f"0{size.bits}b")]
    owned = old[:S]
    owned[action // 2] = 1 - action % 2
    p = 1.0 if new[:S] == owned else 0.0
    r_g = sum(old[S + S * E + g] == int(task.rising_helps[g]) for g in range(G))
    for s in range(S):
        who = [e for e in range(E) if task.influence[s, e]]
        r_s = sum(old[S + s * E + e] for e in who)
        rise = 0.1 + 0.8 * (r_s + 3 * r_g) / (len(who) + 3 * G)
        for e in range(E):
            p *= rise if new[S + s * E + e] else 1 - rise
    p *= 0.5**G
    assert task.to_tabular().transition[now, action, later] == pytest.approx(p, abs=1e-14)


def test_reward_timings_by_hand():
    # One sector of one stock without globals: rising now means it rises with .9 next.
    # States are (owned, rising); buy, sell.  Expected next sign: 2 * .9 - 1 = .8 or -.8.
    hand = {
        "after_next": [[-0.8, 0], [0.8, 0], [-0.8, 0], [0.8, 0]],
        "after_current": [[-1, 0], [1, 0], [-1, 0], [1, 0]],
        "before_next": [[0, 0], [0, 0], [-0.8, -0.8], [0.8, 0.8]],
        "before_current": [[0, 0], [0, 0], [-1, -1], [1, 1]],
    }
    for timing, expected in hand.items():
        task = stock(1, 1, 0, reward_timing=timing).tasks[0]
        np.testing.assert_allclose(task.reward, expected, atol=1e-15)


def test_persistent_globals_keep_their_value():
    task = StockMDP([[1]], [True], global_persistence=1.0)
    now = task.size.state([0], [0], [1])
    keeps = task.size.global_values[:, 0].astype(float)
    np.testing.assert_allclose(task.expectation(keeps)[now], 1.0)


def test_start_options():
    assert stock(1, 1, 1).tasks[0].start.tolist() == [1 / 8] * 8
    unowned = stock(1, 1, 1, start="unowned").tasks[0]
    assert unowned.start.tolist() == [1 / 4] * 4 + [0] * 4


def test_the_large_domain_builds_its_tasks_when_asked():
    domain = stock(1, 2, 8)
    assert len(domain) == 768
    assert domain.n_observations == 2048
    first = domain.tasks[0]
    assert domain.tasks[0] is first
    assert domain.tasks[1].features is first.features
    assert domain.tasks[-1].rising_helps.all()
    assert len(domain.tasks[2:5]) == 3
    with pytest.raises(IndexError):
        domain.tasks[768]


def test_bad_input_is_one_sentence():
    with pytest.raises(ValueError, match="sectors is 0, but it must be an integer of at least 1"):
        stock(0, 2, 2)
    with pytest.raises(ValueError, match=r"global_factors is 1\.5"):
        stock(1, 2, 1.5)
    with pytest.raises(
        ValueError, match="reward_timing 'now' does not exist: choose one of after_next"
    ):
        stock(reward_timing="now")
    with pytest.raises(ValueError, match="influence 'some' does not exist"):
        stock(influence="some")
    with pytest.raises(ValueError, match=r"discount is 1\.5"):
        stock(discount=1.5)
    with pytest.raises(ValueError, match="influence of sector 2 names no stock"):
        StockMDP([[1, 0], [0, 0]], [True])
    with pytest.raises(ValueError, match="are needed"):
        StockMDP([1, 0], [True])
    with pytest.raises(ValueError, match="states, but at most"):
        stock(4, 5, 5)
    with pytest.raises(ValueError, match="transition matrix of a stock task of size <1, 2, 11>"):
        StockMDP([[1, 0]], [True] * 11).to_tabular()
    with pytest.raises(ValueError, match="state bits"):
        StockSize(1, 1, 1).state([1], [2], [0])


def test_monte_carlo_returns_match_the_exact_value():
    # Uniformly random trading for 150 steps at discount .9 (.9^150 < 1e-6).
    task = stock(1, 2, 1).tasks[4]
    dense = task.to_tabular()
    chain = dense.transition.mean(axis=1)
    exact = np.linalg.solve(np.eye(task.n_states) - 0.9 * chain, task.reward.mean(axis=1))
    listed = task.outcomes()
    cumulative = listed.probability.cumsum(axis=2)
    rng = np.random.default_rng(8)
    n = 4000
    state, returns = rng.integers(task.n_states, size=n), np.zeros(n)
    for t in range(150):
        action = rng.integers(2, size=n)
        k = (cumulative[state, action] < rng.random(n)[:, None]).sum(axis=1)
        returns += 0.9**t * listed.reward[state, action, k]
        state = listed.successor[state, action, k]
    error = returns.std(ddof=1) / np.sqrt(n)
    assert abs(returns.mean() - exact.mean()) < 4 * error


def test_solutions_in_factored_form_equal_the_dense_ones():
    for sizes in [(1, 2, 3), (2, 2, 1)]:
        task = stock(*sizes, influence="per_sector").tasks[-2]
        dense = task.to_tabular()
        np.testing.assert_allclose(solve(task).q, solve(dense).q, atol=1e-9)
        ours, theirs = soft_policy_iteration(task, 0.1), soft_policy_iteration(dense, 0.1)
        np.testing.assert_allclose(ours.q, theirs.q, atol=1e-9)


def test_the_large_domain_is_solvable():
    # 2,048 states each; the Bellman equation holds to rounding, checked by one more look-ahead.
    tasks = stock(1, 2, 8).tasks
    for task in (tasks[0], tasks[400], tasks[767]):
        q = solve(task).q
        np.testing.assert_allclose(task.lookahead(q.max(axis=1)), q, atol=1e-9)


@pytest.mark.parametrize("timing", get_args(RewardTiming))
def test_only_the_default_reward_timing_meets_the_statements_of_section_43(timing):
    # Relevance of a feature: mean variance of Q* over it, the others held (S = 1, E = 2, G = 2).
    domain = stock(1, 2, 2, reward_timing=timing)
    tables = np.array([solve(task).q for task in domain.tasks]).reshape(-1, *[2] * 6)
    task = [np.mean([q.var(axis=i).mean() for q in tables]) for i in range(6)]
    mean = tables.mean(axis=0)
    within = [mean.var(axis=i).mean() for i in range(6)]
    ownership, stocks, globals_, action = 0, [1, 2], [3, 4], 5
    meets = {
        "ownership is completely irrelevant": within[ownership] < 1e-18,
        "stocks and the action are domain relevant": min(within[i] for i in (*stocks, action))
        > 0.005,
        "globals are strongly task relevant, much more so than stocks, but domain irrelevant": (
            min(task[i] for i in globals_) > 5 * max(task[i] for i in stocks)
            and max(within[i] for i in globals_) < 1e-18
        ),
        "stocks and the action are only weakly domain relevant": (
            max(within[i] for i in (*stocks, action)) < 0.1 * min(task[i] for i in globals_)
        ),
    }
    assert all(meets.values()) == (timing == "after_next")
