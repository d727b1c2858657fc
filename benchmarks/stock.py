"""Stock-trading tasks in factored form against the same tasks with a transition matrix.

    python benchmarks/stock.py [--json] [--repeats 5]

Side by side in one run: one expectation over next states, and one exact solution (Q*), for
<1, 2, G>; medians of several interleaved rounds, in CPU seconds of one thread.  Then all 768
tasks of <1, 2, 8> (2,048 states each) are solved in factored form, with the peak memory.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import time
from collections.abc import Callable
from statistics import median

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from thesis_lib.domains import stock
from thesis_lib.mdp import solve

GLOBALS = (3, 5, 8)


def cpu_seconds(function: Callable[[], object], least: float = 0.02) -> float:
    """CPU seconds a call, over enough calls to fill ``least`` seconds."""
    calls, total = 0, 0.0
    while total < least:
        start = time.process_time()
        function()
        total += time.process_time() - start
        calls += 1
    return total / calls


def side_by_side(
    ours: Callable[[], object], peer: Callable[[], object], repeats: int
) -> tuple[float, float]:
    rounds = [(cpu_seconds(ours), cpu_seconds(peer)) for _ in range(repeats + 1)][1:]
    return median(r[0] for r in rounds), median(r[1] for r in rounds)


def row(name: str, ours: float, peer: float | None, unit: str) -> dict[str, object]:
    ratio = None if peer is None else peer / ours
    return {"name": name, "ours": ours, "peer": peer, "ratio": ratio, "unit": unit}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--repeats", type=int, default=5)
    arguments = parser.parse_args()
    rows = []

    # The large domain first, so that the peak memory is its own.
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    start = time.process_time()
    domain = stock(1, 2, 8)
    tables = [solve(task).q for task in domain.tasks]
    seconds = time.process_time() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    assert len(tables) == 768
    rows.append(row("<1,2,8>: Q* of all 768 tasks", seconds, None, "CPU seconds"))
    rows.append(row("<1,2,8>: memory of that", peak - before, None, "MiB"))

    for g in GLOBALS:
        task = stock(1, 2, g).tasks[1]
        dense = task.to_tabular()
        values = np.random.default_rng(0).normal(size=task.n_states)
        np.testing.assert_allclose(solve(task).q, solve(dense).q, atol=1e-9)
        times = side_by_side(
            lambda t=task, v=values: t.expectation(v),
            lambda t=dense, v=values: t.expectation(v),
            arguments.repeats,
        )
        rows.append(row(f"<1,2,{g}>: one expectation", *times, "CPU seconds"))
        times = side_by_side(lambda t=task: solve(t), lambda t=dense: solve(t), arguments.repeats)
        rows.append(row(f"<1,2,{g}>: Q* of one task", *times, "CPU seconds"))

    if arguments.json:
        print(json.dumps(rows))
        return
    print(f"{'':32} {'factored':>12} {'matrix':>12} {'ratio':>8}")
    for r in rows:
        peer = "" if r["peer"] is None else f"{r['peer']:12.3g} {r['ratio']:8.1f}"
        print(f"{r['name']:32} {r['ours']:12.3g} {peer:21} {r['unit']}")


if __name__ == "__main__":
    main()
