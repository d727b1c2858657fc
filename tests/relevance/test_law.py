"""The law rho_k = rho_inf + (rho_1 - rho_inf)/k, and the estimators that follow from it."""

from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.relevance.worlds import covariance, distribution, kinds, labels, seeds, world
from thesis_lib.relevance import (
    Solutions,
    cross_task_q,
    domain_relevance,
    estimate,
    finite_domain,
    ground,
    k_relevance,
    law,
    relevance,
)
from thesis_lib.relevance.estimators import compare


def two_tasks() -> Solutions:
    """Two tasks on two equally likely pairs with Q = (1, -1) and (-1, 3)."""
    return Solutions(
        np.array([[1.0, -1.0], [-1.0, 3.0]]), np.full((2, 2), 0.5), np.array([[0], [1]]), ("x",)
    )


def test_two_tasks_by_hand() -> None:
    # Removing x merges the pairs.  B_11 = Var(1, -1) = 1, B_22 = Var(-1, 3) = 4 and
    # B_12 = E[Q1 Q2] - E[Q1] E[Q2] = (-1 - 3)/2 - 0 = -2.
    solutions, y = two_tasks(), [0, 0]
    np.testing.assert_allclose(covariance(solutions, y), [[1, -2], [-2, 4]])
    assert law(covariance(solutions, y)) == (-2, 2.5)
    # rho_1 = 5/2; Q_d = (0, 1), so rho_inf = 1/4; rho_2 = (1 + 4 + 2 * 1/4) / 4 = 11/8.
    np.testing.assert_allclose(k_relevance(solutions, y, [1, 2]), [2.5, 1.375])
    assert domain_relevance(solutions, y) == pytest.approx(0.25)
    # Two different tasks out of the domain's two: rho_inf = U/2 + b/2.
    assert finite_domain(-2, 2.5, 2) == pytest.approx(0.25)
    # V_2 = 1/4, mean of one left out 5/2: J = 2/4 - 5/2 = -2 = U; F = V_2 / (5/2 - 1/4).
    found = estimate(solutions, y)
    assert found.observed == pytest.approx(0.25)
    assert found.domain == pytest.approx(-2)
    assert found.spread == pytest.approx(4.5)
    assert found.f_ratio == pytest.approx(1 / 9)


@settings(deadline=None, max_examples=200)
@given(seed=seeds, n_tasks=st.integers(1, 5))
def test_law_of_k_relevance(seed: int, n_tasks: int) -> None:
    solutions = world(seed, "shared", n_tasks)
    y, D = labels(seed, solutions.n_pairs), distribution(seed, n_tasks)
    B = covariance(solutions, y)
    first, limit = D @ np.diag(B), D @ B @ D
    assert domain_relevance(solutions, y, distribution=D) == pytest.approx(limit, abs=1e-12)
    assert first - limit >= -1e-12
    # The definition's sum over all |M|^k sequences, with Q_c the mean of its tasks' Q.
    for k in (1, 2, 3):
        total = sum(
            D[list(c)].prod() * B[np.ix_(c, c)].mean() for c in product(range(n_tasks), repeat=k)
        )
        assert total == pytest.approx(limit + (first - limit) / k, abs=1e-12)
        assert k_relevance(solutions, y, k, distribution=D) == pytest.approx(total, abs=1e-12)


@settings(deadline=None, max_examples=100)
@given(seed=seeds, n_tasks=st.integers(2, 6))
def test_law_of_combinations(seed: int, n_tasks: int) -> None:
    solutions = world(seed, "shared", n_tasks)
    y = labels(seed, solutions.n_pairs)
    U, b = law(covariance(solutions, y))
    for k in range(1, n_tasks + 1):
        values = [
            relevance(y, *cross_task_q(solutions, c)) for c in combinations(range(n_tasks), k)
        ]
        assert np.mean(values) == pytest.approx(U + (b - U) / k, abs=1e-11)


@settings(deadline=None, max_examples=50)
@given(seed=seeds, n=st.integers(2, 4))
def test_u_is_unbiased_over_all_sequences(seed: int, n: int) -> None:
    # Every sequence of n tasks that can be observed, with its probability.
    solutions = world(seed, "shared", 3)
    y, D = labels(seed, solutions.n_pairs), distribution(seed, 3)
    B = covariance(solutions, y)
    mean_u = mean_b = 0.0
    for c in product(range(3), repeat=n):
        U, b = law(B[np.ix_(c, c)])
        mean_u += D[list(c)].prod() * U
        mean_b += D[list(c)].prod() * b
    assert mean_u == pytest.approx(domain_relevance(solutions, y, distribution=D), abs=1e-11)
    assert mean_b == pytest.approx(k_relevance(solutions, y, 1, distribution=D), abs=1e-11)


@settings(deadline=None, max_examples=50)
@given(seed=seeds, n=st.integers(2, 4))
def test_finite_domain_correction_is_unbiased(seed: int, n: int) -> None:
    solutions = world(seed, "shared", 5)
    y = labels(seed, solutions.n_pairs)
    B = covariance(solutions, y)
    estimates = [finite_domain(*law(B[np.ix_(c, c)]), 5) for c in combinations(range(5), n)]
    assert np.mean(estimates) == pytest.approx(domain_relevance(solutions, y), abs=1e-11)


@settings(deadline=None, max_examples=100)
@given(seed=seeds, kind=kinds, n=st.integers(2, 6))
def test_jackknife_by_leaving_out_each_task(seed: int, kind: str, n: int) -> None:
    solutions = world(seed, kind, n)
    y = labels(seed, solutions.n_pairs)
    everything = relevance(y, *cross_task_q(solutions))
    without = [
        relevance(y, *cross_task_q(solutions, [j for j in range(n) if j != i])) for i in range(n)
    ]
    found = estimate(solutions, y)
    assert found.observed == pytest.approx(everything, abs=1e-11)
    assert found.domain == pytest.approx(n * everything - (n - 1) * np.mean(without), abs=1e-10)
    if kind == "shared":
        U, b = law(covariance(solutions, y))
        assert found.domain == pytest.approx(U, abs=1e-11)
        assert found.spread == pytest.approx(b - U, abs=1e-11)


def test_jackknife_removes_the_leading_bias_of_unshared_tasks() -> None:
    # Exact bias over all sequences of n tasks: that of V_n falls like 1/n, that of J faster.
    solutions = world(11, "weights", 3)
    y = labels(11, solutions.n_pairs)
    limit = domain_relevance(solutions, y)
    bias = {}
    for n in (3, 6):
        estimates = [estimate(solutions.take(c), y) for c in product(range(3), repeat=n)]
        bias[n] = (
            abs(np.mean([e.observed for e in estimates]) - limit),
            abs(np.mean([e.domain for e in estimates]) - limit),
        )
    assert bias[6][0] == pytest.approx(bias[3][0] / 2, rel=0.2)
    assert bias[6][1] < bias[3][1] / 3
    assert bias[6][1] < bias[6][0] / 5


@settings(deadline=None, max_examples=60)
@given(seed=seeds, kind=kinds)
def test_increments_add_up(seed: int, kind: str) -> None:
    solutions = world(seed, kind, 4, sizes=(2, 2, 3))
    finer = labels(seed, solutions.n_pairs, 5)
    coarser = finer // 2
    whole = estimate(solutions, coarser)
    first, second = estimate(solutions, finer), estimate(solutions, coarser, finer)
    assert first.observed + second.observed == pytest.approx(whole.observed, abs=1e-10)
    assert first.domain + second.domain == pytest.approx(whole.domain, abs=1e-10)


def test_f_ratio_at_its_edges() -> None:
    constant = Solutions(np.ones((3, 2)), np.full((3, 2), 0.5), np.array([[0], [1]]), ("x",))
    assert estimate(constant, [0, 0]).f_ratio == 0
    same = Solutions(
        np.tile([1.0, -1.0], (3, 1)), np.full((3, 2), 0.5), np.array([[0], [1]]), ("x",)
    )
    assert estimate(same, [0, 0]).f_ratio == np.inf
    # Two tasks on one pair each: relevance grows with the tasks, from 0.
    grows = Solutions(np.diag([1.0, 2.0]), np.eye(2), np.array([[0], [1]]), ("x",))
    assert estimate(grows, [0, 0]).spread < 0
    assert estimate(grows, [0, 0]).f_ratio == np.inf


def test_bad_input_is_refused() -> None:
    unshared = world(0, "weights")
    with pytest.raises(ValueError, match="at least 2"):
        estimate(unshared.take([0]), [0] * 6)
    with pytest.raises(ValueError, match="square matrix"):
        law(np.ones((1, 1)))
    with pytest.raises(ValueError, match="finer than the abstraction"):
        estimate(unshared, [0, 0, 0, 1, 1, 1], [0, 0, 1, 1, 2, 2])
    with pytest.raises(ValueError, match="n_domain is 0"):
        finite_domain(1, 1, 0)
    with pytest.raises(ValueError, match="at least"):
        compare(ground(unshared.take([1])), ground(unshared.take([1])).total())


def test_domain_relevance_has_no_unbiased_estimate_where_weights_differ() -> None:
    """The mean of any function of n tasks is a polynomial of degree n in their chances."""
    t = np.linspace(0, 1, 41)

    def misfit(p: list[list[float]], n: int) -> float:
        q = np.array([[1.0, 0.0], [3.0, -2.0]])
        solutions = Solutions(q, np.array(p), np.arange(2)[:, None], ("x",))
        merged = np.zeros(2, dtype=np.int64)
        rho = [domain_relevance(solutions, merged, distribution=[1 - s, s]) for s in t]
        rest = np.polynomial.Polynomial.fit(t, rho, n)(t) - rho
        return float(np.abs(rest).max() / np.max(rho))

    # One p: a quadratic, so two tasks are enough.  Two: no n is, and the misfit only fades.
    assert misfit([[0.5, 0.5], [0.5, 0.5]], 2) < 1e-12
    fits = [misfit([[1.0, 0.0], [0.5, 0.5]], n) for n in (2, 4, 8)]
    assert fits[0] > fits[1] > fits[2] > 1e-9
