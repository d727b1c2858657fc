"""What a sweep will take: processor time, memory, and wall-clock time on so many cores."""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence

import pandas as pd

from thesis_lib.training.config import TrainConfig

NETS = ("ffwd", "dffwd", "dtrnn", "ctrnn", "gru", "lstm", "esn")
"""The nets that were measured, the columns of :data:`STEP_COST`."""

STEP_COST: Mapping[tuple[str, str], tuple[tuple[int, int], ...]] = {
    ("Swimmer", "flat"): ((39, 39), (50, 58), (38, 47), (41, 61), (41, 60), (39, 68), (36, 40)),
    ("Swimmer", "hill"): (
        *((245, 257), (244, 281), (237, 263), (241, 241)),
        *((240, 240), (239, 239), (235, 235)),
    ),
    ("Hopper", "flat"): ((30, 47), (41, 60), (31, 47), (36, 52), (34, 55), (37, 59), (37, 56)),
    ("Hopper", "hill"): ((49, 68), (55, 75), (48, 63), (54, 70), (48, 82), (54, 80), (54, 54)),
    ("HalfCheetah", "flat"): ((11, 14), (22, 28), (12, 21), (20, 37), (17, 30), (22, 44), (32, 31)),
    ("HalfCheetah", "hill"): ((12, 15), (24, 31), (19, 25), (28, 45), (19, 34), (30, 49), (37, 45)),
    ("Walker2d", "flat"): ((19, 24), (29, 36), (19, 24), (22, 37), (25, 34), (24, 40), (48, 53)),
    ("Walker2d", "hill"): ((21, 26), (38, 42), (25, 38), (30, 48), (33, 46), (28, 53), (44, 59)),
    ("Ant", "flat"): ((75, 83), (87, 118), (76, 91), (79, 103), (67, 91), (77, 103), (569, 765)),
    ("Ant", "hill"): ((80, 90), (98, 98), (88, 109), (90, 90), (77, 77), (87, 87), (580, 835)),
}
"""Processor microseconds a control step takes, learning from it included, in batches of 50,000 and
of 10,000 steps, for each of :data:`NETS`; ``benchmarks/end_to_end.py`` measures them again.

:meta hide-value:
"""

SMALL_BATCH = 22_400
"""Steps of a batch below which the second number holds; halfway between the two, by ratio."""

CORES = (2, 64, 1000)
"""Numbers of cores a plan gives the time for."""


def cost(config: TrainConfig) -> float:
    """About how many processor seconds a run takes from its first iteration to its last.

    A net or task that was not measured counts as the median of those that were.
    """
    table = pd.DataFrame(STEP_COST, index=list(NETS)).T
    size = int(config.batch_steps < SMALL_BATCH)
    measured = table.map(lambda pair: float(pair[size]))
    task = (config.task, config.terrain)
    row = measured.loc[task] if task in measured.index else measured.median()
    micro = row.get(config.architecture, row.median())
    return float(config.iterations * config.batch_steps * micro * 1e-6)


def not_measured(configs: Sequence[TrainConfig]) -> list[str]:
    """Tasks, with their ground, and nets of runs whose :func:`cost` is a guess, each once."""
    tasks = {f"{task} ({ground})": None for task, ground in STEP_COST}
    wanted = [name for c in configs for name in (f"{c.task} ({c.terrain})", c.architecture)]
    return [name for name in dict.fromkeys(wanted) if name not in tasks and name not in NETS]


def memory(config: TrainConfig) -> float:
    """About how many gigabytes a run takes: as measured, 1, and more for the Ant's reservoir."""
    if config.task == "Ant" and config.architecture == "esn":
        return max(1.0, 0.725 + 17.5e-6 * config.batch_steps)
    return 1.0


def plan(configs: Sequence[TrainConfig]) -> pd.DataFrame:
    """What runs will take, task by task.

    Returns
    -------
    pandas.DataFrame
        One row a task and terrain: how many ``runs``, processor hours of all (``core_hours``) and
        of the longest (``longest_hours``), gigabytes of the largest (``memory_gb``).
    """
    runs = pd.DataFrame(
        {
            "task": [c.task for c in configs],
            "terrain": [c.terrain for c in configs],
            "hours": [cost(c) / 3600 for c in configs],
            "memory": [memory(c) for c in configs],
        }
    )
    groups = runs.groupby(["task", "terrain"], sort=False)
    found = groups.agg(
        runs=("hours", "size"),
        core_hours=("hours", "sum"),
        longest_hours=("hours", "max"),
        memory_gb=("memory", "max"),
    )
    return found.reset_index()


def makespan(seconds: Sequence[float], cores: int) -> float:
    """Wall-clock seconds until all runs are done, each begun by the first core that is free.

    Parameters
    ----------
    seconds
        Of each run, in the order in which they are handed out.
    cores
        How many run at a time.
    """
    free = [0.0] * cores
    for run in seconds:
        heapq.heapreplace(free, free[0] + run)
    return max(free)
