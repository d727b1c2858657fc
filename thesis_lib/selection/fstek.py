r"""FS-TEK (algorithm 7), its parts BKR and FR (algorithms 8, 9), and IBKR (section 4.3)."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Literal

import numpy as np
from scipy.stats import norm

from thesis_lib.arrays import FloatArray
from thesis_lib.checks import generator, one_of, positive_integer
from thesis_lib.relevance.cells import Cells, FeatureCells, ground
from thesis_lib.relevance.exact import explained_combinations, explained_sequences
from thesis_lib.relevance.sequences import count_tasks, sample_combinations
from thesis_lib.relevance.solutions import Solutions
from thesis_lib.selection.base import (
    BackwardElimination,
    Call,
    Check,
    KeepForGood,
    Test,
    Verdict,
    forward_strength,
)
from thesis_lib.selection.fitting import (
    MAX_CONDITION,
    Alpha,
    ExponentialFit,
    check_alpha,
    fit_exponential,
    fit_inverse,
    student_tail,
)

Curves = Callable[[FeatureCells, int], FloatArray]


def bkr(
    solutions: Solutions,
    removed: Iterable[str | int],
    max_seqs: int | None,
    k: int,
    rng: np.random.Generator | int = 0,
) -> FloatArray:
    """Backward k-relevance of every feature not yet removed.

    Parameters
    ----------
    solutions
        n task solutions.
    removed
        The features R marked for removal so far, names or indices.
    max_seqs
        Most combinations of k tasks to sample; None for the mean over all of them,
        computed exactly.
    k
        Tasks in a combination, at most n.
    rng
        Generator or seed for the sample.

    Returns
    -------
    FloatArray
        Relevance of removing R and each feature in turn, shape ``(F - |R|,)``, in the
        order of the features.

    Notes
    -----
    Source: algorithm 8.
    """
    base = ground(solutions)
    cells = base.keep(np.flatnonzero(~solutions.mask(removed)).tolist())
    curves = _Combinations(base, max_seqs, [k], generator(rng))
    return np.array([curves(cells, i)[0] for i in cells.features])


def fr(solutions: Solutions, features: Iterable[str | int]) -> float:
    """Forward relevance of a set of features on the cross-task Q of all tasks.

    Parameters
    ----------
    solutions
        n task solutions.
    features
        The set G, names or indices.

    Notes
    -----
    Source: algorithm 9.
    """
    chosen = np.flatnonzero(solutions.mask(features)).tolist()
    return forward_strength(ground(solutions).pool(), chosen)


class FSTEK(BackwardElimination):
    r"""Feature selection through extrapolation of k-relevance.

    For every feature the relevance D(k) of removing it, k = 1 .. n, is fitted by
    :math:`\theta_1 + \theta_2 e^{-\theta_3 k}`; the feature is marked for removal when
    the interval around the asymptote :math:`\theta_1` reaches 0.

    Parameters
    ----------
    alpha
        Level of the interval in (0, 1), or a function of the number of tasks, such as
        :func:`~thesis_lib.selection.fitting.triangle_alpha`.
    max_seqs
        Most combinations of tasks sampled for each k (algorithm 8); the text gives no
        number.  None, the default: all of them, by the exact formula.
    random_state
        Seed or generator for the sample.
    alpha_is
        What alpha means.  ``"significance"``: the interval covers with probability
        1 - alpha.  ``"confidence"``: with probability alpha, the literal words of
        algorithm 7; at the printed levels near 1e-3 the interval then vanishes.
    tail
        ``"two-sided"`` quantile of 1 - alpha/2, or ``"one-sided"`` of 1 - alpha.
    interval
        ``"curve"``: t quantile with n - 3 degrees of freedom times the standard error of
        :math:`\theta_1`.  ``"observation"``: the residual variance added, an interval
        for a further data point.
    flat
        What a relevance equal for all k is.  ``"limit"``: its own limit, known exactly.
        ``"unsure"``: the fit is singular, hence unsure, so even a feature of relevance
        0 stays.
    three_tasks
        With 3 tasks the curve passes through every point and has no standard error.
        ``"unsure"``, or ``"zero-width"`` for an interval of width 0.
    straight
        What a curve is that no exponential fits, because it falls in a straight line or
        faster.  ``"unsure"``; or ``"remove"``, as its extrapolation falls below 0.
    max_condition
        Condition number of the Jacobian (of data scaled to span 1) above which the fit
        is unsure.
    keep_for_good
        ``"call"``: a feature neither marked nor unsure in some round is not tested again
        in this call (section 4.3).  ``"never"``: every round tests all.  ``"forever"``:
        nor in later calls of :meth:`fit`.

    Notes
    -----
    Source: algorithm 7 and the tweaks of section 4.3.  A feature whose fit is
    ill-conditioned, does not converge or has no asymptote (:math:`\theta_3 \le 0`) is
    "unsure": kept, tested again in the next round, and listed in ``unsure_``.

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
    >>> FSTEK(alpha=0.001).fit(solutions).get_feature_names_out().tolist()
    ['fuel']
    """

    min_tasks = 3

    def __init__(
        self,
        alpha: Alpha = 1e-3,
        max_seqs: int | None = None,
        random_state: np.random.Generator | int = 0,
        alpha_is: Literal["significance", "confidence"] = "significance",
        tail: Literal["two-sided", "one-sided"] = "two-sided",
        interval: Literal["curve", "observation"] = "curve",
        flat: Literal["limit", "unsure"] = "limit",
        three_tasks: Literal["unsure", "zero-width"] = "unsure",
        straight: Literal["unsure", "remove"] = "unsure",
        max_condition: float = MAX_CONDITION,
        keep_for_good: KeepForGood = "call",
    ) -> None:
        self.alpha = alpha
        self.max_seqs = max_seqs
        self.random_state = random_state
        self.alpha_is = alpha_is
        self.tail = tail
        self.interval = interval
        self.flat = flat
        self.three_tasks = three_tasks
        self.straight = straight
        self.max_condition = max_condition
        self.keep_for_good = keep_for_good

    def _test(self, call: Call) -> Test:
        n = call.solutions.n_tasks
        level = check_alpha(self.alpha, n)
        one_of("alpha_is", self.alpha_is, ("significance", "confidence"))
        one_of("tail", self.tail, ("two-sided", "one-sided"))
        one_of("interval", self.interval, ("curve", "observation"))
        one_of("flat", self.flat, ("limit", "unsure"))
        one_of("three_tasks", self.three_tasks, ("unsure", "zero-width"))
        one_of("straight", self.straight, ("unsure", "remove"))
        outside = level if self.alpha_is == "significance" else 1 - level
        outside = outside / 2 if self.tail == "two-sided" else outside
        quantile = student_tail(outside, n - 3) if n > 3 else 0.0
        curves = self._curves(call)
        affine = call.ground.shared and self.max_seqs is None

        def test(cells: FeatureCells, candidates: list[int]) -> Iterable[Check]:
            for feature in candidates:
                curve = curves(cells, feature)
                if np.ptp(curve) <= call.zero:
                    yield self._judge_flat(feature, curve, call.zero)
                elif affine:
                    # The law gives the curve, and the fit to it is that to 1/k, scaled.
                    slope = (curve[0] - curve[-1]) * n / (n - 1)
                    fit = fit_inverse(n).scaled(curve[0] - slope, slope)
                    yield self._judge(feature, curve, fit, quantile)
                else:
                    yield self._judge(feature, curve, fit_exponential(curve), quantile)

        return test

    def _curves(self, call: Call) -> Curves:
        """What gives the k-relevances, k = 1 to n, of a feature that cells still tell apart."""
        lengths = range(1, call.solutions.n_tasks + 1)
        return _Combinations(call.ground, self.max_seqs, lengths, generator(self.random_state))

    def _judge_flat(self, feature: int, curve: FloatArray, zero: float) -> Check:
        value = float(curve[-1])
        if self.flat == "unsure":
            return Check(feature, "unsure", value, np.nan, 0.0, "relevance is constant", curve)
        verdict: Verdict = "remove" if value <= zero else "keep"
        return Check(feature, verdict, value, value, zero, "relevance is constant", curve)

    def _judge(
        self, feature: int, curve: FloatArray, fit: ExponentialFit | None, quantile: float
    ) -> Check:
        if fit is None:
            falls = bool(curve[-1] < curve[0])
            reason = "the fit did not converge"
            verdict: Verdict = "remove" if falls and self.straight == "remove" else "unsure"
            return Check(feature, verdict, np.nan, np.nan, 0.0, reason, curve)

        def check(verdict: Verdict, reason: str, low: float = np.nan) -> Check:
            return Check(feature, verdict, fit.asymptote, low, 0.0, reason, curve, fit.theta)

        if fit.increasing:
            return check("keep", "the fitted curve increases")
        if fit.decay <= 0:
            straight: Verdict = "remove" if self.straight == "remove" else "unsure"
            return check(straight, "the fitted curve has no asymptote")
        if not fit.condition <= self.max_condition:
            return check("unsure", "the Jacobian is ill-conditioned")
        error = fit.standard_error
        if fit.n_points == 3:
            if self.three_tasks == "unsure":
                return check("unsure", "three points leave no residual")
            error = 0.0
        elif self.interval == "observation":
            error = float(np.hypot(error, fit.residual_error))
        low = fit.asymptote - quantile * error
        if low <= 0.0:
            return check("remove", "the interval reaches 0", low)
        return check("keep", "the interval stays above 0", low)


class IBKR(BackwardElimination):
    r"""Iterated BKR: backward elimination by the relevance on all observed tasks.

    The same as FS-TEK but for k = n only, without extrapolation (section 4.3).

    Parameters
    ----------
    alpha
        Level of the interval, or a function of the number of tasks.  Read only with
        ``interval="bootstrap"``.
    interval
        ``"none"``: for k = n there is one combination of n tasks and nothing to take an
        interval of, so a feature is marked when its relevance is 0; this gives the
        printed 1/1 on the triangle.  ``"bootstrap"``: marked when the mean over
        ``max_seqs`` sequences of n tasks, drawn with replacement, less the two-sided
        normal quantile times their standard deviation is at most 0.
    max_seqs
        Sequences drawn for the bootstrap.
    random_state
        Seed or generator for the sequences.
    keep_for_good
        As for :class:`FSTEK`.
    """

    def __init__(
        self,
        alpha: Alpha = 0.15,
        interval: Literal["none", "bootstrap"] = "none",
        max_seqs: int = 100,
        random_state: np.random.Generator | int = 0,
        keep_for_good: KeepForGood = "call",
    ) -> None:
        self.alpha = alpha
        self.interval = interval
        self.max_seqs = max_seqs
        self.random_state = random_state
        self.keep_for_good = keep_for_good

    def _test(self, call: Call) -> Test:
        n = call.solutions.n_tasks
        level = check_alpha(self.alpha, n)
        one_of("interval", self.interval, ("none", "bootstrap"))
        counts, quantile = np.ones((1, n)), 0.0
        if self.interval == "bootstrap":
            size = positive_integer("max_seqs", self.max_seqs), n
            counts = count_tasks(generator(self.random_state).integers(n, size=size), n)
            quantile = float(norm.isf(level / 2))
        total = explained_sequences(call.ground, counts)

        def test(cells: FeatureCells, candidates: list[int]) -> Iterable[Check]:
            for feature in candidates:
                relevance = total - explained_sequences(cells.drop(feature), counts)
                value = float(relevance.mean())
                low = value - quantile * float(relevance.std())
                if low <= call.zero:
                    yield Check(feature, "remove", value, low, call.zero, "nothing is lost")
                else:
                    yield Check(feature, "keep", value, low, call.zero, "relevant so far")

        return test


class _Combinations:
    """Mean relevance of a feature over combinations of k tasks, for several k.

    Combinations are drawn once, as the text says its implementation does.
    """

    def __init__(
        self,
        base: Cells,
        max_seqs: int | None,
        lengths: Iterable[int],
        rng: np.random.Generator,
    ) -> None:
        n = base.n_tasks
        self.k = np.array(list(lengths))
        self.counts: FloatArray | None = None
        if max_seqs is not None:
            drawn = [count_tasks(sample_combinations(n, int(k), max_seqs, rng), n) for k in self.k]
            self.counts = np.concatenate(drawn)
            sizes = np.array([len(rows) for rows in drawn])
            self.starts = np.cumsum(sizes) - sizes
            self.sizes = sizes
        self.base = self._explained(base)

    def _explained(self, cells: Cells) -> FloatArray:
        if self.counts is None:
            return explained_combinations(cells, self.k)
        values = explained_sequences(cells, self.counts)
        return np.add.reduceat(values, self.starts) / self.sizes

    def __call__(self, cells: FeatureCells, feature: int) -> FloatArray:
        return self.base - self._explained(cells.drop(feature))
