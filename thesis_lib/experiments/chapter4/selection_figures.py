"""Figures 4.3 to 4.6: what feature selection does for the return, and its place in ROC space."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal, get_args

import pandas as pd

from thesis_lib.chapter3.runs import SETTINGS, Learner
from thesis_lib.domains import continuing_cliff, episodic_cliff, stock, triangle
from thesis_lib.edition.experiment import Context, Experiment
from thesis_lib.experiments.chapter4.protocol import COLUMNS, Flat, Level, Protocol, measure
from thesis_lib.experiments.chapter4.worlds import Source, Target, world
from thesis_lib.mdp.checks import one_of

POSITION = ("x", "y")
"""Features of the cliff that are relevant, but so weakly that the thesis counts them as not."""


CLIFF_METHODS = ("fs-tek", "ibkr", "jackknife", "random", "none", "constant")
"""No fixed features: all are relevant."""

CLIFF_LEARNER = Learner("q_learning", 0.1, 0.01, steps=10_000)


@dataclass(frozen=True)
class TriangleConfig:
    """Settings of figure 4.3."""

    protocol: Protocol = field(default_factory=lambda: Protocol(tasks_seen=(*range(3, 13), 15, 20)))
    """Sizes."""
    learner: Learner = SETTINGS["triangle"].learners[0]
    """Learning and exploration rate: the best of figure 3.3."""
    fstek: Level = "schedule"
    """Level of FS-TEK, as printed."""
    flat: Flat = "unsure"
    """A colour or a sensor reading that never varied makes the fit singular, hence "unsure"."""
    source: Source = "exact"
    """Exact solutions of the observed tasks, or learned ones."""


@dataclass(frozen=True)
class CliffConfig:
    """Settings of figures 4.4 and 4.5."""

    target: Target = "Q_star"
    """Q* in figure 4.4, Q~ in figure 4.5."""
    protocol: Protocol = field(
        default_factory=lambda: Protocol(
            tasks_seen=(1, 2, 3, 4, 5, 6, 7, 8, 10, 12),
            methods=CLIFF_METHODS,
        )
    )
    """Sizes; no fixed features, as all are relevant."""
    cliff: Literal["continuing", "episodic"] = "continuing"
    """Which cliff domain; the text does not say, but only this one fits its statements."""
    learner: Learner = CLIFF_LEARNER
    """Learning rate near the best of figure 3.1; ten thousand steps, as long as the boost lasts."""
    fstek: Level = "schedule"
    """Level of FS-TEK; not printed for this domain."""
    flat: Flat = "unsure"
    """A colour or a sensor reading that never varied makes the fit singular, hence "unsure"."""
    source: Source = "exact"
    """Exact solutions of the observed tasks, or learned ones."""


@dataclass(frozen=True)
class EpisodicConfig:
    """Settings of figures 4.4 and 4.5 on the other cliff."""

    star: CliffConfig = field(
        default_factory=lambda: CliffConfig(
            cliff="episodic",
            learner=SETTINGS["episodic cliff with sensor"].learners[0],
            protocol=Protocol(runs=150, tasks_seen=(1, 2, 3, 4, 5, 8, 12), methods=CLIFF_METHODS),
        )
    )
    """With Q*; the same is run with Q~."""


@dataclass(frozen=True)
class StockConfig:
    """Settings of figure 4.6."""

    global_factors: tuple[int, ...] = (1, 2, 3, 4, 5)
    """G."""
    protocol: Protocol = field(default_factory=Protocol)
    """Sizes."""
    learner: Learner = SETTINGS["stock"].learners[0]
    """Learning and exploration rate: the best of figure 3.4."""
    discount: float = 0.9
    """gamma, not printed."""
    low: Level = 1e-4
    """Level of FS-TEK for G < 4."""
    high: Level = "schedule"
    """Level for G >= 4: one "that increases with k", its formula not printed."""
    flat: Flat = "limit"
    """Ownership has relevance 0 exactly; learned values would give it a small falling one."""
    source: Source = "exact"
    """Exact solutions of the observed tasks, or learned ones."""


def run_figure_4_3(config: TriangleConfig, context: Context) -> pd.DataFrame:
    """Compute figure 4.3; columns are documented in :data:`FIGURE_4_3`."""
    domain = world(triangle, config.learner, context, source=config.source)
    return measure(domain, config.learner, config.protocol, config.fstek, config.flat, context, 0)


def run_cliff(config: CliffConfig, context: Context) -> pd.DataFrame:
    """Compute figure 4.4 or 4.5; columns are documented in :data:`FIGURE_4_4`."""
    one_of("cliff", config.cliff, ("continuing", "episodic"))
    make = (lambda: episodic_cliff(True)) if config.cliff == "episodic" else continuing_cliff
    domain = world(
        make,
        config.learner,
        context,
        target=config.target,
        source=config.source,
        irrelevant=POSITION,
    )
    # Both figures see the same tasks, so that the two potentials can be compared.
    return measure(domain, config.learner, config.protocol, config.fstek, config.flat, context, 1)


def run_episodic(config: EpisodicConfig, context: Context) -> pd.DataFrame:
    """Both potentials on the episodic cliff; columns are documented in :data:`EPISODIC`."""
    tables = []
    for target in get_args(Target):
        table = run_cliff(replace(config.star, target=target), context)
        table.insert(0, "potential", target)
        tables.append(table)
    return pd.concat(tables, ignore_index=True)


def run_figure_4_6(config: StockConfig, context: Context) -> pd.DataFrame:
    """Compute figure 4.6; columns are documented in :data:`FIGURE_4_6`."""
    tables = []
    for g in config.global_factors:
        domain = world(
            partial(stock, 1, 2, g, discount=config.discount),
            config.learner,
            context,
            source=config.source,
        )
        level = config.low if g < 4 else config.high
        table = measure(
            domain, config.learner, config.protocol, level, config.flat, context, 10 + g
        )
        table.insert(0, "global_factors", g)
        tables.append(table)
    return pd.concat(tables, ignore_index=True)


SMALL = Protocol(runs=2, tests=1, tasks_seen=(3, 4, 5))

FIGURE_4_3: Experiment[TriangleConfig] = Experiment(
    id="figure-4.3",
    item="Figure 4.3",
    title="Feature selection on the triangle: return and ROC space, over tasks seen.",
    function=run_figure_4_3,
    budgets={
        "smoke": TriangleConfig(protocol=SMALL),
        "book": TriangleConfig(),
        "thesis": TriangleConfig(),
    },
    columns=COLUMNS,
    seconds={"smoke": 1, "book": 30, "thesis": 30},
)

BOOK_CLIFF = replace(CliffConfig().protocol, runs=200)
SMALL_CLIFF = Protocol(runs=2, tests=1, tasks_seen=(1, 2, 4), methods=CLIFF_METHODS)

FIGURE_4_4: Experiment[CliffConfig] = Experiment(
    id="figure-4.4",
    item="Figure 4.4",
    title="Feature selection on the cliff with Q* as potential.",
    function=run_cliff,
    budgets={
        "smoke": CliffConfig(protocol=SMALL_CLIFF),
        "book": CliffConfig(protocol=BOOK_CLIFF),
        "thesis": CliffConfig(),
    },
    columns=COLUMNS,
    seconds={"smoke": 1, "book": 32, "thesis": 78},
)

FIGURE_4_5: Experiment[CliffConfig] = Experiment(
    id="figure-4.5",
    item="Figure 4.5",
    title="Feature selection on the cliff with Q~ as potential.",
    function=run_cliff,
    budgets={
        "smoke": CliffConfig(target="Q_tilde", protocol=SMALL_CLIFF),
        "book": CliffConfig(target="Q_tilde", protocol=BOOK_CLIFF),
        "thesis": CliffConfig(target="Q_tilde"),
    },
    columns=COLUMNS,
    seconds={"smoke": 1, "book": 32, "thesis": 78},
)

EPISODIC: Experiment[EpisodicConfig] = Experiment(
    id="figure-4.4-episodic",
    item="Figures 4.4 and 4.5 on the episodic cliff",
    title="Feature selection on the episodic cliff with sensor, with either potential.",
    function=run_episodic,
    budgets={
        "smoke": EpisodicConfig(
            star=CliffConfig(
                cliff="episodic",
                learner=Learner("q_learning", 1.0, 0.1, episodes=20),
                protocol=SMALL_CLIFF,
            )
        ),
        "book": EpisodicConfig(),
        "thesis": EpisodicConfig(),
    },
    columns={"potential": "Q_star or Q_tilde", **COLUMNS},
    seconds={"smoke": 1, "book": 40, "thesis": 40},
)

FIGURE_4_6: Experiment[StockConfig] = Experiment(
    id="figure-4.6",
    item="Figure 4.6",
    title="Feature selection on stock trading with 1 to 5 global factors.",
    function=run_figure_4_6,
    budgets={
        "smoke": StockConfig(global_factors=(1, 4), protocol=SMALL),
        "book": StockConfig(protocol=Protocol(runs=100)),
        "thesis": StockConfig(),
    },
    columns={"global_factors": "G", **COLUMNS},
    seconds={"smoke": 1, "book": 42, "thesis": 205},
)
