r"""Dynamic programming: policy iteration, value iteration and their soft form (section 2.3.2).

:func:`policy_iteration` and :func:`value_iteration` are algorithms 1 and 2 as printed,
with their history.  :func:`solve` and :func:`soft_policy_iteration` give exact
solutions: they evaluate each policy by a linear solve instead of sweeps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.checks import one_of, positive_integer, positive_number, probability
from thesis_lib.compiled import njit
from thesis_lib.mdp.checks import policy_matrix, require_mdp, state_values, table
from thesis_lib.mdp.evaluation import evaluate, proper_policy, require_proper, start_value
from thesis_lib.mdp.greedy import EXPLORATIONS, Exploration, greedy_actions
from thesis_lib.mdp.model import MDP
from thesis_lib.mdp.occupancy import average_reward, stationary_distribution
from thesis_lib.mdp.sampling import loop_array

__all__ = [
    "PolicyIteration",
    "Solution",
    "ValueIteration",
    "average_reward",
    "evaluate",
    "policy_iteration",
    "soft_policy_iteration",
    "solve",
    "start_value",
    "stationary_distribution",
    "value_iteration",
]

ROUNDING = 1e-12
"""Relative improvement below which a change of action is put down to rounding."""


@dataclass(frozen=True, eq=False)
class PolicyIteration:
    r"""Result and history of algorithm 1, with I rounds of evaluation and improvement.

    Attributes
    ----------
    v, q
        Values of the last policy as the sweeps left them, shapes ``(S,)`` and ``(S, A)``.
    policy
        The last policy, shape ``(S,)``.
    policies
        The initial policy and that after each improvement, shape ``(I + 1, S)``; the last
        two are equal.
    values
        V after each evaluation, shape ``(I, S)``.
    deltas
        :math:`\Delta` of every sweep, one array a round.
    """

    v: FloatArray
    q: FloatArray
    policy: IntArray
    policies: IntArray
    values: FloatArray
    deltas: tuple[FloatArray, ...]

    @property
    def sweeps(self) -> tuple[int, ...]:
        """Number of sweeps in each round of evaluation."""
        return tuple(len(d) for d in self.deltas)

    @property
    def n_sweeps(self) -> int:
        """Number of sweeps in all."""
        return sum(self.sweeps)


@dataclass(frozen=True, eq=False)
class ValueIteration:
    r"""Result and history of algorithm 2 after n sweeps.

    Attributes
    ----------
    v, q
        Values, shapes ``(S,)`` and ``(S, A)``.
    policy
        The greedy policy, lowest action first, shape ``(S,)``.
    n_sweeps
        Number of sweeps n.
    deltas
        :math:`\Delta` of each sweep, shape ``(n,)``.
    errors
        Distance to ``optimum`` before the first and after each sweep, shape ``(n + 1,)``;
        None if it was not given.
    values
        V before the first and after each sweep, shape ``(n + 1, S)``; None unless
        ``history`` was asked for.
    """

    v: FloatArray
    q: FloatArray
    policy: IntArray
    n_sweeps: int
    deltas: FloatArray
    errors: FloatArray | None = None
    values: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Solution:
    r"""An optimal policy, among all or among the epsilon-greedy ones, and its values.

    Attributes
    ----------
    q
        :math:`Q^*` or :math:`\tilde Q`, shape ``(S, A)``; 0 in terminal states.
    v
        Value of each state under ``policy``, shape ``(S,)``.
    policy
        Action probabilities, shape ``(S, A)``.
    greedy
        The action that ``policy`` prefers, shape ``(S,)``.
    n_improvements
        Number of times the policy was improved.
    """

    q: FloatArray
    v: FloatArray
    policy: FloatArray
    greedy: IntArray
    n_improvements: int


class _Model(NamedTuple):
    """A task as the compiled sweeps read it."""

    successor: np.ndarray
    probability: np.ndarray
    reward: np.ndarray
    terminal: np.ndarray
    discount: float


def _model(mdp: MDP) -> _Model:
    listed = mdp.outcomes()
    return _Model(
        loop_array(listed.successor, np.int32),
        loop_array(listed.probability, np.float64),
        loop_array(mdp.reward, np.float64),
        loop_array(mdp.terminal, np.bool_),
        float(mdp.discount),
    )


@njit()
def _backup(model, v, s, a):  # type: ignore[no-untyped-def]
    """Expected reward and discounted next value of one pair."""
    follow = 0.0
    for k in range(model.successor.shape[2]):
        follow += model.probability[s, a, k] * v[model.successor[s, a, k]]
    return model.reward[s, a] + model.discount * follow


@njit()
def _evaluation_sweep(model, policy, v):  # type: ignore[no-untyped-def]
    """Lines 5 to 10 of algorithm 1: back up every state in place, and return Delta."""
    delta = 0.0
    for s in range(v.shape[0]):
        if not model.terminal[s]:
            new = _backup(model, v, s, policy[s])
            delta = max(delta, abs(v[s] - new))
            v[s] = new
    return delta


@njit()
def _optimality_sweep(model, v):  # type: ignore[no-untyped-def]
    """Lines 3 to 8 of algorithm 2: back up every state in place, and return Delta."""
    delta = 0.0
    for s in range(v.shape[0]):
        if not model.terminal[s]:
            new = -np.inf
            for a in range(model.reward.shape[1]):
                new = max(new, _backup(model, v, s, a))
            delta = max(delta, abs(v[s] - new))
            v[s] = new
    return delta


def policy_iteration(
    mdp: MDP,
    *,
    theta: float = 1e-8,
    initial_policy: ArrayLike | None = None,
    initial_v: ArrayLike | None = None,
    max_sweeps: int = 100_000,
) -> PolicyIteration:
    r"""Policy iteration (algorithm 1).

    Evaluation sweeps through the states in order and in place.  Improvement keeps the
    current action where it is among the best, closer than
    :func:`~thesis_lib.mdp.greedy.tie_tolerance`, and otherwise takes the lowest-numbered
    best one, so that ties cannot make it run for ever.

    Parameters
    ----------
    mdp
        The task.
    theta
        Evaluation ends with the first sweep in which no value changes by as much.
    initial_policy
        Actions, shape ``(S,)``.  Default: action 0 everywhere, or with discount 1
        :func:`~thesis_lib.mdp.evaluation.proper_policy`.  "Arbitrarily", as the thesis has
        it, will not do with discount 1: the values of a policy that never ends
        diverge, and so would line 4.
    initial_v
        V to start from, shape ``(S,)``; default 0.  Terminal states are always 0.
    max_sweeps
        Most sweeps in all.

    Returns
    -------
    PolicyIteration
        Values, policy and their history.

    Raises
    ------
    ValueError
        When an argument is out of range, or a policy never ends and the discount is 1.
    RuntimeError
        When ``max_sweeps`` do not suffice.
    """
    require_mdp(mdp)
    positive_number("theta", theta)
    positive_integer("max_sweeps", max_sweeps)
    v = np.zeros(mdp.n_states) if initial_v is None else state_values("initial_v", initial_v, mdp)
    if initial_policy is not None:
        if np.shape(initial_policy) != (mdp.n_states,):
            raise ValueError(
                f"initial_policy has shape {np.shape(initial_policy)}, but algorithm 1 starts from "
                f"one action a state, shape ({mdp.n_states},)."
            )
        policy = policy_matrix(initial_policy, mdp).argmax(axis=1)
    elif mdp.discount == 1.0:
        policy = proper_policy(mdp)
    else:
        policy = np.zeros(mdp.n_states, dtype=np.int64)
    model = _model(mdp)
    policies, values, deltas = [policy], [], []
    n_sweeps = 0
    stable = False
    while not stable:
        if mdp.discount == 1.0:
            require_proper(mdp, policy_matrix(policy, mdp))
        changes = [np.inf]
        while changes[-1] >= theta:
            if n_sweeps == max_sweeps:
                raise RuntimeError(
                    f"policy iteration is not done after {max_sweeps} sweeps: the last one changed "
                    f"a value by {changes[-1]:.3g}, above theta = {theta}; raise theta or "
                    "max_sweeps."
                )
            changes.append(_evaluation_sweep(model, policy, v))
            n_sweeps += 1
        q = mdp.lookahead(v)
        best = greedy_actions(q)
        keep = best[np.arange(mdp.n_states), policy] | mdp.terminal
        stable = bool(keep.all())
        policy = np.where(keep, policy, best.argmax(axis=1))
        deltas.append(np.array(changes[1:]))
        values.append(v.copy())
        policies.append(policy)
    q[mdp.terminal] = 0.0
    return PolicyIteration(v, q, policy, np.array(policies), np.array(values), tuple(deltas))


def value_iteration(
    mdp: MDP,
    *,
    tolerance: float = 1e-8,
    initial_v: ArrayLike | None = None,
    initial_q: ArrayLike | None = None,
    synchronous: bool = False,
    optimum: ArrayLike | None = None,
    history: bool = False,
    max_sweeps: int = 100_000,
) -> ValueIteration:
    r"""Value iteration, in place on V (algorithm 2) or synchronous on Q (theorem 1).

    The synchronous form applies :math:`Q_{n+1}(s, a) = R^{sa} + \gamma \sum_{s'} P^{sas'}
    \max_{a'} Q_n(s', a')` to all pairs at once; it is the contraction that theorem 1
    speaks of.  It needs no list of outcomes, only :meth:`MDP.expectation`.

    Parameters
    ----------
    mdp
        The task.
    tolerance
        The threshold theta: stop after the first sweep that changes no value by as much;
        with ``optimum``, stop as soon as no value is further than this from it.
    initial_v
        V to start from, shape ``(S,)``, of the in-place form; default 0.
    initial_q
        Q to start from, shape ``(S, A)``; the in-place form starts from its maximum.
        Terminal states are always 0.
    synchronous
        Whether to run the synchronous form.
    optimum
        :math:`Q^*`, shape ``(S, A)``, to measure the distance to: in the maximum norm of Q
        when synchronous, of V when in place.
    history
        Whether to keep V of every sweep.
    max_sweeps
        Most sweeps.

    Returns
    -------
    ValueIteration
        Values, the number of sweeps and their history.

    Raises
    ------
    ValueError
        When an argument is out of range or has the wrong shape.
    RuntimeError
        When ``max_sweeps`` do not suffice.
    """
    require_mdp(mdp)
    positive_number("tolerance", tolerance)
    positive_integer("max_sweeps", max_sweeps)
    if initial_v is not None and (synchronous or initial_q is not None):
        raise ValueError(
            "initial_v is for the in-place form without initial_q; give only initial_q instead."
        )
    q = np.zeros((mdp.n_states, mdp.n_actions))
    if initial_q is not None:
        q = table("initial_q", initial_q, mdp)
    v = q.max(axis=1) if initial_v is None else state_values("initial_v", initial_v, mdp)
    goal = None if optimum is None else table("optimum", optimum, mdp)
    model = None if synchronous else _model(mdp)

    def distance() -> float:
        if goal is None:
            return np.inf
        return float(np.abs(goal - q).max() if synchronous else np.abs(goal.max(axis=1) - v).max())

    def unfinished() -> bool:
        if goal is not None:
            return errors[-1] > tolerance
        return not deltas or deltas[-1] >= tolerance

    deltas: list[float] = []
    errors = [distance()]
    values = [v.copy()]
    while unfinished():
        if len(deltas) == max_sweeps:
            raise RuntimeError(
                f"value iteration is not done after {max_sweeps} sweeps: the last one changed a "
                f"value by {deltas[-1]:.3g}, and the tolerance is {tolerance}; raise the tolerance "
                "or max_sweeps, or check that the values are finite."
            )
        if model is None:
            new = mdp.lookahead(v)
            new[mdp.terminal] = 0.0
            deltas.append(float(np.abs(new - q).max()))
            q, v = new, new.max(axis=1)
        else:
            deltas.append(_optimality_sweep(model, v))
        errors.append(distance())
        if history:
            values.append(v.copy())
    if not synchronous:
        q = mdp.lookahead(v)
        q[mdp.terminal] = 0.0
    return ValueIteration(
        v=v,
        q=q,
        policy=greedy_actions(q).argmax(axis=1),
        n_sweeps=len(deltas),
        deltas=np.array(deltas),
        errors=None if goal is None else np.array(errors),
        values=np.array(values) if history else None,
    )


def solve(mdp: MDP) -> Solution:
    r"""The optimal values :math:`Q^*` (eq. 2.7), exact, by policy iteration with linear solves.

    With discount 1 this is the best of the policies that end from every state.

    Parameters
    ----------
    mdp
        The task.

    Returns
    -------
    Solution
        :math:`Q^*`, :math:`V^*` and a deterministic optimal policy.

    Raises
    ------
    ValueError
        When the discount is 1 and values are not finite.

    Examples
    --------
    >>> from thesis_lib.domains import episodic_cliff
    >>> task = episodic_cliff().tasks[0]
    >>> round(float(solve(task).v @ task.start), 6)  # five steps round the cliff
    -5.0
    """
    require_mdp(mdp)
    return soft_policy_iteration(mdp, 0.0)


def soft_policy_iteration(
    mdp: MDP, epsilon: float, *, exploration: Exploration = "all"
) -> Solution:
    r"""The best epsilon-greedy policy and its values :math:`\tilde Q` (footnote 4, section 3.4.2).

    As policy iteration, but "in the policy improvement step, the policy is made only
    epsilon-greedy".  Evaluation is a linear solve.

    An improvement changes the preferred action of a state only if another is better by
    more than rounding, and then to the lowest-numbered best one.  Every change raises the
    value of some state and lowers none, so no policy returns; should rounding make one
    return all the same, the iteration ends there.  In the resulting policy one action a
    state is preferred even where several tie; ``epsilon_greedy(q, epsilon)`` shares the
    probability among them, which changes no value if random actions are drawn from all.

    Parameters
    ----------
    mdp
        The task.
    epsilon
        Probability of a random action, in [0, 1].
    exploration
        Whether the random action is drawn from ``"all"`` actions or from the ``"others"``,
        those that are not preferred; then epsilon can be at most (A - 1) / A, unless there is
        one action, which is taken all the same.

    Returns
    -------
    Solution
        :math:`\tilde Q` and its policy.

    Raises
    ------
    ValueError
        When an argument is out of range, or the discount is 1 and values are not finite.
    """
    require_mdp(mdp)
    epsilon = probability("epsilon", epsilon)
    one_of("exploration", exploration, EXPLORATIONS)
    A = mdp.n_actions
    if exploration == "others" and A > 1 and epsilon > (A - 1) / A:
        raise ValueError(
            f"epsilon is {epsilon}, but with exploration by the other {A - 1} actions it must be "
            f"at most {(A - 1) / A:.6g}, where the preferred action is no likelier than they."
        )
    if epsilon == 0.0 and mdp.discount == 1.0:
        greedy = proper_policy(mdp)
    else:
        greedy = mdp.reward.argmax(axis=1)
    states = np.arange(mdp.n_states)
    seen: set[bytes] = set()
    while True:
        policy = _soft(greedy, A, epsilon, exploration)
        values = evaluate(mdp, policy)
        seen.add(greedy.tobytes())
        best = values.q.max(axis=1)
        least = best - ROUNDING * np.abs(values.q).max()
        better = values.q[states, greedy] < least
        improved = np.where(better, (values.q >= least[:, None]).argmax(axis=1), greedy)
        if improved.tobytes() in seen:
            return Solution(values.q, values.v, policy, greedy, len(seen) - 1)
        greedy = improved


def _soft(greedy: IntArray, A: int, epsilon: float, exploration: Exploration) -> FloatArray:
    """Make a deterministic policy epsilon-greedy, shape ``(S, A)``."""
    preferred = np.eye(A)[greedy]
    if exploration == "all" or A == 1:
        return (1 - epsilon) * preferred + epsilon / A
    return (1 - epsilon) * preferred + epsilon * (1 - preferred) / (A - 1)
