r"""Potential functions for multi-task reinforcement learning (section 3.3).

All three potentials of the thesis are one formula, the mean over tasks of a task value
function, weighted by how likely each task is given the pair (eq. 3.4):

.. math:: Q_d(x) = \sum_m p(m|x) Q_m(x).

They differ in :math:`Q_m`: the optimal values (:func:`q_star`, eq. 3.6), the values of the
best soft policy (:func:`q_tilde`, eq. 3.7), or the values of one policy for all tasks
(:func:`q_mu`, eq. 3.8).  Learners take a potential by initialisation or, equivalently,
by look-ahead-advice shaping: see :func:`thesis_lib.mdp.learning.learn`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import FloatArray
from thesis_lib.domains.domain import Domain
from thesis_lib.mdp import planning
from thesis_lib.mdp.greedy import epsilon_greedy
from thesis_lib.mdp.learning import Method, learn

Weighting = Literal["uniform", "start", "stationary", "learning"]
WEIGHTINGS: tuple[str, ...] = ("uniform", "start", "stationary", "learning")


def cross_task_values(
    domain: Domain, tables: Iterable[ArrayLike], weights: ArrayLike | None = None
) -> FloatArray:
    """Mean of task value functions, the least-squares prediction of a new task (eq. 3.4).

    Parameters
    ----------
    domain
        The domain.
    tables
        :math:`Q_m` of each task, each ``(S_m, A)``.
    weights
        p(x|m), shape ``(M, O, A)``; default uniform over each task's pairs.  A pair that
        has no weight in any task has no mean under (3.4); it gets the mean under uniform
        weights, so that a potential is defined everywhere.

    Returns
    -------
    FloatArray
        :math:`Q_d`, shape ``(O, A)``.

    Raises
    ------
    ValueError
        When a shape is wrong, or a pair of a task has no finite value.
    """
    stacked = _stacked(domain, tables)
    mean = _weighted_mean(stacked, domain.posterior(weights))
    if weights is None:
        return mean
    return np.where(np.isnan(mean), _weighted_mean(stacked, domain.posterior()), mean)


def _weighted_mean(stacked: FloatArray, posterior: FloatArray) -> FloatArray:
    terms = np.where(posterior > 0, posterior * np.nan_to_num(stacked), 0.0).sum(axis=0)
    return np.where(np.isnan(posterior).all(axis=0), np.nan, terms)


def _stacked(domain: Domain, tables: Iterable[ArrayLike]) -> FloatArray:
    """Tables in the domain's coordinates, ``(M, O, A)``, NaN where a task has no such pair.

    Raises
    ------
    ValueError
        When a pair of a task has no finite value.
    """
    stacked = domain.gather(tables)
    if (bad := ~np.isfinite(stacked) & domain.present[:, :, None]).any():
        m, o, a = np.argwhere(bad)[0]
        raise ValueError(
            f"the value of task {domain.task_names[m]!r} at pair [observation {o}, action "
            f"{domain.actions[a]}] is {stacked[m, o, a]}, but every pair of a task needs a finite "
            "value; give pairs that were never seen a number, such as 0."
        )
    return stacked


def expected_squared_error(
    domain: Domain,
    tables: Iterable[ArrayLike],
    q0: ArrayLike,
    weights: ArrayLike | None = None,
) -> float:
    r"""Mean squared error of one function as a prediction of every task's values (eq. 3.3).

    Parameters
    ----------
    domain
        The domain.
    tables
        :math:`Q_m` of each task, each ``(S_m, A)``.
    q0
        The prediction, shape ``(O, A)``.
    weights
        p(x|m), shape ``(M, O, A)``; default uniform.

    Returns
    -------
    float
        :math:`\sum_m D(m) \sum_x p(x|m) (Q_m(x) - Q_0(x))^2`.

    Raises
    ------
    ValueError
        When a shape is wrong, or a pair of a task has no finite value.
    """
    p = domain.uniform() if weights is None else domain.check_weights(weights)
    prediction = np.asarray(q0, dtype=float)
    if prediction.shape != domain.shape:
        raise ValueError(
            f"q0 has shape {prediction.shape}, but domain {domain.name!r} needs (observations, "
            f"actions) = {domain.shape}."
        )
    stacked = _stacked(domain, tables)
    if (bad := ~np.isfinite(prediction)).any():
        o, a = np.argwhere(bad)[0]
        raise ValueError(
            f"q0 of pair [observation {o}, action {domain.actions[a]}] is {prediction[o, a]}, but "
            "a prediction of every pair is needed; give it a number, such as 0."
        )
    error = np.nan_to_num(stacked - prediction)
    return float((domain.distribution[:, None, None] * p * error**2).sum())


def linear_cross_task_weights(
    task_weights: ArrayLike,
    active: ArrayLike,
    distribution: ArrayLike | None = None,
    *,
    labels: ArrayLike | None = None,
    fill: float = 0.0,
) -> FloatArray:
    r"""Cross-task weights of a linear function of binary features (eq. 3.5).

    .. math:: w_d^i = \sum_m p(m|f^i = 1) w_m^i

    It solves (3.3) where no two features are ever active together (state aggregation, one
    tiling), and where the tasks share the features' second moments and their sum is regular,
    where it is the mean of the weights.  Elsewhere it does not: see
    :func:`least_squares_weights`.

    Parameters
    ----------
    task_weights
        :math:`w_m^i`, shape ``(M, n)``; not read where the feature is never active.
    active
        :math:`p(f^i = 1|m)`, how often feature i is active in task m, shape ``(M, n)``.
    distribution
        D(m), shape ``(M,)``; default uniform.
    labels
        An abstraction of the features, shape ``(n,)``, equal integers from 0 where it merges
        features: they share the mean of their weights (eq. 4.1).  Default none.
    fill
        Weight of what is never active.

    Returns
    -------
    FloatArray
        :math:`w_d`, shape ``(n,)``.
    """
    w, f = np.asarray(task_weights, dtype=float), np.asarray(active, dtype=float)
    if w.shape != f.shape or w.ndim != 2 or (f < 0).any():
        raise ValueError(
            f"task_weights has shape {w.shape} and active {f.shape}, but both must be "
            "(tasks, features) and activities at least 0."
        )
    joint = f if distribution is None else np.asarray(distribution, float)[:, None] * f
    weighted, total = np.where(joint > 0, joint * w, 0.0).sum(axis=0), joint.sum(axis=0)
    groups = np.arange(w.shape[1]) if labels is None else np.asarray(labels)
    weighted, total = np.bincount(groups, weighted), np.bincount(groups, total)
    mean = np.divide(weighted, total, out=np.full(len(total), float(fill)), where=total > 0)
    return np.asarray(mean[groups])


def least_squares_weights(
    task_weights: ArrayLike, moments: ArrayLike, distribution: ArrayLike | None = None
) -> FloatArray:
    r"""Cross-task weights that solve (3.3) for any linear function approximator.

    With :math:`F_m = \sum_x p(x|m) f(x) f(x)^\top` the error :math:`\sum_m D(m) (w_m - w)^\top
    F_m (w_m - w)` is least where

    .. math:: \Bigl(\sum_m D(m) F_m\Bigr) w_d = \sum_m D(m) F_m w_m.

    Equation 3.5 is this with the matrices' diagonals only.

    Parameters
    ----------
    task_weights
        :math:`w_m`, shape ``(M, n)``.
    moments
        :math:`F_m`, shape ``(M, n, n)``.
    distribution
        D(m), shape ``(M,)``; default uniform.

    Returns
    -------
    FloatArray
        :math:`w_d`, shape ``(n,)``; of all solutions the shortest.

    Notes
    -----
    If the first task knows only a pair with both of two features, worth 2 by weights (1, 1), and
    the second only a pair with the first feature, worth 3, then (3, -1) meets both without
    error; (3.5) gives (2, 1), with a mean squared error of 1.
    """
    w, F = np.asarray(task_weights, dtype=float), np.asarray(moments, dtype=float)
    if w.ndim != 2 or F.shape != (*w.shape, w.shape[1]):
        raise ValueError(
            f"task_weights has shape {w.shape} and moments {F.shape}, but (tasks, features) and "
            "(tasks, features, features) are needed."
        )
    n_tasks = len(w)
    D = np.full(n_tasks, 1 / n_tasks) if distribution is None else np.asarray(distribution, float)
    left = np.einsum("m,mij->ij", D, F)
    right = np.einsum("m,mij,mj->i", D, F, w)
    return np.asarray(np.linalg.lstsq(left, right, rcond=None)[0])


def q_star(domain: Domain, weights: ArrayLike | None = None) -> FloatArray:
    """The potential :math:`Q^*_d`, mean of optimal values (eq. 3.6), shape ``(O, A)``.

    Examples
    --------
    >>> from thesis_lib.domains import triangle
    >>> domain = triangle()
    >>> potential = q_star(domain)
    >>> potential.shape == domain.shape
    True
    >>> domain.scatter(potential, task=0).shape  # as a task's learner takes it
    (4, 3)
    """
    return cross_task_values(domain, optimal_solutions(domain), weights)


def q_tilde(domain: Domain, epsilon: float, weights: ArrayLike | None = None) -> FloatArray:
    r"""The potential :math:`\tilde Q_d`, mean of best soft values (eq. 3.7), shape ``(O, A)``.

    Parameters
    ----------
    domain
        The domain.
    epsilon
        Exploration rate of the soft policies.
    weights
        p(x|m), shape ``(M, O, A)``; default uniform.

    Examples
    --------
    No soft policy is worth more than the best one:

    >>> from thesis_lib.domains import triangle
    >>> domain = triangle()
    >>> bool((q_tilde(domain, epsilon=0.1) < q_star(domain) + 1e-9).all())
    True
    """
    return cross_task_values(domain, soft_solutions(domain, epsilon), weights)


def q_mu(domain: Domain, policy: ArrayLike, weights: ArrayLike | None = None) -> FloatArray:
    r"""The potential :math:`Q^\mu_d`, mean of one policy's values (eq. 3.8), shape ``(O, A)``.

    Parameters
    ----------
    domain
        The domain.
    policy
        The cross-task policy :math:`\mu`, shape ``(O, A)``.
    weights
        p(x|m), shape ``(M, O, A)``; default uniform.
    """
    return cross_task_values(domain, policy_values(domain, policy), weights)


def optimal_solutions(domain: Domain) -> list[FloatArray]:
    """Optimal values :math:`Q^*_m` of every task, exact, each ``(S_m, A)``."""
    return [planning.solve(task).q for task in domain.tasks]


def soft_solutions(domain: Domain, epsilon: float) -> list[FloatArray]:
    r"""Values :math:`\tilde Q_m` of every task's best epsilon-greedy policy, exact."""
    return [planning.soft_policy_iteration(task, epsilon).q for task in domain.tasks]


def policy_values(domain: Domain, policy: ArrayLike) -> list[FloatArray]:
    r"""Values :math:`Q^\mu_m` of one cross-task policy in every task, exact.

    Parameters
    ----------
    domain
        The domain.
    policy
        Shape ``(O, A)``, rows summing to 1.
    """
    return [
        planning.evaluate(task, mu).q
        for task, mu in zip(domain.tasks, task_policies(domain, policy), strict=True)
    ]


def task_policies(domain: Domain, policy: ArrayLike) -> list[FloatArray]:
    """A cross-task policy restricted to each task, uniform where no action matters."""
    return domain.scatter_all(policy, fill=1.0 / len(domain.actions))


def pair_weights(
    domain: Domain, kind: Weighting, policies: Sequence[FloatArray] | None = None
) -> FloatArray:
    """The weighting p(x|m) of section 3.3.6, options 1, 3 and 4, exact.

    Parameters
    ----------
    domain
        The domain.
    kind
        ``"uniform"`` over each task's pairs; ``"start"``: the start-state distribution and
        a uniform random policy; ``"stationary"``: the share of time the task's policy
        spends in each pair, episodes following one another.  For the fourth,
        ``"learning"``, see :func:`learning_weights`.
    policies
        For ``"stationary"``: the policy corresponding to each :math:`Q_m`, ``(S_m, A)``.

    Returns
    -------
    FloatArray
        p(x|m), shape ``(M, O, A)``.
    """
    if kind == "uniform":
        return domain.uniform()
    if kind == "start":
        n_actions = len(domain.actions)
        tables = [np.repeat(t.start[:, None], n_actions, 1) / n_actions for t in domain.tasks]
        return _as_weights(domain, tables)
    if kind == "stationary":
        if policies is None or len(policies) != len(domain):
            given = "none" if policies is None else len(policies)
            raise ValueError(
                f"kind 'stationary' needs policies, one (states, actions) array for each of "
                f"{len(domain)} tasks, but {given} were given."
            )
        tables = [
            planning.stationary_distribution(task, policy)[:, None] * policy
            for task, policy in zip(domain.tasks, policies, strict=True)
        ]
        return _as_weights(domain, tables)
    raise ValueError(
        f"kind {kind!r} does not exist here: choose uniform, start or stationary, or call "
        "learning_weights."
    )


def learning_weights(
    domain: Domain,
    method: Method,
    *,
    alpha: float,
    epsilon: float,
    steps: int,
    rng: np.random.Generator,
    snapshots: int = 100,
) -> FloatArray:
    r"""The weighting induced by learning, p(x|m) = sum_t p(x|m, pi_t) / T (section 3.3.6, 2).

    One trajectory of learning is sampled in each task; for each of its policies the
    stationary distribution is exact.  The sum over t runs over at least
    ``snapshots`` equally spaced steps.

    Parameters
    ----------
    domain
        The domain.
    method, alpha, epsilon
        The learner.
    steps
        T, the number of learning steps.
    rng
        Source of the trajectories.
    snapshots
        How many of the T policies are averaged over at least: one every T // snapshots steps,
        so that 150 steps with 100 snapshots average 150.

    Returns
    -------
    FloatArray
        p(x|m), shape ``(M, O, A)``.
    """
    if not 1 <= snapshots <= steps:
        raise ValueError(f"snapshots is {snapshots}, but it must be in 1..{steps} (steps).")
    tables = []
    for task in domain.tasks:
        learned = learn(
            task,
            method,
            alpha=alpha,
            epsilon=epsilon,
            steps=steps,
            rng=rng,
            checkpoint_every=steps // snapshots,
            record={"q"},
        )
        assert learned.checkpoint_q is not None
        total = np.zeros((task.n_states, task.n_actions))
        for q in learned.checkpoint_q:
            policy = epsilon_greedy(q, epsilon)
            total += planning.stationary_distribution(task, policy)[:, None] * policy
        tables.append(total / len(learned.checkpoint_q))
    return _as_weights(domain, tables)


def _as_weights(domain: Domain, tables: Iterable[FloatArray]) -> FloatArray:
    p = np.nan_to_num(domain.gather(tables))
    return p / p.sum(axis=(1, 2), keepdims=True)


def constant_potential(domain: Domain, value: float) -> FloatArray:
    """The same value at every pair: plain optimistic (or pessimistic) initialisation.

    The control for every potential: it carries the level of the values and nothing of
    what distinguishes one pair from another.

    Parameters
    ----------
    domain
        The tasks.
    value
        The number, in units of reward.

    Returns
    -------
    FloatArray
        Shape ``(O, A)``.
    """
    return np.full(domain.shape, float(value))
