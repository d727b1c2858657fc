"""A batch of tasks against one call of ``learn`` a task."""

import numpy as np
import pytest

from thesis_lib.domains import continuing_cliff, stock, triangle
from thesis_lib.mdp import learn
from thesis_lib.mdp.batched import TaskBatch
from thesis_lib.mdp.learning import METHODS

DOMAINS = {
    "triangle": (triangle, {"episodes": 7}),
    "cliff": (continuing_cliff, {"steps": 500}),
    "stock": (lambda: stock(1, 2, 1), {"steps": 300}),
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", DOMAINS)
def test_totals_are_those_of_learn_to_the_last_bit(name, method):
    make, budget = DOMAINS[name]
    domain = make()
    function = np.random.default_rng(0).normal(size=domain.shape)
    chosen = [0, 3, 3, 1]
    batch = TaskBatch(
        [domain.tasks[m] for m in chosen],
        [domain.observation_index[m] for m in chosen],
        method,
        alpha=0.3,
        epsilon=0.1,
        **budget,
    )
    ours = batch.total_rewards(function, [5, 6, 7, 8])
    # A batch may be used again.
    assert batch.total_rewards(function, [5, 6, 7, 8]).tolist() == ours.tolist()
    single = [
        learn(
            domain.tasks[m],
            method,
            alpha=0.3,
            epsilon=0.1,
            rng=seed,
            initial_q=domain.scatter(function, m),
            **budget,
        ).total_reward
        for m, seed in zip(chosen, (5, 6, 7, 8), strict=True)
    ]
    assert ours.tolist() == single


def test_a_long_budget_of_episodes_fills_the_records_more_than_once():
    domain = triangle()
    episodes = 2**14 + 3
    batch = TaskBatch(
        [domain.tasks[0]],
        [domain.observation_index[0]],
        "q_learning",
        alpha=0.5,
        epsilon=0.1,
        episodes=episodes,
    )
    ours = batch.total_rewards(np.zeros(domain.shape), [1])
    one = learn(domain.tasks[0], "q_learning", alpha=0.5, epsilon=0.1, rng=1, episodes=episodes)
    assert ours[0] == one.total_reward


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"steps": None}, "neither of episodes and steps"),
        ({"episodes": 3}, "both of episodes and steps"),
        ({"steps": 0}, "steps"),
        ({"alpha": 1.5}, "alpha is 1.5"),
        ({"method": "td"}, "method 'td' does not exist"),
        ({"index": [np.zeros(3, int)]}, r"index 0 has shape \(3,\)"),
        ({"index": []}, "1 tasks and 0 indices"),
        ({"steps": None, "episodes": 3}, "no terminal state"),
    ],
)
def test_bad_batches_are_refused(change, message):
    domain = stock(1, 2, 1)
    given = {
        "index": [domain.observation_index[0]],
        "method": "q_learning",
        "alpha": 0.3,
        "epsilon": 0.1,
        "steps": 5,
        **change,
    }
    with pytest.raises(ValueError, match=message):
        TaskBatch([domain.tasks[0]], given.pop("index"), given.pop("method"), **given)


@pytest.mark.parametrize(
    ("function", "rngs", "message"),
    [
        (np.zeros((16, 1)), [1], r"function has shape \(16, 1\)"),
        (np.zeros((15, 2)), [1], "at least 16 rows"),
        (np.full((16, 2), np.nan), [1], "not finite everywhere"),
        (np.zeros((16, 2)), [1, 2], "1 tasks and 2 generators"),
        (np.zeros((16, 2)), [-1], "rng is -1"),
    ],
)
def test_bad_functions_are_refused(function, rngs, message):
    domain = stock(1, 2, 1)
    batch = TaskBatch(
        [domain.tasks[0]],
        [domain.observation_index[0]],
        "q_learning",
        alpha=0.3,
        epsilon=0.1,
        steps=5,
    )
    with pytest.raises(ValueError, match=message):
        batch.total_rewards(function, rngs)
