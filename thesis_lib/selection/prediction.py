r"""Selection as prediction: leave-one-task-out cross-validation, and shrinkage.

A potential is a prediction of the next task's solution.  Keeping a feature predicts it by the
finer abstraction f, removing it by the coarser c.  Leave task i of n out, predict it by the
other n - 1, and mix: :math:`c_{-i} + w (f_{-i} - c_{-i})`.  Summed over tasks, with weights
:math:`p(x|i)`, the squared error falls below that of c by

.. math:: 2 w N - w^2 D, \qquad
    N = \sum_i \mathrm{E}_i (Q_i - c_{-i})(f_{-i} - c_{-i}), \quad
    D = \sum_i \mathrm{E}_i (f_{-i} - c_{-i})^2,

so the mixture predicts best at :math:`w = N/D`, and f predicts no better than c exactly where
:math:`2N \le D`, that is :math:`w \le \frac12`.  Nothing here asks how tasks weight their pairs:
task i is a fresh draw for what the others predict, and (2N - D)/n is an unbiased estimate of how
much less the feature lets n - 1 tasks err on the next one, *whatever the p(x|m)*.  (Of the domain
relevance itself no unbiased estimate exists then: :mod:`thesis_lib.relevance.estimators`.)

*Cells that the others never visit.*  A table says nothing of them; what it holds there is part of
the function that is judged.  It may be a number, such as the 0 of a table that nobody has filled,
the mean of the others over all pairs, or what the coarser cell has.  Each is a function of the
other tasks alone, so (2N - D)/n is unbiased for the function with these values, and in general
for no other.  A number or the mean charges a feature for what it errs in such cells; the coarser
cell's value charges nothing, as if the potential, too, had that of the coarser cell there.  Where
tasks share p(x|m), the others visit every cell that a task visits, and all are one.

*Shared p(x|m).*  With :math:`Z_i` the contribution of task i to the increment, mean
:math:`\bar Z` and covariance S (:mod:`thesis_lib.selection.jackknife`), c predicts 0 and f
predicts :math:`\bar Z_{-i} = (n \bar Z - Z_i)/(n-1)`.  As :math:`\sum_i |Z_i|^2 = (n-1)\,
\mathrm{tr} S + n|\bar Z|^2`, :math:`Z_i - \bar Z_{-i} = \frac{n}{n-1}(Z_i - \bar Z)` and
:math:`n |\bar Z|^2 = F\, \mathrm{tr} S`,

.. math:: 2N - D = \sum_i |Z_i|^2 - |Z_i - \bar Z_{-i}|^2
        = \Bigl(n - 1 + F - \frac{n^2}{n-1}\Bigr) \mathrm{tr} S,

which is at most 0 exactly where :math:`F \le 1 + \frac{n}{n-1}`: cross-validation is the
F-test with a threshold that falls from 3 to 2, where a 5% test has one from 161.4 to 3.84.
Likewise :math:`w = (F-1) / (F - 1 + \frac{n}{n-1})`.

*Shrinkage.*  The best multiple of :math:`\bar Z` as a prediction is
:math:`|\mathrm{E} Z|^2 / (|\mathrm{E} Z|^2 + \mathrm{tr}\Sigma / n)`.  The unbiased estimate of
:math:`|\mathrm{E} Z|^2` is :math:`|\bar Z|^2 - \mathrm{tr} S/n`, so the plug-in is
:math:`(1 - 1/F)_+`, which is James and Stein's rule with an estimated variance.  The
cross-fitted :math:`N_+/D` is the same estimate for n - 1 tasks, and needs no shared p(x|m).
"""

from __future__ import annotations

from collections.abc import Iterable
from math import prod
from typing import Literal

import numpy as np

from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.checks import one_of
from thesis_lib.relevance.cells import Cells, FeatureCells, ground, keep
from thesis_lib.relevance.estimators import LEFT, compare
from thesis_lib.relevance.solutions import Solutions
from thesis_lib.selection.base import (
    ZERO,
    BackwardElimination,
    Call,
    Check,
    KeepForGood,
    Selector,
    Test,
)

Unseen = Literal["mean", "coarser"]
"""What a function has in a cell that no task visits, if that is not a number."""


def left_out(
    finer: FeatureCells, feature: int, unseen: float | Unseen = "coarser"
) -> tuple[float, float]:
    r"""What a feature adds to the prediction of each task by the others: N and D.

    Parameters
    ----------
    finer
        Sums over the cells of the features kept, for n tasks, at least 2.
    feature
        Index of one of them.
    unseen
        What both functions have in a cell that the others never visit: ``"mean"``, that of the
        others over all pairs, or a number, counted from :attr:`Solutions.centre` as the sums are.
        With ``"coarser"`` the finer one has the value of the coarser.

    Returns
    -------
    tuple of float
        :math:`N/n` and :math:`D/n` of :mod:`thesis_lib.selection.prediction`.  The feature
        lowers the mean squared error by :math:`(2N - D)/n` and is best scaled by N/D.
    """
    coarser = finer.drop(feature)
    above = coarser_cell(finer, coarser, feature)
    a, b = finer.a, np.broadcast_to(finer.b, finer.a.shape)
    (c, seen), (f, visited) = _others(coarser), _others(finer)
    c, seen = c[:, above], seen[:, above]
    if unseen == "coarser":
        step = np.where(visited & seen, f - c, 0.0)
    else:
        value = _others(finer.total())[0] if unseen == "mean" else unseen
        c = np.where(seen, c, value)
        step = np.where(visited, f, value) - c
    n = finer.n_tasks
    return float(((a - b * c) * step).sum()) / n, float((b * step * step).sum()) / n


def _others(cells: Cells) -> tuple[FloatArray, np.ndarray]:
    """Mean of a cell over the other tasks, and whether they visit it, each ``(n, G)``."""
    b = np.broadcast_to(cells.b, cells.a.shape)
    total = b.sum(axis=0)
    A, B = cells.a.sum(axis=0) - cells.a, total - b
    visited = LEFT * total < B
    return np.divide(A, B, out=np.zeros_like(A), where=visited), visited


def coarser_cell(finer: FeatureCells, coarser: FeatureCells, feature: int) -> IntArray:
    """Cell of the coarser partition that holds each cell of the finer, shape ``(G,)``."""
    at = finer.features.index(feature)
    low, size = prod(finer.sizes[at + 1 :]), finer.sizes[at]
    code = (finer.code // (low * size)) * low + finer.code % low
    return np.searchsorted(coarser.code, code)


class LeaveOneTaskOut(BackwardElimination):
    r"""Backward elimination by leave-one-task-out cross-validation.

    In each round every feature's part in the prediction of one task by the others is compared
    with its cost; of those that do not pay, the one with the smallest weight N/D goes.

    Parameters
    ----------
    unseen
        What the potential has where no task visits its cell; only of the function with this value
        does the rule tell which predicts better.  A number is what
        :func:`~thesis_lib.potentials.linear_cross_task_weights` is given as ``fill``, by default
        the same 0; ``"mean"`` is the mean over all tasks and pairs.  With ``"coarser"`` a feature
        costs nothing there, as if the potential had the value of the coarser cell.

    Notes
    -----
    This edition's.  The statistic is the weight N/D and the threshold one half, whatever the
    tasks' p(x|m); where they share it, the rule is :math:`F \le 1 + n/(n-1)`.  Derivation:
    :mod:`thesis_lib.selection.prediction`.  It asks which function predicts better, not
    whether a feature is relevant: an irrelevant one is kept with a probability that does not
    tend to 0 (for one Gaussian direction, that of a squared Student t above the threshold).

    Examples
    --------
    Eight tasks, whose values depend on fuel, and on colour in every other task the other way.

    >>> import numpy as np
    >>> from thesis_lib.relevance import Solutions, TaskTable
    >>> x = np.array([(fuel, colour, 0) for fuel in range(3) for colour in range(2)])
    >>> tables = [
    ...     TaskTable(("fuel", "colour", "a"), x, x[:, 0] + sign * (2 * x[:, 1] - 1))
    ...     for sign in [1.0, -1.0] * 4
    ... ]
    >>> solutions = Solutions.from_tables(tables)
    >>> LeaveOneTaskOut().fit(solutions).get_feature_names_out().tolist()
    ['fuel']
    """

    min_tasks = 2
    keep_for_good: KeepForGood = "never"

    def __init__(self, unseen: float | Unseen = 0.0) -> None:
        self.unseen = unseen

    def _test(self, call: Call) -> Test:
        unseen = self.unseen
        if isinstance(unseen, str):
            one_of("unseen", unseen, ("mean", "coarser"))
        elif not np.isfinite(unseen):
            raise ValueError(
                f"unseen is {unseen}, but a finite number is needed, the value of the potential "
                'where no task visits a cell, or "mean" or "coarser".'
            )
        else:
            unseen = unseen - call.solutions.centre

        def test(cells: FeatureCells, candidates: list[int]) -> Iterable[Check]:
            for feature in candidates:
                gained, spent = left_out(cells, feature, unseen)
                relevance = compare(cells, cells.drop(feature)).domain
                if spent <= call.zero:
                    yield Check(feature, "remove", relevance, 0.0, 0.5, "it changes no prediction")
                elif 2 * gained <= spent:
                    reason = "tasks are predicted no worse without it"
                    yield Check(feature, "remove", relevance, gained / spent, 0.5, reason)
                else:
                    reason = "tasks are predicted better with it"
                    yield Check(feature, "keep", relevance, gained / spent, 0.5, reason)

        return test

    def _choose(self, call: Call, removed: list[int], marked: list[Check]) -> int:
        return min(marked, key=lambda check: check.statistic).feature


class Shrinkage(Selector):
    r"""Scale every feature's contribution instead of keeping or removing it.

    Features leave one after another, always the one of least weight, until none is left.  The
    cross-task function is then built up again in the opposite order, each feature's
    contribution times its weight.

    Parameters
    ----------
    weight
        ``"plug-in"``: :math:`(1 - 1/F)_+`, F the jackknife F-ratio of the increment.
        ``"cross-fitted"``: :math:`N_+/D`, at most 1, which leave-one-task-out predictions
        give for any p(x|m), those with the value of the coarser cell where the others visit
        none, as :meth:`values` has it.

    Attributes
    ----------
    order_
        Features as they left, indices of shape ``(F,)``.
    weights_
        Weight of each feature's contribution, in the order of the features, shape ``(F,)``.
    support_
        The features that the function depends on: all but those that left first with
        weight 0.

    Notes
    -----
    This edition's.  Derivation: :mod:`thesis_lib.selection.prediction`.
    """

    min_tasks = 2
    order_: IntArray
    weights_: FloatArray

    def __init__(self, weight: Literal["plug-in", "cross-fitted"] = "plug-in") -> None:
        self.weight = weight

    def _select(self, solutions: Solutions) -> list[int]:
        one_of("weight", self.weight, ("plug-in", "cross-fitted"))
        cells = ground(solutions)
        top = compare(cells, cells.keep(()))
        zero = ZERO * max(top.observed, abs(top.spread))
        if not zero > 0:
            raise ValueError(
                f"every Q-function of the {solutions.n_tasks} tasks is the same constant, so no "
                "feature can be told from another; check that the tasks were learned."
            )
        self.weights_ = np.zeros(solutions.n_features)
        order: list[int] = []
        while cells.features:
            weights = [self._weight(cells, feature, zero) for feature in cells.features]
            least = int(np.argmin(weights))
            order.append(cells.features[least])
            self.weights_[order[-1]] = weights[least]
            cells = cells.drop(order[-1])
        self.order_ = np.array(order)
        positive = np.flatnonzero(self.weights_[self.order_] > 0)
        return order[: int(positive[0])] if len(positive) else order

    def _weight(self, cells: FeatureCells, feature: int, zero: float) -> float:
        if self.weight == "cross-fitted":
            gained, spent = left_out(cells, feature)
            return min(max(gained / spent, 0.0), 1.0) if spent > zero else 0.0
        result = compare(cells, cells.drop(feature))
        return max(1 - 1 / result.f_ratio, 0.0) if result.observed > zero else 0.0

    def values(self, solutions: Solutions) -> FloatArray:
        """The shrunk cross-task function of tasks, by the weights fitted.

        Parameters
        ----------
        solutions
            As a rule those given to :meth:`fit`.

        Returns
        -------
        FloatArray
            Shape ``(N,)``.  Where no task visits a cell it has the value of the next coarser.

        Raises
        ------
        ValueError
            When the features are not those of the fit, in their order.
        """
        self._check_names(solutions.feature_names)
        p = solutions.p
        a, b = np.where(p > 0, p * solutions.q, 0.0).sum(axis=0), p.sum(axis=0)
        out = np.full(solutions.n_pairs, a.sum() / b.sum())
        coarser = out
        for place in reversed(range(len(self.order_))):
            labels = keep(solutions, self.order_[place:].tolist())
            total, weight = np.bincount(labels, a)[labels], np.bincount(labels, b)[labels]
            finer = np.divide(total, weight, out=coarser.copy(), where=weight > 0)
            out = out + self.weights_[self.order_[place]] * (finer - coarser)
            coarser = finer
        return out
