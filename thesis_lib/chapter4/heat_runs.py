"""The protocol of section 4.3 on the heat domain, which figures 4.7 and 4.8 share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from thesis_lib.arrays import BoolArray, FloatArray
from thesis_lib.chapter4.heat_space import HeatLearner, HeatSpace
from thesis_lib.chapter4.protocol import SMALL as SMALL_PROTOCOL
from thesis_lib.chapter4.protocol import Level, Protocol, selectors
from thesis_lib.chapter4.runs import Run, choose
from thesis_lib.checks import one_of
from thesis_lib.domains.heat import HeatTask
from thesis_lib.domains.heat_learning import HeatLearned
from thesis_lib.edition.experiment import Context
from thesis_lib.edition.plots import legend_of

RELEVANT = ("heat", "a")
"""What counts as domain relevant; see :mod:`thesis_lib.chapter4.heat_relevance`."""

Lessons = Literal["plain", "shaped"]
"""Learn observed tasks from weights 0, or each from the potential of those before it."""

TASKS_SEEN = (3, 4, 5, 6, 7, 8, 10, 12)

CLOCKWISE = ((0, 0), (0, 1), (1, 1), (1, 0))
"""Panels of figure 4.8 in the order of the noise: "clockwise starting in the top left"."""


@dataclass(frozen=True)
class Config:
    """Settings of figures 4.7 and 4.8."""

    space: HeatSpace = field(default_factory=HeatSpace)
    """The domain, its learner and its features; sigma_slip is .1."""
    sensors: tuple[float, ...] = (0.01, 0.02, 0.04, 0.06)
    """Values of sigma_sensor."""
    protocol: Protocol = field(default_factory=lambda: Protocol(tasks_seen=TASKS_SEEN))
    """Sizes."""
    first: int = 5
    """Episodes of a test task that the left panel counts."""
    followed: int = 100
    """Episodes of a test task that the right panel follows; 0 for none."""
    followed_sensor: float = 0.02
    """sigma_sensor of the right panel."""
    followed_at: tuple[int, ...] = (4, 5, 6, 8, 12)
    """Numbers of observed tasks of the right panel."""
    fstek: Level = "schedule"
    """Level of FS-TEK; not printed for this domain."""
    lessons: Lessons = "plain"
    """How the observed tasks are learned."""
    relevant: tuple[str, ...] = RELEVANT
    """Truth labels of ROC space, and what ``fixed`` keeps."""

    @property
    def truth(self) -> BoolArray:
        """Which features count as domain relevant, shape ``(F,)``."""
        return np.isin(self.space.feature_names, self.relevant)


SMOKE = Config(
    space=HeatSpace(learner=HeatLearner(episodes=20)),
    sensors=(0.02, 0.06),
    protocol=SMALL_PROTOCOL,
    first=2,
    followed=8,
    followed_at=(3, 5),
)
BOOK = Config(protocol=Protocol(runs=24, tasks_seen=TASKS_SEEN), followed_at=(4, 8, 12))

_TESTED: dict[str, Run] = {}
"""The last levels of noise that were measured with test tasks; the other figure needs no more."""


def measure_heat(config: Config, space: HeatSpace, context: Context, test: bool) -> Run:
    """Run the protocol at one level of noise.

    Every run learns its own observed tasks afresh.  Within a run all
    methods see the same tasks, test on the same tasks and draw the same random numbers.

    Parameters
    ----------
    config
        Settings.
    space
        The domain, with its noise.
    context
        Seed and workers.  Levels of noise share the seed, hence the tasks.
    test
        Whether to learn the test tasks; without, returns are NaN, and what this process has just
        measured with them is not measured again.

    Returns
    -------
    Run
        Stacked, with a last axis of returns for the episodes of a test task; NaN for those that
        were not run.
    """
    protocol, grid = config.protocol, config.protocol.tasks_seen
    follow = config.followed > 0 and space.world.sensor == config.followed_sensor
    length = max(config.first, config.followed if follow else 0)
    asked = repr((config, space, context.seed))
    if not test and (done := _TESTED.get(asked)) is not None:
        return replace(done, returns=np.full_like(done.returns, np.nan))

    def one(seed: np.random.SeedSequence) -> Run:
        rng, lessons, picks = (np.random.default_rng(s) for s in seed.spawn(3))
        observed = space.sample_tasks(max(grid), rng)
        seen = space.solutions(learn_in_turn(space, observed, lessons, config.lessons))
        available = selectors(config.fstek, "unsure", config.relevant, picks)
        earned = np.full((len(grid), len(protocol.methods), length), np.nan)
        choices = []
        for j, n in enumerate(grid):
            solutions = seen.take(np.arange(n))
            tests = space.sample_tasks(protocol.tests, rng)
            draws = rng.integers(2**63, size=protocol.tests)
            episodes = length if follow and n in config.followed_at else config.first
            choices.append([choose(available[m], solutions) for m in protocol.methods])
            known: dict[bytes, FloatArray] = {}
            for i, (kept, *_) in enumerate(choices[-1] if test else ()):
                if (code := kept.tobytes()) not in known:
                    phi = space.potential(solutions, kept)
                    learned = [
                        space.learn(task, int(draw), episodes=episodes, initial_weights=phi)
                        for task, draw in zip(tests, draws, strict=True)
                    ]
                    known[code] = np.mean([one.episode_returns for one in learned], axis=0)
                earned[j, i, :episodes] = known[code]
        return Run.of(earned, choices)

    label = f"heat, sensor noise {space.world.sensor:g}"
    runs = Run.stack(context.map(one, context.seeds(protocol.runs, 4, 20), label))
    if test:
        _TESTED[asked] = runs
        for oldest in list(_TESTED)[: -len(CLOCKWISE)]:
            del _TESTED[oldest]
    return runs


def learn_in_turn(
    space: HeatSpace, tasks: Sequence[HeatTask], rng: np.random.Generator, lessons: Lessons
) -> list[HeatLearned]:
    """Learn the observed tasks, in their order.

    Parameters
    ----------
    space
        The domain and its learner.
    tasks
        The tasks.
    rng
        Goes on from task to task.
    lessons
        ``"shaped"`` starts each task from the potential, without selection, of the tasks
        before it.
    """
    one_of("lessons", lessons, get_args(Lessons))
    learned: list[HeatLearned] = []
    for task in tasks:
        start = None
        if lessons == "shaped" and learned:
            before = space.solutions(learned)
            start = space.potential(before, np.ones(before.n_features, dtype=bool))
        learned.append(space.learn(task, rng, initial_weights=start))
    return learned


def by_noise(
    table: pd.DataFrame,
    draw: Callable[[Axes, pd.DataFrame], object],
    *,
    height: float,
    legend_columns: int,
) -> tuple[Figure, Any]:
    """One panel a level of noise, clockwise from the top left, with one legend.

    Parameters
    ----------
    table
        With a column ``sensor``.
    draw
        Fills a panel.
    height
        Of the figure, inches.
    legend_columns
        Of the legend.

    Returns
    -------
    figure, axes
    """
    fig, axes = plt.subplots(2, 2, figsize=(7.2, height), sharex=True, sharey=True)
    for at, (sensor, part) in zip(CLOCKWISE, table.groupby("sensor"), strict=False):
        draw(axes[at], part)
        axes[at].set_title(rf"$\sigma_{{sensor}}$ = {sensor:g}", fontsize=9)
    for ax in axes[0]:
        ax.set_xlabel("")
    legend_of(axes[0, 0], legend_columns, fontsize=8)
    return fig, axes
