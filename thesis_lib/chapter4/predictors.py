"""Figures 4.3 to 4.8 again, with the two selectors that predict: cross-validation and shrinkage.

The figures themselves stand as committed.  Here leave-one-task-out cross-validation and shrinkage
meet FS-TEK, IBKR and the jackknife F in the same experiments, over fewer runs: the same domains,
potentials, learners and levels, the same tasks for all within a run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import t

from thesis_lib.arrays import BoolArray, FloatArray
from thesis_lib.chapter4 import figure_4_3, figure_4_4, figure_4_6, heat_runs, looks
from thesis_lib.chapter4.protocol import Flat, Level, level
from thesis_lib.chapter4.runs import Rated, Run, Target, Trial, choose, solve_domain
from thesis_lib.checks import one_of
from thesis_lib.domains import Domain, continuing_cliff, stock, triangle
from thesis_lib.domains.heat import ACTIONS
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.plots import COLOURS, legend_of, panels, unclutter
from thesis_lib.potentials import linear_cross_task_weights
from thesis_lib.relevance import Solutions, keep
from thesis_lib.selection import (
    FSTEK,
    IBKR,
    JackknifeF,
    LeaveOneTaskOut,
    NoSelection,
    Selector,
    Shrinkage,
)

METHODS = (
    *("none", "fs-tek", "ibkr", "jackknife", "cross-validation"),
    *("cross-validation, mean", "cross-validation, coarser", "shrinkage"),
)
"""Cross-validation is that of the potentials here, 0 where no task was, and of two others."""

UNSEEN = 0.0
"""What the potentials have where no observed task was."""

DRAWN = tuple(method for method in METHODS if "," not in method)
SYMBOLS = {**dict(zip(METHODS, METHODS, strict=True)), **looks.SYMBOLS}
COLOUR = {**looks.COLOUR, "shrinkage": COLOURS[3]}


@dataclass(frozen=True)
class Config:
    """Which settings are run, how often and when."""

    settings: tuple[str, ...]
    """Keys of :data:`TABLES`, or of :data:`HEAT`."""
    tasks_seen: tuple[int, ...] = (3, 4, 5, 6, 8, 12)
    """Numbers of observed tasks."""
    runs: int = 40
    """Sequences of tasks a setting."""
    tests: int = 10
    """Tasks learned with each potential."""


@dataclass(frozen=True)
class Predicted(Rated):
    """One selector after one number of observed tasks in the experiment of one figure."""

    figure: str
    """Its number in the thesis."""
    setting: str
    """Domain with potential, number of factors or sensor noise."""
    method: str
    """The selector; what shrinkage gives weight 0 counts as removed."""
    over_none: float
    """Return less that without selection, paired by run, mean."""
    over_none_ci95: float
    """Half-width of its 95% t interval."""
    over_fstek: float
    """Return less that of FS-TEK, paired by run, mean."""
    over_fstek_ci95: float
    """Half-width of its 95% t interval."""


@dataclass(frozen=True)
class Case:
    """One experiment of a figure.

    Attributes
    ----------
    figure
        Its number.
    fstek, flat
        Of FS-TEK there.
    truth
        Which features are domain relevant, shape ``(F,)``.
    observe
        Draws and solves n tasks.
    trial
        Draws tasks to learn; what it gives maps a potential of shape ``(N,)`` to their mean return.
    """

    figure: str
    fstek: Level
    flat: Flat
    truth: BoolArray
    observe: Callable[[int, np.random.Generator], Solutions]
    trial: Callable[[int, np.random.Generator], Callable[[FloatArray], float]]


def _table(
    figure: str,
    context: Context,
    *,
    make: Callable[[], Domain],
    config: figure_4_3.Config | figure_4_4.Config | figure_4_6.Config,
    fstek: Level,
    target: Target = "Q_star",
    irrelevant: tuple[str, ...] = (),
) -> Case:
    """An experiment on a domain with tables, by the config of its figure."""
    learner = config.learner
    solved = solve_domain(make(), learner, context, target=target, irrelevant=irrelevant)

    def trial(n: int, rng: np.random.Generator) -> Callable[[FloatArray], float]:
        tasks = Trial(solved, learner, n, rng)
        return lambda phi: tasks.mean_return(phi.reshape(solved.domain.shape))

    return Case(
        *(figure, fstek, config.flat, solved.truth),
        observe=lambda n, rng: solved.solutions.take(solved.domain.sample(n, rng)),
        trial=trial,
    )


def _heat(sensor: float, context: Context) -> Case:
    """The first episodes on the heat domain, at one level of noise."""
    config = heat_runs.Config()
    space = config.space.with_noise(sensor)

    def observe(n: int, rng: np.random.Generator) -> Solutions:
        tasks = space.sample_tasks(n, rng)
        return space.solutions(heat_runs.learn_in_turn(space, tasks, rng, config.lessons))

    def trial(n: int, rng: np.random.Generator) -> Callable[[FloatArray], float]:
        tasks, draws = space.sample_tasks(n, rng), rng.integers(2**63, size=n).tolist()

        def mean_return(phi: FloatArray) -> float:
            start = phi.reshape(-1, len(ACTIONS))
            learned = (
                space.learn(task, seed, episodes=config.first, initial_weights=start)
                for task, seed in zip(tasks, draws, strict=True)
            )
            return float(np.mean([one.episode_returns.sum() for one in learned]))

        return mean_return

    return Case("4.7", config.fstek, "unsure", config.truth, observe, trial)


_TRIANGLE, _CLIFF, _STOCK = figure_4_3.Config(), figure_4_4.Config(), figure_4_6.Config()

_cliff = partial(
    _table,
    make=continuing_cliff,
    config=_CLIFF,
    fstek=_CLIFF.fstek,
    irrelevant=figure_4_4.POSITION,
)

TABLES: Mapping[str, Callable[[Context], Case]] = {
    "triangle": partial(_table, "4.3", make=triangle, config=_TRIANGLE, fstek=_TRIANGLE.fstek),
    "cliff, Q*": partial(_cliff, "4.4"),
    "cliff, Q~": partial(_cliff, "4.5", target="Q_tilde"),
    **{
        f"stock, G = {g}": partial(
            _table,
            "4.6",
            make=partial(stock, 1, 2, g, discount=_STOCK.discount),
            config=_STOCK,
            fstek=_STOCK.low if g < 4 else _STOCK.high,
        )
        for g in _STOCK.global_factors
    },
}
"""The experiments of figures 4.3 to 4.6."""

HEAT: Mapping[str, Callable[[Context], Case]] = {
    f"heat, noise {sensor:g}": partial(_heat, sensor) for sensor in heat_runs.Config().sensors
}
"""Those of figures 4.7 and 4.8: the return of the first five episodes, and the rates."""


@experiment(
    "ch4-predictors",
    item="Figures 4.3 to 4.6, with the selectors that predict",
    smoke=Config(("triangle", "stock, G = 4"), tasks_seen=(3, 5), runs=2, tests=1),
    book=Config(tuple(TABLES), runs=12),
    thesis=Config(tuple(TABLES), runs=500),
    seconds=20,
)
def on_tables(config: Config, context: Context) -> list[Predicted]:
    """Cross-validation and shrinkage in the experiments of figures 4.3 to 4.6."""
    return _measured(TABLES, config, context)


@experiment(
    "ch4-predictors-heat",
    item="Figures 4.7 and 4.8, with the selectors that predict",
    smoke=Config(("heat, noise 0.02",), tasks_seen=(3,), runs=2, tests=1),
    book=Config(tuple(HEAT), runs=6),
    thesis=Config(tuple(HEAT), runs=500),
    seconds=20,
)
def on_heat(config: Config, context: Context) -> list[Predicted]:
    """Cross-validation and shrinkage in the experiments of figures 4.7 and 4.8."""
    return _measured(HEAT, config, context)


def _measured(
    known: Mapping[str, Callable[[Context], Case]], config: Config, context: Context
) -> list[Predicted]:
    rows = []
    for name in config.settings:
        one_of("settings", name, tuple(known))
        seeds = context.seeds(config.runs, 44, tuple(known).index(name))
        case = known[name](context)
        runs = Run.stack(context.map(partial(_run, case, config), seeds, name))
        for (i, method), (j, n) in product(enumerate(METHODS), enumerate(config.tasks_seen)):
            none, fstek = (runs.ahead_of(j, i, METHODS.index(o)) for o in ("none", "fs-tek"))
            rows.append(
                Predicted(
                    figure=case.figure,
                    setting=name,
                    method=method,
                    tasks_seen=n,
                    over_none=none.mean,
                    over_none_ci95=none.half_width,
                    over_fstek=fstek.mean,
                    over_fstek_ci95=fstek.half_width,
                    **runs.rated(j, i, case.truth),
                )
            )
    return rows


def _run(case: Case, config: Config, seed: np.random.SeedSequence) -> Run:
    """One sequence of tasks; all selectors see the same and are tested on the same."""
    rng = np.random.default_rng(seed)
    seen = case.observe(max(config.tasks_seen), rng)
    earned, choices = [], []
    for n in config.tasks_seen:
        own, mean_return = seen.take(np.arange(n)), case.trial(config.tests, rng)
        selectors = _selectors(case)
        choices.append([choose(selector, own) for selector in selectors])
        tried: dict[bytes, float] = {}
        found = []
        for selector, (support, *_) in zip(selectors, choices[-1], strict=True):
            shrinks = isinstance(selector, Shrinkage)
            code = b"shrinkage" if shrinks else support.tobytes()
            if code not in tried:
                labels = keep(own, np.flatnonzero(support).tolist())
                phi = (
                    selector.values(own)
                    if shrinks
                    else linear_cross_task_weights(own.q, own.p, labels=labels, fill=UNSEEN)
                )
                tried[code] = mean_return(phi)
            found.append(tried[code])
        earned.append(found)
    return Run.of(earned, choices)


def _selectors(case: Case) -> list[Selector]:
    """In the order of :data:`METHODS`."""
    fstek = FSTEK(alpha=level(case.fstek), flat=case.flat)
    crossed = [LeaveOneTaskOut(unseen) for unseen in (UNSEEN, "mean", "coarser")]
    return [NoSelection(), fstek, IBKR(), JackknifeF(), *crossed, Shrinkage()]


def compared(table: pd.DataFrame, by: str | None = None) -> pd.DataFrame:
    """In how many cells of setting and number of tasks a selector is shown to earn more, or less.

    Paired 95% intervals, with Bonferroni over the cells of a selector.

    Parameters
    ----------
    table
        One row a setting, number of tasks and selector.
    by
        Column by which the cells are counted apart, such as ``setting``; default together.
    """
    rows = []
    cells = table.groupby("method").size().max()
    for key, own in table.groupby([by, "method"] if by else ["method"], sort=False):
        row: dict[str, object] = dict(zip([by] if by else [], key[:-1], strict=True))
        row |= {"selector": SYMBOLS[str(key[-1])], "cells": len(own)}
        for other, gap in (("no selection", "over_none"), ("FS-TEK", "over_fstek")):
            gain, half = own[gap], own[f"{gap}_ci95"] * corrected(cells, own.n_runs)
            row[f"more than {other}"] = int((gain > half).sum())
            row[f"less than {other}"] = int((gain < -half).sum())
        rows.append(row)
    return pd.DataFrame(rows)


def corrected(choices: int, runs: pd.Series) -> FloatArray:
    """Factor of a 95% t interval over so many runs that was looked at with others (Bonferroni).

    >>> corrected(4, pd.Series([3, 10**6])).round(3).tolist()
    [2.059, 1.274]
    """
    return np.asarray(t.isf(0.025 / choices, runs - 1) / t.isf(0.025, runs - 1))


def by_setting(table: pd.DataFrame) -> pd.DataFrame:
    """At how many numbers of tasks a selector earns more / less than no selection, by setting."""
    counts = compared(table[table.method != "none"], "setting")
    more, less = (counts[f"{word} than no selection"].astype(str) for word in ("more", "less"))
    wide = counts.assign(cell=more + " / " + less).pivot(
        index="setting", columns="selector", values="cell"
    )
    return wide.loc[table.setting.unique(), counts.selector.unique()].reset_index()


def returns_figure(table: pd.DataFrame) -> Figure:
    """Paired gain over no selection by number of tasks, one panel a setting."""
    fig, axes = _panels(table)
    for ax, (_, own) in zip(axes, table.groupby("setting", sort=False), strict=False):
        for method in DRAWN[1:]:
            at = own[own.method == method]
            gain, half = at.over_none, at.over_none_ci95
            ax.plot(at.tasks_seen, gain, lw=1.3, color=COLOUR[method], label=SYMBOLS[method])
            ax.fill_between(
                *(at.tasks_seen, gain - half, gain + half), color=COLOUR[method], alpha=0.15, lw=0
            )
        ax.axhline(0, color=looks.PRINTED, lw=0.6)
    return _named(fig, axes, "tasks seen", "return over no selection")


def roc_figure(table: pd.DataFrame) -> Figure:
    """ROC space, one panel a setting; points are joined in the order of tasks seen."""
    fig, axes = _panels(table)
    for ax, (_, own) in zip(axes, table.groupby("setting", sort=False), strict=False):
        looks.roc(ax, own, DRAWN[1:-1], near=0.15)
        at = own[own.method == "shrinkage"]
        colour, name = COLOUR["shrinkage"], SYMBOLS["shrinkage"]
        ax.plot(at.fpr, at.tpr, "x-", ms=4, lw=0.8, color=colour, label=name)
        ax.set(xlabel="", ylabel="")
    return unclutter(_named(fig, axes, "false positive rate", "true positive rate"))


def _panels(table: pd.DataFrame) -> tuple[Figure, list[Axes]]:
    """A figure with a titled panel a setting."""
    names = list(dict.fromkeys(table.setting))
    fig, axes = panels(len(names), 3 if len(names) != 4 else 2, 1.9, 0.7)
    for ax, name in zip(axes, names, strict=True):
        ax.set_title(name, fontsize=9)
        ax.tick_params(labelsize=7)
    return fig, axes


def _named(fig: Figure, axes: list[Axes], x: str, y: str) -> Figure:
    """The figure with names on its sides and one legend."""
    fig.supxlabel(x, fontsize=9)
    fig.supylabel(y, fontsize=9)
    legend_of(axes[0], 5, "upper center", fontsize=8)
    return fig
