"""Exact k-relevance against algorithm 8 with 100 sampled sequences a length.

    python benchmarks/relevance.py [--json] [--repeats 5] [--large-bits 20]

Side by side in one run, in CPU seconds of one thread, medians of interleaved rounds: the
k-relevance of every feature for all k up to the number of tasks, on the triangle and on
stock <1, 2, 3>.  The peer is algorithm 8 as printed, written sequence by sequence with
NumPy; a second row puts the library's own vectorised algorithm 8 in its place.  Errors are
root mean squares over features and k, against the mean over all combinations.  Then the
growth of the cost with tasks, features and pairs, and a domain of 2^20 pairs and 50 tasks.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import time
from collections.abc import Callable
from math import comb
from statistics import median

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from thesis_lib.domains import stock, triangle
from thesis_lib.mdp import solve
from thesis_lib.relevance import Solutions, ground, remove
from thesis_lib.relevance.exact import explained, explained_combinations
from thesis_lib.selection import FSTEK, JackknifeF, bkr

MAX_SEQS = 100
Row = dict[str, object]


def algorithm_8(
    q: np.ndarray,
    p: np.ndarray,
    cells: list[np.ndarray],
    k: int,
    max_seqs: int,
    rng: np.random.Generator,
) -> np.ndarray:
    """BKR for every feature, as printed: sample combinations, average Q, average relevance."""
    n = len(q)
    chosen: dict[tuple[int, ...], None] = {}
    while len(chosen) < min(max_seqs, comb(n, k)):
        chosen[tuple(sorted(rng.choice(n, k, replace=False).tolist()))] = None
    sizes = [int(y.max()) + 1 for y in cells]
    total = np.zeros(len(cells))
    for c in chosen:
        index = list(c)
        weight = p[index]
        mass = weight.sum(axis=0)
        seen = mass > 0
        mean = (weight * q[index]).sum(axis=0)[seen] / mass[seen]
        mass = mass[seen] / k
        for i, (y, size) in enumerate(zip(cells, sizes, strict=True)):
            inside = y[seen]
            group = np.bincount(inside, mass, size)
            average = np.bincount(inside, mass * mean, size) / np.where(group > 0, group, 1)
            total[i] += mass @ (mean - average[inside]) ** 2
    return total / len(chosen)


def cpu_seconds(function: Callable[[], object], least: float = 0.02) -> float:
    """CPU seconds a call, over enough calls to fill ``least`` seconds."""
    calls, total = 0, 0.0
    while total < least:
        start = time.process_time()
        function()
        total += time.process_time() - start
        calls += 1
    return total / calls


def side_by_side(functions: list[Callable[[], object]], repeats: int) -> list[float]:
    """Median CPU seconds of each, in interleaved rounds after one to warm up."""
    rounds = [[cpu_seconds(f) for f in functions] for _ in range(repeats + 1)][1:]
    return [median(column) for column in zip(*rounds, strict=True)]


def row(name: str, ours: float, peer: float | None, unit: str) -> Row:
    return {
        "name": name,
        "ours": ours,
        "peer": peer,
        "ratio": None if not peer else peer / ours if ours else None,
        "unit": unit,
    }


def against_algorithm_8(name: str, domain_solutions: Solutions, repeats: int) -> list[Row]:
    n = domain_solutions.n_tasks
    lengths = np.arange(1, n + 1)
    cells = [remove(domain_solutions, [f]) for f in range(domain_solutions.n_features)]
    q = np.nan_to_num(domain_solutions.q)
    p = domain_solutions.p

    def exact() -> np.ndarray:
        # A new object, so that nothing computed before is used again.
        fresh = domain_solutions.take(lengths - 1)
        pairs = ground(fresh)
        kept = explained_combinations(pairs, lengths)
        parts = [pairs.drop(f) for f in range(fresh.n_features)]
        return np.array([kept - explained_combinations(cells, lengths) for cells in parts])

    def sampled(seed: int = 0) -> np.ndarray:
        rng = np.random.default_rng(seed)
        return np.array([algorithm_8(q, p, cells, k, MAX_SEQS, rng) for k in lengths]).T

    def vectorised(seed: int = 0) -> np.ndarray:
        rng = np.random.default_rng(seed)
        fresh = domain_solutions.take(lengths - 1)
        return np.array([bkr(fresh, [], MAX_SEQS, int(k), rng) for k in lengths]).T

    ours, printed, fast = side_by_side([exact, lambda: sampled(), lambda: vectorised()], repeats)

    # Accuracy against every combination, listed where there are at most 5000.
    listed = [k for k in lengths if comb(n, int(k)) <= 5000]
    rng = np.random.default_rng(0)
    truth = np.array([algorithm_8(q, p, cells, int(k), 5000, rng) for k in listed]).T
    columns = [int(k) - 1 for k in listed]
    error = float(np.sqrt(np.mean((exact()[:, columns] - truth) ** 2)))
    noise = float(np.sqrt(np.mean([(sampled(s)[:, columns] - truth) ** 2 for s in range(5)])))
    return [
        row(f"{name}: all features, k = 1..{n}", ours, printed, "CPU seconds"),
        row(f"{name}: same, algorithm 8 vectorised", ours, fast, "CPU seconds"),
        row(f"{name}: error over the k that can be listed", error, noise, "relevance"),
    ]


def random_solutions(n_tasks: int, bits: int, n_pairs: int | None = None) -> Solutions:
    """Binary features with random linear effects; a random subset of pairs if asked for."""
    rng = np.random.default_rng(0)
    total = 2**bits
    index = (
        np.arange(total) if n_pairs is None else np.sort(rng.choice(total, n_pairs, replace=False))
    )
    features = ((index[:, None] >> np.arange(bits)[::-1]) & 1).astype(np.int8)
    q = rng.normal(size=(n_tasks, bits)) @ features.T
    p = np.broadcast_to(np.full(len(index), 1 / len(index)), q.shape)
    return Solutions(q, p, features, tuple(f"f{i}" for i in range(bits)))


def growth(repeats: int) -> list[Row]:
    """Cost of the exact law and of algorithm 8 as one size doubles, and the slopes of the logs."""
    lengths = np.arange(1, 11)

    def exact(solutions: Solutions) -> Callable[[], object]:
        tasks = np.arange(solutions.n_tasks)
        D = np.full(len(tasks), 1 / len(tasks))

        def every_feature() -> list[np.ndarray]:
            pairs = ground(solutions.take(tasks))
            kept = explained(pairs, lengths, D)
            parts = range(solutions.n_features)
            return [kept - explained(pairs.drop(f), lengths, D) for f in parts]

        return every_feature

    def printed(solutions: Solutions, max_seqs: int = 20) -> Callable[[], object]:
        rng = np.random.default_rng(0)
        cells = [remove(solutions, [f]) for f in range(solutions.n_features)]
        return lambda: algorithm_8(solutions.q, solutions.p, cells, 5, max_seqs, rng)

    rows = []
    powers = [2**b for b in (14, 15, 16, 17, 18)]
    for what, sizes, make in (
        ("exact law: tasks", [64, 128, 256, 512, 1024], lambda m: exact(random_solutions(m, 12))),
        ("exact law: pairs N", powers, lambda n: exact(random_solutions(16, 20, n))),
        ("exact law: features P", [4, 8, 16, 32], lambda f: exact(wide_solutions(f))),
        ("algorithm 8: pairs N", powers[:3], lambda n: printed(random_solutions(16, 20, n))),
        ("algorithm 8: features P", [4, 8, 16, 32], lambda f: printed(wide_solutions(f))),
        ("algorithm 8: sequences M", [8, 32, 128], lambda m: printed(wide_solutions(8), m)),
    ):
        measured = [side_by_side([make(size)], repeats)[0] for size in sizes]
        rows += [
            row(f"{what} = {size}", value, None, "CPU seconds")
            for size, value in zip(sizes, measured, strict=True)
        ]
        slope = float(np.polyfit(np.log(sizes), np.log(measured), 1)[0])
        rows.append(row(f"{what}, slope (1 is linear)", slope, None, "log-log slope"))
    return rows


def wide_solutions(n_features: int) -> Solutions:
    """The same 4096 pairs and 16 tasks with more and more features."""
    base = random_solutions(16, 12)
    extra = np.random.default_rng(1).integers(0, 2, (base.n_pairs, max(n_features - 12, 0)))
    if n_features < 12:
        # Merge bits into fewer, larger features, so that the pairs stay the same.
        parts = np.array_split(np.arange(12), n_features)
        features = np.stack([base.features[:, i] @ (1 << np.arange(len(i))) for i in parts], axis=1)
    else:
        features = np.concatenate([base.features, extra], axis=1)
    return Solutions(base.q, base.p, features, tuple(f"f{i}" for i in range(n_features)))


def large(bits: int) -> list[Row]:
    """Selection on 2^bits pairs and 50 tasks of which five features are relevant."""
    rng = np.random.default_rng(0)
    n_tasks, n = 50, 2**bits
    features = ((np.arange(n)[:, None] >> np.arange(bits)[::-1]) & 1).astype(np.int8)
    effects = rng.normal(0, 1, (n_tasks, bits))
    effects[:, :5] = rng.normal(1, 0.3, (n_tasks, 5))
    q = effects @ features.T
    p = np.broadcast_to(np.full(n, 1 / n), q.shape)
    solutions = Solutions(q, p, features, tuple(f"f{i}" for i in range(bits)))
    rows = []
    for selector in (JackknifeF(), FSTEK(alpha=1e-3)):
        start = time.process_time()
        selector.fit(solutions.take(np.arange(n_tasks)))
        seconds = time.process_time() - start
        kept = selector.get_support()
        name = f"2^{bits} pairs, 50 tasks: {type(selector).__name__} keeps {kept[:5].sum()} of 5"
        name += f" relevant, {kept[5:].sum()} of {bits - 5} irrelevant"
        rows.append(row(name, seconds, None, "CPU seconds"))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    rows.append(row("peak memory of that", peak, None, "MiB"))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--large-bits", type=int, default=20)
    arguments = parser.parse_args()

    rows: list[Row] = []
    for domain in (triangle(), stock(1, 2, 3)):
        solutions = Solutions.from_domain(domain, [solve(task).q for task in domain.tasks])
        rows += against_algorithm_8(domain.name, solutions, arguments.repeats)
    rows += growth(arguments.repeats)
    rows += large(arguments.large_bits)

    if arguments.json:
        print(json.dumps(rows))
        return
    print(f"{'':76} {'ours':>10} {'peer':>10} {'ratio':>9}")
    for r in rows:
        peer = f"{'':20}" if r["peer"] is None else f"{r['peer']:10.3g} {r['ratio'] or 0:9.3g}"
        print(f"{r['name']:76} {r['ours']:10.3g} {peer} {r['unit']}")


if __name__ == "__main__":
    main()
