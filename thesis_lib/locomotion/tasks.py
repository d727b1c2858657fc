"""The five tasks of section 5.1: what a policy sees, what it earns and when it fails.

Everything here is a pure function of the robot's state after a control step, vectorised
over worlds.  Where the author's code, the thesis's text and the study it adopts (Duan et
al., 2016) disagree, the readings are named and one of them is the default.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Literal, NamedTuple, get_args

import numpy as np

from thesis_lib.arrays import BoolArray, FloatArray
from thesis_lib.checks import one_of
from thesis_lib.locomotion.robots import ROBOTS, Limits, Robot, get_robot
from thesis_lib.registration import HORIZON as HORIZON

Reading = Literal["code", "text", "duan"]
"""Whose word is followed where they differ: the author's code, the thesis's text, or Duan et al."""

Termination = Literal["train", "test", "never"]
"""Which limits end an episode: those of training, those of the author's test mode, or none."""

RESET_POSITION_NOISE = 0.01
"""Standard deviation of the noise on every entry of ``qpos`` at a reset, in m or rad."""

RESET_VELOCITY_NOISE = 0.1
"""Standard deviation of the noise on every entry of ``qvel`` at a reset, in m/s or rad/s."""

TEST_HORIZON = 1000
"""Control steps in a test run (section 5.4)."""


class Sensor(NamedTuple):
    """One entry of an observation: its name, its unit and the kind of thing it measures."""

    name: str
    unit: str
    group: str


@dataclass
class Fields:
    """The state of n worlds that observations and rewards are functions of.

    Positions, velocities and forces all belong to the state *after* the control step, as
    in the author's code.

    Attributes
    ----------
    qpos
        Positions in the model's order, shape ``(n, nq)``; m and rad.
    qvel
        Velocities in the model's order, shape ``(n, nv)``; m/s and rad/s.
    com
        Centre of mass of the whole robot, shape ``(n, 3)``; m, world frame.
    com_velocity
        Its velocity, shape ``(n, 3)``; m/s.
    constraint_force
        Generalised force of contacts and joint limits, shape ``(n, nv)``; N and N m.
    contact_force
        Torque and force that contacts exert on each body, world first, shape
        ``(n, 6 * bodies)``; N m and N.
    rotation
        Rotation matrix of the torso by rows, shape ``(n, 9)``.
    previous_action
        Action that led to this state, 0 after a reset, shape ``(n, A)``.
    """

    qpos: FloatArray
    qvel: FloatArray
    com: FloatArray
    com_velocity: FloatArray
    constraint_force: FloatArray
    contact_force: FloatArray
    rotation: FloatArray
    previous_action: FloatArray


class Reward(NamedTuple):
    """Reward of a step and what it is the sum of; each shape ``(n,)``.

    Attributes
    ----------
    total
        Sum of the others.
    forward
        Forward velocity of the centre of mass, in m/s.
    control
        Minus the cost of the action.
    contact
        Minus the cost of contact forces.
    alive
        Bonus for every step.
    """

    total: FloatArray
    forward: FloatArray
    control: FloatArray
    contact: FloatArray
    alive: FloatArray


class _Block(NamedTuple):
    """Consecutive observation entries that are columns of one field."""

    field: str
    columns: tuple[int, ...]
    sensors: tuple[Sensor, ...]
    clip: float = np.inf


def _named(names: tuple[str, ...], unit: str, group: str) -> tuple[Sensor, ...]:
    return tuple(Sensor(name, unit, group) for name in names)


def _axes(prefix: str, unit: str, group: str, axes: str = "xyz") -> tuple[Sensor, ...]:
    return _named(tuple(f"{prefix}{axis}" for axis in axes), unit, group)


def _joints(robot: Robot, quantity: str, unit: str, group: str) -> tuple[Sensor, ...]:
    if robot.name == "Swimmer":
        short: tuple[str, ...] = ("joint 1", "joint 2")
    else:
        short = tuple(joint.removesuffix("_joint").replace("_", " ") for joint in robot.joints)
    return _named(tuple(f"{quantity}{joint}" for joint in short), unit, group)


def _free_root(robot: Robot) -> tuple[_Block, _Block]:
    """Positions and velocities of a robot that moves freely in space."""
    positions = (
        *_axes("", "m", "position"),
        *_axes("quaternion ", "1", "orientation", "wxyz"),
        *_joints(robot, "", "rad", "joint angle"),
    )
    velocities = (
        *_axes("velocity ", "m/s", "velocity"),
        *_axes("angular velocity ", "rad/s", "angular velocity"),
        *_joints(robot, "velocity ", "rad/s", "joint velocity"),
    )
    return (
        _Block("qpos", robot.qpos_order, positions),
        _Block("qvel", robot.qvel_order, velocities),
    )


def _planar_root(robot: Robot, skip: int, clip: float = np.inf) -> tuple[_Block, _Block]:
    """Positions, without the one at ``skip``, and velocities of a robot in the x-z plane."""
    first_two = "xz" if robot.qpos_order[0] == 0 else "zx"
    positions = (
        *_axes("", "m", "position", first_two),
        Sensor("pitch", "rad", "orientation"),
        *_joints(robot, "", "rad", "joint angle"),
    )
    velocities = (
        *_axes("velocity ", "m/s", "velocity", first_two),
        Sensor("velocity pitch", "rad/s", "angular velocity"),
        *_joints(robot, "velocity ", "rad/s", "joint velocity"),
    )
    keep = [i for i in range(robot.nq) if i != skip]
    return (
        _Block("qpos", tuple(robot.qpos_order[i] for i in keep), tuple(positions[i] for i in keep)),
        _Block("qvel", robot.qvel_order, velocities, clip),
    )


_COM = _Block("com", (0, 1, 2), _axes("com ", "m", "centre of mass"))
_ANT_BODIES = (
    "world",
    "torso",
    *(f"{part} {leg}" for leg in (1, 2, 3, 4) for part in ("hip", "leg", "foot")),
)


def _blocks(robot: Robot, observation: Reading) -> tuple[_Block, ...]:
    """Lay out the observation vector of a robot."""
    if robot.name == "Swimmer":
        blocks: tuple[_Block, ...] = (*_free_root(robot), _COM)
        if observation == "text":
            columns = tuple(range(robot.action_size))
            sensors = _joints(robot, "previous action ", "1", "previous action")
            blocks = (*blocks, _Block("previous_action", columns, sensors))
        return blocks
    if robot.name == "Hopper":
        forces = (
            Sensor("constraint z", "N", "constraint force"),
            Sensor("constraint x", "N", "constraint force"),
            Sensor("constraint pitch", "N m", "constraint force"),
            *_joints(robot, "constraint ", "N m", "constraint force"),
        )
        constraint = _Block("constraint_force", robot.qvel_order, forces, 10.0)
        return (*_planar_root(robot, skip=1, clip=10.0), constraint, _COM)
    if robot.name == "HalfCheetah":
        return (*_planar_root(robot, skip=0), _COM)
    if robot.name == "Walker2d":
        return (*_planar_root(robot, skip=-1), _COM)
    if robot.name != "Ant":
        root = _free_root(robot) if robot.pitch_index is None else _planar_root(robot, skip=-1)
        return (*root, _COM)
    contacts = tuple(
        Sensor(f"contact {body} {what} {axis}", unit, "contact force")
        for body in _ANT_BODIES
        for what, unit in (("torque", "N m"), ("force", "N"))
        for axis in "xyz"
    )
    cells = tuple(f"rotation {row}{column}" for row in "xyz" for column in "xyz")
    return (
        *_free_root(robot),
        _Block("contact_force", tuple(range(len(contacts))), contacts, 1.0),
        _Block("rotation", tuple(range(9)), _named(cells, "1", "orientation")),
        _COM,
    )


_LIMITS: Mapping[str, Mapping[str, Limits | None]] = MappingProxyType(
    {
        "Swimmer": {"train": None, "test": None},
        "Hopper": {
            "train": Limits(low=0.7, pitch=0.2, state=100.0),
            "test": Limits(low=0.1, pitch=0.4, state=100.0),
        },
        "HalfCheetah": {"train": None, "test": None},
        "Walker2d": {"train": Limits(low=0.8, high=2.0, pitch=1.0), "test": Limits(pitch=1.5)},
        "Ant": {"train": Limits(low=0.2, high=1.0, closed=True), "test": None},
    }
)

_CONTROL_COST: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {"HalfCheetah": {"code": 0.05, "text": 0.005, "duan": 0.05}}
)
_ALIVE_BONUS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "Hopper": {"code": 0.1, "text": 0.1, "duan": 1.0},
        "Ant": {"code": 0.05, "text": 0.05, "duan": 0.05},
    }
)


@dataclass(frozen=True)
class Task:
    """A robot with its observation, reward and termination (section 5.1.1).

    Build one with :func:`make_task`.

    Attributes
    ----------
    robot
        The robot.
    reading
        Whose word the observation follows where code and text differ.
    control_cost
        Cost per squared action, summed over actuators.
    contact_cost
        Cost per squared contact force after clipping each entry to [-1, 1].  Nothing is paid
        where the observation reads no forces (:attr:`needs_forces`), as none are computed.
    alive_bonus
        Reward of every step, the one that ends an episode included.
    termination
        Which limits apply.
    limits
        The limits, or None if nothing ends an episode.
    """

    robot: Robot
    reading: Reading
    control_cost: float
    contact_cost: float
    alive_bonus: float
    termination: Termination
    limits: Limits | None

    @cached_property
    def sensors(self) -> tuple[Sensor, ...]:
        """Name, unit and kind of every entry of the observation."""
        return tuple(s for block in self._layout for s in block.sensors)

    @cached_property
    def sensor_names(self) -> tuple[str, ...]:
        """Name of every entry of the observation."""
        return tuple(sensor.name for sensor in self.sensors)

    @property
    def observation_size(self) -> int:
        """Number of entries of the observation."""
        return len(self.sensors)

    @property
    def action_size(self) -> int:
        """Number of entries of the action."""
        return self.robot.action_size

    @cached_property
    def fields_used(self) -> frozenset[str]:
        """Names of the fields the observation reads."""
        return frozenset(block.field for block in self._layout)

    @property
    def needs_forces(self) -> bool:
        """Whether the observation reads constraint or contact forces, which are computed then."""
        return not self.fields_used.isdisjoint({"constraint_force", "contact_force"})

    @cached_property
    def _layout(self) -> tuple[_Block, ...]:
        return _blocks(self.robot, self.reading)

    @cached_property
    def _copies(self) -> tuple[tuple[slice, str, slice], ...]:
        """Which slice of which field goes where: columns cut into rising runs."""
        copies = []
        start = 0
        for block in self._layout:
            runs = np.split(block.columns, np.flatnonzero(np.diff(block.columns) != 1) + 1)
            for run in runs:
                target = slice(start, start + len(run))
                copies.append((target, block.field, slice(int(run[0]), int(run[-1]) + 1)))
                start += len(run)
        return tuple(copies)

    @cached_property
    def _clips(self) -> tuple[tuple[slice, float], ...]:
        """Which entries are clipped, and at what absolute value."""
        ends = np.cumsum([len(block.columns) for block in self._layout])
        return tuple(
            (slice(int(end) - len(block.columns), int(end)), block.clip)
            for end, block in zip(ends, self._layout, strict=True)
            if np.isfinite(block.clip)
        )

    def observe(self, fields: Fields) -> FloatArray:
        """Observation vectors of n worlds, raw and unscaled.

        Returns
        -------
        FloatArray
            Shape ``(n, observation_size)``, units as in :attr:`sensors`.
        """
        observations = np.empty((len(fields.qpos), self.observation_size))
        for target, name, columns in self._copies:
            observations[:, target] = getattr(fields, name)[:, columns]
        for target, bound in self._clips:
            part = observations[:, target]
            np.minimum(part, bound, out=part)
            np.maximum(part, -bound, out=part)
        return observations

    def reward(self, fields: Fields, action: FloatArray) -> Reward:
        """Reward of the step that led to the given state (section 5.1.1).

        Forward velocity of the whole robot's centre of mass, minus the cost of the action
        and of contact forces, plus the bonus for being alive.

        Parameters
        ----------
        fields
            State after the step.
        action
            The action in [-1, 1], shape ``(n, A)``.

        Returns
        -------
        Reward
            Total and components, each shape ``(n,)``.
        """
        forward = fields.com_velocity[:, 0].copy()
        control = np.einsum("ij,ij->i", action, action)
        control *= -self.control_cost
        alive = np.full(len(forward), self.alive_bonus)
        if self.contact_cost:
            force = np.minimum(fields.contact_force, 1.0)
            np.maximum(force, -1.0, out=force)
            contact = np.einsum("ij,ij->i", force, force)
            contact *= -self.contact_cost
        else:
            contact = np.zeros(len(forward))
        return Reward(forward + control + contact + alive, forward, control, contact, alive)

    def terminated(self, fields: Fields) -> BoolArray:
        """Whether each world's state is outside the limits.

        Returns
        -------
        BoolArray
            Shape ``(n,)``.
        """
        limits, robot = self.limits, self.robot
        if limits is None:
            return np.zeros(len(fields.qpos), dtype=bool)
        inside = np.ones(len(fields.qpos), dtype=bool)
        z = fields.qpos[:, robot.height_index]
        if limits.closed:
            inside &= (z >= limits.low) & (z <= limits.high)
        elif limits.low > -np.inf or limits.high < np.inf:
            inside &= (z > limits.low) & (z < limits.high)
        if limits.pitch < np.inf:
            inside &= np.abs(fields.qpos[:, robot.pitch_index]) < limits.pitch
        if limits.state < np.inf:
            # all but the root's height, x and pitch, as in the author's code
            for part in (fields.qpos[:, 3:], fields.qvel):
                # worlds are looked at one by one only if any is near the bound
                if not (part.max() < limits.state and part.min() > -limits.state):
                    inside &= (np.abs(part) < limits.state).all(axis=1)
        return ~inside


def make_task(
    name: str,
    *,
    reading: Reading = "code",
    control_cost: float | None = None,
    alive_bonus: float | None = None,
    termination: Termination = "train",
) -> Task:
    """Build a task of section 5.1.

    Parameters
    ----------
    name
        A robot: Swimmer, Hopper, HalfCheetah, Walker2d or Ant, or one that an installed
        package offers (:mod:`thesis_lib.registration`), which sees its positions,
        velocities and centre of mass.
    reading
        ``"code"``: the author's published code.  ``"text"``: the thesis's text, which
        differs in the half-cheetah's control cost (0.005, not 0.05) and in the swimmer's
        observation (22 entries, not 20; the two more are taken to be the previous
        action).  ``"duan"``: as the code, with the hopper's alive bonus of 1 instead of
        0.1.
    control_cost, alive_bonus
        Numbers that replace those of the reading.
    termination
        ``"train"``: the limits of section 5.1.1.  ``"test"``: those of the author's test
        mode, wider for the hopper and the walker, none for the ant.  ``"never"``: none.

    Returns
    -------
    Task

    Raises
    ------
    ValueError
        For an unknown name, reading or termination, a number that is not finite, or a robot
        with a limit on its height or pitch that has no such coordinate.

    Examples
    --------
    >>> make_task("HalfCheetah").observation_size
    20
    """
    robot = get_robot(name)
    one_of("reading", reading, get_args(Reading))
    one_of("termination", termination, get_args(Termination))
    if control_cost is None:
        control_cost = _CONTROL_COST.get(name, {}).get(reading, 0.005)
    if alive_bonus is None:
        alive_bonus = _ALIVE_BONUS.get(name, {}).get(reading, 0.0)
    for label, value in (("control_cost", control_cost), ("alive_bonus", alive_bonus)):
        if not np.isfinite(value):
            raise ValueError(f"{label} is {value}, but must be a finite number.")
    limits = None
    if termination != "never":
        limits = _LIMITS.get(name, {}).get(termination, robot.limits)
    if limits is not None:
        _check_limits(robot, limits)
    return Task(
        robot=robot,
        reading=reading,
        control_cost=float(control_cost),
        contact_cost=5e-4 if name == "Ant" else 0.0,
        alive_bonus=float(alive_bonus),
        termination=termination,
        limits=limits,
    )


def _check_limits(robot: Robot, limits: Limits) -> None:
    """Raise ValueError for a limit on a coordinate that the robot does not have."""
    height = limits.closed or limits.low > -np.inf or limits.high < np.inf
    for name, index, limited in (
        ("height", robot.height_index, height),
        ("pitch", robot.pitch_index, limits.pitch < np.inf),
    ):
        if limited and index is None:
            raise ValueError(
                f"robot {robot.name!r} has {limits}, but no {name}_index: say where its positions "
                f"hold its {name}, or drop the limit."
            )


TASKS = tuple(ROBOTS)
"""Names of the tasks."""
