"""What the text leaves open on the heat domain, and what each choice changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.experiments.chapter4.heat import HeatConfig, measure_heat
from thesis_lib.experiments.chapter4.heat_worlds import HeatLearner, HeatSpace
from thesis_lib.experiments.chapter4.protocol import Protocol
from thesis_lib.relevance import Solutions, estimate, relevance, remove
from thesis_lib.selection import rates
from thesis_lib.stats import mean_ci


@dataclass(frozen=True)
class HeatRelevanceConfig:
    """Settings of the large-sample estimates of relevance."""

    space: HeatSpace = field(default_factory=HeatSpace)
    """The domain, its learner and its features."""
    sensors: tuple[float, ...] = (0.01, 0.02, 0.04, 0.06)
    """Values of sigma_sensor."""
    batches: int = 6
    """Independent batches of tasks, whose scatter gives the interval."""
    tasks: int = 60
    """Tasks in a batch."""


SETS: Mapping[str, tuple[str, ...]] = {
    "x": ("x",),
    "y": ("y",),
    "heading": ("heading",),
    "heat": ("heat",),
    "a": ("a",),
    "x, y": ("x", "y"),
    "x, y, heading": ("x", "y", "heading"),
    "x, y, heading, a": ("x", "y", "heading", "a"),
    "all": ("x", "y", "heading", "heat", "a"),
}
"""Features removed together from the full set."""


def run_relevance(config: HeatRelevanceConfig, context: Context) -> pd.DataFrame:
    """Estimate relevance from many tasks; columns are documented in :data:`HEAT_RELEVANCE`."""
    records = []
    for i, sensor in enumerate(config.sensors):
        space = config.space.with_noise(sensor)

        def batch(seed: np.random.SeedSequence, space: HeatSpace = space) -> list[list[float]]:
            rng = np.random.default_rng(seed)
            tasks = space.sample_tasks(config.tasks, rng)
            solutions = space.solutions([space.learn(task, rng) for task in tasks])
            return [_estimates(solutions, names) for names in SETS.values()]

        label = f"heat relevance, sensor noise {sensor:g}"
        found = np.array(context.map(batch, context.seeds(config.batches, 4, 21, i), label))
        total = found[:, -1].mean(axis=0)
        for j, name in enumerate(SETS):
            task, domain = found[:, j, 0], mean_ci(found[:, j, 1])
            records.append(
                {
                    "sensor": sensor,
                    "removed": name,
                    "task_relevance": float(task.mean()),
                    "domain_relevance": domain.mean,
                    "ci95": domain.half_width,
                    "task_share": float(task.mean() / total[0]),
                    "share": domain.mean / total[1],
                    "share_ci95": domain.half_width / total[1],
                    "n_tasks": config.batches * config.tasks,
                }
            )
    return rows(records)


def _estimates(solutions: Solutions, names: tuple[str, ...]) -> list[float]:
    """Task relevance and the jackknife estimate of domain relevance of removing features."""
    labels = remove(solutions, names)
    single = [relevance(labels, q, p) for q, p in zip(solutions.q, solutions.p, strict=True)]
    return [float(np.mean(single)), estimate(solutions, labels).domain]


HEAT_RELEVANCE: Experiment[HeatRelevanceConfig] = Experiment(
    id="section-4.3-heat",
    item="Section 4.3 (heat domain)",
    title="Task and domain relevance of the heat domain's features, from many learned tasks.",
    function=run_relevance,
    budgets={
        "smoke": HeatRelevanceConfig(
            space=HeatSpace(learner=HeatLearner(episodes=20)), sensors=(0.02,), batches=2, tasks=4
        ),
        "book": HeatRelevanceConfig(),
        "thesis": HeatRelevanceConfig(batches=40),
    },
    columns={
        "sensor": "sigma_sensor; sigma_slip is .1",
        "removed": "features removed together from the full set",
        "task_relevance": "rho_1, squared weight",
        "domain_relevance": "jackknife estimate of rho_infinity, squared weight",
        "ci95": "half-width of its 95% t interval over batches of tasks",
        "task_share": "task relevance over that of removing every feature",
        "share": "domain relevance over that of removing every feature",
        "share_ci95": "half-width of its 95% interval",
        "n_tasks": "tasks learned",
    },
    seconds={"smoke": 1, "book": 15, "thesis": 100},
)

READINGS: Mapping[str, Mapping[str, Any]] = {
    "as used": {},
    "stride .25": {"world": {"stride": 0.25}},
    "stride 1": {"world": {"stride": 1.0}},
    "turn pi/16": {"world": {"turn": np.pi / 16}},
    "turn pi/4": {"world": {"turn": np.pi / 4}},
    "heat exponential": {"world": {"intensity": "exponential"}},
    "heat linear": {"world": {"intensity": "linear"}},
    "noise in shares of the range": {"world": {"noise_scale": "range"}},
    "alpha .1": {"learner": {"alpha": 0.1}},
    "alpha .6": {"learner": {"alpha": 0.6}},
    "accumulating traces": {"learner": {"traces": "accumulating", "alpha": 0.1}},
    "gamma .98": {"learner": {"discount": 0.98}},
    "positions fine": {"space": {"layout": "positions"}},
    "sources off the walls": {"space": {"sources": "inside"}},
    "p(x|m) uniform": {"space": {"weighting": "uniform"}},
    "tiling may go": {"space": {"tilings": "feature"}},
    "observed tasks shaped": {"config": {"lessons": "shaped"}},
    "level 1e-4": {"config": {"fstek": 1e-4}},
    "level 1e-3": {"config": {"fstek": 1e-3}},
}
"""Options by reading, one changed at a time."""


READINGS_BASE = HeatConfig(
    sensors=(0.02,),
    protocol=Protocol(runs=12, tasks_seen=(5, 8), methods=("fs-tek", "none", "constant")),
    followed=0,
)


@dataclass(frozen=True)
class HeatReadingConfig:
    """Settings of the comparison of readings."""

    base: HeatConfig = READINGS_BASE
    """What every reading starts from."""
    readings: tuple[str, ...] = tuple(READINGS)
    """Keys of :data:`READINGS`."""


def changed(base: HeatConfig, reading: str) -> HeatConfig:
    """The config with one reading's options."""
    options = READINGS[reading]
    space = replace(
        base.space,
        world=replace(base.space.world, **options.get("world", {})),
        learner=replace(base.space.learner, **options.get("learner", {})),
        **options.get("space", {}),
    )
    return replace(base, space=space, **options.get("config", {}))


def run_readings(config: HeatReadingConfig, context: Context) -> pd.DataFrame:
    """Compare the readings; columns are documented in :data:`HEAT_READINGS`."""
    records = []
    for reading in config.readings:
        own = changed(config.base, reading)
        methods = own.protocol.methods
        for sensor in own.sensors:
            space = own.space.with_noise(sensor)
            runs = measure_heat(own, space, context, test=True)
            total = runs.returns[..., : own.first].sum(axis=-1)
            at = {m: methods.index(m) for m in methods}
            # Where the tiling may go it is neither right nor wrong to remove it.
            counted = [i for i, name in enumerate(space.feature_names) if name != "tiling"]
            truth = np.isin(np.array(space.feature_names)[counted], own.relevant)
            for j, n in enumerate(own.protocol.tasks_seen):
                plain = total[:, at["none"], j]
                gain = mean_ci(total[:, at["fs-tek"], j] - plain)
                control = mean_ci(total[:, at["constant"], j] - plain)
                fpr, tpr = rates(runs.support[:, at["fs-tek"], j][:, counted], truth)
                records.append(
                    {
                        "reading": reading,
                        "sensor": sensor,
                        "tasks_seen": n,
                        "gain": gain.mean,
                        "gain_ci95": gain.half_width,
                        "constant_gain": control.mean,
                        "constant_gain_ci95": control.half_width,
                        "none_return": float(plain.mean()),
                        "fpr": fpr,
                        "tpr": tpr,
                        "n_runs": own.protocol.runs,
                    }
                )
    return rows(records)


HEAT_READINGS: Experiment[HeatReadingConfig] = Experiment(
    id="figure-4.7-readings",
    item="Figures 4.7 and 4.8 (readings)",
    title="FS-TEK on the heat domain, by reading of what the text leaves open.",
    function=run_readings,
    budgets={
        "smoke": HeatReadingConfig(
            base=HeatConfig(
                space=HeatSpace(learner=HeatLearner(episodes=10)),
                sensors=(0.02,),
                protocol=Protocol(
                    runs=2, tests=1, tasks_seen=(4,), methods=("fs-tek", "none", "constant")
                ),
                first=1,
                followed=0,
            )
        ),
        "book": HeatReadingConfig(),
        "thesis": HeatReadingConfig(
            base=replace(READINGS_BASE, protocol=replace(READINGS_BASE.protocol, runs=100))
        ),
    },
    columns={
        "reading": "which option differs from the one used",
        "sensor": "sigma_sensor; sigma_slip is .1",
        "tasks_seen": "number of observed tasks n",
        "gain": "FS-TEK's return of the first five episodes less that without selection, paired",
        "gain_ci95": "half-width of its 95% t interval over runs",
        "constant_gain": "the constant potential's return less that without selection, paired",
        "constant_gain_ci95": "half-width of its 95% t interval over runs",
        "none_return": "mean return of the first five episodes without selection",
        "fpr": "share of x, y and heading that FS-TEK keeps",
        "tpr": "share of heat and action that FS-TEK keeps",
        "n_runs": "number of runs",
    },
    seconds={"smoke": 1, "book": 23, "thesis": 190},
)
