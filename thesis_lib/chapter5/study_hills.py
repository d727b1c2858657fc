"""Study 2 (ours): what does training on hills do? (sections 5.5.2 and 5.7)

The thesis says that it gives RNNs, not FNNs, an incentive to maintain internal state.  Then the
logarithm of the share they keep rises more for RNNs than for FNNs; and policies trained on hills
lose more of their return than flat-trained ones if their memory is zeroed at every step.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.stats import ttest_1samp

from thesis_lib.arrays import FloatArray
from thesis_lib.chapter5 import cells
from thesis_lib.chapter5.cells import GROUPS, ROBOTS, Cells, weights
from thesis_lib.chapter5.contrasts import SMOKE, Config
from thesis_lib.chapter5.judging import Evidence, both, of_rows, of_source, together
from thesis_lib.chapter5.runs import CELL, DEFAULT, PRINTED_STEPS, Runs
from thesis_lib.edition.criteria import graded
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.words import plain, with_interval
from thesis_lib.robustness import PERTURBATIONS, TRAINED_ON, retained

FLOOR = 0.01
"""A policy that keeps less of its return counts as keeping this much: logarithms need it."""

IN_FULL = "in full"
INTERVENTIONS = ("no memory", "no previous action")


@dataclass(frozen=True)
class Effect:
    """One difference that training on hills makes, on a logarithmic scale."""

    source: str
    """Printed, ours, or in full: those of ours that learned for as long as the thesis's."""
    name: str
    """Noise or switch: rise of the share kept, RNNs less FNNs.  Noise, RNNs: theirs alone.  No
    memory or no previous action: loss of the regular return without it, hill-trained less
    flat-trained RNNs."""
    value: float
    """Mean over robots of the difference of logarithms."""
    low: float
    """Lower end of its 95% bootstrap interval over runs."""
    high: float
    """Upper end."""
    p_tasks: float
    """t-test with robots as the unit."""
    robots: int
    """Robots behind it."""
    units: int
    """Fewest runs behind it."""
    printed_budget: bool
    """Whether all learned for as many steps as the thesis's."""


@experiment("ch5-hills", item="Study 2", smoke=SMOKE, book=Config(), seconds=0.8)
def effects(config: Config, context: Context) -> list[Effect]:
    """Differences of differences by training on hills, printed and ours."""
    a, b, c, d = (np.random.default_rng(s) for s in context.seeds(4))
    store = config.runs()
    found = [*_rises(cells.printed(tuple(cells.TESTED.values()), a, config.resamples))]
    found += _rises(cells.from_tests(store, b, config.resamples))
    found += _losses(store, c, config.resamples)
    long = store.in_full()
    return [
        *found,
        *_rises(replace(cells.from_tests(long, d, config.resamples), source=IN_FULL)),
        *_losses(long, d, config.resamples, IN_FULL),
    ]


def _rises(made: Cells) -> Iterator[Effect]:
    own, others = weights("RNNs"), weights("FNNs")
    means, resampled = _rise(made.mean), _rise(made.draws)
    for j, perturbation in enumerate(PERTURBATIONS):
        for name, of in ((perturbation, own - others), (f"{perturbation}, RNNs", own)):
            mean, draws = means[j] @ of, resampled[:, j] @ of
            there = np.isfinite(mean)
            if there.any():
                units = int(made.units[:, there].min())
                budget = bool(made.printed_budget[:, there].all())
                yield _effect(made.source, name, mean[there], draws[:, there], units, budget)


def _rise(returns: FloatArray) -> FloatArray:
    """Rise of the log share kept by hill training, shape ``(..., 2, robots, nets)``."""
    logs = np.log(np.maximum(retained(returns), FLOOR))
    rise: FloatArray = logs[..., 1, :, :, :] - logs[..., 0, :, :, :]
    return rise


def _losses(
    store: Runs, rng: np.random.Generator, n: int, source: str = "ours"
) -> Iterator[Effect]:
    """Log loss of the regular return by an intervention, hill-trained less flat-trained."""
    tests = store.returns(across=["terrain"])
    tests = tests[(tests.condition == "base") & (tests.variant == DEFAULT)]
    keys = [*CELL, "seed", "iterations", "batch_steps"]
    wide = tests.pivot_table(index=keys, columns="intervention", values="return").reset_index()
    wide = wide[wide.architecture.str.upper().isin(GROUPS["RNNs"])]
    for name in INTERVENTIONS:
        if name not in wide or "none" not in wide:
            continue
        own = wide[(wide["none"] > 0) & wide[name].notna()]
        own = own.assign(loss=-np.log(np.maximum(own[name] / own["none"], FLOOR)))
        by = own.groupby(["task", "architecture", "terrain"]).loss
        samples = {key: loss.to_numpy() for key, loss in by}
        nets = [
            (r, a) for r, a, ground in samples if ground == "hill" and (r, a, "flat") in samples
        ]
        robots = [robot for robot in ROBOTS if any(r == robot for r, _ in nets)]
        if not robots:
            continue
        mean = {key: np.array([loss.mean()]) for key, loss in samples.items()}
        drawn = {
            key: loss[rng.integers(len(loss), size=(n, len(loss)))].mean(axis=1)
            for key, loss in samples.items()
        }
        units = min(len(samples[r, a, ground]) for r, a in nets for ground in TRAINED_ON)
        deep = bool((own.iterations * own.batch_steps >= PRINTED_STEPS).all())
        value, draws = (_by_robot(losses, nets, robots) for losses in (mean, drawn))
        yield _effect(source, name, value[0], draws, units, deep)


def _by_robot(
    losses: Mapping[tuple[str, str, str], FloatArray],
    nets: Sequence[tuple[str, str]],
    robots: Sequence[str],
) -> FloatArray:
    """Hill-trained less flat-trained, mean over each robot's nets, shape ``(n, robots)``."""
    return np.stack(
        [
            np.mean(
                [losses[r, a, "hill"] - losses[r, a, "flat"] for r, a in nets if r == robot],
                axis=0,
            )
            for robot in robots
        ],
        axis=1,
    )


def _effect(
    source: str, name: str, by_robot: FloatArray, draws: FloatArray, units: int, deep: bool
) -> Effect:
    over = draws.mean(axis=1)
    return Effect(
        source,
        name,
        float(by_robot.mean()),
        *cells.interval(over, units),
        float(ttest_1samp(by_robot, 0).pvalue) if len(by_robot) > 1 else np.nan,
        len(by_robot),
        units,
        deep,
    )


def _above_zero(table: pd.DataFrame, source: str, name: str, what: str) -> Evidence | None:
    own = of_source(source, table)
    rows = own[own.name == name]
    if rows.empty:
        return None
    row = rows.iloc[0]
    verdict = graded(row.low > 0, row.value > 0, denied=row.high < 0)
    sentence = f"{what} {_interval(row)} on a logarithmic scale"
    if row.robots > 1:
        sentence += f"; with the {row.robots} robots as the unit p = {row.p_tasks:.2g}"
    return of_rows(rows, verdict, f"{sentence}.")


def reading(table: pd.DataFrame) -> str:
    """What zeroing memory, and the last action that recurrent nets read, does in the test."""
    own = table[table.source == "ours"].set_index("name")
    told = []
    for name in INTERVENTIONS:
        if name not in own.index:
            told.append(f"Policies with {name} have not been tested yet.")
            continue
        told.append(
            f"With {name} the loss of regular return of hill-trained RNNs, less that of "
            f"flat-trained ones, is {_interval(own.loc[name])} on a logarithmic scale "
            f"({_behind(own.loc[[name]])})."
        )
    return plain(" ".join(told))


def reading_in_full(table: pd.DataFrame) -> str:
    """The same losses, and the rise of the share kept, of policies that learned for as long."""
    words = {
        "noise": "by training on hills the share kept under noise rises more for RNNs than for "
        "FNNs by",
        "noise, RNNs": "that of RNNs by",
        "no memory": "without memory hill-trained RNNs lose more by",
        "no previous action": "without the previous action by",
    }
    own = table[(table.source == IN_FULL) & table.name.isin(list(words))].set_index("name")
    if own.empty:
        return "No policies that learned for as long as the thesis's have been tested so."
    told = [f"{said} {_interval(own.loc[n])}" for n, said in words.items() if n in own.index]
    return plain(
        f"Of the policies that learned for as long as the thesis's alone ({_behind(own)}): "
        f"{', '.join(told)}."
    )


def _interval(row: pd.Series) -> str:
    return with_interval(row.value, row.low, row.high, "+.2f")


def _behind(rows: pd.DataFrame) -> str:
    """What is behind some effects."""
    robots = rows.robots.min()
    return f"{f'{robots} robots' if robots > 1 else 'one robot'}, {rows.units.min()} seeds or more"


@both("5.7-pomdp-transfer", effects)
def transfers(source: str, table: pd.DataFrame) -> Evidence | None:
    """Rise of the share kept under noise, RNNs less FNNs, and RNNs' own."""
    more = _above_zero(table, source, "noise", "the share kept rises more for RNNs by")
    return together([more, _above_zero(table, source, "noise, RNNs", "that of RNNs rises by")])


@both("6.1-incentive", effects)
def memory_matters(source: str, table: pd.DataFrame) -> Evidence | None:
    """Loss without memory, hill-trained less flat-trained RNNs."""
    return _above_zero(table, source, "no memory", "without memory hill-trained RNNs lose more by")
