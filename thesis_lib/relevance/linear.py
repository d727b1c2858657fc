r"""Relevance for linear cross-task functions, fitted by least squares (section 4.5).

Let a cross-task function be linear in columns :math:`\psi_j(x)`, each of which reads some of
the features.  Regression on the solutions of all tasks of a sequence c at once,

.. math:: \min_w \frac1k \sum_i \sum_x p(x|c_i) \bigl(Q_{c_i}(x) - w^\top\psi(x)\bigr)^2
          = \text{const} + \min_w \sum_x p(x|c) \bigl(Q_c(x) - w^\top\psi(x)\bigr)^2,

is regression on the cross-task Q-function of equation 4.5.  Removing features takes away the
columns that read them; the k-relevance of doing so is the expected rise of the mean squared
error.  With H the span of all columns and L that of the columns left, and shared p(x|m), the
rise is :math:`|(\Pi_H - \Pi_L) Q_c|^2 = B(Q_c, Q_c)` with the bilinear
:math:`B(f, g) = \langle (\Pi_H - \Pi_L) f, g \rangle_p`, hence

.. math:: \rho_k = \rho_\infty + (\rho_1 - \rho_\infty)/k

as for tables, which are the case of one column a pair.  The weights are linear in Q as well:
their mean over sequences does not change with k, and their mean squares obey the same law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg

from thesis_lib.arrays import BoolArray, FloatArray
from thesis_lib.checks import one_of
from thesis_lib.relevance.estimators import Estimate, law
from thesis_lib.relevance.exact import check_distribution, check_lengths
from thesis_lib.relevance.solutions import ACTION, Solutions

Interactions = Literal["none", "action", "pairs"]
"""Columns beside those of single features: none, products with the action, or of all pairs."""

RANK = 1e-10
"""Directions shorter than this share of the longest are linearly dependent on others."""


@dataclass(frozen=True, eq=False)
class Basis:
    r"""Columns of a linear function, and the features that each of them reads.

    Attributes
    ----------
    columns
        :math:`\psi_j(x)`, shape ``(N, d)``.
    uses
        Whether column j reads feature f, shape ``(d, F)``.  A column of a constant reads none.
    """

    columns: FloatArray
    uses: BoolArray

    def __post_init__(self) -> None:
        columns, uses = np.asarray(self.columns, dtype=float), np.asarray(self.uses, dtype=bool)
        if columns.ndim != 2 or uses.ndim != 2 or columns.shape[1] != len(uses):
            raise ValueError(
                f"columns has shape {columns.shape} and uses {uses.shape}, but (pairs, columns) "
                "and (columns, features) are needed."
            )
        if not np.isfinite(columns).all():
            raise ValueError("columns holds values that are not finite; replace or drop them.")
        object.__setattr__(self, "columns", columns)
        object.__setattr__(self, "uses", uses)

    def within(self, kept: ArrayLike) -> BoolArray:
        """Columns that read kept features only, shape ``(d,)``.

        Parameters
        ----------
        kept
            Which features are kept, shape ``(F,)``.
        """
        return ~(self.uses & ~np.asarray(kept, dtype=bool)).any(axis=1)


def feature_basis(
    solutions: Solutions, interactions: Interactions = "action", numeric: Sequence[str] = ()
) -> Basis:
    """Columns made of the features: a constant, each feature, and products.

    Parameters
    ----------
    solutions
        Gives the pairs and their features.
    interactions
        Products of two features: none, those with the action, or all.
    numeric
        Features that enter as one column of their values; the others as one column for each
        value but the first.  A feature of two values is the same either way.

    Returns
    -------
    Basis
        Columns centred and scaled to a mean square of 1 over the pairs; constant features
        have none.
    """
    one_of("interactions", interactions, ("none", "action", "pairs"))
    as_number = solutions.mask(numeric)
    single = [
        _codes(column, bool(number))
        for column, number in zip(solutions.features.T, as_number, strict=True)
    ]
    n_features = solutions.n_features
    pairs: list[tuple[int, int]] = []
    if interactions == "pairs":
        pairs = list(combinations(range(n_features), 2))
    elif interactions == "action":
        a = solutions.index(ACTION)
        pairs = [(f, a) for f in range(n_features) if f != a]
    columns, uses = [np.ones((solutions.n_pairs, 1))], [np.zeros(n_features, dtype=bool)]
    for read in [*((f,) for f in range(n_features)), *pairs]:
        block = single[read[0]]
        for f in read[1:]:
            block = (block[:, :, None] * single[f][:, None, :]).reshape(len(block), -1)
        columns.append(block)
        uses += [np.isin(np.arange(n_features), read)] * block.shape[1]
    return Basis(np.concatenate(columns, axis=1), np.array(uses))


def _codes(column: np.ndarray, number: bool) -> FloatArray:
    """A feature as columns with mean 0 and mean square 1, shape ``(N, values - 1)`` or one."""
    values = np.unique(column)
    if len(values) == 1:
        return np.empty((len(column), 0))
    raw = column[:, None].astype(float) if number else (column[:, None] == values[1:]).astype(float)
    raw = raw - raw.mean(axis=0)
    return raw / np.sqrt((raw**2).mean(axis=0))


@dataclass(frozen=True, eq=False)
class LinearClass:
    """The tasks' solutions as a linear function sees them, in an orthonormal basis.

    Attributes
    ----------
    coefficients
        Coordinates of each task's fit, shape ``(M, r)``.
    coordinates
        Coordinates of each column, shape ``(r, d)``.
    """

    coefficients: FloatArray
    coordinates: FloatArray

    def products(self, columns: BoolArray) -> FloatArray:
        """Inner products of the tasks' fits by some of the columns, shape ``(M, M)``.

        Parameters
        ----------
        columns
            Which, shape ``(d,)``.
        """
        fitted = self.coefficients @ _span(self.coordinates[:, columns])
        return fitted @ fitted.T


def linear_class(solutions: Solutions, basis: Basis) -> LinearClass:
    """Project the solutions on a linear function class, in the norm weighted by p(x).

    Parameters
    ----------
    solutions
        M task solutions with one p(x|m), all on all pairs.
    basis
        Its columns, for the same pairs.

    Raises
    ------
    ValueError
        When tasks do not share p(x|m), or the basis has another number of pairs.
    """
    if not solutions.shared:
        raise ValueError(
            "the tasks have different p(x|m), but one projection for all is needed; give all tasks "
            "the same p, or select on tables."
        )
    if len(basis.columns) != solutions.n_pairs:
        raise ValueError(
            f"the basis has {len(basis.columns)} rows, but there are {solutions.n_pairs} pairs; "
            "make it of the same solutions."
        )
    p = solutions.p[0]
    seen = p > 0
    root = np.sqrt(p[seen])
    weighted = root[:, None] * basis.columns[seen]
    axes = _span(weighted)
    # Where every projection holds the constants, what all values share cancels, rounding with it.
    constant = not basis.uses.any(axis=1).all()
    values = root * (solutions.q[:, seen] - (solutions.centre if constant else 0.0))
    return LinearClass(values @ axes, axes.T @ weighted)


def _span(columns: FloatArray) -> FloatArray:
    """Orthonormal basis of the span of some columns."""
    if columns.shape[1] == 0:
        return np.empty((len(columns), 0))
    basis, triangle, _ = linalg.qr(columns, mode="economic", pivoting=True, check_finite=False)
    size = np.abs(np.diag(triangle))
    return np.asarray(basis[:, size > RANK * max(size[0], np.finfo(float).tiny)])


def increment_covariance(
    solutions: Solutions, basis: Basis, kept: ArrayLike, reference: ArrayLike | None = None
) -> FloatArray:
    r"""Matrix :math:`B_{ij} = \langle (\Pi_H - \Pi_L) Q_i, Q_j \rangle_p`, shape ``(M, M)``.

    Parameters
    ----------
    solutions, basis
        As for :func:`linear_class`.
    kept
        Features of L, shape ``(F,)`` bool.
    reference
        Features of H, a superset; default all.

    Returns
    -------
    FloatArray
        Its mean is the rise of the mean squared error of the function fitted to all tasks.
    """
    left = np.asarray(kept, dtype=bool)
    whole = np.ones_like(left) if reference is None else np.asarray(reference, dtype=bool)
    if (left & ~whole).any():
        raise ValueError("kept has features that reference lacks, but it must be a subset of it.")
    fitted = linear_class(solutions, basis)
    return fitted.products(basis.within(whole)) - fitted.products(basis.within(left))


def linear_k_relevance(
    solutions: Solutions,
    basis: Basis,
    kept: ArrayLike,
    k: ArrayLike,
    distribution: ArrayLike | None = None,
) -> FloatArray:
    r"""Exact k-relevance of restricting a linear function to some features.

    Parameters
    ----------
    solutions, basis
        As for :func:`linear_class`; all tasks of the domain.
    kept
        Features kept, shape ``(F,)`` bool.
    k
        Sequence lengths, a number or an array.
    distribution
        D(m); default uniform.

    Returns
    -------
    FloatArray
        :math:`\rho_k`, shaped as ``k``.
    """
    lengths = check_lengths(k)
    D = check_distribution(distribution, solutions.n_tasks)
    B = increment_covariance(solutions, basis, kept)
    limit, first = float(D @ B @ D), float(D @ np.diag(B))
    return np.reshape(limit + (first - limit) / lengths, np.shape(k))


def estimate_from(products: ArrayLike) -> Estimate:
    """Estimate of domain relevance from the matrix B of n observed tasks.

    Parameters
    ----------
    products
        :math:`B_{ij}`, shape ``(n, n)``, n at least 2.
    """
    B = np.asarray(products, dtype=float)
    unbiased, single = law(B)
    return Estimate(max(float(B.mean()), 0.0), unbiased, single - unbiased, len(B))
