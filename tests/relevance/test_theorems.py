"""Every statement of section 4.1.2 and appendix B, and what holds where one does not.

Statements are checked over thousands of random domains; a statement that fails has a
counterexample that can be checked by hand, in exact fractions.
"""

from fractions import Fraction
from itertools import combinations_with_replacement, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.relevance.worlds import (
    Task,
    as_solutions,
    distribution,
    exact_k_relevance,
    exact_relevance,
    kinds,
    labels,
    seeds,
    uniform_task,
    world,
)
from thesis_lib.relevance import (
    Solutions,
    cross_task_q,
    domain_relevance,
    k_relevance,
    rate,
    relevance,
    sequence_covariance,
)

N_DOMAINS = 2000
K = np.arange(1, 21)


def curves(kind: str, n_domains: int = N_DOMAINS) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """rho_k for k = 1 .. 20, the limit and the rate, of random domains, abstractions and D."""
    rows, limits, rates = [], [], []
    for seed in range(n_domains):
        solutions = world(seed, kind, n_tasks=2 + seed % 4)
        y, D = labels(seed, solutions.n_pairs), distribution(seed, solutions.n_tasks)
        rows.append(k_relevance(solutions, y, K, distribution=D))
        limits.append(domain_relevance(solutions, y, distribution=D))
        rates.append(rate(solutions, y, distribution=D))
    return np.array(rows), np.array(limits), np.array(rates)


@pytest.fixture(scope="module")
def shared() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return curves("shared")


@pytest.fixture(scope="module")
def unshared() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return tuple(
        np.concatenate(parts)
        for parts in zip(curves("subsets", 1000), curves("weights", 1000), strict=True)
    )


# Theorem 2.

OPPOSITE: tuple[Task, Task] = (uniform_task(x=1, y=-1), uniform_task(x=-1, y=1))
MERGED = {"x": 0, "y": 0}


def test_theorem_2_no_constant_serves_all_k() -> None:
    # Two tasks with opposite values: Q_c = (d, -d) with d the mean of k signs, so
    # rho_k = E d^2 = 1/k.  Steps are -1/(k(k-1)) and their ratio is (k-1)/(k+1).
    rho = [exact_k_relevance(MERGED, OPPOSITE, k) for k in range(1, 8)]
    assert rho == [Fraction(1, k) for k in range(1, 8)]
    step = np.diff(rho)
    for k in range(2, 7):
        assert step[k - 1] / step[k - 2] == Fraction(k - 1, k + 1)
    # The ratio passes any constant below 1: at k = 2000 it is above .999.
    solutions, _ = as_solutions(OPPOSITE)
    late = np.diff(k_relevance(solutions, [0, 0], np.array([1999, 2000, 2001])))
    assert late[1] / late[0] > 0.999


def test_theorem_2_corrected_for_shared_p(shared: tuple) -> None:
    # |rho_{k+1} - rho_k| = (k-1)/(k+1) |rho_k - rho_{k-1}|, less unless both are 0.
    rho, limit, _ = shared
    step = np.diff(rho, axis=1)
    np.testing.assert_allclose(
        step[:, 1:], step[:, :-1] * (K[1:-1] - 1) / (K[1:-1] + 1), atol=1e-12
    )
    np.testing.assert_allclose(rho, limit[:, None] + (rho[:, :1] - limit[:, None]) / K, atol=1e-12)


# Task 1 is worth 0 on three pairs, task 2 is worth 3 and 1 on two of them.
GROWING_STEP: tuple[Task, Task] = (uniform_task(x=0, y=0, z=0), uniform_task(x=3, y=1))


def test_theorem_2_steps_can_grow_when_p_is_not_shared() -> None:
    cell = {"x": 0, "y": 0, "z": 0}
    one, two = GROWING_STEP
    # By hand, with lambda the share of task 2: relevance 0, 17/63, 1/2, 13/18, 1 at
    # lambda = 0, 1/3, 1/2, 2/3, 1.
    assert exact_relevance(cell, [one]) == 0
    assert exact_relevance(cell, [one, one, two]) == Fraction(17, 63)
    assert exact_relevance(cell, [one, two]) == Fraction(1, 2)
    assert exact_relevance(cell, [one, two, two]) == Fraction(13, 18)
    assert exact_relevance(cell, [two]) == 1
    rho = [exact_k_relevance(cell, GROWING_STEP, k) for k in (1, 2, 3)]
    # rho_1 = rho_2 but rho_3 differs: the step grows from 0, and since f(rho_1) = rho_2 and
    # f(rho_2) = rho_3 with rho_1 = rho_2, there is no function f at all.
    assert rho == [Fraction(1, 2), Fraction(1, 2), Fraction(167, 336)]
    solutions, _ = as_solutions(GROWING_STEP)
    np.testing.assert_allclose(k_relevance(solutions, [0, 0, 0], [1, 2, 3]), [0.5, 0.5, 167 / 336])


def test_theorem_2_fails_in_a_share_of_unshared_domains(unshared: tuple) -> None:
    step = np.abs(np.diff(unshared[0], axis=1))
    grows = (step[:, 1:] > step[:, :-1] + 1e-10).any(axis=1)
    assert 0.05 < grows.mean() < 0.5


def test_theorem_2_ratio_of_steps_tends_to_one_when_p_is_not_shared() -> None:
    for seed in range(200):
        solutions = world(seed, "weights", 3)
        y = labels(seed, 6)
        if abs(rate(solutions, y)) < 0.05:
            continue
        step = np.diff(k_relevance(solutions, y, np.array([1000, 1001, 1002])))
        assert step[1] / step[0] == pytest.approx(1, abs=0.02)


def test_f_is_no_function_of_relevance_across_abstractions() -> None:
    # The step depends on the abstraction as well: two with rho_1 = 1 and different rho_2.
    same: tuple[Task, Task] = (uniform_task(x=1, y=-1), uniform_task(x=1, y=-1))
    assert exact_k_relevance(MERGED, same, 1) == exact_k_relevance(MERGED, OPPOSITE, 1) == 1
    assert exact_k_relevance(MERGED, same, 2) == 1
    assert exact_k_relevance(MERGED, OPPOSITE, 2) == Fraction(1, 2)


# Corollary 1.


@pytest.mark.parametrize("case", ["shared", "unshared"])
def test_corollary_1_limit_is_the_domain_relevance(
    case: str, request: pytest.FixtureRequest
) -> None:
    rho, limit, _ = request.getfixturevalue(case)
    # The distance falls like 1/k: between k = 10 and k = 20 it about halves, in the mean.
    distance = np.abs(rho - limit[:, None])
    assert distance[:, 19].mean() < 0.6 * distance[:, 9].mean()


@pytest.mark.parametrize("kind", ["shared", "subsets", "weights"])
def test_corollary_1_at_a_million(kind: str) -> None:
    for seed in range(100):
        solutions = world(seed, kind, 4)
        y = labels(seed, 6)
        far = k_relevance(solutions, y, 10**6)
        assert far == pytest.approx(domain_relevance(solutions, y), abs=2e-4)


# Theorem 3.


def test_theorem_3_holds_and_never_increases(shared: tuple) -> None:
    assert (np.diff(shared[0], axis=1) <= 1e-12).all()


def test_theorem_3_needs_a_shared_p() -> None:
    # Two tasks on one pair each, worth 1 and -1: relevance grows, as 1 - 1/k.
    apart = (uniform_task(x=1), uniform_task(y=-1))
    rho = [exact_k_relevance(MERGED, apart, k) for k in range(1, 6)]
    assert rho == [1 - Fraction(1, k) for k in range(1, 6)]


def test_theorem_3_fails_both_ways_in_unshared_domains(unshared: tuple) -> None:
    step = np.diff(unshared[0], axis=1)
    rises, falls = (step > 1e-10).any(axis=1), (step < -1e-10).any(axis=1)
    assert (rises & ~falls).mean() > 0.1
    assert (falls & ~rises).mean() > 0.1
    assert (rises & falls).mean() > 0.01


# Equations B.1 to B.4.


@settings(deadline=None, max_examples=200)
@given(seed=seeds, kind=kinds)
def test_b1_and_b2_rewrite_the_cross_task_q(seed: int, kind: str) -> None:
    solutions = world(seed, kind)
    c = [0, 1, 1, 2]
    q, p = cross_task_q(solutions, c)
    seen = p > 0
    scaled = rescaled(solutions, c)
    np.testing.assert_allclose(scaled.mean(axis=0)[seen], q[seen], atol=1e-9)


def rescaled(solutions: Solutions, c: list[int]) -> np.ndarray:
    """Q^c_{c_i}(x) of equation B.2, 0 outside the task's pairs, shape (k, N)."""
    p, q = solutions.p[c], np.nan_to_num(solutions.q[c])
    mean = p.mean(axis=0)
    return np.divide(p, mean, out=np.zeros_like(p), where=mean > 0) * q


def test_b4_as_printed_is_not_the_relevance() -> None:
    # Task 1 visits x and y, task 2 only x, and nothing is merged but x and y (z apart).
    # Task 2 spends half its time in z, so it visits the abstract pair {x, y} half as often.
    tasks = (uniform_task(x=1, y=-1), uniform_task(x=1, z=0))
    cell = {"x": 0, "y": 0, "z": 1}
    # p(y|c) = 3/4; Q_c = 1 on x (mass 1/2) and -1 on y (mass 1/4): Var = 8/9, rho = 2/3.
    assert exact_relevance(cell, tasks) == Fraction(2, 3)
    solutions, pairs = as_solutions(tasks)
    y = [cell[x] for x in pairs]
    assert sequence_covariance(solutions, y, [0, 1]).mean() == pytest.approx(2 / 3)
    # As printed: the functions (p(x|y,c_i)/p(x|y,c)) Q are (3/4, -3/2) and (3/2, 0) under
    # p(.|y) = (2/3, 1/3): their mean (9/8, -3/4) has variance 25/32, times 3/4.
    printed = sequence_covariance(solutions, y, [0, 1], as_printed=True).mean()
    assert printed == pytest.approx(75 / 128)


@settings(deadline=None, max_examples=200)
@given(seed=seeds)
def test_b4_holds_where_tasks_visit_abstract_pairs_equally_often(seed: int) -> None:
    # Any p within the cells, but the same mass 1/2 on each of two cells.
    rng = np.random.default_rng(seed)
    p = np.concatenate([rng.dirichlet(np.ones(3), 3), rng.dirichlet(np.ones(3), 3)], axis=1) / 2
    solutions = Solutions(rng.normal(size=(3, 6)), p, np.arange(6)[:, None], ("x",))
    y = [0, 0, 0, 1, 1, 1]
    printed = sequence_covariance(solutions, y, [0, 1, 2], as_printed=True).mean()
    assert printed == pytest.approx(relevance(y, *cross_task_q(solutions)), abs=1e-12)


# Lemma 1.


@settings(deadline=None, max_examples=300)
@given(seed=seeds, kind=kinds)
def test_lemma_1(seed: int, kind: str) -> None:
    solutions = world(seed, kind)
    c = [0, 1, 1, 2]
    mean = solutions.p[c].mean(axis=0)
    np.testing.assert_allclose(
        rescaled(solutions, c) @ mean,
        (solutions.p[c] * np.nan_to_num(solutions.q[c])).sum(axis=1),
        atol=1e-9,
    )


# Lemma 2.

EVEN: tuple[Task, Task] = (uniform_task(x=1, y=1), uniform_task(x=1, y=-1))


def product_mean(tasks: tuple[Task, ...], i: int, j: int) -> Fraction:
    """E[Q^c_i Q^c_j] of lemma 2."""
    total = Fraction(0)
    for x in {x for task in tasks for x in task}:
        p = sum((task[x][0] for task in tasks if x in task), Fraction(0)) / len(tasks)
        if x in tasks[i] and x in tasks[j]:
            (pi, qi), (pj, qj) = tasks[i][x], tasks[j][x]
            total += pi * pj / p * qi * qj
    return total


def test_lemma_2_fails_for_products_of_mixed_sign() -> None:
    # E[Q1 Q2] = (1 - 1)/2 = 0.  After a task that visits only x, p(x|c) = 2/3 and
    # p(y|c) = 1/3, and the products weigh 3/8 and -3/4: the mean is -3/8, not within 3/2 * 0.
    assert product_mean(EVEN, 0, 1) == 0
    assert product_mean((*EVEN, uniform_task(x=0)), 0, 1) == Fraction(-3, 8)


def test_lemma_2_says_nothing_about_covariances() -> None:
    # Cov = E[Q Q] - E[Q] E[Q], and only the first term changes: with Q_1 = Q_2 = 1 on x and y
    # Cov(Q_1, Q_2) = 0, but 1/4 * 3/2 + 1/4 * 3 - 1 = 1/8 after the task on x is appended.
    ones = (uniform_task(x=1, y=1), uniform_task(x=1, y=1))
    assert product_mean(ones, 0, 1) - 1 == 0
    assert product_mean((*ones, uniform_task(x=0)), 0, 1) - 1 == Fraction(1, 8)


@settings(deadline=None, max_examples=300)
@given(seed=seeds, kind=kinds, m=st.integers(0, 2))
def test_lemma_2_corrected_holds_for_absolute_products(seed: int, kind: str, m: int) -> None:
    # E|Q_i Q_j| grows by at most (k+1)/k, and so does E[Q_i^2]: the ratio of weights, pair
    # by pair, is (k p(x|c) + p(x|c)) / (k p(x|c) + p(x|m)) (equation B.6).
    solutions = world(seed, kind)
    c = [0, 1, 2]
    mean = solutions.p[c].mean(axis=0)
    before = np.abs(rescaled(solutions, c))
    after = np.abs(rescaled(solutions, [*c, m]))[:3]
    mean_after = solutions.p[[*c, m]].mean(axis=0)
    old = (before * mean) @ before.T
    new = (after * mean_after) @ after.T
    assert (new >= 0).all()
    assert (new <= 4 / 3 * old + 1e-9).all()


# Lemma 3.


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_lemma_3_by_counting(n: int) -> None:
    # New elements of the covariance matrix when a k-th task is appended, in all n ways.
    previous = None
    for k in range(2, 6):
        for counts in combinations_with_replacement(range(n), k - 1):
            new = [2 * counts.count(m) + 1 for m in range(n)]
            ratio = Fraction(sum(new), n * (2 * k - 1))
            assert ratio == Fraction(2 * (k - 1) + n, n * (2 * k - 1))
        # It decreases with k, unless there is one task only, when it is always 1.
        if previous is not None:
            assert ratio == previous if n == 1 else ratio < previous
        previous = ratio


def test_lemma_3_counts_sequences_as_if_all_were_equally_likely() -> None:
    # With D = (3/4, 1/4) the expected share of equal pairs among the new elements is
    # (1 + 2(k-1) sum D^2)/(2k-1): sum D^2 = 5/8 takes the place of 1/N = 1/2.
    D = (Fraction(3, 4), Fraction(1, 4))
    for k in (2, 3, 4):
        share = sum(
            np.prod([D[i] for i in c]) * Fraction(2 * c[:-1].count(c[-1]) + 1, 2 * k - 1)
            for c in product(range(2), repeat=k)
        )
        assert share == (1 + 2 * (k - 1) * Fraction(5, 8)) / (2 * k - 1)


def test_proof_of_theorem_3_type_1_frequencies_change_with_k() -> None:
    # "The frequency ... does not change ... for the type 1 covariances" fails for unequal D:
    # task m stands for k D_m + k(k-1) D_m^2 of the elements, so 3 : 1 at k = 1 tends to 9 : 1.
    D = (Fraction(3, 4), Fraction(1, 4))

    def share(m: int, k: int) -> Fraction:
        return sum(
            np.prod([D[i] for i in c]) * Fraction(c.count(m) ** 2, k**2)
            for c in product(range(2), repeat=k)
        )

    def expected(m: int, k: int) -> Fraction:
        return D[m] / k + (1 - Fraction(1, k)) * D[m] ** 2

    for k in (1, 2, 3):
        assert share(0, k) == expected(0, k)
        assert share(1, k) == expected(1, k)
    assert share(0, 1) / share(1, 1) == 3
    assert share(0, 3) / share(1, 3) > 3
