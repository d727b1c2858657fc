"""Task and domain relevance on the heat domain, estimated from many learned tasks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from thesis_lib.chapter4.heat_space import HeatLearner, HeatSpace
from thesis_lib.chapter4.protocol import wider
from thesis_lib.domains.heat import LAYOUTS, HeatWorld
from thesis_lib.edition.criteria import judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.words import several
from thesis_lib.relevance import Solutions, estimate, relevance, remove
from thesis_lib.stats import mean_ci


@dataclass(frozen=True)
class Config:
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

SMALL = 0.1
"""Largest share of the relevance of all features that is a small amount."""


@dataclass(frozen=True)
class Relevance:
    """Some features at one level of noise."""

    sensor: float
    """sigma_sensor; sigma_slip is .1."""
    removed: str
    """Features removed together from the full set."""
    task_relevance: float
    """rho_1, squared weight."""
    domain_relevance: float
    """Jackknife estimate of rho_infinity, squared weight."""
    ci95: float
    """Half-width of its 95% t interval over batches of tasks."""
    task_share: float
    """Task relevance over that of removing every feature."""
    share: float
    """Domain relevance over that of removing every feature."""
    share_ci95: float
    """Half-width of its 95% interval."""
    n_tasks: int
    """Tasks learned."""


SMOKE = Config(HeatSpace(learner=HeatLearner(episodes=20)), sensors=(0.02,), batches=2, tasks=4)


@experiment(
    "ch4-heat-relevance",
    item="Section 4.3 (heat domain)",
    smoke=SMOKE,
    book=Config(batches=4, tasks=40),
    thesis=Config(batches=40),
    seconds=10,
)
def relevances(config: Config, context: Context) -> list[Relevance]:
    """Task and domain relevance of the heat domain's features, from many learned tasks."""
    records = []
    for i, sensor in enumerate(config.sensors):
        space = config.space.with_noise(sensor)

        def batch(seed: np.random.SeedSequence, space: HeatSpace = space) -> list[list[float]]:
            rng = np.random.default_rng(seed)
            tasks = space.sample_tasks(config.tasks, rng)
            solutions = space.solutions([space.learn(task, rng) for task in tasks])
            return [estimates(solutions, names) for names in SETS.values()]

        label = f"heat relevance, sensor noise {sensor:g}"
        found = np.array(context.map(batch, context.seeds(config.batches, 4, 21, i), label))
        total = found[:, -1].mean(axis=0)
        for name, (single, limits) in zip(SETS, found.transpose(1, 2, 0), strict=True):
            task, limit = float(single.mean()), mean_ci(limits)
            records.append(
                Relevance(
                    sensor=sensor,
                    removed=name,
                    task_relevance=task,
                    domain_relevance=limit.mean,
                    ci95=limit.half_width,
                    task_share=float(task / total[0]),
                    share=limit.mean / total[1],
                    share_ci95=limit.half_width / total[1],
                    n_tasks=config.batches * config.tasks,
                )
            )
    return records


def estimates(solutions: Solutions, names: tuple[str, ...]) -> list[float]:
    """Task relevance and the jackknife estimate of domain relevance of removing features."""
    labels = remove(solutions, names)
    single = [relevance(labels, q, p) for q, p in zip(solutions.q, solutions.p, strict=True)]
    return [float(np.mean(single)), estimate(solutions, labels).domain]


@criterion("4.3-heat-reward")
def reward() -> Finding:
    """The reward of a step by its formula."""
    value = HeatWorld().step_reward
    return judged(
        round(value, 2) == -0.71,
        f"-10 over the diagonal of the area is {value:.4f}.",
        {"reward": value},
        otherwise=Verdict.REFUTED,
    )


@criterion("4.3-heat-features")
def number_of_features() -> Finding:
    """Whether a product grid with four tilings has 1664 tiles."""
    codings = [HeatWorld().coding(intervals) for intervals in LAYOUTS.values()]
    listed = "; ".join(
        f"{c.tilings} tilings of {' x '.join(map(str, c.tiles))} (x, y, heading, heat) give "
        f"{c.n_features}"
        for c in codings
    )
    return judged(
        all(c.n_features == 1664 for c in codings),
        f"{listed}, with one weight for each feature and action; the text does not say which.",
        otherwise=Verdict.REFUTED,
    )


@criterion("4.3-heat-information", relevances)
def information(table: pd.DataFrame) -> Finding:
    """Domain relevance of position and heading together, as a share."""
    own = table[table.removed == "x, y, heading"]
    listed = several(
        f"{r.share:.1%} ± {r.share_ci95:.1%} at {r.sensor:g}" for r in own.itertuples()
    )
    positive = bool((own.share > own.share_ci95).all())
    small = bool((own.share + own.share_ci95 <= SMALL).all())
    none = bool((own.share + own.share_ci95 * wider(len(own)) < 0).any())
    return judged(
        positive and small,
        f"Share of the domain relevance of all features that goes with x, y and heading: {listed} "
        f"({own.n_tasks.iloc[0]} tasks each).",
        {"most": float(own.share.max())},
        direction=positive,
        otherwise=Verdict.NOT_REPRODUCED if none else Verdict.INCONCLUSIVE,
    )


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Shares of domain relevance, one column a level of noise."""
    cell = table.share.map("{:.1%}".format) + " ± " + table.share_ci95.map("{:.1%}".format)
    wide = table.assign(cell=cell).pivot(index="removed", columns="sensor", values="cell")
    wide = wide.loc[[name for name in SETS if name != "all"]]
    wide.columns = [f"noise {sensor:g}" for sensor in wide.columns]
    return wide.reset_index()
