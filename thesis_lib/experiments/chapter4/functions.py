"""Cross-task functions that are no tables: the law for them, and selection with them (4.5)."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations_with_replacement
from math import factorial

import numpy as np
import pandas as pd

from thesis_lib.arrays import BoolArray, FloatArray
from thesis_lib.chapter3.runs import SETTINGS, Learner
from thesis_lib.domains import Domain, stock
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.experiments.chapter4.curves import exact_solutions
from thesis_lib.experiments.chapter4.families import random_domain
from thesis_lib.experiments.chapter4.protocol import Trial
from thesis_lib.experiments.chapter4.wide import WideMarket
from thesis_lib.experiments.chapter4.worlds import World, world
from thesis_lib.relevance import Solutions, feature_basis, fit_networks, keep, relevance
from thesis_lib.selection import (
    FixedFeatures,
    JackknifeF,
    LinearF,
    NetworkF,
    NoSelection,
    Selector,
    rates,
)
from thesis_lib.stats import mean_ci

# The law.


@dataclass(frozen=True)
class FunctionLawConfig:
    """Settings of the test of the law."""

    factors: int = 1
    """G of the stock domain."""
    longest: int = 6
    """Largest k."""
    removed: tuple[str, ...] = ("g1", "s1e1")
    """Features removed, one at a time: an irrelevant and a relevant one."""
    hidden: tuple[int, ...] = (1, 2, 4)
    """Hidden units of the networks."""
    seeds: int = 4
    """Random starts of the networks."""


def multisets(n_tasks: int, k: int) -> tuple[np.ndarray, FloatArray]:
    """Sequences of k equally likely tasks up to order, ``(S, k)``, and their probabilities.

    Parameters
    ----------
    n_tasks
        Tasks in the domain.
    k
        Length.
    """
    drawn = list(combinations_with_replacement(range(n_tasks), k))
    orders = [
        factorial(k) / np.prod([factorial(drawn_one.count(m)) for m in set(drawn_one)])
        for drawn_one in drawn
    ]
    return np.array(drawn), np.array(orders) / n_tasks**k


def run_function_law(config: FunctionLawConfig, context: Context) -> pd.DataFrame:
    """Test the law; columns are documented in :data:`FUNCTION_LAW`."""
    solutions = exact_solutions(stock(1, 2, config.factors))
    lengths = np.arange(1, config.longest + 1)
    mixes = [multisets(solutions.n_tasks, int(k)) for k in lengths]
    # The cross-task Q-function of every sequence, all lengths together.
    means = np.concatenate([solutions.q[tasks].mean(axis=1) for tasks, _ in mixes])
    ends = np.cumsum([len(tasks) for tasks, _ in mixes])

    def expected(values: FloatArray) -> FloatArray:
        parts = np.split(values, ends[:-1])
        return np.array([p @ part for part, (_, p) in zip(parts, mixes, strict=True)])

    records: list[dict[str, float | str | int]] = []

    def note(function: str, hidden: int, seed: int, feature: str, curve: FloatArray) -> None:
        slopes = np.column_stack([np.ones(len(lengths)), 1 / lengths])
        fitted = slopes @ np.linalg.lstsq(slopes, curve, rcond=None)[0]
        scale = max(abs(curve[0]), np.finfo(float).tiny)
        for k, value, fit in zip(lengths, curve, fitted, strict=True):
            records.append(
                {
                    "function": function,
                    "hidden": hidden,
                    "seed": seed,
                    "feature": feature,
                    "k": int(k),
                    "value": float(value),
                    "fitted": float(fit),
                    "misfit": float(abs(value - fit) / scale),
                }
            )

    basis = feature_basis(solutions, "action")
    for feature in config.removed:
        kept = ~solutions.mask([feature])
        labels = keep(solutions, np.flatnonzero(kept).tolist())
        p = solutions.p[0]
        table = np.array([relevance(labels, q, p) for q in means])
        note("table", 0, 0, feature, expected(table))
        errors = [
            mean_square(basis.columns[:, basis.within(k)], means)
            for k in (kept, np.ones_like(kept))
        ]
        note("linear", 0, 0, feature, expected(errors[0] - errors[1]))
        weights = np.linalg.lstsq(basis.columns, means.T, rcond=None)[0]
        at = int(np.flatnonzero(basis.uses[:, solutions.index(feature)])[-1])
        note("weight", 0, 0, feature, expected(weights[at]))
        note("squared weight", 0, 0, feature, expected(weights[at] ** 2))

    def networks(job: tuple[int, int]) -> list[tuple[int, int, str, FloatArray]]:
        hidden, seed = job
        full = _network_errors(solutions, means, np.ones(solutions.n_features, bool), *job, context)
        out = []
        for feature in config.removed:
            kept = ~solutions.mask([feature])
            lost = _network_errors(solutions, means, kept, *job, context) - full
            out.append((hidden, seed, feature, expected(lost)))
        return out

    jobs = [(hidden, seed) for hidden in config.hidden for seed in range(config.seeds)]
    for part in context.map(networks, jobs, "networks"):
        for hidden, seed, feature, curve in part:
            note("network", hidden, seed, feature, curve)
    return rows(records)


def mean_square(columns: FloatArray, targets: FloatArray) -> FloatArray:
    """Mean squared error of the least-squares fit of each row of targets, shape ``(S,)``."""
    weights = np.linalg.lstsq(columns, targets.T, rcond=None)[0]
    return ((targets.T - columns @ weights) ** 2).mean(axis=0)


def _network_errors(
    solutions: Solutions,
    targets: FloatArray,
    kept: BoolArray,
    hidden: int,
    seed: int,
    context: Context,
) -> FloatArray:
    """Mean squared error of a network on some features, fitted to each row of targets."""
    basis = feature_basis(solutions, "none")
    reads = basis.uses.any(axis=1) & basis.within(kept)
    rng = np.random.default_rng(np.random.SeedSequence(context.seed, spawn_key=(30, hidden, seed)))
    inputs = basis.columns[:, reads]
    fitted = fit_networks(inputs, targets, hidden, rng, iterations=100)
    return ((fitted(inputs) - targets) ** 2).mean(axis=1)


FUNCTION_LAW: Experiment[FunctionLawConfig] = Experiment(
    id="function-law",
    item="Section 4.5 (law)",
    title="k-relevance of a linear function and of small networks against a + b/k.",
    function=run_function_law,
    budgets={
        "smoke": FunctionLawConfig(longest=3, hidden=(2,), seeds=1),
        "book": FunctionLawConfig(),
        "thesis": FunctionLawConfig(seeds=20),
    },
    columns={
        "function": "table; linear (columns of features and their products with the action); "
        "weight or squared weight of the feature's product with the action in the linear "
        "function; network fitted to the cross-task Q-function",
        "hidden": "hidden units of the network, 0 for the others",
        "seed": "random start of the network",
        "feature": "removed",
        "k": "sequence length",
        "value": "expectation over all sequences of k tasks, listed: of the rise of the mean "
        "squared error, or of the weight",
        "fitted": "least-squares fit of a + b/k over the lengths",
        "misfit": "distance of the two, over the value at k = 1",
    },
    seconds={"smoke": 1, "book": 35, "thesis": 170},
)


# Selection.

METHODS: Mapping[str, Callable[[int], Selector]] = {
    "table": lambda seed: JackknifeF(),
    "linear": lambda seed: LinearF(),
    "network": lambda seed: NetworkF(random_state=seed),
    "none": lambda seed: NoSelection(),
}
"""Selectors by the cross-task function that they see, given a seed."""

SYMBOLS = {
    "table": "on tables",
    "linear": "linear",
    "network": "networks",
    "none": "no selection",
    "fixed": "fixed features",
    "constant": "constant",
    "linear, more pairs": "linear, more pairs",
}
"""How figures name the methods."""

TABULAR: Mapping[str, Callable[[], Domain]] = {
    "stock G=2": partial(stock, 1, 2, 2),
    "random MDP": partial(random_domain, 202, relevant=3, irrelevant=2, signal=1.0),
}
"""Domains with tables, the second with features that matter in combination."""

WIDE = "wide stock"


@dataclass(frozen=True)
class FunctionSelectionConfig:
    """Settings of the comparison of selectors."""

    runs: int = 100
    """Sequences of tasks on domains with tables."""
    wide_runs: int = 20
    """Sequences of tasks on the wide market."""
    tests: int = 10
    """Tasks learned with each function."""
    tasks_seen: tuple[int, ...] = (4, 8, 16)
    """Numbers of observed tasks n."""
    learner: Learner = SETTINGS["stock"].learners[0]
    """Learning and exploration rate; the best of figure 3.4."""
    market: WideMarket = field(default_factory=WideMarket)
    """The wide market."""
    pairs: int = 600
    """Pairs at which its tasks' values are known, drawn anew for each run."""
    more_pairs: int = 4000
    """The same for the linear function with more pairs."""
    hidden: int = 3
    """Hidden units of the networks there; 6 on the others."""
    tabular: tuple[str, ...] = tuple(TABULAR)
    """Domains with tables."""


def run_function_selection(config: FunctionSelectionConfig, context: Context) -> pd.DataFrame:
    """Compare the selectors; columns are documented in :data:`FUNCTION_SELECTION`."""
    records = []
    for i, name in enumerate(config.tabular):
        found = world(TABULAR[name], config.learner, context)
        runs = context.map(
            partial(_tabular_run, config, found), context.seeds(config.runs, 31, i), name
        )
        records += _records(name, config, runs, found.truth, ALL)
    runs = context.map(partial(_wide_run, config), context.seeds(config.wide_runs, 32), WIDE)
    return rows(records + _records(WIDE, config, runs, config.market.relevant, ON_WIDE))


ALL = (*METHODS, "fixed", "constant")
ON_WIDE = (*ALL, "linear, more pairs")


@dataclass(frozen=True)
class _Run:
    """Return, features kept and time of selection, by number of tasks and method."""

    returns: FloatArray
    support: BoolArray
    seconds: FloatArray


def _empty(config: FunctionSelectionConfig, n_features: int, n_methods: int) -> _Run:
    shape = len(config.tasks_seen), n_methods
    return _Run(np.zeros(shape), np.zeros((*shape, n_features), bool), np.zeros(shape))


def _select(
    run: _Run,
    j: int,
    solutions: Solutions,
    relevant: tuple[str, ...],
    makers: Mapping[str, Callable[[int], Selector]],
    seed: int,
) -> None:
    """Fill in what every method keeps of n tasks, and how long it took."""
    for i, method in enumerate(ALL):
        selector = (
            makers[method](seed)
            if method in makers
            else FixedFeatures(relevant if method == "fixed" else ())
        )
        _note(run, j, i, selector, solutions)


def _note(run: _Run, j: int, i: int, selector: Selector, solutions: Solutions) -> None:
    start = time.thread_time()
    run.support[j, i] = selector.fit(solutions).support_
    run.seconds[j, i] = time.thread_time() - start


def _tabular_run(
    config: FunctionSelectionConfig, found: World, seed: np.random.SeedSequence
) -> _Run:
    rng = np.random.default_rng(seed)
    names = found.solutions.feature_names
    relevant = tuple(n for n, true in zip(names, found.truth, strict=True) if true)
    seen = found.domain.sample(max(config.tasks_seen), rng)
    run = _empty(config, len(names), len(ALL))
    for j, n in enumerate(config.tasks_seen):
        seed_of_nets = int(rng.integers(2**31))
        _select(run, j, found.solutions.take(seen[:n]), relevant, METHODS, seed_of_nets)
        tests = found.domain.sample(config.tests, rng)
        trial = Trial(found, config.learner, tests, rng.integers(2**63, size=config.tests))
        for i in range(len(ALL)):
            phi = found.potential(seen[:n], run.support[j, i])
            run.returns[j, i] = trial.mean_return(phi)
    return run


def _wide_run(config: FunctionSelectionConfig, seed: np.random.SeedSequence) -> _Run:
    rng = np.random.default_rng(seed)
    market, learner = config.market, config.learner
    names = market.feature_names
    relevant = tuple(n for n, true in zip(names, market.relevant, strict=True) if true)
    makers = {**METHODS, "network": lambda s: NetworkF(hidden=config.hidden, random_state=s)}
    seen = market.sample_tasks(max(config.tasks_seen), rng)
    values = market.solutions(seen, market.sample_pairs(config.pairs, rng))
    more = market.solutions(seen, market.sample_pairs(config.more_pairs, rng))
    run = _empty(config, len(names), len(ON_WIDE))
    for j, n in enumerate(config.tasks_seen):
        observed = values.take(np.arange(n))
        _select(run, j, observed, relevant, makers, int(rng.integers(2**31)))
        _note(run, j, ON_WIDE.index("linear, more pairs"), LinearF(), more.take(np.arange(n)))
        tests = market.sample_tasks(config.tests, rng)
        draws = rng.integers(2**63, size=config.tests)
        for i, method in enumerate(ON_WIDE):
            known = observed if method in ALL else more.take(np.arange(n))
            start = market.weights(known, run.support[j, i])
            run.returns[j, i] = np.mean(
                [
                    market.learn(
                        task,
                        start,
                        np.random.default_rng(int(draw)),
                        steps=learner.steps or 1,
                        alpha=learner.alpha,
                        epsilon=learner.epsilon,
                    )
                    for task, draw in zip(tests, draws, strict=True)
                ]
            )
    return run


def _records(
    name: str,
    config: FunctionSelectionConfig,
    runs: list[_Run],
    truth: BoolArray,
    methods: tuple[str, ...],
) -> list[dict[str, float | str | int]]:
    returns = np.stack([run.returns for run in runs])
    support = np.stack([run.support for run in runs])
    seconds = np.stack([run.seconds for run in runs])
    none = ALL.index("none")
    records: list[dict[str, float | str | int]] = []
    for j, n in enumerate(config.tasks_seen):
        for i, method in enumerate(methods):
            fpr, tpr = rates(support[:, j, i], truth)
            own = mean_ci(returns[:, j, i])
            gain = mean_ci(returns[:, j, i] - returns[:, j, none])
            records.append(
                {
                    "domain": name,
                    "method": method,
                    "tasks_seen": n,
                    "fpr": fpr,
                    "tpr": tpr,
                    "mean_return": own.mean,
                    "ci95": own.half_width,
                    "gain": gain.mean,
                    "gain_ci95": gain.half_width,
                    "features_kept": float(support[:, j, i].sum(axis=-1).mean()),
                    "cpu_seconds": float(np.median(seconds[:, j, i])),
                    "n_runs": own.n,
                }
            )
    return records


FUNCTION_SELECTION: Experiment[FunctionSelectionConfig] = Experiment(
    id="function-selection",
    item="Section 4.5 (selection)",
    title="Feature selection by linear functions and networks, where tables exist and where not.",
    function=run_function_selection,
    budgets={
        "smoke": FunctionSelectionConfig(
            runs=2,
            wide_runs=2,
            tests=1,
            tasks_seen=(4,),
            pairs=80,
            more_pairs=100,
            hidden=1,
            market=WideMarket(4, 3),
            tabular=("stock G=2",),
        ),
        "book": FunctionSelectionConfig(),
        "thesis": FunctionSelectionConfig(runs=500, wide_runs=100),
    },
    columns={
        "domain": "name",
        "method": "jackknife F on tables, on a linear function, on the mean of networks; no "
        "selection; the truly relevant features; none at all; linear with more pairs known",
        "tasks_seen": "number of observed tasks n",
        "fpr": "share of the domain-irrelevant features kept",
        "tpr": "share of the domain-relevant features kept",
        "mean_return": "mean total reward of 300 steps of the test tasks, over runs",
        "ci95": "half-width of its 95% t interval over runs",
        "gain": "return less that of no selection, paired by run, mean",
        "gain_ci95": "half-width of its 95% t interval",
        "features_kept": "mean number of features kept",
        "cpu_seconds": "processor time of a selection, median over runs",
        "n_runs": "sequences of tasks",
    },
    seconds={"smoke": 1, "book": 90, "thesis": 400},
)
