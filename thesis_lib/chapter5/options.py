"""What settings that the text leaves open do to learning (sections 2.3.4, 2.3.5 and 5.4)."""

from __future__ import annotations

import textwrap

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.stats import ttest_1samp

from thesis_lib.chapter5.committed import COLUMNS, Config, experiment_of, time_constant
from thesis_lib.chapter5.networks import NAMES, STYLES
from thesis_lib.edition.criteria import LEVEL, graded
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion, effect_of
from thesis_lib.edition.plots import PRINTED
from thesis_lib.edition.saved import saved
from thesis_lib.edition.words import with_interval
from thesis_lib.stats import mean_ci
from thesis_lib.training.config import TrainConfig, step_size
from thesis_lib.training.curves import MARGIN, PAIRED_COLUMNS, compared, summary
from thesis_lib.training.grid import DEFAULT, parse_variant
from thesis_lib.training.plan import cost

SWEEPS = ("dtrnn", "ctrnn", "esn", "previous_action", "dffwd", "softplus")
"""Sweeps of settings, folders of ``results/options``."""

FIRST = 100
"""Iterations at the printed batch by which settings were calibrated."""

FEWEST = 3
"""Seeds from which on a difference is judged."""

COMMITTED = Config(tuple(f"options/{name}/curves" for name in SWEEPS))


@experiment(
    "ch5-options",
    item="Section 5.5.1",
    smoke=COMMITTED,
    book=COMMITTED,
    seconds=0.3,
    columns={
        "sweep": "path of the sweep below results",
        "iterations": "of its runs",
        "batch_steps": "control steps of an iteration",
        "time_constant": "initial time constants of the sweep's default CTRNNs in seconds",
        **PAIRED_COLUMNS,
    },
)
def changes(config: Config, context: Context) -> pd.DataFrame:
    """Returns with settings changed one at a time (committed with the book).

    Each sweep's variants against its default; p-values are Holm's for a sweep.
    """
    tables = []
    for name in config.names:
        sweep = saved(name)
        budget = {key: sweep.provenance["config"][key] for key in ("iterations", "batch_steps")}
        budget["time_constant"] = time_constant(sweep.provenance)
        tables.append(compared(sweep.table, "variant").assign(sweep=name, **budget))
    return pd.concat(tables, ignore_index=True)


def _change(table: pd.DataFrame, net: str, changed: str) -> pd.Series:
    """The row of a network in which one setting was changed."""
    found = table[(table.architecture == net) & (table.changed == changed)]
    if len(found) != 1:
        raise ValueError(
            f"ch5-options has {len(found)} rows for the {NAMES[net]} with {changed!r}, but "
            "exactly 1 is needed."
        )
    return found.iloc[0]


def _compared(name: str, row: pd.Series) -> str:
    return (
        f"{name} {row.mean_changed:.0f} (difference {row.difference:.0f}, 95% interval "
        f"{row.low:.0f} to {row.high:.0f}, p = {row.p_holm:.2g} after Holm)"
    )


def _at_calibrated(row: pd.Series, found: Finding) -> Finding:
    """What runs say that start from the benchmark's time constants; others decide nothing."""
    ours = TrainConfig().time_constant
    if row.time_constant == ours:
        return found
    return Finding(
        Verdict.INCONCLUSIVE,
        f"{found.evidence} These runs start from time constants of {row.time_constant:g} s and "
        f"last {row.iterations} iterations of {row.batch_steps:,} steps; at the {ours:g} s of the "
        "benchmark, where the CTRNN learns several times as fast, the two have not been compared.",
        found.numbers,
    )


def needed(table: pd.DataFrame) -> str:
    """What it takes to compare the CTRNN's integrators and constraints as the benchmark has it."""
    row = _change(table, "ctrnn", "integrator=euler")
    if row.time_constant == TrainConfig().time_constant:
        return ""
    own = table[(table.architecture == "ctrnn") & (table.sweep == row.sweep)]
    arms = 1 + own.changed.str.contains("integrator|constraint").sum()
    run = TrainConfig(task=row.task, architecture="ctrnn", iterations=FIRST)
    hours = arms * row.n * cost(run) / 3600
    return (
        f"Both were compared at initial time constants of {row.time_constant:g} s, and the "
        f"benchmark starts from {run.time_constant:g} s: claims on them stay open until "
        f"{arms} settings have {row.n} seeds of {FIRST} iterations at the printed batch from "
        f"there, about {hours:.1f} processor hours."
    )


@criterion("5.2.2-clamp", changes)
def clamp_is_best(table: pd.DataFrame) -> Finding:
    """Mean return over training of the clamp against two reparameterisations."""
    others = {
        name: _change(table, "ctrnn", f"constraint={name}") for name in ("softplus", "exponential")
    }
    first = others["softplus"]
    evidence = (
        f"Mean return over training ({first.task}, {first.n} seeds in pairs): "
        f"{first.mean_reference:.0f} with the clamp; "
        + "; ".join(_compared(name, row) for name, row in others.items())
        + ". A penalty was not tried."
    )
    below = [row.difference < 0 for row in others.values()]
    clear = [row.p_holm < LEVEL for row in others.values()]
    better = any(c and not b for b, c in zip(below, clear, strict=True))
    # Five seeds whose intervals hold differences either way show nothing.
    verdict = graded(
        all(below) and all(clear), all(below), denied=better, otherwise=Verdict.INCONCLUSIVE
    )
    return _at_calibrated(first, Finding(verdict, evidence))


@criterion("5.5.1-midpoint", changes)
def midpoint_learns_better(table: pd.DataFrame) -> Finding:
    """Mean return over training of Euler's method against the author's midpoint."""
    euler, midpoint = (_change(table, "ctrnn", f"integrator={n}") for n in ("euler", "midpoint"))
    evidence = (
        f"Mean return over training ({euler.task}, {euler.n} seeds in pairs): "
        f"{euler.mean_reference:.0f} with the author's midpoint (Heun); "
        f"{_compared('Euler', euler)}; {_compared('the true midpoint', midpoint)}."
    )
    worse, clear = euler.difference < 0, euler.p_holm < LEVEL
    verdict = graded(
        worse and clear, worse, denied=clear and not worse, otherwise=Verdict.INCONCLUSIVE
    )
    return _at_calibrated(euler, Finding(verdict, evidence))


seconds = experiment_of(
    *("ch5-integrator-seconds", "options/ctrnn/curves"),
    "Processor seconds of the CTRNN's iterations by setting (committed with the book).",
    {n: COLUMNS[n] for n in ("task", "variant", "seed", "sampling_seconds", "update_seconds")},
)


@criterion("5.5.1-midpoint-cost", seconds)
def midpoint_costs_time(table: pd.DataFrame) -> Finding:
    """Seconds of a run with the author's midpoint over those with Euler's method, seed by seed."""
    spent = table.assign(seconds=table.sampling_seconds + table.update_seconds)
    by = spent.pivot_table("seconds", "seed", "variant", aggfunc="sum")
    pairs = by.reindex(columns=[DEFAULT, "integrator=euler"]).dropna()
    if len(pairs) < FEWEST:
        told = f"Only {len(pairs)} seeds have been timed with both methods."
        return Finding(Verdict.INCONCLUSIVE, told)
    logs = np.log(pairs[DEFAULT] / pairs["integrator=euler"])
    found, p = mean_ci(logs), float(ttest_1samp(logs, 0).pvalue)
    ratio, low, high = np.exp(found.mean + found.half_width * np.array([0, -1, 1]))
    return Finding(
        graded(
            found.mean > 0 and p < LEVEL,
            found.mean > 0,
            denied=p < LEVEL,
            otherwise=Verdict.INCONCLUSIVE,
        ),
        f"A run with the author's midpoint (Heun) takes {with_interval(ratio, low, high, '.2f')} "
        f"times the processor seconds of one with Euler's method ({table.task.iloc[0]}, "
        f"{len(pairs)} seeds in pairs, {pairs[DEFAULT].mean():.1f} and "
        f"{pairs['integrator=euler'].mean():.1f} s; paired t-test of logarithms, p = {p:.2g}).",
        {"ratio": float(ratio), "p": p},
    )


def measured(table: pd.DataFrame, net: str, changed: str) -> str:
    """What a change does to the mean return over the learning curve, as a sentence."""
    row = _change(table, net, changed)
    many = int((table.sweep == row.sweep).sum())
    after = f", {row.p_holm:.2g} after Holm for the {many} options tried" if many > 1 else ""
    return (
        f"Measured with `{changed}` for the {NAMES[net]} on {row.task}: over {row.iterations} "
        f"iterations of {row.batch_steps:,} steps the mean return is {row.mean_changed:.0f} "
        f"instead of {row.mean_reference:.0f}, a difference of {row.difference:.0f} (95% "
        f"interval {row.low:.0f} to {row.high:.0f}, {row.n} seeds in pairs; t-test "
        f"p = {row.p_difference:.2g}{after})."
    )


@effect_of("2.3.4-discount", changes)
def smaller_lambda(table: pd.DataFrame) -> str:
    """What advantages with a lambda below 1 change."""
    known = "A lambda below 1 trades variance for the bias of a linear baseline."
    return f"{known} {measured(table, 'dtrnn', 'gae_lambda=0.97')}"


@effect_of("2.3.4-bootstrap", changes)
def bootstrap(table: pd.DataFrame) -> str:
    """What crediting episodes cut by the limit changes."""
    known = (
        "Returns near the limit look smaller than they are. The baseline has the time among its "
        "features and takes up most of it."
    )
    return f"{known} {measured(table, 'dtrnn', 'bootstrap=True')}"


@effect_of("2.3.5-damping", changes)
def damping(table: pd.DataFrame) -> str:
    """What more damping of the Fisher matrix changes."""
    known = (
        "10 steps leave a residual, which every learning curve records (column `residual`); the "
        "line search makes the step safe all the same."
    )
    return f"{known} {measured(table, 'dtrnn', 'damping=0.1')}"


@effect_of("5.4-initial-weights", changes)
def small_output_layer(table: pd.DataFrame) -> str:
    """What an output layer that starts small changes."""
    known = (
        "With an output layer of full size the first policies act on the state before anything is "
        "learned, with means about as large as their noise; a small one starts all of them from "
        "noise around 0."
    )
    return f"{known} {measured(table, 'dffwd', 'head_scale=0.01')}"


def figure(table: pd.DataFrame) -> Figure:
    """What changing a setting does to the return, beside a tenth of the default's, row by row."""
    fig, ax = plt.subplots(figsize=(7.2, 1.0 + 0.27 * len(table)))
    ax.axvline(0, color=PRINTED, lw=1)
    names = []
    for place, row in enumerate(table.itertuples()):
        colour = STYLES[row.architecture][0]
        none = MARGIN * abs(row.mean_reference)
        ax.plot([-none, none], [place, place], color="#d0d0d0", lw=7, solid_capstyle="butt")
        ax.plot([row.low, row.high], [place, place], color=colour, lw=1.4)
        sure = row.p_holm < LEVEL
        ax.plot(row.difference, place, "o", color=colour, mfc=colour if sure else "white")
        switched = row.changed.replace("=True", " on").replace("=False", " off")
        changed = switched.replace("_", " ").replace("=", " ")
        names.append(textwrap.fill(f"{NAMES[row.architecture]}: {changed}", 36))
    ax.set_yticks(range(len(names)), names, fontsize=8.5)
    ax.set(ylim=(len(names) - 0.5, -0.5), xlabel="difference in return")
    ax.grid(axis="y", visible=False)
    return fig


def by_bound(curves: pd.DataFrame, last: int = 5) -> pd.DataFrame:
    """Return of the first batch and of the last ones by bound on the divergence.

    Parameters
    ----------
    curves
        Several seeds of one network on one task with variants of ``delta_kl``, as a sweep
        merges them.
    last
        Batches at the end that are averaged.

    Returns
    -------
    pandas.DataFrame
        A row a bound, the largest first: the bound, the number of runs, mean returns with the
        half-width of their 95% Student interval, and in how many runs the end is above the
        start.
    """
    run = curves.iloc[0]
    plain = step_size(TrainConfig(task=run.task, architecture=run.architecture))
    records = []
    for name, ends in summary(curves, last).groupby("variant"):
        delta = plain if name == DEFAULT else float(parse_variant(str(name))["delta_kl"])
        record: dict[str, object] = {"bound [nat]": delta, "runs": len(ends)}
        for heading, part in (("first batch", "first_return"), (f"last {last}", "last_return")):
            found = mean_ci(ends[part])
            record[heading] = f"{found.mean:.1f} ± {found.half_width:.1f}"
        record["gained"] = f"{int((ends.last_return > ends.first_return).sum())} of {len(ends)}"
        records.append(record)
    return pd.DataFrame(records).sort_values("bound [nat]", ascending=False, ignore_index=True)
