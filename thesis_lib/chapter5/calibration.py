"""Settings that table 5.1 does not print, held against table 5.2 (section 5.4).

Runs at the printed batch vary one setting at a time.  Their first hundred iterations stand beside
the mean over five hundred that the thesis prints: a run that is to reach that mean must be near it
after a hundred.  Only flat ground decides, so that hills and tests stay a prediction.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from thesis_lib.chapter5.cells import NETS, as_published
from thesis_lib.checkout import repository_root
from thesis_lib.edition.criteria import LEVEL, graded
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion, effect_of
from thesis_lib.edition.words import several
from thesis_lib.published import TASKS
from thesis_lib.stats import Summary, equivalence, holm, welch
from thesis_lib.training.config import NARROWED, TrainConfig, head_scale, sensors, step_size
from thesis_lib.training.curves import MARGIN
from thesis_lib.training.trained import LAST

SETTINGS = ("task", "architecture", "sensors", "time_constant", "head_scale", "delta_kl")
"""What tells the runs of a row from others, seeds apart."""

APART = {
    "sensors": "sensors",
    "time_constant": "time constants [s]",
    "head_scale": "output ×",
    "delta_kl": "δ",
}
"""The settings of these in which readings of one net on one robot differ, for a sentence."""

FEWEST = 3
"""Seeds of a reading from which on it is tested against another."""


@dataclass(frozen=True)
class Config:
    """Which runs are read."""

    store: str = "results/calibration"
    """Folder of ``curves.csv``, in the checkout."""
    iterations: int = 100
    """Iterations compared; runs that have not come so far are left out."""


@dataclass(frozen=True)
class Reading:
    """Runs with the same settings."""

    task: str
    """Robot, on flat ground."""
    architecture: str
    """Net."""
    sensors: str
    """What a recurrent net sees: all, or a reading of table 5.1's subset (text, literal, code)."""
    time_constant: float
    """Initial time constants of the CTRNN in seconds; none for other nets."""
    head_scale: float
    """What the output layer's initial weights are multiplied with."""
    delta_kl: float
    """Bound on the divergence in nats."""
    mean_return: float
    """Mean return over the iterations, mean over seeds."""
    lowest: float
    """The same of the seed that earned least."""
    highest: float
    """The same of the seed that earned most."""
    sd: float
    """Standard deviation of the same over seeds; none with one."""
    last_return: float
    """Mean return of the last five of them, mean over seeds."""
    n_runs: int
    """Seeds."""
    printed_mean: float
    """Mean over 500 iterations in table 5.2."""
    printed_se: float
    """Its standard error over five runs."""


@experiment("ch5-calibration", item="Table 5.2, its readings", smoke=Config(), book=Config(),
            seconds=0.06)  # fmt: skip
def readings(config: Config, context: Context) -> list[Reading]:
    """Return of the first iterations by settings that are not printed, beside table 5.2."""
    curves = pd.read_csv(repository_root() / config.store / "curves.csv")
    curves = curves[curves.iteration <= config.iterations]
    printed = as_published("table-5.2").loc["flat"]
    rows = []
    for key, group in curves.groupby(list(SETTINGS), sort=False, dropna=False):
        by = group.pivot(index="iteration", columns="seed", values="mean_return")
        if len(by) < config.iterations:
            continue
        runs = by.loc[:, by.notna().all()]
        means = runs.mean()
        settings: dict[str, Any] = dict(zip(SETTINGS, key, strict=True))
        net = settings["architecture"].upper()
        cell = printed.loc[(settings["task"], net)]
        rows.append(
            Reading(
                **settings,
                mean_return=float(means.mean()),
                lowest=float(means.min()),
                highest=float(means.max()),
                sd=float(means.std()),
                last_return=float(runs.tail(LAST).to_numpy().mean()),
                n_runs=runs.shape[1],
                printed_mean=float(cell.value),
                printed_se=float(cell.standard_error),
            )
        )
    return rows


def _told(row: pd.Series) -> str:
    seeds = f"{row.n_runs} seed{'s' if row.n_runs > 1 else ''}"
    return f"{row.mean_return:.0f} ({seeds}; {row.last_return:.0f} at the end)"


@effect_of("5.2.2-time-constants", readings)
def of_time_constants(table: pd.DataFrame) -> str:
    """What the CTRNN earns on the half-cheetah by its initial time constants."""
    rows = table[(table.task == "HalfCheetah") & (table.architecture == "ctrnn")]
    rows = rows.sort_values("time_constant")
    told = ", ".join(f"{_told(r)} from {r.time_constant:g} s" for r in rows.itertuples())
    first = rows.iloc[0]
    return (
        f"On the HalfCheetah the mean return of the first hundred iterations is {told}; printed "
        f"over five hundred are {first.printed_mean:.0f} ± {first.printed_se:.0f}."
    )


@effect_of("5.1-subsets", readings)
def of_subsets(table: pd.DataFrame) -> str:
    """What the DTRNN earns on the hopper by what it sees."""
    rows = table[(table.task == "Hopper") & (table.architecture == "dtrnn")]
    names = {"text": "the text's 11 sensors", "literal": "all but the angular velocities",
             "code": "the 17 sensors of the author's code"}  # fmt: skip
    told = ", ".join(f"{_told(r)} with {names[r.sensors]}" for r in rows.itertuples())
    return (
        f"On the Hopper the DTRNN's mean return of the first hundred iterations is {told}; printed "
        f"over five hundred are {rows.printed_mean.iloc[0]:.0f} ± {rows.printed_se.iloc[0]:.0f}."
    )


@effect_of("5.2-output-start", readings)
def of_output_start(table: pd.DataFrame) -> str:
    """What a tenth of the output layer's initial weights changes, by net."""
    keys = ["task", "architecture", "sensors", "time_constant", "delta_kl"]
    by = table.assign(time_constant=table.time_constant.fillna(0)).pivot(
        index=keys, columns="head_scale", values=["mean_return", "n_runs", "printed_mean"]
    )
    by = by.dropna()
    told = ", ".join(
        f"{key[1].upper()} {row['mean_return', 1.0]:.0f} and {row['mean_return', 0.1]:.0f} "
        f"({row['n_runs'].min():.0f})"
        for key, row in by.iterrows()
    )
    off = by["mean_return"].sub(by["printed_mean", 1.0], axis=0).abs()
    other = [
        str(key[1]).upper()
        for key, nearer in off.idxmin(axis=1).items()
        if nearer != head_scale(TrainConfig(key[0], architecture=key[1]))
    ]
    but = f", but for {several(other)}" if other else ""
    return (
        "Mean return of the first hundred iterations on the HalfCheetah, from the author's scale "
        f"and from a tenth of it (seeds): {told}.  In use is the one that comes nearer to "
        f"table 5.2{but}; with one or two seeds that is a choice, not a finding."
    )


@effect_of("5.4-other-step-sizes", readings)
def of_step_sizes(table: pd.DataFrame) -> str:
    """What nets whose step size is not printed earn by it, where both were tried alike."""
    keys = ["task", "architecture", "sensors", "head_scale"]
    told = []
    for (task, net, *_), own in table.fillna({"time_constant": 0}).groupby(keys, sort=False):
        if own.delta_kl.nunique() > 1:
            each = several(f"{_told(r)} with {r.delta_kl:g}" for r in own.itertuples())
            told.append(f"{net.upper()} on the {task} {each}")
    return (
        f"Mean return of the first hundred iterations: {'; '.join(told)}. What whole runs come to "
        "with the step sizes in use stands beside table 5.2. The thesis's values for the other "
        "networks range from 0.02 to 0.5."
    )


def used(table: pd.DataFrame) -> pd.Series:
    """Whether a row has the settings of :class:`~thesis_lib.training.config.TrainConfig`."""
    flags = []
    for row in table.itertuples():
        config = TrainConfig(str(row.task), architecture=str(row.architecture))
        given = (row.sensors, row.head_scale, row.delta_kl)
        same = given == (sensors(config), head_scale(config), step_size(config))
        flags.append(same and not abs(row.time_constant - config.time_constant) > 0)
    return pd.Series(flags, index=table.index)


def _reach(table: pd.DataFrame) -> pd.Series:
    """Whether the last of the first hundred iterations earn the printed mean less two errors."""
    reach: pd.Series = table.last_return >= table.printed_mean - 2 * table.printed_se
    return reach


def fit(table: pd.DataFrame) -> str:
    """Which nets come to the level of table 5.2 within the calibration by some reading."""
    whole = []
    for task, own in table.groupby("task", sort=False):
        by_net = _reach(own).groupby(own.architecture, sort=False).any()
        by_net.index = by_net.index.str.upper()
        best = own.loc[own.groupby("architecture").last_return.idxmax()]
        short = {
            r.architecture.upper(): f"{r.last_return / r.printed_mean:.0%}"
            for r in best.itertuples()
        }
        yes, no = by_net.index[by_net], by_net.index[~by_net]
        told = [f"On the {task}"]
        if len(yes):
            told.append(f"some reading brings {several(yes)} to the printed level by then")
        if len(no):
            each = several(f"{net} ({short[net]})" for net in no)
            told.append(
                f"{'and ' if len(yes) else ''}nothing tried brings {each} there, in brackets the "
                "best reading's share of the printed mean"
            )
        whole.append(f"{' '.join(told)}.")
    level = "At the printed level is what earns table 5.2's mean less two standard errors."
    return " ".join([level, *whole, *_nearer(table)])


def _nearer(table: pd.DataFrame) -> list[str]:
    """A sentence on nets that learned faster by another reading than the one in use."""
    told = []
    for (task, net), own in table.assign(used=used(table)).groupby(["task", "architecture"]):
        mine, others = own[own.used], own[~own.used]
        if len(mine) and len(others) and others.mean_return.max() > mine.mean_return.max():
            told.append(f"{net.upper()} ({task})")
    if not told:
        return []
    return [
        f"Faster by another reading than the one in use learned {several(told)}: there the one in "
        "use was not chosen by this table."
    ]


def gaps(table: pd.DataFrame) -> str:
    """What the calibration has not tried, and what rests on one seed."""
    told = []
    for task in TASKS:
        own = table[table.task == task]
        nets = set(own.architecture.str.upper())
        missing = [net for net in NETS if net not in nets]
        if nets and missing:
            told.append(f"On the {task} nothing was tried for {several(missing)}.")
        elif not nets and task in NARROWED:
            told.append(f"On the {task}, whose subset of sensors is a reading too, nothing was.")
    single = table[table.n_runs == 1]
    if len(single):
        told.append(f"{len(single)} of {len(table)} readings have one seed alone.")
    return " ".join(told)


@criterion("table-5.1-subset", readings)
def text_subset_learns(table: pd.DataFrame) -> Finding:
    """Whether the DTRNN comes to the printed mean with the sensors that the text describes."""
    rows = table[(table.task == "Hopper") & (table.architecture == "dtrnn")].set_index("sensors")
    text, code = rows.loc["text"], rows.loc["code"]
    low = text.printed_mean - 2 * text.printed_se
    verdict = Verdict.REPRODUCED if text.last_return >= low else Verdict.NOT_REPRODUCED
    if min(text.n_runs, code.n_runs) < 2:
        verdict = Verdict.INCONCLUSIVE
    return Finding(
        verdict,
        f"After a hundred iterations the DTRNN earns {text.last_return:.0f} on the Hopper with the "
        f"11 sensors without velocities and {code.last_return:.0f} with the 17 of the author's "
        f"code ({text.n_runs} and {code.n_runs} runs); table 5.2 prints {text.printed_mean:.0f} ± "
        f"{text.printed_se:.0f} over five hundred.",
        {"text": float(text.last_return), "code": float(code.last_return)},
    )


def _pairs(table: pd.DataFrame) -> Iterator[tuple[str, Summary, Summary]]:
    """Readings of a net on a robot that differ in one setting, each of two seeds or more."""
    several = table[table.n_runs > 1].fillna({"time_constant": 0})
    for (task, net), own in several.groupby(["task", "architecture"], sort=False):
        for (_, a), (_, b) in itertools.combinations(own.iterrows(), 2):
            apart = [name for name in APART if a[name] != b[name]]
            if len(apart) == 1:
                (name,) = apart
                first, second = (r[name] if name == "sensors" else f"{r[name]:g}" for r in (a, b))
                called = f"{net.upper()} ({task}), {APART[name]} {first} and {second}"
                one, other = (Summary(r.mean_return, r.sd, int(r.n_runs)) for r in (a, b))
                yield called, one, other


@criterion("5.7-hyperparameters", readings)
def settings_matter(table: pd.DataFrame) -> Finding:
    """Readings of one net that differ in one setting, tested where both have seeds enough."""
    pairs = sorted(_pairs(table), key=lambda pair: -min(pair[1].n, pair[2].n))
    many = np.array([min(a.n, b.n) >= FEWEST for _, a, b in pairs], dtype=bool)
    tested = [(a, b) for (_, a, b), enough in zip(pairs, many, strict=True) if enough]
    p = np.full(len(pairs), np.nan)
    p[many] = holm([welch(a, b).p_value for a, b in tested])
    told = [
        f"{name}: {a.mean:.0f} and {b.mean:.0f} ({a.n} and {b.n} seeds"
        f"{'' if np.isnan(q) else f', p = {q:.2g}'})"
        for (name, a, b), q in zip(pairs, p, strict=True)
    ]
    alike = [
        equivalence(a, b, MARGIN * max(abs(a.mean), abs(b.mean))).p_value < LEVEL for a, b in tested
    ]
    sure, none = int((p < LEVEL).sum()), bool(alike) and all(alike)
    return Finding(
        graded(sure, otherwise=Verdict.NOT_REPRODUCED if none else Verdict.INCONCLUSIVE),
        f"Pairs of readings that differ in one setting: {len(pairs)}, with {FEWEST} seeds or more "
        f"each {len(tested)}, and significantly different of these {sure} (mean return of the "
        f"first hundred iterations, Welch, Holm). {'; '.join(told)}.",
        {"significant": float(sure), "tested": float(len(tested))},
    )


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """The table for the page; bold the returns of what is in use."""
    low, high = (table[c].map("{:.0f}".format) for c in ("lowest", "highest"))
    mean = table.mean_return.map("{:.0f}".format)
    return pd.DataFrame(
        {
            "task": table.task,
            "network": table.architecture.str.upper(),
            "sensors": table.sensors,
            "τ [s]": table.time_constant.map(lambda t: "–" if np.isnan(t) else f"{t:g}"),
            "output": table.head_scale.map("× {:g}".format),
            "δ": table.delta_kl.map("{:g}".format),
            "first 100": mean.where(~used(table), "**" + mean + "**"),
            "seeds": [a if a == b else f"{a} to {b}" for a, b in zip(low, high, strict=True)],
            "at 100": table.last_return.map("{:.0f}".format),
            "printed, 500": [
                f"{m:.0f} ({s:.0f})"
                for m, s in zip(table.printed_mean, table.printed_se, strict=True)
            ],
        }
    )
