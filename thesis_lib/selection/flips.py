r"""Selection by flipped signs: the F-ratio beside itself on tasks whose contributions change sign.

With :math:`Z_i` the contribution of task i to an increment of relevance
(:mod:`thesis_lib.selection.jackknife`), F grows with :math:`s = |\sum_i Z_i|^2 / n\sum_i |Z_i|^2`,
whose denominator no sign changes.  If the :math:`Z_i` are independent, each with a law symmetric
about 0, all choices of signs are equally likely given the rest, so that s is above all but a share
:math:`\alpha` of its values over signs with probability at most :math:`\alpha`: **the level is held
exactly, for any symmetric scatter and any n**.  A choice and its opposite give the same s: where
:math:`2^{1-n} > \alpha`, up to five tasks at 5%, no feature is kept.  Where tasks do not share
p(x|m), :math:`Z_i` is their deviation from the mean of the coarser cell, to first order.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product

import numpy as np

from thesis_lib.arrays import FloatArray
from thesis_lib.relevance.cells import Cells, FeatureCells
from thesis_lib.relevance.estimators import compare, inner_products
from thesis_lib.selection.base import BackwardElimination, Call, Check, KeepForGood, Test, Verdict
from thesis_lib.selection.fitting import Alpha, check_alpha
from thesis_lib.selection.prediction import coarser_cell

MOST = 1024
"""Choices of signs that are tried: all up to eleven tasks, then drawn ones, over whose draw the
level is exact."""


class SignFlips(BackwardElimination):
    """Backward elimination by a test that is exact for symmetric scatter.

    Parameters
    ----------
    alpha
        Probability in (0, 1) that an irrelevant feature passes one test, or a function of n.

    Notes
    -----
    This edition's.  Derivation: :mod:`thesis_lib.selection.flips`.
    """

    min_tasks = 2
    keep_for_good: KeepForGood = "never"

    def __init__(self, alpha: Alpha = 0.05) -> None:
        self.alpha = alpha

    def _test(self, call: Call) -> Test:
        n = call.solutions.n_tasks
        signs = sign_choices(n)
        above = int(check_alpha(self.alpha, n) * len(signs))

        def test(cells: FeatureCells, candidates: list[int]) -> Iterable[Check]:
            for feature in candidates:
                result, gram = compare(cells, cells.drop(feature)), contributions(cells, feature)
                s = ((signs @ gram) * signs).sum(axis=1) / max(n * gram.trace(), call.zero)
                # At most so many lie above it; equal ones differ by rounding alone.
                limit = float(np.sort(s)[-1 - above]) * (1 + 1e-9)
                kept = result.observed > call.zero and s[0] > limit
                reason = f"{'few' if kept else 'many'} signs of the tasks' parts give as much"
                verdict: Verdict = "keep" if kept else "remove"
                yield Check(feature, verdict, result.domain, float(s[0]), limit, reason)

        return test

    def _choose(self, call: Call, removed: list[int], marked: list[Check]) -> int:
        return min(marked, key=lambda check: check.statistic - check.threshold).feature


def sign_choices(n: int) -> FloatArray:
    """Choices of n signs up to a common one, shape ``(at most MOST, n)``; first all the same."""
    if 2 ** (n - 1) <= MOST:
        return np.array([(1.0, *rest) for rest in product((1.0, -1.0), repeat=n - 1)])
    signs = np.random.default_rng(n).choice([1.0, -1.0], size=(MOST, n))
    signs[0] = 1.0
    return signs


def contributions(finer: FeatureCells, feature: int) -> FloatArray:
    """Inner products of the tasks' contributions to a feature's increment, shape ``(n, n)``."""
    coarser = finer.drop(feature)
    above = coarser_cell(finer, coarser, feature)
    pooled = coarser.pool()
    mean = np.divide(pooled.a, pooled.b, out=np.zeros_like(pooled.a), where=pooled.b > 0)
    off = Cells(finer.a - mean[0, above] * finer.b, finer.b)
    return inner_products(off) - inner_products(off.merge(above))
