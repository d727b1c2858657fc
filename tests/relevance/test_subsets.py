"""Means over subsets of tasks, against listing them one by one."""

from itertools import combinations

import numpy as np
import pytest

from thesis_lib.relevance.exact import _subset_integral
from thesis_lib.relevance.subsets import listed_subsets


def one_by_one(a, b, k):
    n, cells = a.shape
    out = []
    for size in k:
        terms = []
        for chosen in combinations(range(n), size):
            A, B = a[list(chosen)].sum(axis=0), b[list(chosen)].sum(axis=0)
            terms.append(sum(A[g] ** 2 / B[g] for g in range(cells) if B[g] > 0) / size)
        out.append(np.mean(terms))
    return out


def test_two_tasks_by_hand():
    # Cell 1: both visit; cell 2: only the second.  k = 1: (4/1 + 9/3)/2 + (16/2)/2; k = 2:
    # (2 + 3)^2/(1 + 3)/2 + 16/2/2.
    a = np.array([[2.0, 0.0], [3.0, 4.0]])
    b = np.array([[1.0, 0.0], [3.0, 2.0]])
    np.testing.assert_allclose(listed_subsets(a, b, np.array([1, 2])), [7.5, 25 / 8 + 4])


@pytest.mark.parametrize("n", [1, 3, 6])
def test_against_listing_every_combination(n):
    rng = np.random.default_rng(n)
    b = rng.random((n, 5)) * (rng.random((n, 5)) < 0.6)
    a = rng.normal(size=(n, 5)) * (b > 0)
    k = np.arange(1, n + 1)
    np.testing.assert_allclose(listed_subsets(a, b, k), one_by_one(a, b, k), atol=1e-13)


def test_it_is_the_integral():
    rng = np.random.default_rng(0)
    b = rng.random((9, 4)) + 0.01
    a = rng.normal(size=(9, 4))
    k = np.array([1, 4, 9])
    np.testing.assert_allclose(
        listed_subsets(a, b, k), _subset_integral(a, b, k), rtol=1e-10, atol=1e-12
    )


def test_no_cell_gives_nothing():
    assert listed_subsets(np.zeros((3, 0)), np.zeros((3, 0)), np.array([1, 2])).tolist() == [0, 0]
