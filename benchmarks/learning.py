"""Whether every net learns on every flat task, and how long it takes.

One seed, 60 iterations of 10,000 steps with the settings of table 5.1: mean return of the
first batch and of the last five, steps a second of processor time end to end (sampling and
learning), seconds.  With ``--precision both`` the same runs in float32 and float64 over several
seeds, which tells how much the number type matters.

    python benchmarks/learning.py [--json] [--tasks Hopper Ant] [--nets dtrnn gru]
        [--iterations 60] [--batch-steps 10000] [--seeds 1] [--precision float32|both]
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from typing import Any

import torch

from thesis_lib.experiments.training import TrainConfig, train
from thesis_lib.locomotion import TASKS
from thesis_lib.policies import ARCHITECTURES

LAST = 5
"""Iterations averaged at the end."""


def run(config: TrainConfig) -> dict[str, Any]:
    wall, start = time.perf_counter(), time.process_time()
    curve = train(config).curve
    learning = curve.sampling_seconds.sum() + curve.update_seconds.sum()
    return {
        "name": f"{config.task}, {config.architecture}",
        "task": config.task,
        "net": config.architecture,
        "seed": config.seed,
        "precision": config.precision,
        "first_return": curve.mean_return.iloc[0],
        "last_return": curve.mean_return.tail(LAST).mean(),
        "best_return": curve.mean_return.max(),
        "rejected_updates": int((~curve.accepted).sum()),
        "steps": int(curve.steps.iloc[-1]),
        "thrown_away": curve.simulated.sum() / curve.steps.iloc[-1] - 1,
        "steps_per_second": curve.steps.iloc[-1] / learning,
        "processor_seconds": time.process_time() - start,
        "wall_seconds": time.perf_counter() - wall,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--json", action="store_true", help="print rows as JSON")
    parser.add_argument("--tasks", nargs="*", default=list(TASKS))
    parser.add_argument("--nets", nargs="*", default=list(ARCHITECTURES))
    parser.add_argument("--iterations", type=int, default=60)
    parser.add_argument("--batch-steps", type=int, default=10_000)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--precision", choices=["float32", "float64", "both"], default="float32")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    both = arguments.precision == "both"
    rows = []
    for task in arguments.tasks:
        for net in arguments.nets:
            for seed in range(arguments.seeds):
                for precision in ("float32", "float64") if both else (arguments.precision,):
                    config = TrainConfig(
                        task=task,
                        architecture=net,
                        seed=seed,
                        iterations=arguments.iterations,
                        batch_steps=arguments.batch_steps,
                        precision=precision,
                    )
                    row = run(config)
                    rows.append(row)
                    if not arguments.json:
                        print(
                            f"{row['name']:28} seed {seed} {precision}  return "
                            f"{row['first_return']:8.1f} -> {row['last_return']:8.1f}  "
                            f"{row['steps_per_second']:7,.0f} steps/s  "
                            f"{row['thrown_away']:5.1%} thrown away  "
                            f"{row['wall_seconds']:6.0f} s",
                            flush=True,
                        )
    if arguments.json:
        json.dump(rows, sys.stdout, indent=1)


if __name__ == "__main__":
    main()
