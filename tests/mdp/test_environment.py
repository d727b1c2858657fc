import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from tests.mdp.examples import chain, grid, random_mdp
from thesis_lib.domains import Domain
from thesis_lib.mdp import TabularEnv, TabularMDP
from thesis_lib.mdp.aggregated import learn_aggregated
from thesis_lib.mdp.environment import from_gymnasium
from thesis_lib.mdp.evaluation import evaluate
from thesis_lib.mdp.learning import learn
from thesis_lib.mdp.planning import policy_iteration, soft_policy_iteration, solve, value_iteration

TASKS = {"grid": grid(3), "random": random_mdp(0, terminal=1), "continuing": random_mdp(1)}


@pytest.fixture
def make():
    """Register environments for one test."""
    names = []

    def register(mdp, **options):
        name = f"thesis-test/Task{len(names)}-v0"
        names.append(name)
        gymnasium.register(name, TabularEnv, max_episode_steps=50)
        return gymnasium.make(name, mdp=mdp, **options)

    yield register
    for name in names:
        del gymnasium.registry[name]


@pytest.mark.parametrize("observation", ["state", "features"])
@pytest.mark.parametrize("task", TASKS)
def test_passes_gymnasiums_own_check_without_warnings(make, task, observation):
    env = make(TASKS[task], observation=observation)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)


def test_same_seed_same_episode():
    env = TabularEnv(random_mdp(2, terminal=1))

    def play():
        seen = [env.reset(seed=3)[0]]
        for a in (0, 1, 2, 1, 0):
            seen.extend(env.step(a)[:3])
        return seen

    assert play() == play()


def test_frequencies_match_the_model():
    mdp = random_mdp(4)
    env = TabularEnv(mdp)
    env.reset(seed=0)
    n = 5000
    counts = np.zeros(5)
    for _ in range(n):
        env.reset(options={"state": 2})
        counts[env.step(1)[0]] += 1
    expected = mdp.transition[2, 1]
    np.testing.assert_allclose(counts / n, expected, atol=4 * 0.5 / np.sqrt(n))


def test_an_episode_by_hand():
    env = TabularEnv(chain(2))
    state, info = env.reset(seed=0)
    assert (state, info["features"]) == (0, {"state": 0})
    assert env.step(1)[:4] == (1, 0.0, False, False)
    assert env.step(0)[:4] == (1, 0.0, False, False)
    assert env.step(1)[:4] == (2, 8.0, True, False)


def test_features_are_observed_in_their_order():
    P = np.zeros((2, 1, 2))
    P[:, 0, 1] = 1.0
    mdp = TabularMDP(P, np.zeros((2, 1)), [1, 0], features={"x": [5, 7], "y": [-1, 0]})
    env = TabularEnv(mdp, observation="features")
    observation, info = env.reset(seed=0)
    np.testing.assert_array_equal(observation, [5, -1])
    assert info == {"state": 0, "features": {"x": 5, "y": -1}}
    assert env.observation_space.contains(observation)
    np.testing.assert_array_equal(env.observation_space.nvec, [3, 2])


def test_a_time_limit_truncates(make):
    env = make(chain(2))
    env.reset(seed=0)
    outcomes = [env.step(0)[2:4] for _ in range(50)]
    assert outcomes[-1] == (False, True)
    assert set(outcomes[:-1]) == {(False, False)}


def test_bad_use():
    env = TabularEnv(chain(2))
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(0)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="action is 2, but it must be an integer from 0 to 1"):
        env.step(2)
    with pytest.raises(ValueError, match="start in state 2, but it must be a non-terminal"):
        env.reset(options={"state": 2})
    with pytest.raises(ValueError, match="render_mode is 'human'"):
        TabularEnv(chain(2), render_mode="human")
    with pytest.raises(ValueError, match="observation 'pixels' does not exist"):
        TabularEnv(chain(2), observation="pixels")


def test_a_task_without_features_is_seen_by_its_states():
    task = TabularMDP(np.eye(2)[:, None], np.zeros((2, 1)), [1.0, 0.0], discount=0.9, features={})
    assert TabularEnv(task).reset(seed=0) == (0, {"state": 0, "features": {}})
    with pytest.raises(ValueError, match="observation is 'features', but the task has none"):
        TabularEnv(task, observation="features")


@pytest.mark.parametrize("name", ["FrozenLake-v1", "CliffWalking-v1", "Taxi-v4"])
def test_tables_of_gymnasium_become_tasks(name):
    env = gymnasium.make(name)
    task = from_gymnasium(env, 0.95)
    assert task.n_states == env.observation_space.n
    rng = np.random.default_rng(0)
    seen, _ = env.reset(seed=0)
    assert task.start[seen] > 0
    for _ in range(500):
        action = int(rng.integers(task.n_actions))
        after, reward, terminated, truncated, _ = env.step(action)
        assert task.transition[seen, action, after] > 0
        assert task.transition_reward[seen, action, after] == pytest.approx(reward)
        assert bool(task.terminal[after]) == terminated
        seen = env.reset()[0] if terminated or truncated else after


def test_frozen_lake_by_hand():
    env = gymnasium.make("FrozenLake-v1", is_slippery=False, desc=["SF", "HG"])
    task = from_gymnasium(env, 0.9)
    # Right, then down, is 1 after one more step.
    np.testing.assert_allclose(solve(task).v, [0.9, 1.0, 0.0, 0.0])
    np.testing.assert_array_equal(task.terminal, [False, False, True, True])


class Listed(gymnasium.Env):
    """An environment that has nothing but its table."""

    def __init__(self, table, start):
        self.P, self.initial_state_distrib = table, np.array(start)


def test_a_state_that_both_ends_and_goes_on_is_no_state_of_a_task():
    # From 0 on to 1, there "exit" with reward 5: 4.5 from the start, not the 0 of an absorbing 1.
    leave = {0: {0: [(1.0, 1, 0.0, False)]}, 1: {0: [(1.0, 1, 5.0, True)]}}
    with pytest.raises(ValueError, match="can end in state 1 and can also go on from there"):
        from_gymnasium(Listed(leave, [1.0, 0.0]), 0.9)
    with pytest.raises(ValueError, match="can end in state 0 and can also go on from there"):
        from_gymnasium(Listed({0: {0: [(1.0, 0, 5.0, True)]}}, [1.0]), 0.9)
    apart = leave | {1: {0: [(1.0, 2, 5.0, True)]}, 2: {0: [(1.0, 2, 0.0, True)]}}
    np.testing.assert_allclose(solve(from_gymnasium(Listed(apart, np.eye(3)[0]), 0.9)).v[0], 4.5)


def test_what_no_episode_comes_to_does_not_count():
    # State 3 goes on to the end without ending, as states of Taxi do that no ride comes to.
    table = {
        0: {0: [(1.0, 1, 1.0, False), (0.0, 2, 0.0, False)]},
        1: {0: [(1.0, 2, 2.0, True)]},
        2: {0: [(1.0, 2, 0.0, False)]},
        3: {0: [(1.0, 2, 0.0, False)]},
    }
    task = from_gymnasium(Listed(table, np.eye(4)[0]), 0.5)
    np.testing.assert_array_equal(task.terminal, [False, False, True, False])
    np.testing.assert_allclose(solve(task).v[:2], [2.0, 2.0])


def test_an_environment_where_a_task_is_needed_is_told_what_to_pass():
    lake, own, pole = (
        gymnasium.make(name) for name in ("FrozenLake-v1", "thesis/Triangle-v0", "CartPole-v1")
    )
    for env, instead in (
        (lake, r"thesis_lib.mdp.environment.from_gymnasium\(env, discount\)"),
        (own, "its MDP, env.unwrapped.mdp"),
        (pole, "an MDP such as TabularMDP"),
    ):
        for use in (
            lambda task: learn(task, alpha=0.1, epsilon=0.1, rng=0, steps=3),
            lambda task: learn_aggregated(task, [0], alpha=1, epsilon=0, rng=0, steps=3, every=1),
            solve,
            value_iteration,
            policy_iteration,
            lambda task: soft_policy_iteration(task, 0.1),
            lambda task: evaluate(task, [0]),
            TabularEnv,
            lambda task: Domain("mine", [task]),
        ):
            with pytest.raises(ValueError, match=f"a task is needed, but .* pass {instead}"):
                use(env)
    with pytest.raises(ValueError, match=r"lists no transitions .*; build a TabularMDP"):
        from_gymnasium(pole, 0.9)
    with pytest.raises(ValueError, match=r"env is 'FrozenLake-v1', but .* gymnasium.make"):
        from_gymnasium("FrozenLake-v1", 0.9)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"take the one that it holds, env\.unwrapped\.mdp"):
        from_gymnasium(gymnasium.make("thesis/Triangle-v0"), 0.9)
