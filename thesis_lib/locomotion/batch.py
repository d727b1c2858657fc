"""Many worlds of one task stepped together, outside Python's interpreter (section 5.4).

The physics is MuJoCo's own :class:`mujoco.batch.Batch`: each world is a row of state that
C++ threads advance.  Observation, reward and termination are computed here for all worlds
at once.  A world's trajectory is bit for bit that of a plain ``mj_step`` loop, whatever
the number of threads and whatever the other worlds do.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import mujoco
import mujoco.batch
import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import BoolArray, FloatArray, IntArray
from thesis_lib.checks import one_of
from thesis_lib.locomotion.robots import COM_VELOCITY, ROOT_BODY, Ground, build_model
from thesis_lib.locomotion.tasks import (
    HORIZON,
    RESET_POSITION_NOISE,
    RESET_VELOCITY_NOISE,
    Fields,
    Task,
    make_task,
)

Seed = int | np.random.SeedSequence | Sequence[int]

DIVERGENCE_REWARD = -1000.0
"""Reward of the step in which a world diverges, as in the author's code."""

ACTION_LIMIT = 1e3
"""A policy whose output exceeds this in absolute value has diverged (the author's rule)."""

STATE_LIMIT = 1e10
"""Positions and velocities beyond this make the engine give up; here the world diverges."""

PERSISTENT_WORLDS = 128
"""Up to so many worlds, each keeps its own working memory; results are the same either way."""

_RESETS_DRAWN = 8
"""For how many resets a world draws its noise at once."""

_ENGINE = ("_batch", "_fields", "_ctrl", "_xfrc", "_warning_counts", "_moving")
"""Attributes of a batch that a copy makes anew: the engine, and views of its arrays."""

_BAD_STATE = slice(mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADCTRL + 1)
_WARNINGS = (
    "inertia",
    "contacts",
    "constraints",
    "position",
    "velocity",
    "acceleration",
    "control",
)


@dataclass(frozen=True)
class Attachment:
    """What a perturbation learns about the batch it is attached to.

    Attributes
    ----------
    task
        The task.
    num_envs
        Number of worlds n.
    sensors
        Names of the observation columns it will be given.
    generators
        One random stream per world.  World i's stream is its own: what is drawn from it
        depends on nothing but the seed and world i's history.
    model
        The model before any edit with a later onset.
    """

    task: Task
    num_envs: int
    sensors: tuple[str, ...]
    generators: tuple[np.random.Generator, ...]
    model: mujoco.MjModel


class Effect:
    """A perturbation at work in one batch; every hook does nothing unless overridden.

    ``worlds`` are the ids of the k worlds concerned, sorted, and rows of the other
    arguments belong to them, but for the forces, which have a row for every world.
    ``t`` counts the control steps taken in each world's episode: 0 for the observation
    after a reset, k for the one that step k returns.
    """

    def on_reset(self, worlds: IntArray) -> None:
        """Forget the last episode of these worlds."""

    def on_action(self, t: IntArray, actions: FloatArray, worlds: IntArray) -> FloatArray:
        """Change actions, shape ``(k, A)`` in [-1, 1], on their way to the motors."""
        return actions

    def on_force(self, t: IntArray, xfrc_applied: FloatArray, worlds: IntArray) -> None:
        """Add forces and torques on bodies, zero before this.

        Parameters
        ----------
        t, worlds
            Of the k worlds concerned.
        xfrc_applied
            Force in N, then torque in N m, in the world's frame, of every body in all n worlds,
            shape ``(n, bodies, 6)``: change ``xfrc_applied[worlds]``.  Body 0 is the world.
        """

    def on_observation(self, t: IntArray, observations: FloatArray, worlds: IntArray) -> FloatArray:
        """Change what the policy sees, shape ``(k, D)``, each entry in its sensor's unit.

        Rewards use the true state.
        """
        return observations


class Perturbation:
    """A change of a task's dynamics or sensors; subclasses are frozen dataclasses.

    The object only describes.  Its buffers and random streams live in the
    :class:`Effect` that :meth:`attach` makes for each batch.

    Attributes
    ----------
    onset
        First control step of an episode at which it acts.
    edits_model
        Whether worlds run on a model changed by :meth:`edit_model` from ``onset`` on.
    """

    onset: int = 0
    edits_model: bool = False

    def edit_model(self, spec: mujoco.MjSpec) -> None:
        """Change the model, for instance masses or friction."""

    def ground(
        self, robot: str, num_envs: int, seed: np.random.SeedSequence
    ) -> Sequence[Ground] | None:
        """Offer a terrain for each world, or None to leave the ground alone."""
        return None

    def sensors(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """Names of the sensors the policy is left with."""
        return names

    def attach(self, context: Attachment) -> Effect | None:
        """Start the perturbation in a batch; None if it has no part in the loop."""
        return None


@dataclass(frozen=True)
class Final:
    """The end of the old episodes, where worlds have already begun new ones.

    Attributes
    ----------
    observation, true_observation
        The last one with and without perturbations, shapes ``(n, D)``.
    com
        The last centre of mass, shape ``(n, 3)``, in metres.
    """

    observation: FloatArray
    true_observation: FloatArray
    com: FloatArray


@dataclass(frozen=True)
class Info:
    """What a step tells besides observation, reward and flags; arrays over n worlds.

    Attributes
    ----------
    components
        What the reward is the sum of, by name: ``forward``, ``control``, ``contact``,
        ``alive``, ``divergence``; each shape ``(n,)``.
    diverged
        Worlds that diverged in this step, shape ``(n,)``.
    off_map
        Worlds that left their terrain in this step, shape ``(n,)``.
    true_observation
        The observation before any perturbation, shape ``(n, D)``.
    episode_return, episode_length
        Undiscounted return and number of steps of each world's episode so far, that
        which just ended included; shape ``(n,)``.
    final
        How the old episodes stood in worlds that restarted at once; None if none did.
    """

    components: dict[str, FloatArray]
    diverged: BoolArray
    off_map: BoolArray
    true_observation: FloatArray
    episode_return: FloatArray
    episode_length: IntArray
    final: Final | None


@dataclass(frozen=True)
class Step:
    """Outcome of one control step in n worlds.

    Attributes
    ----------
    observation
        What the policy sees next, shape ``(n, D)``.
    reward
        Shape ``(n,)``.
    terminated
        Whether the state ended the episode, shape ``(n,)``.
    truncated
        Whether the step limit or the edge of the map ended it, shape ``(n,)``.
    info
        Everything else.
    """

    observation: FloatArray
    reward: FloatArray
    terminated: BoolArray
    truncated: BoolArray
    info: Info


def _child(parent: np.random.SeedSequence, *key: int) -> np.random.SeedSequence:
    """Descendant of a seed sequence, by its key alone: unlike ``spawn``, it keeps no count."""
    return np.random.SeedSequence(parent.entropy, spawn_key=(*parent.spawn_key, *key))


def _world_seeds(seed: Seed, n: int) -> list[np.random.SeedSequence]:
    """One independent seed sequence per world; the first n are the same for any larger n."""
    if isinstance(seed, np.random.SeedSequence):
        return [_child(seed, 0, i) for i in range(n)]
    numbers = [seed] if isinstance(seed, int | np.integer) else list(seed)
    for number in numbers:
        if not isinstance(number, int | np.integer) or number < 0:
            raise ValueError(f"seed is {number!r}, but must be a whole number, 0 or more.")
    roots = [np.random.SeedSequence(int(number)) for number in numbers]
    if isinstance(seed, int | np.integer):
        return [_child(roots[0], 0, i) for i in range(n)]
    if len(roots) != n:
        raise ValueError(
            f"There are {len(roots)} seeds for {n} worlds; give one seed, or one for each world."
        )
    return [_child(root, 0, 0) for root in roots]


class BatchTask:
    """N worlds of one task in a closed loop.

    Parameters
    ----------
    task
        A task, or the name of a robot for :func:`~thesis_lib.locomotion.tasks.make_task`.
    num_envs
        Number of worlds n, at least 1.
    threads
        C++ threads that share the worlds; 0 takes all processors.  Results do not
        depend on it.
    seed
        A whole number or seed sequence from which every world gets its own random
        streams, or one number per world.  World i of ``seed=[s0, s1, ...]`` is the only
        world of a batch with ``num_envs=1, seed=si``.
    terrain
        A ground for all worlds, one for each of them, or None for the flat floor.
    perturbations
        Perturbations in the order in which they act.
    max_episode_steps
        Control steps after which an episode is truncated; None for no limit.
    autoreset
        Whether :meth:`step` restarts ended worlds at once.  Otherwise they stand still,
        with reward 0 and their flags up, until :meth:`reset`.
    bad_actions
        What to do with NaN or infinite actions: ``"raise"`` a ValueError, or ``"end"``
        the episode as diverged, as the author's sampler did.  Actions beyond
        ``ACTION_LIMIT`` end it in either case.

    Notes
    -----
    A world diverges when its policy's output does, or when the engine finds its state
    or acceleration not finite or too large.  Its episode ends with the reward
    ``DIVERGENCE_REWARD`` and the flag ``info.diverged``, its observation is the last
    good one, and the other worlds go on.

    Examples
    --------
    >>> import numpy as np
    >>> task = BatchTask("Hopper", num_envs=2, seed=0)
    >>> task.reset().shape
    (2, 20)
    >>> task.step(np.zeros((2, task.action_size))).reward.shape
    (2,)
    """

    def __init__(
        self,
        task: Task | str,
        num_envs: int,
        *,
        threads: int = 1,
        seed: Seed = 0,
        terrain: Ground | Sequence[Ground] | None = None,
        perturbations: Sequence[Perturbation] = (),
        max_episode_steps: int | None = HORIZON,
        autoreset: bool = False,
        bad_actions: Literal["raise", "end"] = "raise",
    ) -> None:
        self.task = make_task(task) if isinstance(task, str) else task
        _check_count("num_envs", num_envs, least=1)
        _check_count("threads", threads, least=0)
        if max_episode_steps is not None:
            _check_count("max_episode_steps", max_episode_steps, least=1)
        one_of("bad_actions", bad_actions, ("raise", "end"))
        self.num_envs = int(num_envs)
        self.perturbations = tuple(perturbations)
        self.max_episode_steps = max_episode_steps
        self.autoreset = autoreset
        self._raise_bad_actions = bad_actions == "raise"
        self._seeds = _world_seeds(seed, self.num_envs)
        self._all = np.arange(self.num_envs)
        self._build_models(self._choose_grounds(terrain))
        self._phase = np.zeros(self.num_envs, dtype=np.int64)
        self._open(threads)
        self.reseed(seed)

    # -- building ---------------------------------------------------------------------

    def _open(self, threads: int) -> None:
        """Start the engine on the models, and look into it."""
        # A persistent batch goes on from the forward stages of its last call, which makes
        # positions and velocities at the new state free.  Forces must be computed anew
        # anyway, and many worlds outgrow the processor's cache: then one thread's memory
        # for all its worlds is faster.
        forces = self.task.needs_forces
        self._stage = int(mujoco.mjtStage.mjSTAGE_ACC if forces else mujoco.mjtStage.mjSTAGE_VEL)
        self._batch = mujoco.batch.Batch(
            self._models[0][0],
            self.num_envs,
            threads,
            persistent=not forces and self.num_envs <= PERSISTENT_WORLDS,
        )
        self._set_models()
        self._bind()

    def __getstate__(self) -> dict[str, Any]:
        # The engine can't be copied, nor can views of it.  Its state rows hold all it remembers.
        kept = {name: value for name, value in self.__dict__.items() if name not in _ENGINE}
        engine = (self.threads, self._batch.state.copy(), self._fields.previous_action.copy())
        return {**kept, "engine": engine}

    def __copy__(self) -> BatchTask:
        return copy.deepcopy(self)  # two engines must not count one another's steps

    def __setstate__(self, state: dict[str, Any]) -> None:
        threads, rows, previous_action = state.pop("engine")
        self.__dict__.update(state)
        self._open(threads)
        self._fields.previous_action[:] = previous_action
        self._batch.state[:] = rows
        self._batch.forward(stage=self._stage)
        self._batch.state[:] = rows  # without what the engine has just learned anew

    def _choose_grounds(self, terrain: Ground | Sequence[Ground] | None) -> list[Ground | None]:
        """One ground for each world, from the argument or from a perturbation."""
        offers = [] if terrain is None else [terrain]
        seed = _child(self._seeds[0], 1)
        for perturbation in self.perturbations:
            offer = perturbation.ground(self.task.robot.name, self.num_envs, seed)
            if offer is not None:
                offers.append(offer)
        if len(offers) > 1:
            raise ValueError(
                f"{len(offers)} terrains are asked for at once; give either terrain or one "
                "perturbation that brings its own."
            )
        if not offers:
            return [None] * self.num_envs
        if not isinstance(offers[0], Sequence):
            return [offers[0]] * self.num_envs
        if len(offers[0]) != self.num_envs:
            raise ValueError(
                f"There are {len(offers[0])} terrains for {self.num_envs} worlds; give one "
                "terrain, or one for each world."
            )
        return list(offers[0])

    def _build_models(self, grounds: list[Ground | None]) -> None:
        """Compile a model for every ground and every stage of the perturbations.

        The grounds themselves are not kept: a map's heights are in its models.
        """
        edits = [p for p in self.perturbations if p.edits_model]
        self._onsets = np.array(sorted({p.onset for p in edits if p.onset > 0}), dtype=np.int64)
        distinct = {id(ground): ground for ground in grounds}
        number = {key: k for k, key in enumerate(distinct)}
        self._ground_of = np.array([number[id(ground)] for ground in grounds])
        self._models = [
            [
                build_model(
                    self.task.robot,
                    ground,
                    [p.edit_model for p in edits if p.onset <= onset],
                )
                for onset in (0, *self._onsets)
            ]
            for ground in distinct.values()
        ]
        self._map_edges: tuple[FloatArray, FloatArray] | None = None
        if grounds[0] is not None:
            centre = np.array([g.centre for g in grounds if g is not None])
            half = np.array([g.half_size for g in grounds if g is not None])
            self._map_edges = (centre - half, centre + half)

    def _set_models(self) -> None:
        """Run every world on the model of its ground and phase."""
        if len(self._models) > 1 or len(self._onsets):
            pairs = zip(self._ground_of, self._phase, strict=True)
            self._batch.set_models([self._models[g][p] for g, p in pairs])

    def _bind(self) -> None:
        """Bind live views of what observation, reward and control need."""
        batch, model, n = self._batch, self.model, self.num_envs
        sensor = model.sensor(COM_VELOCITY)
        start, root = int(sensor.adr[0]), model.body(ROOT_BODY).id
        used = self.task.fields_used
        none = np.empty((n, 0))
        self._fields = Fields(
            qpos=batch.bind("qpos"),
            qvel=batch.bind("qvel"),
            com=batch.bind("subtree_com")[:, root],
            com_velocity=batch.bind("sensordata")[:, start : start + 3],
            constraint_force=batch.bind("qfrc_constraint") if "constraint_force" in used else none,
            contact_force=(
                batch.bind("cfrc_ext").reshape(n, -1) if "contact_force" in used else none
            ),
            rotation=batch.bind("xmat")[:, root] if "rotation" in used else none,
            previous_action=np.zeros((n, self.task.action_size)),
        )
        self._ctrl = batch.bind("ctrl")
        self._xfrc = batch.bind("xfrc_applied")
        self._warning_counts = batch.warning[:, :, 1]
        low, high = model.actuator_ctrlrange.T
        self._ctrl_centre, self._ctrl_half = (low + high) / 2, (high - low) / 2
        # A state row holds all that a world remembers, positions before velocities.
        self._fields.qpos[0] = self.task.robot.init_qpos
        self._blank = batch.state[0].copy()
        batch.state[0] = 0.0
        self._fields.qpos[0] = RESET_POSITION_NOISE
        self._fields.qvel[0] = RESET_VELOCITY_NOISE
        moving = np.flatnonzero(batch.state[0])
        self._moving = batch.state[:, moving[0] : moving[-1] + 1]
        self._noise_scale = self._moving[0].copy()

    def reseed(self, seed: Seed) -> None:
        """Give every world the random streams of another seed; call :meth:`reset` next.

        Terrains stay as they were built.

        Raises
        ------
        ValueError
            If the seed is no whole number, or there is not one for each world.
        """
        self._seeds = _world_seeds(seed, self.num_envs)
        self._generators = [np.random.default_rng(_child(s, 0)) for s in self._seeds]
        # noise of the next few resets of each world, drawn when it runs out
        self._noise = np.empty((self.num_envs, _RESETS_DRAWN, len(self._noise_scale)))
        self._noise_used = np.full(self.num_envs, _RESETS_DRAWN)
        names = self.task.sensor_names
        self._effects: list[Effect] = []
        for k, perturbation in enumerate(self.perturbations):
            streams = tuple(np.random.default_rng(_child(s, 2, k)) for s in self._seeds)
            context = Attachment(self.task, self.num_envs, names, streams, self.model)
            effect = perturbation.attach(context)
            if effect is not None:
                self._effects.append(effect)
            names = perturbation.sensors(names)
        self.sensor_names = names
        self._acting = self._hooked("on_action")
        self._pushing = self._hooked("on_force")
        self._sensing = self._hooked("on_observation")
        n = self.num_envs
        self._true = np.zeros((n, self.task.observation_size))
        self._seen = np.zeros((n, self.observation_size))
        self.steps = np.zeros(n, dtype=np.int64)
        self._returns = np.zeros(n)
        self._flag(np.zeros(n, dtype=bool), np.zeros(n, dtype=bool))
        self._warned = np.zeros(len(_WARNINGS), dtype=np.int64)
        self._started = False

    def _hooked(self, hook: str) -> list[Effect]:
        """Effects that override a hook."""
        return [e for e in self._effects if getattr(type(e), hook) is not getattr(Effect, hook)]

    # -- what it is -------------------------------------------------------------------

    @property
    def model(self) -> mujoco.MjModel:
        """The model of world 0 at the start of an episode."""
        return self._models[0][0]

    @property
    def observation_size(self) -> int:
        """Number D of entries the policy sees."""
        return len(self.sensor_names)

    @property
    def action_size(self) -> int:
        """Number A of entries of an action."""
        return self.task.action_size

    @property
    def threads(self) -> int:
        """Number of C++ threads."""
        return int(self._batch.nthread)

    @property
    def true_observation(self) -> FloatArray:
        """Copy of the observations before any perturbation, shape ``(n, task D)``."""
        return self._true.copy()

    @property
    def observation(self) -> FloatArray:
        """Copy of what the policy sees now, shape ``(n, D)``."""
        return self._seen.copy()

    @property
    def com(self) -> FloatArray:
        """Copy of the centres of mass, shape ``(n, 3)``, in metres."""
        return self._fields.com.copy()

    @property
    def qpos(self) -> FloatArray:
        """Copy of all positions in the model's order, shape ``(n, nq)``."""
        return self._fields.qpos.copy()

    @property
    def qvel(self) -> FloatArray:
        """Copy of all velocities in the model's order, shape ``(n, nv)``."""
        return self._fields.qvel.copy()

    @property
    def engine_warnings(self) -> dict[str, int]:
        """How often the engine has warned in any world since the last seeding, by kind."""
        return dict(zip(_WARNINGS, self._warned.tolist(), strict=True))

    def ground_id(self, world: int) -> int:
        """Number of the ground a world stands on; worlds on the same ground share it."""
        return int(self._ground_of[world])

    def get_model(self, world: int) -> mujoco.MjModel:
        """Return a copy of the model that a world runs on now."""
        return self._batch.get_model(self._check_worlds([world])[0])

    def get_data(self, world: int, data: mujoco.MjData | None = None) -> mujoco.MjData:
        """Return one world's state with everything derived from it, for instance to render it.

        Parameters
        ----------
        world
            Its id.
        data
            An object to write into, made for the same model; None for a new one.
        """
        (chosen,) = self._check_worlds([world])
        data = self._batch.get_data(chosen, data)
        mujoco.mj_forward(self._model_of(chosen), data)
        return data

    def _model_of(self, world: int) -> mujoco.MjModel:
        return self._models[self._ground_of[world]][self._phase[world]]

    # -- the loop ---------------------------------------------------------------------

    def reset(self, worlds: ArrayLike | None = None) -> FloatArray:
        """Start new episodes.

        Every entry of the initial position and velocity gets Gaussian noise, of standard
        deviation ``RESET_POSITION_NOISE`` and ``RESET_VELOCITY_NOISE``.

        Parameters
        ----------
        worlds
            Ids, or a boolean mask of shape ``(n,)``; None for all worlds.

        Returns
        -------
        FloatArray
            What the policy sees in these worlds, in rising order of id, shape ``(k, D)``.

        Raises
        ------
        ValueError
            If there is no such world.
        """
        ids = self._all if worlds is None else self._check_worlds(worlds)
        if not self._started and len(ids) < self.num_envs:
            raise ValueError("No episode has begun; call reset() for all worlds first.")
        self._reset(ids)
        return self._seen[ids]

    def set_state(
        self, qpos: ArrayLike, qvel: ArrayLike, worlds: ArrayLike | None = None
    ) -> FloatArray:
        """Put worlds into given states, in the middle of whatever episode they are in.

        What follows depends on the given state and the actions alone: controls, outside
        forces and the engine's memory of the last contact forces become 0.  Step counts
        and returns go on.

        Parameters
        ----------
        qpos, qvel
            Positions (m, rad) and velocities (m/s, rad/s) in the model's order, shape
            ``(k, nq)`` and ``(k, nv)``, or one state for all.
        worlds
            Ids or mask of the k worlds; None for all.

        Returns
        -------
        FloatArray
            What the policy sees in these worlds, shape ``(k, D)``.

        Raises
        ------
        ValueError
            If a shape is wrong or a number is not finite.
        """
        ids = self._all if worlds is None else self._check_worlds(worlds)
        if not self._started:
            self._reset(self._all)
        robot = self.task.robot
        values = {}
        for name, given, size in (("qpos", qpos, robot.nq), ("qvel", qvel, robot.nv)):
            array = np.asarray(given, dtype=np.float64)
            if array.shape not in ((size,), (len(ids), size)) or not np.isfinite(array).all():
                raise ValueError(
                    f"{name} has shape {array.shape}, but must hold {size} finite numbers for "
                    f"each of the {len(ids)} worlds."
                )
            values[name] = array
        self._batch.bind("qacc_warmstart")[ids] = 0.0
        self._ctrl[ids] = self._xfrc[ids] = self._fields.previous_action[ids] = 0.0
        self._fields.qpos[ids] = values["qpos"]
        self._fields.qvel[ids] = values["qvel"]
        self._batch.forward(ids, stage=self._stage)
        self._observe(ids)
        return self._seen[ids]

    def step(self, actions: ArrayLike) -> Step:
        """Apply one action in every world and advance it by one control step.

        Parameters
        ----------
        actions
            Shape ``(n, A)``; entries outside [-1, 1] are clipped, then scaled to the
            motors' torque.  The control cost is that of the clipped action.

        Returns
        -------
        Step
            Observation, reward, flags and info; the arrays are the caller's to keep.

        Raises
        ------
        ValueError
            If the shape is wrong, an action is NaN or infinite (unless
            ``bad_actions="end"``), or :meth:`reset` was not called first.
        """
        wanted, calm = self._check_actions(actions)
        action = np.minimum(wanted, 1.0)
        np.maximum(action, -1.0, out=action)
        ids, diverged = self._running, np.zeros(self.num_envs, dtype=bool)
        if not calm:
            diverged |= ~(np.abs(wanted) <= ACTION_LIMIT).all(axis=1)
            diverged[self._terminated | self._truncated] = False
            action[~np.isfinite(wanted)] = 0.0
            ids = ids[~diverged[ids]]
        self._act(action, ids)
        self._advance(ids, diverged)
        self.steps[self._running] += 1
        return self._outcome(action, diverged)

    def _act(self, action: FloatArray, ids: IntArray) -> None:
        """Write controls and outside forces, and change models whose time has come."""
        applied = action
        if self._acting:
            t, rows = self.steps[ids], action[ids]
            for effect in self._acting:
                rows = effect.on_action(t, rows, ids)
            applied = action.copy()
            applied[ids] = np.clip(rows, -1.0, 1.0)
        np.multiply(applied, self._ctrl_half, out=self._ctrl)
        self._ctrl += self._ctrl_centre
        self._fields.previous_action[:] = action
        if self._pushing:
            self._xfrc[:] = 0.0
            for effect in self._pushing:
                effect.on_force(self.steps[ids], self._xfrc, ids)
        if len(self._onsets):
            self._change_models(np.searchsorted(self._onsets, self.steps, side="right"))

    def _change_models(self, phase: IntArray) -> None:
        """Let every world run on the model of its phase."""
        if (phase != self._phase).any():
            self._phase = phase
            self._set_models()

    def _advance(self, ids: IntArray, diverged: BoolArray) -> None:
        """Step the physics; mark which worlds the engine could not carry on."""
        try:
            self._batch.step(
                None if ids is self._all else ids,
                nstep=self.task.robot.frame_skip,
                stage=self._stage,
            )
        except mujoco.batch.SimulationError as error:
            diverged[error.ids] = True
        counts = self._warning_counts
        if counts.any():
            self._warned += counts.sum(axis=0)
            diverged |= counts[:, _BAD_STATE].any(axis=1)
            counts[:] = 0
        # two reductions tell whether all is well; NaN fails the comparison
        moving = self._moving
        if not (moving.max() < STATE_LIMIT and moving.min() > -STATE_LIMIT):
            diverged |= ~(np.abs(moving) < STATE_LIMIT).all(axis=1)

    def _outcome(self, action: FloatArray, diverged: BoolArray) -> Step:
        """Observe, reward and end episodes once the physics has moved."""
        fields, n = self._fields, self.num_envs
        with np.errstate(invalid="ignore", over="ignore"):  # of worlds that diverged
            parts = self.task.reward(fields, action)
            terminated = self.task.terminated(fields)
        if self.max_episode_steps is None:
            truncated = np.zeros(n, dtype=bool)
        else:
            truncated = self.steps >= self.max_episode_steps
        off_map = np.zeros(n, dtype=bool)
        if self._map_edges is not None:
            low, high = self._map_edges
            place = fields.com[:, :2]
            off_map |= ~((place >= low) & (place <= high)).all(axis=1)

        reward = parts.total
        components = dict(zip(parts._fields[1:], parts[1:], strict=True))
        components["divergence"] = np.zeros(n)
        if self._running is self._all and not diverged.any():
            truncated |= off_map
            self._observe(self._all)
        else:
            ended = self._terminated | self._truncated
            still = diverged | ended
            off_map[still] = False
            terminated = np.where(ended, self._terminated, terminated | diverged)
            truncated = np.where(ended, self._truncated, truncated | off_map)
            components["divergence"][diverged] = DIVERGENCE_REWARD
            for name in parts._fields[1:]:
                components[name][still] = 0.0
            reward[still] = components["divergence"][still]
            self._observe(np.flatnonzero(~still))
            self._batch.state[diverged] = self._blank  # where every number is finite
        self._returns += reward
        self._flag(terminated, truncated)

        episode_return, episode_length = self._returns.copy(), self.steps.copy()
        final = None
        if self.autoreset and self._running is not self._all:
            final = Final(self._seen, self._true, self.com)
            self._reset(np.flatnonzero(terminated | truncated))
        seen = self._seen.copy()
        info = Info(
            components=components,
            diverged=diverged,
            off_map=off_map,
            true_observation=self._true.copy() if self._sensing else seen,
            episode_return=episode_return,
            episode_length=episode_length,
            final=final,
        )
        return Step(seen, reward, terminated.copy(), truncated.copy(), info)

    def _flag(self, terminated: BoolArray, truncated: BoolArray) -> None:
        """Keep which episodes have ended, and which worlds still run."""
        self._terminated, self._truncated = terminated, truncated
        ended = terminated | truncated
        self._running = np.flatnonzero(~ended) if ended.any() else self._all

    def _reset(self, ids: IntArray) -> None:
        """Start new episodes in these worlds."""
        self.steps[ids] = 0
        if len(self._onsets):
            phase = self._phase.copy()
            phase[ids] = 0
            self._change_models(phase)
        self._batch.state[ids] = self._blank
        self._moving[ids] += self._noise_scale * self._draw(ids)
        self._fields.previous_action[ids] = 0.0
        self._batch.forward(ids, stage=self._stage)
        self._returns[ids] = 0.0
        terminated, truncated = self._terminated.copy(), self._truncated.copy()
        terminated[ids] = truncated[ids] = False
        self._flag(terminated, truncated)
        for effect in self._effects:
            effect.on_reset(ids)
        self._started |= len(ids) == self.num_envs
        self._observe(ids)

    def _draw(self, ids: IntArray) -> FloatArray:
        """Standard normal numbers for a reset of these worlds, each from its own stream."""
        for i in ids[self._noise_used[ids] == _RESETS_DRAWN]:
            self._generators[i].standard_normal(out=self._noise[i])
            self._noise_used[i] = 0
        drawn = self._noise[ids, self._noise_used[ids]]
        self._noise_used[ids] += 1
        return drawn

    def _observe(self, ids: IntArray) -> None:
        """Refresh what is observed in these worlds, in new arrays."""
        everyone = len(ids) == self.num_envs
        true = self.task.observe(self._fields)
        if not everyone:
            true = true[ids]
        seen, t = true, self.steps[ids]
        for effect in self._sensing:
            seen = effect.on_observation(t, seen, ids)
        if seen.shape != (len(ids), self.observation_size):
            raise ValueError(
                f"The perturbations return observations of shape {seen.shape}, but announce "
                f"{self.observation_size} sensors; make sensors() and on_observation() agree."
            )
        if everyone:
            self._true, self._seen = true, seen
        else:
            self._true, self._seen = self._true.copy(), self._seen.copy()
            self._true[ids] = true
            self._seen[ids] = seen

    # -- checks -----------------------------------------------------------------------

    def _check_actions(self, actions: ArrayLike) -> tuple[FloatArray, bool]:
        """Actions as an array, and whether all are within the author's limit."""
        if not self._started:
            raise ValueError("No episode has begun; call reset() before the first step.")
        wanted = np.asarray(actions, dtype=np.float64)
        if wanted.shape != (self.num_envs, self.action_size):
            raise ValueError(
                f"The actions have shape {wanted.shape}, but {self.num_envs} worlds of "
                f"{self.task.robot.name} need shape ({self.num_envs}, {self.action_size})."
            )
        # NaN fails the comparison
        calm = bool(wanted.max() <= ACTION_LIMIT and wanted.min() >= -ACTION_LIMIT)
        if self._raise_bad_actions and not calm:
            bad = ~np.isfinite(wanted)
            if bad.any():
                i, j = np.argwhere(bad)[0]
                raise ValueError(
                    f"The action of world {i} holds {wanted[i, j]} at entry {j}; give finite "
                    "numbers, or bad_actions='end' to end such an episode as diverged."
                )
        return wanted, calm

    def _check_worlds(self, worlds: ArrayLike) -> IntArray:
        """World ids, sorted, from ids or a mask."""
        given = np.asarray(worlds)
        if given.size == 0:
            return np.zeros(0, dtype=np.int64)
        if given.dtype == bool and given.shape == (self.num_envs,):
            return np.flatnonzero(given)
        ids = np.sort(np.atleast_1d(given))
        if (
            ids.ndim != 1
            or not np.issubdtype(ids.dtype, np.integer)
            or ids[0] < 0
            or ids[-1] >= self.num_envs
            or (np.diff(ids) == 0).any()
        ):
            raise ValueError(
                f"worlds is {worlds!r}, but must be distinct ids from 0 to {self.num_envs - 1} "
                f"or a boolean mask of shape ({self.num_envs},)."
            )
        return ids.astype(np.int64)


def _check_count(name: str, value: int, least: int) -> None:
    if not isinstance(value, int | np.integer) or isinstance(value, bool) or value < least:
        raise ValueError(f"{name} is {value!r}, but must be a whole number of at least {least}.")
