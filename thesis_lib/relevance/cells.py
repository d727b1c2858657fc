r"""Partitions of the state-action pairs, and the sums over their cells that relevance needs.

Write :math:`b_m(y) = \sum_{x \in y} p(x|m)` and
:math:`a_m(y) = \sum_{x \in y} p(x|m) Q_m(x)` for the cells y of a partition.  For a
sequence c of k tasks, :math:`p(y|c) = \sum_i b_{c_i}(y) / k` and the abstract
:math:`\bar Q_c(y) = \sum_i a_{c_i}(y) / \sum_i b_{c_i}(y)`, so these two numbers a task
and cell are all that any relevance of the partition depends on.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from math import prod

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.relevance.solutions import Solutions

SMALL = 2**14
"""Tables up to this size are summed in one call instead of one call a task."""


@dataclass(frozen=True, eq=False)
class Cells:
    r"""Sums over the cells of a partition, for each task.

    Attributes
    ----------
    a
        :math:`a_m(y)`, shape ``(M, G)``.
    b
        :math:`b_m(y)`, shape ``(M, G)``, or ``(1, G)`` where all tasks share p(x|m).
    """

    a: FloatArray
    b: FloatArray

    @property
    def n_tasks(self) -> int:
        """Number of tasks M."""
        return int(self.a.shape[0])

    @property
    def n_cells(self) -> int:
        """Number of cells G."""
        return int(self.a.shape[1])

    @property
    def shared(self) -> bool:
        """Whether all tasks share one weighting."""
        return self.b.shape[0] == 1

    def merge(self, labels: IntArray, n_cells: int | None = None) -> Cells:
        """Merge cells.

        Parameters
        ----------
        labels
            New cell of each cell, shape ``(G,)``, numbered from 0.
        n_cells
            Number of new cells; default the largest label plus one.
        """
        n = int(labels.max()) + 1 if n_cells is None else n_cells
        return Cells(sum_groups(self.a, labels, n), sum_groups(self.b, labels, n))

    def total(self) -> Cells:
        """The one cell of the null abstraction, which removes every feature."""
        return Cells(self.a.sum(axis=1, keepdims=True), self.b.sum(axis=1, keepdims=True))


@dataclass(frozen=True, eq=False)
class FeatureCells(Cells):
    """Cells of the abstraction that keeps some of the features.

    Attributes
    ----------
    features
        Indices of the features kept, in order.
    code
        Feature values of each cell as one integer, shape ``(G,)``.
    sizes
        Number of values of each kept feature.
    """

    features: tuple[int, ...]
    code: IntArray
    sizes: tuple[int, ...]

    def drop(self, feature: int) -> FeatureCells:
        """Cells after removing one more feature.

        Parameters
        ----------
        feature
            Index of a feature in ``features``.
        """
        # Selectors on the same tasks ask for the same cells; small ones are kept.
        if self.a.size > SMALL:
            return self._drop(feature)
        kept: dict[int, FeatureCells] = self.__dict__.setdefault("_dropped", {})
        if feature not in kept:
            kept[feature] = self._drop(feature)
        return kept[feature]

    def _drop(self, feature: int) -> FeatureCells:
        at = self.features.index(feature)
        low, size = prod(self.sizes[at + 1 :]), self.sizes[at]
        features = self.features[:at] + self.features[at + 1 :]
        sizes = self.sizes[:at] + self.sizes[at + 1 :]
        if self._is_block:
            unique = np.arange(self.n_cells // size)
            a, b = _add_up(self.a, size, low), _add_up(self.b, size, low)
            return FeatureCells(a, b, features, unique, sizes)
        code = (self.code // (low * size)) * low + self.code % low
        return self._recode(code, features, sizes)

    @cached_property
    def _is_block(self) -> bool:
        """Whether every combination of values occurs, in order, so that axes can be summed."""
        complete = self.n_cells == prod(self.sizes)
        return complete and bool((self.code == np.arange(self.n_cells)).all())

    def keep(self, features: Iterable[int]) -> FeatureCells:
        """Cells after removing all features but some.

        Parameters
        ----------
        features
            Indices out of ``features``.
        """
        wanted = set(features)
        at = [i for i, feature in enumerate(self.features) if feature in wanted]
        sizes = tuple(self.sizes[i] for i in at)
        code = _digits(self.code, self.sizes, at)
        return self._recode(code, tuple(self.features[i] for i in at), sizes)

    def pool(self) -> FeatureCells:
        """Cells of all tasks together, as of one task with their mean weights."""
        n = self.n_tasks
        b = self.b if self.shared else self.b.mean(axis=0, keepdims=True)
        a = self.a.sum(axis=0, keepdims=True) / n
        return FeatureCells(a, b, self.features, self.code, self.sizes)

    def _recode(
        self, code: IntArray, features: tuple[int, ...], sizes: tuple[int, ...]
    ) -> FeatureCells:
        labels, unique = _number(code, prod(sizes))
        merged = self.merge(labels, len(unique))
        return FeatureCells(merged.a, merged.b, features, unique, sizes)


def ground(solutions: Solutions) -> FeatureCells:
    """Cells of the abstraction that removes nothing: one a state-action pair.

    Parameters
    ----------
    solutions
        M task solutions on N pairs.

    Returns
    -------
    FeatureCells
        In the order of the feature values, which need not be that of the pairs.
    """
    kept = solutions.__dict__.get("_ground")
    if isinstance(kept, FeatureCells):
        return kept
    made = _ground(solutions)
    if made.a.size <= SMALL:
        solutions.__dict__["_ground"] = made
    return made


def _ground(solutions: Solutions) -> FeatureCells:
    a, b = solutions.moments
    code, sizes = solutions.radix
    if (code[1:] < code[:-1]).any():
        # Sums over a feature then run along memory, whatever the order of the pairs.
        order = np.argsort(code)
        a, b, code = a[:, order], b[:, order], code[order]
    return FeatureCells(a, b, tuple(range(solutions.n_features)), code, sizes)


def partition(solutions: Solutions, labels: ArrayLike) -> Cells:
    """Cells of an arbitrary abstraction (definition 1).

    Parameters
    ----------
    solutions
        M task solutions on N pairs.
    labels
        Abstract pair of each pair, shape ``(N,)``: any integers, equal where pairs are
        merged.  See :func:`keep` and :func:`remove` for feature subsets.
    """
    return Cells(*solutions.moments).merge(check_labels(labels, solutions.n_pairs))


def keep(solutions: Solutions, features: Iterable[str | int]) -> IntArray:
    r"""Labels of the abstraction :math:`\phi(x) = x[Y]` that keeps the features Y (section 4.2).

    Parameters
    ----------
    solutions
        Gives the pairs and their features.
    features
        Names or indices of Y; none for the null abstraction.

    Returns
    -------
    IntArray
        Shape ``(N,)``, numbered from 0 in the order of the feature values.
    """
    at = np.flatnonzero(solutions.mask(features)).tolist()
    code, sizes = solutions.radix
    return _number(_digits(code, sizes, at), prod(sizes[i] for i in at))[0]


def remove(solutions: Solutions, features: Iterable[str | int]) -> IntArray:
    """Labels of the abstraction that removes the features F, so that X+ - F stays (section 4.2).

    Parameters
    ----------
    solutions
        Gives the pairs and their features.
    features
        Names or indices of F.

    Returns
    -------
    IntArray
        Shape ``(N,)``, numbered from 0.
    """
    return keep(solutions, np.flatnonzero(~solutions.mask(features)).tolist())


def check_labels(labels: ArrayLike, n_pairs: int) -> IntArray:
    """Number the cells of a partition 0, 1, ... without gaps.

    Parameters
    ----------
    labels
        Integers, shape ``(N,)``.
    n_pairs
        N.

    Raises
    ------
    ValueError
        When the shape or the type is wrong.
    """
    given = np.asarray(labels)
    if given.shape != (n_pairs,) or not np.issubdtype(given.dtype, np.integer):
        raise ValueError(
            f"labels has shape {given.shape} and type {given.dtype}, but one integer for each of "
            f"the {n_pairs} state-action pairs is needed."
        )
    return np.unique(given, return_inverse=True)[1].reshape(-1).astype(np.int64)


def sum_groups(values: FloatArray, labels: IntArray, n: int) -> FloatArray:
    """Sum the columns of a table by group.

    Parameters
    ----------
    values
        Shape ``(M, G)``.
    labels
        Group of each column, shape ``(G,)``, in 0 .. n - 1.
    n
        Number of groups.

    Returns
    -------
    FloatArray
        Shape ``(M, n)``.
    """
    rows = len(values)
    if rows > 1 and values.size <= SMALL:
        index = labels + n * np.arange(rows)[:, None]
        out = np.empty(rows * n)
        out[:] = np.bincount(index.ravel(), values.ravel(), rows * n)
        return out.reshape(rows, n)
    out = np.empty((rows, n))
    for m in range(rows):
        out[m] = np.bincount(labels, values[m], n)
    return out


def _add_up(values: FloatArray, size: int, low: int) -> FloatArray:
    """Sum a table ``(M, high * size * low)`` over its middle axis, slice by slice."""
    rows = len(values)
    block = values.reshape(rows, -1, size, low)
    out = block[:, :, 0].copy()
    for i in range(1, size):
        out += block[:, :, i]
    return out.reshape(rows, -1)


def _digits(code: IntArray, sizes: tuple[int, ...], at: list[int]) -> IntArray:
    """Code made of some of the digits of another."""
    out = np.zeros_like(code)
    low = 1
    for i in reversed(at):
        out += (code // prod(sizes[i + 1 :]) % sizes[i]) * low
        low *= sizes[i]
    return out


def _number(code: IntArray, size: int) -> tuple[IntArray, IntArray]:
    """Number codes in 0 .. size - 1 without gaps; also the codes in order."""
    if size > 8 * len(code) + 64:
        unique, labels = np.unique(code, return_inverse=True)
        return labels.reshape(-1), unique
    seen = np.zeros(size, dtype=bool)
    seen[code] = True
    unique = np.flatnonzero(seen)
    if len(unique) == size:
        return code, unique
    number = np.cumsum(seen) - 1
    return number[code], unique
