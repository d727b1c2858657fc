"""Q-learning on an abstract table: states that an abstraction merges share their values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import FloatArray
from thesis_lib.checks import generator, positive_integer
from thesis_lib.compiled import njit
from thesis_lib.mdp.checks import require_mdp, schedule, table
from thesis_lib.mdp.greedy import tie_tolerance
from thesis_lib.mdp.learning import _choose, _first_state
from thesis_lib.mdp.model import MDP
from thesis_lib.mdp.sampling import draw, sampler


@dataclass(frozen=True, eq=False)
class AggregatedLearned:
    """What a learner on an abstract table knows at the end, and what it earned.

    Attributes
    ----------
    q
        Learned values, shape ``(Z, A)``.
    total_reward
        Sum of all rewards, the task's own.
    rewards
        Reward of each stretch of ``every`` steps, shape ``(steps // every,)``.
    """

    q: FloatArray
    total_reward: float
    rewards: FloatArray


def learn_aggregated(
    mdp: MDP,
    labels: ArrayLike,
    *,
    alpha: float,
    epsilon: float,
    steps: int,
    every: int,
    rng: np.random.Generator | int,
    potential: ArrayLike | None = None,
) -> AggregatedLearned:
    r"""Learn a task by Q-learning with one value for all states of a cell (algorithm 4).

    The agent acts epsilon-greedily with respect to :math:`Q(z(s), a) + \Phi(s, a)`, with z
    the cell of a state, and updates the cell.  The value function and the potential may
    thus rest on different features of a state: the first on task-relevant, the second on
    domain-relevant ones.  With cells of one state each this is
    :func:`~thesis_lib.mdp.learning.learn` with the same seed, to the last bit.

    Parameters
    ----------
    mdp
        The task.
    labels
        Cell of each state, shape ``(S,)``, numbered from 0.
    alpha, epsilon
        Learning rate and probability of a random action.
    steps
        Number of steps; episodes follow one another.
    every
        Length of the stretches whose rewards are noted.
    rng
        Generator or seed.
    potential
        :math:`\Phi`, shape ``(S, A)``, look-ahead advice as in ``learn``; default 0.

    Raises
    ------
    ValueError
        When a shape or a number is out of range.

    Notes
    -----
    Source: section 4.1.1, after equation 4.9.
    """
    require_mdp(mdp)
    z = np.require(labels, np.int64, ["C", "W"])
    if z.shape != (mdp.n_states,) or z.min() < 0:
        raise ValueError(
            f"labels has shape {z.shape}, but one cell number of at least 0 for each of the "
            f"{mdp.n_states} states is needed."
        )
    n_steps, stretch = positive_integer("steps", steps), positive_integer("every", every)
    shape = (mdp.n_states, mdp.n_actions)
    phi = np.zeros(shape) if potential is None else table("potential", potential, mdp)
    source = sampler(mdp)
    q = np.zeros((int(z.max()) + 1, mdp.n_actions))
    rewards = np.zeros(-(-n_steps // stretch))
    _learn_cells(
        *source,
        float(mdp.discount),
        z,
        phi,
        q,
        float(schedule("alpha", alpha, 1, "step", zero_allowed=False)[0]),
        float(schedule("epsilon", epsilon, 1, "step", zero_allowed=True)[0]),
        tie_tolerance(source.reward, q, phi),
        n_steps,
        stretch,
        generator(rng),
        rewards,
    )
    return AggregatedLearned(q, float(rewards.sum()), rewards[: n_steps // stretch])


@njit(error_model="numpy")
def _learn_cells(  # type: ignore[no-untyped-def]
    successor, cumulative, reward, terminal, start, start_cumulative, discount,
    z, phi, q, alpha, epsilon, tie, n_steps, every, rng, rewards,
):  # fmt: skip
    """Run the loop; ``advised`` holds Q + Phi of the state at hand in its one row."""
    A = q.shape[1]
    advised = np.empty((1, A))
    s = _first_state(start, start_cumulative, rng)
    for b in range(A):
        advised[0, b] = q[z[s], b] + phi[s, b]
    a = _choose(advised, 0, epsilon, False, tie, rng.random())
    for t in range(n_steps):
        k = 0
        if cumulative[s, a, 0] < 1.0:
            k = draw(cumulative[s, a], rng.random())
        s_next = successor[s, a, k]
        done = terminal[s_next]
        value = gain = 0.0
        if not done:
            best = 0
            for b in range(1, A):
                if q[z[s_next], b] + phi[s_next, b] > q[z[s_next], best] + phi[s_next, best]:
                    best = b
            value, gain = q[z[s_next], best], phi[s_next, best]
        r = reward[s, a, k]
        delta = r + (discount * gain - phi[s, a]) + discount * value - q[z[s], a]
        q[z[s], a] += alpha * delta
        rewards[t // every] += r
        s = _first_state(start, start_cumulative, rng) if done else s_next
        for b in range(A):
            advised[0, b] = q[z[s], b] + phi[s, b]
        a = _choose(advised, 0, epsilon, False, tie, rng.random())
