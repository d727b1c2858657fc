r"""k-relevance over sequences that are listed or drawn (definition 5, algorithm 8, figure 4.2)."""

from __future__ import annotations

from itertools import combinations, islice, product
from math import comb

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.checks import generator, positive_integer
from thesis_lib.relevance.abstraction import cross_task_q, relevance
from thesis_lib.relevance.cells import check_labels, ground, partition, sum_groups
from thesis_lib.relevance.exact import check_distribution, check_lengths, explained_sequences
from thesis_lib.relevance.solutions import Solutions

MOST = 200_000
"""Longest list of sequences that is made."""


def list_sequences(
    n_tasks: int, k: int, distribution: ArrayLike | None = None
) -> tuple[IntArray, FloatArray]:
    r"""All :math:`|M|^k` sequences and their probabilities :math:`p(c) = \prod_i D(c_i)`.

    Parameters
    ----------
    n_tasks
        Number of tasks M.
    k
        Sequence length.
    distribution
        D(m), shape ``(M,)``; default uniform.

    Returns
    -------
    sequences
        Shape ``(|M|^k, k)``, in lexicographic order: the sequences that extend c stand
        together, as the areas of figure 4.2 do.
    probabilities
        Shape ``(|M|^k,)``.

    Raises
    ------
    ValueError
        When there are more than 200,000.
    """
    (length,) = check_lengths(k)
    D = check_distribution(distribution, positive_integer("n_tasks", n_tasks))
    if n_tasks**length > MOST:
        raise ValueError(
            f"there are {n_tasks}^{length} sequences, but at most {MOST} are listed; use the exact "
            "law (k_relevance) or draw some (sampled_k_relevance)."
        )
    sequences = np.array(list(product(range(n_tasks), repeat=int(length))), dtype=np.int64)
    return sequences, D[sequences].prod(axis=1)


def brute_force_k_relevance(
    solutions: Solutions, labels: ArrayLike, k: int, distribution: ArrayLike | None = None
) -> float:
    r"""k-relevance by its definition, a sum over all :math:`|M|^k` sequences.

    Parameters
    ----------
    solutions
        The M tasks of the domain.
    labels
        The abstraction, shape ``(N,)``.
    k
        Sequence length.
    distribution
        D(m), shape ``(M,)``; default uniform.

    Returns
    -------
    float
        :math:`\rho_k(\phi)`.

    Notes
    -----
    Source: definition 5, equation 4.6.  For small k;
    :func:`~thesis_lib.relevance.exact.k_relevance` gives the same number for any k.
    """
    sequences, probability = list_sequences(solutions.n_tasks, k, distribution)
    numbered = check_labels(labels, solutions.n_pairs)
    values = [relevance(numbered, *cross_task_q(solutions, c)) for c in sequences]
    return float(probability @ values)


def sample_combinations(
    n_tasks: int, k: int, max_seqs: int, rng: np.random.Generator | int
) -> IntArray:
    """Draw ``min(max_seqs, C(n, k))`` different combinations of k tasks.

    Parameters
    ----------
    n_tasks
        Number of tasks n.
    k
        Tasks in a combination, at most n.
    max_seqs
        Most combinations to draw.
    rng
        Generator or seed; not used where all combinations are taken.

    Returns
    -------
    IntArray
        Shape ``(C, k)``; each row ascending, all rows different.

    Notes
    -----
    Source: algorithm 8, lines 2 and 3.
    """
    (length,) = check_lengths(k, positive_integer("n_tasks", n_tasks)).tolist()
    limit = positive_integer("max_seqs", max_seqs)
    number = comb(n_tasks, length)
    if number <= max(limit, 1000):
        every = np.array(list(combinations(range(n_tasks), length)), dtype=np.int64)
        if number <= limit:
            return every
        return every[np.sort(generator(rng).choice(number, limit, replace=False))]
    draws = generator(rng)
    seen: dict[tuple[int, ...], None] = {}
    while len(seen) < limit:
        order = draws.random((limit, n_tasks)).argsort(axis=1)[:, :length]
        seen.update(dict.fromkeys(map(tuple, np.sort(order, axis=1).tolist())))
    return np.array(list(islice(seen, limit)), dtype=np.int64)


def count_tasks(sequences: ArrayLike, n_tasks: int) -> FloatArray:
    """How often each task occurs in each sequence, shape ``(C, M)``.

    Parameters
    ----------
    sequences
        Task indices, shape ``(C, k)``.
    n_tasks
        M.
    """
    c = np.asarray(sequences)
    index = c + n_tasks * np.arange(len(c))[:, None]
    counts = np.bincount(index.ravel(), minlength=len(c) * n_tasks)
    return counts.reshape(len(c), n_tasks).astype(float)


def sampled_k_relevance(
    solutions: Solutions,
    labels: ArrayLike,
    k: int,
    max_seqs: int,
    rng: np.random.Generator | int,
    *,
    distribution: ArrayLike | None = None,
    replacement: bool = False,
) -> float:
    """k-relevance averaged over sequences that are drawn.

    Parameters
    ----------
    solutions
        M task solutions.
    labels
        The abstraction, shape ``(N,)``.
    k
        Sequence length.
    max_seqs
        Most sequences to draw.
    rng
        Generator or seed.
    distribution
        D(m), shape ``(M,)``, for sequences with replacement; default uniform.
    replacement
        False: different combinations of k tasks, as algorithm 8 does.  True: sequences
        drawn i.i.d. from D, as definition 5 has it.

    Returns
    -------
    float
    """
    cells = partition(solutions, labels)
    if replacement:
        (length,) = check_lengths(k)
        D = check_distribution(distribution, solutions.n_tasks)
        size = positive_integer("max_seqs", max_seqs), length
        sequences = generator(rng).choice(solutions.n_tasks, size=size, p=D)
    elif distribution is not None:
        raise ValueError(
            "distribution was given with replacement=False, but combinations of different tasks "
            "all weigh the same; leave it out."
        )
    else:
        sequences = sample_combinations(solutions.n_tasks, k, max_seqs, rng)
    counts = count_tasks(sequences, solutions.n_tasks)
    return float(
        (explained_sequences(ground(solutions), counts) - explained_sequences(cells, counts)).mean()
    )


def sequence_covariance(
    solutions: Solutions, labels: ArrayLike, sequence: ArrayLike, *, as_printed: bool = False
) -> FloatArray:
    r"""Covariance matrix of a sequence, whose mean element is the sequence's relevance.

    Element (i, j) is :math:`\sum_y p(y|c)\, w_i(y) w_j(y)\, \mathrm{Cov}(Q^c_{y,c_i},
    Q^c_{y,c_j})` with :math:`w_i(y) = p(y|c_i)/p(y|c)`.

    Parameters
    ----------
    solutions
        M task solutions.
    labels
        The abstraction, shape ``(N,)``.
    sequence
        Task indices, shape ``(k,)``.
    as_printed
        Set every :math:`w_i(y)` to 1 where task :math:`c_i` visits y, as equation B.4
        prints it.  The mean is then not the relevance, and changes when a constant is
        added to Q, unless all tasks of the sequence visit every abstract pair equally
        often.

    Returns
    -------
    FloatArray
        Shape ``(k, k)``, symmetric.

    Notes
    -----
    Source: equations B.3 and B.4, and the right column of figure 4.2.
    """
    chosen = solutions.take(np.asarray(sequence))
    b = chosen.p
    a = b * np.where(b > 0, chosen.q, 0.0)
    if not as_printed:
        a -= b * chosen.centre
    y = check_labels(labels, solutions.n_pairs)
    n = int(y.max()) + 1
    A, B = sum_groups(a, y, n), sum_groups(b, y, n)
    p, mass = b.mean(axis=0), B.mean(axis=0)
    # p(x|c) Q^c_{y,i} w_i = p(x|c_i) Q_i: the functions of B.3 with the weights they need.
    if as_printed:
        scale = np.divide(mass, B, out=np.zeros_like(B), where=B > 0)
        a, A = a * scale[:, y], A * scale
    within = np.divide(a, p, out=np.zeros_like(a), where=p > 0) @ a.T
    between = np.divide(A, mass, out=np.zeros_like(A), where=mass > 0) @ A.T
    return within - between
