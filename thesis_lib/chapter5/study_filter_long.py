"""Study 1 (ours) at the printed length: who keeps what in correlated noise (section 5.5.2).

That CTRNNs keep more than DTRNNs in noise that is correlated in time was seen, and confirmed on
fresh seeds, after 12% of the printed steps (:mod:`~thesis_lib.chapter5.study_filter`).  Here are
policies of all nets trained for as long as the thesis's, tested 100 times by ``thesis
test-policies`` in noise with each ``--correlation-time``.  The criterion was written before any of
them had been tested so; that of the second look, with more seeds, before these were trained.
"""

from __future__ import annotations

from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.chapter5.cells import NETS
from thesis_lib.chapter5.contrasts import SMOKE, Config
from thesis_lib.chapter5.judging import difference
from thesis_lib.chapter5.networks import STYLES
from thesis_lib.chapter5.runs import DEFAULT, ENOUGH
from thesis_lib.chapter5.study_filter import CORRELATIONS, ROBOT, by_policy
from thesis_lib.edition.criteria import LEVEL, graded
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.words import several, with_interval
from thesis_lib.stats import Comparison, holm, mean_ci, welch

SLOW = CORRELATIONS[1:]
"""Correlation times of noise that is not white."""

LOOKS = 2
"""How often the criterion is asked of a growing number of seeds; each time at 5% over this."""


@dataclass(frozen=True)
class Kept:
    """What one policy trained for the printed length keeps of its return under noise."""

    architecture: str
    """Net."""
    correlation: float
    """Correlation time of the noise in control steps."""
    seed: int
    """Seed of its training."""
    base: float
    """Mean return of its regular test."""
    retained: float
    """Mean return under noise as a share of that."""


@experiment("ch5-correlated-noise-long", item="Study 1", smoke=SMOKE, book=Config(), seconds=0.1)
def kept(config: Config, context: Context) -> list[Kept]:
    """Shares of the return kept in noise of one variance by half-cheetahs trained in full."""
    tests = config.runs().in_full().tests
    tests = tests[
        (tests.task == ROBOT)
        & (tests.terrain == "flat")
        & (tests.variant == DEFAULT)
        & (tests.policy == "last")
        & (tests.intervention == "none")
    ]
    means = tests.groupby(["condition", "architecture", "seed", "correlation"])["return"].mean()
    rows = []
    for (condition, net, seed, correlation), value in means.items():
        base = float(means.get(("base", net, seed, 0.0), np.nan))
        if condition == "noise" and base > 0 and net.upper() in NETS:
            rows.append(Kept(net.upper(), correlation, seed, base, value / base))
    return rows


@criterion("ch5-correlated-noise-long", kept)
def keeps_more(table: pd.DataFrame) -> Finding:
    """CTRNNs against DTRNNs, in the mean over the correlation times above 0."""
    by = by_policy(table, "architecture", SLOW)
    if not {"CTRNN", "DTRNN"} <= set(by):
        return Finding(Verdict.NOT_RUN, "No policies of the printed length have been tested so.")
    seeds = min(len(by["CTRNN"]), len(by["DTRNN"]))
    if seeds < ENOUGH:
        return Finding(Verdict.INCONCLUSIVE, f"Only {seeds} seeds of a net have been tested so.")
    test = welch(by["CTRNN"], by["DTRNN"])
    sure = test.p_value < LEVEL / LOOKS
    rest = ", ".join(
        f"{net} {mean_ci(by[net]).mean:.2f} ± {mean_ci(by[net]).half_width:.2f}"
        for net in NETS
        if net in by
    )
    return Finding(
        graded(
            sure and test.difference > 0,
            denied=sure and test.difference < 0,
            otherwise=Verdict.INCONCLUSIVE,
        ),
        f"After the printed length of training CTRNNs keep, mean over the correlation times above "
        f"0, {difference(test)} more of their regular "
        f"return than DTRNNs (p = {test.p_value:.2g}, Welch, {seeds} seeds a net; below "
        f"{LEVEL / LOOKS:g} counts, as this is asked {LOOKS} times). Shares by net, 95%: {rest}.",
        {"difference": test.difference, "p": test.p_value},
    )


def lead(table: pd.DataFrame) -> dict[str, Comparison]:
    """CTRNNs' share less DTRNNs' in white and in the slowest noise, and how it changes; Welch."""
    wide = table.pivot_table(
        index=["architecture", "seed"], columns="correlation", values="retained"
    ).dropna()
    if 0 not in wide or len(wide.columns) < 2:
        return {}
    white, slow = wide[0], wide[max(wide)]
    found = {}
    for name, shares in (("white", white), ("slow", slow), ("change", slow - white)):
        by = {str(net): own.to_numpy() for net, own in shares.groupby("architecture")}
        ours, theirs = (by.get(net, np.empty(0)) for net in ("CTRNN", "DTRNN"))
        if min(len(ours), len(theirs)) < ENOUGH:
            return {}
        found[name] = welch(ours, theirs)
    return found


def reading(table: pd.DataFrame) -> str:
    """Whether the lead is that of a filter, and which nets are behind CTRNNs; looked at after.

    A first-order low pass weakens white noise most: were it what makes CTRNNs robust, their lead
    over DTRNNs would shrink as noise of the same variance becomes slow.
    """
    found = lead(table)
    if not found:
        return "Too few policies as long as the thesis's have been tested in such noise."
    told = {name: with_interval(t.difference, t.low, t.high, "+.2f") for name, t in found.items()}
    change = found["change"]
    if change.p_value >= LEVEL / LOOKS:
        so = "which way it goes these seeds do not tell"
    else:
        so = "it shrinks, as a filter's would" if change.difference < 0 else "no filter does that"
    by = by_policy(table, "architecture", SLOW)
    others = [net for net in NETS if net != "CTRNN" and len(by.get(net, ())) >= ENOUGH]
    tests = [welch(by["CTRNN"], by[net]) for net in others]
    adjusted = holm([test.p_value for test in tests])
    behind = [
        net
        for net, test, p in zip(others, tests, adjusted, strict=True)
        if p < LEVEL / LOOKS and test.difference > 0
    ]
    return (
        f"CTRNNs keep {told['white']} more than DTRNNs in white noise and {told['slow']} more in "
        f"noise correlated over {table.correlation.max():g} steps. From the one to the other their "
        f"lead changes by {told['change']}: {so}. In the mean over correlated noise CTRNNs are "
        f"significantly ahead of {several(behind) if behind else 'no net'} (Welch, after Holm's "
        f"correction over {len(others)} nets; p below {LEVEL / LOOKS:g} counts here too)."
    )


def draw(table: pd.DataFrame) -> Figure:
    """Mean share kept over the correlation time of the noise, a line a net, dots its seeds."""
    fig, ax = plt.subplots()
    times = sorted(table.correlation.unique())
    for net in NETS:
        colour, style = STYLES[net.lower()]
        own = table[table.architecture == net]
        place = own.correlation.map(times.index) + 0.05 * (NETS.index(net) - len(NETS) / 2)
        face = colour if style == "-" else "white"
        ax.plot(place, own.retained, "o", ms=2.5, color=colour, mfc=face, alpha=0.6)
        means = own.assign(place=place).groupby("correlation")[["place", "retained"]].mean()
        ax.plot(means.place, means.retained, style, color=colour, lw=1.4, label=net)
    ax.set_xticks(range(len(times)), [f"{time:g}" for time in times])
    ax.set(xlabel="correlation time of the noise, control steps", ylabel="share of the return kept")
    if len(table):
        handles = ax.get_legend_handles_labels()
        fig.legend(*handles, loc="outside upper center", ncols=7, fontsize=8, handlelength=1.6)
    return fig
