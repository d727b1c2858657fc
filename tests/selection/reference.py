"""Algorithms 7, 8 and 9 transcribed line by line, slowly, on dictionaries.

Only the sample of combinations and the data are shared with the library, so that both see
the same sequences.
"""

import warnings
from itertools import combinations
from math import comb

import numpy as np
from scipy.optimize import OptimizeWarning, curve_fit
from scipy.stats import t as student

from thesis_lib.relevance import Solutions, sample_combinations

Pair = tuple[int, ...]
TaskQ = tuple[dict[Pair, float], dict[Pair, float]]
"""Q_m(x) and p(x|m) of a task."""

MAX_CONDITION = 1 / np.sqrt(np.finfo(float).eps)


def tasks_of(solutions: Solutions) -> list[TaskQ]:
    pairs = [tuple(row) for row in solutions.features.tolist()]
    return [
        (
            {x: v for x, v, w in zip(pairs, q, p, strict=True) if w > 0},
            {x: w for x, w in zip(pairs, p, strict=True) if w > 0},
        )
        for q, p in zip(solutions.q.tolist(), solutions.p.tolist(), strict=True)
    ]


def cross_task(sequence: list[TaskQ]) -> TaskQ:
    """Equation 4.5."""
    k = len(sequence)
    q, p = {}, {}
    for x in {x for _, weights in sequence for x in weights}:
        total = sum(weights.get(x, 0.0) for _, weights in sequence)
        q[x] = sum(w.get(x, 0.0) / total * v[x] for v, w in sequence if x in w)
        p[x] = total / k
    return q, p


def rho(kept: list[int], q: dict[Pair, float], p: dict[Pair, float]) -> float:
    """Definition 4 for the abstraction x -> x[kept]."""
    cells: dict[Pair, list[Pair]] = {}
    for x in q:
        cells.setdefault(tuple(x[f] for f in kept), []).append(x)
    total = 0.0
    for inside in cells.values():
        mass = sum(p[x] for x in inside)
        mean = sum(p[x] / mass * q[x] for x in inside)
        total += mass * sum(p[x] / mass * (q[x] - mean) ** 2 for x in inside)
    return total


def bkr(sampled: list[TaskQ], removed: list[int], n_features: int) -> dict[int, float]:
    """Algorithm 8, given the Q-functions of the sampled sequences."""
    out = {}
    for i in range(n_features):
        if i not in removed:
            kept = [f for f in range(n_features) if f not in removed and f != i]
            out[i] = sum(rho(kept, q, p) for q, p in sampled) / len(sampled)
    return out


def fr(tasks: list[TaskQ], chosen: list[int]) -> float:
    """Algorithm 9."""
    q, p = cross_task(tasks)
    mass: dict[Pair, float] = {}
    mean: dict[Pair, float] = {}
    for x in q:
        y = tuple(x[f] for f in chosen)
        mass[y] = mass.get(y, 0.0) + p[x]
        mean[y] = mean.get(y, 0.0) + p[x] * q[x]
    return rho([], {y: mean[y] / mass[y] for y in mass}, mass)


def verdict(D: np.ndarray, level: float, zero: float) -> str:
    """Lines 13 to 22 of algorithm 7 for one feature, with "unsure" from section 4.3."""
    n = len(D)
    k = np.arange(1.0, n + 1)
    span = D.max() - D.min()
    if span <= zero:
        return "remove" if D[-1] <= zero else "keep"
    data = (D - D[-1]) / span

    def f(k: np.ndarray, a: float, b: float, c: float) -> np.ndarray:
        return a + b * np.exp(-c * k)

    def slopes(k: np.ndarray, a: float, b: float, c: float) -> np.ndarray:
        return np.array([np.ones_like(k), np.exp(-c * k), -b * k * np.exp(-c * k)]).T

    start = (0.0, data[0] * np.exp(0.5), 0.5)
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", OptimizeWarning)
        try:
            theta, covariance = curve_fit(
                f, k, data, start, jac=slopes, method="lm", ftol=1e-14, xtol=1e-14, maxfev=300
            )
        except RuntimeError:
            return "unsure"
        if f(2, *theta) - f(1, *theta) > 0:
            return "keep"
        J = slopes(k, *theta)
        if theta[2] <= 0 or not np.isfinite(J).all():
            return "unsure"
        if not np.linalg.cond(J) <= MAX_CONDITION or n == 3:
            return "unsure"
    limit = D[-1] + span * theta[0]
    half_width = student.ppf(1 - level / 2, n - 3) * span * np.sqrt(covariance[0, 0])
    return "remove" if limit - half_width <= 0 else "keep"


def fs_tek(
    solutions: Solutions, level: float, max_seqs: int | None, seed: int
) -> tuple[list[int], list[list[dict[int, str]]], np.ndarray]:
    """Algorithm 7: features removed in order, verdicts of each round, D of the first round."""
    tasks = tasks_of(solutions)
    n, n_features = len(tasks), solutions.n_features
    rng = np.random.default_rng(seed)
    sampled = []
    for k in range(1, n + 1):
        if max_seqs is None or comb(n, k) <= max_seqs:
            chosen = list(combinations(range(n), k))
        else:
            chosen = sample_combinations(n, k, max_seqs, rng).tolist()
        sampled.append([cross_task([tasks[i] for i in c]) for c in chosen])
    zero = 1e-12 * rho([], *cross_task(tasks))
    removed: list[int] = []
    for_good: set[int] = set()
    rounds = []
    first = np.zeros(0)
    while True:
        rows = [bkr(sampled[k], removed, n_features) for k in range(n)]
        verdicts = {}
        for i in rows[0]:
            if i not in for_good:
                D = np.array([row[i] for row in rows])
                verdicts[i] = verdict(D, level, zero)
        if not rounds:
            first = np.array([[row[i] for row in rows] for i in sorted(rows[0])])
        rounds.append(verdicts)
        for_good |= {i for i, v in verdicts.items() if v == "keep"}
        marked = [i for i, v in verdicts.items() if v == "remove"]
        if not marked:
            return removed, rounds, first
        strengths = {i: fr(tasks, [*removed, i]) for i in marked}
        weakest = min(strengths.values())
        removed.append(next(i for i in marked if strengths[i] <= weakest + zero))
