import numpy as np
import pytest

from tests.mdp.examples import chain, grid, random_mdp
from thesis_lib.mdp import evaluate, follow, simulate


@pytest.mark.parametrize(
    "mdp",
    [
        random_mdp(1, terminal=1, discount=1.0),
        random_mdp(2, terminal=2, discount=0.8),
        grid(3),
        chain(3),
    ],
    ids=["undiscounted", "discounted", "grid", "chain"],
)
def test_monte_carlo_returns_agree_with_the_exact_value(mdp):
    pi = np.random.default_rng(0).dirichlet(np.ones(mdp.n_actions), size=mdp.n_states)
    run = simulate(mdp, pi, episodes=40_000, rng=5)
    standard_error = run.returns.std(ddof=1) / np.sqrt(run.returns.size)
    exact = float(mdp.start @ evaluate(mdp, pi).v)
    assert abs(run.returns.mean() - exact) < 4 * standard_error
    assert run.visits.sum() == run.lengths.sum()


def test_a_deterministic_episode_by_hand():
    run = simulate(chain(4), [1, 1, 1, 1, 0], episodes=3, rng=0)
    np.testing.assert_array_equal(run.returns, [1.0] * 3)  # 8 * .5^3
    np.testing.assert_array_equal(run.total_rewards, [8.0] * 3)
    np.testing.assert_array_equal(run.lengths, [4] * 3)
    np.testing.assert_array_equal(run.visits[:, 1], [3, 3, 3, 3, 0])
    path = follow(chain(4), [1, 1, 1, 1, 0], rng=0)
    np.testing.assert_array_equal(path.states, [0, 1, 2, 3, 4])
    np.testing.assert_array_equal(path.actions, [1] * 4)
    np.testing.assert_array_equal(path.rewards, [0, 0, 0, 8])


def test_following_is_the_first_simulated_episode():
    mdp = random_mdp(3, terminal=1)
    pi = np.full((5, 3), 1 / 3)
    run, path = simulate(mdp, pi, episodes=1, rng=9), follow(mdp, pi, rng=9)
    assert path.rewards.sum() == pytest.approx(run.total_rewards[0])
    assert len(path.actions) == run.lengths[0]
    visits = np.zeros((5, 3), int)
    np.add.at(visits, (path.states[:-1], path.actions), 1)
    np.testing.assert_array_equal(visits, run.visits)


def test_episodes_are_cut_off():
    run = simulate(chain(4), np.zeros(5, int), episodes=2, rng=0, max_episode_steps=7)
    np.testing.assert_array_equal(run.lengths, [7, 7])
    assert len(follow(chain(4), np.zeros(5, int), rng=0, max_steps=7).actions) == 7


def test_endless_episodes_are_refused():
    for call in (lambda **k: simulate(episodes=1, **k), follow):
        with pytest.raises(ValueError, match="from state 0 the policy never reaches a terminal"):
            call(mdp=chain(4), policy=np.zeros(5, int), rng=0)


def test_bad_arguments():
    with pytest.raises(ValueError, match="episodes is 0"):
        simulate(chain(), np.ones(5, int), episodes=0, rng=0)
    with pytest.raises(ValueError, match="rng is -3"):
        simulate(chain(), np.ones(5, int), episodes=1, rng=-3)
