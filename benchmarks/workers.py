"""How much faster two workers are than one, experiment by experiment.

    python benchmarks/workers.py [--json] [--repeats 3] [--workers 2] [ID ...]

One and several workers take turns in the same run; reported are medians of wall time.  The
tables are compared too: they must not depend on the number of workers.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from dataclasses import replace

from thesis_lib.chapter3 import figure_3_1, table_3_1
from thesis_lib.edition.chapters import find

CONFIGS = {
    "table-3.1": replace(
        table_3_1.entries.config("book"), potentials=("none", "Q_star", "Q_tilde"), n_runs=400
    ),
    "figure-3.1": replace(
        figure_3_1.by_alpha.config("book"), discounts=(0.95,), names=("none", "Q_star", "Q_tilde")
    ),
}
"""The learning part of each: what is shared out among the workers."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("ids", nargs="*", default=list(CONFIGS))
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    rows = []
    for identifier in options.ids:
        experiment = find(identifier)
        config = CONFIGS.get(identifier, experiment.config("book"))
        experiment.run(config=experiment.config("smoke"))  # compile
        seconds: dict[int, list[float]] = {1: [], options.workers: []}
        tables = {}
        for _ in range(options.repeats):
            for workers in seconds:
                start = time.perf_counter()
                tables[workers] = experiment.run(config=config, workers=workers).table
                seconds[workers].append(time.perf_counter() - start)
        if not tables[1].equals(tables[options.workers]):
            raise SystemExit(f"{identifier}: the table depends on the number of workers.")
        one, many = (statistics.median(seconds[w]) for w in (1, options.workers))
        rows.append(
            {
                "name": f"{identifier}, {options.workers} workers",
                "ours": many,
                "peer": one,
                "ratio": one / many,
                "unit": "s",
            }
        )
    if options.json:
        print(json.dumps(rows))
        return
    for row in rows:
        print(
            f"{row['name']:30s} {row['ours']:7.2f} s, one worker {row['peer']:7.2f} s: "
            f"{row['ratio']:.2f}x"
        )


if __name__ == "__main__":
    main()
