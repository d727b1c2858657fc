"""Whether the swimmer gets stuck (section 5.1.1)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from thesis_lib.chapter5.open_loop import SMOKE_SEARCH, Search, find_gait
from thesis_lib.chapter5.untrained import untrained
from thesis_lib.edition.criteria import LEVEL, graded
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.locomotion.batch import BatchTask
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.locomotion.tasks import HORIZON
from thesis_lib.stats import equivalence, mean_ci, welch

MARGIN = 0.25
"""Distances that differ by less than this share count as equal."""


@dataclass(frozen=True)
class Config:
    """An open-loop gait takes over from a fresh start, or after random actions."""

    search: Search = field(default_factory=Search)
    n_runs: int = 100
    struggle: int = 200
    """Steps of the untrained controller before."""
    steps: int = HORIZON
    robots: tuple[str, ...] = ("Swimmer", "HalfCheetah")
    """Those that an open-loop gait moves and no limit stops."""


@dataclass(frozen=True)
class Run:
    """One run of the gait."""

    task: str
    """Name."""
    start: str
    """reset, or struggle: after 200 steps of the untrained controller."""
    run: int
    """Index."""
    distance: float
    """Between start and end on the ground [m]."""


@experiment(
    "ch5-recovery",
    item="Section 5.1.1, Swimmer",
    smoke=Config(search=SMOKE_SEARCH, n_runs=3, struggle=10, steps=20),
    book=Config(),
    seconds=7,
    claims_read={"robots": ("Swimmer",)},
)
def runs(config: Config, context: Context) -> list[Run]:
    """Does an open-loop gait get as far after a struggle as from a fresh start?"""

    def measure(robot: str) -> list[Run]:
        gait = find_gait(robot, config.search, context.seed)
        n, records = config.n_runs, []
        for k, start in enumerate(("reset", "struggle")):
            cell = (list(ROBOTS).index(robot), k)
            (seed,) = context.seeds(1, 5, 7, *cell)
            batch = BatchTask(robot, n, seed=seed, max_episode_steps=None)
            batch.reset()
            if start == "struggle":
                act = untrained(robot, context.seeds(n, 5, 8, *cell))
                for t in range(config.struggle):
                    batch.step(act(t))
            before = batch.qpos[:, :2]
            act = gait.controller(n)
            for t in range(config.steps):
                batch.step(act(t))
            moved = batch.qpos[:, :2] - before
            if robot not in ("Swimmer", "Ant"):
                moved[:, 1] = 0  # the planar robots' second coordinate is their height
            records += [Run(robot, start, i, float(np.hypot(*m))) for i, m in enumerate(moved)]
        return records

    found = context.map(measure, config.robots, "recovery")
    return [record for records in found for record in records]


@criterion("5.1-swimmer-recovers", runs)
def swimmer_recovers(table: pd.DataFrame) -> Finding:
    """How far a gait moves the swimmer after a struggle and from a fresh start."""
    own = table[table.task == "Swimmer"]
    fresh, after = (own[own.start == start].distance for start in ("reset", "struggle"))
    mean, late = mean_ci(fresh), mean_ci(after)
    margin = MARGIN * mean.mean
    test, gap = equivalence(after, fresh, margin), welch(after, fresh)
    evidence = (
        f"The same gait covers {mean.mean:.2f} ± {mean.half_width:.2f} m from a reset and "
        f"{late.mean:.2f} ± {late.half_width:.2f} m after random actions (n = {mean.n} each); "
        f"equal within {MARGIN:.0%} with p = {test.p_value:.2g}; least way after random "
        f"actions {after.min():.2f} m."
    )
    as_far = test.p_value < LEVEL or gap.low > -margin
    denied = gap.high < -margin
    return Finding(graded(as_far, denied=denied, otherwise=Verdict.INCONCLUSIVE), evidence)
