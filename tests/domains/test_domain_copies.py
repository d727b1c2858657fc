"""Copies of domains, tasks and environments are like the original, and go on like it."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest

import thesis_lib.domains  # noqa: F401  (registers the environments)
from thesis_lib.domains import stock
from thesis_lib.domains.environments import DOMAINS
from thesis_lib.mdp.learning import learn

WAYS = {"deepcopy": copy.deepcopy, "pickle": lambda made: pickle.loads(pickle.dumps(made))}


@pytest.fixture(params=WAYS.values(), ids=WAYS)
def duplicate(request):
    return request.param


@pytest.mark.parametrize("name", DOMAINS)
def test_every_domain(name, duplicate):
    domain = DOMAINS[name]()
    twin = duplicate(domain)
    assert twin.task_names == domain.task_names
    np.testing.assert_array_equal(twin.distribution, domain.distribution)
    np.testing.assert_array_equal(twin.observations, domain.observations)
    for ours, theirs in zip(domain.tasks, twin.tasks, strict=True):
        values = np.random.default_rng(0).normal(size=ours.n_states)
        np.testing.assert_array_equal(theirs.lookahead(values), ours.lookahead(values))
        np.testing.assert_array_equal(theirs.start, ours.start)
    runs = [learn(d.tasks[-1], alpha=0.1, epsilon=0.1, rng=3, steps=500) for d in (domain, twin)]
    np.testing.assert_array_equal(runs[0].q, runs[1].q)


@pytest.mark.parametrize("name", DOMAINS)
def test_arrays_of_a_copy_are_read_only_as_well(name, duplicate):
    twin = duplicate(DOMAINS[name]())
    for array in (twin.distribution, twin.observations, twin.tasks[0].reward):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


@pytest.mark.parametrize(
    "options",
    [
        {"influence": "per_sector", "sectors": 2, "global_factors": 1},
        {"global_persistence": 0.8, "start": "unowned", "reward_timing": "before_current"},
    ],
)
def test_a_copied_stock_domain_keeps_its_options_and_shares_its_states(options, duplicate):
    domain = stock(**options)
    twin = duplicate(domain)
    first, last = twin.tasks[0], twin.tasks[-1]
    assert first.features is last.features
    original = domain.tasks[-1]
    for name in ("influence", "rising_helps", "reward", "start"):
        np.testing.assert_array_equal(getattr(last, name), getattr(original, name))
    for ours, theirs in zip(
        vars(original.outcomes()).values(), vars(last.outcomes()).values(), strict=True
    ):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("name", [*DOMAINS, "Heat"])
def test_environments_go_on_alike(name, duplicate):
    env = gymnasium.make(f"thesis/{name}-v0")
    rng = np.random.default_rng(0)
    env.reset(seed=4)

    def go_on(made, actions):
        for action in actions:
            seen, reward, terminated, _, info = made.step(action)
            yield np.append(seen, reward), info
            if terminated:
                yield made.reset()

    list(go_on(env, rng.integers(env.action_space.n, size=30)))
    twin = duplicate(env)
    actions = rng.integers(env.action_space.n, size=300)
    ahead = list(go_on(twin, actions))
    for ours, theirs in zip(go_on(env, actions), ahead, strict=True):
        np.testing.assert_array_equal(ours[0], theirs[0])
