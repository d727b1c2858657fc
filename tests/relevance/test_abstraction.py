"""Abstractions and relevance of one Q-function (definitions 1 to 4)."""

import numpy as np
import pytest
from hypothesis import given, settings

from tests.relevance.worlds import (
    as_solutions,
    exact_relevance,
    forward_relevance,
    kinds,
    labels,
    seeds,
    uniform_task,
    world,
)
from thesis_lib.relevance import (
    abstract_q,
    abstraction_error,
    cross_task_q,
    relevance,
    relevance_by_variance,
)

# Worked by hand: two abstract pairs, of probability 3/4 and 1/4.
LABELS = [7, 7, 2]
Q = [1.0, 4.0, 10.0]
P = [0.5, 0.25, 0.25]


def test_abstract_values_and_errors_by_hand() -> None:
    # The labels in order: 2 (the pair with Q = 10), then 7 (1 and 4 with weights 2/3, 1/3).
    np.testing.assert_allclose(abstract_q(LABELS, Q, P), [10, 2])
    np.testing.assert_allclose(abstraction_error(LABELS, Q, P), [0, 2 / 3 * 1 + 1 / 3 * 4])
    assert relevance(LABELS, Q, P) == pytest.approx(0.75 * 2)
    assert relevance_by_variance(LABELS, Q, P) == pytest.approx(0.75 * 2)


def test_keeping_everything_loses_nothing() -> None:
    assert relevance([0, 1, 2], Q, P) == 0


def test_pairs_without_weight_are_not_read() -> None:
    assert relevance([0, 0, 0, 1], [*Q, np.nan], [*P, 0.0]) == pytest.approx(13.5)
    assert np.isnan(abstract_q([0, 0, 0, 1], [*Q, np.nan], [*P, 0.0])[1])


def test_cross_task_values_of_two_tasks_by_hand() -> None:
    # Task 0 visits x and y, task 1 only x, twice as often as task 0 does.
    solutions, pairs = as_solutions([uniform_task(x=4, y=10), uniform_task(x=1)])
    assert pairs == ["x", "y"]
    q, p = cross_task_q(solutions)
    np.testing.assert_allclose(q, [(0.5 * 4 + 1 * 1) / 1.5, 10])
    np.testing.assert_allclose(p, [0.75, 0.25])
    # Merging both: mean 0.75 * 2 + 0.25 * 10 = 4, variance 0.75 * 4 + 0.25 * 36 = 12.
    assert relevance([0, 0], q, p) == pytest.approx(12)
    # In the sequence (1, 0, 1) task 1 weighs twice: Q(x) = (2 + 2) / 2.5.
    q, p = cross_task_q(solutions, [1, 0, 1])
    np.testing.assert_allclose(q, [1.6, 10])
    np.testing.assert_allclose(p, [5 / 6, 1 / 6])
    # Task 1 alone never visits y.
    q, p = cross_task_q(solutions, [1])
    np.testing.assert_array_equal(q, [1, np.nan])


@settings(deadline=None, max_examples=200)
@given(seed=seeds, kind=kinds)
def test_definition_and_variance_form_agree(seed: int, kind: str) -> None:
    solutions = world(seed, kind)
    y = labels(seed, solutions.n_pairs)
    q, p = cross_task_q(solutions, [0, 1, 1])
    scale = relevance(np.zeros_like(y), q, p)
    assert abs(relevance(y, q, p) - relevance_by_variance(y, q, p)) <= 1e-12 * scale
    # Law of total variance: what is explained and what is lost add up.
    assert relevance(y, q, p) + forward_relevance(y, q, p) == pytest.approx(scale, rel=1e-12)


def test_the_two_forms_agree_far_from_zero() -> None:
    # Returns near -1000, as on the cliff, differing by single steps.
    rng = np.random.default_rng(0)
    q = -1000 + rng.integers(0, 3, 500).astype(float)
    p = rng.dirichlet(np.ones(500))
    y = rng.integers(0, 20, 500)
    assert relevance(y, q, p) == pytest.approx(relevance_by_variance(y, q, p), rel=1e-12)


def test_relevance_matches_exact_fractions() -> None:
    tasks = [uniform_task(x=3, y=-1, z=2), uniform_task(x=0, z=5)]
    cell = {"x": 0, "y": 0, "z": 1}
    solutions, pairs = as_solutions(tasks)
    y = [cell[x] for x in pairs]
    for c in ([0], [1], [0, 1], [0, 1, 1]):
        expected = exact_relevance(cell, [tasks[i] for i in c])
        assert relevance(y, *cross_task_q(solutions, c)) == pytest.approx(float(expected))


@pytest.mark.parametrize(
    ("y", "q", "p", "message"),
    [
        ([0, 0], Q, P, "one integer for each of the 3"),
        ([0.0, 0.5, 1.0], Q, P, "type float64"),
        (LABELS, Q[:2], P, r"shape \(2,\)"),
        (LABELS, Q, [0.5, 0.5, 0.5], "sums to 1.5"),
        (LABELS, [1, np.nan, 2], P, "pair 1 is nan"),
    ],
)
def test_bad_input_is_refused(y: list, q: list, p: list, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        relevance(y, q, p)
