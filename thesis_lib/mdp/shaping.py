r"""Potential-based shaping of any Gymnasium environment (section 3.1).

:func:`thesis_lib.mdp.learning.learn` shapes tabular tasks by itself; this is for agents and
environments of one's own.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Discrete
from numpy.typing import ArrayLike

from thesis_lib.checks import probability


class PotentialShaping(gymnasium.Wrapper[Any, Any, Any, Any]):
    r"""Add :math:`F = \gamma\Phi(s') - \Phi(s)` or look-ahead advice to the reward.

    Without ``next_action`` the potential is one of states (Ng, Harada and Russell).  With it,
    the potential is one of state-action pairs, and the reward gains the look-ahead advice

    .. math:: F = \gamma\Phi(s', a') - \Phi(s, a)

    of Wiewiora, Cottrell and Elkan, with :math:`a'` as in the agent's learning rule.
    :math:`\Phi` is 0 in a terminal state, whatever the function says, but not where an episode
    is truncated.

    Parameters
    ----------
    env
        The environment.
    potential
        A function of the observation, or of observation and action, that returns a number;
        or, where observations (and actions) are whole numbers from 0, a table of them, shape
        ``(S,)`` or ``(S, A)``.
    discount
        :math:`\gamma` of the agent.
    next_action
        A function of the next observation that returns :math:`a'`: the action the agent will
        take there (Sarsa), or the greedy one by :math:`Q + \Phi` (Q-learning).  It is asked
        once a step, unless the state is terminal, and ``info["next_action"]`` tells what it
        answered, which a Sarsa agent then takes.

    Raises
    ------
    ValueError
        When the discount is not in [0, 1], a table does not fit, or the potential's value is
        not one finite number.
    gymnasium.error.ResetNeeded
        When a step is taken before the first reset.

    Notes
    -----
    ``info["shaping"]`` is F.

    *When this changes nothing but the speed.*  A potential of states leaves every policy's
    advantages, and so the best policies, as they are.  Look-ahead advice is the same as
    starting from :math:`Q = \Phi`, but only for an agent that chooses its actions by
    :math:`Q + \Phi`; an agent that chooses by Q alone may learn something else.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        potential: Callable[..., float] | ArrayLike,
        discount: float,
        next_action: Callable[[Any], Any] | None = None,
    ) -> None:
        super().__init__(env)
        self.discount = probability("discount", discount)
        self.next_action = next_action
        self._potential = potential if callable(potential) else self._look_up(potential)
        self._observation: Any = None

    def _look_up(self, potential: ArrayLike) -> Callable[..., float]:
        table = np.asarray(potential, dtype=float)
        spaces = (self.observation_space, self.action_space)[: 2 if self.next_action else 1]
        sizes = [int(s.n) for s in spaces if isinstance(s, Discrete) and s.start == 0]
        if len(sizes) < len(spaces) or list(table.shape) != sizes:
            pairs = table.ndim == 2 and not self.next_action
            raise ValueError(
                f"the potential is a table of shape {table.shape}, but it is looked up in "
                f"{' and '.join(map(str, spaces))}; give one number for each value, or a function "
                f"where they are not counted from 0{', or next_action for pairs' * pairs}."
            )
        return lambda *pair: float(table[pair])

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode; see :meth:`gymnasium.Env.reset`."""
        self._observation, info = self.env.reset(seed=seed, options=options)
        return self._observation, info

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Take an action; the reward is the environment's plus F."""
        if self._observation is None:
            raise gymnasium.error.ResetNeeded("call reset before the first step.")
        before = self._value(self._observation, action)
        observation, reward, terminated, truncated, info = self.env.step(action)
        after = 0.0
        if not terminated:
            following = self.next_action(observation) if self.next_action else None
            if self.next_action:
                info = {**info, "next_action": following}
            after = self._value(observation, following)
        self._observation = observation
        shaping = self.discount * after - before
        return (
            observation,
            float(reward) + shaping,
            terminated,
            truncated,
            {**info, "shaping": shaping},
        )

    def _value(self, observation: Any, action: Any) -> float:
        pair = (observation, action) if self.next_action else (observation,)
        value = self._potential(*pair)
        number = float(value) if np.ndim(value) == 0 else np.nan
        if not np.isfinite(number):
            raise ValueError(
                f"the potential is {value} at {pair}, but it must be one finite number."
            )
        return number
