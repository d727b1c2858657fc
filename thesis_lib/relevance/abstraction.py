r"""Abstraction and relevance of one Q-function (definitions 1 to 4), and cross-task Q (eq. 4.5).

An abstraction is an array of labels, one integer a state-action pair, equal where the
abstraction merges pairs; :func:`keep` and :func:`remove` make them from features.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.relevance.cells import check_labels
from thesis_lib.relevance.solutions import ATOL, Solutions


def cross_task_q(
    solutions: Solutions, sequence: ArrayLike | None = None
) -> tuple[FloatArray, FloatArray]:
    r"""Cross-task Q-function of a sequence, :math:`Q_c(x) = \sum_i p(c_i|x, c) Q_{c_i}(x)`.

    Parameters
    ----------
    solutions
        M task solutions on N pairs.
    sequence
        Task indices c, shape ``(k,)``, repeats allowed; default every task once.

    Returns
    -------
    q
        :math:`Q_c(x)`, shape ``(N,)``; NaN outside :math:`X_c`.
    p
        :math:`p(x|c) = \frac{1}{k}\sum_i p(x|c_i)`, shape ``(N,)``.

    Notes
    -----
    Source: equation 4.5.  With the empirical D of the sequence,
    :math:`p(c_i|x, c) = p(x|c_i) / \sum_j p(x|c_j)`.
    """
    chosen = solutions if sequence is None else solutions.take(np.asarray(sequence))
    p = chosen.p.sum(axis=0)
    with np.errstate(invalid="ignore"):
        products = np.where(chosen.p > 0, chosen.p * chosen.q, 0.0).sum(axis=0)
        return products / p, p / chosen.n_tasks


def abstract_q(labels: ArrayLike, q: ArrayLike, p: ArrayLike) -> FloatArray:
    r"""Abstract Q-function :math:`\bar Q_\phi(y) = \sum_{x \in \phi^{-1}(y)} p(x|y) Q(x)`.

    Parameters
    ----------
    labels
        Abstract pair of each pair, shape ``(N,)``.
    q
        Q(x), shape ``(N,)``; not read where p is 0.
    p
        p(x), shape ``(N,)``.

    Returns
    -------
    FloatArray
        Shape ``(G,)``, in the order of the sorted labels; NaN where p(y) = 0.

    Notes
    -----
    Source: definition 2, equation 4.1.
    """
    y, values, weights, n = _prepare(labels, q, p)
    with np.errstate(invalid="ignore"):
        return np.bincount(y, weights * values, n) / np.bincount(y, weights, n)


def abstraction_error(labels: ArrayLike, q: ArrayLike, p: ArrayLike) -> FloatArray:
    r"""Mean squared abstraction error of each abstract pair, :math:`\varepsilon_\phi(y, Q)`.

    Parameters
    ----------
    labels, q, p
        As for :func:`abstract_q`.

    Returns
    -------
    FloatArray
        Shape ``(G,)``; NaN where p(y) = 0.

    Notes
    -----
    Source: definition 3, equation 4.2.
    """
    y, values, weights, n = _prepare(labels, q, p)
    residual = values - abstract_q(labels, q, p)[y]
    residual[weights == 0] = 0.0
    with np.errstate(invalid="ignore"):
        return np.bincount(y, weights * residual**2, n) / np.bincount(y, weights, n)


def relevance(labels: ArrayLike, q: ArrayLike, p: ArrayLike) -> float:
    r"""Relevance of an abstraction, :math:`\rho_\phi(Q) = \sum_y p(y)\, \varepsilon_\phi(y, Q)`.

    Parameters
    ----------
    labels, q, p
        As for :func:`abstract_q`.

    Returns
    -------
    float
        The error made by using the abstraction; 0 when it loses nothing.

    Notes
    -----
    Source: definition 4, equation 4.3.
    """
    y, _, weights, n = _prepare(labels, q, p)
    mass = np.bincount(y, weights, n)
    seen = mass > 0
    return float(mass[seen] @ abstraction_error(labels, q, p)[seen])


def relevance_by_variance(labels: ArrayLike, q: ArrayLike, p: ArrayLike) -> float:
    r"""Relevance as a sum of variances, :math:`\sum_y p(y) \mathrm{Var}(Q(\phi^{-1}(y)))`.

    Each variance is a mean square less a squared mean, a different sum from that of
    :func:`relevance`; the two agree to rounding.

    Parameters
    ----------
    labels, q, p
        As for :func:`abstract_q`.

    Notes
    -----
    Source: equation 4.4.
    """
    y, values, weights, n = _prepare(labels, q, p)
    # Variances do not change with the origin; about the mean they are sums of small numbers.
    values = values - weights @ values
    mass = np.bincount(y, weights, n)
    seen = mass > 0
    first = np.bincount(y, weights * values, n)[seen] / mass[seen]
    second = np.bincount(y, weights * values**2, n)[seen] / mass[seen]
    return float(mass[seen] @ (second - first**2))


def _prepare(
    labels: ArrayLike, q: ArrayLike, p: ArrayLike
) -> tuple[IntArray, FloatArray, FloatArray, int]:
    values = np.asarray(q, dtype=float)
    weights = np.asarray(p, dtype=float)
    if values.ndim != 1 or weights.shape != values.shape or len(values) == 0:
        raise ValueError(
            f"q has shape {values.shape} and p {weights.shape}, but one number for each "
            "state-action pair is needed in both."
        )
    total = weights.sum()
    if not np.isfinite(total) or weights.min() < 0 or abs(total - 1) > ATOL:
        raise ValueError(
            f"p sums to {total:.12g} with smallest entry {weights.min():.6g}, but weights must be "
            "at least 0 and sum to 1; divide them by their sum."
        )
    bad = (weights > 0) & ~np.isfinite(values)
    if bad.any():
        x = int(np.argmax(bad))
        raise ValueError(
            f"q at pair {x} is {values[x]}, but p is {weights[x]:.6g} there; a pair with positive "
            "weight needs a finite value."
        )
    y = check_labels(labels, len(values))
    return y, np.where(weights > 0, values, 0.0), weights, int(y.max()) + 1
