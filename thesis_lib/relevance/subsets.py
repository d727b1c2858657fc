"""Exact means over all subsets of few tasks, by listing them."""

from __future__ import annotations

import numpy as np
from scipy.special import comb

from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.compiled import njit

MOST_VISITORS = 16
"""Up to this many tasks that visit a cell, listing their subsets is the fastest exact way."""


def listed_subsets(a: FloatArray, b: FloatArray, k: IntArray) -> FloatArray:
    r"""Sum over cells of the mean of :math:`A^2 / (k B)` over all subsets of k tasks.

    A and B are a subset's sums of a and b; the term is 0 where B is.

    Parameters
    ----------
    a, b
        Sums over cells for n tasks, shape ``(n, G)``.
    k
        Sizes of the subsets, at most n, shape ``(K,)``.

    Returns
    -------
    FloatArray
        Shape ``(K,)``.

    Notes
    -----
    A task that does not visit a cell adds nothing there.  So only subsets T of a cell's v
    visitors are listed, and a T of size j stands for C(n - v, k - j) subsets of size k.
    Time grows as :math:`2^v`.
    """
    n = len(a)
    visitors = (b > 0).sum(axis=0)
    most = int(visitors.max(initial=0))
    sums = _sum_by_size(np.ascontiguousarray(a.T), np.ascontiguousarray(b.T), most)
    sizes = np.asarray(k)[:, None, None]
    v, j = np.arange(most + 1)[:, None], np.arange(most + 1)
    stands_for = comb(np.maximum(n - v, 0), np.maximum(sizes - j, 0)) * (sizes >= j)
    return np.einsum("kvj,vj->k", stands_for / comb(n, sizes) / sizes, sums)


@njit(error_model="numpy")
def _sum_by_size(a, b, most):  # type: ignore[no-untyped-def]
    """Sum of A^2/B by number of visitors v and size j, shape ``(most + 1, most + 1)``."""
    out = np.zeros((most + 1, most + 1))
    A, B = np.zeros(1 << most), np.zeros(1 << most)
    size = np.zeros(1 << most, np.int64)
    for m in range(1, 1 << most):
        size[m] = size[m >> 1] + (m & 1)
    for g in range(a.shape[0]):
        v = 0
        for i in range(a.shape[1]):
            if b[g, i] > 0.0:
                # Subsets with this visitor are those without it, each with it added.
                half = 1 << v
                for m in range(half):
                    A[half + m] = A[m] + a[g, i]
                    B[half + m] = B[m] + b[g, i]
                v += 1
        for m in range(1, 1 << v):
            out[v, size[m]] += A[m] * A[m] / B[m]
    return out
