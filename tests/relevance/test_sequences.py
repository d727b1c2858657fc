"""Sequences listed and drawn, and the covariance matrices of figure 4.2."""

from math import comb

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.stats import binomtest

from tests.relevance.worlds import kinds, labels, seeds, world
from thesis_lib.relevance import (
    brute_force_k_relevance,
    cross_task_q,
    k_relevance,
    list_sequences,
    relevance,
    sample_combinations,
    sampled_k_relevance,
    sequence_covariance,
)
from thesis_lib.relevance.sequences import count_tasks


def test_areas_of_figure_42() -> None:
    # p1 = 1/2, p2 = p3 = 1/4: the areas printed beside the figure.
    D = [0.5, 0.25, 0.25]
    sequences, area = list_sequences(3, 2, D)
    assert sequences[1].tolist() == [0, 1]
    assert area[1] == 0.125
    for k in (1, 2, 3):
        sequences, area = list_sequences(3, k, D)
        assert len(area) == 3**k
        assert area.sum() == pytest.approx(1)
        # The share of single-task sequences, p1^k + p2^k + p3^k (section 4.1.2).
        single = (sequences == sequences[:, :1]).all(axis=1)
        assert area[single].sum() == pytest.approx(0.5**k + 2 * 0.25**k)
    # The areas that extend a sequence of length 2 add up to its own.
    np.testing.assert_allclose(
        list_sequences(3, 3, D)[1].reshape(9, 3).sum(axis=1), list_sequences(3, 2, D)[1]
    )


@settings(deadline=None, max_examples=100)
@given(seed=seeds, kind=kinds)
def test_mean_of_the_covariance_matrix_is_the_relevance(seed: int, kind: str) -> None:
    solutions = world(seed, kind)
    y = labels(seed, solutions.n_pairs)
    for c in ([0], [1, 2], [0, 1, 1]):
        matrix = sequence_covariance(solutions, y, c)
        np.testing.assert_allclose(matrix, matrix.T, atol=1e-12)
        expected = relevance(y, *cross_task_q(solutions, c))
        assert matrix.mean() == pytest.approx(expected, abs=1e-11)


def test_combinations_are_different_and_complete() -> None:
    assert sample_combinations(4, 2, 10, 0).tolist() == [
        *([0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3])
    ]
    for n, k in ((12, 5), (30, 12), (60, 30)):
        drawn = sample_combinations(n, k, 100, 0)
        assert drawn.shape == (100, k)
        assert len({tuple(row) for row in drawn.tolist()}) == 100
        assert (np.diff(drawn, axis=1) > 0).all()
        assert drawn.min() >= 0
        assert drawn.max() < n
        np.testing.assert_array_equal(drawn, sample_combinations(n, k, 100, 0))


@pytest.mark.parametrize(("n", "k"), [(12, 3), (25, 6)])
def test_every_combination_is_equally_likely(n: int, k: int) -> None:
    # Each draw of one combination holds task 0 with probability k/n; 99.9% interval.
    rng = np.random.default_rng(0)
    hits = sum(0 in sample_combinations(n, k, 1, rng)[0] for _ in range(2000))
    assert binomtest(hits, 2000, k / n).pvalue > 1e-3
    assert comb(n, k) > 200


def test_counts() -> None:
    np.testing.assert_array_equal(
        count_tasks([[0, 2, 2], [1, 0, 1]], 4), [[1, 0, 2, 0], [1, 2, 0, 0]]
    )


@pytest.mark.parametrize("kind", ["shared", "weights"])
def test_sampling_every_combination_is_exact(kind: str) -> None:
    solutions = world(2, kind, 6)
    y = labels(2, solutions.n_pairs)
    for k in range(1, 7):
        exact = k_relevance(solutions, y, k, replacement=False)
        assert sampled_k_relevance(solutions, y, k, 20, 0) == pytest.approx(exact, abs=1e-12)


def test_samples_scatter_about_the_exact_value() -> None:
    solutions = world(2, "weights", 8)
    y = labels(2, solutions.n_pairs)
    rng = np.random.default_rng(0)
    D = np.full(8, 1 / 8)
    for replacement, distribution in ((False, None), (True, D)):
        draws = [
            sampled_k_relevance(
                solutions, y, 4, 10, rng, replacement=replacement, distribution=distribution
            )
            for _ in range(500)
        ]
        exact = k_relevance(solutions, y, 4, replacement=replacement)
        assert np.mean(draws) == pytest.approx(exact, abs=4 * np.std(draws) / np.sqrt(500))


def test_bad_input_is_refused() -> None:
    solutions = world(0, "shared", 20)
    with pytest.raises(ValueError, match=r"20\^5 sequences"):
        brute_force_k_relevance(solutions, [0] * 6, 5)
    with pytest.raises(ValueError, match="only 20 tasks"):
        sample_combinations(20, 21, 5, 0)
    with pytest.raises(ValueError, match="max_seqs is 0"):
        sample_combinations(20, 2, 0, 0)
    with pytest.raises(ValueError, match="leave it out"):
        sampled_k_relevance(solutions, [0] * 6, 2, 5, 0, distribution=np.full(20, 0.05))
