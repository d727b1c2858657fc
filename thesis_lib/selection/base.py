r"""What all feature selectors share: scikit-learn's conventions and backward elimination."""

from __future__ import annotations

import abc
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.utils import Tags
from sklearn.utils.validation import check_is_fitted

from thesis_lib.arrays import BoolArray, FloatArray, IntArray
from thesis_lib.checks import one_of
from thesis_lib.relevance.cells import FeatureCells, ground, keep
from thesis_lib.relevance.solutions import Solutions

Verdict = Literal["remove", "keep", "unsure"]
KeepForGood = Literal["call", "never", "forever"]

ZERO = 1e-12
"""Relevance below this share of the variance of the Q-values is rounding error, hence 0."""


class Selector(TransformerMixin, BaseEstimator, abc.ABC):
    """Chooses the features that a cross-task function should use.

    A scikit-learn transformer that is fitted to :class:`Solutions`: arguments of the
    constructor are parameters, :meth:`fit` learns and returns the selector, and learned
    attributes end in an underscore.  The last step of a ``make_pipeline`` or one before it,
    it passes on the columns kept.

    Attributes
    ----------
    support_
        Which features are kept, shape ``(F,)``.
    removed_
        Names of the features removed, in the order of removal.
    feature_names_in_
        Names of all features, shape ``(F,)``.
    n_features_in_
        F.
    """

    min_tasks: int = 1
    support_: BoolArray
    removed_: tuple[str, ...]
    feature_names_in_: np.ndarray
    n_features_in_: int

    def __sklearn_tags__(self) -> Tags:
        tags = super().__sklearn_tags__()
        tags.input_tags.two_d_array = False  # fit takes Solutions
        return tags

    def fit(self, solutions: Solutions, y: None = None) -> Self:
        """Select features from the solutions of the observed tasks.

        Parameters
        ----------
        solutions
            One row a task, in the order they were observed.
        y
            Not used; there for scikit-learn's sake.

        Returns
        -------
        Self

        Raises
        ------
        ValueError
            When there are too few tasks, every Q-function is constant, or a parameter is
            out of range.
        """
        if not isinstance(solutions, Solutions):
            raise ValueError(
                f"solutions is a {type(solutions).__name__}, but a Solutions object is needed; "
                "make one with Solutions(...), Solutions.from_domain or Solutions.from_tables."
            )
        if solutions.n_tasks < self.min_tasks:
            raise ValueError(
                f"{type(self).__name__} was given {solutions.n_tasks} task(s), but needs at least "
                f"{self.min_tasks}; use NoSelection until that many were observed."
            )
        self.feature_names_in_ = np.array(solutions.feature_names, dtype=object)
        self.n_features_in_ = solutions.n_features
        removed = self._select(solutions)
        self.support_ = np.ones(solutions.n_features, dtype=bool)
        self.support_[removed] = False
        self.removed_ = tuple(solutions.feature_names[i] for i in removed)
        return self

    @abc.abstractmethod
    def _select(self, solutions: Solutions) -> list[int]:
        """Indices of the features to remove, in the order of removal."""

    def get_support(self, indices: bool = False) -> BoolArray | IntArray:
        """Mask of the features kept, or their indices."""
        self._check_fitted()
        return np.flatnonzero(self.support_) if indices else self.support_

    def get_feature_names_out(self, input_features: Sequence[str] | None = None) -> np.ndarray:
        """Names of the features kept; ``input_features``, if given, must be those of the fit."""
        self._check_names(input_features)
        return self.feature_names_in_[self.support_]

    def transform(self, features: Solutions | ArrayLike) -> np.ndarray:
        """Keep the selected columns.

        Parameters
        ----------
        features
            Feature values, shape ``(N, F)``, of any pairs: an array in the order of
            ``feature_names_in_``, or a frame or solutions with these names in this order.

        Returns
        -------
        numpy.ndarray
            Shape ``(N, number kept)``.

        Raises
        ------
        sklearn.exceptions.NotFittedError
            When nothing was selected yet.
        ValueError
            When columns lack, or have other names or another order than in the fit.
        """
        if isinstance(features, Solutions):
            self._check_names(features.feature_names)
            return features.features[:, self.support_]
        self._check_names(getattr(features, "columns", None))
        rows = np.asarray(features)
        if rows.ndim != 2 or rows.shape[1] != len(self.support_):
            raise ValueError(
                f"features has shape {rows.shape}, but the selector was fitted to "
                f"{len(self.support_)} features; give one column for each."
            )
        return rows[:, self.support_]

    def labels(self, solutions: Solutions) -> IntArray:
        """The abstraction selected, as labels of the pairs, shape ``(N,)``."""
        self._check_names(solutions.feature_names)
        return keep(solutions, np.flatnonzero(self.support_).tolist())

    def _check_fitted(self) -> None:
        check_is_fitted(
            self,
            "support_",
            msg="this %(name)s has selected nothing yet; call fit(solutions) first.",
        )

    def _check_names(self, names: Iterable[Any] | None) -> None:
        self._check_fitted()
        if names is not None and list(names) != list(self.feature_names_in_):
            raise ValueError(
                f"the columns are {', '.join(map(str, names))}, but the selector was fitted to "
                f"{', '.join(self.feature_names_in_)}, in this order; choose and order them so."
            )


@dataclass(frozen=True)
class Check:
    """One feature tested in one round of backward elimination.

    Attributes
    ----------
    feature
        Index of the feature, tested together with those already removed.
    verdict
        ``"remove"``: marked as domain irrelevant; ``"keep"``; or ``"unsure"``: no
        reliable estimate, kept for now.
    relevance
        Estimated domain relevance.
    statistic, threshold
        The feature is marked when the statistic is at most the threshold.
    reason
        What decided, in words.
    curve
        D(k) for k = 1 .. n, where the method computes it.
    theta
        Fitted parameters, where the method fits a curve.
    """

    feature: int
    verdict: Verdict
    relevance: float
    statistic: float
    threshold: float
    reason: str
    curve: FloatArray | None = None
    theta: FloatArray | None = None


@dataclass(frozen=True)
class Round:
    """One round of backward elimination.

    Attributes
    ----------
    removed
        Features removed before the round, as indices.
    checks
        The features tested.
    choice
        The feature removed at the end of the round; None in the last.
    """

    removed: tuple[int, ...]
    checks: tuple[Check, ...]
    choice: int | None


@dataclass(frozen=True)
class Call:
    """What one call of :meth:`BackwardElimination.fit` computes once.

    Attributes
    ----------
    solutions
        The observed tasks.
    ground
        Cells of the full feature set.
    pooled
        The same for all tasks together.
    zero
        Relevance up to which is rounding error.
    """

    solutions: Solutions
    ground: FeatureCells
    pooled: FeatureCells
    zero: float


Test = Callable[[FeatureCells, list[int]], Iterable[Check]]
"""Tests each candidate together with the features already absent from the cells."""


class BackwardElimination(Selector):
    """Remove features one at a time, by the main loop of algorithm 7.

    In each round every remaining feature is tested together with those already removed.
    Of the features marked as irrelevant one is removed: by default that with the weakest
    forward relevance (algorithm 9).  A feature that a round neither marks nor is unsure
    about is kept for good (section 4.3).

    Attributes
    ----------
    relevance_
        Estimated domain relevance of each feature when it was last tested, shape
        ``(F,)``; NaN if never.
    unsure_
        Names of the features about which the last round was unsure.  They are kept.
    history_
        The rounds.
    """

    keep_for_good: KeepForGood = "call"
    relevance_: FloatArray
    unsure_: tuple[str, ...]
    history_: list[Round]

    def _select(self, solutions: Solutions) -> list[int]:
        one_of("keep_for_good", self.keep_for_good, ("call", "never", "forever"))
        cells = ground(solutions)
        pooled = cells.pool()
        total = _explained(pooled) - _explained(pooled.keep(()))
        if not total > 0 and _all_constant(solutions):
            raise ValueError(
                f"every Q-function of the {solutions.n_tasks} tasks is constant, so no feature can "
                "be told from another; check that the tasks were learned."
            )
        scale = max(total, _mean_variance(cells))
        call = Call(solutions, cells, pooled, ZERO * scale)
        test = self._test(call)
        settled = self._settled(solutions)
        removed: list[int] = []
        self.history_ = []
        self.relevance_ = np.full(solutions.n_features, np.nan)
        while True:
            candidates = [i for i in cells.features if i not in settled]
            checks = tuple(test(cells, candidates))
            for check in checks:
                self.relevance_[check.feature] = check.relevance
            if self.keep_for_good != "never":
                settled |= {check.feature for check in checks if check.verdict == "keep"}
            marked = [check for check in checks if check.verdict == "remove"]
            choice = self._choose(call, removed, marked) if marked else None
            self.history_.append(Round(tuple(removed), checks, choice))
            if choice is None:
                break
            removed.append(choice)
            cells = cells.drop(choice)
        names = solutions.feature_names
        self.unsure_ = tuple(names[c.feature] for c in checks if c.verdict == "unsure")
        if self.keep_for_good == "forever":
            self.kept_for_good_ = tuple(names[i] for i in sorted(settled))
        return removed

    def _settled(self, solutions: Solutions) -> set[int]:
        if self.keep_for_good != "forever" or not hasattr(self, "kept_for_good_"):
            return set()
        return {solutions.index(name) for name in self.kept_for_good_}

    @abc.abstractmethod
    def _test(self, call: Call) -> Test:
        """Check the parameters and return the test of features for this call."""

    def _choose(self, call: Call, removed: list[int], marked: list[Check]) -> int:
        if len(marked) == 1:
            return marked[0].feature
        strengths = [forward_strength(call.pooled, [*removed, check.feature]) for check in marked]
        # Ties up to rounding go to the first feature, so that the order of sums is no judge.
        weakest = min(strengths) + call.zero
        return next(c.feature for c, s in zip(marked, strengths, strict=True) if s <= weakest)


def forward_strength(pooled: FeatureCells, features: Iterable[int]) -> float:
    """Forward relevance of a feature set on the cross-task Q of all tasks (algorithm 9).

    Parameters
    ----------
    pooled
        Cells of all tasks together, :meth:`FeatureCells.pool`.
    features
        Indices of the set G.
    """
    return _explained(pooled.keep(features)) - _explained(pooled.keep(()))


def _explained(pooled: FeatureCells) -> float:
    a, b = pooled.a[0], pooled.b[0]
    seen = b > 0
    return float((a[seen] ** 2 / b[seen]).sum())


def _mean_variance(cells: FeatureCells) -> float:
    """Mean variance of the tasks' own Q-functions."""
    a = cells.a
    b = np.broadcast_to(cells.b, a.shape)
    square = np.divide(a * a, b, out=np.zeros_like(a), where=b > 0).sum()
    return float(square - (a.sum(axis=1) ** 2).sum()) / len(a)


def _all_constant(solutions: Solutions) -> bool:
    for q, p in zip(solutions.q, solutions.p, strict=True):
        values = q[p > 0]
        if np.ptp(values) > 0:
            return False
    return True
