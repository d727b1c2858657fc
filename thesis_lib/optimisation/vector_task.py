"""What a task must offer so that policies can be run on it: many worlds that step together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from numpy.typing import ArrayLike

from thesis_lib.arrays import BoolArray, FloatArray


class Outcome(Protocol):
    """What a task's step returns, an entry for each of n worlds."""

    @property
    def observation(self) -> FloatArray:
        """What the policy sees next, shape ``(n, D)``."""
        ...

    @property
    def reward(self) -> FloatArray:
        """Shape ``(n,)``."""
        ...

    @property
    def terminated(self) -> BoolArray:
        """Whether the state ended the episode, shape ``(n,)``."""
        ...

    @property
    def truncated(self) -> BoolArray:
        """Whether a limit ended the episode, shape ``(n,)``."""
        ...


@dataclass(frozen=True)
class Step:
    """An :class:`Outcome` and no more."""

    observation: FloatArray
    reward: FloatArray
    terminated: BoolArray
    truncated: BoolArray


class VectorTask(Protocol):
    """A task in n worlds; a world that has ended stands still until it is reset.

    :class:`thesis_lib.locomotion.BatchTask` is one, and
    :class:`thesis_lib.optimisation.GymnasiumTask` makes one of any environment.
    """

    @property
    def num_envs(self) -> int:
        """Number of worlds n."""
        ...

    @property
    def observation_size(self) -> int:
        """Length D of an observation."""
        ...

    @property
    def action_size(self) -> int:
        """Length A of an action."""
        ...

    def reset(self, worlds: Any = None) -> FloatArray:
        """Start new episodes in k worlds (default all); observations, shape ``(k, D)``."""
        ...

    def step(self, actions: ArrayLike) -> Outcome:
        """Act in every world, shape ``(n, A)``."""
        ...
