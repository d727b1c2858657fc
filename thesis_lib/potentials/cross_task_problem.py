"""How good one policy is for all tasks of a domain: its exact value and gradient (eq. 3.9)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from scipy import special

from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.checks import one_of
from thesis_lib.compiled import njit
from thesis_lib.domains.domain import Domain, check_policies
from thesis_lib.mdp.model import ATOL, MDP

Objective = Literal["start", "stationary"]
OBJECTIVES: tuple[str, ...] = ("start", "stationary")

HORIZON = 1e12
"""With a discount of 1 a policy that never ends an episode has no value; counting no more
than about this many steps gives it a very low one and changes others by one part in
HORIZON for every step of an episode."""


def softmax_policy(preferences: FloatArray) -> FloatArray:
    """Policy from preferences: a softmax over the last axis (footnote 2)."""
    return special.softmax(preferences, axis=-1)


@dataclass(frozen=True, eq=False)
class CrossTaskProblem:
    r"""Exact value of cross-task policies in one domain.

    Parameters
    ----------
    domain
        The domain; its transition matrices are held densely, so its tasks must be small.
    objective
        What :math:`\mu^*` maximises.  ``"start"``: equation 3.9 with the start-state
        distribution, :math:`\sum_m D(m) \sum_s p(s_0 = s|m) V_m^\mu(s)`.
        ``"stationary"``: equation 3.11, which weights states by how often the policy is
        in them, :math:`\sum_m D(m) \sum_s p(s|m, \mu) V_m^\mu(s)`; in a continuing task
        this is the average reward divided by :math:`1 - \gamma`, and in an episodic one
        p(s|m, mu) is the share of time spent in s when episodes follow one another.

    Raises
    ------
    ValueError
        When there is no such objective, or it is ``"stationary"`` and a task ends up in one
        of several sets of states that no policy leaves.

    Notes
    -----
    Arrays over a task's members are padded to the largest task; a padding state ends the
    episode with reward 0 and is never reached.
    """

    domain: Domain
    objective: Objective = "start"
    _transition: FloatArray = field(init=False, repr=False)
    _reward: FloatArray = field(init=False, repr=False)
    _start: FloatArray = field(init=False, repr=False)
    _index: IntArray = field(init=False, repr=False)
    _discount: float = field(init=False, repr=False)
    _first: IntArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        one_of("objective", self.objective, OBJECTIVES)
        domain = self.domain
        n_tasks, n_actions = len(domain), len(domain.actions)
        size = int(domain.present.sum(axis=1).max())
        transition = np.zeros((n_tasks, size, n_actions, size))
        reward = np.zeros((n_tasks, size, n_actions))
        start = np.zeros((n_tasks, size))
        index = np.zeros((n_tasks, size), dtype=np.int64)
        for m, (task, observed) in enumerate(
            zip(domain.tasks, domain.observation_index, strict=True)
        ):
            inside = np.flatnonzero(observed >= 0)
            n = len(inside)
            # What leaves the members is an episode's end, worth 0.
            transition[m, :n, :, :n] = dense(task)[inside][:, :, inside]
            reward[m, :n] = task.reward[inside]
            start[m, :n] = task.start[inside]
            index[m, :n] = observed[inside]
        for name, value in (
            ("_transition", transition),
            ("_reward", reward),
            ("_start", start),
            ("_index", index),
            ("_discount", min(domain.discount, 1.0 - 1.0 / HORIZON)),
        ):
            object.__setattr__(self, name, value)
        first = np.zeros(n_tasks, dtype=np.int64)
        if self.objective == "stationary":
            first = self._recurrent(np.full(domain.shape, 1.0 / n_actions))
        object.__setattr__(self, "_first", first)

    def value(self, policy: FloatArray) -> FloatArray:
        """The objective of one policy or of a batch of them.

        Parameters
        ----------
        policy
            Shape ``(..., O, A)``, rows summing to 1.

        Returns
        -------
        FloatArray
            Shape ``(...)``.

        Raises
        ------
        ValueError
            When it is no policy of the domain, or the objective is stationary and the policy
            ends up in one of several sets of states that it never leaves.
        """
        mu = np.ascontiguousarray(check_policies(self.domain, policy))
        flat = mu.reshape(-1, *self.domain.shape)
        first = np.tile(self._first, (len(flat), 1))
        if self.objective == "stationary":
            for b in np.flatnonzero((flat == 0.0).any(axis=(1, 2))):
                first[b] = self._recurrent(flat[b])
        values = _objective(
            flat,
            self._transition,
            self._reward,
            self._start,
            self._index,
            self.domain.distribution,
            self._discount,
            first,
            self.objective == "stationary",
        )
        return np.asarray(values.reshape(mu.shape[:-2]))

    def state_distribution(self, policy: FloatArray) -> FloatArray:
        """Share of time p(s|m, mu) spent in each member state, shape ``(..., M, S)``.

        Unique for a policy that has one set of states in each task which it never leaves.
        """
        return self._shares(self._under(policy)[0])

    def _shares(self, chain: FloatArray) -> FloatArray:
        recurrent = self._restarted(chain)
        size = chain.shape[-1]
        # Replace one balance equation by normalisation.
        system = np.eye(size) - np.swapaxes(recurrent, -1, -2)
        system[..., -1, :] = 1.0
        right = np.zeros((*chain.shape[:-1], 1))
        right[..., -1, 0] = 1.0
        return np.clip(np.linalg.solve(system, right)[..., 0], 0.0, None)

    def gradient(self, preferences: FloatArray) -> tuple[float, FloatArray]:
        r"""Objective and its exact gradient with respect to softmax preferences.

        For fixed state weights w the policy gradient theorem gives
        :math:`\partial J / \partial \mu(s, a) = u(s) Q(s, a)` with the discounted visits
        :math:`u = (I - \gamma P_\mu^T)^{-1} w`.  The stationary weights move with the
        policy as well, which adds :math:`w(s) \sum_{s'} P(s, a, s') h(s')` with
        :math:`h = (I - P_\mu + 1 w^T)^{-1} V`, P including the restart at an episode's end.

        Parameters
        ----------
        preferences
            Shape ``(O, A)``; the policy is their softmax.

        Returns
        -------
        tuple[float, FloatArray]
            The value, and the gradient of shape ``(O, A)``.
        """
        policy = softmax_policy(preferences)
        chain, reward = self._under(policy)
        eye = np.eye(chain.shape[-1])
        system = eye - self._discount * chain
        values = np.linalg.solve(system, reward[..., None])[..., 0]
        weights = self._start if self.objective == "start" else self._shares(chain)
        visits = np.linalg.solve(np.swapaxes(system, -1, -2), weights[..., None])[..., 0]
        onward = np.einsum("msat,mt->msa", self._transition, values)
        slope = visits[..., None] * (self._reward + self._discount * onward)
        if self.objective == "stationary":
            spread = eye - self._restarted(chain) + weights[:, None, :]
            bias = np.linalg.solve(spread, values[..., None])[..., 0]
            leave = 1.0 - self._transition.sum(-1)
            restart = (self._start * bias).sum(-1)[:, None, None]
            next_bias = np.einsum("msat,mt->msa", self._transition, bias) + leave * restart
            slope = slope + weights[..., None] * next_bias
        total = np.zeros(self.domain.shape)
        np.add.at(total, self._index, self.domain.distribution[:, None, None] * slope)
        centred = total - (policy * total).sum(-1, keepdims=True)
        value = float((self.domain.distribution * (weights * values).sum(-1)).sum())
        return value, policy * centred

    def _recurrent(self, policy: FloatArray) -> IntArray:
        """The first member of each task that one policy always comes back to, shape ``(M,)``."""
        chain, _ = self._under(policy)
        ends = 1.0 - chain.sum(-1) > ATOL
        begins = self._start > 0
        reach = (
            (chain > 0) | (ends[..., None] & begins[:, None]) | np.eye(chain.shape[-1], dtype=bool)
        )
        for _ in range(chain.shape[-1].bit_length()):
            steps = reach.astype(np.float32)
            reach = steps @ steps > 0
        recurs = (reach & begins[..., None]).any(axis=1)
        recurs &= ~(reach & ~np.swapaxes(reach, -1, -2)).any(axis=-1)
        first = recurs.argmax(axis=-1)
        several = (recurs & ~reach[np.arange(len(first)), first]).any(axis=-1)
        if several.any():
            raise ValueError(
                f"in task {self.domain.task_names[several.argmax()]!r} a policy ends up in one of "
                "several sets of states that it never leaves, so it has no one stationary "
                "distribution; choose the objective 'start'."
            )
        return first

    def _under(self, policy: FloatArray) -> tuple[FloatArray, FloatArray]:
        mu = policy[..., self._index, :]
        chain = np.einsum("...msa,msat->...mst", mu, self._transition)
        return chain, (mu * self._reward).sum(-1)

    def _restarted(self, chain: FloatArray) -> FloatArray:
        leave = 1.0 - chain.sum(-1)
        return chain + leave[..., None] * self._start[:, None, :]


@njit()
def _objective(mu, transition, reward, start, index, distribution, discount, first, stationary):  # type: ignore[no-untyped-def]
    """Objective of a batch of policies, shape ``(B,)``, by elimination in every task.

    I - gamma P is diagonally dominant, so elimination needs no pivots; the stationary
    distribution is eliminated by Grassmann, Taksar and Heyman's rule, which subtracts
    nothing and so keeps its precision however rarely a state is left.  A loop from 0 over an
    array of its own is done several numbers at a time: so ``pivot``, and whole rows, though
    nothing left of the diagonal is read again.
    """
    n_policies = mu.shape[0]
    n_tasks, S, A, _ = transition.shape
    totals = np.zeros(n_policies)
    chain = np.empty((S, S))
    system = np.empty((S, S))
    value = np.empty(S)
    weight = np.empty(S)
    pivot = np.empty(S)
    for b in range(n_policies):
        for m in range(n_tasks):
            chain[:] = 0.0
            for s in range(S):
                value[s] = 0.0
                for a in range(A):
                    p = mu[b, index[m, s], a]
                    value[s] += p * reward[m, s, a]
                    for t in range(S):
                        chain[s, t] += p * transition[m, s, a, t]
            for s in range(S):
                for t in range(S):
                    system[s, t] = -discount * chain[s, t]
                system[s, s] += 1.0
            for k in range(S):
                for t in range(S):
                    pivot[t] = system[k, t]
                for s in range(k + 1, S):
                    if system[s, k] != 0.0:
                        factor = system[s, k] / pivot[k]
                        for t in range(S):
                            system[s, t] -= factor * pivot[t]
                        value[s] -= factor * value[k]
            for k in range(S - 1, -1, -1):
                for t in range(k + 1, S):
                    value[k] -= system[k, t] * value[t]
                value[k] /= system[k, k]
            if stationary:
                for s in range(S):
                    stay = 0.0
                    for t in range(S):
                        stay += chain[s, t]
                    for t in range(S):
                        chain[s, t] += (1.0 - stay) * start[m, t]
                # The elimination ends at member 0, which must be one that recurs.
                root = first[b, m]
                if root > 0:
                    _swap(chain, root)
                _stationary(chain, weight, pivot)
                if root > 0:
                    weight[0], weight[root] = weight[root], weight[0]
            else:
                weight[:] = start[m]
            total = 0.0
            for s in range(S):
                total += weight[s] * value[s]
            totals[b] += distribution[m] * total
    return totals


@njit()
def _swap(chain, k):  # type: ignore[no-untyped-def]
    """Let states 0 and k of a chain change places."""
    for t in range(chain.shape[0]):
        chain[0, t], chain[k, t] = chain[k, t], chain[0, t]
    for s in range(chain.shape[0]):
        chain[s, 0], chain[s, k] = chain[s, k], chain[s, 0]


@njit()
def _stationary(chain, weight, pivot):  # type: ignore[no-untyped-def]
    """Stationary distribution of a chain in which state 0 recurs, written to ``weight``.

    The others are overwritten.
    """
    S = chain.shape[0]
    for k in range(S - 1, 0, -1):
        leave = 0.0
        for t in range(k):
            pivot[t] = chain[k, t]
            leave += pivot[t]
        if leave > 0.0:
            for s in range(k):
                chain[s, k] /= leave
        else:
            for s in range(k):
                chain[s, k] = 0.0
        for s in range(k):
            share = chain[s, k]
            if share != 0.0:
                for t in range(k):
                    chain[s, t] += share * pivot[t]
    weight[0] = 1.0
    total = 1.0
    for k in range(1, S):
        weight[k] = 0.0
        for s in range(k):
            weight[k] += weight[s] * chain[s, k]
        total += weight[k]
    for k in range(S):
        weight[k] /= total


def dense(task: MDP) -> FloatArray:
    """Transition matrix of a task of any kind, shape ``(S, A, S)``, from its outcomes."""
    outcomes = task.outcomes()
    matrix = np.zeros((task.n_states, task.n_actions, task.n_states))
    s, a, _ = np.indices(outcomes.successor.shape)
    np.add.at(matrix, (s, a, outcomes.successor), outcomes.probability)
    return matrix
