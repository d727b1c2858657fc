"""Perturbations at work in a batch: moments, timing, streams, and what they leave alone."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy import stats

from thesis_lib.locomotion.batch import BatchTask
from thesis_lib.locomotion.perturbations import (
    ActionDelay,
    ActuatorFailure,
    CorrelatedNoise,
    FrictionChange,
    MassChange,
    Push,
    SensorFailure,
    SensorSubset,
    TerrainSwitch,
    WhiteNoise,
    occlusion,
)
from thesis_lib.locomotion.robots import ROBOTS, build_model
from thesis_lib.locomotion.tasks import make_task
from thesis_lib.locomotion.terrain import PATCH, SWITCH_AT, hills


def batch(robot: str, n: int = 1, *perturbations, **options) -> BatchTask:
    """Worlds that never end, so that every step counts."""
    task = make_task(robot, termination="never")
    settings = {"seed": 0, "max_episode_steps": None, **options}
    made = BatchTask(task, n, perturbations=perturbations, **settings)
    made.reset()
    return made


def random_actions(robot: str, steps: int, n: int = 1, seed: int = 5) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (steps, n, ROBOTS[robot].action_size))


def positions(made: BatchTask, actions: np.ndarray) -> np.ndarray:
    """Positions before the first step and after each, shape ``(steps + 1, n, nq)``."""
    path = [made.qpos]
    for action in actions:
        made.step(action)
        path.append(made.qpos)
    return np.array(path)


# --------------------------------------------------------------------------------------- noise


def noise_of(made: BatchTask, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What each step added to the observation, and the rewards."""
    added, rewards = [], []
    for action in actions:
        step = made.step(action)
        added.append(step.observation - step.info.true_observation)
        rewards.append(step.reward)
    return np.array(added), np.array(rewards)


def test_noise_has_the_stated_moments():
    """Chi-square bound on the variance, binomial bounds on sign and tails, at 1e-6 each."""
    sigma, n, steps = 0.7, 20, 150
    added, _ = noise_of(
        batch("Swimmer", n, WhiteNoise(sigma, onset=0)), random_actions("Swimmer", steps, n)
    )
    draws = added.ravel() / sigma
    m = draws.size
    assert m == steps * n * 20
    low, high = stats.chi2(m).ppf([5e-7, 1 - 5e-7])
    assert low < (draws**2).sum() < high
    assert abs(draws.mean()) < stats.norm.ppf(1 - 5e-7) / np.sqrt(m)
    for count, chance in (((draws > 0).sum(), 0.5), ((np.abs(draws) > 2).sum(), 0.0455003)):
        assert stats.binomtest(int(count), m, chance).pvalue > 1e-6


def test_noise_is_white_over_time_sensors_and_worlds():
    """No correlation between neighbours along any axis: each is a mean of independent products."""
    added, _ = noise_of(
        batch("Swimmer", 10, WhiteNoise(1.0, onset=0)), random_actions("Swimmer", 200, 10)
    )
    for axis in range(3):
        moved = np.moveaxis(added, axis, 0)
        products = (moved[1:] * moved[:-1]).ravel()
        # A product of two independent standard normals has mean 0 and variance 1.
        assert abs(products.mean()) < stats.norm.ppf(1 - 5e-7) / np.sqrt(products.size)


def test_noise_begins_at_its_step_and_not_before():
    """Observation t is noisy from t = onset on: after the reset t is 0, after step k it is k."""
    made = batch("Hopper", 3, WhiteNoise(1.0, onset=4))
    added, _ = noise_of(made, random_actions("Hopper", 8, 3))
    assert (added[:3] == 0).all()
    assert (added[3:] != 0).all()
    # At once when the onset is 0, and again after the next reset.
    made = batch("Hopper", 3, WhiteNoise(1.0, onset=0))
    assert (made.reset() != made.true_observation).all()
    made = batch("Hopper", 3, WhiteNoise(1.0, onset=2))
    np.testing.assert_array_equal(made.reset(), made.true_observation)


@pytest.mark.parametrize("robot", ROBOTS)
def test_noise_leaves_motion_and_reward_alone(robot):
    """Under the same actions: same states, same rewards, bit for bit."""
    actions = random_actions(robot, 30, 2)
    plain, noisy = batch(robot, 2), batch(robot, 2, WhiteNoise(1.0, onset=0))
    _, expected = noise_of(plain, actions)
    added, rewards = noise_of(noisy, actions)
    np.testing.assert_array_equal(rewards, expected)
    np.testing.assert_array_equal(noisy.qpos, plain.qpos)
    np.testing.assert_array_equal(noisy.qvel, plain.qvel)
    assert (added != 0).all()


def test_noise_is_each_worlds_own():
    """A world hears the same noise alone and in company, also when another one restarts."""
    actions = random_actions("Swimmer", 100, 3)
    alone, _ = noise_of(batch("Swimmer", 1, WhiteNoise(onset=0), seed=[7]), actions[:, 1:2])
    made = batch("Swimmer", 3, WhiteNoise(onset=0), seed=[3, 7, 9])
    in_company = []
    for i, action in enumerate(actions):
        if i % 30 == 20:
            made.reset([0, 2])
        step = made.step(action)
        in_company.append((step.observation - step.info.true_observation)[1:2])
    np.testing.assert_array_equal(in_company, alone)


def test_noise_of_a_sigma_for_each_sensor():
    sigma = tuple(float(i) for i in range(20))
    added, _ = noise_of(
        batch("Hopper", 1, WhiteNoise(sigma, onset=0)), random_actions("Hopper", 400)
    )
    spread = np.sqrt((added[:, 0] ** 2).mean(axis=0))
    assert spread[0] == 0
    # Root mean square of 400 draws: within a factor chi2(400).ppf(1 - 1e-7) / 400 of sigma.
    np.testing.assert_allclose(spread[1:], sigma[1:], rtol=0.2)


@pytest.mark.parametrize("c", [1.0, 10.0, 100.0])
def test_slow_noise_has_its_variance_from_the_onset_and_its_correlation_time(c):
    """Over 4,000 independent pairs: the variance by chi-square, correlations by their theory."""
    sigma, onset, n = 0.5, 3, 200
    made = batch("Swimmer", n, CorrelatedNoise(sigma, onset, c))
    added, _ = noise_of(made, random_actions("Swimmer", 24, n))
    assert (added[: onset - 1] == 0).all()
    draws = added[onset - 1 :].reshape(-1, n * 20) / sigma  # from step onset on
    m = draws.shape[1]
    low, high = stats.chi2(m).ppf([5e-8, 1 - 5e-8])
    for t in (0, 1, 20):  # stationary at once
        assert low < (draws[t] ** 2).sum() < high
    for lag in (1, 5, 20):
        rho = np.exp(-lag / c)
        # A product of two standard normals of correlation rho has variance 1 + rho^2.
        bound = stats.norm.ppf(1 - 5e-8) * np.sqrt((1 + rho**2) / m)
        assert abs((draws[0] * draws[lag]).mean() - rho) < bound


def test_slow_noise_of_no_correlation_time_is_white_noise():
    actions = random_actions("Hopper", 80, 2)
    slow, _ = noise_of(batch("Hopper", 2, CorrelatedNoise(0.3, 5, 0.0)), actions)
    white, _ = noise_of(batch("Hopper", 2, WhiteNoise(0.3, 5)), actions)
    np.testing.assert_array_equal(slow, white)


def test_slow_noise_of_an_episode_owes_nothing_to_the_one_before():
    """With c infinite but in name the first value stays; after a reset there is another one."""
    made = batch("Swimmer", 1, CorrelatedNoise(1.0, 1, 1e12))
    first, _ = noise_of(made, random_actions("Swimmer", 3))
    made.reset()
    second, _ = noise_of(made, random_actions("Swimmer", 3))
    for added in (first, second):
        np.testing.assert_allclose(added[1:], np.broadcast_to(added[0], (2, 1, 20)), atol=1e-4)
    assert (np.abs(first[0] - second[0]) > 1e-4).all()


# ------------------------------------------------------------------------------------- sensors


@pytest.mark.parametrize(
    ("robot", "names"),
    [
        (
            "Hopper",
            (
                *("z", "pitch", "thigh", "leg", "foot"),
                *(f"constraint {x}" for x in ("z", "x", "pitch", "thigh", "leg", "foot")),
            ),
        ),
        ("Swimmer", ("z", "quaternion y", "quaternion z", "joint 1", "joint 2")),
    ],
)
def test_the_texts_occlusions_hold_no_velocities(robot, names):
    """Table 5.1: a feature subset that does not include angular velocities."""
    subset = occlusion(robot)
    made = batch(robot, 2, subset)
    assert made.sensor_names == names
    all_names = made.task.sensor_names
    seen = made.step(random_actions(robot, 1, 2)[0]).observation
    np.testing.assert_array_equal(
        seen, made.true_observation[:, [all_names.index(name) for name in names]]
    )
    assert seen.shape == (2, len(names))


@pytest.mark.parametrize(
    ("robot", "size"),
    [("Swimmer", 3), ("Hopper", 17), ("HalfCheetah", 8), ("Walker2d", 8), ("Ant", 17)],
)
def test_the_codes_occlusions(robot, size):
    made = batch(robot, 1, occlusion(robot, "code"))
    assert made.observation_size == size
    if robot == "Hopper":
        assert [n for n in made.sensor_names if n.startswith("velocity")]
    if robot == "Ant":  # called normal forces in the code, but component 4 is the force along y
        assert [n for n in made.sensor_names if "contact" in n] == [
            f"contact foot {leg} force y" for leg in (1, 2, 3, 4)
        ]


def test_only_hopper_and_swimmer_are_occluded_in_the_text():
    assert {robot for robot in ROBOTS if occlusion(robot)} == {"Hopper", "Swimmer"}


def test_subset_and_noise_in_either_order():
    """Noise after the subset falls on what is left; before it, on everything."""
    subset = SensorSubset(("foot", 0))
    for order in ([subset, WhiteNoise(onset=0)], [WhiteNoise(onset=0), subset]):
        made = batch("Hopper", 1, *order)
        assert made.sensor_names == ("foot", "z")
        seen = made.step(random_actions("Hopper", 1)[0]).observation
        assert seen.shape == (1, 2)
        assert (seen != made.true_observation[:, [4, 0]]).all()


# ------------------------------------------------------------------------------------- terrain


def test_switch_gives_world_i_its_map_whatever_the_batch():
    """All controllers meet the same terrains (section 5.4)."""
    switch = TerrainSwitch(seed=4)
    few, many = (switch.ground("Walker2d", n, np.random.SeedSequence(n)) for n in (2, 5))
    for a, b in zip(few, many, strict=False):
        np.testing.assert_array_equal(a.heights, b.heights)
    assert len({ground.heights.tobytes() for ground in many}) == 5
    assert (many[0].surface[:, many[0].x <= SWITCH_AT["Walker2d"]] == 0).all()


# The swimmer's nose reaches 1.5 m, the switch is at 2 m; nobody gets there in 60 random steps.
@pytest.mark.parametrize("robot", ROBOTS)
def test_before_the_switch_the_world_is_the_flat_task(robot):
    """Bit for bit: the robot touches the flat task's own floor, and no height field."""
    actions = random_actions(robot, 60, 2)
    flat = positions(batch(robot, 2), actions)
    switched = positions(batch(robot, 2, TerrainSwitch()), actions)
    if robot == "Ant":  # the engine lists its contacts in another order: equal up to rounding
        np.testing.assert_allclose(switched, flat, rtol=0, atol=1e-12)
    else:
        np.testing.assert_array_equal(switched, flat)
    # A height field that is just as flat is another world.
    other = positions(batch(robot, 2, terrain=hills(0.0, 0, robot=robot)), actions)
    assert np.abs(other - flat).max() > 1e-3


def test_behind_the_switch_the_robot_stands_on_the_hills():
    """Ants dropped at places behind the switch come to rest on the ground the map says."""
    switch = TerrainSwitch(difficulty=1.0, switch_at=5.0)
    made = batch("Ant", 6, switch)
    grounds = switch.ground("Ant", 6, np.random.SeedSequence(0))
    places = np.array([[20.0, 3.0], [9.0, -7.0], [30.0, 10.0], [14.0, 0.0], [50.0, 20.0], [8, 0]])
    qpos = np.tile(ROBOTS["Ant"].init_qpos, (6, 1))
    qpos[:, :2] = places
    qpos[:, 2] = [0.8 + g.ground_z(*p) for g, p in zip(grounds, places, strict=True)]
    made.set_state(qpos, np.zeros((6, 14)))
    for _ in range(150):
        made.step(np.zeros((6, 8)))
    for ground, (x, y, z) in zip(grounds, made.qpos[:, :3], strict=True):
        clearance = z - ground.ground_z(x, y)
        assert 0.2 < clearance < 0.8  # the torso is a ball of radius 0.25 on bent legs
    assert np.ptp(made.qpos[:, 2]) > 0.2


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("options", [{}, {"switch_at": "task"}, {"preset": "text"}])
def test_robots_never_start_buried(robot, options):
    """Contacts after a reset on hills are no deeper than on the flat floor."""

    def deepest(terrain) -> float:
        made = batch(robot, 20, terrain=terrain, seed=3)
        contacts = (made.get_data(i).contact.dist for i in range(20))
        return min((float(c.min()) for c in contacts if c.size), default=0.0)

    flat = deepest(None)
    on_hills = deepest([hills(1.0, s, robot=robot, **options) for s in range(20)])
    # The reset's noise pushes feet into any floor; a millimetre is allowed for the triangles.
    assert on_hills > flat - 1e-3


def test_the_start_square_holds_every_robot():
    """No part of a robot in its starting pose is within 0.3 m of the square's edge."""
    for robot in ROBOTS.values():
        model = build_model(robot)
        data = mujoco.MjData(model)
        data.qpos[:] = robot.init_qpos
        mujoco.mj_forward(model, data)
        body_geoms = np.flatnonzero(model.geom_bodyid > 0)
        reach = np.abs(data.geom_xpos[body_geoms, :2]) + model.geom_rbound[body_geoms, None]
        assert reach.max() < PATCH - 0.3


# ----------------------------------------------------------------------------------- actuators


def test_a_dead_motor_acts_like_no_command_from_its_step_on():
    robot = "HalfCheetah"
    actions = random_actions(robot, 20)
    cut = actions.copy()
    cut[8:, :, [1, 4]] = 0
    failed = positions(batch(robot, 1, ActuatorFailure(("bshin", 4), onset=8)), actions)
    np.testing.assert_array_equal(failed, positions(batch(robot), cut))


def test_a_weak_motor_keeps_its_share():
    actions = random_actions("Ant", 10)
    weak = actions.copy()
    weak[:, :, 2] *= 0.25
    failed = positions(batch("Ant", 1, ActuatorFailure((2,), 0.25, onset=0)), actions)
    np.testing.assert_array_equal(failed, positions(batch("Ant"), weak))


def test_the_control_cost_is_that_of_the_action_asked_for():
    """A dead motor moves nothing, but the policy still pays for its wish."""
    made = batch("Swimmer", 1, ActuatorFailure((0, 1), onset=0))
    step = made.step(np.array([[1.0, -0.5]]))
    assert step.info.components["control"] == pytest.approx(-0.005 * 1.25)


def test_delayed_actions_arrive_late():
    """Two steps late from step 5 on: 5 and 6 repeat what was asked at 3 and 4, and so on."""
    actions = random_actions("HalfCheetah", 12)
    late = actions.copy()
    late[5:] = actions[3:-2]
    delayed = positions(batch("HalfCheetah", 1, ActionDelay(2, onset=5)), actions)
    np.testing.assert_array_equal(delayed, positions(batch("HalfCheetah"), late))


def test_a_delay_starts_empty_in_every_episode():
    actions = random_actions("Swimmer", 8)
    late = np.concatenate([np.zeros_like(actions[:3]), actions[:-3]])
    made, plain = batch("Swimmer", 1, ActionDelay(3, onset=0)), batch("Swimmer")
    for _ in range(2):
        np.testing.assert_array_equal(positions(made, actions), positions(plain, late))
        made.reset()
        plain.reset()


# ------------------------------------------------------------------------------ silent sensors


def test_silent_sensors_read_a_constant_from_the_onset_on():
    failing = SensorFailure(("pitch", 3), reading=-0.5, onset=4)
    made, plain = batch("Hopper", 2, failing), batch("Hopper", 2)
    assert made.sensor_names == plain.sensor_names
    for t, action in enumerate(random_actions("Hopper", 8, 2), start=1):
        step, true = made.step(action), plain.step(action)
        expected = true.observation.copy()
        if t >= 4:
            expected[:, [1, 3]] = -0.5
        np.testing.assert_array_equal(step.observation, expected)
        np.testing.assert_array_equal(step.reward, true.reward)


# ---------------------------------------------------------------------------------------- body


@pytest.mark.parametrize("robot", ROBOTS)
def test_mass_change_scales_mass_and_inertia(robot):
    plain = build_model(robot)
    heavy = build_model(robot, edits=[MassChange(1.5).edit_model])
    np.testing.assert_allclose(heavy.body_mass, 1.5 * plain.body_mass)
    np.testing.assert_allclose(heavy.body_inertia, 1.5 * plain.body_inertia)
    torso = build_model(robot, edits=[MassChange(2.0, bodies=("torso",)).edit_model])
    changed = np.flatnonzero(~np.isclose(torso.body_mass, plain.body_mass))
    assert changed.tolist() == [plain.body("torso").id]
    np.testing.assert_allclose(torso.body("torso").mass, 2 * plain.body("torso").mass)


def test_friction_change_scales_sliding_friction_only():
    plain, ice = (
        build_model("Walker2d", edits=edits) for edits in ([], [FrictionChange(0.1).edit_model])
    )
    np.testing.assert_allclose(ice.geom_friction[:, 0], 0.1 * plain.geom_friction[:, 0])
    np.testing.assert_array_equal(ice.geom_friction[:, 1:], plain.geom_friction[:, 1:])


@pytest.mark.parametrize("change", [MassChange(3.0, onset=10), FrictionChange(0.0, onset=10)])
def test_body_changes_begin_at_their_step(change):
    actions = random_actions("HalfCheetah", 60)
    plain = positions(batch("HalfCheetah"), actions)
    changed = positions(batch("HalfCheetah", 1, change), actions)
    np.testing.assert_array_equal(changed[:11], plain[:11])
    assert not np.array_equal(changed[-1], plain[-1])
    # From the first step when the onset is 0: the same as a model edited by hand.
    made = batch("HalfCheetah", 1, type(change)(change.factor, onset=0))
    reference = build_model("HalfCheetah", edits=[change.edit_model])
    data = mujoco.MjData(reference)
    data.qpos[:], data.qvel[:] = made.qpos[0], made.qvel[0]
    for action in actions:
        made.step(action)
        data.ctrl[:] = action[0]
        mujoco.mj_step(reference, data)
    np.testing.assert_array_equal(made.qpos[0], data.qpos)


@pytest.mark.parametrize("robot", ["Ant", "HalfCheetah"])
def test_a_push_changes_momentum_by_force_times_time(robot):
    """In free flight, where only gravity and drag act besides, the centre of mass gains the
    stated velocity."""
    robot_, kick = ROBOTS[robot], (0.6, 0.0, 0.4)
    gains = []
    for perturbations in ([], [Push(kick, steps=5, onset=0)]):
        made = batch(robot, 1, *perturbations)
        qpos = np.array(robot_.init_qpos)
        qpos[robot_.height_index] += 3
        made.set_state(qpos, np.zeros(robot_.nv))
        for _ in range(5):
            made.step(np.zeros((1, robot_.action_size)))
        gains.append(made.get_data(0).sensor("com velocity").data.copy())
    np.testing.assert_allclose(gains[1] - gains[0], kick, atol=0.01)


def test_pushes_come_and_go():
    """Forces during steps 3, 4 and 10, 11 and 17, 18: two steps, every seven from step 3 on."""
    made = batch("Ant", 1, Push((1.0, 0.0, 0.0), steps=2, onset=3, every=7))
    effect = made.perturbations[0].attach(
        type("Attachment", (), {"task": made.task, "model": made.model})()
    )
    pushed = []
    for t in range(20):
        forces = np.zeros((1, made.model.nbody, 6))
        effect.on_force(np.array([t]), forces, np.array([0]))
        if forces.any():
            pushed.append(t)
            # mass x velocity / duration, on the torso.
            torso = made.model.body("torso").id
            assert forces[0, torso, 0] == pytest.approx(made.model.body_mass.sum() / (2 * 0.02))
            assert np.count_nonzero(forces) == 1
    assert pushed == [3, 4, 10, 11, 17, 18]


def test_perturbations_combine():
    """All at once, on hills, in several worlds: nothing breaks and everything is seen."""
    everything = [
        TerrainSwitch(switch_at=2.0),
        MassChange(1.2, onset=5),
        FrictionChange(0.8, onset=5),
        ActuatorFailure((0,), 0.5, onset=7),
        ActionDelay(1, onset=9),
        Push((0.0, 0.5, 0.0), onset=11),
        SensorSubset(("x", "z", "com x")),
        WhiteNoise(0.1, onset=13),
    ]
    made = batch("Ant", 3, *everything)
    for action in random_actions("Ant", 40, 3):
        step = made.step(action)
    assert step.observation.shape == (3, 3)
    assert np.isfinite(step.observation).all()
    assert not any(made.engine_warnings.values())


# -------------------------------------------------------------------------------------- errors


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: WhiteNoise(-1.0), "sigma is -1.0"),
        (lambda: WhiteNoise(np.nan), "sigma is nan"),
        (lambda: CorrelatedNoise(correlation_time=-1.0), "correlation_time is -1.0"),
        (lambda: CorrelatedNoise(-1.0), "sigma is -1.0"),
        (lambda: WhiteNoise(onset=-1), "onset is -1"),
        (lambda: WhiteNoise(onset=1.5), "onset is 1.5"),
        (lambda: SensorSubset(("z", "z")), "only once"),
        (lambda: SensorFailure(("z",), np.inf), "reading is inf"),
        (lambda: batch("Hopper", 1, SensorFailure(("knee",))), "no sensor 'knee'"),
        (lambda: occlusion("Ant", "thesis"), "one of text, literal, code"),
        (lambda: ActuatorFailure((0,), 1.5), "factor is 1.5"),
        (lambda: ActionDelay(0), "steps is 0"),
        (lambda: MassChange(0.0), "factor is 0.0"),
        (lambda: FrictionChange(-0.1), "factor is -0.1"),
        (lambda: Push((1.0, 0.0)), "velocity has 2 entries"),
        (lambda: Push((1.0, 0.0, np.inf)), "velocity is inf, but it must be a finite number"),
        (lambda: Push(1.0), "velocity is 1.0, but it must be several values"),
        (lambda: WhiteNoise(np.ones((2, 2))), "sigma is array"),
        (lambda: WhiteNoise((0.1, -0.1)), "sigma is .0.1, -0.1."),
        (lambda: SensorSubset("zx"), "keep is 'zx', but it must be several values"),
        (lambda: ActionDelay(1.5), "steps is 1.5"),
        (
            lambda: TerrainSwitch(preset="ours"),
            "preset 'ours' does not exist: choose one of author, text",
        ),
        (lambda: Push((1.0, 0.0, 0.0), steps=0), "steps is 0"),
        (lambda: Push((1.0, 0.0, 0.0), steps=5, every=4), "every is 4"),
        (lambda: batch("Hopper", 1, WhiteNoise((1.0, 2.0))), "2 entries for 20 sensors"),
        (lambda: batch("Hopper", 1, SensorSubset(("knee",))), "no sensor 'knee'"),
        (lambda: batch("Hopper", 1, SensorSubset((20,))), "indices run from 0 to 19"),
        (lambda: batch("Hopper", 1, SensorSubset(())), "no sensor is named"),
        (lambda: batch("Hopper", 1, ActuatorFailure(("knee",))), "no actuator 'knee'"),
        (lambda: batch("Hopper", 1, MassChange(2.0, ("wing",))), "no body 'wing'"),
        (lambda: batch("Swimmer", 1, FrictionChange(0.5)), "slides without friction"),
        (lambda: batch("Hopper", 1, TerrainSwitch(switch_at=500.0)), "switch_at is 500 m"),
        (
            lambda: batch("Hopper", 1, TerrainSwitch(), terrain=hills(0.5, 0, robot="Hopper")),
            "terrain",
        ),
    ],
)
def test_bad_input_is_refused_before_any_simulation(make, message):
    with pytest.raises(ValueError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        (WhiteNoise(np.float64(0.5), np.int64(3)), WhiteNoise(0.5, 3)),
        (WhiteNoise(np.array([0.5, 1.0])), WhiteNoise((0.5, 1.0))),
        (CorrelatedNoise(1, correlation_time=np.int64(5)), CorrelatedNoise(1.0, 100, 5.0)),
        (SensorSubset(np.arange(3)), SensorSubset((0, 1, 2))),
        (SensorFailure(["z", np.int64(1)], np.float32(0.5)), SensorFailure(("z", 1), 0.5)),
        (TerrainSwitch(np.float64(0.5), np.float64(2)), TerrainSwitch(0.5, 2.0)),
        (TerrainSwitch(extent=np.ones((2, 2))), TerrainSwitch(extent=((1.0, 1.0), (1.0, 1.0)))),
        (ActuatorFailure(np.array([1])), ActuatorFailure((1,))),
        (ActionDelay(np.int64(2)), ActionDelay(2)),
        (MassChange(np.float64(2), np.array(["torso"])), MassChange(2.0, ("torso",))),
        (FrictionChange(np.float64(0.5)), FrictionChange(0.5)),
        (Push(np.array([0, 1, 0]), every=np.int64(9)), Push((0.0, 1.0, 0.0), every=9)),
    ],
)
def test_numpy_numbers_make_the_same_perturbation(given, meant):
    assert given == meant
    assert hash(given) == hash(meant)
    assert repr(given) == repr(meant)  # which records of tests hold
