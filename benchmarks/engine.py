"""What the engine of sweeps costs: two runs by `thesis sweep` beside two bare processes.

A bare process calls ``Training.step`` and keeps nothing.  Each side runs for few and for many
iterations, so that starting up is taken out: reported are the differences, of processor seconds
(the overhead, which a busy machine hardly changes) and of wall-clock seconds (the throughput,
which needs a quiet one).

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


def seconds(commands: list[list[str]]) -> tuple[float, float]:
    """Processor and wall-clock seconds of processes side by side, their children included."""
    start = time.perf_counter()
    running = [subprocess.Popen(c, stdout=subprocess.DEVNULL) for c in commands]
    spent = 0.0
    for process in running:
        _, status, usage = os.wait4(process.pid, 0)
        if status:
            raise SystemExit(f"{' '.join(process.args)} failed.")
        spent += usage.ru_utime + usage.ru_stime
    return spent, time.perf_counter() - start


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
    found: dict[str, list[tuple[float, float]]] = {"bare": [], "swept": []}
    for _ in range(options.repeats):
        for name, commands in (("bare", bare), ("swept", swept)):
            ends = []
            for iterations in (few, many):
                with tempfile.TemporaryDirectory() as folder:
                    which = options.task, options.architecture, options.batch_steps
                    ends.append(seconds(commands(*which, iterations, Path(folder))))
            found[name].append((ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]))
    rows = []
    for i, (what, target) in enumerate((("processor", 0.99), ("wall clock", 0.9))):
        ours, peer = (statistics.median(f[i] for f in found[name]) for name in ("swept", "bare"))
        rows.append(
            {
                "name": f"{options.architecture.upper()}, {options.task}, two runs, {what}",
                "ours": ours,
                "peer": peer,
                "ratio": peer / ours,
                "target": target,
                "unit": "s",
            }
        )
    if options.json:
        print(json.dumps(rows, indent=1))
        return
    for row in rows:
        print(
            f"{row['name']:46} {row['ours']:8.2f} s, bare {row['peer']:8.2f} s: "
            f"{row['ratio']:.3f} of a bare process's rate (at least {row['target']})"
        )


if __name__ == "__main__":
    main()
