"""Intervals and tests used throughout the book.

Every figure states n, an interval and the test; these are the functions it uses.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import special, stats

from thesis_lib.arrays import FloatArray


def _sample(values: ArrayLike, at_least: int = 2) -> FloatArray:
    x = np.asarray(values, dtype=float).ravel()
    if len(x) < at_least or not np.isfinite(x).all():
        raise ValueError(
            f"the sample has {len(x)} values, {int((~np.isfinite(x)).sum())} of them not finite, "
            f"but at least {at_least} finite values are needed."
        )
    return x


@dataclass(frozen=True)
class Mean:
    """A mean with its 95% interval, ``mean ± half_width``, over ``n`` runs."""

    mean: float
    half_width: float
    n: int

    def __str__(self) -> str:
        return f"{self.mean:.3g} ± {self.half_width:.2g} (n = {self.n})"


def mean_ci(values: ArrayLike, level: float = 0.95) -> Mean:
    """Mean and Student t interval of independent runs.

    Parameters
    ----------
    values
        One number a run, any shape; at least 2, all finite.
    level
        Coverage of the interval.

    Returns
    -------
    Mean

    Examples
    --------
    >>> found = mean_ci([1.0, 2.0, 3.0])
    >>> found.mean, round(found.half_width, 3)  # 4.303 standard errors
    (2.0, 2.484)
    """
    x = _sample(values)
    sem = x.std(ddof=1) / np.sqrt(len(x))
    # A hundredth of the time of scipy.stats.t.ppf, which calls it.
    half = float(special.stdtrit(len(x) - 1, 0.5 + level / 2) * sem)
    return Mean(float(x.mean()), half, len(x))


@dataclass(frozen=True)
class Comparison:
    """Two samples compared: the difference of means, its interval, and a p-value.

    Attributes
    ----------
    difference
        Mean of the first sample less mean of the second.
    low, high
        Welch interval of the difference at the level asked for.
    p_value
        Of the test named by ``test``.
    test
        What was done.
    """

    difference: float
    low: float
    high: float
    p_value: float
    test: str


@dataclass(frozen=True)
class Summary:
    """Mean, standard deviation (n - 1) and size of a sample: all that Welch's test needs."""

    mean: float
    sd: float
    n: int

    @classmethod
    def of(cls, sample: ArrayLike | Summary) -> Summary:
        """Summarise a sample; a summary is returned as it is."""
        if isinstance(sample, Summary):
            return sample
        x = _sample(sample)
        return cls(float(x.mean()), float(x.std(ddof=1)), len(x))


def _welch(a: Summary, b: Summary) -> tuple[float, float, float]:
    """Difference of means, its standard error, and Welch's degrees of freedom."""
    for sample in (a, b):
        if sample.n < 2 or not sample.sd >= 0:
            raise ValueError(
                f"a sample of {sample.n} values has standard deviation {sample.sd}, but Welch's "
                "test needs at least 2 values and a deviation of at least 0; give more runs."
            )
    u, v = a.sd**2 / a.n, b.sd**2 / b.n
    dof = (u + v) ** 2 / (u**2 / (a.n - 1) + v**2 / (b.n - 1)) if u + v > 0 else np.inf
    return a.mean - b.mean, float(np.sqrt(u + v)), float(dof)


def welch(a: ArrayLike | Summary, b: ArrayLike | Summary, level: float = 0.95) -> Comparison:
    """Welch's t-test that two means are equal (unequal variances).

    Parameters
    ----------
    a, b
        Independent samples, one number a run, or their summaries.
    level
        Coverage of the interval of the difference.

    Returns
    -------
    Comparison
        With a two-sided p-value.
    """
    gap, se, dof = _welch(Summary.of(a), Summary.of(b))
    half = float(stats.t.ppf(0.5 + level / 2, dof)) * se
    p = float(2 * stats.t.sf(abs(gap) / se, dof)) if se > 0 else float(gap == 0)
    return Comparison(gap, gap - half, gap + half, p, "Welch")


def equivalence(a: ArrayLike | Summary, b: ArrayLike | Summary, margin: float) -> Comparison:
    """Two one-sided Welch tests (TOST) that two means differ by less than a margin.

    "No significant difference" is absence of evidence; a small p-value here is
    evidence of no difference that matters.

    Parameters
    ----------
    a, b
        Independent samples, one number a run, or their summaries.
    margin
        The largest difference that counts as none, positive, in the samples' units.

    Returns
    -------
    Comparison
        The 90% interval of the difference and the TOST p-value: equivalence is shown
        at 5% when the interval lies inside (-margin, margin).
    """
    if not margin > 0:
        raise ValueError(f"margin is {margin}, but an equivalence margin must be positive.")
    gap, se, dof = _welch(Summary.of(a), Summary.of(b))
    half = float(stats.t.ppf(0.95, dof)) * se
    p = float(stats.t.sf((margin - abs(gap)) / se, dof)) if se > 0 else float(abs(gap) >= margin)
    return Comparison(gap, gap - half, gap + half, p, "TOST")


def power_within(
    margin: ArrayLike, half_width: ArrayLike, level: float = 0.95, *, sides: int = 2
) -> FloatArray:
    """How often intervals would show that differences are within margins, were there none.

    Parameters
    ----------
    margin, half_width
        Largest differences that count as none, and half-widths of the intervals.
    level
        Coverage of the intervals.
    sides
        2 if both ends of an interval must be within the margin, 1 if one.

    Returns
    -------
    FloatArray
        By the normal distribution, a power each.

    Examples
    --------
    >>> power_within([0.5, 2.0], 1.0).round(3).tolist()
    [0.0, 0.95]
    """
    bound, half = np.broadcast_arrays(np.asarray(margin, float), np.asarray(half_width, float))
    share = np.divide(bound, half, out=np.full(half.shape, np.inf), where=half > 0)
    one = stats.norm.cdf(stats.norm.isf((1 - level) / 2) * (share - 1))
    power: FloatArray = one if sides == 1 else np.maximum(0.0, 2 * one - 1)
    return power


def least_power(
    margin: ArrayLike, half_width: ArrayLike, level: float = 0.95, *, sides: int = 2
) -> float:
    """The least of several powers, as of :func:`power_within`."""
    return float(power_within(margin, half_width, level, sides=sides).min())


def kruskal(*samples: ArrayLike) -> float:
    """Kruskal-Wallis p-value that several samples come from one distribution."""
    return float(stats.kruskal(*[_sample(s) for s in samples]).pvalue)


def holm(p_values: ArrayLike) -> FloatArray:
    """Holm's step-down adjustment of p-values for many comparisons.

    Parameters
    ----------
    p_values
        Shape ``(n,)``, each in [0, 1].

    Returns
    -------
    FloatArray
        Adjusted p-values in the same order, shape ``(n,)``.

    Examples
    --------
    >>> holm([0.01, 0.04, 0.03]).round(9).tolist()
    [0.03, 0.06, 0.06]
    """
    p = np.asarray(p_values, dtype=float)
    if p.ndim != 1 or ((p < 0) | (p > 1) | np.isnan(p)).any():
        raise ValueError(f"p-values must be a list of numbers in [0, 1], but they are {p}.")
    order = np.argsort(p)
    stepped = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    adjusted = np.empty_like(p)
    adjusted[order] = np.minimum(stepped, 1.0)
    return adjusted


def bootstrap_ci(
    values: ArrayLike,
    statistic: Callable[[FloatArray], float] = np.mean,
    *,
    rng: np.random.Generator,
    n_resamples: int = 2000,
    level: float = 0.95,
) -> tuple[float, float]:
    """Percentile bootstrap interval of a statistic of independent runs.

    Parameters
    ----------
    values
        One entry a run along axis 0.
    statistic
        Maps an array like ``values`` to a number.
    rng
        Source of the resampling.
    n_resamples, level
        Number of resamples and coverage.

    Returns
    -------
    tuple[float, float]
        Low and high end.
    """
    x = np.asarray(values, dtype=float)
    draws = [statistic(x[rng.integers(len(x), size=len(x))]) for _ in range(n_resamples)]
    low, high = np.quantile(draws, [(1 - level) / 2, (1 + level) / 2])
    return float(low), float(high)


def iqm(scores: ArrayLike) -> float:
    """Interquartile mean: the mean of the middle half of all scores."""
    x = np.sort(_sample(scores, 1))  # by hand, since resamples call it thousands of times
    cut = len(x) // 4
    return float(x[cut : len(x) - cut].mean())


def stratified_bootstrap_ci(
    *scores: ArrayLike,
    statistic: Callable[..., float],
    rng: np.random.Generator,
    n_resamples: int = 2000,
    level: float = 0.95,
) -> tuple[float, float]:
    """Percentile interval of a statistic of score matrices, runs resampled within each task.

    Agarwal et al. (2021): tasks are strata, since runs of different tasks do not replace each
    other.

    Parameters
    ----------
    *scores
        Shapes ``(runs, tasks)``, each resampled by itself.
    statistic
        Maps such matrices to a number, such as :func:`iqm` of one of them.
    rng, n_resamples, level
        As in :func:`bootstrap_ci`.

    Returns
    -------
    tuple[float, float]
        Low and high end.
    """
    matrices = [np.asarray(s, dtype=float) for s in scores]
    if any(m.ndim != 2 or not np.isfinite(m).all() for m in matrices):
        raise ValueError("scores must be matrices (runs, tasks) of finite numbers.")
    draws = [
        statistic(*(np.take_along_axis(m, rng.integers(len(m), size=m.shape), 0) for m in matrices))
        for _ in range(n_resamples)
    ]
    low, high = np.quantile(draws, [(1 - level) / 2, (1 + level) / 2])
    return float(low), float(high)


def leading(samples: Mapping[str, ArrayLike | Summary], alpha: float = 0.05) -> list[str]:
    """Those not significantly below the highest mean, by Welch's test (as in table 5.2).

    The thesis tests "Kruskal-Wallis followed by Welch": where :func:`kruskal` finds nothing, all
    lead.  Summaries, all that a printed table has, cannot be ranked and go to Welch at once.

    Parameters
    ----------
    samples
        At least 2, by name: one number a run, or their summaries.
    alpha
        Level of both tests.

    Returns
    -------
    list of str
        In order of their means, the highest first.
    """
    whole = [s for s in samples.values() if not isinstance(s, Summary)]
    summaries = {name: Summary.of(s) for name, s in samples.items()}
    order = sorted(summaries, key=lambda name: -summaries[name].mean)
    if len(whole) == len(samples) and not kruskal(*whole) < alpha:
        return order
    best = summaries[order[0]]
    return [n for n in order if n == order[0] or welch(best, summaries[n]).p_value >= alpha]


def friedman(scores: ArrayLike) -> float:
    """Friedman's p-value that controllers rank alike, with tasks as the unit.

    Parameters
    ----------
    scores
        Shape ``(tasks, controllers)``, at least 3 controllers.
    """
    x = np.asarray(scores, dtype=float)
    return float(stats.friedmanchisquare(*x.T).pvalue)


def parametric_bootstrap(
    mean: ArrayLike, standard_error: ArrayLike, *, rng: np.random.Generator, n_resamples: int = 2000
) -> FloatArray:
    """Resamples of means of which only mean and standard error are known: independent normals.

    Parameters
    ----------
    mean, standard_error
        Same shape; NaN where a cell is empty.
    rng, n_resamples
        Source and number of the resamples.

    Returns
    -------
    FloatArray
        Shape ``(n_resamples, ...)``.
    """
    m, se = np.asarray(mean, dtype=float), np.asarray(standard_error, dtype=float)
    if m.shape != se.shape or (se < 0).any():
        raise ValueError(
            f"means have shape {m.shape} and standard errors {se.shape}; give one error of at "
            "least 0 for each mean."
        )
    draws: FloatArray = m + se * rng.standard_normal((n_resamples, *m.shape))
    return draws


def two_sided(draws: ArrayLike) -> FloatArray:
    """Two-sided p-value that a quantity is 0, from its bootstrap resamples.

    Parameters
    ----------
    draws
        Shape ``(n_resamples, ...)``.

    Returns
    -------
    FloatArray
        Shape ``(...)``; at least ``2 / (n_resamples + 1)``, NaN where the resamples are.
    """
    x = np.asarray(draws, dtype=float)
    least = np.minimum((x <= 0).sum(axis=0), (x >= 0).sum(axis=0))
    p = np.minimum(1.0, 2 * (least + 1) / (len(x) + 1))
    return np.where(np.isnan(x).any(axis=0), np.nan, p)


def combined(p_values: ArrayLike) -> tuple[float, float]:
    """Chi-square over independent comparisons of which only p-values are comparable.

    Each two-sided p-value becomes the squared normal deviate of the same p, so that tests of few
    runs, whose t has heavy tails, count for what they are; their sum is chi-square with one
    degree of freedom a comparison.

    Parameters
    ----------
    p_values
        Shape ``(n,)``, each in (0, 1].

    Returns
    -------
    tuple[float, float]
        The sum, and its p-value.
    """
    p = np.asarray(p_values, dtype=float)
    if p.ndim != 1 or not len(p) or not ((p > 0) & (p <= 1)).all():
        raise ValueError(f"p-values must be a list of numbers in (0, 1], but they are {p}.")
    total = float(stats.chi2.isf(p, 1).sum())
    return total, float(stats.chi2.sf(total, len(p)))


def chi_square(observed: ArrayLike, expected: ArrayLike, sd: ArrayLike) -> float:
    r"""Sum of squared standardised differences, :math:`\sum ((o-e)/s)^2`."""
    o, e, s = (np.asarray(v, dtype=float) for v in (observed, expected, sd))
    return float((((o - e) / s) ** 2).sum())
