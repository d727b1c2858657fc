"""Potential functions (section 3.3)."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from thesis_lib import potentials
from thesis_lib.domains import Domain, episodic_cliff
from thesis_lib.mdp.greedy import epsilon_greedy
from thesis_lib.mdp.model import TabularMDP


def one_step(rewards, codes, discount=0.5):
    """A task of one-step episodes: state i earns rewards[i, a] and ends."""
    rewards = np.asarray(rewards, dtype=float)
    n, n_actions = rewards.shape
    transition = np.zeros((n + 1, n_actions, n + 1))
    transition[:, :, n] = 1
    return TabularMDP(
        transition=transition,
        reward=np.vstack([rewards, np.zeros(n_actions)]),
        start=np.append(np.full(n, 1 / n), 0),
        terminal=np.append(np.zeros(n, bool), True),
        discount=discount,
        features={"code": np.append(codes, -1)},
    )


@pytest.fixture
def two_tasks():
    """Observations 1, 2 in task one and 2, 3 in task two: only 2 is shared."""
    return Domain(
        "two tasks",
        (one_step([[1, 2], [3, 4]], [1, 2]), one_step([[10, 20], [30, 40]], [2, 3])),
        distribution=[0.75, 0.25],
    )


def test_mean_of_values_by_hand(two_tasks):
    # p(m|x) at observation 2 is .75 and .25, elsewhere one task has all the weight.
    expected = [[1, 2], [0.75 * 3 + 0.25 * 10, 0.75 * 4 + 0.25 * 20], [30, 40]]
    assert potentials.q_star(two_tasks) == pytest.approx(np.array(expected))


def test_weights_change_the_mean_by_hand(two_tasks):
    p = two_tasks.uniform()
    p[0, 1], p[0, 0] = 0.1, 0.4  # task one is rarely in observation 2
    posterior = 0.75 * 0.1 / (0.75 * 0.1 + 0.25 * 0.25)
    got = potentials.cross_task_values(two_tasks, potentials.optimal_solutions(two_tasks), p)
    assert got[1, 0] == pytest.approx(posterior * 3 + (1 - posterior) * 10)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_mean_needs_every_value(two_tasks, value):
    first, second = potentials.optimal_solutions(two_tasks)
    bad = [first, np.where(second == 40, value, second)]
    told = rf"the value of task '1' at pair \[observation 2, action 1\] is {value}, but every pair"
    with pytest.raises(ValueError, match=told):
        potentials.cross_task_values(two_tasks, bad)
    # What a task's terminal states are given is read by no mean.
    ended = [np.where(np.arange(3)[:, None] == 2, value, first), second]
    assert np.isfinite(potentials.cross_task_values(two_tasks, ended)).all()


def test_a_pair_without_weight_falls_back_to_the_uniform_mean(two_tasks):
    p = two_tasks.uniform()
    p[0, 0], p[0, 1] = 0.0, 0.5
    got = potentials.cross_task_values(two_tasks, potentials.optimal_solutions(two_tasks), p)
    assert got[0] == pytest.approx([1, 2])


def test_the_squared_error_needs_every_value(two_tasks):
    tables = potentials.optimal_solutions(two_tasks)
    # Uniform over four pairs each: mean squares 30 / 4 and 3000 / 4, by D(m) = .75 and .25.
    none = np.zeros(two_tasks.shape)
    assert potentials.expected_squared_error(two_tasks, tables, none) == pytest.approx(
        sum(d * s / 4 for d, s in zip(two_tasks.distribution, (30, 3000), strict=True))
    )
    with pytest.raises(ValueError, match=r"q0 has shape \(2,\), but domain .* = \(3, 2\)"):
        potentials.expected_squared_error(two_tasks, tables, np.zeros(2))
    for value in (np.nan, np.inf):
        with pytest.raises(ValueError, match=rf"q0 of pair \[observation 2, action 1\] is {value}"):
            potentials.expected_squared_error(two_tasks, tables, [[0, 0], [0, 0], [0, value]])
        bad = [tables[0], np.where(tables[1] == 40, value, tables[1])]
        with pytest.raises(ValueError, match=rf"at pair \[observation 2, action 1\] is {value}"):
            potentials.expected_squared_error(two_tasks, bad, none)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 4), st.booleans())
def test_the_mean_is_the_least_squares_minimiser(seed, n_tasks, shared):
    """Equation 3.4 minimises 3.3: no perturbation does better, on random domains and weights."""
    rng = np.random.default_rng(seed)
    tasks = tuple(
        one_step(rng.normal(size=(3, 2)), np.arange(3) + (0 if shared else m))
        for m in range(n_tasks)
    )
    domain = Domain("random", tasks, distribution=rng.dirichlet(np.ones(n_tasks)))
    p = domain.uniform() * rng.uniform(0.1, 1, (n_tasks, *domain.shape))
    p /= p.sum(axis=(1, 2), keepdims=True)
    tables = potentials.optimal_solutions(domain)
    best = potentials.cross_task_values(domain, tables, p)
    error = potentials.expected_squared_error(domain, tables, best, p)
    for _ in range(5):
        other = best + rng.normal(scale=0.1, size=best.shape)
        assert potentials.expected_squared_error(domain, tables, other, p) > error
    # The minimum of a quadratic: independent least squares on the weighted system.
    stacked = domain.gather(tables)
    m, o, a = np.nonzero(~np.isnan(stacked))
    w = np.sqrt(domain.distribution[m] * p[m, o, a])
    design = np.zeros((len(m), best.size))
    design[np.arange(len(m)), o * domain.shape[1] + a] = w
    solution = np.linalg.lstsq(design, w * stacked[m, o, a], rcond=None)[0]
    assert best.ravel() == pytest.approx(solution, abs=1e-9)


def test_soft_values_are_lower_than_optimal_ones():
    domain = episodic_cliff(sensor=True)
    star, tilde = potentials.q_star(domain), potentials.q_tilde(domain, 0.1)
    assert (tilde <= star + 1e-9).all()
    assert potentials.q_tilde(domain, 0.0) == pytest.approx(star)


def test_soft_values_by_hand():
    """Staying is greedy nowhere, but random in one step of five: V = .8 * 8 + .2 * V/2 = 64/9."""
    transition = np.zeros((2, 2, 2))
    transition[0, 0, 0] = transition[0, 1, 1] = transition[1, :, 1] = 1
    reward, start = np.array([[0.0, 8.0], [0.0, 0.0]]), np.array([1.0, 0.0])
    domain = Domain("stay or go", [TabularMDP(transition, reward, start, start == 0, discount=0.5)])
    (soft,), (best,) = (
        potentials.soft_solutions(domain, 0.4),
        potentials.optimal_solutions(domain),
    )
    assert soft[0] == pytest.approx([32 / 9, 8])
    assert best[0] == pytest.approx([4, 8])


def test_value_of_one_policy_by_hand(two_tasks):
    policy = np.full(two_tasks.shape, 0.5)
    assert potentials.q_mu(two_tasks, policy)[0] == pytest.approx([1, 2])  # one-step episodes


def test_cliff_potential_by_hand():
    """Q* one step before the goal, in the one task where that step is not over the cliff.

    Task (0,0)->(3,0): the cell (3,1) above the goal has Q*(S) = -1.
    """
    domain = episodic_cliff()
    task = domain.task_names.index("(0,0)->(3,0)")
    table = potentials.optimal_solutions(domain)[task]
    state = 1 * 4 + 3
    assert table[state, 2] == -1
    assert table[0, 0] == -5  # N, E, E, E, S
    assert table[0, 1] == -1000 - 5  # into the cliff, back to the start


def test_start_weights_by_hand(two_tasks):
    p = potentials.pair_weights(two_tasks, "start")
    assert p[0, :2] == pytest.approx(np.full((2, 2), 0.25))
    assert p[0, 2] == pytest.approx([0, 0])


def test_stationary_weights_of_a_walk_by_hand():
    """Cliff task, greedy path N E E E S: five pairs, each a fifth of the time."""
    domain = episodic_cliff()
    policies = [epsilon_greedy(q, 0.0) for q in potentials.optimal_solutions(domain)]
    p = potentials.pair_weights(domain, "stationary", policies)
    m = domain.task_names.index("(0,0)->(3,0)")
    assert np.sort(p[m].ravel())[-5:] == pytest.approx(np.full(5, 0.2))


def test_learning_weights_are_a_weighting():
    domain = episodic_cliff()
    p = potentials.learning_weights(
        domain,
        "q_learning",
        alpha=0.5,
        epsilon=0.1,
        steps=2000,
        rng=np.random.default_rng(0),
        snapshots=10,
    )
    domain.check_weights(p)


def test_linear_weights_by_hand():
    # Feature 1 is active in task one only; feature 2 twice as often in task two.
    w = potentials.linear_cross_task_weights([[1.0, 2.0], [5.0, 8.0]], [[1, 1], [0, 2]])
    assert w == pytest.approx([1.0, (2 + 2 * 8) / 3])


def test_linear_weights_of_a_history_by_hand():
    # p(i|m) = visits/4 and visits/8.  Feature 0: (1/4 * 1 + 1/2 * 5)/(3/4) = 11/3; feature 1
    # is seen in the first task only; feature 2: (1/2 * 3 + 1/2 * 7)/1; feature 3 never.
    w = [[1.0, 2.0, 3.0, np.nan], [5.0, np.nan, 7.0, np.nan]]
    p = [[0.25, 0.25, 0.5, 0.0], [0.5, 0.0, 0.5, 0.0]]
    got = potentials.linear_cross_task_weights(w, p, fill=-9)
    assert got == pytest.approx([11 / 3, 2, 5, -9])
    # Feature 0 with D: (.8/4 * 1 + .2/2 * 5)/(.8/4 + .2/2) = 7/3.
    got = potentials.linear_cross_task_weights(w, p, [0.8, 0.2])
    assert got[0] == pytest.approx(7 / 3)
    # Features 0 and 1 merged: (1/4 * 1 + 1/4 * 2 + 1/2 * 5)/(1/4 + 1/4 + 1/2).
    got = potentials.linear_cross_task_weights(w, p, labels=[0, 0, 1, 1])
    assert got == pytest.approx([3.25, 3.25, 5, 5])


def test_linear_weights_equal_the_tabular_mean(two_tasks):
    """With one indicator feature a pair, (3.5) is (3.4)."""
    tables = potentials.optimal_solutions(two_tasks)
    stacked, p = two_tasks.gather(tables).reshape(2, -1), two_tasks.uniform().reshape(2, -1)
    w = potentials.linear_cross_task_weights(np.nan_to_num(stacked), p, two_tasks.distribution)
    assert w == pytest.approx(potentials.cross_task_values(two_tasks, tables).ravel())


def second_moments(f, p):
    """F_m = sum_x p(x|m) f(x) f(x)^T."""
    return np.einsum("mx,xi,xj->mij", p, f, f)


def squared_error(w, f, p, q):
    return float((np.asarray(p) * (np.asarray(q) - f @ w) ** 2).sum() / len(p))


def test_where_features_overlap_and_weights_differ_eq_3_5_is_no_minimum():
    f = np.array([[1, 1], [1, 0]])
    p, q, own = np.eye(2), [[2.0, 2.0], [3.0, 3.0]], [[1.0, 1.0], [3.0, 0.0]]
    printed = potentials.linear_cross_task_weights(own, p @ f)
    best = potentials.least_squares_weights(own, second_moments(f, p))
    assert printed == pytest.approx([2, 1])
    assert squared_error(printed, f, p, q) == pytest.approx(1)
    assert best == pytest.approx([3, -1])
    assert squared_error(best, f, p, q) == pytest.approx(0, abs=1e-20)


@pytest.mark.parametrize("kind", ["any", "no overlap", "same p"])
def test_least_squares_weights_are_those_of_the_weighted_regression(kind):
    """On random binary features, against lstsq on the stacked pairs of all tasks."""
    rng = np.random.default_rng(8)
    for _ in range(20):
        n, pairs, tasks = 4, 12, 3
        f = rng.integers(0, 2, (pairs, n)).astype(float)
        if kind == "no overlap":
            f = np.eye(n)[rng.integers(0, n, pairs)]
        p = rng.dirichlet(np.ones(pairs), 1 if kind == "same p" else tasks)
        p = np.broadcast_to(p, (tasks, pairs))
        own, D = rng.normal(size=(tasks, n)), rng.dirichlet(np.ones(tasks))
        moments = second_moments(f, p)
        root = np.sqrt(D[:, None] * p)
        rows, target = (root[:, :, None] * f).reshape(-1, n), (root * (own @ f.T)).ravel()
        expected = np.linalg.lstsq(rows, target, rcond=None)[0]
        found = potentials.least_squares_weights(own, moments, D)
        assert f @ found == pytest.approx(f @ expected, abs=1e-9)
        printed = potentials.linear_cross_task_weights(own, p @ f, D)
        alike = np.allclose(f @ printed, f @ expected, atol=1e-9)
        assert alike == (kind != "any")


def test_least_squares_weights_refuse_moments_of_another_shape():
    with pytest.raises(ValueError, match=r"moments \(2, 2\)"):
        potentials.least_squares_weights(np.ones((2, 2)), np.ones((2, 2)))


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        (np.ones((2, 3, 2)), "must be at least 0 and sum to 1"),
        (np.full((2, 3, 2), 1 / 6), "outside its state-action space"),
        (np.ones((3, 2)), "have shape"),
    ],
)
def test_bad_weights(two_tasks, weights, message):
    with pytest.raises(ValueError, match=message):
        potentials.q_star(two_tasks, weights)


def test_unknown_weighting(two_tasks):
    with pytest.raises(ValueError, match="choose uniform, start or stationary"):
        potentials.pair_weights(two_tasks, "even")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="for each of 2 tasks, but 1 were given"):
        potentials.pair_weights(two_tasks, "stationary", [np.full((3, 2), 0.5)])
    with pytest.raises(ValueError, match="needs policies"):
        potentials.pair_weights(two_tasks, "stationary")


def test_potential_with_missing_pairs(two_tasks):
    phi = np.zeros(two_tasks.shape)
    phi[2] = np.nan
    with pytest.raises(ValueError, match=r"no value at observation \(code=3\)"):
        two_tasks.scatter_all(phi)


def test_constant_potential_is_the_same_number_at_every_pair(two_tasks):
    constant = potentials.constant_potential(two_tasks, -3)
    assert constant.dtype == float
    np.testing.assert_array_equal(constant, [[-3, -3]] * 3)  # observations 1, 2 and 3
