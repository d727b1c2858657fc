r"""Optimal initialisation for value iteration (section 3.3.1, theorem 1).

Synchronous value iteration contracts: after n sweeps of task m,
:math:`\|Q^*_m - Q^n_m\|_\infty \le \gamma^n \delta_m` with
:math:`\delta_m = \|Q^*_m - Q_0\|_\infty`.  To come within :math:`\varepsilon` it is therefore
enough that :math:`n \ge \log_\gamma(\varepsilon / \delta_m)`, and over tasks (eq. 3.2) the
bound is smallest where the weighted geometric mean of the :math:`\delta_m` is.

What the proof leaves out is that a task within :math:`\varepsilon` needs no sweep, not fewer than
none: it assumes :math:`\varepsilon < \delta_m`, and its objective, the geometric mean, is then
degenerate, 0 at every single task's :math:`Q^*_m`.  With the truncation,

.. math:: \bar n(Q_0) = \sum_m D(m) \log_\gamma \frac{\varepsilon}{\max(\delta_m, \varepsilon)}
          = \frac{G_\varepsilon(Q_0) - \log \varepsilon}{\log(1/\gamma)}, \qquad
          G_\varepsilon(Q_0) = \sum_m D(m) \log \max(\delta_m, \varepsilon),

so that **the sufficient number of sweeps is least exactly where** :math:`G_\varepsilon` **is**
(:func:`truncated_minimiser`); no assumption on the distances is left.

*Minimisers.*  Where one function is within :math:`\varepsilon` of all tasks, it is one, as the
midrange is for every :math:`\varepsilon` from the largest half distance of two tasks' values on.
As :math:`\varepsilon \to 0` **a minimiser solves a heaviest set S of tasks that agree where they
overlap** (a single task where all differ), to within :math:`\varepsilon`, and tends to the least
:math:`\sum_{m \notin S} D(m) \log \delta_m` over the rest.  For let two tasks that disagree be at
least :math:`2 \varepsilon_0` apart on a pair they share.  Of those two one has :math:`\delta \ge
\varepsilon_0` whatever :math:`Q_0` is, so the tasks with :math:`\delta_m < \varepsilon_0` agree,
their weight is at most the heaviest set's w, and :math:`G_\varepsilon \ge w \log \varepsilon +
(1 - w) \log \varepsilon_0` for :math:`\varepsilon \le \varepsilon_0`.  The heaviest set attains
:math:`w \log \varepsilon + O(1)`; a lighter one cannot for small :math:`\varepsilon`.
:math:`\square`  So for high precision theorem 1 tells to bet on one task.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize, sparse

from thesis_lib.arrays import FloatArray
from thesis_lib.domains.domain import Domain
from thesis_lib.mdp.model import MDP
from thesis_lib.mdp.planning import value_iteration


def distances(domain: Domain, tables: Sequence[ArrayLike], q0: ArrayLike) -> FloatArray:
    r"""Max-norm distance :math:`\delta_m` of an initialisation to each task's values.

    Parameters
    ----------
    domain
        The domain.
    tables
        :math:`Q^*_m`, each ``(S_m, A)``.
    q0
        Shape ``(O, A)``.

    Returns
    -------
    FloatArray
        Shape ``(M,)``; the maximum runs over a task's own pairs.
    """
    gap = np.abs(domain.gather(tables) - np.asarray(q0, dtype=float))
    return np.nanmax(gap, axis=(1, 2))


def log_geometric_mean(distribution: ArrayLike, delta: ArrayLike) -> float:
    r"""The theorem's objective :math:`\log\prod_m \delta_m^{D(m)}`; minus infinity at a zero."""
    with np.errstate(divide="ignore"):
        return float(np.dot(np.asarray(distribution), np.log(np.asarray(delta))))


def sufficient_sweeps(delta: ArrayLike, tolerance: float, discount: float) -> FloatArray:
    r"""Sweeps that are enough, :math:`\log_\gamma(\varepsilon / \delta_m)`, 0 if already there.

    Parameters
    ----------
    delta
        :math:`\delta_m`, shape ``(M,)``.
    tolerance
        :math:`\varepsilon > 0`.
    discount
        gamma in (0, 1).

    Returns
    -------
    FloatArray
        Real-valued, shape ``(M,)``: the bound of (3.2) before averaging over tasks.
    """
    _check(tolerance, discount)
    d = np.maximum(np.asarray(delta, dtype=float), tolerance)
    return np.log(tolerance / d) / np.log(discount)


def measured_sweeps(
    mdp: MDP, q_star: FloatArray, q0: FloatArray, tolerance: float, most: int = 100_000
) -> int:
    r"""Sweeps of synchronous value iteration until :math:`\|Q^*-Q^n\|_\infty \le \varepsilon`.

    Parameters
    ----------
    mdp
        The task.
    q_star
        Its optimal values, shape ``(S, A)``.
    q0
        Where to start, shape ``(S, A)``; terminal states are set to 0, as they are known.
    tolerance
        :math:`\varepsilon > 0`.
    most
        Give up after so many sweeps.

    Returns
    -------
    int
        The number of sweeps n, 0 when q0 is already close enough.
    """
    _check(tolerance, mdp.discount)
    return value_iteration(
        mdp,
        tolerance=tolerance,
        initial_q=q0,
        synchronous=True,
        optimum=q_star,
        max_sweeps=most,
    ).n_sweeps


def midrange(domain: Domain, tables: Sequence[ArrayLike]) -> FloatArray:
    """Middle between the largest and the smallest task value of each pair, ``(O, A)``.

    It minimises the largest distance to any task.
    """
    stacked = domain.gather(tables)
    return (np.nanmax(stacked, axis=0) + np.nanmin(stacked, axis=0)) / 2


def mean_distance_minimiser(
    domain: Domain,
    tables: Sequence[ArrayLike],
    weights: ArrayLike | None = None,
    floor: float = 0.0,
) -> FloatArray:
    r"""Initialisation with the smallest weighted mean distance, a linear programme.

    .. math:: \min_{Q_0} \sum_m w_m \max(\delta_m, \varepsilon) \quad
              \text{s.t. } |Q^*_m(x) - Q_0(x)| \le \delta_m

    Parameters
    ----------
    domain
        The domain.
    tables
        :math:`Q^*_m`, each ``(S_m, A)``.
    weights
        :math:`w_m \ge 0`, shape ``(M,)``; default D(m).
    floor
        :math:`\varepsilon`: distances below it count as it.

    Returns
    -------
    FloatArray
        Shape ``(O, A)``.
    """
    stacked = domain.gather(tables).reshape(len(domain), -1)
    n_tasks, n_pairs = stacked.shape
    w = domain.distribution if weights is None else np.asarray(weights, dtype=float)
    task, pair = np.nonzero(~np.isnan(stacked))
    value = stacked[task, pair]
    row, one = np.arange(len(task)), np.ones(len(task))
    shape = (len(task), n_pairs + n_tasks)
    above = sparse.coo_matrix((one, (row, pair)), shape)
    slack = sparse.coo_matrix((one, (row, n_pairs + task)), shape)
    # No variable is an integer: this way SciPy checks and rewrites less than by linprog.
    solution = optimize.milp(
        np.concatenate([np.zeros(n_pairs), w]),
        constraints=optimize.LinearConstraint(
            sparse.vstack([above - slack, -above - slack]).tocsc(),
            ub=np.concatenate([value, -value]),
        ),
        bounds=optimize.Bounds(np.repeat([-np.inf, floor], [n_pairs, n_tasks])),
    )
    if not solution.success:
        raise RuntimeError(f"the linear programme was not solved: {solution.message}")
    return np.asarray(solution.x[:n_pairs]).reshape(domain.shape)


def truncated_minimiser(
    domain: Domain,
    tables: Sequence[ArrayLike],
    tolerance: float,
    *,
    starts: Sequence[ArrayLike] = (),
    iterations: int = 20,
) -> FloatArray:
    r"""Local minimiser of :math:`G_\varepsilon = \sum_m D(m)\log\max(\delta_m, \varepsilon)`.

    The logarithm lies below its tangents, so the linear programme with weights :math:`D(m) /
    \max(\delta_m, \varepsilon)` and the same truncation lowers the objective or stops.

    Parameters
    ----------
    domain
        The domain.
    tables
        :math:`Q^*_m`, each ``(S_m, A)``.
    tolerance
        :math:`\varepsilon > 0`, in the units of value.
    starts
        Initialisations ``(O, A)`` to descend from, besides the midrange, the mean and every
        task's own values; the best end is returned.
    iterations
        Most programmes a start.

    Returns
    -------
    FloatArray
        Shape ``(O, A)``; distances meant to be epsilon are a millionth of max|Q*| below it.
    """
    _check(tolerance, domain.discount)
    mean = mean_distance_minimiser(domain, tables)
    alone = [single_task(domain, tables, m, mean) for m in range(len(domain))]
    # The programmes are solved to about 1e-7, and a distance a hair above epsilon costs a sweep.
    scale = float(np.nanmax(np.abs(domain.gather(tables))))
    floor = tolerance - min(tolerance / 2, 1e-6 * scale)
    best, lowest = None, np.inf
    for start in (mean, midrange(domain, tables), *alone, *starts):
        q0, value = np.asarray(start, dtype=float), np.inf
        for _ in range(iterations):
            delta = np.maximum(distances(domain, tables, q0), tolerance)
            reached = log_geometric_mean(domain.distribution, delta)
            if reached < lowest - 1e-9:
                best, lowest = q0, reached
            if reached > value - 1e-9:
                break
            weights, value = domain.distribution / delta, reached
            q0 = mean_distance_minimiser(domain, tables, weights / weights.sum(), floor)
    assert best is not None
    return best


def single_task(
    domain: Domain, tables: Sequence[ArrayLike], task: int, fallback: ArrayLike
) -> FloatArray:
    """One task's values for all tasks, ``fallback`` on the pairs it lacks, ``(O, A)``."""
    own = domain.gather(tables)[task]
    return np.where(np.isnan(own), np.asarray(fallback, dtype=float), own)


def _check(tolerance: float, discount: float) -> None:
    if not tolerance > 0:
        raise ValueError(f"tolerance is {tolerance}, but it must be positive.")
    if not 0 < discount < 1:
        raise ValueError(
            f"the discount is {discount}, but theorem 1 needs one strictly between 0 and 1; build "
            "the domain with another discount."
        )
