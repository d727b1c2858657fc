"""The thesis's robustness tests (section 5.4) on a controller without sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from thesis_lib.chapter5.cells import TESTED, as_published
from thesis_lib.chapter5.open_loop import NAME, SMOKE_SEARCH, Search, find_gait
from thesis_lib.chapter5.untrained import run_episodes
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import effect_of
from thesis_lib.locomotion.batch import BatchTask, Perturbation
from thesis_lib.locomotion.height_field import HeightField
from thesis_lib.locomotion.perturbations import TerrainSwitch, WhiteNoise
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.locomotion.tasks import TEST_HORIZON, make_task
from thesis_lib.locomotion.terrain import SWITCH_AT, hills
from thesis_lib.robustness import CONDITIONS, PERTURBATIONS, score


@dataclass(frozen=True)
class Config:
    """The tests, with open-loop gaits as controllers."""

    search: Search = field(default_factory=Search)
    searches: int = 2
    """Independent searches for each robot."""
    n_runs: int = 20
    steps: int = TEST_HORIZON
    difficulty: float = 1.0
    sigma: float = 1.0


@dataclass(frozen=True)
class Run:
    """One test run of one gait."""

    task: str
    """Name."""
    search: int
    """Index of the search that found the gait."""
    condition: str
    """base, noise, switch, or flat field (a height field of height 0)."""
    run: int
    """Index; one run starts from the same state in all conditions."""
    episode_return: float
    """Undiscounted, over at most 1000 steps."""
    length: int
    """Control steps."""
    distance: float
    """Way of the root along x [m]."""


@experiment(
    "ch5-open-loop",
    item="Section 5.4",
    smoke=Config(search=SMOKE_SEARCH, searches=2, n_runs=2, steps=60),
    book=Config(n_runs=10),
    thesis=Config(searches=10),
    seconds=47,
)
def runs(config: Config, context: Context) -> list[Run]:
    """The thesis's robustness tests on a controller without sensors."""

    def measure(job: tuple[str, int]) -> list[Run]:
        robot, index = job
        gait = find_gait(robot, config.search, context.seed, index)
        n = config.n_runs
        (seed,) = context.seeds(1, 5, 6, list(ROBOTS).index(robot), index)
        flat_field = hills(0.0, 0, robot=robot)
        conditions: dict[str, tuple[list[Perturbation], HeightField | None]] = {
            "base": ([], None),
            "noise": ([WhiteNoise(config.sigma)], None),
            "switch": ([TerrainSwitch(config.difficulty, seed=context.seed)], None),
            "flat field": ([], flat_field),
        }
        records = []
        for condition, (perturbations, terrain) in conditions.items():
            batch = BatchTask(
                make_task(robot, termination="test"),
                n,
                seed=seed,
                terrain=terrain,
                perturbations=perturbations,
                max_episode_steps=config.steps,
            )
            found = run_episodes(batch, gait.controller(n), config.steps)
            measured = [found[name] for name in ("episode_return", "length", "distance")]
            records += [
                Run(robot, index, condition, i, *values)
                for i, values in enumerate(zip(*measured, strict=True))
            ]
        return records

    jobs = [(robot, index) for robot in ROBOTS for index in range(config.searches)]
    return [record for found in context.map(measure, jobs, "open-loop gaits") for record in found]


@effect_of("5.1-flat-field", runs)
def flat_field(table: pd.DataFrame) -> str:
    """What the same gaits earn on the plane and on a flat height field."""
    own = table[table.task.isin(["HalfCheetah", "Ant"])]
    by = own.groupby(["task", "condition"]).episode_return.mean().unstack()
    parts = "; ".join(
        f"{robot} {row['base']:.0f} on the plane, {row['flat field']:.0f} on a flat height field"
        for robot, row in by.iterrows()
    )
    return (
        "A height field of height 0 makes several times as many contacts as a plane. The same "
        f"gaits earn in 1000 steps: {parts}. Here the ground before the switch is the plane itself."
    )


def _printed(condition: str, robot: str) -> pd.Series:
    """Printed returns of the networks trained on the flat, by architecture."""
    return as_published(TESTED[condition]).value.loc["flat"].loc[robot]


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """The gaits' 1000-step returns and, in brackets, the range of the printed networks."""
    mean = table.groupby(["task", "condition", "search"]).episode_return.mean()
    records = []
    for robot in ROBOTS:
        record = {"task": robot}
        for condition in CONDITIONS:
            printed = _printed(condition, robot)
            ours = " and ".join(f"{v:.0f}" for v in mean[robot, condition])
            heading = "regular" if condition == "base" else condition
            record[heading] = f"**{ours}** ({printed.min():.0f}–{printed.max():.0f})"
        records.append(record)
    return pd.DataFrame(records)


def scores(table: pd.DataFrame, robots: Sequence[str]) -> pd.DataFrame:
    """Equation 5.4 for the seven printed networks and the open-loop gait together."""
    records = []
    for robot in robots:
        own = table[table.task == robot].groupby("condition").episode_return.mean()
        base = _printed("base", robot)
        for condition in PERTURBATIONS:
            perturbed = _printed(condition, robot)[base.index]
            found = score(np.r_[base, own.base], np.r_[perturbed, own[condition]])
            best = int(found[:-1].argmax())
            records.append(
                {
                    "task": robot,
                    "perturbation": condition,
                    NAME: found[-1],
                    "best network": found[best],
                    "which": base.index[best],
                    "rank of 8": int((found > found[-1]).sum()) + 1,
                }
            )
    return pd.DataFrame(records)


def crossing(
    search: Search, seed: int, *, worlds: int = 12, frames: int = 6
) -> tuple[np.ndarray, HeightField, list[str]]:
    """States of a half-cheetah's run across the terrain switch, evenly spaced along its way.

    Of some worlds, that with the longest way is chosen.

    Returns
    -------
    tuple
        Positions, shape ``(frames, nq)``; the ground; and a caption for each state.
    """
    robot, switch = "HalfCheetah", TerrainSwitch(1.0, seed=seed)
    batch = BatchTask(
        make_task(robot, termination="test"), worlds, seed=seed, perturbations=[switch]
    )
    grounds = switch.ground(robot, worlds, np.random.SeedSequence(seed))
    act = find_gait(robot, search, seed).controller(worlds)
    batch.reset()
    path = [batch.qpos]
    for t in range(500):
        batch.step(act(t))
        path.append(batch.qpos)
    x = np.array(path)[:, :, 0]
    best = int(x[-1].argmax())
    furthest = np.maximum.accumulate(x[:, best])
    # From a little before the switch to the end of the way, or all of a way that ends before.
    start = min(SWITCH_AT[robot] - 2, furthest[-1] / 2)
    moments = [int(np.argmax(furthest >= p)) for p in np.linspace(start, furthest[-1], frames)]
    dt = ROBOTS[robot].control_dt
    captions = [f"{t * dt:.1f} s, x = {x[t, best]:.1f} m" for t in moments]
    ground = grounds[best]
    assert isinstance(ground, HeightField)
    return np.array([path[t][best] for t in moments]), ground, captions
