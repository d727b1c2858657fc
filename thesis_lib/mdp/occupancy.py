r"""Where a policy spends its time: stationary and occupation distributions (section 3.3.6)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from thesis_lib.arrays import BoolArray, FloatArray
from thesis_lib.mdp.checks import policy_matrix
from thesis_lib.mdp.model import MDP, TabularMDP


def transition_matrix(mdp: MDP, policy: ArrayLike) -> FloatArray:
    r"""Transition matrix of the Markov chain that a policy makes of a task.

    Parameters
    ----------
    mdp
        The task.
    policy
        Actions, shape ``(S,)``, or action probabilities, shape ``(S, A)``.

    Returns
    -------
    FloatArray
        :math:`P_\pi(s, s') = \sum_a \pi(s, a) P^{sas'}`, shape ``(S, S)``.
    """
    pi = policy_matrix(policy, mdp)
    if isinstance(mdp, TabularMDP):
        return np.einsum("sa,sat->st", pi, mdp.transition)
    listed = mdp.outcomes()
    S = mdp.n_states
    weight = (pi[:, :, None] * listed.probability).ravel()
    row = np.repeat(np.arange(S), weight.size // S)
    return sparse.coo_array((weight, (row, listed.successor.ravel())), shape=(S, S)).toarray()


def stationary_distribution(mdp: MDP, policy: ArrayLike) -> FloatArray:
    """Long-run fraction of time that a policy spends in each state (option 1 of section 3.3.6).

    An episodic task is restarted from its start distribution whenever it ends, so its
    distribution is over non-terminal states: the expected visits of an episode, normalised.
    Where the chain has several closed sets of states, what counts is the one that it
    ends up in from the start, each by its probability.

    Parameters
    ----------
    mdp
        The task.
    policy
        Actions, shape ``(S,)``, or action probabilities, shape ``(S, A)``.

    Returns
    -------
    FloatArray
        Shape ``(S,)``, sums to 1; 0 in terminal and transient states.
    """
    going_on = ~mdp.terminal
    P = transition_matrix(mdp, policy)[going_on]
    start = _start(mdp)[going_on]
    chain = P[:, going_on] + np.outer(P[:, mdp.terminal].sum(axis=1), start)
    share = np.zeros(len(chain))
    n_sets, label = connected_components(sparse.csr_array(chain), connection="strong")
    member = label[:, None] == np.arange(n_sets)
    leaves = np.array([chain[np.ix_(m, ~m)].any() for m in member.T])
    transient = leaves[label]
    entered = (
        start[~transient] + _visits(chain, start, transient) @ chain[np.ix_(transient, ~transient)]
    )
    arrival = np.zeros(len(chain))
    arrival[~transient] = entered
    for m in member.T[~leaves]:
        mass = arrival[m].sum()
        if mass > 0:
            share[m] = mass * _invariant(chain[np.ix_(m, m)])
    out = np.zeros(mdp.n_states)
    out[going_on] = share / share.sum()
    return out


def _visits(chain: FloatArray, start: FloatArray, inside: BoolArray) -> FloatArray:
    """Expected visits to the states ``inside`` before the chain leaves them for good."""
    within = chain[np.ix_(inside, inside)]
    solved = np.linalg.solve(np.eye(len(within)) - within.T, start[inside])
    return np.asarray(solved, dtype=np.float64)


def _invariant(chain: FloatArray) -> FloatArray:
    """The invariant distribution of an irreducible chain, shape ``(n,)``.

    Adding the constant 1/n to each entry of the singular system p (I - P) = 0 makes it
    regular and fixes the sum of p to 1.
    """
    n = len(chain)
    p = np.linalg.solve(np.eye(n) - chain.T + 1 / n, np.full(n, 1 / n))
    # Rounding may leave -1e-19 where the true probability is tiny.
    p = np.maximum(p, 0.0)
    return p / p.sum()


def average_reward(mdp: MDP, policy: ArrayLike) -> float:
    """Long-run reward a step of a policy; an episodic task is restarted when it ends.

    Parameters are those of :func:`stationary_distribution`.
    """
    pi = policy_matrix(policy, mdp)
    return float(stationary_distribution(mdp, pi) @ (pi * mdp.reward).sum(axis=1))


def _start(mdp: MDP) -> FloatArray:
    """The start distribution, which must leave terminal states out."""
    ended = mdp.terminal & (mdp.start > 0)
    if ended.any():
        raise ValueError(
            f"start gives terminal state {int(np.argmax(ended))} a positive probability, but an "
            "episode must start in a non-terminal state."
        )
    return mdp.start
