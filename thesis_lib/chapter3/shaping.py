"""Section 3.1: shaping and initialisation, and section 3.3: averages of values and of weights."""

from __future__ import annotations

from functools import cache
from typing import Any, get_args

import numpy as np

from thesis_lib import potentials
from thesis_lib.arrays import FloatArray
from thesis_lib.domains import episodic_cliff
from thesis_lib.edition.criteria import EXACT, exact
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.words import number
from thesis_lib.mdp.greedy import epsilon_greedy, greedy_actions
from thesis_lib.mdp.learning import Learned, Method, learn

EPISODES = 50
"""Episodes over which an advised and an initialised learner are compared."""


@cache
def _both(method: Method) -> tuple[Learned, Learned, FloatArray]:
    """An advised learner, an initialised one with the same random numbers, and the potential."""
    domain = episodic_cliff(False)
    phi = potentials.q_tilde(domain, 0.1)
    initial = domain.scatter(phi, 0)

    def run(**start: Any) -> Learned:
        return learn(
            domain.tasks[0], method, alpha=0.4, epsilon=0.1, episodes=EPISODES, rng=1,
            record={"rewards", "actions", "states"}, **start,
        )  # fmt: skip

    return run(potential=initial), run(initial_q=initial), initial


@criterion("3.1-equals-initialisation")
def shaping_is_initialisation() -> Finding:
    """Actions and values of both learners, for every learning rule."""
    gap, same = 0.0, True
    for method in get_args(Method):
        advised, initialised, phi = _both(method)
        same &= np.array(advised.actions).tolist() == np.array(initialised.actions).tolist()
        gap = max(gap, float(np.abs(advised.q + phi - initialised.q).max()))
    return Finding(
        Verdict.REPRODUCED if same and gap < 1e-6 else Verdict.REFUTED,
        f"Over {EPISODES} episodes of {len(get_args(Method))} learning rules the two take "
        f"{'the same' if same else 'different'} actions, and Q + Φ differs from the initialised "
        f"values by at most {gap:.0e}.",
        {"gap": gap},
    )


@criterion("3.1-before-acting")
def initialisation_acts_first() -> Finding:
    """First greedy actions: those of an initialised table, and those of an advised table alone."""
    _, initialised, phi = _both("sarsa")
    free = int(greedy_actions(np.zeros_like(phi))[0].sum())
    start = np.array(initialised.states)[0]
    bound = int(greedy_actions(phi)[start].sum())
    return Finding(
        Verdict.REPRODUCED if bound < free else Verdict.REFUTED,
        f"In the start state {bound} of {free} actions are greedy in the initialised table before "
        "the first is taken; in a table of its own that only gets shaping rewards all are.",
        {"initialised": bound, "advised": free},
    )


@criterion("3.3.2-least-squares")
def mean_has_the_least_error() -> Finding:
    """Error (3.3) of the mean (3.4) and of a least-squares solver, with unequal p(x|m)."""
    domain, epsilon = episodic_cliff(True), 0.1
    tables = potentials.soft_solutions(domain, epsilon)
    policies = [epsilon_greedy(q, epsilon) for q in tables]
    p = potentials.pair_weights(domain, "stationary", policies)
    mean = potentials.cross_task_values(domain, tables, p)
    met = (domain.distribution[:, None, None] * p).nonzero()
    root = np.sqrt(domain.distribution[met[0]] * p[met])[:, None]
    one_hot = np.eye(mean.size)[np.ravel_multi_index(met[1:], mean.shape)]
    target = root[:, 0] * domain.gather(tables)[met]
    best = np.linalg.lstsq(root * one_hot, target, rcond=None)[0].reshape(mean.shape)
    ours, least = (potentials.expected_squared_error(domain, tables, q, p) for q in (mean, best))
    return exact(
        ours <= least * (1 + EXACT),
        f"On the episodic cliff, with the p(x|m) that the soft policies induce, the mean (3.4) has "
        f"squared error {number(ours)} and a least-squares solver's solution {number(least)}.",
    )


@criterion("3.4.1-shared-pairs")
def sensor_parts_tasks() -> Finding:
    """Pairs of the episodic cliff, and those that two tasks share, without the sensor and with."""
    total, shared = [], []
    for sensor in (False, True):
        domain = episodic_cliff(sensor)
        tasks, n_actions = domain.present.astype(int), len(domain.actions)
        total.append(domain.n_observations * n_actions)
        shared.append((tasks @ tasks.T)[np.triu_indices(len(tasks), 1)] * n_actions)
    without, own = (number(float(each.mean())) for each in shared)
    return exact(
        total[1] > total[0] and (shared[1] <= shared[0]).all() and (shared[1] < shared[0]).any(),
        f"Without the sensor the domain has {total[0]} pairs, of which two tasks share {without} "
        f"in the mean; with it {total[1]}, of which they share {own}. Fewer with it are shared by "
        f"{(shared[1] < shared[0]).sum()} of the {len(shared[0])} pairs of tasks, more by "
        f"{(shared[1] > shared[0]).sum() or 'none'}.",
    )


@criterion("3.3.2-linear")
def averaging_weights() -> Finding:
    """Two binary features that overlap, weighted differently by two tasks: error of (3.5)."""
    # Pairs x have features (1, 1) and (1, 0); task 1 meets the first only, task 2 the second.
    features = np.array([[1.0, 1.0], [1.0, 0.0]])
    return against_least_squares(features, np.array([[1.0, 1.0], [3.0, 0.0]]), np.eye(2))


def against_least_squares(features: FloatArray, weights: FloatArray, p: FloatArray) -> Finding:
    """Whether no weights have less squared error (3.3) than the averages (3.5).

    Parameters
    ----------
    features
        Binary, shape ``(X, F)``.
    weights
        Of the tasks' own linear functions, shape ``(M, F)``.
    p
        p(x|m), shape ``(M, X)``.
    """
    n, target = len(p), weights @ features.T
    on = p @ features  # p(f = 1|m)
    printed = (on * weights).sum(axis=0) / on.sum(axis=0)
    root = np.sqrt(p / n).ravel()[:, None]
    best = np.linalg.lstsq(
        root * np.tile(features, (n, 1)), root[:, 0] * target.ravel(), rcond=None
    )[0]  # fmt: skip
    errors = [float((p / n * (target - features @ w) ** 2).sum()) for w in (printed, best)]
    told = [f"({', '.join(map(number, w))})" for w in (printed, best)]
    return Finding(
        Verdict.REPRODUCED if errors[0] <= errors[1] + EXACT else Verdict.REFUTED,
        f"In an example of {n} tasks with binary features (3.5) gives the weights {told[0]} with "
        f"squared error {number(errors[0])}, the minimiser of (3.3) is {told[1]} with "
        f"{number(round(errors[1], 9))}.",
        {"printed": errors[0], "best": errors[1]},
    )
