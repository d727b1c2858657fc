r"""Estimates of domain relevance from the observed tasks, without sequences or curve fits.

With shared p(x|m), :math:`B(f, g) = \sum_y p(y)\, \mathrm{Cov}(f, g \mid y)` is bilinear,
symmetric and positive semi-definite, and :math:`\rho_\phi(Q) = B(Q, Q)`.  Write
:math:`B_{ij} = B(Q_{s_i}, Q_{s_j})` for n observed tasks, b for the mean of the diagonal
and U for the mean of the other elements.  A combination of k different tasks has
:math:`Q_c = \frac{1}{k} \sum_{i \in c} Q_i`, so its relevance is the mean of a k x k
submatrix; averaged over all combinations the k diagonal elements have mean b and the
k(k - 1) others mean U:

.. math:: D(k) = U + (b - U) / k.

Tasks drawn i.i.d. from D have :math:`\mathrm{E}\, B_{ij} = B(Q_d, Q_d) = \rho_\infty` for
i != j and :math:`\mathrm{E}\, B_{ii} = \rho_1`, so U is an unbiased estimate of domain
relevance and b of task relevance.  If n different tasks are drawn from a domain of N
without replacement, :math:`\mathrm{E}\, U` is instead the mean of the domain's other
elements and :math:`\rho_\infty = (1 - 1/N)\,\mathrm{E}\,U + \mathrm{E}\,b / N`.

Where p(x|m) differs between tasks :math:`\rho_k = \rho_\infty + c/k + O(1/k^2)`, and the
delete-one jackknife :math:`J = n V_n - (n - 1) \bar V_{n-1}` removes the 1/k term.  As
:math:`V_n = D(n)` and :math:`\bar V_{n-1} = D(n - 1)`, J = U when p is shared.

*There, no estimate is unbiased, however many tasks are seen.*  The mean of any function of n
independent tasks is a polynomial of degree at most n in D.  Two tasks with chances
:math:`1 - t` and t, of which the first visits only the pair x and the second x and z equally
often, give x the weight :math:`1 - t/2` and

.. math:: \rho_\infty(t) = \frac{((1-t)\, q_1 + t q_2 / 2)^2}{1 - t/2} + \frac{t}{2} z_2^2
          - \bigl((1-t)\, q_1 + t (q_2 + z_2)/2\bigr)^2

when both pairs are merged.  The fraction is a polynomial only if its numerator vanishes at t = 2,
that is if :math:`q_1 = q_2`: else :math:`\rho_\infty` is no polynomial, and no function of any
number of tasks has it for its mean on all of these domains.  What *can* be estimated without
bias is how much better a function of n - 1 tasks predicts the next one with a feature than
without (:mod:`thesis_lib.selection.prediction`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import FloatArray
from thesis_lib.checks import positive_integer
from thesis_lib.relevance.cells import Cells, ground, partition
from thesis_lib.relevance.exact import shared_law
from thesis_lib.relevance.solutions import Solutions

LEFT = 1e-12
"""Share of a cell's weight below which nothing is left of it but rounding."""


@dataclass(frozen=True)
class Estimate:
    r"""What n observed tasks say about the domain relevance of an abstraction.

    Attributes
    ----------
    observed
        :math:`V_n`, the relevance on the cross-task Q of all n tasks.
    domain
        J, the jackknife estimate of :math:`\rho_\infty`; equal to the unbiased U where
        tasks share p(x|m).  May be below 0.
    spread
        :math:`\hat c = n (V_n - J)`, the estimate of :math:`\lim k (\rho_k -
        \rho_\infty)`.  Where tasks share p(x|m) it is the trace of the covariance matrix
        of the tasks' residuals, b - U.
    n_tasks
        n.
    """

    observed: float
    domain: float
    spread: float
    n_tasks: int

    @property
    def f_ratio(self) -> float:
        r"""Mean effect, squared, over its variance between tasks, :math:`F = n V_n / \hat c`.

        With residuals :math:`Z_i` of the tasks, mean :math:`\bar Z` and covariance matrix
        S, :math:`V_n = |\bar Z|^2` and :math:`\hat c = \mathrm{tr}\,S`; F has expectation
        near 1 where the domain relevance is 0.  It is 0 where nothing was observed
        (:math:`V_n = 0`) and infinite where relevance does not fall with the number of
        tasks (:math:`\hat c \le 0`).
        """
        if self.observed <= 0.0:
            return 0.0
        return self.n_tasks * self.observed / self.spread if self.spread > 0 else float("inf")


def estimate(
    solutions: Solutions, labels: ArrayLike, reference: ArrayLike | None = None
) -> Estimate:
    r"""Jackknife estimate of domain relevance.

    Parameters
    ----------
    solutions
        n observed task solutions, at least 2.
    labels
        The abstraction, shape ``(N,)``.
    reference
        Labels of a finer abstraction; the estimate is then of the increment
        :math:`\rho(\phi) - \rho(\phi_{\text{reference}})`.  Default the pairs themselves.

    Raises
    ------
    ValueError
        When there is one task only, or ``reference`` is not finer than ``labels``.
    """
    cells = partition(solutions, labels)
    if reference is None:
        return compare(ground(solutions), cells)
    finer = partition(solutions, reference)
    pairs = np.stack([np.asarray(reference), np.asarray(labels)], axis=1)
    if len(np.unique(pairs, axis=0)) > finer.n_cells:
        raise ValueError(
            "reference splits cells of the abstraction across its own cells, but an increment "
            "needs a reference that is finer than the abstraction; refine the reference."
        )
    return compare(finer, cells)


def compare(finer: Cells, coarser: Cells) -> Estimate:
    """Jackknife estimate of the relevance lost between two nested partitions.

    Parameters
    ----------
    finer, coarser
        Sums over cells; each cell of ``coarser`` is a union of cells of ``finer``.
    """
    return compare_parts(finer.n_tasks, jackknife_parts(finer), jackknife_parts(coarser))


def compare_parts(
    n_tasks: int, finer: tuple[float, float], coarser: tuple[float, float]
) -> Estimate:
    """The same from the two :func:`jackknife_parts`, for when one is compared with many.

    Parameters
    ----------
    n_tasks
        n.
    finer, coarser
        Parts of the two partitions.
    """
    # Merging cells never explains more; a negative difference is rounding.
    observed = max(finer[0] - coarser[0], 0.0)
    spread = finer[1] - coarser[1]
    return Estimate(observed, observed - spread / n_tasks, spread, n_tasks)


def finite_domain(unbiased: float, single: float, n_domain: int) -> float:
    r"""Domain relevance when the observed tasks are different tasks of a finite domain.

    Parameters
    ----------
    unbiased
        U, the mean of the covariance matrix's elements off the diagonal.
    single
        b, the mean of its diagonal.
    n_domain
        Number of tasks N in the domain, all equally likely.

    Returns
    -------
    float
        :math:`(1 - 1/N) U + b/N`, unbiased for :math:`\rho_\infty` when tasks are drawn
        without replacement.
    """
    n = positive_integer("n_domain", n_domain)
    return (1 - 1 / n) * unbiased + single / n


def law(covariances: ArrayLike) -> tuple[float, float]:
    """Mean of the elements off the diagonal, U, and on it, b, of a covariance matrix.

    Parameters
    ----------
    covariances
        :math:`B_{ij}`, shape ``(n, n)``, n at least 2.

    Returns
    -------
    tuple of float
        U and b, so that D(k) = U + (b - U) / k over combinations of k tasks.
    """
    B = np.asarray(covariances, dtype=float)
    n = len(B)
    if B.shape != (n, n) or n < 2:
        raise ValueError(
            f"covariances has shape {B.shape}, but a square matrix of at least 2 tasks is needed."
        )
    trace = np.trace(B)
    return float((B.sum() - trace) / (n * (n - 1))), float(trace / n)


def inner_products(cells: Cells, centred: bool = False) -> FloatArray:
    r"""Products :math:`\sum_y a_i(y) a_j(y) / \bar b(y)` of tasks, shape ``(n, n)``.

    Parameters
    ----------
    cells
        Sums over the cells of a partition, for n tasks; :math:`\bar b` is their mean
        weight.
    centred
        Use :math:`a_i - r\, b_i` instead, r the cell's mean Q-value: the deviation of a
        task from the mean of all.
    """
    b = cells.b.mean(axis=0)
    seen = b > 0
    a = cells.a[:, seen]
    if centred:
        a = a - a.mean(axis=0) / b[seen] * cells.b[:, seen]
    return (a / b[seen]) @ a.T


def jackknife_parts(cells: Cells) -> tuple[float, float]:
    r"""Explained mean square of all tasks, and n (n - 1) times its mean rise without one.

    With a' = a - r b and r = sum a / sum b, leaving task i out of a cell changes
    :math:`A^2/B` to :math:`a_i'^2/(B - b_i) + 2 r (-a_i') + r^2 (B - b_i)`; the last two
    average to the value of all tasks, so only the first, which is positive, remains.

    Parameters
    ----------
    cells
        Sums over the cells of a partition, for n tasks, at least 2.
    """
    kept = cells.__dict__.get("_jackknife")
    if kept is None:
        kept = cells.__dict__["_jackknife"] = _jackknife_parts(cells)
    return kept


def _jackknife_parts(cells: Cells) -> tuple[float, float]:
    n = cells.n_tasks
    if n < 2:
        raise ValueError(
            f"{n} task was given, but a jackknife estimate leaves one task out and needs at "
            "least 2; observe more tasks."
        )
    if cells.shared:
        # B - b_i = (n - 1) b for every task.
        explained, within = shared_law(cells, np.full(n, 1.0 / n))
        return explained, within * n / (n - 1)
    A = cells.a.sum(axis=0)
    total = cells.b.sum(axis=0)
    r = np.divide(A, total, out=np.zeros_like(A), where=total > 0)
    rest = total - cells.b
    change = cells.a - r * cells.b
    change *= change
    # A cell that only task i visits has nothing left without it, and a_i' is 0.
    left = rest > LEFT * total
    change = np.divide(change, rest, out=np.zeros_like(change), where=left)
    return float(A @ r) / n, float(change.sum())
