"""Finite Markov decision processes (section 2.2)."""

from __future__ import annotations

import abc
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thesis_lib.arrays import BoolArray, FloatArray, IntArray

ATOL = 1e-9
"""How far a probability row may be from summing to one."""


@dataclass(frozen=True)
class Outcomes:
    """The possible outcomes of every state-action pair, padded to the longest list.

    Learners draw from this list instead of from the dense transition matrix, so a
    step costs O(log K), whatever the number of states.

    Attributes
    ----------
    successor
        Next state of each outcome, shape ``(S, A, K)``.
    probability
        Probability of each outcome, shape ``(S, A, K)``; 0 in the padding.
    reward
        Reward of each outcome, shape ``(S, A, K)``.
    """

    successor: NDArray[np.int32]
    probability: FloatArray
    reward: FloatArray


class MDP(abc.ABC):
    r"""A finite MDP :math:`\langle S, A, P, R, \gamma\rangle` (section 2.2).

    Concrete classes say how an expectation over next states is taken:
    :class:`TabularMDP` multiplies by a matrix, while large structured tasks (stock
    trading) use their factors and never build one.

    Attributes
    ----------
    reward
        Expected reward :math:`R^{sa}`, shape ``(S, A)``.
    start
        Start-state distribution, shape ``(S,)``.
    terminal
        True for absorbing states, shape ``(S,)``.  Their value is 0.
    discount
        The discount factor gamma in [0, 1].
    actions
        Names of the actions, length A.
    features
        Named integer state features, each of shape ``(S,)``.
    """

    reward: FloatArray
    start: FloatArray
    terminal: BoolArray
    discount: float
    actions: tuple[str, ...]
    features: Mapping[str, IntArray]

    @property
    def n_states(self) -> int:
        """Number of states S, terminal ones included."""
        return int(self.reward.shape[0])

    @property
    def n_actions(self) -> int:
        """Number of actions A."""
        return int(self.reward.shape[1])

    @abc.abstractmethod
    def expectation(self, values: FloatArray) -> FloatArray:
        r"""Expected value of the next state, :math:`\sum_{s'} P^{sas'} v(s')`.

        Parameters
        ----------
        values
            One number a state, shape ``(S,)``.

        Returns
        -------
        FloatArray
            Shape ``(S, A)``.
        """

    @abc.abstractmethod
    def outcomes(self) -> Outcomes:
        """List the possible outcomes of every pair, for sampling."""

    def lookahead(self, values: FloatArray) -> FloatArray:
        r"""One-step look-ahead :math:`R^{sa} + \gamma \sum_{s'} P^{sas'} v(s')` (eq. 2.6).

        Parameters
        ----------
        values
            State values, shape ``(S,)``.

        Returns
        -------
        FloatArray
            State-action values, shape ``(S, A)``.
        """
        return self.reward + self.discount * self.expectation(values)

    def __getstate__(self) -> dict[str, Any]:
        # What can be derived again is left out, and a mapping proxy cannot be pickled.
        state = {k: v for k, v in self.__dict__.items() if k not in ("_outcomes", "_sampler")}
        return {**state, "features": dict(self.features)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        for array in (*state.values(), *state["features"].values()):
            if isinstance(array, np.ndarray):
                array.flags.writeable = False
        self.__dict__.update(state, features=MappingProxyType(state["features"]))


def _check_probability_rows(name: str, rows: FloatArray, labels: Sequence[str]) -> None:
    """Raise ValueError naming the first row that is no probability distribution."""
    flat = rows.reshape(-1, rows.shape[-1])
    for test, what in (
        (~np.isfinite(flat).all(axis=1), "holds a value that is not finite"),
        ((flat < 0).any(axis=1), "holds a negative probability"),
    ):
        if test.any():
            i = int(np.argmax(test))
            raise ValueError(f"{name} row {labels[i]} {what}: every entry must be in [0, 1].")
    total = flat.sum(axis=1)
    wrong = np.abs(total - 1) > ATOL
    if wrong.any():
        i = int(np.argmax(wrong))
        raise ValueError(
            f"{name} row {labels[i]} sums to {total[i]:.12g}, but a probability row must sum to 1; "
            "divide the row by its sum if the weights are meant as relative."
        )


@dataclass(frozen=True, eq=False)
class TabularMDP(MDP):
    """A finite MDP given by its transition matrix.

    Parameters
    ----------
    transition
        :math:`P^{sas'}`, shape ``(S, A, S)``; every row ``[s, a]`` sums to 1.
    reward
        Expected reward :math:`R^{sa}`, shape ``(S, A)``.
    start
        Start-state distribution, shape ``(S,)``.
    terminal
        Absorbing states, shape ``(S,)`` bool; default none.  Each must return to
        itself with probability 1 and reward 0 under every action.
    discount
        gamma in [0, 1].
    features
        Named integer features, each ``(S,)``; default one feature ``state``.
    actions
        Names of the actions; default ``"0"``, ``"1"``, ...
    transition_reward
        Reward of each transition, shape ``(S, A, S)``, for tasks in which the reward
        depends on where the step leads.  Its expectation must be ``reward``.

    Raises
    ------
    ValueError
        When shapes disagree, a row does not sum to 1, an entry is not finite or a
        terminal state is not absorbing; the message names the row.

    Notes
    -----
    Source: section 2.2.  The arrays are copied and made read-only.

    Examples
    --------
    A state that is left with probability one half a step:

    >>> import numpy as np
    >>> waiting = TabularMDP(
    ...     transition=np.array([[[0.5, 0.5]], [[0.0, 1.0]]]),
    ...     reward=np.array([[-1.0], [0.0]]),
    ...     start=np.array([1.0, 0.0]),
    ...     terminal=np.array([False, True]),
    ...     discount=1.0,
    ... )
    >>> waiting.n_states, waiting.n_actions
    (2, 1)
    >>> waiting.lookahead(np.array([-2.0, 0.0])).tolist()  # -2 is its value
    [[-2.0], [0.0]]
    """

    transition: FloatArray
    reward: FloatArray
    start: FloatArray
    terminal: BoolArray = None  # type: ignore[assignment]
    discount: float = 1.0
    features: Mapping[str, IntArray] = None  # type: ignore[assignment]
    actions: tuple[str, ...] = None  # type: ignore[assignment]
    transition_reward: FloatArray | None = None

    def __post_init__(self) -> None:
        transition = _frozen(self.transition, np.float64)
        if transition.ndim != 3 or transition.shape[0] != transition.shape[2]:
            raise ValueError(
                f"transition has shape {transition.shape}, but (S, A, S) is needed: "
                "one row of next-state probabilities for each state and action."
            )
        n_states, n_actions, _ = transition.shape
        reward = _frozen(self.reward, np.float64)
        start = _frozen(self.start, np.float64)
        terminal = _frozen(
            np.zeros(n_states, bool) if self.terminal is None else self.terminal, np.bool_
        )
        actions = tuple(map(str, range(n_actions))) if self.actions is None else tuple(self.actions)
        features = {"state": np.arange(n_states)} if self.features is None else self.features
        for name, array, shape in (
            ("reward", reward, (n_states, n_actions)),
            ("start", start, (n_states,)),
            ("terminal", terminal, (n_states,)),
            ("actions", np.asarray(actions), (n_actions,)),
            *((f"feature {k!r}", np.asarray(v), (n_states,)) for k, v in features.items()),
        ):
            if array.shape != shape:
                raise ValueError(
                    f"{name} has shape {array.shape}, but {shape} is needed to agree with a "
                    f"transition of shape {transition.shape}."
                )
        for name, values in features.items():
            if not np.issubdtype(np.asarray(values).dtype, np.integer):
                raise ValueError(
                    f"feature {name!r} has values of type {np.asarray(values).dtype}, but features "
                    "are integers; give each distinct value an integer code."
                )
        if not 0.0 <= self.discount <= 1.0:
            raise ValueError(f"discount is {self.discount}, but it must be in [0, 1].")
        pairs = [f"[state {s}, action {a}]" for s in range(n_states) for a in actions]
        _check_probability_rows("transition", transition, pairs)
        _check_probability_rows("start", start[None], ["[start]"])
        bad = ~np.isfinite(reward)
        if bad.any():
            s, a = np.argwhere(bad)[0]
            raise ValueError(
                f"reward [state {s}, action {actions[a]}] is {reward[s, a]}, but rewards must be "
                "finite."
            )
        for s in np.flatnonzero(terminal):
            for a in range(n_actions):
                if abs(transition[s, a, s] - 1) > ATOL or reward[s, a] != 0:
                    raise ValueError(
                        f"terminal state {s} is not absorbing: action {actions[a]} stays with "
                        f"probability {transition[s, a, s]:.6g} and reward {reward[s, a]:.6g}, but "
                        "it must stay with probability 1 and reward 0."
                    )
        if self.transition_reward is not None:
            outcome = _frozen(self.transition_reward, np.float64)
            if outcome.shape != transition.shape:
                raise ValueError(
                    f"transition_reward has shape {outcome.shape}, but it must equal the shape "
                    f"{transition.shape} of transition."
                )
            expected = np.einsum("sat,sat->sa", transition, outcome)
            wrong = ~(np.abs(expected - reward) <= 1e-8 * (1 + np.abs(reward)))
            if wrong.any():
                s, a = np.argwhere(wrong)[0]
                raise ValueError(
                    f"transition_reward [state {s}, action {actions[a]}] has expectation "
                    f"{expected[s, a]:.6g}, but reward says {reward[s, a]:.6g}; the two must agree."
                )
            object.__setattr__(self, "transition_reward", outcome)
        for name, value in (
            ("transition", transition),
            ("reward", reward),
            ("start", start),
            ("terminal", terminal),
            ("actions", actions),
            ("discount", float(self.discount)),
            ("features", MappingProxyType({k: _frozen(v, np.int64) for k, v in features.items()})),
        ):
            object.__setattr__(self, name, value)

    def expectation(self, values: FloatArray) -> FloatArray:
        """Expected value of the next state, shape ``(S, A)``; see :meth:`MDP.expectation`."""
        return self.transition @ values

    def outcomes(self) -> Outcomes:
        """List the possible outcomes of every pair, padded to the longest list."""
        return self._outcomes

    @cached_property
    def _outcomes(self) -> Outcomes:
        possible = self.transition > 0
        width = int(possible.sum(axis=2).max())
        # A stable sort puts the possible successors first, in the order of the states.
        successor = np.argsort(~possible, axis=2, kind="stable")[:, :, :width]
        probability = np.take_along_axis(self.transition, successor, axis=2)
        if self.transition_reward is None:
            reward = np.broadcast_to(self.reward[:, :, None], successor.shape).copy()
        else:
            reward = np.take_along_axis(self.transition_reward, successor, axis=2)
        return Outcomes(successor.astype(np.int32), probability, reward)


def _frozen(array: ArrayLike, dtype: type[np.generic]) -> NDArray[Any]:
    """Copy ``array`` to a read-only C-ordered array of the given type."""
    copy: NDArray[Any] = np.array(array, dtype=dtype, order="C")
    copy.flags.writeable = False
    return copy
