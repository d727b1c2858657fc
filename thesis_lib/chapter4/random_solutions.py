"""Random solutions of tasks over a few features, for statements that must hold of any."""

from __future__ import annotations

from itertools import product
from typing import Literal, get_args

import numpy as np

from thesis_lib.relevance import Solutions

Kind = Literal["shared", "subsets", "weights"]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""How random tasks weight their pairs: one p(x|m) for all; uniform on random subsets of the
pairs; any weights."""


def random_solutions(
    rng: np.random.Generator, kind: Kind, n_tasks: int, sizes: tuple[int, ...] = (2, 3)
) -> Solutions:
    """Random Q-functions of tasks over a small feature space.

    Parameters
    ----------
    rng
        Source of the numbers.
    kind
        The weights p(x|m).
    n_tasks
        M.
    sizes
        Number of values of each feature.
    """
    features = np.array(list(product(*map(range, sizes))))
    n = len(features)
    q = rng.normal(size=(n_tasks, n))
    if kind == "shared":
        p = np.broadcast_to(rng.dirichlet(np.ones(n)), q.shape)
    elif kind == "weights":
        p = rng.dirichlet(np.full(n, 0.5), n_tasks)
    else:
        present = np.zeros(q.shape, dtype=bool)
        for row in present:
            row[rng.choice(n, rng.integers(1, n + 1), replace=False)] = True
        p = present / present.sum(axis=1, keepdims=True)
        q = np.where(present, q, np.nan)
    return Solutions(q, p, features, tuple(f"f{i}" for i in range(len(sizes))))


def planted_solutions(
    rng: np.random.Generator,
    n_tasks: int,
    effect: float,
    *,
    levels: int = 2,
    shared: bool = True,
) -> Solutions:
    """Solutions in which ``f`` matters by ``effect`` on average and ``g`` not at all.

    Both effects scatter between tasks with unit variance, Gaussian.

    Parameters
    ----------
    rng
        Source of the numbers.
    n_tasks
        n.
    effect
        Mean effect of f, in standard deviations of its scatter.
    levels
        Values of g; the more, the more directions its scatter has.
    shared
        One uniform p(x|m), or weights drawn for each task.
    """
    features = np.array(list(product(range(2), range(levels))))
    f, g = features.T
    q = (effect + rng.normal(size=n_tasks))[:, None] * (2 * f - 1.0)
    q = q + rng.normal(size=(n_tasks, levels))[:, g]
    n = len(features)
    if shared:
        p = np.broadcast_to(np.full(n, 1 / n), q.shape)
    else:
        p = rng.dirichlet(np.full(n, 3.0), n_tasks)
    return Solutions(q, p, features, ("f", "g"))


def noise_to_signal(rng: np.random.Generator, n_tasks: int, index: int) -> Solutions:
    """Random solutions with shared p(x|m) and features f, g and h, from pure noise to a signal.

    Parameters
    ----------
    rng
        Source of the numbers.
    n_tasks
        n.
    index
        Modulo 5, twice the size of what all tasks have in common, so that decisions to remove a
        feature go both ways.
    """
    noise = random_solutions(rng, "shared", n_tasks, (2, 2, 2))
    common = rng.normal(size=noise.n_pairs) * (index % 5) / 2
    return Solutions(noise.q + common, noise.p, noise.features, ("f", "g", "h"))
