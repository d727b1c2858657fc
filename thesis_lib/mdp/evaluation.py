r"""Exact values of a policy by solving the linear Bellman equation (section 2.3.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse.linalg import LinearOperator, gmres

from thesis_lib.arrays import BoolArray, FloatArray, IntArray
from thesis_lib.mdp.checks import policy_matrix
from thesis_lib.mdp.model import MDP, TabularMDP

KRYLOV_VECTORS = 60
ROUNDS = 30
ROUNDING = 1e-13
"""Relative residual at which an iterative solution is as good as a direct one."""


@dataclass(frozen=True, eq=False)
class Values:
    r"""Value functions of a policy.

    Attributes
    ----------
    q
        :math:`Q^\pi`, shape ``(S, A)``; 0 in terminal states.
    v
        :math:`V^\pi`, shape ``(S,)``; 0 in terminal states.
    """

    q: FloatArray
    v: FloatArray


def evaluate(mdp: MDP, policy: ArrayLike) -> Values:
    r"""Exact value functions of a policy (eq. 2.5, 2.6).

    Solves :math:`(I - \gamma P_\pi) v = r_\pi` over the non-terminal states: directly for
    a :class:`TabularMDP`, and for other tasks by GMRES, which asks only for
    :meth:`MDP.expectation`, until the residual is at the level of rounding.

    Parameters
    ----------
    mdp
        The task.
    policy
        Actions, shape ``(S,)``, or action probabilities, shape ``(S, A)``.

    Returns
    -------
    Values
        :math:`Q^\pi` and :math:`V^\pi`.

    Raises
    ------
    ValueError
        When the policy is malformed, or when the discount is 1 and from some state the
        policy never reaches a terminal state, so that its value is not finite.
    """
    pi = policy_matrix(policy, mdp)
    going_on = ~mdp.terminal
    if mdp.discount == 1.0:
        require_proper(mdp, pi)
    v = np.zeros(mdp.n_states)
    if going_on.any():
        expected = (pi * mdp.reward).sum(axis=1)[going_on]
        if isinstance(mdp, TabularMDP):
            within = np.einsum("sa,sat->st", pi[going_on], mdp.transition[going_on])[:, going_on]
            v[going_on] = np.linalg.solve(np.eye(len(within)) - mdp.discount * within, expected)
        else:
            v[going_on] = _iterate(mdp, pi, going_on, expected)
    q = mdp.lookahead(v)
    q[mdp.terminal] = 0.0
    return Values(q, v)


def _iterate(mdp: MDP, pi: FloatArray, going_on: BoolArray, expected: FloatArray) -> FloatArray:
    """Solve the Bellman equation of a policy by GMRES with iterative refinement."""
    full = np.zeros(mdp.n_states)

    def apply(x: FloatArray) -> FloatArray:
        full[going_on] = x
        follow = (pi * mdp.expectation(full)).sum(axis=1)
        return x - mdp.discount * follow[going_on]

    n = len(expected)
    operator = LinearOperator((n, n), matvec=apply, dtype=np.float64)
    x = np.zeros(n)
    residual, previous = expected, np.inf
    for _ in range(ROUNDS):
        error = float(np.abs(residual).max())
        scale = max(float(np.abs(expected).max()), float(np.abs(x).max()))
        # Refinement that gains nothing has reached the rounding of the expectation itself.
        if error <= ROUNDING * scale or (error <= 1e-9 * scale and error > previous / 2):
            return x
        step, _ = gmres(operator, residual, rtol=1e-10, restart=min(n, KRYLOV_VECTORS), maxiter=20)
        x = x + step
        residual, previous = expected - apply(x), error
    raise RuntimeError(
        f"the value of the policy did not converge: its Bellman residual is {error:.3g} after "
        f"{ROUNDS} rounds of GMRES; the policy takes extremely long to end."
    )


def start_value(mdp: MDP, policy: ArrayLike) -> float:
    r"""Expected return :math:`\sum_s p(s_0 = s) V^\pi(s)` of a policy from the start.

    Parameters and errors are those of :func:`evaluate`.

    Examples
    --------
    >>> from thesis_lib.domains import episodic_cliff
    >>> from thesis_lib.mdp import soft_policy_iteration
    >>> task = episodic_cliff().tasks[0]
    >>> soft = soft_policy_iteration(task, epsilon=0.1)
    >>> round(start_value(task, soft.policy), 2)  # exploring beside a cliff costs
    -38.38
    """
    return float(mdp.start @ evaluate(mdp, policy).v)


def ends(mdp: MDP, pi: FloatArray) -> BoolArray:
    """From which states a policy can reach a terminal state.

    Parameters
    ----------
    mdp
        The task.
    pi
        Action probabilities, shape ``(S, A)``.

    Returns
    -------
    BoolArray
        Shape ``(S,)``; True for terminal states.  If all are True, the policy is proper: it
        ends with probability 1 from everywhere.
    """
    reached = mdp.terminal.copy()
    while True:
        chance = (pi * mdp.expectation(reached.astype(np.float64))).sum(axis=1)
        grown = reached | (chance > 0)
        if (grown == reached).all():
            return reached
        reached = grown


def require_proper(mdp: MDP, pi: FloatArray) -> None:
    """Raise ValueError when a policy may go on for ever from some state."""
    stuck = ~ends(mdp, pi)
    if stuck.any():
        raise ValueError(
            f"from state {int(np.argmax(stuck))} ({int(stuck.sum())} such states) the policy "
            "never reaches a terminal state, so with discount 1 its value is not finite; take a "
            "discount below 1 or a policy that ends."
        )


def proper_policy(mdp: MDP) -> IntArray:
    """A policy that ends from every state: each action may lead a step closer to the end.

    Parameters
    ----------
    mdp
        An episodic task.

    Returns
    -------
    IntArray
        Actions, shape ``(S,)``; 0 in terminal states.

    Raises
    ------
    ValueError
        When no terminal state can be reached from some state.
    """
    actions = np.zeros(mdp.n_states, dtype=np.int64)
    reached = mdp.terminal.copy()
    while not reached.all():
        leads = mdp.expectation(reached.astype(np.float64)) > 0
        new = leads.any(axis=1) & ~reached
        if not new.any():
            raise ValueError(
                f"from state {int(np.argmin(reached))} no policy reaches a terminal state, so with "
                "discount 1 values are not finite; take a discount below 1."
            )
        actions[new] = leads[new].argmax(axis=1)
        reached |= new
    return actions
