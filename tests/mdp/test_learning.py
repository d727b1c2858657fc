import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.mdp import reference
from tests.mdp.examples import chain, grid, random_mdp
from thesis_lib.mdp import learn, tie_tolerance
from thesis_lib.mdp.learning import METHODS

ALPHA, EPSILON = 0.3, 0.2


def episodic(seed):
    return random_mdp(seed, n_states=6, n_actions=3, terminal=1)


@pytest.mark.parametrize("exploration", ["all", "others"])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("mdp", [episodic(1), grid(3), chain(4)], ids=["random", "grid", "chain"])
def test_equals_the_plain_python_algorithm_bit_for_bit(mdp, method, exploration):
    learned = learn(
        mdp, method, alpha=ALPHA, epsilon=EPSILON, episodes=40, rng=7, exploration=exploration
    )
    world = reference.World(
        mdp,
        EPSILON,
        tie_tolerance(mdp.outcomes().reward),
        np.random.default_rng(7),
        exploration == "others",
    )
    expected = getattr(reference, method)(world, ALPHA, 40)
    if method == "expected_sarsa":  # its mean is added up in another order
        np.testing.assert_allclose(learned.q, expected, rtol=1e-12, atol=1e-12)
    else:
        np.testing.assert_array_equal(learned.q, expected)


@pytest.mark.parametrize("method", METHODS)
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), scale=st.sampled_from([0.1, 1.0, 100.0]))
def test_shaping_equals_initialisation(method, seed, scale):
    mdp = episodic(seed) if seed % 2 else grid(3, discount=0.95)
    phi = scale * np.random.default_rng(seed).normal(size=(mdp.n_states, mdp.n_actions))
    options = {"alpha": 0.4, "epsilon": 0.1, "steps": 400, "rng": seed, "record": ["actions"]}
    shaped = learn(mdp, method, potential=phi, **options)
    initialised = learn(mdp, method, initial_q=phi, **options)
    np.testing.assert_array_equal(shaped.actions, initialised.actions)
    going_on = ~mdp.terminal
    np.testing.assert_allclose(
        (shaped.q + phi)[going_on], initialised.q[going_on], rtol=0, atol=1e-9 * scale
    )
