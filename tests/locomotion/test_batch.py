"""The batch of worlds against a plain MuJoCo loop, against itself, and at its edges."""

import mujoco
import numpy as np
import pytest

from thesis_lib.locomotion import robots
from thesis_lib.locomotion.batch import (
    ACTION_LIMIT,
    DIVERGENCE_REWARD,
    PERSISTENT_WORLDS,
    Attachment,
    BatchTask,
    Effect,
    Perturbation,
)
from thesis_lib.locomotion.tasks import Fields, make_task

NAMES = list(robots.ROBOTS)
EVERY = pytest.mark.parametrize("name", NAMES)


class Bumps:
    """Gentle waves along both axes, level with the floor at the origin."""

    def __init__(self, phase=0.0, half=20.0, height=0.15, floor=0.0):
        x = np.linspace(-half, half, 81)
        wave = 1 - np.cos(x + phase)
        self.heights = height * (wave[:, None] + wave[None, :]) / 4
        self.half_size = (half, half)
        self.centre = (0.0, 0.0)
        self.z_offset = floor


def random_actions(task, steps, seed=0, scale=1.0):
    rng = np.random.default_rng(seed)
    return rng.uniform(-scale, scale, (steps, task.num_envs, task.action_size))


def current_fields(model, data, action):
    """What the author's code reads after a step: everything at the new state."""
    copy = mujoco.MjData(model)
    mujoco.mj_copyData(copy, model, data)
    mujoco.mj_forward(model, copy)
    mujoco.mj_rnePostConstraint(model, copy)
    mujoco.mj_subtreeVel(model, copy)
    return Fields(
        qpos=copy.qpos[None],
        qvel=copy.qvel[None],
        com=copy.subtree_com[1][None],
        com_velocity=copy.subtree_linvel[1][None],
        constraint_force=copy.qfrc_constraint[None],
        contact_force=copy.cfrc_ext.reshape(1, -1),
        rotation=copy.xmat[1][None],
        previous_action=action[None],
    )


@pytest.mark.parametrize("hills", [False, True], ids=["flat", "hills"])
@EVERY
def test_bit_identical_to_a_plain_mj_step_loop(name, hills):
    """Trajectory, observation and reward of every world, over several hundred steps."""
    grounds = [Bumps(0.0), Bumps(0.5), Bumps(1.0)] if hills else None
    n, steps = 3, 120 if hills else 250
    task = make_task(name, termination="never")
    batch = BatchTask(task, n, seed=11, terrain=grounds, max_episode_steps=None)
    batch.reset()
    models = [robots.build_model(name, grounds[i] if hills else None) for i in range(n)]
    worlds = [mujoco.MjData(model) for model in models]
    for i, data in enumerate(worlds):
        data.qpos[:], data.qvel[:] = batch.qpos[i], batch.qvel[i]
    for action in random_actions(batch, steps, seed=1, scale=1.3):
        step = batch.step(action)
        clipped = np.clip(action, -1, 1)
        for i, (model, data) in enumerate(zip(models, worlds, strict=True)):
            data.ctrl[:] = clipped[i]
            for _ in range(task.robot.frame_skip):
                mujoco.mj_step(model, data)
            fields = current_fields(model, data, clipped[i])
            assert np.array_equal(batch.qpos[i], data.qpos)
            assert np.array_equal(batch.qvel[i], data.qvel)
            assert np.array_equal(step.observation[i], task.observe(fields)[0])
            assert step.reward[i] == task.reward(fields, clipped[i][None]).total[0]
    assert sum(batch.engine_warnings.values()) == 0


def play(batch, actions):
    batch.reset()
    return [batch.step(action) for action in actions]


def assert_same(ours, theirs, mine=slice(None), yours=slice(None)):
    for a, b in zip(ours, theirs, strict=True):
        for field in ("observation", "reward", "terminated", "truncated"):
            assert np.array_equal(getattr(a, field)[mine], getattr(b, field)[yours]), field
        assert np.array_equal(a.info.episode_return[mine], b.info.episode_return[yours])


@pytest.mark.parametrize("hills", [False, True], ids=["flat", "hills"])
@EVERY
def test_any_number_of_threads_gives_the_same(name, hills):
    grounds = [Bumps(0.3 * i) for i in range(7)] if hills else None
    runs = []
    for threads in (1, 2, 5):
        batch = BatchTask(name, 7, threads=threads, seed=3, terrain=grounds, autoreset=True)
        assert batch.threads == threads
        runs.append(play(batch, random_actions(batch, 60)))
    assert_same(runs[0], runs[1])
    assert_same(runs[0], runs[2])


@pytest.mark.parametrize("name", ["Swimmer", "HalfCheetah", "Walker2d"])
def test_any_number_of_worlds_gives_the_same(name):
    """Large batches keep no working memory for each world; small ones do."""
    large = BatchTask(name, PERSISTENT_WORLDS + 1, seed=4)
    small = BatchTask(name, 2, seed=4)
    actions = random_actions(large, 30)
    assert_same(play(large, actions), play(small, actions[:, :2]), mine=slice(2))


@pytest.mark.parametrize("name", ["Hopper", "Walker2d"])
def test_a_world_does_not_depend_on_the_others(name):
    """Episodes end at different times; worlds 0 to 2 of five are the three of a batch of three."""
    large = BatchTask(name, 5, seed=9, autoreset=True)
    actions = random_actions(large, 80)
    small = BatchTask(name, 3, seed=9, autoreset=True)
    assert_same(play(large, actions), play(small, actions[:, :3]), mine=slice(3))


def test_a_seed_for_each_world_makes_it_the_world_of_a_batch_of_one():
    many = BatchTask("Hopper", 3, seed=[4, 5, 4], autoreset=True)
    actions = random_actions(many, 50)
    actions[:, 2] = actions[:, 0]
    steps = play(many, actions)
    one = play(BatchTask("Hopper", 1, seed=5, autoreset=True), actions[:, 1:2])
    assert_same(steps, one, mine=slice(1, 2))
    assert_same(steps, steps, mine=slice(0, 1), yours=slice(2, 3))


def test_seeds():
    first = BatchTask("Ant", 4, seed=1).reset()
    assert np.array_equal(first, BatchTask("Ant", 4, seed=1).reset())
    assert not np.array_equal(first, BatchTask("Ant", 4, seed=2).reset())
    assert len(np.unique(first[:, 0])) == 4
    batch = BatchTask("Ant", 4, seed=2)
    batch.reseed(1)
    assert np.array_equal(first, batch.reset())
    assert not np.array_equal(first, batch.reset())
    sequence = np.random.SeedSequence(1)
    a = BatchTask("Ant", 2, seed=sequence).reset()
    assert np.array_equal(a, BatchTask("Ant", 2, seed=sequence).reset())


@EVERY
def test_reset_noise_has_the_authors_moments(name):
    """qpos ~ init + N(0, 0.01^2), qvel ~ N(0, 0.1^2) on every entry; 4-sigma bands."""
    n = 3000
    batch = BatchTask(name, n, seed=0)
    batch.reset()
    position = batch.qpos - np.array(batch.task.robot.init_qpos)
    for noise, sigma in ((position, 0.01), (batch.qvel, 0.1)):
        assert np.abs(noise.mean(axis=0)).max() < 4 * sigma / np.sqrt(n)
        assert np.abs(noise.std(axis=0) / sigma - 1).max() < 4 / np.sqrt(2 * n)
        correlation = np.corrcoef(noise.T) - np.eye(noise.shape[1])
        assert np.abs(correlation).max() < 5 / np.sqrt(n)


def test_reset_of_a_subset_leaves_the_others_alone():
    batch = BatchTask("HalfCheetah", 4, seed=0)
    batch.reset()
    for action in random_actions(batch, 5):
        batch.step(action)
    before = batch.qpos
    seen = batch.reset([1, 3])
    assert seen.shape == (2, 20)
    assert np.array_equal(batch.qpos[[0, 2]], before[[0, 2]])
    assert batch.steps.tolist() == [5, 0, 5, 0]
    assert batch.reset(np.array([False, True, False, False])).shape == (1, 20)
    assert batch.reset(np.zeros(4, dtype=bool)).shape == (0, 20)
    assert batch.steps.tolist() == [5, 0, 5, 0]


def test_ended_worlds_stand_still_until_reset():
    batch = BatchTask("Hopper", 6, seed=0)
    batch.reset()
    ended_at = np.zeros(6, dtype=int)
    last = None
    for action in random_actions(batch, 80):
        qpos = batch.qpos
        step = batch.step(action)
        if last is not None and last.terminated.any():
            still = last.terminated
            assert np.array_equal(batch.qpos[still], qpos[still])
            assert (step.reward[still] == 0).all()
            assert step.terminated[still].all()
            assert np.array_equal(step.observation[still], last.observation[still])
            assert np.array_equal(step.info.episode_return[still], last.info.episode_return[still])
        ended_at[step.terminated & (ended_at == 0)] = 1
        last = step
    assert ended_at.all()
    assert len(set(batch.steps.tolist())) > 1  # they fell at different times
    batch.reset([2])
    assert not batch.step(action).terminated[2]


def test_autoreset_hands_over_the_last_observation():
    manual = BatchTask("Hopper", 1, seed=8)
    auto = BatchTask("Hopper", 1, seed=8, autoreset=True)
    assert np.array_equal(manual.reset(), auto.reset())
    episodes = 0
    for action in random_actions(auto, 60):
        a, b = manual.step(action), auto.step(action)
        assert a.reward == b.reward
        assert a.terminated == b.terminated
        assert a.info.episode_return == b.info.episode_return
        assert a.info.episode_length == b.info.episode_length
        if a.terminated[0]:
            episodes += 1
            assert np.array_equal(b.info.final.observation, a.observation)
            assert np.array_equal(b.observation, manual.reset())
        else:
            assert b.info.final is None
            assert np.array_equal(b.observation, a.observation)
    assert episodes > 2


def test_truncation_return_and_length():
    batch = BatchTask("HalfCheetah", 2, max_episode_steps=7, autoreset=True)
    batch.reset()
    total = np.zeros(2)
    for t, action in enumerate(random_actions(batch, 20), start=1):
        step = batch.step(action)
        total += step.reward
        assert (step.truncated == (t % 7 == 0)).all()
        np.testing.assert_allclose(step.info.episode_return, total)
        assert (step.info.episode_length == (t - 1) % 7 + 1).all()
        if t % 7 == 0:
            total[:] = 0
    parts = step.info.components
    np.testing.assert_allclose(sum(parts.values()), step.reward)


def test_returned_arrays_belong_to_the_caller():
    batch, twin = BatchTask("Ant", 2, seed=0), BatchTask("Ant", 2, seed=0)
    batch.reset()[:] = np.nan
    twin.reset()
    first = None
    for action in random_actions(twin, 5):
        a, b = batch.step(action), twin.step(action)
        assert np.array_equal(a.observation, b.observation)
        assert np.array_equal(a.reward, b.reward)
        first = first or (b.observation, b.observation.copy())
        a.observation[:] = a.reward[:] = np.nan
        a.terminated[:] = a.info.true_observation[:] = True
    assert np.array_equal(*first)


@EVERY
def test_set_state_forgets_what_was_before(name):
    batch = BatchTask(make_task(name, termination="never"), 2, seed=0)
    batch.reset()
    actions = random_actions(batch, 30)
    start = batch.qpos[0], batch.qvel[0]
    first = batch.set_state(*start)
    paths = []
    for _ in range(2):
        assert np.array_equal(batch.set_state(*start), first)
        paths.append([batch.step(np.stack([a[0], a[0]])).observation for a in actions])
    assert np.array_equal(*paths)
    assert np.array_equal(paths[0][-1][0], paths[0][-1][1])


def test_set_state_of_one_world_only():
    batch = BatchTask("Hopper", 3)
    batch.reset()
    others = batch.qpos[[0, 2]]
    qpos = [5.0, 1.1, 0.05, -0.1, -0.2, 0.1]
    seen = batch.set_state(qpos, np.zeros(6), [1])
    np.testing.assert_array_equal(batch.qpos[1], qpos)
    np.testing.assert_allclose(seen[0, :5], [1.1, 0.05, -0.1, -0.2, 0.1])
    assert np.array_equal(batch.qpos[[0, 2]], others)


# -- a world that diverges -------------------------------------------------------------


@pytest.mark.parametrize("name", ["Hopper", "HalfCheetah"])
@pytest.mark.parametrize("autoreset", [False, True])
def test_an_unstable_world_ends_alone(name, autoreset, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the engine keeps a log file
    options = {"seed": 2, "autoreset": autoreset}
    task = make_task(name, termination="never")
    batch, calm = BatchTask(task, 3, **options), BatchTask(task, 3, **options)
    before = batch.reset()
    calm.reset()
    qvel = batch.qvel[1]
    qvel[-1] = 9e9  # legal for the engine, but no acceleration can follow
    before = batch.set_state(batch.qpos[1], qvel, [1])
    for k, action in enumerate(random_actions(batch, 10)):
        step, other = batch.step(action), calm.step(action)
        assert np.array_equal(step.observation[[0, 2]], other.observation[[0, 2]])
        assert np.array_equal(step.reward[[0, 2]], other.reward[[0, 2]])
        assert np.isfinite(step.observation).all()
        assert np.isfinite(batch.qpos).all()
        if k == 0:
            assert step.info.diverged.tolist() == [False, True, False]
            assert step.terminated.tolist() == [False, True, False]
            assert step.reward[1] == DIVERGENCE_REWARD == -1000
            assert step.info.components["divergence"].tolist() == [0, -1000, 0]
            assert sum(c[1] for c in step.info.components.values()) == -1000
            last = step.info.final.observation if autoreset else step.observation
            assert np.array_equal(last[1], before[0])
        else:
            assert not step.info.diverged.any()
            assert (step.terminated[1], step.reward[1] == 0) == (not autoreset, not autoreset)
    assert sum(batch.engine_warnings.values()) <= 1
    assert sum(calm.engine_warnings.values()) == 0


def test_an_error_of_the_engine_ends_its_world_alone():
    """A model whose memory holds no contacts makes MuJoCo raise once the robot lands."""

    class NoMemory(Perturbation):
        edits_model = True

        def edit_model(self, spec):
            spec.memory = 3000  # enough in the air, too little for the first contacts

    task = make_task("HalfCheetah")
    batch = BatchTask(task, 2, perturbations=[NoMemory()], seed=0)
    batch.reset()
    high = np.zeros(9)
    high[1] = 3.0
    before = batch.set_state(high, np.zeros(9), [1])
    for _ in range(40):  # the other world falls from 3 m: 78 steps of .01 s to the ground
        step = batch.step(np.zeros((2, 6)))
        if step.info.diverged.any():
            break
        before = step.observation
    assert step.info.diverged.tolist() == [True, False]
    assert step.reward[0] == -1000
    assert np.array_equal(step.observation[0], before[0])
    assert not batch.step(np.zeros((2, 6))).info.diverged.any()


@pytest.mark.parametrize("value", [1.001e3, -1e9])
def test_an_action_beyond_the_authors_limit_ends_the_episode(value):
    batch, calm = BatchTask("Ant", 3, seed=0), BatchTask("Ant", 3, seed=0)
    first = batch.reset()
    calm.reset()
    action = random_actions(batch, 1)[0]
    wild = action.copy()
    wild[2, 5] = value
    step, other = batch.step(wild), calm.step(action)
    assert step.info.diverged.tolist() == [False, False, True]
    assert step.reward[2] == -1000
    assert step.terminated[2]
    assert np.array_equal(step.observation[2], first[2])
    assert np.array_equal(step.observation[:2], other.observation[:2])


def test_an_action_at_the_limit_is_only_clipped():
    a, b = BatchTask("Ant", 1, seed=0), BatchTask("Ant", 1, seed=0)
    a.reset(), b.reset()
    ours = a.step(np.full((1, 8), ACTION_LIMIT))
    theirs = b.step(np.ones((1, 8)))
    assert np.array_equal(ours.observation, theirs.observation)
    assert ours.reward == theirs.reward  # the clipped action is what costs
    assert ours.info.components["control"][0] == pytest.approx(-0.005 * 8)


def test_bad_actions_may_end_the_episode_instead_of_raising():
    batch = BatchTask("Hopper", 4, bad_actions="end")
    batch.reset()
    action = np.zeros((4, 3))
    action[0, 1], action[3, 0] = np.nan, -np.inf
    step = batch.step(action)
    assert step.info.diverged.tolist() == [True, False, False, True]
    assert step.reward[[0, 3]].tolist() == [-1000, -1000]
    assert np.isfinite(step.observation).all()
    assert not batch.step(np.zeros((4, 3))).info.diverged.any()


# -- terrain and perturbations ---------------------------------------------------------


def test_each_world_stands_on_its_own_ground():
    high, low = Bumps(height=0.0), Bumps(height=0.0, floor=-0.3)
    task = make_task("Ant", termination="never")
    batch = BatchTask(task, 3, terrain=[low, high, low], seed=1)
    batch.reset()
    for _ in range(150):
        batch.step(np.zeros((3, 8)))
    z = batch.qpos[:, 2]
    assert z[1] - z[0] == pytest.approx(0.3, abs=0.05)
    assert z[2] == pytest.approx(z[0], abs=0.02)
    assert len({id(model) for model in batch._batch.models}) == 2  # equal grounds share a model


def test_leaving_the_map_truncates_with_a_flag():
    batch = BatchTask("HalfCheetah", 2, terrain=Bumps(half=5.0, height=0.0))
    batch.reset()
    qpos = np.zeros(9)
    qpos[0] = 5.5
    batch.set_state(qpos, np.zeros(9), [1])
    step = batch.step(np.zeros((2, 6)))
    assert step.info.off_map.tolist() == step.truncated.tolist() == [False, True]
    assert not step.terminated.any()


class Recorder(Effect):
    def __init__(self, calls):
        self.calls = calls

    def on_reset(self, worlds):
        self.calls.append(("reset", worlds.tolist()))

    def on_action(self, t, actions, worlds):
        self.calls.append(("action", t.tolist(), worlds.tolist()))
        return -actions

    def on_force(self, t, xfrc_applied, worlds):
        assert not xfrc_applied.any()
        self.calls.append(("force", t.tolist(), worlds.tolist()))
        xfrc_applied[worlds, 1, 2] += 1.0

    def on_observation(self, t, observations, worlds):
        self.calls.append(("observation", t.tolist(), worlds.tolist()))
        return observations[:, :3] + 100.0


class Recording(Perturbation):
    def __init__(self):
        self.calls = []

    def sensors(self, names):
        return names[:3]

    def attach(self, context: Attachment):
        self.context = context
        return Recorder(self.calls)


def test_hooks_are_called_with_the_right_worlds_and_times():
    recording = Recording()
    batch = BatchTask("HalfCheetah", 2, perturbations=[recording], max_episode_steps=2)
    assert recording.context.sensors == batch.task.sensor_names
    assert len(recording.context.generators) == 2
    assert batch.observation_size == 3
    assert batch.sensor_names == ("z", "pitch", "bthigh")
    first = batch.reset()
    np.testing.assert_array_equal(first, batch.true_observation[:, :3] + 100)
    batch.step(np.zeros((2, 6)))
    batch.reset([0])
    step = batch.step(np.zeros((2, 6)))  # world 1 ends
    batch.step(np.zeros((2, 6)))
    assert recording.calls == [
        ("reset", [0, 1]),
        ("observation", [0, 0], [0, 1]),
        ("action", [0, 0], [0, 1]),
        ("force", [0, 0], [0, 1]),
        ("observation", [1, 1], [0, 1]),
        ("reset", [0]),
        ("observation", [0], [0]),
        ("action", [0, 1], [0, 1]),
        ("force", [0, 1], [0, 1]),
        ("observation", [1, 2], [0, 1]),
        ("action", [1], [0]),
        ("force", [1], [0]),
        ("observation", [2], [0]),
    ]
    np.testing.assert_array_equal(step.observation, step.info.true_observation[:, :3] + 100)


def test_a_changed_action_drives_the_motors_but_the_wanted_one_is_charged():
    class Mirror(Perturbation):
        def attach(self, context):
            class Half(Effect):
                def on_action(self, t, actions, worlds):
                    return 0.5 * actions

            return Half()

    task = make_task("HalfCheetah")
    perturbed = BatchTask(task, 1, perturbations=[Mirror()], seed=4)
    plain = BatchTask(task, 1, seed=4)
    perturbed.reset(), plain.reset()
    for action in random_actions(plain, 20):
        a, b = perturbed.step(action), plain.step(0.5 * action)
        assert np.array_equal(a.observation, b.observation)
        cost = -0.05 * (action**2).sum()
        assert a.info.components["control"][0] == pytest.approx(cost, abs=1e-12)


def test_an_outside_force_lifts_by_the_law_of_motion():
    """A constant upward force F on the torso changes the COM's momentum by F t."""

    class Lift(Perturbation):
        def attach(self, context):
            class Up(Effect):
                def on_force(self, t, xfrc_applied, worlds):
                    xfrc_applied[worlds[t[worlds] >= 3], 1, 2] += 500.0

            return Up()

    batch = BatchTask(make_task("HalfCheetah"), 2, perturbations=[Lift()], seed=0)
    batch.reset()
    qpos = np.zeros(9)
    qpos[1] = 10.0
    batch.set_state(qpos, np.zeros(9))
    for _ in range(13):
        batch.step(np.zeros((2, 6)))
    velocity = batch._fields.com_velocity[:, 2]
    expected = -9.81 * 0.13 + 500.0 / 14.0 * 0.10
    np.testing.assert_allclose(velocity, expected, atol=5e-3)


class Heavy(Perturbation):
    edits_model = True

    def __init__(self, factor, onset):
        self.factor, self.onset = factor, onset

    def edit_model(self, spec):
        for geom in spec.geoms:
            geom.density *= self.factor


def test_models_change_at_their_onset_and_back_at_a_reset():
    light = robots.total_mass(robots.build_model("HalfCheetah"))
    changes = [Heavy(2.0, onset=3), Heavy(3.0, onset=5)]
    batch = BatchTask("HalfCheetah", 2, perturbations=changes, seed=0)
    batch.reset()

    def masses():
        return [robots.total_mass(batch.get_model(i)) / light for i in range(2)]

    seen = []
    for t in range(7):
        if t == 4:
            batch.reset([0])
        batch.step(np.zeros((2, 6)))
        seen.append(masses())
    # step t (0-based) runs on the model of onset <= steps taken before it
    np.testing.assert_allclose([b for _, b in seen], [1, 1, 1, 2, 2, 6, 6])
    np.testing.assert_allclose([a for a, _ in seen], [1, 1, 1, 2, 1, 1, 1])


def test_model_change_from_the_start_is_bit_identical_to_that_model():
    def heavier(spec):
        for geom in spec.geoms:
            geom.density *= 2.0

    batch = BatchTask("HalfCheetah", 1, perturbations=[Heavy(2.0, onset=4)], seed=0)
    batch.reset()
    data = mujoco.MjData(batch.model)
    data.qpos[:], data.qvel[:] = batch.qpos[0], batch.qvel[0]
    models = [robots.build_model("HalfCheetah", edits=e) for e in ([], [heavier])]
    for t, action in enumerate(random_actions(batch, 40)):
        batch.step(action)
        data.ctrl[:] = action[0]
        mujoco.mj_step(models[t >= 4], data)
        assert np.array_equal(batch.qpos[0], data.qpos)


def test_a_perturbation_may_bring_its_ground():
    class Brings(Perturbation):
        def ground(self, robot, num_envs, seed):
            assert robot == "Ant"
            return [Bumps(phase) for phase in range(num_envs)]

    batch = BatchTask("Ant", 3, perturbations=[Brings()])
    assert len({id(m) for m in batch._batch.models}) == 3
    with pytest.raises(ValueError, match="2 terrains are asked for at once"):
        BatchTask("Ant", 3, perturbations=[Brings()], terrain=Bumps())


# -- mirror images ---------------------------------------------------------------------


def reflect(name, qpos, qvel):
    """The state seen in a mirror that swaps left and right (y to -y)."""
    qpos, qvel = qpos.copy(), qvel.copy()
    if name == "Walker2d":
        swap = [0, 1, 2, 6, 7, 8, 3, 4, 5]
        return qpos[swap], qvel[swap]
    qpos[[1, 4, 6]] *= -1  # y, and the rotation's x and z: an axis is a pseudo-vector
    qvel[[1, 3, 5]] *= -1
    if name == "Swimmer":
        qpos[7:] *= -1
        qvel[6:] *= -1
        return qpos, qvel
    legs = np.array([6, 7, 4, 5, 2, 3, 0, 1])  # 1 and 4 swap, 2 and 3 swap
    sign = np.array([-1, 1] * 4)  # hips turn the other way
    qpos[7:] = (qpos[7:] * sign)[legs]
    qvel[6:] = (qvel[6:] * sign)[legs]
    return qpos, qvel


MIRRORED_ACTION = {
    "Swimmer": ([0, 1], [-1, -1]),
    "Walker2d": ([3, 4, 5, 0, 1, 2], [1] * 6),
    # actuators are those of legs 4, 1, 2, 3
    "Ant": ([2, 3, 0, 1, 6, 7, 4, 5], [-1, 1] * 4),
}


class EvenFeet(Perturbation):
    """The walker's feet differ in friction; a mirror needs them equal."""

    edits_model = True

    def edit_model(self, spec):
        spec.geom("foot_left_geom").friction = spec.geom("foot_geom").friction


@pytest.mark.parametrize("name", list(MIRRORED_ACTION))
def test_mirror_image(name):
    task = make_task(name, termination="never")
    feet = [EvenFeet()] if name == "Walker2d" else []
    batch = BatchTask(task, 2, seed=5, perturbations=feet)
    batch.reset()
    qpos, qvel = batch.qpos[0], batch.qvel[0]
    images = reflect(name, qpos, qvel)
    batch.set_state(np.stack([qpos, images[0]]), np.stack([qvel, images[1]]))
    order, sign = MIRRORED_ACTION[name]
    for action in random_actions(batch, 40, seed=2, scale=0.3):
        action[1] = action[0][order] * np.array(sign)
        step = batch.step(action)
        expected = reflect(name, batch.qpos[0], batch.qvel[0])
        np.testing.assert_allclose(batch.qpos[1], expected[0], atol=1e-6)
        np.testing.assert_allclose(batch.qvel[1], expected[1], atol=1e-4)
        assert step.reward[0] == pytest.approx(step.reward[1], abs=1e-4)


@pytest.mark.parametrize(
    ("name", "cost", "alive"),
    [
        ("Hopper", 0.005, 0.1),
        ("HalfCheetah", 0.05, 0.0),
        ("Walker2d", 0.005, 0.0),
        ("Ant", 0.005, 0.05),
    ],
)
def test_reward_in_free_flight_by_hand(name, cost, alive):
    """Thrown forward at 2 m/s, no motor can change the speed of the centre of mass."""
    batch = BatchTask(make_task(name, termination="never"), 2, seed=0)
    robot = batch.task.robot
    qpos, qvel = np.array(robot.init_qpos), np.zeros(robot.nv)
    qpos[robot.height_index] += 10.0
    qvel[0] = 2.0
    batch.set_state(qpos, qvel)
    action = np.zeros((2, batch.action_size))
    action[1] = 0.2
    squared = 0.04 * batch.action_size
    for _ in range(5):
        reward = batch.step(action).reward
        assert reward[0] == pytest.approx(2.0 + alive, abs=1e-9)
        assert reward[1] == pytest.approx(2.0 + alive - cost * squared, abs=1e-2)


@pytest.mark.parametrize("name", ["Hopper", "HalfCheetah", "Walker2d"])
def test_planar_robots_stay_in_their_plane(name):
    batch = BatchTask(make_task(name, termination="never"), 2, terrain=None, seed=0)
    batch.reset()
    for action in random_actions(batch, 50):
        step = batch.step(action)
        assert np.abs(step.observation[:, -2]).max() < 1e-12  # COM y


# -- refusals --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"num_envs": 0}, "num_envs is 0, but must be a whole number of at least 1"),
        ({"num_envs": -3}, "num_envs is -3"),
        ({"num_envs": 2.5}, "num_envs is 2.5"),
        ({"task": "Snake"}, "robot 'Snake' does not exist"),
        ({"threads": -1}, "threads is -1"),
        ({"max_episode_steps": 0}, "max_episode_steps is 0"),
        ({"bad_actions": "ignore"}, "bad_actions 'ignore' does not exist"),
        ({"seed": -1}, "seed is -1"),
        ({"seed": [1]}, "There are 1 seeds for 2 worlds"),
        ({"terrain": [Bumps()]}, "There are 1 terrains for 2 worlds"),
    ],
)
def test_bad_construction(arguments, message):
    with pytest.raises(ValueError, match=message):
        BatchTask(**{"task": "Hopper", "num_envs": 2, **arguments})


def test_bad_actions_are_refused_before_anything_moves():
    batch = BatchTask("Hopper", 2)
    with pytest.raises(ValueError, match="No episode has begun"):
        batch.step(np.zeros((2, 3)))
    batch.reset()
    before = batch.qpos
    for bad, message in (
        (np.zeros(3), r"shape \(3,\), but 2 worlds of Hopper need shape \(2, 3\)"),
        (np.zeros((2, 4)), r"shape \(2, 4\)"),
        (np.array([[0, 0, 0], [0, np.nan, 0]]), "world 1 holds nan at entry 1"),
        (np.array([[np.inf, 0, 0], [0, 0, 0]]), "world 0 holds inf at entry 0"),
    ):
        with pytest.raises(ValueError, match=message):
            batch.step(bad)
    assert np.array_equal(batch.qpos, before)
    assert batch.steps.tolist() == [0, 0]


@pytest.mark.parametrize("worlds", [[2], [-1], [0, 0], [0.5], [True, False, True]])
def test_bad_worlds(worlds):
    batch = BatchTask("Hopper", 2)
    batch.reset()
    with pytest.raises(ValueError, match="must be distinct ids from 0 to 1"):
        batch.reset(worlds)


def test_bad_states():
    batch = BatchTask("Hopper", 2)
    for qpos, qvel, name in (
        (np.zeros(5), np.zeros(6), "qpos"),
        (np.zeros(6), np.zeros((3, 6)), "qvel"),
        (np.full(6, np.nan), np.zeros(6), "qpos"),
    ):
        with pytest.raises(ValueError, match=f"{name} has shape .* 6 finite numbers"):
            batch.set_state(qpos, qvel)


def test_sensors_and_observations_must_agree():
    class Liar(Recording):
        def sensors(self, names):
            return names[:5]

    with pytest.raises(ValueError, match="announce 5 sensors"):
        BatchTask("HalfCheetah", 1, perturbations=[Liar()]).reset()
