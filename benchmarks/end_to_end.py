"""Training from end to end: steps a second of a core, and the memory of a large reservoir.

One thread.  Steps a second of processor time are those learned from, over sampling and update
together, median of the iterations after the first; the thesis's Hopper with batches of 50,000.
The echo state network is the Ant's, of 3,256 units: one iteration, and the peak of the whole
process's memory.

    python benchmarks/end_to_end.py [--json] [--architectures dtrnn ctrnn] [--no-memory]
"""

from __future__ import annotations

import argparse
import json
import resource
from typing import Any

import numpy as np

from thesis_lib.training.config import TrainConfig
from thesis_lib.training.run import Training
from thesis_lib.training.train import use_one_thread

TARGET_RATE = 20_000
TARGET_MEMORY = 3.0


def rate(architecture: str, task: str, batch: int, iterations: int) -> dict[str, Any]:
    """Steps a second of one network."""
    run = Training(TrainConfig(task=task, architecture=architecture, batch_steps=batch))
    for _ in range(iterations + 1):
        run.step()
    curve = run.curve
    seconds = curve.sampling_seconds + curve.update_seconds
    rates = (np.diff(curve.steps, prepend=0) / seconds).iloc[1:]
    return {
        "name": f"{architecture.upper()}, {task}",
        "ours": float(rates.median()),
        "target": TARGET_RATE if architecture == "dtrnn" else None,
        "unit": "steps per processor s",
    }


def memory() -> dict[str, Any]:
    """Peak memory of one iteration of the Ant's echo state network."""
    run = Training(TrainConfig(task="Ant", architecture="esn", batch_steps=50_000))
    row = run.step()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return {
        "name": f"ESN of {run.policy.hidden_size:,} units, Ant, {row['steps']:,} steps",
        "ours": peak,
        "target": TARGET_MEMORY,
        "unit": "GiB at the peak",
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--json", action="store_true", help="print rows as JSON")
    parser.add_argument("--task", default="Hopper")
    parser.add_argument("--architectures", nargs="*", default=["dtrnn", "ctrnn", "gru", "lstm"])
    parser.add_argument("--batch-steps", type=int, default=50_000)
    parser.add_argument("--iterations", type=int, default=5)
    parser.add_argument("--memory", action=argparse.BooleanOptionalAction, default=True)
    arguments = parser.parse_args()
    use_one_thread()
    rows = [memory()] if arguments.memory else []  # first, while nothing else has peaked
    rows += [
        rate(name, arguments.task, arguments.batch_steps, arguments.iterations)
        for name in arguments.architectures
    ]
    if arguments.json:
        print(json.dumps(rows, indent=1))
        return
    for row in rows:
        target = "" if row["target"] is None else f"target {row['target']:,}"
        print(f"{row['name']:46} {row['ours']:10,.2f} {row['unit']:22} {target}")


if __name__ == "__main__":
    main()
