"""k-relevance exactly, for every k: against its definition, exact fractions, and its limit."""

from fractions import Fraction
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.relevance.worlds import (
    KINDS,
    Task,
    as_solutions,
    distribution,
    exact_k_relevance,
    exact_relevance,
    forward_relevance,
    kinds,
    labels,
    seeds,
    uniform_task,
    world,
)
from thesis_lib.relevance import (
    Solutions,
    brute_force_k_relevance,
    cross_task_q,
    domain_relevance,
    k_relevance,
    list_sequences,
    rate,
    relevance,
    remove,
    second_rate,
)
from thesis_lib.relevance.cells import Cells
from thesis_lib.relevance.exact import explained_combinations, explained_sequences

# Tasks of different sizes that share some pairs: all three cases of the formula occur.
TASKS = [uniform_task(x=3, y=-1, z=2), uniform_task(x=0, z=5), uniform_task(w=4)]
CELL = {"w": 0, "x": 0, "y": 1, "z": 1}


@settings(deadline=None, max_examples=150)
@given(seed=seeds, kind=kinds, n_tasks=st.integers(1, 4), k=st.integers(1, 4))
def test_the_exact_formula_is_the_definition(seed: int, kind: str, n_tasks: int, k: int) -> None:
    solutions = world(seed, kind, n_tasks)
    y, D = labels(seed, solutions.n_pairs), distribution(seed, n_tasks)
    exact = k_relevance(solutions, y, k, distribution=D)
    assert exact == pytest.approx(brute_force_k_relevance(solutions, y, k, D), abs=1e-11)


@settings(deadline=None, max_examples=100)
@given(seed=seeds, kind=kinds, k=st.integers(1, 3))
def test_forward_k_relevance_is_its_definition(seed: int, kind: str, k: int) -> None:
    solutions = world(seed, kind)
    y, D = labels(seed, solutions.n_pairs), distribution(seed, 3)
    sequences, probability = list_sequences(3, k, D)
    values = [forward_relevance(y, *cross_task_q(solutions, c)) for c in sequences]
    exact = k_relevance(solutions, y, k, distribution=D, direction="forward")
    assert exact == pytest.approx(probability @ values, abs=1e-11)


@settings(deadline=None, max_examples=150)
@given(seed=seeds, kind=kinds, n_tasks=st.integers(1, 6))
def test_combinations_without_replacement(seed: int, kind: str, n_tasks: int) -> None:
    solutions = world(seed, kind, n_tasks)
    y = labels(seed, solutions.n_pairs)
    for k in range(1, n_tasks + 1):
        values = [
            relevance(y, *cross_task_q(solutions, c)) for c in combinations(range(n_tasks), k)
        ]
        exact = k_relevance(solutions, y, k, replacement=False)
        assert exact == pytest.approx(np.mean(values), abs=1e-11)


@pytest.mark.parametrize("k", [1, 2, 3, 4, 5, 6])
def test_exact_fractions(k: int) -> None:
    solutions, pairs = as_solutions(TASKS)
    expected = float(exact_k_relevance(CELL, TASKS, k))
    got = k_relevance(solutions, [CELL[x] for x in pairs], k)
    assert got == pytest.approx(expected, rel=1e-13)


def random_task(rng: np.random.Generator) -> Task:
    chosen = [x for x in "uvwxyz" if rng.random() < 0.6] or ["u"]
    weight = [int(rng.integers(1, 1000)) ** 2 for _ in chosen]
    return {
        x: (Fraction(w, sum(weight)), Fraction(int(rng.integers(-9, 10))))
        for x, w in zip(chosen, weight, strict=True)
    }


@pytest.mark.parametrize("seed", range(5))
def test_quadrature_reaches_rounding_error(seed: int) -> None:
    # Weights that differ by up to a million, against exact fractions.
    rng = np.random.default_rng(seed)
    tasks = [random_task(rng) for _ in range(3)]
    cell = {x: i % 2 for i, x in enumerate("uvwxyz")}
    solutions, pairs = as_solutions(tasks)
    y = [cell[x] for x in pairs]
    for k in (1, 2, 5):
        expected = float(exact_k_relevance(cell, tasks, k))
        assert k_relevance(solutions, y, k) == pytest.approx(expected, abs=1e-12)
        if k <= 3:
            subsets = [exact_relevance(cell, c) for c in combinations(tasks, k)]
            expected = float(sum(subsets, Fraction(0)) / len(subsets))
            got = k_relevance(solutions, y, k, replacement=False)
            assert got == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_many_k_at_once_are_the_same_as_one_by_one(kind: str) -> None:
    solutions = world(1, kind, 6)
    y = labels(1, solutions.n_pairs)
    ks = np.array([[1, 2], [6, 4]])
    for replacement in (True, False):
        together = k_relevance(solutions, y, ks, replacement=replacement)
        assert together.shape == (2, 2)
        alone = [k_relevance(solutions, y, int(k), replacement=replacement) for k in ks.flat]
        np.testing.assert_allclose(together.ravel(), alone, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_limit_is_the_relevance_on_the_domains_q(kind: str) -> None:
    solutions = world(2, kind, 4)
    y, D = labels(2, solutions.n_pairs), np.array([0.5, 0.25, 0.125, 0.125])
    # D is that of a sequence of eight tasks, so Q_d is the Q of that sequence.
    q, p = cross_task_q(solutions, [0, 0, 0, 0, 1, 1, 2, 3])
    limit = domain_relevance(solutions, y, distribution=D)
    assert limit == pytest.approx(relevance(y, q, p), abs=1e-12)
    forward = domain_relevance(solutions, y, distribution=D, direction="forward")
    assert forward == pytest.approx(forward_relevance(y, q, p), abs=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_approach_to_the_limit_has_the_stated_rate(kind: str) -> None:
    solutions = world(5, kind, 4)
    y, D = labels(5, solutions.n_pairs), distribution(5, 4)
    limit = domain_relevance(solutions, y, distribution=D)
    k = np.array([1000, 2000])
    left = k * (k_relevance(solutions, y, k, distribution=D) - limit)
    # k (rho_k - rho_inf) = c + O(1/k): one Richardson step removes the O(1/k).
    assert 2 * left[1] - left[0] == pytest.approx(rate(solutions, y, distribution=D), abs=1e-4)


def test_a_million_tasks_cost_no_more_than_one() -> None:
    solutions = world(0, "weights", 5)
    y = labels(0, solutions.n_pairs)
    far = k_relevance(solutions, y, 10**6)
    assert far == pytest.approx(
        domain_relevance(solutions, y) + rate(solutions, y) / 10**6, abs=1e-10
    )


@pytest.mark.parametrize("kind", KINDS)
def test_all_tasks_combined_are_the_observed_relevance(kind: str) -> None:
    solutions = world(7, kind, 5)
    y = labels(7, solutions.n_pairs)
    observed = relevance(y, *cross_task_q(solutions))
    assert k_relevance(solutions, y, 5, replacement=False) == pytest.approx(observed, abs=1e-12)


def test_blocks_of_cells_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    solutions = world(0, "weights", 4)
    y = labels(0, solutions.n_pairs)
    whole = [k_relevance(solutions, y, [1, 3], replacement=r) for r in (True, False)]
    monkeypatch.setattr("thesis_lib.relevance.exact.BLOCK", 1)
    blocks = [k_relevance(solutions, y, [1, 3], replacement=r) for r in (True, False)]
    np.testing.assert_allclose(whole, blocks, atol=1e-12)


def test_tasks_of_probability_zero_do_not_count() -> None:
    solutions = world(3, "weights", 4)
    y = labels(3, solutions.n_pairs)
    with_zero = k_relevance(solutions, y, [1, 2, 5], distribution=[0.5, 0, 0.5, 0])
    np.testing.assert_allclose(with_zero, k_relevance(solutions.take([0, 2]), y, [1, 2, 5]))


# Invariances.


@settings(deadline=None, max_examples=60)
@given(seed=seeds, kind=kinds)
def test_permuting_tasks_relabelling_values_and_shifting_q_change_nothing(
    seed: int, kind: str
) -> None:
    solutions = world(seed, kind, 4)
    rng = np.random.default_rng(seed)
    order = rng.permutation(4)
    D = distribution(seed, 4)
    relabelled = solutions.features.copy()
    for f, size in enumerate((2, 3)):
        relabelled[:, f] = rng.permutation(size)[relabelled[:, f]] * 7 - 3
    other = Solutions(
        solutions.q[order] + 13.0, solutions.p[order], relabelled, solutions.feature_names
    )
    for name in solutions.feature_names:
        np.testing.assert_allclose(
            k_relevance(other, remove(other, [name]), [1, 2, 3], distribution=D[order]),
            k_relevance(solutions, remove(solutions, [name]), [1, 2, 3], distribution=D),
            atol=1e-11,
        )


@settings(deadline=None, max_examples=60)
@given(seed=seeds, kind=kinds)
def test_constant_and_duplicate_features_are_irrelevant(seed: int, kind: str) -> None:
    solutions = world(seed, kind)
    f0 = solutions.features[:, 0]
    wide = Solutions(
        solutions.q,
        solutions.p,
        np.column_stack([solutions.features, np.full_like(f0, 4), 1 - f0]),
        (*solutions.feature_names, "constant", "duplicate"),
    )
    k = [1, 2, 3]
    for name in ("constant", "duplicate", "f0"):
        np.testing.assert_allclose(k_relevance(wide, remove(wide, [name]), k), 0, atol=1e-12)
    both = k_relevance(wide, remove(wide, ["f0", "duplicate", "constant"]), k)
    np.testing.assert_allclose(both, k_relevance(solutions, remove(solutions, ["f0"]), k))
    np.testing.assert_allclose(
        k_relevance(wide, remove(wide, ["f1", "constant"]), k),
        k_relevance(solutions, remove(solutions, ["f1"]), k),
    )


@settings(deadline=None, max_examples=60)
@given(seed=seeds, kind=kinds)
def test_relevance_grows_with_the_set_of_features_removed(seed: int, kind: str) -> None:
    solutions = world(seed, kind, sizes=(2, 2, 2))
    k = [1, 2, 5]
    one, two, three = (
        k_relevance(solutions, remove(solutions, names), k)
        for names in (["f0"], ["f0", "f2"], ["f0", "f1", "f2"])
    )
    assert (one >= -1e-12).all()
    assert (two - one >= -1e-12).all()
    assert (three - two >= -1e-12).all()


BAD = {
    "k is 0": ({"k": 0}, "at least 1"),
    "k is no integer": ({"k": 1.5}, "integers of at least 1"),
    "no k": ({"k": []}, "integers of at least 1"),
    "k above n": ({"k": 4, "replacement": False}, "only 3 tasks"),
    "D twice": ({"distribution": [0.5, 0.25, 0.25], "replacement": False}, "leave it out"),
    "D shape": ({"distribution": [0.5, 0.5]}, "each of the 3 tasks"),
    "D sum": ({"distribution": [0.5, 0.5, 0.5]}, "sums to 1.5"),
    "D negative": ({"distribution": [1.5, -0.5, 0]}, "smallest entry -0.5"),
    "direction": ({"direction": "sideways"}, "backward, forward"),
    "labels": ({"labels": [0, 1]}, "each of the 6"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_refused(case: str) -> None:
    change, message = BAD[case]
    arguments = {"labels": [0] * 6, "k": 1, **change}
    with pytest.raises(ValueError, match=message):
        k_relevance(world(0, "shared"), arguments.pop("labels"), arguments.pop("k"), **arguments)


@pytest.mark.parametrize("kind", KINDS)
def test_the_rest_after_the_rate_is_of_second_order(kind: str) -> None:
    """k^2 (rho_k - rho_inf - c/k), extrapolated in 1/k, against the coefficient derived."""
    for seed in range(4):
        solutions, y, D = world(seed, kind, 3), labels(seed, 6), distribution(seed, 3)
        k = np.array([400, 800])
        rho = k_relevance(solutions, y, k, distribution=D)
        limit = domain_relevance(solutions, y, distribution=D)
        rest = k**2 * (rho - limit - rate(solutions, y, distribution=D) / k)
        expected = second_rate(solutions, y, distribution=D)
        size = max(abs(expected), 0.1)
        assert abs(2 * rest[1] - rest[0] - expected) < 0.05 * size
    if kind == "shared":
        assert expected == pytest.approx(0, abs=1e-9)


# Two cells; the first task never visits the second, the last never the first.
APART = Cells(
    a=np.array([[1.0, 0.0], [2.0, 2.0], [0.0, 6.0]]),
    b=np.array([[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]]),
)
ALIKE = Cells(a=np.array([[1.0, 3.0], [2.0, -1.0]]), b=np.array([[0.25, 0.75]]))


def test_explained_mean_square_of_sequences_by_hand() -> None:
    # tasks 0 and 1; task 2 twice; task 0 twice and task 1
    counts = [[1, 1, 0], [0, 0, 2], [2, 1, 0]]
    by_hand = [(3**2 / 1.5 + 2**2 / 0.5) / 2, 12**2 / 2 / 2, (4**2 / 2.5 + 2**2 / 0.5) / 3]
    assert explained_sequences(APART, counts) == pytest.approx(by_hand)
    assert explained_sequences(ALIKE, [[1, 1]]) == pytest.approx((3**2 / 0.25 + 2**2 / 0.75) / 4)


def test_explained_mean_square_of_combinations_by_hand() -> None:
    alone = [1, 4 / 0.5 + 4 / 0.5, 36]
    pairs = [(9 / 1.5 + 4 / 0.5) / 2, (1 + 36) / 2, (4 / 0.5 + 64 / 1.5) / 2]
    whole = (9 / 1.5 + 64 / 1.5) / 3
    by_hand = [np.mean(alone), np.mean(pairs), whole]
    assert explained_combinations(APART, [1, 2, 3]) == pytest.approx(by_hand)
    alone = [1 / 0.25 + 9 / 0.75, 4 / 0.25 + 1 / 0.75]
    by_hand = [np.mean(alone), (9 / 0.25 + 4 / 0.75) / 4]
    assert explained_combinations(ALIKE, [1, 2]) == pytest.approx(by_hand)
