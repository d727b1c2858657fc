"""A million control steps of every task: no NaN, no warning from the engine, no leak.

Random actions drive ordinary episodes; extreme ones (every motor at full torque, changing
sign now and then) drive episodes that nothing but 10,000 steps can end.

    python benchmarks/locomotion_health.py [--steps N] [--hills] [--json]
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import time
from pathlib import Path

import numpy as np

from thesis_lib.locomotion import TASKS, BatchTask, make_task
from thesis_lib.locomotion.terrain import hills

WORLDS = 100


@dataclasses.dataclass
class Health:
    """What was seen in one long run."""

    name: str
    steps: int
    episodes: int
    not_finite: int
    engine_warnings: int
    diverged: int
    off_map: int
    rss_growth_mib: float
    largest_velocity: float
    seconds: float


def resident_mib() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 2**20


def actions(kind: str, size: int, rng: np.random.Generator):
    """Endless actions: uniform, or full torque whose sign flips every 20 steps on average."""
    sign = rng.choice([-1.0, 1.0], (WORLDS, size))
    while True:
        if kind == "random":
            yield rng.uniform(-1, 1, (WORLDS, size))
        else:
            sign[rng.random(sign.shape) < 0.05] *= -1
            yield sign


def run(name: str, kind: str, hilly: bool, steps: int) -> Health:
    extreme = kind == "extreme"
    batch = BatchTask(
        make_task(name, termination="never" if extreme else "train"),
        WORLDS,
        seed=1,
        terrain=hills(1.0, 0, robot=name) if hilly else None,
        max_episode_steps=10_000 if extreme else 500,
        autoreset=True,
    )
    batch.reset()
    health = Health(
        f"{name} {'hills' if hilly else 'flat'} {kind}", 0, 0, 0, 0, 0, 0, 0.0, 0.0, 0.0
    )
    rounds = steps // WORLDS
    base = 0.0
    began = time.perf_counter()
    for t, action in zip(
        range(rounds), actions(kind, batch.action_size, np.random.default_rng(2)), strict=False
    ):
        step = batch.step(action)
        finite = np.isfinite(step.observation).all() and np.isfinite(step.reward).all()
        health.not_finite += not finite
        health.episodes += int((step.terminated | step.truncated).sum())
        health.diverged += int(step.info.diverged.sum())
        health.off_map += int(step.info.off_map.sum())
        if t % 100 == 0:
            fastest = float(np.abs(batch.qvel).max())
            health.largest_velocity = max(health.largest_velocity, fastest)
        if t == rounds // 10:
            base = resident_mib()
    health.steps = rounds * WORLDS
    health.engine_warnings = sum(batch.engine_warnings.values())
    health.rss_growth_mib = resident_mib() - base
    health.seconds = time.perf_counter() - began
    return health


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--hills", action="store_true", help="on hills of difficulty 1")
    parser.add_argument("--tasks", nargs="+", default=list(TASKS), choices=TASKS)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    rows = []
    for name in arguments.tasks:
        for kind in ("random", "extreme"):
            health = run(name, kind, arguments.hills, arguments.steps)
            rows.append(dataclasses.asdict(health))
            if not arguments.json:
                print(
                    f"{health.name:26s} {health.steps:9d} steps {health.episodes:7d} episodes, "
                    f"{health.not_finite} not finite, {health.engine_warnings} warnings, "
                    f"{health.diverged} diverged, {health.off_map} off the map, "
                    f"memory {health.rss_growth_mib:+.1f} MiB, "
                    f"|qvel| up to {health.largest_velocity:.0f}, {health.seconds:.0f} s",
                    flush=True,
                )
    if arguments.json:
        print(json.dumps(rows, indent=1))
    sick = [r for r in rows if r["not_finite"] or r["engine_warnings"] or r["diverged"]]
    sys.exit(bool(sick))


if __name__ == "__main__":
    main()
