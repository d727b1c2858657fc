"""What the engine of sweeps costs: two runs by `thesis sweep` beside two bare processes.

A bare process calls ``Training.step`` and keeps nothing.  Each side runs for few and for many
iterations, so that starting up is taken out: reported are the differences, of processor seconds
(the overhead, which a busy machine hardly changes) and of wall-clock seconds (the throughput,
which needs a quiet one).  A third side is a sweep whose workers give memory back as Dask has them
do; page faults are counted on all three.

    python benchmarks/engine.py [--json] [--task Hopper] [--iterations 10 40] [--repeats 3]
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

BARE = """
import sys
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.run import Training
import torch
torch.set_num_threads(1)
task, net, batch, iterations, seed = sys.argv[1:]
run = Training(TrainConfig(task=task, architecture=net, batch_steps=int(batch), seed=int(seed)))
for _ in range(int(iterations)):
    run.step()
"""


def bare(task: str, net: str, batch: int, iterations: int, folder: Path) -> list[list[str]]:
    """Two processes that train and do nothing else."""
    rest = [task, net, str(batch), str(iterations)]
    return [[sys.executable, "-c", BARE, *rest, seed] for seed in "01"]


def swept(task: str, net: str, batch: int, iterations: int, folder: Path) -> list[list[str]]:
    """The same two runs as a sweep."""
    grid = ["--tasks", task, "--architectures", net, "--seeds", "0", "1", "--workers", "2"]
    size = ["--batch-steps", str(batch), "--iterations", str(iterations)]
    places = ["--out", str(folder / "out"), "--runs-in", str(folder / "runs")]
    return [[sys.executable, "-m", "thesis_lib.cli", "sweep", *grid, *size, *places]]


GIVEN_BACK = {"MALLOC_TRIM_THRESHOLD_": "65536", "MALLOC_MMAP_THRESHOLD_": "131072"}
"""Dask's threshold, and glibc's that goes with it where nothing is set."""

SIDES: dict[str, tuple[Any, dict[str, str]]] = {
    "bare": (bare, {}),
    "swept": (swept, {}),
    "given back": (swept, GIVEN_BACK),
}


def seconds(commands: list[list[str]], environment: dict[str, str]) -> tuple[float, float, float]:
    """Processor and wall-clock seconds of processes side by side, and the pages they fetched.

    Their children are included.
    """
    start = time.perf_counter()
    around = os.environ | environment
    running = [subprocess.Popen(c, stdout=subprocess.DEVNULL, env=around) for c in commands]
    spent = faults = 0.0
    for process in running:
        _, status, usage = os.wait4(process.pid, 0)
        if status:
            raise SystemExit(f"{' '.join(process.args)} failed.")
        spent += usage.ru_utime + usage.ru_stime
        faults += usage.ru_minflt
    return spent, time.perf_counter() - start, faults


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--task", default="HalfCheetah")
    parser.add_argument("--architecture", default="dtrnn")
    parser.add_argument("--batch-steps", type=int, default=50_000)
    parser.add_argument("--iterations", type=int, nargs=2, default=(10, 40))
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    few, many = options.iterations
    found: dict[str, list[tuple[float, ...]]] = {name: [] for name in SIDES}
    for _ in range(options.repeats):
        for name, (commands, environment) in SIDES.items():
            ends = []
            for iterations in (few, many):
                with tempfile.TemporaryDirectory() as folder:
                    which = options.task, options.architecture, options.batch_steps
                    made = commands(*which, iterations, Path(folder))
                    ends.append(seconds(made, environment))
            found[name].append(tuple(b - a for a, b in zip(*ends, strict=True)))
    rows = []
    for peer_name, i, what, unit, target in (
        ("bare", 0, "processor", "s", 0.99),
        ("bare", 1, "wall clock", "s", 0.9),
        ("given back", 0, "processor, memory given back", "s", 1.0),
        ("given back", 2, "page faults, memory given back", "", 1.0),
    ):
        ours, peer = (statistics.median(f[i] for f in found[name]) for name in ("swept", peer_name))
        rows.append(
            {
                "name": f"{options.architecture.upper()}, {options.task}, two runs, {what}",
                "ours": ours,
                "peer": peer,
                "ratio": peer / ours,
                "target": target,
                "unit": unit,
            }
        )
    if options.json:
        print(json.dumps(rows, indent=1))
        return
    for row in rows:
        print(
            f"{row['name']:62} {row['ours']:10.2f} {row['unit']:1}, beside "
            f"{row['peer']:10.2f} {row['unit']:1}: ratio {row['ratio']:.3f} "
            f"(at least {row['target']})"
        )


if __name__ == "__main__":
    main()
