r"""Multi-task domains :math:`d = \langle D, M\rangle` (section 3.2)."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import BoolArray, FloatArray, IntArray
from thesis_lib.mdp.checks import require_mdp
from thesis_lib.mdp.model import ATOL, MDP


@dataclass(frozen=True, eq=False)
class Domain:
    r"""A set of tasks, a distribution over them, and the pairs they share.

    The tasks share actions and features.  A state of a task is known across tasks
    by the values of its features, its *observation*: two states of different tasks
    with the same values are the same element of :math:`S_d = \bigcup_m S_m`.  A
    function on :math:`X_d = S_d \times A`, such as a potential, is an array of shape
    ``(O, A)``, with a row an observation.

    Parameters
    ----------
    name
        What the domain is called, for messages and figures.
    tasks
        The MDPs, at least one.  Any sequence will do, so that large tasks can be
        built when asked for.
    distribution
        :math:`D(m)`, shape ``(M,)``, all positive, summing to 1; default uniform.
    members
        For each task the states that count as part of :math:`S_m`, shape ``(S_m,)``
        bool; default all that are not terminal.  A state in which no action is ever
        taken (a cliff cell) is no member.
    task_names
        Default ``"0"``, ``"1"``, ...

    Raises
    ------
    ValueError
        When there is no task, D does not sum to 1, tasks disagree on actions,
        features or discount, or two states of one task share an observation.

    Notes
    -----
    Source: section 3.2.
    """

    name: str
    tasks: Sequence[MDP]
    distribution: FloatArray = None  # type: ignore[assignment]
    members: Sequence[BoolArray] | None = None
    task_names: tuple[str, ...] = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        if len(self.tasks) == 0:
            raise ValueError(f"domain {self.name!r} has no tasks, but it needs at least one.")
        n = len(self.tasks)
        uniform = np.full(n, 1.0 / n)
        distribution = uniform if self.distribution is None else np.array(self.distribution, float)
        if distribution.shape != (n,):
            raise ValueError(
                f"distribution has shape {distribution.shape}, but the domain has {n} tasks; "
                "give one probability a task."
            )
        if not (distribution > 0).all() or abs(distribution.sum() - 1) > ATOL:
            raise ValueError(
                f"distribution sums to {distribution.sum():.12g} with smallest entry "
                f"{distribution.min():.6g}, but D(m) must be positive for every task and sum to 1; "
                "divide the weights by their sum."
            )
        distribution.flags.writeable = False
        names = tuple(map(str, range(n))) if self.task_names is None else tuple(self.task_names)
        if len(names) != n:
            raise ValueError(f"{len(names)} task names were given for {n} tasks; give one a task.")
        if self.members is not None and len(self.members) != n:
            raise ValueError(
                f"members has {len(self.members)} masks for {n} tasks; give one mask a task."
            )
        first = self.tasks[0]
        require_mdp(first)
        for name, task in zip(names, self.tasks, strict=True):
            require_mdp(task)
            for what, got, expected in (
                ("actions", task.actions, first.actions),
                ("features", tuple(task.features), tuple(first.features)),
                ("discount", task.discount, first.discount),
            ):
                if got != expected:
                    raise ValueError(
                        f"task {name!r} has {what} {got!r}, but the other tasks of domain "
                        f"{self.name!r} have {expected!r}; all tasks of a domain share them."
                    )
        object.__setattr__(self, "distribution", distribution)
        object.__setattr__(self, "task_names", names)

    def __reduce__(self) -> tuple[Any, ...]:
        # A copy is made anew, so that its arrays are read-only too.
        return type(self), tuple(getattr(self, field.name) for field in fields(self))

    def __len__(self) -> int:
        return len(self.tasks)

    @cached_property
    def digest(self) -> str:
        """Of the tasks, what they share and D: domains made alike have the same."""
        hashed = hashlib.sha256(self.distribution.tobytes())
        for task, index in zip(self.tasks, self.observation_index, strict=True):
            outcomes = task.outcomes()
            hashed.update(repr((task.n_states, self.actions, task.discount)).encode())
            for part in (outcomes.successor, outcomes.probability, outcomes.reward):
                hashed.update(np.ascontiguousarray(part).tobytes())
            for own in (task.start, task.terminal, index):
                hashed.update(np.ascontiguousarray(own).tobytes())
        return hashed.hexdigest()

    @property
    def actions(self) -> tuple[str, ...]:
        """Names of the actions, shared by all tasks."""
        return self.tasks[0].actions

    @property
    def feature_names(self) -> tuple[str, ...]:
        """Names of the state features, shared by all tasks."""
        return tuple(self.tasks[0].features)

    @property
    def discount(self) -> float:
        """The discount factor, shared by all tasks."""
        return self.tasks[0].discount

    @cached_property
    def _index(self) -> tuple[IntArray, tuple[IntArray, ...]]:
        # Tasks that share their arrays share their states, and one set is enough to sort.
        first = self.tasks[0]
        alike = self.members is None and all(
            task.features is first.features and task.terminal is first.terminal
            for task in self.tasks
        )
        tasks = self.tasks[:1] if alike else self.tasks
        names = self.task_names[: len(tasks)]
        member = (
            [~task.terminal for task in tasks]
            if self.members is None
            else [np.asarray(m, dtype=bool) for m in self.members]
        )
        values = []
        for name, task, keep in zip(names, tasks, member, strict=True):
            if keep.shape != (task.n_states,):
                raise ValueError(
                    f"members of task {name!r} has shape {keep.shape}, but the task has "
                    f"{task.n_states} states; give one bool a state."
                )
            rows = np.stack([task.features[f] for f in self.feature_names], axis=1)[keep]
            if len(np.unique(rows, axis=0)) < len(rows):
                raise ValueError(
                    f"two states of task {name!r} have the same feature values, but the features "
                    "must tell the states of a task apart; add a feature."
                )
            values.append(rows)
        observations, inverse = np.unique(np.concatenate(values), axis=0, return_inverse=True)
        inverse = inverse.reshape(-1)
        index, at = [], 0
        for task, keep, rows in zip(tasks, member, values, strict=True):
            own = np.full(task.n_states, -1, dtype=np.int64)
            own[keep] = inverse[at : at + len(rows)]
            own.flags.writeable = False
            index.append(own)
            at += len(rows)
        observations = observations.astype(np.int64)
        observations.flags.writeable = False
        return observations, tuple(index) * (len(self) // len(tasks))

    @property
    def observations(self) -> IntArray:
        """Feature values of each element of :math:`S_d`, shape ``(O, F)``, sorted."""
        return self._index[0]

    @property
    def observation_index(self) -> tuple[IntArray, ...]:
        """For each task the observation of each state, shape ``(S_m,)``; -1 outside."""
        return self._index[1]

    @property
    def n_observations(self) -> int:
        """Size O of the domain's state space :math:`S_d`."""
        return len(self.observations)

    @property
    def shape(self) -> tuple[int, int]:
        """Shape ``(O, A)`` of a function on :math:`X_d`, such as a potential."""
        return self.n_observations, len(self.actions)

    @cached_property
    def present(self) -> BoolArray:
        """Which observations occur in which task, shape ``(M, O)``."""
        present = np.zeros((len(self), self.n_observations), dtype=bool)
        for m, index in enumerate(self.observation_index):
            present[m, index[index >= 0]] = True
        return present

    def gather(self, tables: Iterable[ArrayLike]) -> FloatArray:
        """Bring one table a task into the domain's coordinates.

        Parameters
        ----------
        tables
            For each task an array ``(S_m, A)``, such as :math:`Q_m`.

        Returns
        -------
        FloatArray
            Shape ``(M, O, A)``, NaN where a pair is not in the task's :math:`X_m`.

        Raises
        ------
        ValueError
            When there is not one table a task, or a shape is wrong.
        """
        given = list(tables)
        if len(given) != len(self):
            raise ValueError(
                f"{len(given)} tables were given, but domain {self.name!r} has {len(self)} tasks; "
                "give one a task."
            )
        out = np.full((len(self), *self.shape), np.nan)
        for m, (table, index) in enumerate(zip(given, self.observation_index, strict=True)):
            values = np.asarray(table, dtype=float)
            if values.shape != (len(index), len(self.actions)):
                raise ValueError(
                    f"the table of task {self.task_names[m]!r} has shape {values.shape}, but "
                    f"(states, actions) = {(len(index), len(self.actions))} is needed."
                )
            out[m, index[index >= 0]] = values[index >= 0]
        return out

    def scatter(self, function: ArrayLike, task: int, fill: float = 0.0) -> FloatArray:
        """Restrict a function on :math:`X_d` to the states of one task.

        Parameters
        ----------
        function
            Array ``(O, A)``, such as a potential.
        task
            Index of the task.
        fill
            Value at states outside :math:`S_m`, terminal ones among them.

        Returns
        -------
        FloatArray
            Shape ``(S_m, A)``.

        Raises
        ------
        ValueError
            When the shape is wrong or a pair of the task has no value.
        """
        values = np.asarray(function, dtype=float)
        if values.shape != self.shape:
            raise ValueError(
                f"the function has shape {values.shape}, but domain {self.name!r} needs "
                f"(observations, actions) = {self.shape}."
            )
        index = self.observation_index[task]
        out = np.full((len(index), len(self.actions)), float(fill))
        out[index >= 0] = values[index[index >= 0]]
        missing = np.isnan(out).any(axis=1)
        if missing.any():
            row = self.observations[index[int(np.argmax(missing))]]
            where = ", ".join(f"{f}={v}" for f, v in zip(self.feature_names, row, strict=True))
            raise ValueError(
                f"the function has no value at observation ({where}) of "
                f"task {self.task_names[task]!r}; give every state-action pair of the domain one."
            )
        return out

    def scatter_all(self, function: ArrayLike, fill: float = 0.0) -> list[FloatArray]:
        """Restrict a function on :math:`X_d` to every task; see :meth:`scatter`."""
        return [self.scatter(function, m, fill) for m in range(len(self))]

    def uniform(self) -> FloatArray:
        r"""Uniform :math:`p(x|m) = 1/|X_m|` (section 3.3.6, option 4), shape ``(M, O, A)``."""
        n_actions = len(self.actions)
        rows = self.present / (self.present.sum(axis=1, keepdims=True) * n_actions)
        return np.repeat(rows[:, :, None], n_actions, axis=2)

    def check_weights(self, weights: ArrayLike) -> FloatArray:
        """Validate a weighting p(x|m).

        Parameters
        ----------
        weights
            Array ``(M, O, A)``; each task's weights are at least 0, sum to 1 and vanish
            outside :math:`X_m`.

        Returns
        -------
        FloatArray
            The same numbers as a float array.
        """
        p = np.asarray(weights, dtype=float)
        if p.shape != (len(self), *self.shape):
            raise ValueError(
                f"weights p(x|m) have shape {p.shape}, but (tasks, observations, actions) = "
                f"{(len(self), *self.shape)} is needed."
            )
        total = p.sum(axis=(1, 2))
        for m in range(len(self)):
            name = self.task_names[m]
            if not np.isfinite(p[m]).all() or (p[m] < 0).any() or abs(total[m] - 1) > 1e-8:
                raise ValueError(
                    f"weights p(x|m) of task {name!r} sum to {total[m]:.12g} with smallest entry "
                    f"{p[m].min():.6g}, but they must be at least 0 and sum to 1; divide them by "
                    "their sum."
                )
            if (p[m][~self.present[m]] > 0).any():
                raise ValueError(
                    f"weights p(x|m) of task {name!r} are positive outside its state-action "
                    "space, but p(x|m) must be 0 there."
                )
        return p

    def posterior(self, weights: ArrayLike | None = None) -> FloatArray:
        """Probability of the task given the pair, p(m|x) = p(x|m) D(m) / p(x) (section 3.3.6).

        Parameters
        ----------
        weights
            p(x|m), shape ``(M, O, A)``; default uniform.

        Returns
        -------
        FloatArray
            Shape ``(M, O, A)``; columns sum to 1, NaN where p(x) = 0.
        """
        p = self.uniform() if weights is None else self.check_weights(weights)
        joint = p * self.distribution[:, None, None]
        with np.errstate(invalid="ignore"):
            return joint / joint.sum(axis=0)

    def sample(self, n: int, rng: np.random.Generator) -> IntArray:
        """Draw n task indices with replacement from D, shape ``(n,)``."""
        return rng.choice(len(self), size=n, p=self.distribution)


def check_policies(domain: Domain, mu: ArrayLike) -> FloatArray:
    r"""Cross-task policies as an array of numbers.

    Parameters
    ----------
    domain
        The domain.
    mu
        One policy :math:`\mu`, shape ``(O, A)``, or several, shape ``(..., O, A)``.

    Returns
    -------
    FloatArray
        Shaped as given.

    Raises
    ------
    ValueError
        When the shape is wrong, or the action probabilities of an observation are none.
    """
    policies = np.asarray(mu, dtype=np.float64)
    if policies.shape[-2:] != domain.shape:
        raise ValueError(
            f"mu has shape {policies.shape}, but domain {domain.name!r} needs (..., observations, "
            f"actions) = (..., {domain.n_observations}, {len(domain.actions)})."
        )
    wrong = ~((policies >= 0).all(axis=-1) & (np.abs(policies.sum(axis=-1) - 1) <= ATOL))
    if wrong.any():
        at = tuple(np.argwhere(wrong)[0])
        row = np.array2string(policies[at], precision=6, threshold=8)
        raise ValueError(
            f"mu of observation {at[-1]} is {row}, but the probabilities of its actions must be at "
            "least 0 and sum to 1; divide them by their sum."
        )
    return policies
