"""The tasks of section 5.1 as Gymnasium environments.

Importing :mod:`thesis_lib` registers ``thesis/Swimmer-v0``, ``thesis/Hopper-v0``,
``thesis/HalfCheetah-v0``, ``thesis/Walker2d-v0`` and ``thesis/Ant-v0``, and on hills of
difficulty 0.5 ``thesis/SwimmerHill-v0`` to ``thesis/AntHill-v0``.  ``gymnasium.make`` gives
one world; ``gymnasium.make_vec`` gives many, stepped together by
:class:`~thesis_lib.locomotion.batch.BatchTask`.  Episodes have the 500 steps of training;
``max_episode_steps=1000`` makes them as long as the thesis's tests.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import mujoco
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from thesis_lib.arrays import BoolArray, FloatArray
from thesis_lib.locomotion.batch import BatchTask, Info
from thesis_lib.locomotion.options import task_options
from thesis_lib.locomotion.rendering import Renderer
from thesis_lib.locomotion.tasks import HORIZON, Task

Image = NDArray[np.uint8]

OBSERVATION_BOUND = 1e6
"""Bound of the observation space, as in the author's code; nothing is clipped to it."""


def _spaces(batch: BatchTask) -> tuple[Box, Box]:
    bound = np.full(batch.observation_size, OBSERVATION_BOUND)
    observations = Box(-bound, bound, dtype=np.float64)
    return observations, Box(-1.0, 1.0, (batch.action_size,), dtype=np.float32)


def _check_render_mode(render_mode: str | None) -> None:
    if render_mode not in (None, "rgb_array"):
        raise ValueError(f"render_mode is {render_mode!r}, but must be 'rgb_array' or None.")


class LocomotionEnv(gymnasium.Env[Any, Any]):
    """One world of a task, as :class:`gymnasium.Env`.

    Parameters
    ----------
    robot
        Swimmer, Hopper, HalfCheetah, Walker2d, Ant, or one that a package offers.
    render_mode
        ``"rgb_array"``, or None.
    width, height
        Size of the picture in pixels.
    camera
        Name of the camera.
    options
        The other attributes of :class:`TaskOptions`.

    Attributes
    ----------
    batch
        The only world, as a :class:`~thesis_lib.locomotion.batch.BatchTask` of one.

    Notes
    -----
    ``info`` holds the reward's components as ``reward_forward``, ``reward_control``,
    ``reward_contact``, ``reward_alive`` and ``reward_divergence``, the flags ``diverged``
    and ``off_map``, the centre of mass as ``x_position`` in metres, and, where noise or a
    subset hides it from the policy, the ``true_observation``.

    An action beyond 1000 in absolute value ends the episode with a reward of -1000, as in
    the author's sampler.  After the end of an episode the world stands still, with reward 0,
    until :meth:`reset`.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"]}  # noqa: RUF012 - Gymnasium's type

    def __init__(
        self,
        robot: str,
        render_mode: str | None = None,
        width: int = 480,
        height: int = 480,
        camera: str = "track",
        **options: Any,
    ) -> None:
        _check_render_mode(render_mode)
        self.batch = task_options(robot, options).batch(1, max_episode_steps=None)
        self.observation_space, self.action_space = _spaces(self.batch)
        self.render_mode = render_mode
        self.metadata = _metadata(self.batch.task)
        self._painter = _Painter(self.batch, width, height, camera)
        self._seeded = False

    @property
    def task(self) -> Task:
        """The task."""
        return self.batch.task

    @property
    def dt(self) -> float:
        """Seconds between two actions."""
        return self.batch.task.robot.control_dt

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Start an episode; see :meth:`gymnasium.Env.reset`."""
        super().reset(seed=seed)
        if seed is not None:
            self.batch.reseed(seed)
        elif not self._seeded:
            self.batch.reseed(int(self.np_random.integers(2**32)))
        self._seeded = True
        observation = self.batch.reset()[0]
        return observation, self._place(self.batch.true_observation[0])

    def step(self, action: ArrayLike) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """Apply an action in [-1, 1]; see :meth:`gymnasium.Env.step`.

        Raises
        ------
        ValueError
            If the action's shape is wrong or it is not finite.
        """
        action = np.asarray(action, dtype=np.float64)
        if action.shape != self.action_space.shape:
            raise ValueError(
                f"The action has shape {action.shape}, but {self.task.robot.name} needs shape "
                f"{self.action_space.shape}."
            )
        step = self.batch.step(action[None])
        info = self._place(step.info.true_observation[0])
        for name, part in step.info.components.items():
            info[f"reward_{name}"] = float(part[0])
        info["diverged"] = bool(step.info.diverged[0])
        info["off_map"] = bool(step.info.off_map[0])
        return (
            step.observation[0],
            float(step.reward[0]),
            bool(step.terminated[0]),
            bool(step.truncated[0]),
            info,
        )

    def _place(self, true_observation: FloatArray) -> dict[str, Any]:
        info: dict[str, Any] = {"x_position": float(self.batch.com[0, 0])}
        if self.batch.perturbations:
            info["true_observation"] = true_observation
        return info

    def set_state(self, qpos: ArrayLike, qvel: ArrayLike) -> None:
        """Put the robot into a state, as in Gymnasium's own MuJoCo environments.

        Parameters
        ----------
        qpos, qvel
            Positions (m, rad) and velocities (m/s, rad/s) in the model's order, shape ``(nq,)``
            and ``(nv,)``.

        Raises
        ------
        ValueError
            If a shape is wrong or a number is not finite.
        """
        self.batch.set_state(qpos, qvel)

    def render(self) -> Image | None:
        """Draw the world, shape ``(height, width, 3)``; None without ``render_mode``.

        Raises
        ------
        thesis_lib.locomotion.rendering.NoGL
            If OpenGL cannot be had; the message says what to do.
        """
        return None if self.render_mode is None else self._painter.frame(0)

    def close(self) -> None:
        """Let go of the renderer."""
        self._painter.close()


class LocomotionVectorEnv(VectorEnv[Any, Any, Any]):
    """Many worlds of a task, stepped together, as :class:`gymnasium.vector.VectorEnv`.

    Parameters
    ----------
    num_envs
        Number of worlds.
    robot
        Swimmer, Hopper, HalfCheetah, Walker2d, Ant, or one that a package offers.
    threads
        C++ threads; 0 takes all processors.  Results do not depend on it.
    n_maps
        On hills, how many maps the worlds take turns on.  The default, one fixed map for
        all, is what the author's recurrent networks were trained on.
    max_episode_steps
        Control steps after which an episode is truncated.
    autoreset_mode
        Gymnasium's modes: ``NEXT_STEP``, ``SAME_STEP`` or ``DISABLED``.
    render_mode, width, height, camera, options
        As in :class:`LocomotionEnv`.

    Notes
    -----
    World i of ``reset(seed=s)`` is the one world of :class:`LocomotionEnv` after
    ``reset(seed=s + i)``, bit for bit, as in Gymnasium's own vector environments.
    """

    def __init__(
        self,
        num_envs: int,
        robot: str,
        threads: int = 1,
        n_maps: int = 1,
        max_episode_steps: int | None = HORIZON,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        width: int = 480,
        height: int = 480,
        camera: str = "track",
        **options: Any,
    ) -> None:
        _check_render_mode(render_mode)
        self._mode = AutoresetMode(autoreset_mode)
        self.batch = task_options(robot, options).batch(
            num_envs,
            n_maps=n_maps,
            threads=threads,
            max_episode_steps=max_episode_steps,
            autoreset=self._mode is AutoresetMode.SAME_STEP,
        )
        self.num_envs = self.batch.num_envs
        self.single_observation_space, self.single_action_space = _spaces(self.batch)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.render_mode = render_mode
        self.metadata = {**_metadata(self.batch.task), "autoreset_mode": self._mode}
        self._painter = _Painter(self.batch, width, height, camera)
        self._ended = np.zeros(self.num_envs, dtype=bool)
        self._seeded = False

    def reset(
        self,
        *,
        seed: int | Sequence[int] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Start episodes; see :meth:`gymnasium.vector.VectorEnv.reset`.

        Parameters
        ----------
        seed
            World i gets ``seed + i``, or its own from a sequence.
        options
            ``{"reset_mask": mask}`` restarts only some worlds; the others' rows hold what
            they last saw.
        """
        mask = None if options is None else options.get("reset_mask")
        if seed is not None:
            seeds = [seed + i for i in range(self.num_envs)] if _is_int(seed) else list(seed)  # type: ignore[operator,arg-type]
            super().reset(seed=int(seeds[0]))
            self.batch.reseed(seeds)
            mask = None
        elif not self._seeded:
            self.batch.reseed(int(self.np_random.integers(2**32)))
            mask = None
        self._seeded = True
        self.batch.reset(mask)
        self._ended[slice(None) if mask is None else np.asarray(mask, dtype=bool)] = False
        return self.batch.observation, self._place()

    def step(
        self, actions: ArrayLike
    ) -> tuple[FloatArray, FloatArray, BoolArray, BoolArray, dict[str, Any]]:
        """Apply one action in each world; see :meth:`gymnasium.vector.VectorEnv.step`.

        Raises
        ------
        ValueError
            If the actions' shape is wrong or they are not finite, or, without autoreset,
            if a world's episode has ended and it was not reset.
        """
        if self._mode is AutoresetMode.DISABLED and self._ended.any():
            raise ValueError(
                f"The episode of world {int(np.argmax(self._ended))} has ended; call reset with "
                "options={'reset_mask': mask}."
            )
        step = self.batch.step(actions)
        observation, terminated, truncated = step.observation, step.terminated, step.truncated
        restarted = np.zeros(self.num_envs, dtype=bool)
        if self._mode is AutoresetMode.NEXT_STEP and self._ended.any():
            # worlds that ended last time stood still in this step, with reward 0
            restarted = self._ended
            self.batch.reset(restarted)
            observation = self.batch.observation
            terminated = terminated & ~restarted
            truncated = truncated & ~restarted
        self._ended = terminated | truncated
        if self._mode is AutoresetMode.SAME_STEP:
            restarted = self._ended
        return observation, step.reward, terminated, truncated, self._info(step.info, restarted)

    def _place(self) -> dict[str, Any]:
        return self._marked(self._where(self.batch.com, self.batch.true_observation))

    def _where(self, com: FloatArray, true_observation: FloatArray) -> dict[str, NDArray[Any]]:
        hidden = {"true_observation": true_observation} if self.batch.perturbations else {}
        return {"x_position": com[:, 0], **hidden}

    def _info(self, info: Info, restarted: BoolArray) -> dict[str, Any]:
        """What Gymnasium's own vector environments make of each world's info.

        A reset tells nothing but the place, so that for worlds that have begun anew in this
        step, the step itself is told in ``final_info`` or nowhere.
        """
        step: dict[str, NDArray[Any]] = {
            f"reward_{name}": part for name, part in info.components.items()
        }
        step |= {"diverged": info.diverged, "off_map": info.off_map}
        infos = self._place()
        if not restarted.all():
            infos |= self._marked(step, ~restarted)
        if info.final is not None:
            last = self._where(info.final.com, info.final.true_observation)
            infos["final_info"] = self._marked(step | last, restarted)
            infos["final_obs"] = np.full(self.num_envs, None, dtype=object)
            for i in np.flatnonzero(restarted):
                infos["final_obs"][i] = info.final.observation[i]
            infos["_final_info"], infos["_final_obs"] = restarted.copy(), restarted.copy()
        return infos

    def _marked(
        self, values: dict[str, NDArray[Any]], mask: BoolArray | None = None
    ) -> dict[str, Any]:
        """Beside each entry, which worlds it holds for; it is 0 for the others."""
        mask = np.ones(self.num_envs, dtype=bool) if mask is None else mask
        infos: dict[str, Any] = {}
        for name, value in values.items():
            infos[name], infos[f"_{name}"] = np.zeros_like(value), mask.copy()
            infos[name][mask] = value[mask]
        return infos

    def set_state(self, qpos: ArrayLike, qvel: ArrayLike, worlds: ArrayLike | None = None) -> None:
        """Put worlds into given states; see :meth:`BatchTask.set_state`."""
        self.batch.set_state(qpos, qvel, worlds)

    def render(self) -> tuple[Image, ...] | None:
        """Draw every world; None without ``render_mode``.

        Raises
        ------
        thesis_lib.locomotion.rendering.NoGL
            If OpenGL cannot be had; the message says what to do.
        """
        if self.render_mode is None:
            return None
        return tuple(self._painter.frame(i) for i in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """Let go of the renderers."""
        self._painter.close()


class _Painter:
    """Draws worlds of a batch, with one renderer for each ground."""

    def __init__(self, batch: BatchTask, width: int, height: int, camera: str) -> None:
        self._batch = batch
        self._options = (width, height, camera)
        self._open: dict[int, tuple[Renderer, mujoco.MjData]] = {}

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_open": {}}  # a copy opens renderers of its own

    def frame(self, world: int) -> Image:
        """Draw one world."""
        ground = self._batch.ground_id(world)
        if ground not in self._open:
            model = self._batch.get_model(world)
            self._open[ground] = (Renderer(model, *self._options), mujoco.MjData(model))
        renderer, data = self._open[ground]
        return renderer.frame(self._batch.get_data(world, data))

    def close(self) -> None:
        """Close all renderers."""
        for renderer, _ in self._open.values():
            renderer.close()
        self._open.clear()


def _is_int(value: Any) -> bool:
    return isinstance(value, int | np.integer)


def _metadata(task: Task) -> dict[str, Any]:
    return {"render_modes": ["rgb_array"], "render_fps": round(1 / task.robot.control_dt)}
