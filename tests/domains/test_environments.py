"""Every domain as a Gymnasium environment, by Gymnasium's own checks."""

import subprocess
import sys
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import thesis_lib.domains  # noqa: F401  (registers the environments)
from thesis_lib.domains import stock, triangle
from thesis_lib.domains.environments import DOMAINS, make

CASES = [
    ("EpisodicCliff", {}),
    ("EpisodicCliff", {"task": 7, "sensor": True, "observation": "features"}),
    ("ContinuingCliff", {"task": 3, "discount": 0.9, "observation": "features"}),
    ("Triangle", {"task": 11, "observation": "features"}),
    ("Stock", {"task": 5}),
    ("Stock", {"sectors": 2, "stocks": 1, "global_factors": 1, "observation": "features"}),
    ("AppendixA1", {"task": 1}),
    ("AppendixA2", {"second": "c"}),
    ("AppendixA3", {"task": 1, "observation": "features"}),
]


@pytest.mark.parametrize(("name", "options"), CASES)
def test_gymnasium_finds_nothing_to_complain_about(name, options):
    env = gymnasium.make(f"thesis/{name}-v0", **options)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=True)
    env.close()


def test_every_domain_is_registered():
    assert {f"thesis/{name}-v0" for name in DOMAINS} <= set(gymnasium.registry)


def test_make_needs_no_import_when_it_names_the_module():
    program = (
        "import gymnasium; env = gymnasium.make('thesis_lib.domains:thesis/Triangle-v0', task=2);"
        "print(env.reset(seed=0)[1]['features'])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "'x3'" in done.stdout


def test_an_episode_is_the_task():
    # Task 5 of the stock domain: average rewards of a state-action pair against the model.
    env = make("Stock", 5)
    task = stock().tasks[5]
    rewards = []
    for i in range(2000):
        env.reset(seed=1 if i == 0 else None, options={"state": 9})
        rewards.append(env.step(0)[1])
    error = np.std(rewards, ddof=1) / np.sqrt(len(rewards))
    assert abs(np.mean(rewards) - task.reward[9, 0]) < 4 * error


def test_a_task_may_be_numbered_by_numpy():
    tasks = triangle().tasks
    np.testing.assert_array_equal(make("Triangle", np.int64(7)).mdp.reward, tasks[7].reward)
    assert not np.array_equal(tasks[6].reward, tasks[7].reward)


def test_bad_tasks_are_one_sentence():
    with pytest.raises(ValueError, match="task is 12, but domain 'triangle' has tasks 0 to 11"):
        gymnasium.make("thesis/Triangle-v0", task=12)
    with pytest.raises(ValueError, match="task is 'first'"):
        make("Triangle", "first")
    with pytest.raises(ValueError, match="domain 'Maze' does not exist: choose one of Epi"):
        make("Maze")
