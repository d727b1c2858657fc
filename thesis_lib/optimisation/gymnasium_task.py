"""Any Gymnasium environment with a continuous action as a task that policies learn."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from numbers import Real
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, flatten, flatten_space
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.wrappers import TimeLimit, TransformObservation
from numpy.typing import ArrayLike

from thesis_lib.arrays import FloatArray
from thesis_lib.checks import positive_integer
from thesis_lib.optimisation.vector_task import Step

ENDLESS = 100_000
"""Steps after which an episode without a limit counts as one that never ends."""


class GymnasiumTask:
    """Worlds of one environment, as :func:`~thesis_lib.optimisation.collect` steps them (a
    :class:`~thesis_lib.optimisation.vector_task.VectorTask`).

    Parameters
    ----------
    env
        The id of an environment, or a function that makes one.
    num_envs
        Number of worlds n.
    seed
        Source of the worlds' random numbers.
    processes
        Whether each world runs in a process of its own, which pays if a step takes long.
    dt
        Seconds between two actions, which a CTRNN integrates over; default what the
        environment says, as ``dt`` or frames a second.
    **options
        Passed to ``gymnasium.make``, such as ``max_episode_steps``.

    Attributes
    ----------
    observation_size, action_size
        Lengths D and A.
    max_episode_steps
        The environment's limit on the steps of an episode, or None.

    Raises
    ------
    ValueError
        When the action is no ``Box``, an environment is given that is made already, or options
        are given beside a function; in a step, when an episode seems never to end.

    Notes
    -----
    Observations of any shape are flattened.  Actions between finite bounds are given from -1
    to 1, clipped and stretched to the bounds, as in :class:`~thesis_lib.locomotion.BatchTask`;
    others are passed on as they are.
    """

    def __init__(
        self,
        env: str | Callable[[], gymnasium.Env[Any, Any]],
        num_envs: int,
        *,
        seed: int | np.random.SeedSequence = 0,
        processes: bool = False,
        dt: float | None = None,
        **options: Any,
    ) -> None:
        positive_integer("num_envs", num_envs)
        if dt is not None and not (isinstance(dt, Real) and 0 < dt < np.inf):
            raise ValueError(f"dt is {dt!r}, but it must be a positive number of seconds.")
        if not isinstance(env, str) and not callable(env):
            raise ValueError(f"env is {env}; give its id, or a function that makes one.")
        if options and not isinstance(env, str):
            raise ValueError(
                f"{', '.join(options)} is given beside a function that makes an environment; let "
                "the function take care of it."
            )

        make = partial(_make, env, options)
        one = make()
        space, seen = one.action_space, one.observation_space
        if not isinstance(space, Box):
            raise ValueError(
                f"the action of {one} is a {space}, but policies here draw continuous ones; give "
                "an environment with a Box action."
            )
        said, self.max_episode_steps = getattr(one.unwrapped, "dt", None), _limit(one)
        rate = one.metadata.get("render_fps")
        one.close()
        assert isinstance(seen, Box)
        self._dt = dt or (float(said) if said else 1.0 / rate if rate else None)
        self.num_envs = num_envs
        self.observation_size, self.action_size = seen.shape[0], int(np.prod(space.shape))
        self._space = space
        kind: Callable[..., VectorEnv[Any, Any, Any]] = (
            AsyncVectorEnv if processes else SyncVectorEnv
        )
        self.envs = kind([make] * num_envs, autoreset_mode=AutoresetMode.NEXT_STEP)
        self.reseed(seed)

    @property
    def dt(self) -> float:
        """Seconds between two actions; ValueError when nobody has said."""
        if self._dt is None:
            raise ValueError(
                "the environment does not say how long a step takes; give dt, in seconds."
            )
        return self._dt

    def reseed(self, seed: int | np.random.SeedSequence) -> None:
        """Give every world the random numbers of another seed; call :meth:`reset` next."""
        parent = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
        self._seeds: list[int] | None = [int(s) for s in parent.generate_state(self.num_envs)]
        self._seen = np.zeros((self.num_envs, self.observation_size))
        self._terminated = np.zeros(self.num_envs, dtype=bool)
        self._truncated = np.zeros(self.num_envs, dtype=bool)
        self._time = np.zeros(self.num_envs, dtype=np.int64)

    def reset(self, worlds: ArrayLike | None = None) -> FloatArray:
        """Start new episodes in k worlds (default all).

        Parameters
        ----------
        worlds
            Ids, rising.

        Returns
        -------
        FloatArray
            What the policy sees there, shape ``(k, D)``.
        """
        ids = np.arange(self.num_envs) if worlds is None else np.asarray(worlds)
        mask = np.zeros(self.num_envs, dtype=bool)
        mask[ids] = True
        if mask.all():
            seen, _ = self.envs.reset(seed=self._seeds)  # type: ignore[arg-type]
            self._seeds = None
        else:
            seen, _ = self.envs.reset(options={"reset_mask": mask})
        self._seen[mask] = seen[mask]
        self._terminated[mask] = self._truncated[mask] = False
        self._time[mask] = 0
        return self._seen[ids]

    def step(self, actions: ArrayLike) -> Step:
        """Act in every world, shape ``(n, A)``; worlds that have ended stand still."""
        action = np.asarray(actions, dtype=np.float64).reshape(self.num_envs, *self._space.shape)
        if self._space.is_bounded("both"):
            low, high = self._space.low.astype(float), self._space.high.astype(float)
            action = low + (np.clip(action, -1.0, 1.0) + 1.0) / 2.0 * (high - low)
        # In the engine, a world that has ended begins a new episode; here nobody sees it.
        seen, reward, terminated, truncated, _ = self.envs.step(action.astype(self._space.dtype))
        running = ~(self._terminated | self._truncated)
        self._time += running
        if self.max_episode_steps is None and self._time.max() > ENDLESS:
            raise ValueError(
                f"an episode has not ended in {ENDLESS:,} steps, and the environment has no limit "
                "of its own: wrap it in gymnasium.wrappers.TimeLimit, or give max_episode_steps."
            )
        self._seen[running] = seen[running]
        self._terminated |= terminated & running
        self._truncated |= truncated & running
        return Step(
            observation=self._seen.copy(),
            reward=np.where(running, reward, 0.0),
            terminated=self._terminated.copy(),
            truncated=self._truncated.copy(),
        )

    def close(self) -> None:
        """Close the environments, and end their processes if they have any."""
        self.envs.close()


def _limit(env: gymnasium.Env[Any, Any]) -> int | None:
    """The steps after which an environment cuts an episode, or None."""
    while isinstance(env, gymnasium.Wrapper):
        if isinstance(env, TimeLimit):
            return int(env._max_episode_steps)
        env = env.env
    return None


def _make(
    env: str | Callable[[], gymnasium.Env[Any, Any]], options: dict[str, Any]
) -> gymnasium.Env[Any, Any]:
    made = gymnasium.make(env, **options) if isinstance(env, str) else env()
    space = made.observation_space
    # As FlattenObservation, which can't be pickled
    return TransformObservation(made, partial(flatten, space), flatten_space(space))
