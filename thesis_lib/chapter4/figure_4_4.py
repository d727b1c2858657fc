"""Figures 4.4 and 4.5: feature selection on the cliff, with Q* and with Q~ as potential."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Literal

import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.chapter3.runs import TabularLearner
from thesis_lib.chapter4 import looks
from thesis_lib.chapter4.protocol import (
    Flat,
    Level,
    Protocol,
    Selected,
    gains,
    measure,
    row,
    share_interval,
    wider,
)
from thesis_lib.chapter4.runs import Source, Target, solve_domain
from thesis_lib.checks import one_of
from thesis_lib.domains import continuing_cliff, episodic_cliff
from thesis_lib.edition.criteria import LEVEL, Pair, judged, no_greater, ordered, summary
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.words import plus_minus, probability, several
from thesis_lib.stats import holm, welch

POSITION = ("x", "y")
"""Features of the cliff that are relevant, but so weakly that the thesis counts them as not."""

METHODS = ("fs-tek", "ibkr", "jackknife", "random", "none", "constant")
"""No fixed features: all are relevant."""

LEFT_OUT = ("random", "constant")
"""Not drawn, as random features are not in the thesis: they earn far less than the others."""

NAMES = ("Q*", "Q~")
"""How sentences name the two potentials."""

ABOUT_40 = (0.3, 0.5)
"""Shares that count as about 40%."""


@dataclass(frozen=True)
class Config:
    """Settings of figures 4.4 and 4.5."""

    target: Target = "Q_star"
    """Q* in figure 4.4, Q~ in figure 4.5."""
    protocol: Protocol = field(
        default_factory=lambda: Protocol(
            tasks_seen=(1, 2, 3, 4, 5, 6, 7, 8, 10, 12), methods=METHODS
        )
    )
    """Sizes; no fixed features, as all are relevant."""
    cliff: Literal["continuing", "episodic"] = "continuing"
    """Which cliff domain; the text does not say, but only this one fits its statements."""
    learner: TabularLearner = field(
        default_factory=lambda: TabularLearner("q_learning", 0.1, 0.01, steps=10_000)
    )
    """Learning rate near the best of figure 3.1; ten thousand steps, as long as the boost lasts."""
    fstek: Level = "schedule"
    """Level of FS-TEK; not printed for this domain."""
    flat: Flat = "unsure"
    """A colour or a sensor reading that never varied makes the fit singular, hence "unsure"."""
    source: Source = "exact"
    """Exact solutions of the observed tasks, or learned ones."""


SMALL = Protocol(runs=2, tests=1, tasks_seen=(1, 2, 4), methods=METHODS)
SMOKE, THESIS = Config(protocol=SMALL), Config()
BOOK = replace(THESIS, protocol=replace(THESIS.protocol, runs=120))


def measured(config: Config, context: Context) -> list[dict[str, Any]]:
    """Fields of :class:`~thesis_lib.chapter4.protocol.Selected` on either cliff."""
    one_of("cliff", config.cliff, ("continuing", "episodic"))
    solved = solve_domain(
        episodic_cliff(True) if config.cliff == "episodic" else continuing_cliff(),
        config.learner,
        context,
        target=config.target,
        source=config.source,
        irrelevant=POSITION,
    )
    # Both potentials see the same tasks, so that they can be compared.
    sizes = (config.learner, config.protocol, config.fstek, config.flat)
    return measure(solved, *sizes, context, 1)


@experiment("figure-4.4", item="Figure 4.4", smoke=SMOKE, book=BOOK, thesis=THESIS, seconds=20)
def with_q_star(config: Config, context: Context) -> list[Selected]:
    """Feature selection on the cliff with Q* as potential."""
    return [Selected(**fields) for fields in measured(config, context)]


@experiment(
    "figure-4.5",
    item="Figure 4.5",
    smoke=replace(SMOKE, target="Q_tilde"),
    book=replace(BOOK, target="Q_tilde"),
    thesis=replace(THESIS, target="Q_tilde"),
    seconds=20,
)
def with_q_tilde(config: Config, context: Context) -> list[Selected]:
    """Feature selection on the cliff with Q~ as potential."""
    return [Selected(**fields) for fields in measured(config, context)]


@criterion("4.3-cliff-removes", with_q_star, with_q_tilde)
def removes_position(*tables: pd.DataFrame) -> Finding:
    """How often FS-TEK removes the position features, over the numbers of tasks measured."""
    least, most = ABOUT_40
    listed, counted, near, far = [], [], [], []
    for name, table in zip(NAMES, tables, strict=True):
        own = table[(table.method == "fs-tek") & (table.tasks_seen >= 4)]
        gone = (1 - own.fpr).set_axis(own.tasks_seen)
        over = share_interval(gone, own.n_runs.set_axis(own.tasks_seen), len(own))
        within = (over.low >= least) & (over.high <= most)
        beyond = (over.high < least) | (over.low > most)
        near.append(float(within.mean()))
        far.append(float(beyond.mean()))
        listed.append(f"{name}: {several(f'{share:.0%} at {n}' for n, share in gone.items())}")
        counted.append(f"within at {within.sum()} and beyond at {beyond.sum()} ({name})")
    return judged(
        near[0] > 0.5,
        f"Position removed with {'; '.join(listed)} tasks. Of {least:.0%} to {most:.0%} the 95% "
        f"interval over runs, corrected for the {len(gone)} numbers of tasks, lies "
        f"{several(counted)}.",
        dict(zip(NAMES, near, strict=True)) | {"beyond": far[0]},
        direction=near[0] > 0,
        otherwise=Verdict.NOT_REPRODUCED if far[0] > 0.5 else Verdict.INCONCLUSIVE,
    )


@criterion("4.3-cliff-gain", with_q_star)
def gains_slightly(table: pd.DataFrame) -> Finding:
    """FS-TEK against no selection with Q*, at the number of tasks where it gains most."""
    by = gains(table)
    n = by.fstek_minus.idxmax()
    gain, half = by.loc[n]
    earned = abs(float(row(table, "none", n).mean_return))
    return judged(
        gain - half * wider(len(by)) > 0,
        f"Largest paired gain over no selection {gain:+.0f} ± {half:.0f} after {n} tasks, "
        f"{gain / earned:.0%} of the return.",
        {"gain": float(gain)},
        otherwise=Verdict.NOT_REPRODUCED
        if (by.fstek_minus + by.fstek_minus_ci95 < 0).all()
        else Verdict.INCONCLUSIVE,
    )


def turns(table: pd.DataFrame) -> tuple[bool, str]:
    """Whether the return without selection rises to a peak inside and then falls; a sentence."""
    own = table[table.method == "none"].sort_values("tasks_seen")
    ends = [own.iloc[0], own.loc[own.mean_return.idxmax()], own.iloc[-1]]
    tests = [welch(summary(ends[1]), summary(end)) for end in (ends[0], ends[2])]
    # The peak is chosen after looking, among all numbers of tasks but one.
    p = holm([min(1.0, (len(own) - 1) * test.p_value) for test in tests])
    first, peak, last = (
        f"{plus_minus(end.mean_return, end.ci95)} after {end.tasks_seen}" for end in ends
    )
    sentence = (
        f"{first}, most {peak}, {last} tasks (rise {probability(p[0])}, decline "
        f"{probability(p[1])}, Welch, corrected for the choice of the peak, Holm)"
    )
    return bool((p < LEVEL).all() and min(t.difference for t in tests) > 0), sentence


@criterion("4.3-cliff-tilde-rises", with_q_tilde)
def q_tilde_does_not_turn(table: pd.DataFrame) -> Finding:
    """That the return with Q~ does not turn, on the continuing cliff."""
    own = table[table.method == "none"].sort_values("tasks_seen")
    peak, last = own.loc[own.mean_return.idxmax()], own.iloc[-1]
    names = (f"the most, after {peak.tasks_seen} tasks", f"after {last.tasks_seen}")
    pair = Pair(summary(peak), summary(last), names, "without selection")
    return no_greater([pair], 0.05, "return", choices=len(own) - 1)


@criterion("4.3-cliff-tilde-gains", with_q_star, with_q_tilde)
def q_tilde_gains_more(star: pd.DataFrame, tilde: pd.DataFrame) -> Finding:
    """Mean and largest gain of FS-TEK with Q~ beside those with Q*."""
    # Numbers of tasks share runs, and both potentials see the same tasks, so that errors may go
    # together in any way: over the numbers half-widths are averaged, of the difference they add up.
    found = {q: gains(t).mean() for q, t in (("Q*", star), ("Q~", tilde))}
    mean = {q: float(by.fstek_minus) for q, by in found.items()}
    half = {q: float(by.fstek_minus_ci95) for q, by in found.items()}
    gap, error = mean["Q~"] - mean["Q*"], sum(half.values())
    listed = " and ".join(f"{plus_minus(mean[q], half[q])} with {q}" for q in NAMES)
    return judged(
        gap > error,
        f"Mean paired gain over no selection {listed}.",
        mean,
        direction=gap > 0,
        otherwise=Verdict.REFUTED if gap < -error else Verdict.INCONCLUSIVE,
    )


def _pair(star: pd.DataFrame, tilde: pd.DataFrame, n: int) -> Pair:
    """Q~ and Q* without selection after n tasks."""
    own = [summary(row(table, "none", n)) for table in (tilde, star)]
    return Pair(own[0], own[1], ("Q~", "Q*"), f"after {n} tasks" if n > 1 else "after 1 task")


@criterion("4.3-cliff-long-run", with_q_star, with_q_tilde)
def q_tilde_in_the_long_run(star: pd.DataFrame, tilde: pd.DataFrame) -> Finding:
    """Q~ against Q* without selection at the largest number of tasks."""
    pair = _pair(star, tilde, int(star.tasks_seen.max()))
    return ordered([pair], "return without selection")


@criterion("4.3-cliff-few", with_q_star, with_q_tilde)
def q_star_for_few_tasks(star: pd.DataFrame, tilde: pd.DataFrame) -> Finding:
    """Q* against Q~ without selection after one and two tasks."""
    pairs = [_pair(star, tilde, n) for n in (1, 2)]
    return ordered(
        [Pair(p.second, p.first, ("Q*", "Q~"), p.where) for p in pairs],
        "return without selection",
    )


def figure(table: pd.DataFrame) -> Figure:
    """Returns in thousands on the left, ROC space on the right."""
    return looks.selection(table, unit=1000, left_out=LEFT_OUT)
