"""Small random domains, and relevance in exact fractions, written without the library."""

from collections.abc import Sequence
from fractions import Fraction
from itertools import product
from typing import Literal, get_args

import numpy as np
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from thesis_lib.relevance import Solutions

Kind = Literal["shared", "subsets", "binary", "weights"]
KINDS = get_args(Kind)

Task = dict[str, tuple[Fraction, Fraction]]
"""Pair -> (p(x|m), Q_m(x))."""


def world(
    seed: int, kind: Kind, n_tasks: int = 3, sizes: tuple[int, ...] = (2, 3), scale: float = 3.0
) -> Solutions:
    """Random solutions: one p for all; uniform on random subsets of random or of equal size;
    or any weights."""
    rng = np.random.default_rng(seed)
    features = np.array(list(product(*map(range, sizes))))
    n = len(features)
    q = rng.normal(-20, scale, (n_tasks, n))
    if kind == "shared":
        p = np.broadcast_to(rng.dirichlet(np.ones(n)), q.shape)
    elif kind == "weights":
        p = rng.dirichlet(np.full(n, 0.5), n_tasks)
    else:
        fixed = rng.integers(1, n + 1)
        count = [fixed if kind == "binary" else rng.integers(1, n + 1) for _ in range(n_tasks)]
        present = np.zeros(q.shape, dtype=bool)
        for m in range(n_tasks):
            present[m, rng.choice(n, count[m], replace=False)] = True
        p = present / present.sum(axis=1, keepdims=True)
        q = np.where(present, q, np.nan)
    return Solutions(q, p, features, tuple(f"f{i}" for i in range(len(sizes))))


def labels(seed: int, n_pairs: int, n_cells: int = 3) -> np.ndarray:
    return np.random.default_rng([seed, 1]).integers(0, n_cells, n_pairs)


def distribution(seed: int, n_tasks: int) -> np.ndarray:
    return np.random.default_rng([seed, 2]).dirichlet(np.ones(n_tasks))


seeds = st.integers(0, 10**6)
kinds = st.sampled_from(KINDS)


def uniform_task(**q: int | Fraction) -> Task:
    """A task that visits the named pairs equally often."""
    return {x: (Fraction(1, len(q)), Fraction(value)) for x, value in q.items()}


def exact_relevance(cell: dict[str, int], tasks: Sequence[Task]) -> Fraction:
    """Relevance of merging pairs by ``cell`` on the cross-task Q of a sequence of tasks."""
    k = len(tasks)
    p: dict[str, Fraction] = {}
    pq: dict[str, Fraction] = {}
    for task in tasks:
        for x, (weight, value) in task.items():
            p[x] = p.get(x, Fraction(0)) + weight / k
            pq[x] = pq.get(x, Fraction(0)) + weight * value / k
    total = Fraction(0)
    for y in set(cell.values()):
        inside = [x for x in p if cell[x] == y]
        mass = sum((p[x] for x in inside), Fraction(0))
        if mass:
            mean = sum((pq[x] for x in inside), Fraction(0)) / mass
            total += sum((p[x] * (pq[x] / p[x] - mean) ** 2 for x in inside), Fraction(0))
    return total


def exact_k_relevance(cell: dict[str, int], tasks: Sequence[Task], k: int) -> Fraction:
    """Mean relevance over all sequences of k tasks, all tasks equally likely."""
    sequences = list(product(tasks, repeat=k))
    return sum((exact_relevance(cell, c) for c in sequences), Fraction(0)) / len(sequences)


def as_solutions(tasks: Sequence[Task]) -> tuple[Solutions, list[str]]:
    """The same tasks for the library, with one feature that numbers the pairs."""
    pairs = sorted({x for task in tasks for x in task})
    q = np.array([[float(t[x][1]) if x in t else np.nan for x in pairs] for t in tasks])
    p = np.array([[float(t[x][0]) if x in t else 0.0 for x in pairs] for t in tasks])
    return Solutions(q, p, np.arange(len(pairs))[:, None], ("x",)), pairs


def forward_relevance(y: ArrayLike, q: np.ndarray, p: np.ndarray) -> float:
    """What an abstraction explains (algorithm 9): the variance of the means of its cells."""
    cell = np.unique(y, return_inverse=True)[1]
    mass = np.bincount(cell, p)
    total = np.bincount(cell, np.where(p > 0, p * q, 0.0))
    mean = np.divide(total, mass, out=np.zeros_like(mass), where=mass > 0)
    return float(mass @ (mean - total.sum()) ** 2)


def covariance(solutions: Solutions, y: ArrayLike) -> np.ndarray:
    """B_ij, the sum over cells of p(y) Cov(Q_i, Q_j | y), of tasks that share p(x|m)."""
    assert solutions.shared
    p, cell = solutions.p[0], np.unique(y, return_inverse=True)[1]
    mean = np.stack([np.bincount(cell, p * q) for q in solutions.q]) / np.bincount(cell, p)
    rest = solutions.q - mean[:, cell]
    return (p * rest) @ rest.T
