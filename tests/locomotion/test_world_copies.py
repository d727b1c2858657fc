"""A copied world goes on as the one it was copied from, bit for bit."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest

from thesis_lib.locomotion import perturbations
from thesis_lib.locomotion.batch import BatchTask
from thesis_lib.locomotion.envs import LocomotionEnv
from thesis_lib.locomotion.tasks import TASKS, make_task
from thesis_lib.locomotion.terrain import hill_maps

WAYS = {"deepcopy": copy.deepcopy, "pickle": lambda made: pickle.loads(pickle.dumps(made))}
PERTURBATIONS = {
    "none": (),
    "noise": (perturbations.WhiteNoise(0.3, onset=12),),
    "subset": (perturbations.SensorSubset((0, 3)),),
    "sensor": (perturbations.SensorFailure((1,), onset=12),),
    "switch": (perturbations.TerrainSwitch(0.5),),
    "motor": (perturbations.ActuatorFailure((0,), onset=12),),
    "delay": (perturbations.ActionDelay(3, onset=6),),
    "mass": (perturbations.MassChange(1.5, onset=12),),
    "friction": (perturbations.FrictionChange(0.5, onset=8),),
    "push": (perturbations.Push((1.0, 0.0, 0.5), steps=8, onset=6, every=9),),
}


@pytest.fixture(params=WAYS.values(), ids=WAYS)
def duplicate(request):
    return request.param


def drive(task, steps, seed=0):
    """Steps under random actions, with a reset of some worlds in between, as one array."""
    rng = np.random.default_rng(seed)
    told = []
    for t in range(steps):
        if t % 7 == 6 and not task.autoreset:
            told.append(task.reset([0]).ravel())
        step = task.step(rng.uniform(-1, 1, (task.num_envs, task.action_size)))
        told += [step.observation, step.reward, step.terminated, step.truncated, task.qpos]
        told += [
            step.info.true_observation,
            step.info.episode_return,
            *step.info.components.values(),
        ]
    return np.concatenate([np.ravel(part) for part in told])


@pytest.mark.parametrize("autoreset", [False, True])
@pytest.mark.parametrize("robot", TASKS)
def test_every_robot(robot, autoreset, duplicate):
    task = BatchTask(robot, 3, seed=4, autoreset=autoreset, max_episode_steps=15)
    task.reset()
    drive(task, 10)
    twin = duplicate(task)
    assert twin.threads == task.threads
    # the twin first, so that nothing it does can go unnoticed in the original
    ahead = drive(twin, 25, seed=1)
    np.testing.assert_array_equal(drive(task, 25, seed=1), ahead)


@pytest.mark.parametrize("name", PERTURBATIONS)
def test_every_perturbation(name, duplicate):
    task = BatchTask(
        make_task("Hopper", termination="never"), 2, seed=1, perturbations=PERTURBATIONS[name]
    )
    task.reset()
    drive(task, 10)
    twin = duplicate(task)
    ahead = drive(twin, 25, seed=1)
    np.testing.assert_array_equal(drive(task, 25, seed=1), ahead)


def test_worlds_on_hills_of_their_own(duplicate):
    task = BatchTask("Ant", 2, seed=1, terrain=hill_maps(2, 0.5, 3, robot="Ant"))
    task.reset()
    drive(task, 5)
    twin = duplicate(task)
    assert [twin.ground_id(i) for i in range(2)] == [0, 1]
    ahead = drive(twin, 20, seed=1)
    np.testing.assert_array_equal(drive(task, 20, seed=1), ahead)


@pytest.mark.parametrize("steps", [None, 0], ids=["new", "just reset"])
def test_before_the_first_step(steps, duplicate):
    task = BatchTask("Walker2d", 2, seed=9)
    if steps == 0:
        task.reset()
    twin = duplicate(task)
    np.testing.assert_array_equal(twin.reset(), task.reset())
    np.testing.assert_array_equal(drive(twin, 5), drive(task, 5))


def test_a_world_that_has_ended_stands_still_in_the_copy_too(duplicate):
    task = BatchTask("Swimmer", 2, max_episode_steps=3)
    task.reset()
    for _ in range(4):
        last = task.step(np.zeros((2, 2)))
    step = duplicate(task).step(np.ones((2, 2)))
    assert step.truncated.all()
    np.testing.assert_array_equal(step.observation, last.observation)
    np.testing.assert_array_equal(step.reward, 0)


def test_a_shallow_copy_shares_no_counters():
    task = BatchTask("Hopper", 1)
    task.reset()
    twin = copy.copy(task)
    twin.step(np.zeros((1, 3)))
    assert (twin.steps[0], task.steps[0]) == (1, 0)


@pytest.mark.parametrize("robot", TASKS)
def test_gymnasium_environments(robot, duplicate):
    for env in (
        gymnasium.make(f"thesis/{robot}Hill-v0", noise=0.1, noise_from=3),
        gymnasium.make_vec(f"thesis/{robot}-v0", num_envs=2, max_episode_steps=8),
    ):
        env.reset(seed=3)
        rng = np.random.default_rng(0)
        actions = rng.uniform(-1, 1, (20, *env.action_space.shape))
        for action in actions[:5]:
            env.step(action)
        twin = duplicate(env)
        ahead = [twin.step(action) for action in actions[5:]] + [twin.reset()]
        for theirs, ours in zip(ahead, [*map(env.step, actions[5:]), env.reset()], strict=True):
            for x, y in zip(theirs[:-1], ours[:-1], strict=True):
                np.testing.assert_array_equal(x, y)


def test_a_planner_looks_ahead_in_copies_and_comes_back():
    env = LocomotionEnv("Hopper")
    env.reset(seed=0)
    values = [copy.deepcopy(env).step(np.full(3, a))[1] for a in (-1.0, 0.0, 1.0)]
    assert values[1] == copy.deepcopy(env).step(np.zeros(3))[1]
    assert env.step(np.full(3, 1.0))[1] == values[2]
