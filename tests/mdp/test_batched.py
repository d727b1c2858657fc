"""Many tasks in one compiled call against one call of ``learn`` a task."""

import numpy as np
import pytest

from thesis_lib.domains import continuing_cliff, stock, triangle
from thesis_lib.mdp import learn
from thesis_lib.mdp.batched import total_rewards
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
    ours = total_rewards(
        [domain.tasks[m] for m in chosen],
        method,
        alpha=0.3,
        epsilon=0.1,
        rngs=[5, 6, 7, 8],
        function=function,
        index=[domain.observation_index[m] for m in chosen],
        **budget,
    )
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
    function = np.zeros(domain.shape)
    ours = total_rewards(
        [domain.tasks[0]],
        "q_learning",
        alpha=0.5,
        epsilon=0.1,
        rngs=[1],
        function=function,
        index=[domain.observation_index[0]],
        episodes=episodes,
    )
    one = learn(domain.tasks[0], "q_learning", alpha=0.5, epsilon=0.1, rng=1, episodes=episodes)
    assert ours[0] == one.total_reward


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"steps": None}, "neither of episodes and steps"),
        ({"episodes": 3}, "both of episodes and steps"),
        ({"steps": 0}, "steps"),
        ({"rngs": [1, 2]}, "1 tasks, 2 generators"),
        ({"alpha": 1.5}, "alpha is 1.5"),
        ({"method": "td"}, "method is 'td'"),
        ({"function": np.full((36, 1), 0.0)}, "function"),
        ({"index": [np.zeros(3, int)]}, r"index 0 has shape \(3,\)"),
        ({"steps": None, "episodes": 3}, "no terminal state"),
    ],
)
def test_bad_arguments_are_refused(change, message):
    domain = stock(1, 2, 1)
    function = np.zeros(domain.shape)
    function = np.full(domain.shape, 0.0)
    given = {
        "method": "q_learning",
        "alpha": 0.3,
        "epsilon": 0.1,
        "rngs": [1],
        "function": function,
        "index": [domain.observation_index[0]],
        "steps": 5,
        **change,
    }
    with pytest.raises(ValueError, match=message):
        total_rewards([domain.tasks[0]], given.pop("method"), **given)


def test_missing_values_are_refused():
    domain = stock(1, 2, 1)
    with pytest.raises(ValueError, match="not finite everywhere"):
        total_rewards(
            [domain.tasks[0]],
            "q_learning",
            alpha=0.3,
            epsilon=0.1,
            rngs=[1],
            function=np.full(domain.shape, np.nan),
            index=[domain.observation_index[0]],
            steps=5,
        )
