"""Any environment of Gymnasium as a task: the same steps as by hand, and policies that learn."""

import copy
import dataclasses
import pickle

import gymnasium
import numpy as np
import pytest
import torch

from thesis_lib.optimisation import (
    TRPO,
    GymnasiumTask,
    Learner,
    collect,
    gymnasium_task,
    run_episodes,
)
from thesis_lib.policies import make_policy
from thesis_lib.training.config import TrainConfig, idle_settings
from thesis_lib.training.grid import run_name
from thesis_lib.training.train import train


class Countdown(gymnasium.Env):
    """Ends after as many steps as its world's seed says; the reward is the action."""

    observation_space = gymnasium.spaces.Dict(
        {"left": gymnasium.spaces.Box(0, 9, (1,)), "grid": gymnasium.spaces.Box(0, 1, (2, 2))}
    )
    action_space = gymnasium.spaces.Box(np.array([0.0, -4.0]), np.array([2.0, 4.0]))
    dt = 0.25

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.left = int(self.np_random.integers(2, 6))
        return self._see(), {}

    def step(self, action):
        assert self.action_space.contains(action)
        self.left -= 1
        return self._see(), float(action.sum()), self.left == 0, False, {}

    def _see(self):
        return {"left": np.array([self.left], np.float32), "grid": np.zeros((2, 2), np.float32)}


class Unbounded(Countdown):
    action_space = gymnasium.spaces.Box(-np.inf, np.inf, (1,))


def test_pendulum_is_pendulum():
    task = GymnasiumTask("Pendulum-v1", 3, seed=5, max_episode_steps=7)
    assert (task.observation_size, task.action_size, task.max_episode_steps) == (3, 1, 7)
    assert task.dt == pytest.approx(0.05)
    seeds = np.random.SeedSequence(5).generate_state(3)
    alone = [gymnasium.make("Pendulum-v1", max_episode_steps=7) for _ in seeds]
    first = [env.reset(seed=int(s))[0] for env, s in zip(alone, seeds, strict=True)]
    np.testing.assert_array_equal(task.reset(), first)
    for t in range(7):
        action = np.random.default_rng(t).normal(size=(3, 1))
        step = task.step(action)
        for i, env in enumerate(alone):
            # bounds of the torque are -2 and 2 Nm
            seen, reward, terminated, truncated, _ = env.step(
                (2 * np.clip(action[i], -1, 1)).astype(np.float32)
            )
            np.testing.assert_array_equal(step.observation[i], seen)
            assert step.reward[i] == reward
            assert (step.terminated[i], step.truncated[i]) == (terminated, truncated)
    assert step.truncated.all()
    still = task.step(np.ones((3, 1)))
    np.testing.assert_array_equal(still.observation, step.observation)
    assert (still.reward == 0).all()
    assert still.truncated.all()
    assert not still.terminated.any()


def test_worlds_that_ended_stand_still_until_they_are_reset():
    task = GymnasiumTask(Countdown, 4, seed=1)
    assert task.observation_size == 5
    left = task.reset()[:, 4]  # grid before left, as in the alphabet
    done = np.zeros(4, dtype=bool)
    for t in range(1, 8):
        step = task.step(np.zeros((4, 2)))
        np.testing.assert_array_equal(step.observation[:, 4], np.maximum(left - t, 0))
        np.testing.assert_array_equal(step.reward, np.where(done, 0.0, 1.0))  # the middle, 1 + 0
        done = t >= left
        np.testing.assert_array_equal(step.terminated, done)
    again = task.reset([1, 3])
    assert again.shape == (2, 5)
    step = task.step(np.ones((4, 2)))
    np.testing.assert_array_equal(step.terminated, [True, False, True, False])
    np.testing.assert_array_equal(step.observation[[1, 3], 4], again[:, 4] - 1)
    np.testing.assert_array_equal(step.reward, [0, 6, 0, 6])


def test_unbounded_actions_are_passed_on():
    task = GymnasiumTask(Unbounded, 1)
    task.reset()
    assert task.step([[37.5]]).reward[0] == 37.5


def test_the_same_seed_gives_the_same_episodes_in_processes_too():
    runs = []
    for processes in (False, True):
        task = GymnasiumTask("Pendulum-v1", 2, seed=3, processes=processes, max_episode_steps=20)
        policy = make_policy("gru", 3, 1, dt=task.dt, seed=1)
        runs.append(collect(task, policy, 70, np.random.default_rng(0)))
        task.close()
    np.testing.assert_array_equal(runs[0].observations, runs[1].observations)
    assert runs[0].n_episodes == 4
    assert (runs[0].lengths == 20).all()


@pytest.mark.parametrize("way", [copy.deepcopy, lambda t: pickle.loads(pickle.dumps(t))])
def test_copies_go_on_alike(way):
    task = GymnasiumTask("Pendulum-v1", 2, max_episode_steps=5)
    task.reset()
    task.step(np.ones((2, 1)))
    twin = way(task)
    for action in np.random.default_rng(0).normal(size=(6, 2, 1)):
        a, b = twin.step(action), task.step(action)
        np.testing.assert_array_equal(a.observation, b.observation)
    np.testing.assert_array_equal(twin.reset([0]), task.reset([0]))


def test_a_recurrent_policy_learns_to_push_the_right_way():
    # The reward is the sum of the actions, so that the mean must rise.
    task = GymnasiumTask(Countdown, 10, seed=0)
    policy = make_policy("ctrnn", 5, 2, dt=task.dt, seed=0, dtype=torch.float64)
    learner = Learner(policy, TRPO(delta=0.05))
    returns = []
    for i in range(8):
        task.reseed(i)
        rollouts = collect(task, policy, 300, np.random.default_rng(i))
        returns.append(rollouts.rewards.mean())
        report = learner.improve(rollouts)
        assert report.accepted
        assert report.kl <= 0.05
    assert returns[-1] > returns[0] + 1


def test_bad_input_is_one_sentence():
    with pytest.raises(ValueError, match="give an environment with a Box action"):
        GymnasiumTask("CartPole-v1", 1)
    with pytest.raises(ValueError, match="num_envs is 0"):
        GymnasiumTask("Pendulum-v1", 0)
    with pytest.raises(ValueError, match="max_episode_steps is given beside a function"):
        GymnasiumTask(Countdown, 1, max_episode_steps=3)
    Silent = type("Silent", (Countdown,), {"dt": None})
    with pytest.raises(ValueError, match="give dt, in seconds"):
        _ = GymnasiumTask(Silent, 1).dt
    assert GymnasiumTask(Silent, 1, dt=0.5).dt == 0.5
    for dt in (0, -1, "a"):
        with pytest.raises(ValueError, match=f"dt is {dt!r}, but it must be"):
            GymnasiumTask(Countdown, 1, dt=dt)
    with pytest.raises(ValueError, match="give its id, or a function that makes one"):
        GymnasiumTask(Countdown(), 1)
    policy = make_policy("ffwd", 3, 1, dt=0.05)
    for env in (gymnasium.make("Pendulum-v1"), gymnasium.make_vec("Pendulum-v1", num_envs=2)):
        with pytest.raises(ValueError, match="pass GymnasiumTask"):
            run_episodes(env, policy)


class Endless(Countdown):
    def step(self, action):
        seen, reward, _, truncated, info = super().step(action)
        return seen | {"left": np.zeros(1, np.float32)}, reward, False, truncated, info


def test_an_episode_that_never_ends_is_told_and_not_stored_for_ever(monkeypatch):
    monkeypatch.setattr(gymnasium_task, "ENDLESS", 30)
    task = GymnasiumTask(Endless, 2)
    policy = make_policy("ffwd", 5, 2, dt=task.dt)
    with pytest.raises(ValueError, match=r"not ended in 30 steps, .*: wrap it in gymnasium.wrap"):
        collect(task, policy, 10, np.random.default_rng(0))
    task = GymnasiumTask(lambda: gymnasium.wrappers.TimeLimit(Endless(), 40), 2)
    assert task.max_episode_steps == 40
    assert collect(task, policy, 10, np.random.default_rng(0)).lengths.tolist() == [40]


@pytest.mark.parametrize("architecture", ["ctrnn", "esn", "ffwd"])
def test_a_run_on_an_environment_s_id_is_taken_up_where_it_was_left(architecture, tmp_path):
    config = TrainConfig(
        "Pendulum-v1", architecture=architecture, batch_steps=60, horizon=20, iterations=2
    )
    train(dataclasses.replace(config, iterations=1), tmp_path)
    resumed, whole = train(config, tmp_path), train(config)
    assert resumed.curve.mean_return.tolist() == whole.curve.mean_return.tolist()
    assert (whole.curve.steps == [60, 120]).all()
    assert (resumed.policy.parameter_vector() == whole.policy.parameter_vector()).all()


def test_a_run_on_an_environment_that_cannot_be_trained_on_is_one_sentence():
    with pytest.raises(ValueError, match="task 'Nope-v0' does not exist: choose one of Swimmer"):
        TrainConfig("Nope-v0")
    with pytest.raises(ValueError, match="terrain is 'hill', but Pendulum-v1 has none"):
        TrainConfig("Pendulum-v1", "hill")
    with pytest.raises(ValueError, match="give an environment with a Box action"):
        train(TrainConfig("CartPole-v1"))
    assert idle_settings(TrainConfig("Pendulum-v1", reading="text"))["reading"] == "a robot's task"
    assert run_name(TrainConfig("thesis/Hopper-v0")) == "thesis-hopper-v0-flat-dtrnn-0-float32"
