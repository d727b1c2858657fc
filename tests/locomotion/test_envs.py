"""The Gymnasium environments: their contract, and that they are the batch."""

import importlib.util
import pickle
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import RecordEpisodeStatistics

from thesis_lib.locomotion import perturbations, rendering, robots, terrain
from thesis_lib.locomotion.batch import BatchTask
from thesis_lib.locomotion.envs import LocomotionEnv
from thesis_lib.locomotion.tasks import HORIZON, TASKS, make_task
from thesis_lib.registration import register

IDS = [f"thesis/{name}{suffix}-v0" for name in TASKS for suffix in ("", "Hill")]


def can_draw() -> bool:
    try:
        rendering.Renderer(robots.build_model("Hopper"), 8, 8).close()
    except rendering.NoGL:
        return False
    return True


needs_gl = pytest.mark.skipif(not can_draw(), reason="no OpenGL on this machine")


def make(name, **kwargs):
    return gymnasium.make(f"thesis/{name}-v0", **kwargs)


def actions_for(env, steps, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(-1, 1, (steps, *env.action_space.shape))


@pytest.mark.parametrize("env_id", IDS)
def test_registered_with_the_training_horizon(env_id):
    assert gymnasium.spec(env_id).max_episode_steps == HORIZON


def test_the_id_may_name_the_module_to_import():
    env = gymnasium.make("thesis_lib.locomotion:thesis/Walker2d-v0")
    assert env.observation_space.shape == (21,)


def test_importing_twice_warns_of_nothing():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        register()


@pytest.mark.parametrize("env_id", IDS)
def test_check_env_is_clean(env_id):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(env_id).unwrapped, skip_render_check=True)


@pytest.mark.parametrize(
    "options",
    [
        {"noise": 1.0, "noise_from": 0},
        {"sensors": "subset"},
        {"difficulty": 1.0, "switch_at": "task"},
        {"perturbations": (perturbations.ActionDelay(2, onset=0),)},
    ],
    ids=["noise", "subset", "switch", "delay"],
)
def test_check_env_is_clean_under_perturbations(options):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(make("Hopper", **options).unwrapped, skip_render_check=True)


@needs_gl
@pytest.mark.parametrize("env_id", ["thesis/Swimmer-v0", "thesis/AntHill-v0"])
def test_check_env_with_pictures(env_id):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make(env_id, render_mode="rgb_array", width=64, height=48)
        check_env(env.unwrapped)
    env.reset(seed=0)
    assert env.render().shape == (48, 64, 3)


@needs_gl
def test_pictures_show_the_worlds():
    env = gymnasium.make_vec(
        "thesis/AntHill-v0", num_envs=3, n_maps=2, render_mode="rgb_array", width=48, height=48
    )
    env.reset(seed=0)
    frames = env.render()
    assert len(frames) == 3
    assert all(f.shape == (48, 48, 3) and f.std() > 5 for f in frames)
    assert not np.array_equal(frames[0], frames[1])
    env.close()


def test_without_render_mode_there_is_no_picture():
    env = make("Ant")
    env.reset(seed=0)
    assert env.unwrapped.render() is None


@pytest.mark.parametrize("name", TASKS)
def test_one_world_is_the_batch_bit_for_bit(name):
    """World i of a batch, the one-world environment seeded alike, the same actions."""
    seeds = [3, 8]
    batch = BatchTask(name, 2, seed=seeds, threads=2)
    envs = [make(name, disable_env_checker=True) for _ in seeds]
    first = batch.reset()
    for env, seed, row in zip(envs, seeds, first, strict=True):
        assert np.array_equal(env.reset(seed=seed)[0], row)
    running = [True, True]
    rng = np.random.default_rng(1)
    for _ in range(150):
        action = rng.uniform(-1.2, 1.2, (2, batch.action_size))
        step = batch.step(action)
        for i, env in enumerate(envs):
            if not running[i]:
                continue
            seen, reward, terminated, truncated, info = env.step(action[i])
            assert np.array_equal(seen, step.observation[i])
            assert reward == step.reward[i]
            assert (terminated, truncated) == (step.terminated[i], step.truncated[i])
            parts = [v for k, v in info.items() if k.startswith("reward_")]
            assert sum(parts) == pytest.approx(reward, abs=1e-12)
            running[i] = not (terminated or truncated)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize(
    ("env_id", "options"),
    [
        ("thesis/Hopper-v0", {}),
        ("thesis/Hopper-v0", {"noise": 1.0, "noise_from": 3, "sensors": "subset"}),
        ("thesis/Walker2dHill-v0", {}),
    ],
)
def test_vector_env_equals_gymnasiums_own_of_the_same_worlds(env_id, options, mode):
    ours = gymnasium.make_vec(env_id, num_envs=3, autoreset_mode=mode, threads=2, **options)
    theirs = gymnasium.make_vec(
        env_id,
        num_envs=3,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": AutoresetMode(mode)},
        disable_env_checker=True,
        **options,
    )
    assert ours.unwrapped.metadata["autoreset_mode"] == AutoresetMode(mode)
    assert ours.single_observation_space == theirs.single_observation_space
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    a, b = ours.reset(seed=20), theirs.reset(seed=20)
    assert np.array_equal(a[0], b[0])
    ends = 0
    for action in actions_for(ours, 80):
        a, b = ours.step(action), theirs.step(action)
        for mine, yours in zip(a[:4], b[:4], strict=True):
            assert np.array_equal(mine, yours)
        ends += int((a[2] | a[3]).sum())
        assert_infos_equal(a[4], b[4])
        assert ("final_info" in a[4]) == (mode == "SameStep" and bool((a[2] | a[3]).any()))
    assert ends > 3


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_gymnasium_counts_whole_episodes(mode):
    """Its issue 1624: with SAME_STEP every episode but the first was a step short."""
    env = RecordEpisodeStatistics(
        gymnasium.make_vec("thesis/Hopper-v0", num_envs=3, autoreset_mode=mode)
    )
    env.reset(seed=1)
    total, length, resets, ends = np.zeros(3), np.zeros(3), np.zeros(3, dtype=bool), 0
    for action in actions_for(env, 80):
        _, reward, terminated, truncated, info = env.step(action)
        counts = ~resets
        total[counts] += reward[counts]
        length[counts] += 1
        ended = terminated | truncated
        for i in np.flatnonzero(ended):
            assert info["episode"]["r"][i] == pytest.approx(total[i])
            assert info["episode"]["l"][i] == length[i]
        ends += ended.sum()
        total[ended] = length[ended] = 0
        resets = ended if mode == "NextStep" else resets
    assert ends > 6


def assert_infos_equal(ours, theirs):
    assert set(ours) == set(theirs)
    for name, value in theirs.items():
        if isinstance(value, dict):
            assert_infos_equal(ours[name], value)
        elif value.dtype == object:
            assert all(np.array_equal(x, y) for x, y in zip(ours[name], value, strict=True)), name
        else:
            assert ours[name].dtype == value.dtype, name
            np.testing.assert_array_equal(ours[name], value, err_msg=name)


def test_vector_env_without_autoreset():
    env = gymnasium.make_vec("thesis/Hopper-v0", num_envs=4, autoreset_mode="Disabled")
    env.reset(seed=0)
    ended = np.zeros(4, dtype=bool)
    for action in actions_for(env, 100):
        seen, _, terminated, truncated, _ = env.step(action)
        ended = terminated | truncated
        if ended.any():
            break
    with pytest.raises(ValueError, match=r"has ended; call reset with options=\{'reset_mask'"):
        env.step(action)
    again, _ = env.reset(options={"reset_mask": ended})
    assert np.array_equal(again[~ended], seen[~ended])
    assert not np.array_equal(again[ended], seen[ended])
    env.step(action)


def test_vector_truncation_comes_from_the_spec_or_the_caller():
    env = gymnasium.make_vec("thesis/HalfCheetah-v0", num_envs=2, max_episode_steps=3)
    env.reset(seed=0)
    flags = [env.step(action)[3].tolist() for action in actions_for(env, 7)]
    ended = [[False, False], [False, False], [True, True], [False, False]]
    assert flags == [*ended, [False, False], [False, False], [True, True]]


def test_seeding():
    env = make("Ant")
    first = env.reset(seed=5)[0]
    second = env.reset()[0]
    assert not np.array_equal(first, second)
    assert np.array_equal(first, env.reset(seed=5)[0])
    assert np.array_equal(second, env.reset()[0])
    assert not np.array_equal(make("Ant").reset()[0], make("Ant").reset()[0])
    vector = gymnasium.make_vec("thesis/Ant-v0", num_envs=2)
    both = vector.reset(seed=[5, 5])[0]
    assert np.array_equal(both[0], first)
    assert np.array_equal(both[1], first)


def test_set_state_and_control_rate():
    env = make("Hopper").unwrapped
    env.reset(seed=0)
    qpos = [2.0, 1.3, 0.05, -0.1, -0.2, 0.1]
    env.set_state(qpos, np.zeros(6))
    np.testing.assert_array_equal(env.batch.qpos[0], qpos)
    assert env.dt == 0.02
    assert env.metadata["render_fps"] == 50
    with pytest.raises(ValueError, match="qpos has shape"):
        env.set_state(np.zeros(5), np.zeros(6))


def test_info_tells_the_place_and_the_parts_of_the_reward():
    env = make("Ant")
    _, info = env.reset(seed=0)
    assert set(info) == {"x_position"}
    action = np.full(8, 0.5)
    _, reward, _, _, info = env.step(action)
    assert info["reward_control"] == pytest.approx(-0.005 * 8 * 0.25)
    assert info["reward_alive"] == 0.05
    parts = ("forward", "control", "contact", "alive", "divergence")
    assert sum(info[f"reward_{part}"] for part in parts) == pytest.approx(reward)
    assert (info["diverged"], info["off_map"]) == (False, False)


def test_noise_reaches_the_policy_only():
    noisy = make("HalfCheetah", noise=1.0, noise_from=3)
    clean = make("HalfCheetah")
    noisy.reset(seed=1), clean.reset(seed=1)
    for t, action in enumerate(actions_for(clean, 10), start=1):
        a, b = noisy.step(action), clean.step(action)
        assert a[1] == b[1]
        assert np.array_equal(a[4]["true_observation"], b[0])
        assert np.array_equal(a[0], b[0]) == (t < 3)


def test_sensor_subsets():
    text = make("Hopper", sensors="subset")
    assert text.observation_space.shape == (11,)
    assert make("Swimmer", sensors="subset").observation_space.shape == (5,)
    assert make("HalfCheetah", sensors="subset").observation_space.shape == (20,)
    some = make("Walker2d", sensors=("pitch", 0))
    seen, info = some.reset(seed=0)
    full = info["true_observation"]
    np.testing.assert_array_equal(seen, [full[2], full[0]])


def test_hills_and_their_options():
    flat, hill = make("Ant").unwrapped, make("AntHill").unwrapped
    assert flat.batch.model.nhfield == 0
    assert hill.batch.model.nhfield == 1
    steep = make("AntHill", difficulty=1.0).unwrapped
    size = [e.batch.model.hfield_size[0, 2] for e in (hill, steep)]
    assert size[1] > 1.5 * size[0]
    other = make("AntHill", terrain_seed=1).unwrapped
    assert not np.array_equal(other.batch.model.hfield_data, hill.batch.model.hfield_data)
    ground = terrain.hills(0.5, 3, robot="Ant")
    own = make("Ant", terrain=ground).unwrapped
    assert own.batch.model.hfield_nrow[0] == ground.heights.shape[0]
    vector = gymnasium.make_vec("thesis/AntHill-v0", num_envs=5, n_maps=2).unwrapped
    assert [vector.batch.ground_id(i) for i in range(5)] == [0, 1, 0, 1, 0]


@pytest.mark.parametrize("name", TASKS)
def test_until_the_switch_the_world_is_the_flat_task(name):
    """A robot that has not met the hills moves bit for bit as on the flat floor."""
    switch = make(name, difficulty=1.0, switch_at="task")
    flat = make(name)
    assert np.array_equal(switch.reset(seed=2)[0], flat.reset(seed=2)[0])
    for action in actions_for(flat, 20):
        a, b = switch.step(action), flat.step(action)
        assert np.array_equal(a[0], b[0])
        if a[2]:
            break


@pytest.mark.parametrize("name", TASKS)
def test_robots_start_on_the_hills_as_on_the_floor(name):
    """At the start no contact is deeper on hills of difficulty 1 than on the flat floor."""
    depth = {}
    for options in ({}, {"difficulty": 1.0}):
        batch = make(name, **options).unwrapped.batch
        batch.reset()
        batch.set_state(np.array(robots.ROBOTS[name].init_qpos), np.zeros(batch.task.robot.nv))
        contacts = batch.get_data(0).contact.dist
        depth[bool(options)] = min(contacts, default=0.0)
    assert depth[True] >= depth[False] - 2e-3


def test_readings_reach_the_task():
    env = make("HalfCheetah", reading="text", termination="never").unwrapped
    assert env.task == make_task("HalfCheetah", reading="text", termination="never")
    assert make("Hopper", alive_bonus=1.0).unwrapped.task.alive_bonus == 1.0


def test_environments_can_be_pickled_by_their_spec():
    spec = pickle.loads(pickle.dumps(gymnasium.spec("thesis/AntHill-v0")))
    assert gymnasium.make(spec).observation_space.shape == (125,)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"difficulty": -0.5}, "difficulty is -0.5"),
        ({"difficulty": "x"}, "difficulty is x, but it must be a finite number of metres"),
        ({"switch_at": 5.0}, "no hills to switch to"),
        ({"difficulty": 1.0, "switch_at": 1e6}, "switch"),
        ({"difficulty": 1.0, "terrain": terrain.hills(0.5, 0)}, "Both terrain and difficulty"),
        ({"render_mode": "ansi"}, "render_mode is 'ansi', but must be 'rgb_array' or None"),
        ({"dificulty": 1.0}, "There is no option 'dificulty'; the options are robot, reading"),
        ({"sensors": ("nose",)}, "nose"),
        ({"noise": -1.0}, "sigma is -1"),
        ({"reading": "book"}, "reading 'book' does not exist"),
    ],
)
def test_bad_options(arguments, message):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Gymnasium's own, about the render mode
        with pytest.raises(ValueError, match=message):
            make("Hopper", **arguments)


def test_bad_robot_comes_before_its_terrain():
    with pytest.raises(ValueError, match="robot 'Snake' does not exist"):
        LocomotionEnv("Snake", difficulty=-1.0)


@pytest.mark.parametrize(
    "bad", [np.zeros(2), np.zeros((1, 3)), [0.0, np.nan, 0.0], [0.0, 0.0, np.inf]]
)
def test_bad_action(bad):
    env = make("Hopper", disable_env_checker=True).unwrapped
    env.reset(seed=0)
    with pytest.raises(ValueError, match="action"):
        env.step(bad)


def test_zero_worlds():
    with pytest.raises(ValueError, match="num_envs is 0, but must be a whole number"):
        gymnasium.make_vec("thesis/Hopper-v0", num_envs=0)


@pytest.mark.slow
@pytest.mark.skipif(
    importlib.util.find_spec("stable_baselines3") is None,
    reason="needs stable-baselines3, which the project does not depend on",
)
@pytest.mark.parametrize("env_id", ["thesis/Hopper-v0", "thesis/AntHill-v0"])
def test_stable_baselines3_trains_unmodified(env_id):
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_checker import check_env as check

    torch.set_num_threads(1)
    env = gymnasium.make(env_id)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check(env, warn=True)
    model = PPO("MlpPolicy", env, n_steps=1000, batch_size=250, n_epochs=2, seed=0)
    model.learn(10_000)
    assert model.num_timesteps >= 10_000
    action, _ = model.predict(env.reset(seed=0)[0], deterministic=True)
    assert env.action_space.contains(action)
    assert all(np.isfinite(p.detach().numpy()).all() for p in model.policy.parameters())
