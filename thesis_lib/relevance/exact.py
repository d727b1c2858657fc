r"""k-relevance exactly, for any k, without listing a single sequence.

For a sequence c of k tasks and a cell y of a partition let :math:`B = \sum_i b_{c_i}(y)`
and :math:`A = \sum_i a_{c_i}(y)` (:mod:`thesis_lib.relevance.cells`).  The relevance of
an abstraction is the mean square it loses:

.. math:: \rho_\phi(Q_c) = E_c(\text{ground}) - E_c(\phi), \qquad
          E_c(\mathcal{P}) = \frac{1}{k} \sum_{y \in \mathcal{P}} \frac{A^2}{B},

because :math:`p(y|c) \bar Q_c(y)^2 = (B/k)(A/B)^2`.  So the expectation of :math:`A^2/B`
over sequences, cell by cell, gives :math:`\rho_k` of every abstraction, backward and
forward.  With r = E[A]/E[B] and :math:`A' = A - rB`,

.. math:: \tfrac{1}{k}\,\mathrm{E}[A^2/B] = \frac{(\mathrm{E} a)^2}{\mathrm{E} b}
          + \tfrac{1}{k}\,\mathrm{E}[A'^2/B],

the cell's limit plus a remainder that is never negative.  Three cases:

1. *Every task has the same weight b in the cell* (shared p(x|m)): the remainder is
   :math:`\mathrm{Var}(a) / (b k)`.  Summed over cells this is the law
   :math:`\rho_k = \rho_\infty + (\rho_1 - \rho_\infty)/k`.
2. *A task has weight b or does not visit the cell* (probability :math:`\pi` of a visit;
   uniform weights on equally many pairs, or a feature constant within tasks): given the
   number of visits the case above applies, so the remainder is
   :math:`\frac{v}{bk} (1 - (1-\pi)^k)`, v the variance of a among tasks that visit.
3. *Any weights*: :math:`1/B = \int_0^\infty e^{-tB} dt` turns the ratio into a product
   over independent tasks.  With :math:`\varphi(t) = \mathrm{E} e^{-tb}`,
   :math:`\varphi_1 = \mathrm{E}\, a' e^{-tb}`, :math:`\varphi_2 = \mathrm{E}\, a'^2 e^{-tb}`
   the remainder is :math:`\int_0^\infty \varphi_2 \varphi^{k-1} + (k-1) \varphi_1^2
   \varphi^{k-2}\, dt`, a sum of positive smooth terms for which double-exponential
   quadrature reaches rounding error.

For k of n observed tasks *without replacement* (the combinations of algorithm 8) the same
three cases hold with hypergeometric visits and, in the third, with the mean over
k-subsets of :math:`A'^2 \prod e^{-t b_i}`, which a recursion over tasks gives for all k;
where few tasks visit a cell, listing the subsets of those that do is faster.
"""

from __future__ import annotations

from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammaln

from thesis_lib.arrays import BoolArray, FloatArray, IntArray
from thesis_lib.checks import one_of
from thesis_lib.relevance.cells import Cells, ground, partition
from thesis_lib.relevance.solutions import ATOL, Solutions
from thesis_lib.relevance.subsets import MOST_VISITORS, listed_subsets

Direction = Literal["backward", "forward"]

EQUAL = 1e-12
"""Weights closer than this, relative to the largest, count as equal in cases 1 and 2."""

BLOCK = 2_000_000
"""Numbers held at once by the quadrature."""


def k_relevance(
    solutions: Solutions,
    labels: ArrayLike,
    k: ArrayLike,
    *,
    distribution: ArrayLike | None = None,
    replacement: bool = True,
    direction: Direction = "backward",
) -> FloatArray:
    r"""Exact k-relevance :math:`\rho_k(\phi)` for any k.

    Parameters
    ----------
    solutions
        The M tasks of the domain, or the tasks observed so far.
    labels
        The abstraction, shape ``(N,)``; see :func:`~thesis_lib.relevance.cells.remove`.
    k
        Sequence lengths, at least 1, any shape.
    distribution
        D(m), shape ``(M,)``; default uniform.
    replacement
        True: sequences drawn i.i.d. from D, as in definition 5.  False: the mean over
        all combinations of k different tasks, as in algorithm 8 with no limit on their
        number; D must then be left out and k is at most M.
    direction
        ``"backward"``: relevance of the abstraction, the error made by using it.
        ``"forward"``: what the abstraction explains, as in algorithm 9.

    Returns
    -------
    FloatArray
        Of the shape of ``k``.

    Raises
    ------
    ValueError
        When a k, D or the labels are out of range.

    Notes
    -----
    Source: definition 5, equation 4.6; the formula is this edition's.

    Examples
    --------
    In two tasks a colour means as much, and the opposite.

    >>> from thesis_lib.relevance import Solutions, TaskTable, remove
    >>> tables = [TaskTable(("colour", "a"), [[0, 0], [1, 0]], [-q, q]) for q in (1.0, -1.0)]
    >>> solutions = Solutions.from_tables(tables)
    >>> k_relevance(solutions, remove(solutions, ["colour"]), [1, 2, 4]).round(9).tolist()
    [1.0, 0.5, 0.25]
    """
    law = _Law(solutions, k, distribution, replacement, direction)
    return law(partition(solutions, labels)).reshape(np.shape(k))


def domain_relevance(
    solutions: Solutions,
    labels: ArrayLike,
    *,
    distribution: ArrayLike | None = None,
    direction: Direction = "backward",
) -> float:
    r"""Domain relevance :math:`\lim_{k\to\infty} \rho_k(\phi)`, the relevance on :math:`Q_d`.

    Parameters
    ----------
    solutions, labels, distribution, direction
        As for :func:`k_relevance`.

    Notes
    -----
    Source: equation 4.7 and corollary 1.

    Examples
    --------
    In two tasks a colour means as much, and the opposite.

    >>> from thesis_lib.relevance import Solutions, TaskTable, remove
    >>> tables = [TaskTable(("colour", "a"), [[0, 0], [1, 0]], [-q, q]) for q in (1.0, -1.0)]
    >>> solutions = Solutions.from_tables(tables)
    >>> domain_relevance(solutions, remove(solutions, ["colour"]))
    0.0
    """
    one_of("direction", direction, ("backward", "forward"))
    D = check_distribution(distribution, solutions.n_tasks)
    cells = partition(solutions, labels)
    if direction == "backward":
        return float(limit(ground(solutions), D).sum() - limit(cells, D).sum())
    return float(limit(cells, D).sum() - limit(cells.total(), D).sum())


def rate(
    solutions: Solutions, labels: ArrayLike, *, distribution: ArrayLike | None = None
) -> float:
    r"""Coefficient of the leading term, :math:`c = \lim_{k\to\infty} k(\rho_k - \rho_\infty)`.

    .. math:: c = \sum_{x} \frac{\mathrm{Var}_m(a_m(x) - r_x b_m(x))}{\mathrm{E} b(x)}
              - \text{the same over the cells of } \phi

    With shared p(x|m) it is :math:`\rho_1 - \rho_\infty \ge 0` and the law has no further
    terms; otherwise it may have either sign, and relevance may grow with k.

    Parameters
    ----------
    solutions, labels, distribution
        As for :func:`k_relevance`.
    """
    D = check_distribution(distribution, solutions.n_tasks)
    cells = partition(solutions, labels)
    return float(_leading(ground(solutions), D) - _leading(cells, D))


def second_rate(
    solutions: Solutions, labels: ArrayLike, *, distribution: ArrayLike | None = None
) -> float:
    r"""Coefficient of the second term, :math:`\lim k^2 (\rho_k - \rho_\infty - c/k)`.

    With :math:`a' = a - rb` and :math:`\bar a', \bar b` the means over k independent tasks, a
    cell's remainder is :math:`\mathrm{E}\, \bar a'^2 / \bar b`.  Expand :math:`1/\bar b` about
    :math:`B = \mathrm{E} b` with the exact rest :math:`(\bar b - B)^2 / (B^2 \bar b)`:

    .. math:: \mathrm{E} \frac{\bar a'^2}{\bar b} = \frac{\mathrm{E} \bar a'^2}{B}
              - \frac{\mathrm{E} \bar a'^2 (\bar b - B)}{B^2}
              + \mathrm{E} \frac{\bar a'^2 (\bar b - B)^2}{B^2\, \bar b}.

    The first is :math:`\mathrm{Var}(a')/(kB)`, the second :math:`-\mathrm{E} a'^2(b - B)/(k^2
    B^2)`, both exactly, as means of independent centred terms.  Where :math:`\bar b \ge B/2` the
    third is at most :math:`2\, \mathrm{E} \bar a'^2 (\bar b - B)^2 / B^3`, a fourth moment of
    means and so :math:`O(1/k^2)`; elsewhere :math:`\bar a'^2 / \bar b \le \max a'^2/b` by Cauchy
    and Schwarz, and by Hoeffding the chance is :math:`e^{-\Omega(k)}`.  **So the rest after c/k is
    O(1/k²)**, for which the law of large numbers alone, giving o(1/k), is not enough.  Its leading
    coefficient is, summed over the pairs less over the cells of :math:`\phi`,

    .. math:: -\frac{\mathrm{E} a'^2 (b - B)}{B^2}
              + \frac{\mathrm{Var}(a')\,\mathrm{Var}(b) + 2\,\mathrm{Cov}(a', b)^2}{B^3}.

    Parameters
    ----------
    solutions, labels, distribution
        As for :func:`k_relevance`.
    """
    D = check_distribution(distribution, solutions.n_tasks)
    return _second(ground(solutions), D) - _second(partition(solutions, labels), D)


def explained(cells: Cells, k: ArrayLike, distribution: FloatArray) -> FloatArray:
    r"""Expected explained mean square :math:`\mathrm{E}[E_c(\mathcal{P})]`, i.i.d. sequences.

    Parameters
    ----------
    cells
        Sums over the cells of the partition, for M tasks.
    k
        Sequence lengths, shape ``(K,)``.
    distribution
        D(m), shape ``(M,)``.

    Returns
    -------
    FloatArray
        Shape ``(K,)``; relevance is a difference of two of these, so the origin of Q
        does not matter.
    """
    lengths = np.asarray(k)
    D = np.asarray(distribution, dtype=float)
    if cells.shared:
        # Case 1.
        last, within = shared_law(cells, D)
        return last + within / lengths
    r = _ratio(cells, D)
    out = np.full(len(lengths), (D @ cells.a) @ r)
    a = cells.a - r * cells.b
    b, binary, general = _classify(cells.b)
    if binary.any():
        # Case 2; 1 - (1 - pi)^k without cancellation, and 1 where pi is 1.
        visits = np.minimum(D @ (cells.b > 0), 1.0)
        spread = np.divide(
            D @ (a * a), b * visits, out=np.zeros_like(b), where=binary & (visits > 0)
        )
        with np.errstate(divide="ignore"):
            met = -np.expm1(lengths[:, None] * np.log1p(-visits))
        out += met @ spread / lengths
    for block in _blocks(general, len(D)):
        out += _integral(a[:, block], cells.b[:, block], lengths, D)
    return out


def explained_combinations(cells: Cells, k: ArrayLike) -> FloatArray:
    r"""Mean explained mean square over all combinations of k different tasks.

    Parameters
    ----------
    cells
        Sums over the cells of the partition, for n tasks.
    k
        Numbers of tasks, at most n, shape ``(K,)``.

    Returns
    -------
    FloatArray
        Shape ``(K,)``.
    """
    lengths = np.asarray(k)
    n = cells.n_tasks
    D = np.full(n, 1.0 / n)
    if n == 1:
        return np.full(len(lengths), limit(cells, D).sum())
    if cells.shared:
        last, within = shared_law(cells, D)
        return last + within * n / (n - 1) * (1.0 / lengths - 1.0 / n)
    r = _ratio(cells, D)
    out = np.full(len(lengths), (D @ cells.a) @ r)
    a = cells.a - r * cells.b
    b, binary, general = _classify(cells.b)
    if binary.any():
        visitors = (cells.b > 0).sum(axis=0)
        # No spread is left where one task visits, which is where n - 1 would be 0.
        spread = np.divide(
            np.einsum("mg,mg->g", a, a),
            b * (visitors - 1),
            out=np.zeros_like(b),
            where=binary & (visitors > 1),
        )
        met = 1.0 - _miss(n, tuple(lengths.tolist()))[:, visitors]
        out += (met - (lengths / n)[:, None]) @ spread / lengths
    few = general & ((cells.b > 0).sum(axis=0) <= MOST_VISITORS)
    if few.any():
        out += listed_subsets(a[:, few], cells.b[:, few], lengths)
    for block in _blocks(general & ~few, n):
        out += _subset_integral(a[:, block], cells.b[:, block], lengths)
    return out


def explained_sequences(cells: Cells, counts: ArrayLike) -> FloatArray:
    r"""Explained mean square :math:`E_c(\mathcal{P})` of given sequences.

    Parameters
    ----------
    cells
        Sums over the cells of the partition, for M tasks.
    counts
        How often each task occurs in each sequence, shape ``(C, M)``.

    Returns
    -------
    FloatArray
        Shape ``(C,)``.
    """
    times = np.asarray(counts, dtype=float)
    length = times.sum(axis=1)
    A = times @ cells.a
    if cells.shared:
        b = cells.b[0]
        seen = b > 0
        return (A[:, seen] ** 2 @ (1.0 / b[seen])) / length**2
    B = times @ cells.b
    A *= A
    return np.divide(A, B, out=np.zeros_like(A), where=B > 0).sum(axis=1) / length


def limit(cells: Cells, distribution: FloatArray) -> FloatArray:
    r"""Explained mean square of each cell in the limit, :math:`(\mathrm{E}a)^2/\mathrm{E}b`.

    Parameters
    ----------
    cells
        Sums over the cells of the partition, for M tasks.
    distribution
        D(m), shape ``(M,)``.

    Returns
    -------
    FloatArray
        Shape ``(G,)``.
    """
    mean = np.asarray(distribution) @ cells.a
    return mean * _ratio(cells, np.asarray(distribution))


def shared_law(cells: Cells, distribution: FloatArray) -> tuple[float, float]:
    r"""Limit and coefficient of 1/k of the explained mean square, for shared p(x|m).

    Parameters
    ----------
    cells
        Sums over the cells of the partition, for M tasks with one weighting.
    distribution
        D(m), shape ``(M,)``.

    Returns
    -------
    tuple of float
        :math:`\sum_y (\mathrm{E} a)^2 / b` and :math:`\sum_y \mathrm{Var}(a) / b`.
    """
    b = cells.b[0]
    inverse = np.divide(1.0, b, out=np.zeros_like(b), where=b > 0)
    mean = distribution @ cells.a
    last = float((mean * mean) @ inverse)
    # One pass over the table, without one of deviations; a is measured from the mean Q.
    squares = [float((row * row) @ inverse) for row in cells.a]
    return last, float(distribution @ squares) - last


def check_distribution(distribution: ArrayLike | None, n_tasks: int) -> FloatArray:
    """Validate D(m), shape ``(M,)``; uniform when None."""
    if distribution is None:
        return np.full(n_tasks, 1.0 / n_tasks)
    D = np.asarray(distribution, dtype=float)
    if D.shape != (n_tasks,) or not np.isfinite(D).all():
        raise ValueError(
            f"distribution has shape {D.shape}, but one finite probability for each of the "
            f"{n_tasks} tasks is needed."
        )
    if D.min() < 0 or abs(D.sum() - 1) > ATOL:
        raise ValueError(
            f"distribution sums to {D.sum():.12g} with smallest entry {D.min():.6g}, but D(m) must "
            "be at least 0 and sum to 1; divide the weights by their sum."
        )
    return D


def check_lengths(k: ArrayLike, largest: int | None = None) -> IntArray:
    """Validate sequence lengths: integers from 1 to ``largest``, flattened."""
    lengths = np.atleast_1d(np.asarray(k)).ravel()
    if len(lengths) == 0 or not np.issubdtype(lengths.dtype, np.integer) or lengths.min() < 1:
        raise ValueError(f"k is {k!r}, but sequence lengths are integers of at least 1.")
    if largest is not None and lengths.max() > largest:
        raise ValueError(
            f"k is {lengths.max()}, but only {largest} tasks can be combined without replacement; "
            "give a smaller k or draw with replacement."
        )
    return lengths.astype(np.int64)


class _Law:
    """k-relevance of partitions of some tasks."""

    def __init__(
        self,
        solutions: Solutions,
        k: ArrayLike,
        distribution: ArrayLike | None,
        replacement: bool,
        direction: Direction,
    ) -> None:
        one_of("direction", direction, ("backward", "forward"))
        self.k = check_lengths(k, None if replacement else solutions.n_tasks)
        if not replacement and distribution is not None:
            raise ValueError(
                "distribution was given with replacement=False, but combinations of different "
                "tasks all weigh the same; leave it out."
            )
        self.D = check_distribution(distribution, solutions.n_tasks)
        self.replacement = replacement
        self.sign = 1.0 if direction == "backward" else -1.0
        base = ground(solutions)
        self.reference = self._explained(base if direction == "backward" else base.total())

    def _explained(self, cells: Cells) -> FloatArray:
        if self.replacement:
            return explained(cells, self.k, self.D)
        return explained_combinations(cells, self.k)

    def __call__(self, cells: Cells) -> FloatArray:
        return self.sign * (self.reference - self._explained(cells))


def _ratio(cells: Cells, D: FloatArray) -> FloatArray:
    """Abstract Q-value of each cell in the limit; 0 in cells that no task visits."""
    a = D @ cells.a
    b = cells.b[0] if cells.shared else D @ cells.b
    return np.divide(a, b, out=np.zeros_like(a), where=b > 0)


def _leading(cells: Cells, D: FloatArray) -> float:
    a = cells.a - _ratio(cells, D) * cells.b
    b = cells.b[0] if cells.shared else D @ cells.b
    seen = b > 0
    return float((D @ a[:, seen] ** 2 / b[seen]).sum())


def _second(cells: Cells, D: FloatArray) -> float:
    b = np.broadcast_to(cells.b, cells.a.shape)
    a, mean = cells.a - _ratio(cells, D) * b, D @ b
    a, d, mean = a[:, mean > 0], (b - mean)[:, mean > 0], mean[mean > 0]
    skew = D @ (a * a * d)
    product = (D @ a**2) * (D @ d**2) + 2 * (D @ (a * d)) ** 2
    return float((product / mean**3 - skew / mean**2).sum())


def _classify(b: FloatArray) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Largest weight of each cell; whether it is the only one but 0; the other cells."""
    largest = b.max(axis=0)
    smallest = np.where(b > 0, b, np.inf).min(axis=0)
    seen = largest > 0
    binary = seen & (largest - smallest <= EQUAL * largest)
    return largest, binary, seen & ~binary


def _blocks(cells: BoolArray, per_cell: int) -> list[IntArray]:
    index = np.flatnonzero(cells)
    if len(index) == 0:
        return []
    size = max(1, BLOCK // (150 * per_cell))
    return np.split(index, range(size, len(index), size))


def _nodes(b: FloatArray, k: int) -> tuple[FloatArray, FloatArray]:
    r"""Double-exponential rule for :math:`\int_0^\infty g(t) dt`, g a mixture of exp(-Bt).

    With :math:`t = \exp(s - e^{-s})` the integrand decays doubly exponentially at both
    ends, and the trapezoidal rule converges as fast as its step shrinks.  B runs from the
    smallest positive weight to k times the largest.
    """
    positive = b[b > 0]
    fast, slow = k * positive.max(), positive.min()
    step = 0.1
    s = np.arange(-3.8, np.log(40.0 * fast / slow) + 1.0, step)
    t = np.exp(s - np.exp(-s)) / fast
    return t, step * t * (1.0 + np.exp(-s))


def _integral(a: FloatArray, b: FloatArray, k: IntArray, D: FloatArray) -> FloatArray:
    """Case 3 for i.i.d. sequences, summed over the cells given, shape ``(K,)``."""
    t, weight = _nodes(b, int(k.max()))
    decay = np.exp(-t[:, None, None] * b)
    weighted = D[:, None] * a
    zeroth = np.einsum("m,tmg->tg", D, decay)
    first = np.einsum("mg,tmg->tg", weighted, decay)
    second = np.einsum("mg,tmg->tg", weighted * a, decay)
    out = np.empty(len(k))
    for i, length in enumerate(k):
        terms = second * zeroth ** (length - 1)
        if length > 1:
            terms += (length - 1) * first**2 * zeroth ** (length - 2)
        out[i] = weight @ terms.sum(axis=1)
    return out


def _subset_integral(a: FloatArray, b: FloatArray, k: IntArray) -> FloatArray:
    """Case 3 for combinations, summed over the cells given, shape ``(K,)``.

    ``power[j]`` holds, for the tasks taken in so far, the mean over subsets of size j of
    A^j exp(-tB), j = 0, 1, 2.  A subset of size s of m tasks contains the m-th with
    probability s/m, which gives the recursion.
    """
    longest = int(k.max())
    t, weight = _nodes(b, longest)
    zeroth, first, second = np.zeros((3, longest + 1, len(t), a.shape[1]))
    zeroth[0] = 1.0
    for m in range(1, len(a) + 1):
        new, decay = a[m - 1], np.exp(-t[:, None] * b[m - 1])
        top = min(m, longest)
        share = (np.arange(1, top + 1) / m)[:, None, None]
        old = zeroth[:top], first[:top], second[:top]
        plus = share * decay
        second[1 : top + 1] = (1 - share) * second[1 : top + 1] + plus * (
            old[2] + 2 * new * old[1] + new**2 * old[0]
        )
        first[1 : top + 1] = (1 - share) * first[1 : top + 1] + plus * (old[1] + new * old[0])
        zeroth[1 : top + 1] = (1 - share) * zeroth[1 : top + 1] + plus * old[0]
    return np.einsum("t,ktg->k", weight, second)[k] / k


@cache
def _miss(n: int, k: tuple[int, ...]) -> FloatArray:
    """Chance that k of n tasks hold none of v given ones, shape ``(K, n + 1)``, v = 0 .. n."""
    others = n - np.arange(n + 1)
    length = np.array(k)[:, None]
    possible = others >= length
    top = np.where(possible, others, length)
    # C(n - v, k) / C(n, k) from factorials would overflow; their logarithms do not.
    log = gammaln(top + 1) - gammaln(top - length + 1) + gammaln(n - length + 1) - gammaln(n + 1)
    return np.where(possible, np.exp(log), 0.0)
