r"""Table 5.2: mean return per learning iteration (section 5.5.1), and what the text says of it.

An entry is the mean over S runs and K iterations of the mean return of an iteration's episodes,

.. math:: \bar R = \frac{1}{S K} \sum_{s=1}^{S} \sum_{k=1}^{K} \bar R_{s,k} .

The mean over a run's iterations is taken by ``runs.Runs.learning`` and that over runs by
``cell_table.beside``; which runs are read says the ``Config`` of ``contrasts``.

``leads(claim, "learning", "all", firsts, seconds)`` judges a claim by whether each of some nets is
ahead of each of others, over runs and after Holm; ``both`` asks the printed table and our runs, of
each the ``rows`` that the claim rests on, and the claim is as good as the weaker.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
from scipy.stats import binomtest, norm, ttest_1samp

from thesis_lib.chapter5.cell_table import (
    Cell,
    beside,
    best_against_best,
    summary,
    whole,
    whole_rows,
    wide,
)
from thesis_lib.chapter5.cells import GROUPS, LEARNING_RUNS, NETS
from thesis_lib.chapter5.contrasts import Config, comparisons
from thesis_lib.chapter5.judging import Evidence, Said, ahead, both, difference, leads, pick
from thesis_lib.chapter5.runs import ENOUGH
from thesis_lib.edition.criteria import LEVEL, graded
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.stats import combined, holm, welch

CALIBRATED = [("HalfCheetah", "flat"), ("Hopper", "flat")]
"""Rows by which unprinted settings were chosen (:mod:`thesis_lib.chapter5.calibration`): that our
means are near them is a fit."""

NEAR = 0.2
"""Share of the printed means by which a net's may differ on average and be the same."""


@experiment("table-5.2", item="Table 5.2", smoke=Config(), book=Config(), seconds=0.1)
def entries(config: Config, context: Context) -> list[Cell]:
    """Mean return per learning iteration, printed and ours, by robot, ground and net."""
    runs = config.runs().learning().rename(columns={"mean_return": "value"})
    return beside("table-5.2", runs, LEARNING_RUNS)


fnn_fastest = leads("5.5.1-fnn-fastest", "learning", "all", ["FNNs"], ["RNNs"])
dffwd_best = leads("6.1-dffwd-best", "learning", "all", ["DFFWD"], NETS)
dtrnn_best = leads("5.5.1-dtrnn-best-rnn", "learning", "all", ["DTRNN"], GROUPS["RNNs"])
vanilla = leads("5.5.1-vanilla-over-gated", "learning", "all", ["vanilla RNNs"], ["gated RNNs"])


@both("6.1-ffwd-close-second", comparisons)
def ffwd_second(source: str, table: pd.DataFrame) -> Evidence | None:
    """FFWD ahead of every RNN, and nearer to DFFWD than to the best of them."""
    found = ahead(table, source, "learning", "all", ["FFWD"], GROUPS["RNNs"])
    if found is None:
        return None
    deep = pick(table, source, "learning", "all", ["DFFWD"], ["FFWD"]).iloc[0]
    over = pick(table, source, "learning", "all", ["FFWD"], GROUPS["RNNs"]).difference.min()
    near = abs(deep.difference) < over
    verdict = found.verdict
    if not near and verdict is Verdict.REPRODUCED:
        verdict = Verdict.DIRECTION
    sentence = f"{found.sentence} DFFWD less FFWD {difference(deep)}."
    return replace(found, verdict=verdict, sentence=sentence)


@both("5.5.1-esn-underperforms", entries, rows=whole(LEARNING_RUNS, "task != 'Ant'", least=2))
def esn_below(rows: pd.DataFrame) -> Said:
    """ESN less the mean of the other nets, by row, in shares; the ant's runs were cut short."""
    by = wide(rows, "value")
    by = by.div(by.max(axis=1), axis=0)
    gap = by.ESN - by.drop(columns="ESN").mean(axis=1)
    p = float(ttest_1samp(gap, 0).pvalue)
    rank = by.rank(axis=1, ascending=False).ESN.mean()
    most = 2 * (gap < 0).sum() > len(gap)
    return (
        graded(most and p < LEVEL, most),
        f"the ESN is below the mean of the other nets on {(gap < 0).sum()} of {len(gap)} rows (the "
        f"ant's, which were not completed, left out; p = {p:.2g} over rows), mean rank {rank:.1f} "
        f"of {len(NETS)}.",
    )


def _beside_the_hopper(source: str, table: pd.DataFrame) -> pd.DataFrame:
    """Flat rows, if the Hopper's is one; of ours, those of robots with its budget, net by net."""
    asked = table[table.trained_on == "flat"]
    if source == "ours":
        budget = asked.set_index("architecture")[["iterations", "batch_steps"]]
        hoppers = budget[(asked.task == "Hopper").to_numpy()].reindex(budget.index)
        same = (budget == hoppers).all(axis=1).to_numpy()
        asked = asked.assign(ours=asked.ours.where(same))
    rows = whole_rows(asked, source, LEARNING_RUNS)
    return rows if (rows.task == "Hopper").any() else rows.iloc[:0]


@both("5.5.1-hopper-hard", entries, rows=_beside_the_hopper)
def hopper_hard(rows: pd.DataFrame) -> Said:
    """Best FNN over best RNN, by robot on the flat; of ours, robots with the Hopper's budget."""
    hopper = rows[rows.task == "Hopper"]
    by = wide(rows, "value").droplevel("trained_on")
    ratio = by[list(GROUPS["FNNs"])].max(axis=1) / by[list(GROUPS["RNNs"])].max(axis=1)
    listed = ", ".join(f"{robot} {value:.2f}" for robot, value in ratio.items())
    verdict, p = Verdict.NOT_REPRODUCED, ""
    if ratio.idxmax() == "Hopper" and hopper.error.notna().all():
        test = best_against_best(hopper)
        sure = test.difference < 0 and test.p_value < LEVEL
        verdict = Verdict.REPRODUCED if sure else Verdict.DIRECTION
        p = f"; on the Hopper the two differ with p = {test.p_value:.2g}"
    return verdict, f"best FNN over best RNN on the flat: {listed}{p}."


_HOPPER = "trained_on == 'flat' and task == 'Hopper'"


@both("5.5.1-hopper-vanilla", entries, rows=whole(LEARNING_RUNS, _HOPPER))
def hopper_vanilla(rows: pd.DataFrame) -> Said:
    """CTRNN and DTRNN against ESN, GRU and LSTM on the flat hopper, by Welch."""
    by = rows.set_index("architecture")
    known = bool(by.error.notna().all())
    summaries = {net: summary(by.loc[net]) for net in GROUPS["RNNs"] if known}
    tests = [
        welch(summaries[vanilla], summaries[other])
        for vanilla in GROUPS["vanilla RNNs"]
        for other in ("ESN", "GRU", "LSTM")
        if known
    ]
    significant = [t.difference > 0 and t.p_value < LEVEL for t in tests]
    above = [t.difference > 0 for t in tests]
    verdict = graded(known and all(significant), known and all(above))
    listed = ", ".join(f"{net} {by.value[net]:.0f}" for net in GROUPS["RNNs"])
    sentence = (
        f"mean returns {listed}; {sum(significant)} of {len(tests)} differences between a vanilla "
        "and another net significant (Welch)."
    )
    return verdict, sentence


@both("table-5.2-bold", entries, rows=whole(LEARNING_RUNS))
def bold(rows: pd.DataFrame) -> Said:
    """Rows led by one net alone."""
    lead = wide(rows, "leads")
    leaders = lead.sum(axis=1)
    alone = leaders == 1
    some = leaders.between(1, len(NETS) - 1).sum()
    groups = "; ".join(
        f"{robot} {ground}: {', '.join(lead.columns[row])}"
        for (ground, robot), row in lead.iterrows()
        if 1 <= row.sum() <= 2
    )
    sentence = (
        f"one net is significantly better than all others on {alone.sum()} of {len(lead)} rows; "
        f"on {some} a leading group is better than some. Led by one or two: {groups or 'none'}."
    )
    return graded(alone.any(), some > 0), sentence


def _spread(cells: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Mean standard error and mean relative one by row, of RNNs and FNNs; incomplete runs out."""
    cells = cells[(cells.architecture != "ESN") | (cells.task != "Ant")]
    kind = cells.architecture.isin(GROUPS["FNNs"]).map({True: "FNNs", False: "RNNs"})
    rows = [cells.trained_on, cells.task, kind]
    absolute = cells.error.groupby(rows).mean().unstack()
    relative = (cells.error / cells.value).groupby(rows).mean().unstack()
    return absolute, relative


@both("5.5.2-rnn-vary", entries, rows=whole(LEARNING_RUNS, errors=True, least=2))
def rnn_vary(rows: pd.DataFrame) -> Said:
    """Standard errors over learning runs, RNNs against FNNs, rows in pairs."""
    listed, sure, larger = [], [], []
    for name, part in zip(("itself", "relation to the mean"), _spread(rows), strict=True):
        ratio = np.log(part.RNNs / part.FNNs)
        p = float(ttest_1samp(ratio, 0).pvalue)
        larger.append(ratio.mean() > 0)
        sure.append(ratio.mean() > 0 and p < LEVEL)
        listed.append(f"in {name} {np.exp(ratio.mean()):.2f} times that of FNNs (p = {p:.2g})")
    sentence = f"RNNs' standard error over learning runs is {' and '.join(listed)}."
    return graded(all(sure), any(larger)), sentence


@both("6.1-fnn-stable", entries, rows=whole(LEARNING_RUNS, errors=True))
def fnn_stable(rows: pd.DataFrame) -> Said:
    """Rows on which FNNs vary less between learning runs, as a share of their mean."""
    _, relative = _spread(rows)
    less = relative.FNNs < relative.RNNs
    p = float(binomtest(int(less.sum()), len(less)).pvalue)
    most = 2 * less.sum() > len(less)
    sentence = (
        f"FNNs' relative standard error is lower on {less.sum()} of {len(less)} rows (sign test "
        f"p = {p:.2g})."
    )
    return graded(most and p < LEVEL, most), sentence


@criterion("table-5.2-means", entries)
def means(table: pd.DataFrame) -> Finding:
    """Printed means against ours, where ours ran for as long and nothing was chosen by them."""
    deep = table[table.printed_budget & (table.seeds >= ENOUGH)]
    fitted = pd.MultiIndex.from_frame(deep[["task", "trained_on"]]).isin(CALIBRATED)
    missing = int((table.seeds == 0).sum())
    if missing == len(table):
        return Finding(Verdict.NOT_RUN, "No cell has been run yet.")
    told = [
        f"{len(deep)} of {len(table)} cells have {ENOUGH} seeds or more at the printed budget; "
        f"{missing} have not been run at all."
    ]
    for cells, where in (
        (deep[fitted], "by which settings were chosen"),
        (deep[~fitted], "by which none were"),
    ):
        if len(cells):
            inside = (cells.low <= cells.printed) & (cells.printed <= cells.high)
            total, p = combined(cells.p_printed)
            told.append(
                f"Of the {len(cells)} on rows {where} our 95% intervals over seeds hold the "
                f"printed mean of {inside.sum()}; all together chi-square {total:.1f} on "
                f"{len(cells)} degrees of freedom, p = {p:.2g}."
            )
    rest = deep[~fitted]
    if len(rest) < (len(table) - len(CALIBRATED) * len(NETS)) / 2:
        return Finding(Verdict.INCONCLUSIVE, " ".join(told))
    by_net = _ratios(rest)
    near = (by_net.ratio - 1).abs() + norm.ppf(1 - LEVEL) * by_net.error < NEAR
    apart = int((holm(rest.p_printed) < LEVEL).sum())
    listed = ", ".join(f"{r.Index} {r.ratio:.2f} ± {r.error:.2f}" for r in by_net.itertuples())
    told.append(
        f"Ours over the printed, mean over those rows with its standard error: {listed}; "
        f"{near.sum()} of {len(by_net)} shown to be within {NEAR:.0%} of 1. {apart} of {len(rest)} "
        "cells differ significantly (Welch, Holm)."
    )
    verdict = graded(near.all() and not apart, denied=apart, otherwise=Verdict.INCONCLUSIVE)
    return Finding(verdict, " ".join(told))


def _ratios(cells: pd.DataFrame) -> pd.DataFrame:
    """Our mean over the printed one, mean over rows with its standard error, by net."""
    ratio = cells.ours / cells.printed
    square = (cells.error / cells.printed) ** 2 + (ratio * cells.printed_error / cells.printed) ** 2
    by_net = ratio.groupby(cells.architecture).agg(["mean", "size"])
    error = square.groupby(cells.architecture).sum() ** 0.5 / by_net["size"]
    return pd.DataFrame({"ratio": by_net["mean"], "error": error})
