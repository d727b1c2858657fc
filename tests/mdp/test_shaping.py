"""Shaping any environment: invariance of the best policies, and look-ahead advice as start."""

import gymnasium
import numpy as np
import pytest

from thesis_lib.domains import episodic_cliff, triangle
from thesis_lib.mdp import TabularMDP, planning
from thesis_lib.mdp.environment import TabularEnv
from thesis_lib.mdp.shaping import PotentialShaping

GAMMA = 0.9


def small_task():
    """Three states in a row and an end; actions go left or right, with a slip."""
    rng = np.random.default_rng(0)
    transition = rng.dirichlet(np.ones(4), (4, 2))
    transition[3] = [0, 0, 0, 1]
    reward = rng.normal(size=(4, 2))
    reward[3] = 0
    return TabularMDP(transition, reward, [0.5, 0.5, 0, 0], [False] * 3 + [True], GAMMA)


@pytest.mark.parametrize("task", [episodic_cliff(discount=GAMMA).tasks[0], small_task()])
def test_a_potential_of_states_leaves_the_best_policy_as_it_is(task):
    # Shaped rewards by the wrapper, state by state and action by action, solved exactly:
    # Q of the shaped task is Q - Phi (Ng et al., corollary 2).
    phi = np.random.default_rng(1).normal(size=task.n_states)
    env = PotentialShaping(TabularEnv(task), phi, GAMMA)
    seen = {}
    env.reset(seed=0)
    for s in np.flatnonzero(~task.terminal):
        for a in range(task.n_actions):
            missing = {int(t) for t in task.outcomes().successor[s, a] if task.transition[s, a, t]}
            while missing:
                env.reset(options={"state": int(s)})
                t, reward, _, _, info = env.step(a)
                seen[s, a, int(t)] = reward
                assert reward - info["shaping"] == pytest.approx(task.reward[s, a])
                missing.discard(int(t))
    shaped_reward = np.zeros_like(task.reward)
    for (s, a, t), reward in seen.items():
        shaped_reward[s, a] += task.transition[s, a, t] * reward
    shaped = TabularMDP(task.transition, shaped_reward, task.start, task.terminal, GAMMA)
    plain, changed = planning.solve(task).q, planning.solve(shaped).q
    alive = ~task.terminal
    np.testing.assert_allclose(changed[alive], (plain - phi[:, None])[alive], atol=1e-8)


class Agent:
    """A tabular learner, written for Gymnasium's interface alone."""

    def __init__(self, q, advice, rule, rng):
        self.q, self.advice, self.rule, self.rng = q.copy(), advice, rule, rng

    def greedy(self, s):
        values = (self.q + self.advice)[s]
        return int(self.rng.choice(np.flatnonzero(values > values.max() - 1e-9)))

    def choose(self, s):
        return (
            int(self.rng.integers(self.q.shape[1])) if self.rng.random() < 0.2 else self.greedy(s)
        )

    def following(self, s):
        return self.choose(s) if self.rule == "sarsa" else self.greedy(s)

    def run(self, env, steps, shaped):
        taken = []
        s, _ = env.reset(seed=7)
        a = self.choose(s)
        for _ in range(steps):
            taken.append((int(s), a))
            t, r, terminated, truncated, info = env.step(a)
            if terminated:
                target = r
            else:
                b = info["next_action"] if shaped else self.following(t)
                target = r + GAMMA * self.q[t, b]
            self.q[s, a] += 0.3 * (target - self.q[s, a])
            if terminated or truncated:
                t, _ = env.reset()
                a = self.choose(t)
            else:
                a = b if self.rule == "sarsa" else self.choose(t)
            s = t
        return taken


@pytest.mark.parametrize("rule", ["sarsa", "q_learning"])
@pytest.mark.parametrize("task", [triangle(discount=GAMMA).tasks[3], small_task()])
def test_look_ahead_advice_is_initialisation(task, rule):
    # Wiewiora (2003): the same actions at every step, and tables that differ by Phi.
    phi = np.random.default_rng(2).normal(size=(task.n_states, task.n_actions))
    phi[task.terminal] = 0

    def environment():
        return gymnasium.wrappers.TimeLimit(TabularEnv(task), 25)

    begun = Agent(phi, np.zeros_like(phi), rule, np.random.default_rng(3))
    advised = Agent(np.zeros_like(phi), phi, rule, np.random.default_rng(3))
    plain = begun.run(environment(), 2000, shaped=False)
    shaped_env = PotentialShaping(environment(), phi, GAMMA, advised.following)
    assert advised.run(shaped_env, 2000, shaped=True) == plain
    np.testing.assert_allclose(advised.q + phi, begun.q, atol=1e-10)
    assert len(set(plain)) > 5


def test_by_hand_on_frozen_lake():
    env = gymnasium.make("FrozenLake-v1", is_slippery=False)
    phi = np.arange(16.0)
    shaped = PotentialShaping(env, lambda s: phi[s], 0.5)
    shaped.reset(seed=0)
    rewards = [shaped.step(a)[1] for a in (2, 2, 1, 1, 1, 2)]  # 0 1 2 6 10 14 15, the goal
    np.testing.assert_allclose(rewards, [0.5, 0, 1, -1, -3, 1 - 14])


def test_a_truncated_episode_keeps_the_potential_of_its_last_state():
    env = gymnasium.make("FrozenLake-v1", is_slippery=False, max_episode_steps=1)
    shaped = PotentialShaping(env, np.arange(16.0), 0.5)
    shaped.reset(seed=0)
    _, reward, terminated, truncated, _ = shaped.step(2)
    assert (reward, terminated, truncated) == (0.5, False, True)


def test_continuous_observations():
    env = PotentialShaping(gymnasium.make("Pendulum-v1"), lambda o: float(o[0]), 0.99)
    first, _ = env.reset(seed=1)
    second, reward, *_, info = env.step(np.zeros(1))
    assert info["shaping"] == pytest.approx(0.99 * second[0] - first[0])
    plain = gymnasium.make("Pendulum-v1")
    plain.reset(seed=1)
    assert reward - info["shaping"] == pytest.approx(plain.step(np.zeros(1))[1])


def test_bad_potentials_are_refused():
    env = gymnasium.make("FrozenLake-v1")
    with pytest.raises(ValueError, match=r"shape \(15,\), but .* in Discrete\(16\)"):
        PotentialShaping(env, np.zeros(15), 0.9)
    with pytest.raises(ValueError, match=r"discount is 1\.5"):
        PotentialShaping(env, np.zeros(16), 1.5)
    shaped = PotentialShaping(env, lambda s: np.nan, 0.9)
    shaped.reset(seed=0)
    with pytest.raises(ValueError, match="potential is nan"):
        shaped.step(0)
    with pytest.raises(ValueError, match="or a function where they are not counted"):
        PotentialShaping(gymnasium.make("Pendulum-v1"), np.zeros(3), 0.9)
    with pytest.raises(ValueError, match=r"shape \(16, 4\), .*, or next_action for pairs"):
        PotentialShaping(env, np.zeros((16, 4)), 0.9)
    shaped = PotentialShaping(env, lambda s: np.ones(1), 0.9)
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset before the first step"):
        shaped.step(0)
    shaped.reset(seed=0)
    with pytest.raises(ValueError, match=r"is \[1.\] at \(0,\), but it must be one finite number"):
        shaped.step(0)
