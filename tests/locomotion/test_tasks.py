"""Observation, reward and termination against hand calculation."""

import dataclasses

import mujoco
import numpy as np
import pytest

from thesis_lib.locomotion import robots, tasks
from thesis_lib.locomotion.tasks import Fields, make_task

NAMES = list(robots.ROBOTS)
N_BODIES = {"Swimmer": 4, "Hopper": 5, "HalfCheetah": 8, "Walker2d": 8, "Ant": 14}


def fields(name, n=1, **changes):
    """A state of n worlds in which everything is 0 but the start configuration."""
    robot = robots.ROBOTS[name]
    values = {
        "qpos": np.tile(np.array(robot.init_qpos, dtype=float), (n, 1)),
        "qvel": np.zeros((n, robot.nv)),
        "com": np.zeros((n, 3)),
        "com_velocity": np.zeros((n, 3)),
        "constraint_force": np.zeros((n, robot.nv)),
        "contact_force": np.zeros((n, 6 * N_BODIES[name])),
        "rotation": np.tile(np.eye(3).ravel(), (n, 1)),
        "previous_action": np.zeros((n, robot.action_size)),
    }
    values.update({key: np.atleast_2d(value) for key, value in changes.items()})
    return Fields(**values)


def planted(name):
    """Fields whose every entry tells where it comes from: 1xx qpos, 2xx qvel, ..."""
    robot = robots.ROBOTS[name]
    return fields(
        name,
        qpos=100.0 + np.arange(robot.nq),
        qvel=200.0 + np.arange(robot.nv),
        com=[301.0, 302.0, 303.0],
        com_velocity=[401.0, 402.0, 403.0],
        constraint_force=500.0 + np.arange(robot.nv),
        contact_force=0.001 * np.arange(6 * N_BODIES[name]),
        rotation=700.0 + np.arange(9),
        previous_action=800.0 + np.arange(robot.action_size),
    )


COM = [301, 302, 303]
LAYOUT = {
    # free joint: x y z, quaternion, two joints; then eight velocities; then COM
    "Swimmer": [*range(100, 109), *range(200, 208), *COM],
    # Gymnasium keeps x before z, the author z before x
    "HalfCheetah": [*range(101, 109), *range(200, 209), *COM],
    "Walker2d": [101, 100, *range(102, 109), 201, 200, *range(202, 209), *COM],
    "Ant": [
        *range(100, 115),
        *range(200, 214),
        *(0.001 * np.arange(84)),
        *range(700, 709),
        *COM,
    ],
}


@pytest.mark.parametrize("name", list(LAYOUT))
def test_observation_layout(name):
    np.testing.assert_allclose(make_task(name).observe(planted(name))[0], LAYOUT[name])


def test_hopper_layout_and_clipping():
    state = planted("Hopper")
    state.qvel[0] = [1.0, 2.0, -3.0, 40.0, -50.0, 6.0]
    state.constraint_force[0] = [7.0, 80.0, -90.0, 1.5, 2.5, 3.5]
    expected = [
        *[101, 102, 103, 104, 105],  # z, pitch, thigh, leg, foot: x is left out
        *[2, 1, -3, 10, -10, 6],  # vz, vx, ... within 10
        *[10, 7, -10, 1.5, 2.5, 3.5],  # constraint forces in the same order
        *COM,
    ]
    np.testing.assert_array_equal(make_task("Hopper").observe(state)[0], expected)


def test_ant_clips_contact_forces_to_one():
    state = fields("Ant")
    state.contact_force[0, [6, 7, 83]] = [3.0, -0.25, -8.0]
    seen = make_task("Ant").observe(state)[0]
    assert seen[[29 + 6, 29 + 7, 29 + 83]].tolist() == [1.0, -0.25, -1.0]


def test_swimmer_of_the_text_also_sees_its_previous_action():
    seen = make_task("Swimmer", reading="text").observe(planted("Swimmer"))[0]
    np.testing.assert_array_equal(seen, [*LAYOUT["Swimmer"], 800, 801])


@pytest.mark.parametrize(
    ("name", "size", "actions"),
    [
        ("Swimmer", 20, 2),
        ("Hopper", 20, 3),
        ("HalfCheetah", 20, 6),
        ("Walker2d", 21, 6),
        ("Ant", 125, 8),
    ],
)
def test_sizes_are_the_listed_ones(name, size, actions):
    task = make_task(name)
    assert task.observation_size == len(task.sensors) == size
    assert len(set(task.sensor_names)) == size
    assert task.action_size == actions


def test_sensor_names_meet_the_facts():
    hopper = make_task("Hopper").sensor_names
    assert hopper[:7] == ("z", "pitch", "thigh", "leg", "foot", "velocity z", "velocity x")
    assert hopper[11] == "constraint z"
    assert hopper[17:] == ("com x", "com y", "com z")
    ant = make_task("Ant").sensor_names
    assert ant[7:9] == ("hip 1", "ankle 1")
    assert ant[29] == "contact world torque x"
    # the author's "foot normal force" entries are forces along y of the four feet
    assert [ant[i] for i in (57, 75, 93, 111)] == [
        f"contact foot {k} force y" for k in (1, 2, 3, 4)
    ]
    assert make_task("Walker2d").sensor_names[:3] == ("z", "x", "pitch")
    units = {s.name: s.unit for s in make_task("Hopper").sensors}
    assert (units["z"], units["velocity thigh"], units["constraint leg"]) == ("m", "rad/s", "N m")


ACTION = np.array([[1.0, -0.5, 0.0, 0.0, 0.5, 1.0, 0.5, -0.5]])
# squared norms of the first 2, 3, 6 and 8 entries, by hand
SQUARED = {2: 1.25, 3: 1.25, 6: 2.5, 8: 3.0}


@pytest.mark.parametrize(
    ("name", "options", "expected"),
    [
        ("Swimmer", {}, 1.5 - 0.005 * 1.25),
        ("Hopper", {}, 1.5 - 0.005 * 1.25 + 0.1),
        ("Hopper", {"reading": "duan"}, 1.5 - 0.005 * 1.25 + 1.0),
        ("Hopper", {"alive_bonus": 0.25}, 1.5 - 0.005 * 1.25 + 0.25),
        ("HalfCheetah", {}, 1.5 - 0.05 * 2.5),
        ("HalfCheetah", {"reading": "text"}, 1.5 - 0.005 * 2.5),
        ("HalfCheetah", {"reading": "text", "control_cost": 0.1}, 1.5 - 0.1 * 2.5),
        ("Walker2d", {}, 1.5 - 0.005 * 2.5),
        ("Ant", {}, 1.5 - 0.005 * 3.0 + 0.05),
    ],
)
def test_reward_by_hand(name, options, expected):
    task = make_task(name, **options)
    action = ACTION[:, : task.action_size]
    assert (action**2).sum() == SQUARED[task.action_size]
    reward = task.reward(fields(name, com_velocity=[1.5, -9.0, 7.0]), action)
    assert reward.total[0] == pytest.approx(expected, abs=1e-12)
    assert reward.forward[0] == 1.5
    parts = reward.forward + reward.control + reward.contact + reward.alive
    assert reward.total[0] == parts[0]


def test_contact_cost_by_hand():
    state = fields("Ant", com_velocity=[0.0, 0.0, 0.0])
    # after clipping: 1 + 1 + 0.25 = 2.25, times 5e-4
    state.contact_force[0, [12, 40, 83]] = [2.0, -30.0, 0.5]
    reward = make_task("Ant").reward(state, np.zeros((1, 8)))
    assert reward.contact[0] == pytest.approx(-0.001125, abs=1e-15)
    assert reward.total[0] == pytest.approx(0.05 - 0.001125, abs=1e-15)


def test_rewards_of_several_worlds_do_not_mix():
    state = fields("HalfCheetah", n=3, com_velocity=np.array([[1, 0, 0], [2, 0, 0], [3, 0, 0.0]]))
    action = np.zeros((3, 6))
    action[1, 0] = 1.0
    total = make_task("HalfCheetah").reward(state, action).total
    np.testing.assert_allclose(total, [1.0, 1.95, 3.0])


UP, DOWN = 1 + 1e-9, 1 - 1e-9
# (task, termination, which coordinate, value, does the episode end?)
SIDES = [
    ("Hopper", "train", "z", 0.7 * UP, False),
    ("Hopper", "train", "z", 0.7 * DOWN, True),
    ("Hopper", "train", "pitch", 0.2 * DOWN, False),
    ("Hopper", "train", "pitch", 0.2 * UP, True),
    ("Hopper", "train", "pitch", -0.2 * DOWN, False),
    ("Hopper", "train", "pitch", -0.2 * UP, True),
    ("Hopper", "train", "angle", 100 * DOWN, False),
    ("Hopper", "train", "angle", -100 * UP, True),
    ("Hopper", "train", "velocity", -100 * DOWN, False),
    ("Hopper", "train", "velocity", 100 * UP, True),
    ("Hopper", "train", "x", 1e4, False),
    ("Hopper", "train", "z", 99.0, False),
    ("Hopper", "test", "z", 0.1 * UP, False),
    ("Hopper", "test", "z", 0.1 * DOWN, True),
    ("Hopper", "test", "pitch", 0.4 * DOWN, False),
    ("Hopper", "test", "pitch", -0.4 * UP, True),
    ("Hopper", "test", "velocity", 100 * UP, True),
    ("Walker2d", "train", "z", 0.8 * UP, False),
    ("Walker2d", "train", "z", 0.8 * DOWN, True),
    ("Walker2d", "train", "z", 2.0 * DOWN, False),
    ("Walker2d", "train", "z", 2.0 * UP, True),
    ("Walker2d", "train", "pitch", DOWN, False),
    ("Walker2d", "train", "pitch", UP, True),
    ("Walker2d", "train", "pitch", -UP, True),
    ("Walker2d", "train", "velocity", 1e3, False),
    ("Walker2d", "test", "z", 0.01, False),
    ("Walker2d", "test", "pitch", 1.5 * DOWN, False),
    ("Walker2d", "test", "pitch", 1.5 * UP, True),
    ("Ant", "train", "z", 0.2, False),
    ("Ant", "train", "z", 0.2 * DOWN, True),
    ("Ant", "train", "z", 1.0, False),
    ("Ant", "train", "z", UP, True),
    ("Ant", "test", "z", 5.0, False),
    ("Ant", "train", "velocity", 1e3, False),
    ("Swimmer", "train", "z", -50.0, False),
    ("HalfCheetah", "train", "z", -0.6, False),
    ("HalfCheetah", "train", "pitch", 3.1, False),
    ("Hopper", "never", "z", 0.0, False),
    ("Ant", "never", "z", 0.0, False),
]


@pytest.mark.parametrize(("name", "termination", "coordinate", "value", "ends"), SIDES)
def test_each_side_of_each_limit(name, termination, coordinate, value, ends):
    robot = robots.ROBOTS[name]
    state = fields(name, n=2)
    if coordinate == "velocity":
        state.qvel[1, -1] = value
    else:
        where = {"x": 0, "z": robot.height_index, "pitch": robot.pitch_index, "angle": robot.nq - 1}
        state.qpos[1, where[coordinate]] = value
    result = make_task(name, termination=termination).terminated(state)
    assert result.tolist() == [False, ends]


@pytest.mark.parametrize("name", ["Hopper", "Walker2d", "Ant"])
def test_height_that_is_not_a_number_ends_the_episode(name):
    state = fields(name)
    state.qpos[0, robots.ROBOTS[name].height_index] = np.nan
    assert make_task(name).terminated(state).tolist() == [True]


def test_an_upper_limit_alone_ends_an_episode():
    task = dataclasses.replace(make_task("Hopper"), limits=robots.Limits(high=2.0))
    state = fields("Hopper", n=3)
    state.qpos[:, 1] = -5.0, 2.0 * DOWN, 2.0
    assert task.terminated(state).tolist() == [False, False, True]


@pytest.mark.parametrize(
    ("limits", "told"),
    [
        ({"high": 2.0}, r"robot 'Blob' has Limits\(.*high=2.0.*, but no height_index: say where"),
        ({"low": 0.1}, "but no height_index"),
        ({"closed": True}, "but no height_index"),
        ({"pitch": 1.0}, "but no pitch_index: say where its positions hold its pitch, or drop"),
    ],
)
def test_a_limit_needs_its_coordinate(limits, told, monkeypatch):
    none = {"height_index": None, "pitch_index": None}
    blob = dataclasses.replace(robots.ROBOTS["Hopper"], name="Blob", **none)
    monkeypatch.setattr(tasks, "get_robot", lambda name: blob)
    assert not make_task("Blob").terminated(fields("Hopper")).any()
    blob = dataclasses.replace(blob, limits=robots.Limits(state=1.0))
    assert not make_task("Blob").terminated(fields("Hopper")).any()
    blob = dataclasses.replace(blob, limits=robots.Limits(**limits))
    with pytest.raises(ValueError, match=told):
        make_task("Blob")
    assert make_task("Blob", termination="never").limits is None


@pytest.mark.parametrize("name", NAMES)
def test_start_configuration_is_inside_the_limits(name):
    for termination in ("train", "test"):
        assert not make_task(name, termination=termination).terminated(fields(name)).any()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"name": "Humanoid"}, "robot 'Humanoid' does not exist"),
        (
            {"name": "Ant", "reading": "thesis"},
            "reading 'thesis' does not exist: choose one of code, text, duan",
        ),
        (
            {"name": "Ant", "termination": "eval"},
            "termination 'eval' does not exist: choose one of train, test",
        ),
        ({"name": "Ant", "control_cost": np.nan}, "control_cost is nan"),
        ({"name": "Hopper", "alive_bonus": np.inf}, "alive_bonus is inf"),
    ],
)
def test_bad_arguments(arguments, message):
    with pytest.raises(ValueError, match=message):
        make_task(**arguments)


def test_tasks_are_values():
    assert make_task("Ant") == make_task("Ant")
    assert dataclasses.replace(make_task("Ant"), control_cost=1.0) != make_task("Ant")
    assert tasks.TASKS == ("Swimmer", "Hopper", "HalfCheetah", "Walker2d", "Ant")


@pytest.mark.parametrize("name", NAMES)
def test_velocity_sensor_is_the_mass_weighted_mean_over_links(name):
    """The author's body_comvels: momentum over mass, taken link by link."""
    model = robots.build_model(name)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(3)
    data.qpos[:] = robots.ROBOTS[name].init_qpos + rng.normal(scale=0.1, size=model.nq)
    data.qvel[:] = rng.normal(size=model.nv)
    mujoco.mj_forward(model, data)
    momentum = np.zeros(3)
    for body in range(1, model.nbody):
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jacBodyCom(model, data, jacobian, None, body)
        momentum += model.body_mass[body] * (jacobian @ data.qvel)
    sensor = model.sensor(robots.COM_VELOCITY)
    measured = data.sensordata[sensor.adr[0] : sensor.adr[0] + 3]
    np.testing.assert_allclose(measured, momentum / model.body_mass.sum(), atol=1e-8)
