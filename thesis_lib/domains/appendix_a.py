"""The domains of appendix A: what stationary memoryless multi-task policies cannot do.

The text of appendix A describes its figures but does not carry their numbers.  Figure
A.1 is fixed by the text.  For A.2 and A.3 the transition probabilities and the rewards
below are this edition's own: the smallest we found with which every statement that the
text makes about its figures holds.  In all of them the only decision is taken in state
1, between actions A and B.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.checks import one_of, positive_number, probability
from thesis_lib.domains.domain import Domain, check_policies
from thesis_lib.mdp.model import TabularMDP
from thesis_lib.mdp.occupancy import stationary_distribution

ACTIONS = ("A", "B")

SecondTask = Literal["a", "b", "c"]
"""Variation of task 2 in figure A.2: without state 3, not ergodic, or ergodic."""

Weighting = Literal["uniform", "occupancy"]
"""p(s|m) uniform over the task's states, or the stationary distribution of the policy."""

Row = Mapping[int, float]


def _task(
    first: tuple[Row, Row],
    others: Sequence[Row],
    reward: tuple[float, float],
    discount: float,
    terminal: int | None = None,
) -> TabularMDP:
    """A task with states 1, 2, ...: where A and B lead from 1, where the others lead."""
    n = 1 + len(others)
    transition = np.zeros((n, 2, n))
    for a in range(2):
        for s, row in enumerate((first[a], *others)):
            for target, p in row.items():
                transition[s, a, target - 1] += p
    rewards = np.zeros((n, 2))
    rewards[0] = reward
    ends = np.zeros(n, dtype=bool)
    if terminal is not None:
        ends[terminal - 1] = True
    return TabularMDP(
        transition=transition,
        reward=rewards,
        start=np.eye(n)[0],
        terminal=ends,
        discount=discount,
        features={"state": np.arange(1, n + 1)},
        actions=ACTIONS,
    )


def figure_a1(penalty: float = 1.0, discount: float = 0.9) -> Domain:
    """The domain of fact 1: the best stochastic policy beats every deterministic one.

    In task 1 action A stays in state 1 at a reward of ``-penalty`` and B ends in the
    absorbing state 2; in task 2 A and B have changed places.

    Parameters
    ----------
    penalty
        R of figure A.1, above 0.
    discount
        gamma, below 1.

    Returns
    -------
    Domain
        Two equally likely tasks with one non-terminal state.
    """
    R = positive_number("penalty", penalty)
    gamma = _below_one(discount)
    stay, end = {1: 1.0}, {2: 1.0}
    return Domain(
        name="figure A.1",
        tasks=(
            _task((stay, end), [end], (-R, 0.0), gamma, terminal=2),
            _task((end, stay), [end], (0.0, -R), gamma, terminal=2),
        ),
        task_names=("task 1", "task 2"),
    )


def figure_a2(
    second: SecondTask = "a", reward: float = 1.0, discount: float = 0.9, detour: float = 0.1
) -> Domain:
    """The domains of fact 2, cases 1 to 3: no policy maximises all states at once.

    In both tasks A and B lead from state 1 to state 2, A earns nothing and B earns
    ``-reward`` in task 1 and ``+reward`` in task 2.  Task 1 goes round 1, 2, 3.  Task 2
    goes round 1 and 2, and so meets its reward more often, which is why choosing B helps
    state 1 on average.  State 3 belongs to task 1 alone (2a), is cut off in task 2 (2b),
    or is visited there seldom and left slowly (2c); so choosing B harms it.

    Parameters
    ----------
    second
        ``"a"`` (tasks with different states), ``"b"`` (task 2 not ergodic) or ``"c"``
        (both ergodic; the statement then needs a uniform p(s|m)).
    reward
        x of figure A.2, above 0.
    discount
        gamma, below 1.
    detour
        In task 2c the probability of going from 2 to 3, and of leaving 3 for 1.

    Returns
    -------
    Domain
        Two equally likely tasks.  All transitions ignore the policy.
    """
    one_of("second", second, get_args(SecondTask))
    x, gamma, p = positive_number("reward", reward), _below_one(discount), detour
    probability("detour", p)
    to = {s: {s: 1.0} for s in (1, 2, 3)}
    others: dict[SecondTask, list[Row]] = {
        "a": [to[1]],
        "b": [to[1], to[3]],
        "c": [{1: 1 - p, 3: p}, {1: p, 3: 1 - p}],
    }
    return Domain(
        name=f"figure A.2, task 2{second}",
        tasks=(
            _task((to[2], to[2]), [to[3], to[1]], (0.0, -x), gamma),
            _task((to[2], to[2]), others[second], (0.0, x), gamma),
        ),
        task_names=("task 1", f"task 2{second}"),
    )


def figure_a3(
    loss: float = 1.0, gain: float = 6.0, discount: float = 0.9, detour: float = 0.05
) -> Domain:
    """The domain of fact 2, case 4: weights d(m|s) that depend on the policy.

    In both tasks A leads from state 1 to 2 and B to 3; B earns ``-loss`` in task 1 and
    ``+gain`` in task 2.  Task 1 goes from 2 to 3 and from 3 back to 1, seldom by way of
    4.  Task 2 goes from 3 to 2 and from 2 to 4, where it stays long.  Hence most visits
    to 4 happen in task 2, most visits to 1 in task 1, and once A is never chosen 2 is
    not visited in task 1 at all.

    Parameters
    ----------
    loss, gain
        What B costs in task 1 and earns in task 2, above 0.
    discount
        gamma, below 1.
    detour
        Probability of going from 3 to 4 in task 1, and of leaving 4 in task 2.

    Returns
    -------
    Domain
        Two equally likely tasks, ergodic unless A is never or always chosen.
    """
    positive_number("loss", loss)
    positive_number("gain", gain)
    gamma, p = _below_one(discount), probability("detour", detour)
    to = {s: {s: 1.0} for s in (1, 2, 3, 4)}
    choice = (to[2], to[3])
    return Domain(
        name="figure A.3",
        tasks=(
            _task(choice, [to[3], {1: 1 - p, 4: p}, to[1]], (0.0, -loss), gamma),
            _task(choice, [to[4], to[2], {1: p, 4: 1 - p}], (0.0, gain), gamma),
        ),
        task_names=("task 1", "task 2"),
    )


def policy(domain: Domain, p_b: float) -> FloatArray:
    """The policy that chooses B in state 1 with probability ``p_b``, shape ``(O, 2)``.

    In the other states both actions do the same; A is chosen there.
    """
    mu = np.tile([1.0, 0.0], (domain.n_observations, 1))
    mu[0] = 1 - probability("p_b", p_b), p_b
    return mu


@dataclass(frozen=True)
class StateValues:
    r"""Values of a cross-task policy, exact up to rounding.

    Attributes
    ----------
    domain
        :math:`V_d^\mu(s)` (eq. 3.10), shape ``(O,)``; NaN where no task goes.
    task
        :math:`V_m^\mu(s)`, shape ``(M, O)``; NaN outside the task.
    weight
        :math:`d(m|s)`, shape ``(M, O)``.
    """

    domain: FloatArray
    task: FloatArray
    weight: FloatArray


def state_values(
    domain: Domain, mu: ArrayLike, weighting: Weighting | ArrayLike = "uniform"
) -> StateValues:
    r"""Domain values :math:`V_d^\mu(s) = \sum_m d(m|s) V_m^\mu(s)` of a cross-task policy.

    Parameters
    ----------
    domain
        Tasks given by transition matrices, with a discount below 1 or episodes that end.
    mu
        The policy, shape ``(O, A)``.
    weighting
        p(s|m), from which d(m|s) follows by Bayes' rule: ``"uniform"`` over the states of
        a task, ``"occupancy"`` (the stationary distribution from the start state, which
        depends on the policy), or an array of shape ``(M, O)``.

    Returns
    -------
    StateValues

    Raises
    ------
    ValueError
        When the occupancy of a task with terminal states is asked for, mu is no policy, or a
        shape or name is wrong.

    Notes
    -----
    Source: equations 3.8 and 3.10 and appendix A.  With p(x|m) = p(s|m) p(a|s) the
    weights p(m|x) do not depend on the action, and (3.8) becomes a sum over states.
    """
    shape = len(domain), domain.n_observations
    choice = check_policies(domain, mu)
    if choice.ndim != 2:
        raise ValueError(
            f"mu has shape {choice.shape}, but one policy is needed, shape {domain.shape}."
        )
    given = None if isinstance(weighting, str) else np.asarray(weighting, dtype=float)
    if given is None:
        one_of("weighting", str(weighting), get_args(Weighting))
    elif given.shape != shape:
        raise ValueError(
            f"weighting has shape {given.shape}, but (tasks, observations) = {shape} is needed."
        )
    values = np.full(shape, np.nan)
    share = np.zeros(shape) if given is None else given
    for m, (task, index) in enumerate(zip(domain.tasks, domain.observation_index, strict=True)):
        if not isinstance(task, TabularMDP):
            raise ValueError(
                f"task {domain.task_names[m]!r} has no transition matrix, which state_values "
                "needs; use the evaluation of thesis_lib.mdp for it."
            )
        inside = np.flatnonzero(index >= 0)
        rows = choice[index[inside]]
        chain = np.einsum("sa,sat->st", rows, task.transition[inside])[:, inside]
        reward = (rows * task.reward[inside]).sum(axis=1)
        solution = np.linalg.solve(np.eye(len(inside)) - task.discount * chain, reward)
        values[m, index[inside]] = solution
        if given is None and weighting == "uniform":
            share[m, index[inside]] = 1 / len(inside)
        elif given is None:
            own = domain.scatter(choice, m, fill=1 / len(domain.actions))
            share[m, index[inside]] = _occupancy(chain, task, own, inside, domain.task_names[m])
    joint = domain.distribution[:, None] * share
    with np.errstate(invalid="ignore"):
        weight = joint / joint.sum(axis=0)
    total = np.where(weight > 0, weight * values, 0.0).sum(axis=0)
    return StateValues(np.where(np.isnan(weight).any(axis=0), np.nan, total), values, weight)


def _occupancy(
    chain: FloatArray, task: TabularMDP, policy: FloatArray, inside: IntArray, name: str
) -> FloatArray:
    """Stationary distribution of the states that can be reached from the start."""
    if np.abs(chain.sum(axis=1) - 1).max() > 1e-9:
        raise ValueError(
            f"task {name!r} has terminal states, and so no stationary distribution; use the "
            "uniform weighting."
        )
    n = len(chain)
    reached = task.start[inside] > 0
    for _ in range(n):
        reached |= (chain[reached] > 0).any(axis=0)
    at = np.flatnonzero(reached)
    inner = chain[np.ix_(at, at)]
    # Balance equations, one of which is redundant, with the normalisation below them.
    system = np.vstack([inner.T - np.eye(len(at)), np.ones(len(at))])
    out = np.zeros(n)
    out[at], _, rank, _ = np.linalg.lstsq(system, np.append(np.zeros(len(at)), 1.0), rcond=None)
    if rank < len(at):  # several closed sets, each with the probability of ending up in it
        return stationary_distribution(task, policy)[inside]
    return np.where(np.abs(out) < 1e-15, 0.0, out)


def _below_one(discount: float) -> float:
    if not 0.0 <= discount < 1.0:
        raise ValueError(f"discount is {discount}, but it must be in [0, 1) for endless tasks.")
    return float(discount)
