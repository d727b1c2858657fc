"""The heat domain as a Gymnasium environment."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from thesis_lib.arrays import FloatArray
from thesis_lib.domains.heat import ACTIONS, HeatTask, HeatWorld, distance_to, move, place, sense


class HeatEnv(gymnasium.Env[FloatArray, np.int64]):
    """A round robot looks for a heat source; see :mod:`thesis_lib.domains.heat`.

    Registered as ``thesis/Heat-v0``.  Observations are the noisy x, y, heading and heat,
    actions 0 to 3 go forward, go backward, turn left and turn right.  An episode ends
    when the source is within the robot's radius.

    Parameters
    ----------
    source
        Where the source is; if None, a new task is drawn from the domain at every reset.
    render_mode
        Only None: :func:`thesis_lib.edition.drawings.draw_heat` draws a task.
    **world
        Passed to :class:`~thesis_lib.domains.heat.HeatWorld`.
    """

    metadata = {"render_modes": []}  # noqa: RUF012  (Gymnasium's own convention)

    def __init__(
        self,
        source: tuple[float, float] | None = None,
        *,
        render_mode: None = None,
        **world: Any,
    ) -> None:
        if render_mode is not None:
            raise ValueError(f"render_mode is {render_mode!r}, but this environment has none.")
        self.world = HeatWorld(**world)
        self.render_mode = render_mode
        self._given = None if source is None else HeatTask(source, self.world).source
        high = np.array([self.world.size, self.world.size, 2 * np.pi, 1.0])
        self.observation_space = spaces.Box(np.zeros(4), high, dtype=np.float64)
        self.action_space = spaces.Discrete(len(ACTIONS))
        self._source: FloatArray | None = None
        self._state = np.zeros(3)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Start an episode at a random place, facing anywhere.

        Parameters
        ----------
        seed
            Seed of the environment's random numbers; None goes on with them.
        options
            Not used.

        Returns
        -------
        tuple
            Observation and info: the true ``state`` (x, y, heading) and the ``source``.
        """
        super().reset(seed=seed)
        source = self._given
        if source is None:
            source = self.world.sample_source(self.np_random)
        self._source = np.array(source, dtype=np.float64)
        place(self.np_random, self.world.parameters, self._source, self._state)
        return self._observe()

    def step(self, action: np.int64) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """Take an action.

        Returns
        -------
        tuple
            Observation, reward, whether the source was reached, False (never truncated), info.

        Raises
        ------
        ValueError
            When the action is not in the action space.
        gymnasium.error.ResetNeeded
            When no episode was started.
        """
        if self._source is None:
            raise gymnasium.error.ResetNeeded("call reset before the first step.")
        if not self.action_space.contains(action):
            raise ValueError(f"action is {action!r}, but it must be an integer from 0 to 3.")
        parameters = self.world.parameters
        move(self.np_random, parameters, self._state, action)
        found = bool(distance_to(self._state, self._source) <= self.world.radius)
        observation, info = self._observe()
        return observation, float(self.world.step_reward), found, False, info

    def _observe(self) -> tuple[FloatArray, dict[str, Any]]:
        assert self._source is not None
        reading = np.empty(4)
        sense(self.np_random, self.world.parameters, self._source, self._state, reading)
        return reading, {"state": self._state.copy(), "source": self._source.copy()}
