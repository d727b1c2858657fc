"""Following a fixed policy: Monte Carlo returns and single trajectories."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.checks import generator, positive_integer
from thesis_lib.compiled import njit
from thesis_lib.mdp.checks import policy_matrix
from thesis_lib.mdp.evaluation import ends
from thesis_lib.mdp.model import MDP
from thesis_lib.mdp.sampling import cumulative, draw, sampler


@dataclass(frozen=True, eq=False)
class Simulated:
    r"""Episodes of a fixed policy.

    Attributes
    ----------
    returns
        Discounted return :math:`\sum_t \gamma^t r_t` of each episode, shape ``(E,)``.
    total_rewards
        Undiscounted sum of its rewards, shape ``(E,)``.
    lengths
        Its number of steps, shape ``(E,)``.
    visits
        How often each pair was taken, shape ``(S, A)``.
    """

    returns: FloatArray
    total_rewards: FloatArray
    lengths: IntArray
    visits: IntArray


class Trajectory(NamedTuple):
    """One episode: states ``(T + 1,)``, actions ``(T,)`` and rewards ``(T,)``."""

    states: IntArray
    actions: IntArray
    rewards: FloatArray


def simulate(
    mdp: MDP,
    policy: ArrayLike,
    *,
    episodes: int,
    rng: np.random.Generator | int,
    max_episode_steps: int | None = None,
) -> Simulated:
    """Follow a policy for a number of episodes.

    Parameters
    ----------
    mdp
        The task.
    policy
        Actions, shape ``(S,)``, or action probabilities, shape ``(S, A)``.
    episodes
        Number of episodes E.
    rng
        Generator or seed.
    max_episode_steps
        Where an episode is cut off; needed if the policy might never end.

    Returns
    -------
    Simulated
        Returns, lengths and visits.

    Raises
    ------
    ValueError
        When an argument is malformed, or episodes might never end and are not cut off.

    Examples
    --------
    >>> from thesis_lib.domains import episodic_cliff
    >>> from thesis_lib.mdp import solve
    >>> task = episodic_cliff().tasks[0]
    >>> simulate(task, solve(task).greedy, episodes=3, rng=0).lengths.tolist()
    [5, 5, 5]
    """
    chances = _chances(mdp, policy, max_episode_steps)
    n = positive_integer("episodes", episodes)
    source = sampler(mdp)
    sums = np.empty((n, 2))
    lengths = np.empty(n, np.int64)
    visits = np.zeros((mdp.n_states, mdp.n_actions), np.int64)
    _simulate(
        source.successor,
        source.cumulative,
        source.reward,
        source.terminal,
        source.start,
        source.start_cumulative,
        mdp.discount,
        chances,
        max_episode_steps or 0,
        sums,
        lengths,
        visits,
        generator(rng),
    )
    return Simulated(sums[:, 0].copy(), sums[:, 1].copy(), lengths, visits)


def follow(
    mdp: MDP,
    policy: ArrayLike,
    *,
    rng: np.random.Generator | int,
    max_steps: int | None = None,
) -> Trajectory:
    """Follow a policy for one episode and keep the trajectory.

    Parameters
    ----------
    mdp
        The task.
    policy
        Actions, shape ``(S,)``, or action probabilities, shape ``(S, A)``.
    rng
        Generator or seed.
    max_steps
        Where the episode is cut off; needed if the policy might never end.

    Returns
    -------
    Trajectory
        States, actions and rewards, drawn as :func:`simulate` draws them.

    Raises
    ------
    ValueError
        When an argument is malformed, or the episode might never end and is not cut off.
    """
    chances = _chances(mdp, policy, max_steps)
    source, rng = sampler(mdp), generator(rng)

    def pick(row: FloatArray) -> int:
        return int(draw(row, rng.random())) if row[0] < 1.0 else 0

    states = [int(source.start[pick(source.start_cumulative)])]
    actions: list[int] = []
    rewards: list[float] = []
    while not mdp.terminal[states[-1]] and (max_steps is None or len(actions) < max_steps):
        s = states[-1]
        a = pick(chances[s])
        k = pick(source.cumulative[s, a])
        actions.append(a)
        rewards.append(float(source.reward[s, a, k]))
        states.append(int(source.successor[s, a, k]))
    return Trajectory(
        np.array(states), np.array(actions, dtype=np.int64), np.array(rewards, dtype=np.float64)
    )


def _chances(mdp: MDP, policy: ArrayLike, cap: int | None) -> FloatArray:
    """Cumulative action probabilities, once it is sure that an episode ends."""
    pi = policy_matrix(policy, mdp)
    if cap is not None:
        positive_integer("the longest episode", cap)
    elif not ends(mdp, pi).all():
        raise ValueError(
            f"from state {int(np.argmin(ends(mdp, pi)))} the policy never reaches a terminal "
            "state; say after how many steps an episode is to be cut off."
        )
    return cumulative(pi)


@njit()
def _simulate(  # type: ignore[no-untyped-def]
    successor,
    outcome_chances,
    reward,
    terminal,
    start,
    start_chances,
    discount,
    action_chances,
    cap,
    sums,
    lengths,
    visits,
    rng,
):
    """Fill ``sums`` with discounted and plain returns, ``lengths`` and ``visits``."""
    for episode in range(lengths.shape[0]):
        s = start[0] if start_chances[0] >= 1.0 else start[draw(start_chances, rng.random())]
        weight, earned, total, t = 1.0, 0.0, 0.0, 0
        going_on = True
        while going_on:
            a, k = 0, 0
            if action_chances[s, 0] < 1.0:
                a = draw(action_chances[s], rng.random())
            if outcome_chances[s, a, 0] < 1.0:
                k = draw(outcome_chances[s, a], rng.random())
            visits[s, a] += 1
            earned += weight * reward[s, a, k]
            total += reward[s, a, k]
            weight *= discount
            s = successor[s, a, k]
            t += 1
            going_on = not terminal[s] and t != cap
        sums[episode, 0] = earned
        sums[episode, 1] = total
        lengths[episode] = t
