"""What can go wrong while a controller runs (sections 5.1 and 5.4, and more).

The thesis tests fixed controllers under two perturbations, white noise on all sensors and
a switch from flat to hilly ground, and trains recurrent networks on a subset of the
sensors of two robots.  Slow noise, actuator failure, action delay, changes of mass and
friction, and pushes are ours.  All are the same kind of object: a frozen description that any
:class:`~thesis_lib.locomotion.batch.BatchTask` or environment takes in a list.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import mujoco
import numpy as np

from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.checks import one_of, plain_settings
from thesis_lib.locomotion.batch import Attachment, Effect, Perturbation
from thesis_lib.locomotion.height_field import Extent
from thesis_lib.locomotion.robots import ROOT_BODY, Ground, total_mass
from thesis_lib.locomotion.terrain import hill_maps

NOISE_ONSET = 100
"""Control step at which the thesis's tests introduce noise (section 5.4)."""

_BLOCK = 64
"""Observations for which a world draws noise at once."""

SUBSETS: Mapping[str, Mapping[str, tuple[int, ...]]] = MappingProxyType(
    {
        "text": MappingProxyType(
            {
                "Swimmer": (2, 5, 6, 7, 8),
                "Hopper": (*range(5), *range(11, 17)),
            }
        ),
        "literal": MappingProxyType(
            {
                "Swimmer": (*range(12), *range(17, 20)),
                "Hopper": (*range(7), *range(11, 20)),
            }
        ),
        "code": MappingProxyType(
            {
                "Swimmer": (6, 7, 8),
                "Hopper": tuple(range(17)),
                "HalfCheetah": tuple(range(8)),
                "Walker2d": tuple(range(2, 10)),
                "Ant": (*range(2, 15), 57, 75, 93, 111),
            }
        ),
    }
)
"""Sensors left to recurrent networks, as indices into the full observation.

``text``: table 5.1's "feature subset that does not include angular velocities", which the
author's code holds under older names; it leaves out all velocities and the centre of mass.
``literal``: all sensors but the angular velocities.  ``code``: the subsets its launcher would
choose today; the hopper's keeps the velocities.

:meta hide-value:
"""


def _settle(perturbation: Perturbation) -> None:
    """Make its settings plain and check its onset."""
    plain_settings(perturbation)
    if perturbation.onset < 0:
        raise ValueError(
            f"onset is {perturbation.onset}, but it must be a whole number of steps, 0 or more."
        )


def _find(wanted: Sequence[str | int], known: Sequence[str], what: str) -> IntArray:
    """Positions of names or indices among the known names; ValueError for the first unknown."""
    if not wanted:
        raise ValueError(f"no {what} is named, but at least one of {', '.join(known)} is needed.")
    found = []
    for item in wanted:
        if isinstance(item, str):
            if item not in known:
                raise ValueError(f"there is no {what} {item!r}; there are {', '.join(known)}.")
            found.append(known.index(item))
        elif 0 <= item < len(known):
            found.append(int(item))
        else:
            raise ValueError(f"there is no {what} {item}; indices run from 0 to {len(known) - 1}.")
    return np.array(found, dtype=np.int64)


# ---------------------------------------------------------------------------------- sensors


@dataclass(frozen=True)
class WhiteNoise(Perturbation):
    """Independent Gaussian noise on what the policy sees (section 5.4).

    Rewards and termination use the true state.  Every world has its own stream of noise.

    Attributes
    ----------
    sigma
        Standard deviation in each sensor's own unit: one number for all, as in the thesis,
        or one for each sensor.
    onset
        First step whose observation is noisy.
    """

    sigma: float | tuple[float, ...] = 1.0
    onset: int = NOISE_ONSET

    def __post_init__(self) -> None:
        _settle(self)
        if np.min(self.sigma, initial=0) < 0:
            raise ValueError(
                f"sigma is {self.sigma}, but it must be one finite number, 0 or more, or one for "
                "each sensor."
            )

    def attach(self, context: Attachment) -> Effect:
        """Start the noise; ValueError when there are more or fewer sigmas than sensors."""
        sigma = np.asarray(self.sigma, np.float64)
        if sigma.ndim and len(sigma) != len(context.sensors):
            raise ValueError(
                f"sigma has {len(sigma)} entries for {len(context.sensors)} sensors; give one "
                "number, or one for each sensor."
            )
        return _NoiseEffect(self.onset, sigma, context, self._decay())

    def _decay(self) -> float:
        """What is left of a deviation one step later."""
        return 0.0


@dataclass(frozen=True)
class CorrelatedNoise(WhiteNoise):
    r"""Noise of the variance of :class:`WhiteNoise` that changes slowly (not in the thesis).

    A first-order autoregression, stationary from its first step: the correlation of two
    observations k steps apart is :math:`e^{-k / c}` with the correlation time c.

    Attributes
    ----------
    correlation_time
        c, control steps; 0 is white noise, number for number.
    """

    correlation_time: float = 10.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.correlation_time < 0:
            raise ValueError(
                f"correlation_time is {self.correlation_time}, but it must be a finite number of "
                "steps, 0 or more."
            )

    def _decay(self) -> float:
        return float(np.exp(-1 / self.correlation_time)) if self.correlation_time else 0.0


class _NoiseEffect(Effect):
    def __init__(self, onset: int, sigma: FloatArray, context: Attachment, decay: float) -> None:
        self._onset, self._sigma, self._decay = onset, sigma, decay
        self._generators = context.generators
        # A world draws for many steps at once, and only when it has used up what it drew.
        self._drawn = np.empty((context.num_envs, _BLOCK, len(context.sensors)))
        self._used = np.full(context.num_envs, _BLOCK)
        self._noise = np.zeros((context.num_envs, len(context.sensors)))

    def on_observation(self, t: IntArray, observations: FloatArray, worlds: IntArray) -> FloatArray:
        noisy = t >= self._onset
        who = worlds[noisy]
        if who.size == 0:
            return observations
        for world in who[self._used[who] == _BLOCK]:
            self._generators[world].standard_normal(out=self._drawn[world])
            self._used[world] = 0
        # Of variance 1 at every step: the first of an episode owes nothing to what was before.
        kept = np.where(t[noisy] == self._onset, 0.0, self._decay)[:, None]
        fresh = self._drawn[who, self._used[who]]
        self._noise[who] = kept * self._noise[who] + np.sqrt(1 - kept**2) * fresh
        self._used[who] += 1
        changed = observations.copy()
        changed[noisy] += self._sigma * self._noise[who]
        return changed


@dataclass(frozen=True)
class SensorSubset(Perturbation):
    """Leave the policy only some of the sensors (table 5.1).

    Attributes
    ----------
    keep
        Sensors to keep, by name or index, in the order in which the policy sees them.
    """

    keep: tuple[str | int, ...]

    def __post_init__(self) -> None:
        _settle(self)
        if len(set(self.keep)) != len(self.keep):
            raise ValueError(f"keep is {self.keep}, but a sensor can be kept only once.")

    def sensors(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """Names of the kept sensors."""
        return tuple(names[i] for i in _find(self.keep, names, "sensor"))

    def attach(self, context: Attachment) -> Effect:
        """Start the occlusion; ValueError for an unknown sensor."""
        return _SensorSubsetEffect(_find(self.keep, context.sensors, "sensor"))


class _SensorSubsetEffect(Effect):
    def __init__(self, columns: IntArray) -> None:
        self._columns = columns

    def on_observation(self, t: IntArray, observations: FloatArray, worlds: IntArray) -> FloatArray:
        return observations[:, self._columns]


@dataclass(frozen=True)
class SensorFailure(Perturbation):
    """Some sensors fall silent (not in the thesis).

    The policy still has an input for them, which reads a constant.

    Attributes
    ----------
    failing
        The sensors, by name or index.
    reading
        What they read, in their own unit.
    onset
        First step whose observation lacks them.
    """

    failing: tuple[str | int, ...]
    reading: float = 0.0
    onset: int = NOISE_ONSET

    def __post_init__(self) -> None:
        _settle(self)

    def attach(self, context: Attachment) -> Effect:
        """Start the failure; ValueError for an unknown sensor."""
        columns = _find(self.failing, context.sensors, "sensor")
        return _SensorFailureEffect(self.onset, columns, self.reading)


class _SensorFailureEffect(Effect):
    def __init__(self, onset: int, columns: IntArray, reading: float) -> None:
        self._onset, self._columns, self._reading = onset, columns, reading

    def on_observation(self, t: IntArray, observations: FloatArray, worlds: IntArray) -> FloatArray:
        changed = observations.copy()
        changed[np.ix_(t >= self._onset, self._columns)] = self._reading
        return changed


def occlusion(
    robot: str, reading: Literal["text", "literal", "code"] = "text"
) -> SensorSubset | None:
    """The sensors the thesis leaves to recurrent networks (table 5.1).

    Parameters
    ----------
    robot
        Name of the robot.
    reading
        A key of :data:`SUBSETS`.

    Returns
    -------
    SensorSubset or None
        None where recurrent networks see everything.

    Raises
    ------
    ValueError
        If the reading is unknown.
    """
    keep = SUBSETS[one_of("reading", reading, SUBSETS)].get(robot)
    return None if keep is None else SensorSubset(keep)


# ---------------------------------------------------------------------------------- terrain


@dataclass(frozen=True)
class TerrainSwitch(Perturbation):
    """Ground that is flat at first and hilly from some place on (sections 5.1 and 5.4).

    World i runs on map i of the seed, so that all controllers meet the same terrains.

    Attributes
    ----------
    difficulty, switch_at, preset, resolution, extent, colour_map
        As in :func:`~thesis_lib.locomotion.terrain.hills`.
    seed
        Decides the maps.
    """

    difficulty: float = 1.0
    switch_at: float | Literal["task"] = "task"
    seed: int = 0
    preset: Literal["author", "text"] = "author"
    resolution: float | None = None
    extent: Extent | None = None
    colour_map: bool = False

    def __post_init__(self) -> None:
        _settle(self)

    def ground(self, robot: str, num_envs: int, seed: np.random.SeedSequence) -> tuple[Ground, ...]:
        """One map for each world; the batch's own seed is not used."""
        options = dataclasses.asdict(self)
        difficulty, maps = options.pop("difficulty"), options.pop("seed")
        return hill_maps(num_envs, difficulty, maps, robot=robot, **options)


# --------------------------------------------------------------------------------- actuators


@dataclass(frozen=True)
class ActuatorFailure(Perturbation):
    """Some motors weaken or die (not in the thesis).

    Attributes
    ----------
    actuators
        The motors, by name or index.
    factor
        What is left of their torque: 0 for a limp joint, 0.5 for half the strength.
    onset
        First step at which they fail.
    """

    actuators: tuple[str | int, ...]
    factor: float = 0.0
    onset: int = NOISE_ONSET

    def __post_init__(self) -> None:
        _settle(self)
        if not 0 <= self.factor <= 1:
            raise ValueError(f"factor is {self.factor}, but a failing motor keeps 0 to 1.")

    def attach(self, context: Attachment) -> Effect:
        """Start the failure; ValueError for an unknown motor."""
        robot = context.task.robot
        factors = np.ones(robot.action_size)
        factors[_find(self.actuators, robot.actuators, "actuator")] = self.factor
        return _ActuatorFailureEffect(self.onset, factors)


class _ActuatorFailureEffect(Effect):
    def __init__(self, onset: int, factors: FloatArray) -> None:
        self._onset, self._factors = onset, factors

    def on_action(self, t: IntArray, actions: FloatArray, worlds: IntArray) -> FloatArray:
        return np.where((t >= self._onset)[:, None], actions * self._factors, actions)


@dataclass(frozen=True)
class ActionDelay(Perturbation):
    """Actions reach the motors some steps late (not in the thesis).

    From ``onset`` on, the motors get at step t what the policy asked for at step
    ``t - steps``, and nothing where that lies before the episode.

    Attributes
    ----------
    steps
        Delay in control steps.
    onset
        First step with the delay.
    """

    steps: int
    onset: int = NOISE_ONSET

    def __post_init__(self) -> None:
        _settle(self)
        if self.steps < 1:
            raise ValueError(f"steps is {self.steps}, but a delay lasts 1 step or more.")

    def attach(self, context: Attachment) -> Effect:
        """Start the delay."""
        return _ActionDelayEffect(self, context)


class _ActionDelayEffect(Effect):
    def __init__(self, delay: ActionDelay, context: Attachment) -> None:
        self._onset = delay.onset
        self._length = delay.steps + 1
        shape = (context.num_envs, self._length, context.task.action_size)
        self._asked = np.zeros(shape)

    def on_reset(self, worlds: IntArray) -> None:
        self._asked[worlds] = 0

    def on_action(self, t: IntArray, actions: FloatArray, worlds: IntArray) -> FloatArray:
        # A ring: slot t mod length holds the newest action, the next slot the oldest.
        self._asked[worlds, t % self._length] = actions
        late = self._asked[worlds, (t + 1) % self._length]
        return np.where((t >= self._onset)[:, None], late, actions)


# ------------------------------------------------------------------------------------- body


@dataclass(frozen=True)
class MassChange(Perturbation):
    """The robot, or part of it, gets heavier or lighter (not in the thesis).

    Density changes, so inertia scales with mass.

    Attributes
    ----------
    factor
        New mass over old, above 0.
    bodies
        Names of the bodies; default all.
    onset
        First step with the new mass.
    """

    factor: float
    bodies: tuple[str, ...] | None = None
    onset: int = NOISE_ONSET
    edits_model = True

    def __post_init__(self) -> None:
        _settle(self)
        if self.factor <= 0:
            raise ValueError(f"factor is {self.factor}, but a mass must stay above 0.")

    def edit_model(self, spec: mujoco.MjSpec) -> None:
        """Scale the chosen bodies; ValueError for an unknown body."""
        robot = [body for body in spec.bodies if body.name != "world"]
        everything = tuple(range(len(robot)))  # by number: the ant's legs have no names
        chosen = everything if self.bodies is None else self.bodies
        for i in _find(chosen, [body.name for body in robot], "body"):
            for geom in robot[i].geoms:
                # A geom's mass is its density's unless it is stated (then it is a number).
                geom.density *= self.factor
                geom.mass *= self.factor


@dataclass(frozen=True)
class FrictionChange(Perturbation):
    """The ground and the robot get more slippery or less (not in the thesis).

    Attributes
    ----------
    factor
        New sliding friction over old, 0 or more.
    onset
        First step with the new friction.
    """

    factor: float
    onset: int = NOISE_ONSET
    edits_model = True

    def __post_init__(self) -> None:
        _settle(self)
        if self.factor < 0:
            raise ValueError(
                f"factor is {self.factor}, but a change of friction needs a number of 0 or more."
            )

    def edit_model(self, spec: mujoco.MjSpec) -> None:
        """Scale the sliding friction of all geoms; ValueError if no contact has any."""
        if all(geom.condim == 1 for geom in spec.geoms):
            raise ValueError(
                "this robot slides without friction, so a change of friction has no effect; "
                "choose another robot or another perturbation."
            )
        for geom in spec.geoms:
            geom.friction[0] *= self.factor


@dataclass(frozen=True)
class Push(Perturbation):
    """A push on the torso (not in the thesis).

    The force is constant for some steps.  It is stated as the change of velocity it would
    give the whole robot if nothing held it, so that one number means the same for an ant of
    1 kg and a swimmer of 107 kg.

    Attributes
    ----------
    velocity
        Change of velocity along world x, y and z, m/s.
    steps
        How many control steps it lasts.
    onset
        First step of the (first) push.
    every
        Steps from one push to the next; None for a single push.
    """

    velocity: tuple[float, float, float]
    steps: int = 5
    onset: int = NOISE_ONSET
    every: int | None = None

    def __post_init__(self) -> None:
        _settle(self)
        if self.steps < 1:
            raise ValueError(f"steps is {self.steps}, but a push lasts 1 step or more.")
        if self.every is not None and self.every < self.steps:
            raise ValueError(
                f"every is {self.every}, but the next push cannot begin before the last one's "
                f"{self.steps} steps are over."
            )

    def attach(self, context: Attachment) -> Effect:
        """Start the pushes."""
        duration = self.steps * context.task.robot.control_dt
        force = np.asarray(self.velocity, np.float64) * total_mass(context.model) / duration
        return _PushEffect(self, force, context.model.body(ROOT_BODY).id)


class _PushEffect(Effect):
    def __init__(self, push: Push, force: FloatArray, body: int) -> None:
        self._push, self._force, self._body = push, force, body

    def on_force(self, t: IntArray, xfrc_applied: FloatArray, worlds: IntArray) -> None:
        since = t - self._push.onset
        phase = since if self._push.every is None else since % self._push.every
        pushed = worlds[(since >= 0) & (phase < self._push.steps)]
        xfrc_applied[pushed, self._body, :3] += self._force
