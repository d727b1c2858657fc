"""The batch of worlds against the bare stepper, one world in Python, and AsyncVectorEnv.

For the five robots, flat and on hills of difficulty 0.5, with random actions:

* closed loop: ``BatchTask`` with observation, reward, termination and reset;
* bare: ``mujoco.batch.Batch`` with the same model, threads and forward stage, led through the
  same states (rows of worlds that were reset are copied in), and nothing else;
* one world: ``gymnasium.make("thesis/...")`` in a Python loop;
* async: Gymnasium's ``AsyncVectorEnv`` of it;
* limit: two processes at once, each with a bare stepper of one thread and half the worlds.

Rates are medians of interleaved rounds: control steps a second by the wall clock, with
``--threads``, and control steps a CPU second, with one thread (idle threads spin and count).
The latter leave out what two cores gain over one, but other work disturbs them less.

    python benchmarks/locomotion.py [--json] [--repeats 5] [--worlds 128] [--threads 2]
    python benchmarks/locomotion.py --memory    resident memory of 1, 64 and 1024 worlds

What a coarser height field buys and costs is measured in benchmarks/terrain.py.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import multiprocessing
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import gymnasium
import mujoco.batch
import numpy as np

from thesis_lib.locomotion import TASKS, BatchTask
from thesis_lib.locomotion.terrain import hill_maps, hills
from thesis_lib.registration import HILL_DIFFICULTY

SECONDS = 0.6
"""How long one measurement should last."""

ASYNC_ENVS = 16


def build(name: str, hilly: bool, worlds: int, threads: int) -> BatchTask:
    ground = hills(HILL_DIFFICULTY, 0, robot=name) if hilly else None
    batch = BatchTask(name, worlds, threads=threads, seed=0, terrain=ground, autoreset=True)
    batch.reset()
    return batch


def random_actions(steps: int, *shape: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(-1, 1, (steps, *shape))


class Bare:
    """The stepper alone, made to pass through the states of a closed loop."""

    def __init__(self, batch: BatchTask, threads: int) -> None:
        inner = batch._batch
        self.batch = mujoco.batch.Batch(
            batch.model, batch.num_envs, threads, persistent=inner.persistent
        )
        self.stage, self.skip = batch._stage, batch.task.robot.frame_skip
        self.ctrl = self.batch.bind("ctrl")
        self.fields = [self.batch.bind(name) for name in inner._bound]
        self.start = inner.state.copy()
        self.end = self.start
        self.changes: list[tuple[np.ndarray, np.ndarray] | None] = []

    def record(self, batch: BatchTask, actions: np.ndarray) -> tuple[float, float]:
        """Run the closed loop, noting the rows of worlds it resets; wall and CPU seconds."""
        inner = batch._batch
        self.start, self.changes, wall, cpu = inner.state.copy(), [], 0.0, 0.0
        for action in actions:
            began, used = time.perf_counter(), time.process_time()
            step = batch.step(action)
            wall += time.perf_counter() - began
            cpu += time.process_time() - used
            ids = np.flatnonzero(step.terminated | step.truncated)
            self.changes.append((ids, inner.state[ids]) if len(ids) else None)
        self.end = inner.state.copy()
        return wall, cpu

    def replay(self, actions: np.ndarray) -> tuple[float, float]:
        """Step through the same states; wall and CPU seconds."""
        self.batch.state[:] = self.start
        self.batch.forward(stage=self.stage)
        began, used = time.perf_counter(), time.process_time()
        for action, change in zip(actions, self.changes, strict=True):
            self.ctrl[:] = action
            self.batch.step(nstep=self.skip, stage=self.stage)
            if change is not None:
                self.batch.state[change[0]] = change[1]
        seconds = time.perf_counter() - began, time.process_time() - used
        if not np.array_equal(self.batch.state, self.end):
            raise RuntimeError("the bare stepper took another way than the closed loop")
        return seconds


def one_world(env: gymnasium.Env, actions: np.ndarray) -> tuple[float, float]:
    """Wall and CPU seconds of one world in a Python loop."""
    began, used = time.perf_counter(), time.process_time()
    for action in actions:
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()
    return time.perf_counter() - began, time.process_time() - used


def many_worlds(envs: gymnasium.vector.AsyncVectorEnv, actions: np.ndarray) -> tuple[float, float]:
    """Wall and CPU seconds of a vector environment, its processes' included."""
    began, used = time.perf_counter(), time.process_time() + cpu_of(envs)
    for action in actions:
        envs.step(action)
    return time.perf_counter() - began, time.process_time() + cpu_of(envs) - used


def cpu_of(envs: gymnasium.vector.AsyncVectorEnv) -> float:
    """CPU seconds that the processes of a vector environment have used."""
    ticks = 0
    for process in envs.processes:
        fields = Path(f"/proc/{process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


def half_of_the_machine(
    name: str, hilly: bool, worlds: int, steps: int, gate: Any, out: Any
) -> None:
    """One of two processes: a bare stepper of one thread, measured on a signal."""
    batch = build(name, hilly, worlds, 1)
    actions = random_actions(steps, worlds, batch.action_size)
    bare = Bare(batch, 1)
    bare.record(batch, actions)
    while gate.wait() is not None:
        out.put(steps * worlds / bare.replay(actions)[0])


class Limit:
    """What two processes reach together."""

    def __init__(self, name: str, hilly: bool, worlds: int, steps: int) -> None:
        context = multiprocessing.get_context("spawn")
        self.gate, self.out = context.Barrier(3), context.Queue()
        self.processes = [
            context.Process(
                target=half_of_the_machine,
                args=(name, hilly, worlds // 2, steps, self.gate, self.out),
                daemon=True,
            )
            for _ in range(2)
        ]
        for process in self.processes:
            process.start()

    def rate(self) -> float:
        """Control steps a second of both together, in one measurement."""
        self.gate.wait()
        return sum(self.out.get() for _ in self.processes)

    def close(self) -> None:
        """End both processes."""
        for process in self.processes:
            process.kill()


def steps_for(measure: Callable[[int], float]) -> int:
    """How many steps fill the time of one measurement."""
    steps = 8
    while (spent := measure(steps)) < SECONDS / 8:
        steps *= 2
    return max(4, round(steps * SECONDS / spent))


def compare(
    name: str, hilly: bool, worlds: int, threads: int, repeats: int
) -> list[dict[str, Any]]:
    label = f"{name} {'hills' if hilly else 'flat'}"
    env_id = f"thesis/{name}{'Hill' if hilly else ''}-v0"
    batch, alone_on_a_core = build(name, hilly, worlds, threads), build(name, hilly, worlds, 1)
    bare, bare_on_a_core = Bare(batch, threads), Bare(alone_on_a_core, 1)
    size = batch.action_size
    steps = steps_for(lambda k: bare.record(batch, random_actions(k, worlds, size))[0])
    actions = random_actions(steps, worlds, size)

    env = gymnasium.make(env_id, disable_env_checker=True)
    env.reset(seed=0)
    k = steps_for(lambda k: one_world(env, random_actions(k, size))[0])
    alone = random_actions(k, size)

    envs = gymnasium.vector.AsyncVectorEnv(
        [lambda: gymnasium.make(env_id, disable_env_checker=True)] * ASYNC_ENVS, context="fork"
    )
    envs.reset(seed=0)
    k = steps_for(lambda k: many_worlds(envs, random_actions(k, ASYNC_ENVS, size))[0])
    apart = random_actions(k, ASYNC_ENVS, size)
    limit = Limit(name, hilly, worlds, steps)

    keys = ("closed", "bare", "closed x1", "bare x1", "one", "async")
    rates: dict[str, list[float]] = {k: [] for k in (*keys, *(f"{k} cpu" for k in keys), "limit")}
    for _ in range(repeats):
        seconds = {
            "closed": (steps * worlds, bare.record(batch, actions)),
            "bare": (steps * worlds, bare.replay(actions)),
            "closed x1": (steps * worlds, bare_on_a_core.record(alone_on_a_core, actions)),
            "bare x1": (steps * worlds, bare_on_a_core.replay(actions)),
            "one": (len(alone), one_world(env, alone)),
            "async": (len(apart) * ASYNC_ENVS, many_worlds(envs, apart)),
        }
        for key, (count, (wall, cpu)) in seconds.items():
            rates[key].append(count / wall)
            rates[f"{key} cpu"].append(count / cpu)
        rates["limit"].append(limit.rate())
    envs.close()
    limit.close()
    wall, cpu = "control steps/s", "control steps/cpu-s"
    peers = (
        ("bare stepper, same stage", "closed", "bare", wall),
        ("bare stepper, same stage", "closed x1 cpu", "bare x1 cpu", cpu),
        ("one world in a Python loop", "closed", "one", wall),
        ("one world in a Python loop", "closed x1 cpu", "one cpu", cpu),
        (f"AsyncVectorEnv x {ASYNC_ENVS}", "closed", "async", wall),
        (f"AsyncVectorEnv x {ASYNC_ENVS}", "closed x1 cpu", "async cpu", cpu),
        ("two processes, bare", "closed", "limit", wall),
    )
    # a ratio is taken within each round, so that what else the machine does cancels
    return [
        {
            "name": f"{label}: closed loop vs {peer}",
            "ours": median(rates[ours]),
            "peer": median(rates[theirs]),
            "ratio": median(a / b for a, b in zip(rates[ours], rates[theirs], strict=True)),
            "unit": unit,
        }
        for peer, ours, theirs, unit in peers
    ]


def resident_mib() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20


GROUNDS = ("flat", "hills", "own hills")
"""The floor; one map for all worlds; a map for each."""


def memory_here(name: str, ground: str, worlds: int) -> float:
    """Resident MiB that a batch adds to this process, after some steps."""
    before = resident_mib()
    maps = hill_maps(worlds if ground == "own hills" else 1, HILL_DIFFICULTY, 0, robot=name)
    terrain = {"flat": None, "hills": maps[0], "own hills": maps}[ground]
    batch = BatchTask(name, worlds, terrain=terrain, autoreset=True)
    del maps, terrain
    batch.reset()
    for action in random_actions(20, worlds, batch.action_size):
        batch.step(action)
    ctypes.CDLL(None).malloc_trim(0)  # what was freed is not held
    return resident_mib() - before


def memory(names: list[str]) -> list[dict[str, Any]]:
    """Resident memory of batches, each in a process of its own."""
    rows = []
    for name in names:
        for ground in GROUNDS:
            used = {}
            for worlds in (1, 64, 1024):
                command = [sys.executable, __file__, "--measure-memory", name, ground]
                answer = subprocess.run(
                    [*command, str(worlds)], capture_output=True, text=True, check=True
                )
                used[worlds] = float(answer.stdout)
            for worlds, mib in used.items():
                rows.append(
                    {
                        "name": f"{name} {ground}: {worlds} worlds vs 1",
                        "ours": mib,
                        "peer": used[1],
                        "ratio": mib / used[1] if used[1] else None,
                        "unit": "MiB",
                    }
                )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--worlds", type=int, default=128)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--tasks", nargs="+", default=list(TASKS), choices=TASKS)
    parser.add_argument("--memory", action="store_true")
    parser.add_argument("--measure-memory", nargs=3, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure_memory:
        name, ground, worlds = arguments.measure_memory
        print(memory_here(name, ground, int(worlds)))
        return
    rows = []
    if arguments.memory:
        rows = memory(arguments.tasks)
    else:
        for name in arguments.tasks:
            for hilly in (False, True):
                rows += compare(name, hilly, arguments.worlds, arguments.threads, arguments.repeats)
                if not arguments.json:
                    for row in rows[-7:]:
                        print(line(row), flush=True)
    if arguments.json:
        print(json.dumps(rows, indent=1))
    elif arguments.memory:
        print("\n".join(map(line, rows)))


def line(row: dict[str, Any]) -> str:
    ratio = "" if row["ratio"] is None else f"{row['ratio']:8.2f}x"
    return f"{row['name']:90s} {row['ours']:12.1f} {row['peer']:12.1f} {ratio}  {row['unit']}"


if __name__ == "__main__":
    main()
