r"""Solutions of several tasks over one feature space: what relevance is computed from."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from thesis_lib.domains.domain import Domain

ACTION = "a"
"""Name of the feature that holds the action: X+ is the state features and the action."""

ATOL = 1e-8
"""How far the weights of a task may be from summing to one."""


class TaskTable(NamedTuple):
    """One task's solution, for tasks that do not come from a :class:`Domain`.

    Attributes
    ----------
    feature_names
        Names of the features, the action among them, length F.
    features : array_like
        Integer feature values of the task's state-action pairs, shape ``(n, F)``.
    q : array_like
        :math:`Q_m(x)`, shape ``(n,)``.
    p : array_like
        :math:`p(x|m)`, shape ``(n,)``; uniform when left out.
    """

    feature_names: Sequence[str]
    features: ArrayLike
    q: ArrayLike
    p: ArrayLike | None = None


@dataclass(frozen=True, eq=False)
class Solutions:
    r"""The solutions :math:`Q_{s_1}, \dots, Q_{s_M}` of M tasks on N state-action pairs.

    A pair is a vector of F feature values, the action among them (the full feature set
    :math:`X^+` of section 4.2).  Pairs of different tasks with the same values are the
    same pair.  A task need not contain every pair.

    Parameters
    ----------
    q
        :math:`Q_m(x)`, shape ``(M, N)``; NaN where x is not in :math:`X_m`.
    p
        :math:`p(x|m)`, shape ``(M, N)``; rows sum to 1, and 0 where ``q`` is NaN.  One
        row broadcast to ``(M, N)`` costs no memory.
    features
        Integer feature values, shape ``(N, F)``; all rows differ.
    feature_names
        Length F, all different.

    Raises
    ------
    ValueError
        When shapes disagree, a name occurs twice, two pairs have the same feature
        values, weights are no distribution, or Q is not finite where p > 0.

    Notes
    -----
    Source: sections 4.1.1 and 4.2.
    """

    q: FloatArray
    p: FloatArray
    features: IntArray
    feature_names: tuple[str, ...]

    def __post_init__(self) -> None:
        q = np.asarray(self.q, dtype=float)
        p = np.asarray(self.p, dtype=float)
        features = np.asarray(self.features)
        names = tuple(self.feature_names)
        _check_tables(q, p)
        _check_features(features, names, q.shape[1])
        for name, value in (("q", q), ("p", p), ("features", features), ("feature_names", names)):
            object.__setattr__(self, name, value)
        code, _ = self.radix
        if len(np.unique(code)) < self.n_pairs:
            order = np.argsort(code, kind="stable")
            i = int(np.argmax(np.diff(code[order]) == 0))
            raise ValueError(
                f"pairs {order[i]} and {order[i + 1]} have the same feature values "
                f"{features[order[i]].tolist()}, but the full feature set must tell pairs apart; "
                "merge them or add a feature."
            )

    @classmethod
    def from_domain(
        cls, domain: Domain, q_tables: Iterable[ArrayLike], p: ArrayLike | None = None
    ) -> Solutions:
        """Gather the solutions of all tasks of a domain.

        Parameters
        ----------
        domain
            The domain; its state features and the action (``"a"``) become the features.
        q_tables
            For each task an array ``(S_m, A)``.
        p
            :math:`p(x|m)`, shape ``(M, O, A)``; default uniform on :math:`X_m`.

        Returns
        -------
        Solutions
            With N = O A pairs, the action running fastest.  A sequence of tasks drawn
            from the domain is :meth:`take` of this.

        Examples
        --------
        >>> from thesis_lib.domains import triangle
        >>> from thesis_lib.potentials import optimal_solutions
        >>> domain = triangle()
        >>> solutions = Solutions.from_domain(domain, optimal_solutions(domain))
        >>> solutions.n_tasks, solutions.n_pairs, solutions.n_features
        (12, 36, 4)
        """
        if ACTION in domain.feature_names:
            raise ValueError(
                f"domain {domain.name!r} has a state feature called {ACTION!r}, but that name is "
                "the action's; rename the feature."
            )
        n_actions = len(domain.actions)
        q = domain.gather(q_tables)
        weights = domain.uniform() if p is None else domain.check_weights(p)
        observations = np.repeat(domain.observations, n_actions, axis=0)
        actions = np.tile(np.arange(n_actions), domain.n_observations)
        return cls(
            q.reshape(len(q), -1),
            weights.reshape(len(q), -1),
            np.column_stack([observations, actions]),
            (*domain.feature_names, ACTION),
        )

    @classmethod
    def from_tables(cls, tables: Sequence[TaskTable]) -> Solutions:
        """Merge task solutions, each on its own state-action pairs.

        Parameters
        ----------
        tables
            One a task; all with the same feature names in the same order.

        Returns
        -------
        Solutions
            On the union of the tasks' pairs, sorted by feature values.

        Raises
        ------
        ValueError
            When there is no task, tasks have different features, shapes disagree or a
            task lists a pair twice.
        """
        if len(tables) == 0:
            raise ValueError("no task was given, but solutions of at least one are needed.")
        names = tuple(tables[0].feature_names)
        rows, lengths = [], []
        for m, table in enumerate(tables):
            if tuple(table.feature_names) != names:
                raise ValueError(
                    f"task {m} has features {list(table.feature_names)}, but task 0 has "
                    f"{list(names)}; all tasks must have the same features in the same order."
                )
            features = np.asarray(table.features)
            _check_features(features, names, len(features))
            if len(np.unique(features, axis=0)) < len(features):
                raise ValueError(
                    f"task {m} lists a state-action pair twice, but each of its pairs must have "
                    "feature values of its own; merge them or add a feature."
                )
            rows.append(features)
            lengths.append(len(features))
        pairs, inverse = np.unique(np.concatenate(rows), axis=0, return_inverse=True)
        ends = np.cumsum(lengths)
        q = np.full((len(tables), len(pairs)), np.nan)
        p = np.zeros_like(q)
        for m, table in enumerate(tables):
            n = lengths[m]
            own = inverse.reshape(-1)[ends[m] - n : ends[m]]
            weights = np.full(n, 1.0 / n) if table.p is None else np.asarray(table.p, dtype=float)
            values = np.asarray(table.q, dtype=float)
            if values.shape != (n,) or weights.shape != (n,):
                raise ValueError(
                    f"task {m} has {n} pairs, but q of shape {values.shape} and p of shape "
                    f"{weights.shape}; give one number a pair."
                )
            q[m, own], p[m, own] = values, weights
            if np.isnan(values).any():
                i = int(np.argmax(np.isnan(values)))
                raise ValueError(
                    f"q of task {m} is NaN at pair {i}, but a task needs a value at every pair it "
                    "lists; leave the pair out if the task does not contain it."
                )
        return cls(q, p, pairs, names)

    @property
    def n_tasks(self) -> int:
        """Number of tasks M."""
        return int(self.q.shape[0])

    @property
    def n_pairs(self) -> int:
        """Number of state-action pairs N."""
        return int(self.q.shape[1])

    @property
    def n_features(self) -> int:
        """Number of features F, the action among them."""
        return len(self.feature_names)

    @cached_property
    def shared(self) -> bool:
        """Whether all tasks have the same p(x|m), the assumption of theorem 3."""
        if self.p.strides[0] == 0:
            return True
        return all(np.array_equal(row, self.p[0]) for row in self.p[1:])

    @cached_property
    def centre(self) -> float:
        """Mean Q-value of the first task.

        Relevance does not change when a constant is added to every Q, so sums are taken
        about this centre, which keeps their rounding error small.
        """
        return float(np.nansum(self.p[0] * self.q[0]))

    @cached_property
    def moments(self) -> tuple[FloatArray, FloatArray]:
        r"""First moments :math:`p(x|m)(Q_m(x) - centre)` ``(M, N)`` and weights.

        The weights are p(x|m), shape ``(M, N)``, or ``(1, N)`` where all tasks share them.
        """
        p = self.p[:1] if self.shared else self.p
        a = self.q - self.centre
        a[np.isnan(a)] = 0.0
        a *= p
        return a, np.ascontiguousarray(p)

    @cached_property
    def radix(self) -> tuple[IntArray, tuple[int, ...]]:
        """Each pair's feature values as one integer ``(N,)``, and each digit's size."""
        return encode(self.features)

    def take(self, tasks: ArrayLike) -> Solutions:
        """Solutions of a sequence of these tasks, repeats allowed.

        Parameters
        ----------
        tasks
            Task indices, shape ``(n,)``.

        Returns
        -------
        Solutions
            With n tasks on the same N pairs.
        """
        index = np.asarray(tasks)
        if index.ndim != 1 or len(index) == 0 or not np.issubdtype(index.dtype, np.integer):
            raise ValueError(
                f"tasks has shape {index.shape} and type {index.dtype}, but it must be a non-empty "
                "list of task indices."
            )
        if index.min() < 0 or index.max() >= self.n_tasks:
            raise ValueError(
                f"tasks holds the index {index.min() if index.min() < 0 else index.max()}, but "
                f"tasks are numbered 0 to {self.n_tasks - 1}."
            )
        # The rows were checked when these solutions were made, so the checks are skipped:
        # experiments take thousands of sequences.
        new = object.__new__(Solutions)
        for name in ("features", "feature_names"):
            object.__setattr__(new, name, getattr(self, name))
        object.__setattr__(new, "q", self.q[index])
        shared = self.p.strides[0] == 0
        p = np.broadcast_to(self.p[0], new.q.shape) if shared else self.p[index]
        object.__setattr__(new, "p", p)
        new.__dict__["radix"] = self.radix
        if self.shared:
            new.__dict__["shared"] = True
        return new

    def mask(self, names: Iterable[str | int]) -> BoolArray:
        """Which features are named, shape ``(F,)``; names or indices are understood."""
        mask = np.zeros(self.n_features, dtype=bool)
        for name in names:
            mask[self.index(name)] = True
        return mask

    def index(self, name: str | int) -> int:
        """Position of a feature, given its name or its index."""
        if isinstance(name, (int, np.integer)) and 0 <= name < self.n_features:
            return int(name)
        if name not in self.feature_names:
            raise ValueError(
                f"there is no feature {name!r}; the features are {', '.join(self.feature_names)}."
            )
        return self.feature_names.index(str(name))


def encode(features: IntArray) -> tuple[IntArray, tuple[int, ...]]:
    """Write feature vectors as integers in a mixed-radix system.

    Parameters
    ----------
    features
        Integer values, shape ``(N, F)``.

    Returns
    -------
    code
        Shape ``(N,)``; equal exactly where all features are equal, last digit fastest.
    sizes
        Number of values of each feature, length F.

    Raises
    ------
    ValueError
        When the product of the sizes does not fit 63 bits.
    """
    code = np.zeros(len(features), dtype=np.int64)
    sizes: list[int] = []
    capacity = 1
    for column in np.ascontiguousarray(np.asarray(features).T, dtype=np.int64):
        low, high = int(column.min()), int(column.max())
        if high - low < 4 * len(column):
            seen = np.zeros(high - low + 1, dtype=np.int64)
            seen[column - low] = 1
            digit = (np.cumsum(seen) - 1)[column - low]
            size = int(seen.sum())
        else:
            values, digit = np.unique(column, return_inverse=True)
            size = len(values)
        capacity *= size
        if capacity >= 2**63:
            raise ValueError(
                f"the features have {' x '.join(map(str, [*sizes, size]))} or more combinations of "
                "values, but at most 2^63 can be told apart; merge features or values."
            )
        code *= size
        code += digit.reshape(-1)
        sizes.append(size)
    return code, tuple(sizes)


def _check_tables(q: FloatArray, p: FloatArray) -> None:
    if q.ndim != 2 or 0 in q.shape:
        raise ValueError(
            f"q has shape {q.shape}, but (tasks, pairs) is needed with at least one of each."
        )
    if p.shape != q.shape:
        raise ValueError(
            f"p has shape {p.shape}, but q has {q.shape}; give one weight for each task and pair."
        )
    for m, (row, values) in enumerate(zip(p, q, strict=True)):
        total = row.sum()
        if not np.isfinite(total) or row.min() < 0 or abs(total - 1) > ATOL:
            raise ValueError(
                f"p(x|m) of task {m} sums to {total:.12g} with smallest entry {row.min():.6g}, but "
                "weights must be at least 0 and sum to 1; divide them by their sum."
            )
        bad = ~np.isfinite(values)
        bad &= (row > 0) | np.isinf(values)
        if bad.any():
            x = int(np.argmax(bad))
            raise ValueError(
                f"q of task {m} at pair {x} is {values[x]}, but p(x|m) is {row[x]:.6g} there; a "
                "pair with positive weight needs a finite value."
            )


def _check_features(features: np.ndarray, names: tuple[str, ...], n_pairs: int) -> None:
    if features.ndim != 2 or features.shape != (n_pairs, len(names)) or len(names) == 0:
        raise ValueError(
            f"features has shape {features.shape}, but (pairs, features) = "
            f"{(n_pairs, len(names))} is needed, with at least one feature."
        )
    if not np.issubdtype(features.dtype, np.integer):
        raise ValueError(
            f"features has type {features.dtype}, but integer codes are needed; number the values "
            "of each feature, for instance with numpy.unique(..., return_inverse=True)."
        )
    for name in names:
        if names.count(name) > 1:
            raise ValueError(
                f"the feature name {name!r} occurs {names.count(name)} times, but names must "
                "differ; rename all but one."
            )
