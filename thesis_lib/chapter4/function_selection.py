"""Section 4.5: feature selection with cross-task functions that are no tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy import stats

from thesis_lib.arrays import BoolArray
from thesis_lib.chapter3.runs import SETTINGS, TabularLearner
from thesis_lib.chapter4.looks import PM, two_rates
from thesis_lib.chapter4.runs import (
    Rated,
    Run,
    SolvedDomain,
    choose,
    place,
    run_selectors,
    solve_domain,
)
from thesis_lib.chapter4.wide_market import WideMarket
from thesis_lib.domains import Domain, stock
from thesis_lib.domains.planted import random_domain
from thesis_lib.edition.criteria import judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.plots import COLOURS, beside, panels, unclutter
from thesis_lib.selection import (
    FixedFeatures,
    JackknifeF,
    LinearF,
    NetworkF,
    NoSelection,
    Selector,
)

SYMBOLS: Mapping[str, str] = {
    "table": "on tables",
    "linear": "linear",
    "network": "networks",
    "none": "no selection",
    "fixed": "fixed features",
    "constant": "constant",
    "linear, more pairs": "linear, more pairs",
}
"""How figures name the methods: by the cross-task function that a selector sees."""

ALL = ("table", "linear", "network", "none", "fixed", "constant")
MORE = "linear, more pairs"

TABULAR: Mapping[str, Callable[[], Domain]] = {
    "stock G=2": partial(stock, 1, 2, 2),
    "random MDP": partial(random_domain, 202, relevant=3, irrelevant=2, signal=1.0),
}
"""Domains with tables, the second with features that matter in combination."""

WIDE = "wide stock"

MOST_FALSE, LEAST_TRUE = 0.15, 0.8
"""Largest false and least true positive rate of a selection that works."""


@dataclass(frozen=True)
class Config:
    """Settings of the comparison of selectors."""

    runs: int = 100
    """Sequences of tasks on domains with tables."""
    wide_runs: int = 12
    """Sequences of tasks on the wide market."""
    tests: int = 10
    """Tasks learned with each function."""
    tasks_seen: tuple[int, ...] = (4, 8, 16)
    """Numbers of observed tasks n."""
    learner: TabularLearner = SETTINGS["stock"].learners[0]
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


SMALL = Config(
    runs=2,
    wide_runs=2,
    tests=1,
    tasks_seen=(4,),
    pairs=80,
    more_pairs=100,
    hidden=1,
    market=WideMarket(4, 3),
    tabular=("stock G=2",),
)


@dataclass(frozen=True)
class Selected(Rated):
    """One method after one number of observed tasks on one domain."""

    domain: str
    """Name."""
    method: str
    """Jackknife F on tables, on a linear function, on the mean of networks; no selection; the truly
    relevant features; none at all; linear with more pairs known."""
    mean_return: float
    """Mean total reward of 300 steps of the test tasks, over runs."""
    gain: float
    """Return less that of no selection, paired by run, mean."""
    gain_ci95: float
    """Half-width of its 95% t interval."""
    fpr_ci95: float
    """Half-width of the normal 95% interval of the false positive rate over runs."""
    tpr_ci95: float
    """The same of the true positive rate."""
    features_kept: float
    """Mean number of features kept."""
    cpu_seconds: float
    """Processor time of a selection, median over runs."""


@experiment(
    "ch4-function-selection",
    item="Section 4.5 (selection)",
    smoke=SMALL,
    book=Config(runs=60, wide_runs=8),
    thesis=Config(runs=500, wide_runs=100),
    seconds=60,
    claims_read={"tasks_seen": (16,), "tests": 1},
)
def selected(config: Config, context: Context) -> list[Selected]:
    """Feature selection by linear functions and networks, where tables exist and where not."""
    records = []
    for i, name in enumerate(config.tabular):
        solved = solve_domain(TABULAR[name](), config.learner, context)
        one = partial(_tabular_run, config, solved)
        runs = context.map(one, context.seeds(config.runs, 31, i), name)
        records += _summarise(name, config, Run.stack(runs), solved.truth, ALL)
    seeds = context.seeds(config.wide_runs, 32)
    runs = context.map(partial(_wide_run, config), seeds, WIDE)
    wide = Run.stack(runs)
    return records + _summarise(WIDE, config, wide, config.market.relevant, (*ALL, MORE))


def _selectors(relevant: Iterable[str], network: NetworkF) -> list[Selector]:
    """A selector for each method, in the order of :data:`ALL`."""
    found = FixedFeatures(tuple(relevant)), FixedFeatures(())
    return [JackknifeF(), LinearF(), network, NoSelection(), *found]


def _tabular_run(config: Config, solved: SolvedDomain, seed: np.random.SeedSequence) -> Run:
    rng = np.random.default_rng(seed)

    def selectors() -> list[Selector]:
        network = NetworkF(random_state=int(rng.integers(2**31)))
        return _selectors(solved.relevant, network)

    return run_selectors(solved, config.learner, config.tasks_seen, config.tests, rng, selectors)


def _wide_run(config: Config, seed: np.random.SeedSequence) -> Run:
    rng = np.random.default_rng(seed)
    market = config.market
    names = np.array(market.feature_names)
    seen = market.sample_tasks(max(config.tasks_seen), rng)
    values = market.solutions(seen, market.sample_pairs(config.pairs, rng))
    more = market.solutions(seen, market.sample_pairs(config.more_pairs, rng))
    earned, choices = [], []
    for n in config.tasks_seen:
        network = NetworkF(hidden=config.hidden, random_state=int(rng.integers(2**31)))
        selectors = [*_selectors(names[market.relevant].tolist(), network), LinearF()]
        known = [values.take(np.arange(n))] * len(ALL) + [more.take(np.arange(n))]
        choices.append([choose(*both) for both in zip(selectors, known, strict=True)])
        tests = market.sample_tasks(config.tests, rng)
        draws = rng.integers(2**63, size=config.tests)
        rewards = np.zeros((len(known), config.tests))
        for i, (observed, choice) in enumerate(zip(known, choices[-1], strict=True)):
            start = market.weights(observed, choice.support)
            for t, (task, draw) in enumerate(zip(tests, draws, strict=True)):
                own = np.random.default_rng(int(draw))
                rewards[i, t] = market.learn(task, start, own, config.learner)
        earned.append(rewards.mean(axis=1))
    return Run.of(earned, choices)


def _summarise(
    name: str, config: Config, runs: Run, truth: BoolArray, methods: tuple[str, ...]
) -> list[Selected]:
    records = []
    for (j, n), (i, method) in product(enumerate(config.tasks_seen), enumerate(methods)):
        gain = runs.ahead_of(j, i, ALL.index("none"))
        placed = place(runs.support[:, j, i], truth)
        records.append(
            Selected(
                domain=name,
                method=method,
                tasks_seen=n,
                gain=gain.mean,
                gain_ci95=gain.half_width,
                fpr_ci95=placed["fpr_ci95"],
                tpr_ci95=placed["tpr_ci95"],
                features_kept=float(runs.support[:, j, i].sum(axis=-1).mean()),
                cpu_seconds=float(np.median(runs.seconds[:, j, i])),
                **runs.rated(j, i, truth),
            )
        )
    return records


@criterion("4.5-approximators", selected)
def other_approximators(table: pd.DataFrame) -> Finding:
    """Rates of selection by networks and on tables after the most tasks, on every domain."""
    own = table[table.tasks_seen == table.tasks_seen.max()].set_index(["domain", "method"])
    pairs = two_rates(own)
    nets = own.xs("network", level="method")
    # All must be met, so that none is corrected; that any is missed is, for all of them.
    half = nets[["fpr_ci95", "tpr_ci95"]].set_axis(["fpr", "tpr"], axis=1)
    single, every = (half.mul(_by_t(nets.n_runs, n), axis=0) for n in (1, half.size))
    met = (nets.fpr + single.fpr <= MOST_FALSE) & (nets.tpr - single.tpr >= LEAST_TRUE)
    missed = (nets.fpr - every.fpr > MOST_FALSE) | (nets.tpr + every.tpr < LEAST_TRUE)
    listed = "; ".join(
        f"{d}: tables {pairs[d, 'table']}, linear {pairs[d, 'linear']}, networks "
        f"{nets.fpr[d]:.2f} ± {single.fpr[d]:.2f}/{nets.tpr[d]:.2f} ± {single.tpr[d]:.2f}"
        for d in table.domain.unique()
    )
    return judged(
        met.all(),
        f"FPR/TPR after {table.tasks_seen.max()} tasks, of networks with 95% t intervals over "
        f"runs, {listed}.",
        {"largest fpr": float(nets.fpr.max()), "least tpr": float(nets.tpr.min())},
        otherwise=Verdict.NOT_REPRODUCED if missed.any() else Verdict.INCONCLUSIVE,
    )


def _by_t(runs: pd.Series, choices: int) -> pd.Series:
    """Factor from a normal 95% interval over so many runs to a t interval (Bonferroni)."""
    return pd.Series(stats.t.isf(0.025 / choices, runs - 1) / stats.norm.isf(0.025), runs.index)


def figure(table: pd.DataFrame) -> Figure:
    """ROC space of selectors that see different functions, one panel a domain."""
    domains = table.domain.unique()
    fig, axes = panels(len(domains), len(domains), 3.4, sharex=True, sharey=True)
    handles = {}
    for ax, domain in zip(axes, domains, strict=True):
        for i, method in enumerate(("table", "linear", "network", MORE)):
            own = table[(table.domain == domain) & (table.method == method)]
            own = own.sort_values("tasks_seen")
            look: dict[str, Any] = {
                "marker": "os^v"[i],
                "ms": 5,
                "lw": 0.8,
                "color": COLOURS[i],
                "alpha": 0.85,
            }
            (handles[SYMBOLS[method]],) = ax.plot(own.fpr, own.tpr, **look)
            offset = (5.0 if i % 2 else -5.0, -5.0 if i < 2 else 5.0)
            for row in own.itertuples():
                at, text = (row.fpr, row.tpr), str(row.tasks_seen)
                beside(ax, text, at, offset, fontsize=7, color=COLOURS[i])
        ax.set(xlabel="false positive rate", xlim=(-0.06, 0.3), ylim=(-0.04, 1.08))
        ax.set_title(domain, fontsize=9)
        ax.xaxis.set_major_locator(MaxNLocator(3))
    axes[0].set_ylabel("true positive rate")
    fig.legend(handles.values(), handles, loc="outside lower center", ncols=4, fontsize=8)
    return unclutter(fig)


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Rates and time of every selector after the most tasks, and its gain after fewest and most."""
    few, many = table.tasks_seen.min(), table.tasks_seen.max()
    cell = table.gain.map("{:+.1f}".format) + PM + table.gain_ci95.map("{:.1f}".format)
    gain = table.assign(cell=cell).pivot(
        index=["domain", "method"], columns="tasks_seen", values="cell"
    )
    own = table[(table.tasks_seen == many) & (table.method != "none")]
    at = list(zip(own.domain, own.method, strict=True))
    return pd.DataFrame(
        {
            "domain": own.domain,
            "selector": own.method.map(SYMBOLS),
            "FPR/TPR": two_rates(own),
            f"gain, n = {few}": gain[few].loc[at].tolist(),
            f"gain, n = {many}": gain[many].loc[at].tolist(),
            "time [ms]": (1000 * own.cpu_seconds).map("{:.1f}".format),
        }
    )
