"""The five robots of chapter 5: Gymnasium's own MuJoCo models, edited into the thesis's.

No model file is kept here.  Each robot names the Gymnasium file it starts from and what
the author's models change in it: timestep, integrator, contact parameters, joints and
gears.  Masses, inertias, link lengths, joint ranges, damping and stiffness are the same
in both and stay untouched.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from importlib.resources import as_file, files
from types import MappingProxyType
from typing import Literal, Protocol

import mujoco
import numpy as np

from thesis_lib.arrays import FloatArray
from thesis_lib.registration import find

SpecEdit = Callable[[mujoco.MjSpec], None]

FLOOR = "floor"
"""Name of the ground geom, plane or height field, in every model."""

HILLS = "hills"
"""Name of the height field when a model has one, and of its geom where the floor stays."""

ROOT_BODY = "torso"
"""Name of the body whose subtree is the whole robot."""

COM_VELOCITY = "com velocity"
"""Name of the sensor that keeps the whole robot's centre-of-mass velocity current."""

_INTEGRATORS = {
    "Euler": mujoco.mjtIntegrator.mjINT_EULER,
    "RK4": mujoco.mjtIntegrator.mjINT_RK4,
}


class Ground(Protocol):
    """What a terrain must offer to become the floor of a model.

    Notes
    -----
    An optional attribute ``floor`` holds the world z of the robot's flat floor, which then
    stays in place, and the ground is the higher of the two.  Without it, or with None, the
    height field replaces the floor.
    """

    @property
    def heights(self) -> FloatArray:
        """Metres above ``z_offset`` at the nodes of a regular grid, shape ``(rows, cols)``.

        Row 0 lies on the edge of least y, column 0 on that of least x; the last ones opposite.
        """

    @property
    def half_size(self) -> tuple[float, float]:
        """Half the length and half the width of the map (x, y), in metres."""

    @property
    def centre(self) -> tuple[float, float]:
        """World x and y of the middle of the map, in metres."""

    @property
    def z_offset(self) -> float:
        """World z of height 0, in metres."""


@dataclass(frozen=True)
class Limits:
    """Bounds outside which an episode ends.

    Attributes
    ----------
    low, high
        Bounds on the height coordinate in metres, absolute, on hills too.
    pitch
        Bound on the absolute pitch in radians.
    closed
        Whether a height exactly on a bound is still inside.
    state
        One bound on the absolute value of joint angles in radians, and of all velocities in
        m/s and rad/s.
    """

    low: float = -np.inf
    high: float = np.inf
    pitch: float = np.inf
    closed: bool = False
    state: float = np.inf


@dataclass(frozen=True)
class Robot:
    """One robot: the Gymnasium model it starts from and how the thesis's differs.

    Attributes
    ----------
    name
        Its name, a key of :data:`ROBOTS`.
    xml
        File name among Gymnasium's MuJoCo models, or the whole path of another; its robot
        is a body called ``torso`` and its ground a geom called ``floor``.
    timestep
        Physics timestep in seconds.
    integrator
        ``"Euler"`` or ``"RK4"``.
    frame_skip
        Physics steps per control step.
    actuators
        Joint each action entry drives, in the order of the action vector.
    torque
        Largest torque of each actuator in N m, in the same order.
    joints
        Names of the actuated joints, in the order of the observation.
    qpos_order
        Index into the model's ``qpos`` of each entry of the author's ``qpos``.
    qvel_order
        Index into the model's ``qvel`` of each entry of the author's ``qvel``.
    init_qpos
        Configuration at the start of an episode before noise, in the model's order.
    height_index, pitch_index
        Where ``qpos`` holds the height in metres and the pitch in radians; None if the
        robot has no such coordinate.
    limits
        What ends an episode, for robots that are not the thesis's; None for nothing.
    """

    name: str
    xml: str
    timestep: float
    integrator: Literal["Euler", "RK4"]
    frame_skip: int
    actuators: tuple[str, ...]
    torque: tuple[float, ...]
    joints: tuple[str, ...]
    qpos_order: tuple[int, ...]
    qvel_order: tuple[int, ...]
    init_qpos: tuple[float, ...]
    height_index: int | None
    pitch_index: int | None
    limits: Limits | None = None

    @property
    def control_dt(self) -> float:
        """Seconds between two actions."""
        return self.timestep * self.frame_skip

    @property
    def action_size(self) -> int:
        """Number of actuators."""
        return len(self.actuators)

    @property
    def nq(self) -> int:
        """Number of position coordinates."""
        return len(self.qpos_order)

    @property
    def nv(self) -> int:
        """Number of velocity coordinates."""
        return len(self.qvel_order)


_PLANAR_ROOT = (1, 0, 2)  # the author's planar robots put z before x, Gymnasium's x before z
_LEG = ("thigh_joint", "leg_joint", "foot_joint")
_LEGS = (*_LEG, "thigh_left_joint", "leg_left_joint", "foot_left_joint")
_CHEETAH = ("bthigh", "bshin", "bfoot", "fthigh", "fshin", "ffoot")


ROBOTS: Mapping[str, Robot] = MappingProxyType(
    {
        robot.name: robot
        for robot in (
            Robot(
                name="Swimmer",
                xml="swimmer.xml",
                timestep=0.005,
                integrator="Euler",
                frame_skip=5,
                actuators=("motor1_rot", "motor2_rot"),
                torque=(150.0, 150.0),
                joints=("motor1_rot", "motor2_rot"),
                qpos_order=tuple(range(9)),
                qvel_order=tuple(range(8)),
                init_qpos=(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0),
                height_index=2,
                pitch_index=None,
            ),
            Robot(
                name="Hopper",
                xml="hopper.xml",
                timestep=0.02,
                integrator="RK4",
                frame_skip=1,
                actuators=_LEG,
                torque=(200.0, 200.0, 200.0),
                joints=_LEG,
                qpos_order=(*_PLANAR_ROOT, 3, 4, 5),
                qvel_order=(*_PLANAR_ROOT, 3, 4, 5),
                init_qpos=(0.0, 1.25, 0.0, 0.0, 0.0, 0.0),
                height_index=1,
                pitch_index=2,
            ),
            Robot(
                name="HalfCheetah",
                xml="half_cheetah.xml",
                timestep=0.01,
                integrator="Euler",
                frame_skip=1,
                actuators=_CHEETAH,
                torque=(120.0, 90.0, 60.0, 120.0, 60.0, 30.0),
                joints=_CHEETAH,
                qpos_order=tuple(range(9)),
                qvel_order=tuple(range(9)),
                init_qpos=(0.0,) * 9,
                height_index=1,
                pitch_index=2,
            ),
            Robot(
                name="Walker2d",
                xml="walker2d.xml",  # walker2d_v5.xml has another foot friction
                timestep=0.005,
                integrator="Euler",
                frame_skip=1,
                actuators=_LEGS,
                torque=(150.0, 100.0, 100.0, 150.0, 100.0, 100.0),
                joints=_LEGS,
                qpos_order=(*_PLANAR_ROOT, *range(3, 9)),
                qvel_order=(*_PLANAR_ROOT, *range(3, 9)),
                init_qpos=(0.0, 1.25, *(0.0,) * 7),
                height_index=1,
                pitch_index=2,
            ),
            Robot(
                name="Ant",
                xml="ant.xml",
                timestep=0.02,
                integrator="RK4",
                frame_skip=1,
                actuators=tuple(
                    f"{joint}_{leg}" for leg in (4, 1, 2, 3) for joint in ("hip", "ankle")
                ),
                torque=(150.0,) * 8,
                joints=tuple(
                    f"{joint}_{leg}" for leg in (1, 2, 3, 4) for joint in ("hip", "ankle")
                ),
                qpos_order=tuple(range(15)),
                qvel_order=tuple(range(14)),
                init_qpos=(0, 0, 0.55, 1, 0, 0, 0, 0, 1, 0, -1, 0, -1, 0, 1),
                height_index=2,
                pitch_index=None,
            ),
        )
    }
)
"""The robots by name, in the order of table 5.2.

:meta hide-value:
"""


def get_robot(name: str) -> Robot:
    """Return the robot of that name.

    Raises
    ------
    ValueError
        If there is no such robot.
    """
    return find("robot", name, ROBOTS)


def _edit_swimmer(spec: mujoco.MjSpec) -> None:
    """Set the planar swimmer free in three dimensions, on a floor without friction."""
    for joint in ("slider1", "slider2", "free_body_rot"):
        spec.delete(spec.joint(joint))
    spec.body(ROOT_BODY).add_freejoint(name="root")
    for joint in spec.joints:
        joint.armature = 0.0
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = geom.condim = 1


def _edit_half_cheetah(spec: mujoco.MjSpec) -> None:
    """Write the total mass of 14 kg as densities: the compiler's own rescaling is deprecated."""
    total = spec.compiler.settotalmass
    spec.compiler.settotalmass = -1
    factor = total / spec.copy().compile().body_mass.sum()
    for geom in spec.geoms:
        geom.density *= factor


def _edit_ant(spec: mujoco.MjSpec) -> None:
    """Give the contacts the author's softness, and the torso an accelerometer.

    The accelerometer changes no motion.  Contact forces on bodies are only computed
    where a sensor asks for them, and this one does.
    """
    for geom in spec.geoms:
        geom.solref = [0.02, 1.0]
        geom.solimp = [0.8, 0.8, 0.01, 0.5, 2.0]
    spec.body(ROOT_BODY).add_site(name="accelerometer")
    spec.add_sensor(
        name="acceleration",
        type=mujoco.mjtSensor.mjSENS_ACCELEROMETER,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname="accelerometer",
    )


_EDITS: Mapping[str, SpecEdit] = MappingProxyType(
    {"Swimmer": _edit_swimmer, "HalfCheetah": _edit_half_cheetah, "Ant": _edit_ant}
)


_SURFACE = (
    *("friction", "condim", "contype", "conaffinity", "solref", "solimp", "solmix"),
    *("margin", "gap", "priority", "material", "rgba"),
)
"""What a height field beside the floor plane takes over from it."""


def _lay_ground(spec: mujoco.MjSpec, ground: Ground) -> None:
    """Turn the floor plane into a height field, or let one rise through it.

    A level height field is not, to the engine, a plane: it makes more contacts.  A ground
    with a ``floor`` therefore keeps the plane, and its surface is the higher of the two.
    """
    heights = np.asarray(ground.heights, dtype=np.float64)
    if heights.ndim != 2 or min(heights.shape) < 2 or not np.isfinite(heights).all():
        raise ValueError(
            f"A terrain needs a grid of at least 2 x 2 finite heights, but this one has shape "
            f"{heights.shape}; build it with terrain.hills."
        )
    low, high = float(heights.min()), float(heights.max())
    # The compiler rescales heights to [0, 1], so size and position carry their range.
    elevation = high - low if high > low else 1.0
    half_x, half_y = ground.half_size
    x, y = ground.centre
    spec.add_hfield(
        name=HILLS,
        size=[half_x, half_y, elevation, 0.1],
        nrow=heights.shape[0],
        ncol=heights.shape[1],
        userdata=heights.ravel(),
    )
    floor = spec.geom(FLOOR)
    plane_z = getattr(ground, "floor", None)
    if plane_z is None:
        field = floor
    elif plane_z != floor.pos[2]:
        raise ValueError(
            f"The terrain's flat part is at z = {plane_z} m, but this robot's floor is at "
            f"{floor.pos[2]} m; draw the terrain for this robot."
        )
    else:
        field = spec.worldbody.add_geom(name=HILLS)
        for name in _SURFACE:
            setattr(field, name, getattr(floor, name))
    field.type = mujoco.mjtGeom.mjGEOM_HFIELD
    field.hfieldname = HILLS
    field.pos = [x, y, ground.z_offset + low]


def build_spec(
    robot: str | Robot, ground: Ground | None = None, edits: Iterable[SpecEdit] = ()
) -> mujoco.MjSpec:
    """Edit Gymnasium's model of a robot into the thesis's (section 5.1).

    Parameters
    ----------
    robot
        A name in :data:`ROBOTS`, or the robot.
    ground
        The terrain that replaces the flat floor; None keeps the floor.
    edits
        Further changes, applied in order once the robot stands on its ground.

    Returns
    -------
    mujoco.MjSpec
        The model's specification; ``compile()`` gives the model.

    Raises
    ------
    ValueError
        If there is no such robot, its actuators are not those of its model, or the ground is no
        grid of finite heights.
    """
    chosen = get_robot(robot) if isinstance(robot, str) else robot
    asset = files("gymnasium").joinpath("envs", "mujoco", "assets", chosen.xml)
    with as_file(asset) as path:
        spec = mujoco.MjSpec.from_file(str(path))
    spec.option.timestep = chosen.timestep
    spec.option.integrator = _INTEGRATORS[chosen.integrator]
    # One robot has no islands of constraints to find; without the search a step takes less time
    # and ends in the same state, bit for bit.
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    if chosen.name in _EDITS:
        _EDITS[chosen.name](spec)
    driven = tuple(actuator.target for actuator in spec.actuators)
    if driven != tuple(chosen.actuators) or len(chosen.torque) != len(driven):
        raise ValueError(
            f"robot {chosen.name!r} has actuators {', '.join(chosen.actuators)} and "
            f"{len(chosen.torque)} torques, but its model drives {', '.join(driven)}: name these, "
            "in this order, with a torque for each."
        )
    for actuator, torque in zip(spec.actuators, chosen.torque, strict=True):
        actuator.gear = [torque, 0.0, 0.0, 0.0, 0.0, 0.0]
    spec.add_sensor(
        name=COM_VELOCITY,
        type=mujoco.mjtSensor.mjSENS_SUBTREELINVEL,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        objname=ROOT_BODY,
    )
    if ground is not None:
        _lay_ground(spec, ground)
    for edit in edits:
        edit(spec)
    return spec


def build_model(
    robot: str | Robot, ground: Ground | None = None, edits: Iterable[SpecEdit] = ()
) -> mujoco.MjModel:
    """Compile a robot's model; arguments and errors as in :func:`build_spec`.

    Returns
    -------
    mujoco.MjModel
        A model that shares nothing with others.
    """
    return build_spec(robot, ground, edits).compile()


def total_mass(model: mujoco.MjModel) -> float:
    """Mass of the whole robot in kg."""
    return math.fsum(model.body_mass)
