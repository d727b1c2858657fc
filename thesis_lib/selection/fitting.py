r"""The exponential fit of algorithm 7 and the threshold it amounts to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import leastsq
from scipy.stats import t as student

from thesis_lib.arrays import FloatArray

Alpha = float | Callable[[int], float]

MAX_CONDITION = float(1 / np.sqrt(np.finfo(float).eps))
"""Condition number of the Jacobian from which a fit counts as ill-conditioned, 6.7e7."""

MAX_EVALUATIONS = 300
"""Evaluations after which a fit counts as not converged; those that converge need about 20."""


@dataclass(frozen=True)
class ExponentialFit:
    r"""Least-squares fit of :math:`f(k; \theta) = \theta_1 + \theta_2 e^{-\theta_3 k}`.

    Attributes
    ----------
    theta
        Parameters, shape ``(3,)``.
    standard_error
        Of :math:`\theta_1`, the value at the asymptote, from the linearised covariance
        :math:`s^2 (J^T J)^{-1}`; NaN for three points.
    residual_error
        s, with n - 3 degrees of freedom; NaN for three points.
    condition
        Condition number of the Jacobian at the solution.
    n_points
        n.
    """

    theta: FloatArray
    standard_error: float
    residual_error: float
    condition: float
    n_points: int

    @property
    def asymptote(self) -> float:
        r"""Extrapolated relevance :math:`\theta_1`."""
        return float(self.theta[0])

    @property
    def decay(self) -> float:
        r"""Rate :math:`\theta_3`; the curve has an asymptote only if it is above 0."""
        return float(self.theta[2])

    @property
    def increasing(self) -> bool:
        """Whether f(2) > f(1) (algorithm 7, line 15)."""
        _, scale, rate = self.theta
        return bool(scale * (np.exp(-2 * rate) - np.exp(-rate)) > 0)

    def scaled(self, shift: float, scale: float) -> ExponentialFit:
        """The fit to ``shift + scale * data``, with scale above 0."""
        theta = self.theta * np.array([scale, scale, 1.0]) + np.array([shift, 0.0, 0.0])
        return ExponentialFit(
            theta,
            scale * self.standard_error,
            scale * self.residual_error,
            self.condition,
            self.n_points,
        )


def fit_exponential(values: ArrayLike) -> ExponentialFit | None:
    r"""Fit D(1), ..., D(n) by Levenberg-Marquardt.

    Data are first shifted and scaled to end at 0 and span 1.  The fitted curve is
    affine-equivariant, so this changes nothing but the condition number, which
    without it would depend on the unit of reward.

    Parameters
    ----------
    values
        D(k) for k = 1 .. n, at least 3, not all equal.

    Returns
    -------
    ExponentialFit or None
        None when the algorithm does not converge.

    Notes
    -----
    Source: algorithm 7, line 14; section 4.3 for the algorithm.  The start is the curve
    through the first and the last point with :math:`\theta_3 = 1/2`.
    """
    data = np.asarray(values, dtype=float)
    if data.ndim != 1 or len(data) < 3 or not np.isfinite(data).all():
        raise ValueError(
            f"values has shape {data.shape}, but at least 3 finite relevances are needed to fit 3 "
            "parameters."
        )
    span = float(np.ptp(data))
    if span == 0:
        raise ValueError(
            f"all values are {data[0]:.6g}, but a constant has no decay to fit; take it as its own "
            "limit."
        )
    fit = _fit(((data - data[-1]) / span).tobytes())
    return None if fit is None else fit.scaled(float(data[-1]), span)


@cache
def fit_inverse(n: int) -> ExponentialFit:
    r"""Fit of the exponential to 1/k, k = 1 .. n.

    By the law D(k) = U + (b - U)/k, the fit to any relevance curve of tasks with shared
    p(x|m) is ``fit_inverse(n).scaled(U, b - U)``.

    Parameters
    ----------
    n
        Number of tasks, at least 3.
    """
    inverse = 1.0 / np.arange(1, n + 1)
    fit = fit_exponential(inverse)
    if fit is None:
        raise RuntimeError(f"the fit to 1/k at n = {n} did not converge; report this as a bug.")
    return fit


def fstek_threshold(n: int, alpha: float) -> float:
    r"""F-ratio up to which FS-TEK removes a feature, for tasks with shared p(x|m).

    With D(k) = U + (b - U)/k the asymptote of the fit is U + h (b - U) and its standard
    error is :math:`\sigma` (b - U), with h and :math:`\sigma` those of the fit to 1/k.
    A feature goes if :math:`U + h (b - U) \le t \sigma (b - U)`, and F = 1 + n U/(b - U)
    turns this into

    .. math:: F \le 1 + n\,(t_{1-\alpha/2,\,n-3}\,\sigma(n) - h(n)).

    Parameters
    ----------
    n
        Number of observed tasks, at least 4.
    alpha
        Significance level of the interval, in (0, 1).

    Returns
    -------
    float
        The threshold.  Below 0 FS-TEK removes nothing, whatever the data.

    Notes
    -----
    The interval measures how badly an exponential fits 1/k.  No term of it depends on
    how much the tasks' solutions scatter.
    """
    level = check_alpha(alpha, n)
    if n < 4:
        raise ValueError(
            f"n is {n}, but an interval around a fit of 3 parameters needs at least 4 tasks."
        )
    fit = fit_inverse(n)
    t = student_tail(level / 2, n - 3)
    return float(1 + n * (t * fit.standard_error - fit.asymptote))


def triangle_alpha(k: int, first: int = 5) -> float:
    r"""FS-TEK's level on the triangle, :math:`\min(\max(k - 5, 0) \cdot .06 + 10^{-4}, .3)`.

    Parameters
    ----------
    k
        Number of observed tasks.
    first
        The k up to which the level is 1e-4.  The formula of the text subtracts 4, but its
        words say "up to k = 5", which comes nearer to the rate printed for five tasks.

    Notes
    -----
    Source: section 4.3, with the words' reading as default.
    """
    return min(max(k - first, 0) * 0.06 + 1e-4, 0.3)


@lru_cache(maxsize=4096)
def student_tail(tail: float, freedom: int) -> float:
    """Value that Student's t exceeds with probability ``tail``, kept for the next call.

    Parameters
    ----------
    tail
        In (0, 1).
    freedom
        Degrees of freedom.
    """
    return float(student.isf(tail, freedom))


def check_alpha(alpha: Alpha, n: int) -> float:
    """Evaluate a level or a schedule at n tasks; it must be in (0, 1)."""
    value = alpha(n) if callable(alpha) else alpha
    if not isinstance(value, (int, float, np.floating)) or not 0.0 < value < 1.0:
        raise ValueError(
            f"alpha is {value!r} at {n} tasks, but a level must be a number in (0, 1)."
        )
    return float(value)


@lru_cache(maxsize=4096)
def _fit(values: bytes) -> ExponentialFit | None:
    """Fit to an array's bytes, kept for the next selector that sees the same curve."""
    data = np.frombuffer(values)
    n = len(data)
    k = np.arange(1.0, n + 1)

    def residual(theta: FloatArray) -> FloatArray:
        return theta[0] + theta[1] * np.exp(-theta[2] * k) - data

    def jacobian(theta: FloatArray) -> FloatArray:
        slopes = np.ones((n, 3))
        slopes[:, 1] = decay = np.exp(-theta[2] * k)
        slopes[:, 2] = -theta[1] * k * decay
        return slopes

    start = np.array([data[-1], (data[0] - data[-1]) * np.exp(0.5), 0.5])
    with np.errstate(over="ignore", invalid="ignore"):
        theta, _, _, _, status = leastsq(
            residual,
            start,
            Dfun=jacobian,
            full_output=True,
            ftol=1e-14,
            xtol=1e-14,
            maxfev=MAX_EVALUATIONS,
        )
        if status not in (1, 2, 3, 4) or not np.isfinite(theta).all():
            return None
        J = jacobian(theta)
        error = residual(theta)
    if not (np.isfinite(J).all() and np.isfinite(error).all()):
        return None
    _, size, right = np.linalg.svd(J, full_matrices=False)
    condition = float(size[0] / size[-1]) if size[-1] > 0 else float("inf")
    if n == 3 or not np.isfinite(condition):
        return ExponentialFit(theta, float("nan"), float("nan"), condition, n)
    s = float(np.sqrt(error @ error / (n - 3)))
    return ExponentialFit(theta, s * float(np.linalg.norm(right[:, 0] / size)), s, condition, n)
