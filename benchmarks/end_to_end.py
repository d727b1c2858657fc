"""Training from end to end beside the bare stepper, and the memory of a large reservoir.

One thread.  Steps a second of processor time are those learned from, over sampling and update
together, median of the iterations after the first, in batches of 50,000.  The bare stepper is the
same worlds under standard normal actions, which is what an untrained policy does, with nothing
learned; the two take turns.  The echo state network is the Ant's, of 3,256 units: one iteration,
and the peak of the whole process's memory.

    python benchmarks/end_to_end.py [--json] [--tasks Hopper Ant] [--terrain flat]
        [--architectures ffwd dtrnn ctrnn] [--no-memory]
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import resource
import time
from typing import Any

import numpy as np

from thesis_lib.locomotion import BatchTask
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.surroundings import own_settings
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.parts import make_batch_task
from thesis_lib.training.run import Training

TARGET_RATIO = 1 / 1.5
TARGET_MEMORY = 3.0
GOALS = ("ffwd", "dtrnn", "ctrnn")


def rate(architecture: str, config: TrainConfig, iterations: int) -> dict[str, Any]:
    """Steps a second of one network, and of its worlds alone."""
    run = Training(dataclasses.replace(config, architecture=architecture))
    worlds = make_batch_task(run.config)
    bare = []
    for _ in range(iterations + 1):
        run.step()
        bare.append(stepped(worlds, run.config.batch_steps))
    curve = run.curve
    seconds = curve.sampling_seconds + curve.update_seconds
    ours = float((np.diff(curve.steps, prepend=0) / seconds).iloc[1:].median())
    peer = float(np.median(bare[1:]))
    return {
        "name": f"{architecture.upper()}, {config.task} {config.terrain}",
        "ours": ours,
        "peer": peer,
        "ratio": ours / peer,
        "target": TARGET_RATIO if architecture in GOALS else None,
        "unit": "steps per processor s",
    }


def stepped(worlds: BatchTask, steps: int) -> float:
    """Steps a second of worlds that restart when they end, under random actions."""
    draw = np.random.default_rng(0)
    actions = draw.standard_normal((64, worlds.num_envs, worlds.action_size))
    worlds.reset()
    start, done = time.process_time(), 0
    while done < steps:
        outcome = worlds.step(actions[done // worlds.num_envs % 64])
        done += worlds.num_envs
        ended = np.flatnonzero(outcome.terminated | outcome.truncated)
        if ended.size:
            worlds.reset(ended)
    return done / (time.process_time() - start)


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
    parser.add_argument("--tasks", nargs="*", default=list(ROBOTS))
    parser.add_argument("--terrain", default="flat")
    parser.add_argument("--architectures", nargs="*", default=list(GOALS))
    parser.add_argument("--batch-steps", type=int, default=50_000)
    parser.add_argument("--iterations", type=int, default=5)
    parser.add_argument("--memory", action=argparse.BooleanOptionalAction, default=True)
    arguments = parser.parse_args()
    rows = [memory()] if arguments.memory else []  # first, while nothing else has peaked
    for task in arguments.tasks:
        config = TrainConfig(
            task=task, terrain=arguments.terrain, batch_steps=arguments.batch_steps
        )
        rows += [rate(name, config, arguments.iterations) for name in arguments.architectures]
    if arguments.json:
        print(json.dumps(rows, indent=1))
        return
    for row in rows:
        beside = f"{row['ratio']:.2f} of the bare stepper's" if "ratio" in row else ""
        target = "" if row["target"] is None else f"target {row['target']:.2f}"
        print(f"{row['name']:36} {row['ours']:10,.2f} {row['unit']:22} {beside} {target}")


if __name__ == "__main__":
    with own_settings():
        main()
