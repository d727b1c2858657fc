"""Domains made of Gymnasium's tasks, against Gymnasium itself."""

import numpy as np
from gymnasium.envs.toy_text.frozen_lake import FrozenLakeEnv, generate_random_map
from gymnasium.envs.toy_text.taxi import TaxiEnv

from thesis_lib.domains.toy_text import frozen_lakes, taxi
from thesis_lib.potentials import optimal_solutions
from thesis_lib.relevance import Solutions, domain_relevance, k_relevance, remove


def test_a_taxi_ride_is_gymnasiums():
    domain, env = taxi(), TaxiEnv()
    task = domain.tasks[1]
    s, _ = env.reset(seed=3)
    env.action_space.seed(3)
    ended = False
    while not ended:
        assert task.start[s] > 0
        for _ in range(200):
            a = int(env.action_space.sample())
            after, reward, ended, *_ = env.step(a)
            assert task.transition[s, a, after] == 1.0
            assert task.reward[s, a] == reward
            assert task.terminal[after] == ended
            s = after
            if ended:
                break
        else:
            s, _ = env.reset()


def test_destinations_have_each_number_once():
    numbers = np.array([task.features["destination"] for task in taxi().tasks])
    assert np.array_equal(np.sort(numbers, axis=0), np.tile(np.arange(4)[:, None], 500))


def test_the_third_lake_is_gymnasiums():
    task = frozen_lakes(seed=2).tasks[0]
    env = FrozenLakeEnv(desc=generate_random_map(4, seed=10))
    going = [s for s in range(16) if not task.terminal[32 + s]]
    for s in going:
        for a in range(4):
            own = np.zeros(64)
            for p, after, *_ in env.P[s][a]:
                own[32 + after] += p
            assert np.allclose(task.transition[32 + s, a], own)
            assert np.isclose(task.reward[32 + s, a], sum(p * r for p, _, r, _ in env.P[s][a]))
    assert [s for s in range(16) if env.desc.ravel()[s] in b"SF"] == going


def test_the_lakes_number_matters_in_each_task_and_not_across():
    """For every task the domain holds all 24 numberings."""
    domain = frozen_lakes()
    solutions = Solutions.from_domain(domain, optimal_solutions(domain))
    lake = remove(solutions, ["lake"])
    assert k_relevance(solutions, lake, 1) > 0.01
    assert abs(domain_relevance(solutions, lake)) < 1e-12
    assert domain_relevance(solutions, remove(solutions, ["row"])) > 1e-3
