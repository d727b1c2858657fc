"""The edited models against the values listed for the thesis's robots."""

import warnings
from dataclasses import replace
from importlib.resources import files

import mujoco
import numpy as np
import pytest

from thesis_lib.locomotion import robots
from thesis_lib.locomotion.terrain import hill_maps

LEG_MASSES = [4.057891, 2.781357]
MASSES = {
    "Swimmer": [35.604717] * 3,
    "Hopper": [3.665191, *LEG_MASSES, 5.315575],
    "HalfCheetah": [6.250209, 1.543515, 1.587448, 1.095397, 1.438075, 1.200837, 0.884519],
    "Walker2d": [3.665191, *LEG_MASSES, 3.166725, *LEG_MASSES, 3.166725],
    "Ant": [0.327249, *[0.039158, 0.039158, 0.067592] * 4],
}
TOTAL_MASS = {
    "Swimmer": 106.81415,
    "Hopper": 15.820013,
    "HalfCheetah": 14.0,
    "Walker2d": 23.677137,
    "Ant": 0.91088,
}
# (timestep, integrator, frame_skip, control dt)
TIMING = {
    "Swimmer": (0.005, "EULER", 5, 0.025),
    "Hopper": (0.02, "RK4", 1, 0.02),
    "HalfCheetah": (0.01, "EULER", 1, 0.01),
    "Walker2d": (0.005, "EULER", 1, 0.005),
    "Ant": (0.02, "RK4", 1, 0.02),
}
TORQUE = {
    "Swimmer": [150, 150],
    "Hopper": [200, 200, 200],
    "HalfCheetah": [120, 90, 60, 120, 60, 30],
    "Walker2d": [150, 100, 100, 150, 100, 100],
    "Ant": [150] * 8,
}
JOINTS = {
    "Swimmer": ["root", "motor1_rot", "motor2_rot"],
    "Hopper": ["rootx", "rootz", "rooty", "thigh_joint", "leg_joint", "foot_joint"],
    "HalfCheetah": [
        "rootx",
        "rootz",
        "rooty",
        "bthigh",
        "bshin",
        "bfoot",
        "fthigh",
        "fshin",
        "ffoot",
    ],
    "Walker2d": [
        "rootx",
        "rootz",
        "rooty",
        "thigh_joint",
        "leg_joint",
        "foot_joint",
        "thigh_left_joint",
        "leg_left_joint",
        "foot_left_joint",
    ],
    "Ant": ["root", "hip_1", "ankle_1", "hip_2", "ankle_2", "hip_3", "ankle_3", "hip_4", "ankle_4"],
}
ACTUATED = {
    "Swimmer": ["motor1_rot", "motor2_rot"],
    "Hopper": JOINTS["Hopper"][3:],
    "HalfCheetah": JOINTS["HalfCheetah"][3:],
    "Walker2d": JOINTS["Walker2d"][3:],
    "Ant": ["hip_4", "ankle_4", "hip_1", "ankle_1", "hip_2", "ankle_2", "hip_3", "ankle_3"],
}
EVERY = pytest.mark.parametrize("name", list(robots.ROBOTS))


@pytest.fixture(scope="module")
def models():
    return {name: robots.build_model(name) for name in robots.ROBOTS}


def solid_capsule_inertia(mass: float, radius: float, half_length: float) -> tuple[float, float]:
    """Principal moments (axial, transverse) of a solid capsule, by integration by hand."""
    length = 2 * half_length
    cylinder = np.pi * radius**2 * length
    sphere = 4 / 3 * np.pi * radius**3
    density = mass / (cylinder + sphere)
    m_c, m_s = density * cylinder, density * sphere
    axial = m_c * radius**2 / 2 + m_s * 2 / 5 * radius**2
    # hemispheres: own centroid 3r/8 beyond the cylinder's end
    across = m_c * (radius**2 / 4 + length**2 / 12) + m_s * (
        2 / 5 * radius**2 + length**2 / 4 + 3 / 8 * length * radius
    )
    return axial, across


@EVERY
def test_masses_are_the_listed_ones(models, name):
    np.testing.assert_allclose(models[name].body_mass[1:], MASSES[name], atol=1e-6)
    assert robots.total_mass(models[name]) == pytest.approx(TOTAL_MASS[name], abs=1e-5)


@pytest.mark.parametrize(
    ("name", "body", "radius", "half_length"),
    [
        ("Swimmer", "mid", 0.1, 0.5),
        ("Hopper", "leg", 0.04, 0.25),
        ("Hopper", "foot", 0.06, 0.195),
        ("Walker2d", "thigh_left", 0.05, 0.225),
        ("HalfCheetah", "bshin", 0.046, 0.15),
        ("Ant", "aux_3", 0.08, np.sqrt(0.08) / 2),
    ],
)
def test_inertia_is_that_of_a_solid_capsule(models, name, body, radius, half_length):
    part = models[name].body(body)
    axial, across = solid_capsule_inertia(float(part.mass[0]), radius, half_length)
    np.testing.assert_allclose(sorted(part.inertia), sorted([axial, across, across]), rtol=1e-9)


@EVERY
def test_timing_and_integrator(models, name):
    robot, (timestep, integrator, skip, control_dt) = robots.ROBOTS[name], TIMING[name]
    option = models[name].opt
    assert option.timestep == timestep
    assert option.integrator == getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
    assert robot.frame_skip == skip
    assert robot.control_dt == pytest.approx(control_dt)


@EVERY
def test_joint_and_actuator_order(models, name):
    model, robot = models[name], robots.ROBOTS[name]
    assert [model.joint(i).name for i in range(model.njnt)] == JOINTS[name]
    driven = [model.joint(int(i)).name for i in model.actuator_trnid[:, 0]]
    assert driven == ACTUATED[name] == list(robot.actuators)
    assert (model.nq, model.nv, model.nu) == (robot.nq, robot.nv, robot.action_size)


@EVERY
def test_control_range_times_gear_is_the_listed_torque(models, name):
    model = models[name]
    np.testing.assert_array_equal(model.actuator_ctrllimited, 1)
    np.testing.assert_array_equal(
        model.actuator_ctrlrange[:, 1] * model.actuator_gear[:, 0], TORQUE[name]
    )
    np.testing.assert_array_equal(model.actuator_ctrlrange[:, 0], -model.actuator_ctrlrange[:, 1])
    assert list(robots.ROBOTS[name].torque) == TORQUE[name]


def test_planar_walkers_start_at_height_1_25_and_order_z_before_x():
    for name in ("Hopper", "Walker2d"):
        robot = robots.ROBOTS[name]
        start = np.array(robot.init_qpos)[list(robot.qpos_order)]
        assert start[:3].tolist() == [1.25, 0.0, 0.0]


def test_ant_starts_low_with_bent_ankles():
    expected = [0, 0, 0.55, 1, 0, 0, 0, 0, 1, 0, -1, 0, -1, 0, 1]
    assert list(robots.ROBOTS["Ant"].init_qpos) == expected


def test_swimmer_is_free_and_slides_without_friction(models):
    model = models["Swimmer"]
    assert model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
    np.testing.assert_array_equal(model.dof_armature, 0.0)
    np.testing.assert_array_equal(model.geom_contype, 1)
    np.testing.assert_array_equal(model.geom_conaffinity, 1)
    np.testing.assert_array_equal(model.geom_condim, 1)
    assert (model.opt.density, model.opt.viscosity) == (4000, 0.1)
    assert model.geom(robots.FLOOR).pos[2] == -0.1
    data = mujoco.MjData(model)
    for _ in range(400):
        mujoco.mj_step(model, data)
    assert set(data.contact.geom.ravel()) == {0, 1, 2, 3}  # each link rests on the floor
    assert np.abs(data.qvel).max() < 1e-3


def test_contact_softness(models):
    ant = models["Ant"]
    assert (ant.geom_solref == [0.02, 1]).all()
    assert (ant.geom_solimp == [0.8, 0.8, 0.01, 0.5, 2]).all()
    hopper = models["Hopper"]
    robot_geoms = hopper.geom_bodyid > 0
    assert (hopper.geom_solimp[robot_geoms, :3] == [0.8, 0.8, 0.01]).all()


def test_foot_friction_of_the_walker_is_uneven(models):
    model = models["Walker2d"]
    assert model.geom("foot_geom").friction[0] == 0.9
    assert model.geom("foot_left_geom").friction[0] == 1.9


@EVERY
def test_edits_leave_gymnasiums_geometry_and_joints_alone(models, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the engine logs its warning about settotalmass in a file
    path = files("gymnasium").joinpath("envs/mujoco/assets", robots.ROBOTS[name].xml)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        original = mujoco.MjModel.from_xml_path(str(path))
    model = models[name]
    np.testing.assert_array_equal(model.geom_size, original.geom_size)
    np.testing.assert_allclose(model.body_mass, original.body_mass, rtol=1e-14)
    np.testing.assert_allclose(model.body_inertia, original.body_inertia, rtol=1e-14)
    for joint in robots.ROBOTS[name].joints:
        ours, theirs = model.joint(joint), original.joint(joint)
        assert ours.range.tolist() == theirs.range.tolist()
        assert ours.damping == theirs.damping
        assert ours.stiffness == theirs.stiffness


@EVERY
def test_building_warns_of_nothing(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        robots.build_model(name)


class Slope:
    """A plane that rises by 1 m in 10 m along x, from z = 0.3 at its left edge."""

    heights = np.tile(np.linspace(0.1, 2.1, 21), (11, 1))
    half_size = (10.0, 5.0)
    centre = (3.0, -1.0)
    z_offset = 0.2


def surface_z(model, x, y):
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    geom = np.zeros(1, dtype=np.int32)
    start = np.array([x, y, 50.0])
    down = np.array([0.0, 0.0, -1.0])
    distance = mujoco.mj_ray(model, data, start, down, None, 1, -1, geom, None)
    return 50.0 - distance


@EVERY
def test_ground_replaces_the_floor_where_it_says(name):
    model = robots.build_model(name, Slope())
    for x, y in ((-5.0, 3.0), (2.5, -5.0), (12.0, -1.0)):
        # z = z_offset + 0.1 + (x - left edge) / 10
        assert surface_z(model, x, y) == pytest.approx(0.3 + (x + 7.0) / 10, abs=1e-6)


def test_rows_run_along_y():
    class Ramp(Slope):
        heights = np.tile(np.linspace(0.0, 1.0, 11)[:, None], (1, 21))
        z_offset = 0.0

    model = robots.build_model("HalfCheetah", Ramp())
    assert surface_z(model, 5.0, -6.0) == pytest.approx(0.0, abs=1e-6)
    assert surface_z(model, 5.0, 3.5) == pytest.approx(0.95, abs=1e-6)


def test_a_level_ground_is_level():
    class Level(Slope):
        heights = np.full((4, 5), 0.25)
        z_offset = -0.25

    model = robots.build_model("Ant", Level())
    assert surface_z(model, 1.0, 1.0) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("hilly", [False, True])
@pytest.mark.parametrize("name", robots.ROBOTS)
def test_without_islands_every_state_is_the_same_bit_for_bit(name, hilly):
    ground = hill_maps(1, 0.5, np.random.SeedSequence(0), robot=name)[0] if hilly else None
    island = int(mujoco.mjtDisableBit.mjDSBL_ISLAND)

    def enabled(spec):
        spec.option.disableflags &= ~island

    states = []
    for edits in ((), (enabled,)):
        model = robots.build_model(name, ground, edits)
        assert bool(model.opt.disableflags & island) == (not edits)
        data, rng = mujoco.MjData(model), np.random.default_rng(0)
        visited = []
        for _ in range(200):
            data.ctrl[:] = rng.uniform(*model.actuator_ctrlrange.T)
            mujoco.mj_step(model, data)
            visited.append(np.r_[data.qpos, data.qvel])
        states.append(np.array(visited))
    np.testing.assert_array_equal(*states)


def test_floor_properties_survive_the_ground(models):
    for name, flat in models.items():
        hilly = robots.build_model(name, Slope())
        ours, theirs = hilly.geom(robots.FLOOR), flat.geom(robots.FLOOR)
        for field in ("friction", "condim", "contype", "conaffinity", "solimp", "solref", "margin"):
            assert np.array_equal(getattr(ours, field), getattr(theirs, field)), (name, field)


@EVERY
def test_a_ground_with_a_floor_rises_through_it(models, name):
    class Rising(Slope):
        z_offset = -1.1  # heights 0.1 to 2.1, so from z = -1 at x = -7 to z = 1 at x = 13
        floor = -0.1 if name == "Swimmer" else 0.0

    model = robots.build_model(name, Rising())
    for x, expected in ((-6.0, Rising.floor), (2.0, Rising.floor), (10.0, 0.7)):
        assert surface_z(model, x, 0.0) == pytest.approx(expected, abs=1e-6)
    flat = models[name].geom(robots.FLOOR)
    for geom in (robots.FLOOR, robots.HILLS):
        for field in ("friction", "condim", "contype", "conaffinity", "solimp", "solref", "margin"):
            assert np.array_equal(getattr(model.geom(geom), field), getattr(flat, field))


def test_a_floor_at_another_height_is_refused():
    class Wrong(Slope):
        floor = 0.0

    with pytest.raises(ValueError, match=r"robot's floor is at -0\.1 m; draw the terrain"):
        robots.build_spec("Swimmer", Wrong())


def test_edits_come_last_and_in_order():
    seen = []
    robots.build_model(
        "Hopper",
        Slope(),
        [
            lambda spec: seen.append(spec.geom(robots.FLOOR).type),
            lambda spec: seen.append(spec.option.timestep),
        ],
    )
    assert seen == [mujoco.mjtGeom.mjGEOM_HFIELD, 0.02]


@pytest.mark.parametrize("bad", ["Humanoid", "hopper", ""])
def test_unknown_robot(bad):
    with pytest.raises(ValueError, match=r"robot .* does not exist.*Swimmer, Hopper, HalfCheetah"):
        robots.build_spec(bad)


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"actuators": robots.ROBOTS["HalfCheetah"].actuators[::-1]}, "has actuators ffoot, fshin"),
        ({"torque": (120.0, 90.0)}, "and 2 torques, but its model drives bthigh, bshin, bfoot, ft"),
    ],
)
def test_actuators_that_are_not_the_models(changed, told):
    with pytest.raises(ValueError, match=told):
        robots.build_spec(replace(robots.ROBOTS["HalfCheetah"], **changed))


def test_ground_that_is_no_grid():
    class Broken(Slope):
        heights = np.array([[0.0, np.nan], [0.0, 1.0]])

    with pytest.raises(ValueError, match="finite heights"):
        robots.build_spec("Ant", Broken())


@pytest.mark.parametrize("name", ["Hopper", "HalfCheetah", "Walker2d", "Ant"])
def test_free_flight_is_a_parabola_that_loses_energy_only_to_damping(name):
    """In the air nothing but gravity moves the centre of mass, and only joints dissipate."""
    robot, model = robots.ROBOTS[name], robots.build_model(name)
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data = mujoco.MjData(model)
    data.qpos[:] = robot.init_qpos
    data.qpos[robot.height_index] += 20.0
    rng = np.random.default_rng(5)
    data.qvel[:] = rng.normal(scale=0.3, size=model.nv)
    data.ctrl[:] = 0.0
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    start, velocity = data.subtree_com[1].copy(), data.subtree_linvel[1].copy()
    energies = [data.energy.sum()]
    for _ in range(round(0.5 / model.opt.timestep)):
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        energies.append(data.energy.sum())
    mujoco.mj_subtreeVel(model, data)
    t = data.time
    gravity = np.array([0.0, 0.0, -9.81])
    np.testing.assert_allclose(data.subtree_linvel[1], velocity + gravity * t, atol=5e-3)
    # Euler's position error for a constant force is g t dt / 2
    slack = 9.81 * t * model.opt.timestep / 2 + 5e-3
    np.testing.assert_allclose(
        data.subtree_com[1], start + velocity * t + gravity * t**2 / 2, atol=slack
    )
    scale = robots.total_mass(model) * 9.81 * 20.0
    assert (np.diff(energies) < 1e-4 * scale).all()


@pytest.mark.parametrize("name", ["Hopper", "Ant"])
def test_free_flight_without_damping_keeps_its_energy(name):
    robot = robots.ROBOTS[name]

    def frictionless(spec):
        for joint in spec.joints:
            joint.damping = np.zeros(3)
            joint.limited = 0

    model = robots.build_model(name, edits=[frictionless])
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data = mujoco.MjData(model)
    data.qpos[:] = robot.init_qpos
    data.qpos[robot.height_index] += 20.0
    data.qvel[:] = np.random.default_rng(6).normal(scale=0.3, size=model.nv)
    mujoco.mj_forward(model, data)
    before = data.energy.sum()
    for _ in range(25):
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    kinetic = data.energy[1]
    assert abs(data.energy.sum() - before) < 1e-6 * kinetic
