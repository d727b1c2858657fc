"""Selection as prediction: what each selector's potential errs, and earns, on the next task.

Rates tell how well a selector labels features; a potential is used to predict the next task and to
speed its learning.  So beside the rates stand the excess squared error of the cross-task
function over the domain's own, and the return; the regret of a selector is its excess error less
that of the best subset of features chosen with hindsight.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.arrays import FloatArray
from thesis_lib.chapter3.runs import TabularLearner
from thesis_lib.chapter4.looks import SYMBOLS, two_rates
from thesis_lib.chapter4.protocol import wider
from thesis_lib.chapter4.runs import Kept, SolvedDomain, Trial, solve_domain
from thesis_lib.domains import Domain, continuing_cliff, stock, triangle
from thesis_lib.domains.planted import random_domain, torus
from thesis_lib.domains.toy_text import frozen_lakes, taxi
from thesis_lib.edition.criteria import graded
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.plots import COLOURS, legend_of, panels
from thesis_lib.edition.words import plus_minus, several
from thesis_lib.mdp.batched import TaskBatch
from thesis_lib.potentials import linear_cross_task_weights
from thesis_lib.relevance import Solutions
from thesis_lib.selection import (
    FSTEK,
    FixedFeatures,
    JackknifeF,
    LeaveOneTaskOut,
    NoSelection,
    Selector,
    Shrinkage,
    rates,
    triangle_alpha,
)
from thesis_lib.stats import Mean, mean_ci


@dataclass(frozen=True)
class Setting:
    """A domain, how its tasks are learned, and what counts as irrelevant beside the truth."""

    make: Callable[[], Domain]
    learner: TabularLearner
    irrelevant: tuple[str, ...] = ()


_SHORT = TabularLearner("q_learning", 0.2, 0.1, steps=300)

SETTINGS: Mapping[str, Setting] = {
    "triangle": Setting(triangle, TabularLearner("q_learning", 0.5, 0.01, episodes=10)),
    "cliff": Setting(
        continuing_cliff, TabularLearner("q_learning", 0.1, 0.01, steps=2_000), ("x", "y")
    ),
    "stock G = 1": Setting(lambda: stock(1, 2, 1), _SHORT),
    "stock G = 3": Setting(lambda: stock(1, 2, 3), _SHORT),
    "random MDPs": Setting(lambda: random_domain(303), _SHORT),
    "torus": Setting(torus, TabularLearner("q_learning", 0.5, 0.05, episodes=10)),
    "frozen lakes": Setting(frozen_lakes, TabularLearner("q_learning", 0.5, 0.05, steps=1_000)),
    "taxi": Setting(taxi, TabularLearner("q_learning", 0.5, 0.05, steps=1_000)),
}
"""Domains of the thesis, two families of ours and two made of Gymnasium's tasks; tasks share
p(x|m) on stock and random MDPs."""

METHODS: Mapping[str, Callable[[], Selector]] = {
    "all features": NoSelection,
    "none (constant)": lambda: FixedFeatures(()),
    "fs-tek": lambda: FSTEK(triangle_alpha, flat="unsure"),
    "jackknife": JackknifeF,
    # Where no task visits a cell the potentials here have the mean, and so it is judged.
    "cross-validation": lambda: LeaveOneTaskOut("mean"),
    "shrinkage": Shrinkage,
    "cross-fitted": lambda: Shrinkage("cross-fitted"),
    "cross-validation, coarser": lambda: LeaveOneTaskOut("coarser"),
}
"""What is compared; ``fixed``, the truly relevant features, is added where they are solved."""

BESIDE = ("none (constant)", "fixed", "cross-validation, coarser")
"""Controls, and cross-validation of another function than the potential; no rivals."""


@dataclass(frozen=True)
class Config:
    """How often and when selectors are compared."""

    domains: tuple[str, ...] = tuple(SETTINGS)
    """Names in :data:`SETTINGS`."""
    tasks_seen: tuple[int, ...] = (3, 4, 5, 8, 12, 20)
    """Numbers of observed tasks."""
    runs: int = 40
    """Sequences of tasks a domain."""
    tests: int = 10
    """Tasks learned with each potential."""


@dataclass(frozen=True)
class Prediction(Kept):
    """One selector after one number of tasks on one domain; shrinkage keeps what it depends on."""

    domain: str
    """Which domain."""
    shared: bool
    """Whether its tasks share p(x|m)."""
    method: str
    """The selector; fixed keeps the truly relevant features."""
    excess: float
    """Squared error of the potential against Q_d under p(x), in units of the variance of a task's
    own values under p(x|m), in the mean over the domain; mean over runs."""
    regret: float
    """That less the excess of the best subset of features in hindsight, mean over runs."""
    regret_ci95: float
    """Half-width of its 95% t interval over runs."""
    mean_return: float
    """Mean total reward of the test tasks, over runs."""
    over_all: float
    """Return less that with all features, paired by run, mean."""
    over_all_ci95: float
    """Half-width of its 95% t interval."""
    n_runs: int
    """Sequences of tasks."""


@experiment(
    "ch4-prediction",
    item="Selection as prediction",
    smoke=Config(domains=("triangle", "stock G = 1"), tasks_seen=(4,), runs=2, tests=2),
    book=Config(runs=25),
    thesis=Config(runs=300),
    seconds=23,
)
def predictions(config: Config, context: Context) -> list[Prediction]:
    """Rates, excess squared error, regret and return of selectors on the next task."""
    rows = []
    for name in config.domains:
        setting = SETTINGS[name]
        solved = solve_domain(
            setting.make(), setting.learner, context, irrelevant=setting.irrelevant
        )
        rows += _on(name, solved, setting.learner, config, context)
    return rows


def _on(
    name: str, solved: SolvedDomain, learner: TabularLearner, config: Config, context: Context
) -> list[Prediction]:
    solutions, domain = solved.solutions, solved.domain
    n_features = solutions.n_features
    methods = {**METHODS, "fixed": lambda: FixedFeatures(solved.relevant)}
    subsets = [np.array(kept) for kept in product((False, True), repeat=n_features)]
    weight = domain.distribution @ solutions.p
    truth = linear_cross_task_weights(solutions.q, solutions.p, domain.distribution)
    own_mean, own_variance = spread(solutions)
    unit = float(domain.distribution @ own_variance)

    def error(phi: FloatArray) -> float:
        return float(weight @ (phi.ravel() - truth) ** 2) / unit

    def one(seed: np.random.SeedSequence) -> tuple[np.ndarray, np.ndarray]:
        rng = np.random.default_rng(seed)
        seen = domain.sample(max(config.tasks_seen), rng)
        numbers = np.empty((len(methods), len(config.tasks_seen), 3))
        support = np.empty((*numbers.shape[:2], n_features), dtype=bool)
        for j, n in enumerate(config.tasks_seen):
            own = solutions.take(seen[:n])
            # A cell that nobody has seen has the mean, but with shrinkage that of the coarser.
            mean = float(own_mean[seen[:n]].mean())
            trial = Trial(solved, learner, config.tests, rng)
            best = min(error(solved.potential(seen[:n], kept, mean)) for kept in subsets)
            values: dict[bytes, tuple[float, float]] = {}
            for i, make in enumerate(methods.values()):
                selector = make()
                if n < selector.min_tasks:
                    selector = NoSelection()
                kept = selector.fit(own).support_
                support[i, j] = kept
                if isinstance(selector, Shrinkage):
                    phi = selector.values(own).reshape(domain.shape)
                    found = error(phi), trial.mean_return(phi)
                else:
                    code = kept.tobytes()
                    if code not in values:
                        phi = solved.potential(seen[:n], kept, mean)
                        values[code] = error(phi), trial.mean_return(phi)
                    found = values[code]
                numbers[i, j] = found[0], found[0] - best, found[1]
        return numbers, support

    key = tuple(SETTINGS).index(name)
    found = context.map(one, context.seeds(config.runs, 24, key), name)
    numbers = np.stack([f[0] for f in found])
    support = np.stack([f[1] for f in found])
    rows = []
    for (i, method), (j, n) in product(enumerate(methods), enumerate(config.tasks_seen)):
        fpr, tpr = rates(support[:, i, j], solved.truth)
        excess, regret, earned = numbers[:, i, j].T
        off = mean_ci(regret)
        gain = mean_ci(earned - numbers[:, 0, j, 2])
        rows.append(
            Prediction(
                *(n, fpr, tpr, name, solutions.shared, method, float(excess.mean())),
                *(off.mean, off.half_width, float(earned.mean()), gain.mean, gain.half_width),
                len(found),
            )
        )
    return rows


def spread(solutions: Solutions) -> tuple[FloatArray, FloatArray]:
    """Mean and variance of each task's own values under its p(x|m), shape ``(M,)`` each."""
    q = np.where(solutions.p > 0, solutions.q, 0.0)
    mean = (solutions.p * q).sum(axis=1)
    return mean, (solutions.p * (q - mean[:, None]) ** 2).sum(axis=1)


def cells(table: pd.DataFrame, column: str) -> pd.DataFrame:
    """One column of the table, one row a domain and number of tasks, one column a method."""
    return table.pivot(index=["domain", "tasks_seen"], columns="method", values=column)


@criterion("4.5-prediction-regret", predictions)
def shrinkage_errs_least(table: pd.DataFrame) -> Finding:
    """Whether shrinkage has less regret than FS-TEK, the F-test and cross-validation."""
    regret, half = cells(table, "regret"), cells(table, "regret_ci95")
    others = ["fs-tek", "jackknife", "cross-validation", "all features"]
    wins = (regret[others].min(axis=1) >= regret.shrinkage - 1e-12).groupby("domain").mean()
    worst = regret[[*others, "shrinkage", "cross-fitted"]].max()
    total = float((regret[others].min(axis=1) >= regret.shrinkage - 1e-12).mean())
    listed = several(f"{value:.2f} ({SYMBOLS.get(name, name)})" for name, value in worst.items())
    # Selectors and numbers of tasks share runs, in which errors may go together in any way: of a
    # difference half-widths add up, and over cells they are averaged.
    gap = regret[others].sub(regret.shrinkage, axis=0)
    error = half[others].add(half.shrinkage, axis=0)
    less = gap.mean() > error.mean()
    more = gap.mean() < -wider(len(others)) * error.mean()
    beaten = (gap < -wider(gap.size) * error).any(axis=1)
    return Finding(
        graded(
            total == 1 and less.all(),
            direction=worst["shrinkage"] <= worst[others].min() and not beaten.any(),
            denied=more.any(),
            otherwise=Verdict.NOT_REPRODUCED if beaten.any() else Verdict.INCONCLUSIVE,
        ),
        f"Shrinkage errs least in {total:.0%} of {len(regret)} cells, by domain in "
        f"{several(f'{w:.0%} ({d})' for d, w in wins.items())}. In "
        f"{beaten.sum() or 'none'} another errs significantly less (corrected for all cells and "
        f"selectors), and by the mean over cells {more.sum() or 'none'} of the {len(others)} "
        f"others; shrinkage significantly less than {less.sum() or 'none'}. Largest regret, in "
        f"variances of a task's own values: {listed}.",
        {"share": total, "beaten": float(beaten.mean()), **worst.to_dict()},
    )


@criterion("4.5-prediction-return", predictions)
def error_predicts_return(table: pd.DataFrame) -> Finding:
    """Whether, cell by cell, the selector that errs less earns more."""
    own = table[~table.method.isin((*BESIDE, "cross-fitted"))]
    excess, earned = cells(own, "excess"), cells(own, "mean_return")
    ranks = [
        float(np.corrcoef(excess.loc[at].rank(), earned.loc[at].rank())[0, 1])
        for at in excess.index
        if excess.loc[at].nunique() > 1 and earned.loc[at].nunique() > 1
    ]
    mean = mean_ci(ranks)
    low, high = mean.mean - mean.half_width, mean.mean + mean.half_width
    return Finding(
        graded(
            high < -0.5,
            direction=high < 0,
            denied=low > 0,
            otherwise=Verdict.NOT_REPRODUCED if low > -0.5 else Verdict.INCONCLUSIVE,
        ),
        f"Over {mean.n} cells the rank correlation of error and return among selectors is "
        f"{mean.mean:.2f} ± {mean.half_width:.2f}.",
        {"correlation": mean.mean},
    )


def told_apart(table: pd.DataFrame) -> pd.DataFrame:
    """Rows of all but all features, with whether they are shown to earn ``more`` or ``less``.

    Paired 95% intervals, with Bonferroni over the selectors and numbers of tasks of a domain.
    """
    own = table[table.method != "all features"]
    half = wider(own.groupby("domain").size().max()) * own.over_all_ci95
    return own.assign(more=own.over_all > half, less=own.over_all < -half)


def against_all(table: pd.DataFrame) -> pd.DataFrame:
    """At how many numbers of tasks a selector is shown to earn more / less than all features."""
    counts = told_apart(table).groupby(["domain", "method"], sort=False)[["more", "less"]].sum()
    cell = counts.more.astype(str) + " / " + counts.less.astype(str)
    wide = cell.unstack().reindex(table.domain.unique())
    return wide[[m for m in table.method.unique() if m in wide]].rename(columns=SYMBOLS)


def no_gain(table: pd.DataFrame) -> tuple[list[str], list[str]]:
    """Where nothing is shown to earn more than all features, and where all earn less.

    Returns
    -------
    tuple of list of str
        The domains on which no selector, nor the truly relevant features, earns more at any number
        of tasks; those of them on which the relevant features earn less at every one.
    """
    told = told_apart(table)
    gained = told.groupby("domain", sort=False).more.any()
    lost = told[told.method == "fixed"].groupby("domain", sort=False).less.all()
    never = gained.index[~gained].tolist()
    return never, [domain for domain in never if lost[domain]]


def by_rule(table: pd.DataFrame, n: int) -> pd.DataFrame:
    """Rates after n tasks and gain over all features, of the F-test and two cross-validations."""
    rules = ("jackknife", "cross-validation", "cross-validation, coarser")
    own = table[table.method.isin(rules) & (table.tasks_seen == n)]
    gain = [plus_minus(*pair) for pair in zip(own.over_all, own.over_all_ci95, strict=True)]
    wide = own.assign(rates=two_rates(own), gain=gain).pivot(
        index="domain", columns="method", values=["rates", "gain"]
    )
    columns = [(what, rule) for what in ("rates", "gain") for rule in rules]
    names = [f"{SYMBOLS.get(rule, rule)}: {what}" for what, rule in columns]
    return wide[columns].set_axis(names, axis=1).loc[table.domain.unique()].reset_index()


def leaning(seed: int, runs: int = 40) -> dict[str, Mean]:
    """What a potential that has seen one of the taxi's four tasks twice earns more than Q_d.

    Parameters
    ----------
    seed
        Of the learning.
    runs
        Times that each task is learned.

    Returns
    -------
    dict of str to Mean
        The gain in that ``one`` task, in each of the ``others``, and over ``all`` four.
    """
    setting = SETTINGS["taxi"]
    solved = solve_domain(setting.make(), setting.learner, Context())
    tasks = np.arange(len(solved.domain))
    every = np.ones(solved.solutions.n_features, dtype=bool)
    even, lean = (solved.potential(seen, every) for seen in (tasks, np.append(tasks, 0)))
    gains = []
    for m in tasks.tolist():
        batch = TaskBatch(
            [solved.domain.tasks[m]] * runs,
            [solved.rows(m)] * runs,
            setting.learner.method,
            **setting.learner.settings,
        )
        earned = [
            batch.total_rewards(phi, [np.random.default_rng([seed, m, r]) for r in range(runs)])
            for phi in (even, lean)
        ]
        gains.append(earned[1] - earned[0])
    one, *others = gains
    parts = {"one": one, "others": np.mean(others, axis=0), "all": np.mean(gains, axis=0)}
    return {name: mean_ci(gain) for name, gain in parts.items()}


def figure(table: pd.DataFrame) -> Figure:
    """Regret over the number of observed tasks, one panel a domain, one line a selector."""
    groups = list(table.groupby("domain", sort=False))
    fig, axes = panels(len(groups), 3, 2.3)
    for ax, (domain, own) in zip(axes, groups, strict=True):
        own = own[own.method != "cross-validation, coarser"]
        for i, (method, group) in enumerate(own.groupby("method", sort=False)):
            look: dict[str, Any] = {
                "color": COLOURS[i % len(COLOURS)],
                "ls": "-" if i < len(COLOURS) else "--",
            }
            ax.plot(group.tasks_seen, group.regret, label=method, **look)
            low, high = group.regret - group.regret_ci95, group.regret + group.regret_ci95
            ax.fill_between(group.tasks_seen, low, high, color=look["color"], alpha=0.15, lw=0)
        ax.set_title(domain, fontsize=9)
        ax.set_yscale("symlog", linthresh=0.01)
        ax.tick_params(labelsize=8)
    fig.supxlabel("observed tasks", fontsize=10)
    fig.supylabel("regret [variances of a task's values]", fontsize=10)
    legend_of(axes[0], 4, "upper center")
    return fig
