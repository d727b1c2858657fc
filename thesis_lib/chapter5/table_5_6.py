"""Table 5.6 (captioned Figure 5.6): what training on hills improves (section 5.5.2)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.stats import ttest_1samp

from thesis_lib import published
from thesis_lib.arrays import FloatArray
from thesis_lib.chapter5 import cells
from thesis_lib.chapter5.cells import GROUPS, NETS, ROBOTS, TESTED, Cells
from thesis_lib.chapter5.contrasts import SMOKE, Config
from thesis_lib.chapter5.judging import Evidence, Said, both, of_rows, together
from thesis_lib.edition.criteria import LEVEL, graded, judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Criterion, Finding, Verdict, criterion
from thesis_lib.edition.plots import COLOURS, PRINTED, legend_of
from thesis_lib.robustness import PERTURBATIONS, improvement, ratio_of_drops, retained

ROUNDING = 0.05
"""Bounds of a bootstrap of 1,000 resamples that differ by less count as the same."""

PRINTED_NAME = {"noise": "noise", "switch": "hill"}
"""How table 5.6 names the perturbations."""

RETAINED = "mean ratio of retained shares"
DROPS = "mean ratio of drops"


def _ratio_of_means(returns: FloatArray) -> FloatArray:
    """Ratio of the mean retained shares, hill-trained over flat-trained, ``(..., 2, nets)``."""
    kept = retained(returns).mean(axis=-2)
    ratio: FloatArray = kept[..., 1, :, :] / kept[..., 0, :, :]
    return ratio


FORMULAS: Mapping[str, Callable[[FloatArray], FloatArray]] = {
    RETAINED: lambda returns: improvement(returns).mean(axis=-2),
    DROPS: lambda returns: ratio_of_drops(returns).mean(axis=-2),
    "ratio of mean retained shares": _ratio_of_means,
}
"""What table 5.6 may have printed, from returns to shape ``(..., 2, nets)``."""

NONE = 0.25
"""How far from 1 an improvement ratio's interval may reach where there is no effect."""

ERROR_FACTORS = (1.0, 2.0)
"""What printed standard errors are multiplied by: 2 is a bootstrap over 5 runs, not 20."""


@dataclass(frozen=True)
class Ratio:
    """One improvement ratio with its interval."""

    source: str
    """Printed (rebuilt from tables C.1 to C.3) or ours."""
    perturbation: str
    """Noise or switch."""
    architecture: str
    """Net."""
    formula: str
    """How the ratio is formed."""
    error_factor: float
    """What the standard errors were multiplied by."""
    value: float
    """The ratio; above 1 a net keeps more if it was trained on hills."""
    low: float
    """2.5th percentile over resampled runs."""
    high: float
    """97.5th percentile."""
    printed_low: float
    """Printed 2.5th percentile."""
    printed_high: float
    """Printed 97.5th percentile."""
    least_robot: str
    """Robot on which it is least."""
    least: float
    """The ratio there."""
    p_tasks: float
    """Paired t-test over tasks that the logarithm of the ratio of retained shares is 0."""
    tasks: int
    """Robots with this net trained on both grounds."""
    units: int
    """Fewest runs behind it."""
    printed_budget: bool
    """Whether all learned for as many steps as the thesis's."""


@experiment("table-5.6", item="Table 5.6", smoke=SMOKE, book=Config(), seconds=1.2)
def ratios(config: Config, context: Context) -> list[Ratio]:
    """Improvement ratios by training on hills: printed bounds, rebuilt ones, and ours."""
    seeds = context.seeds(2)
    rows: list[Ratio] = []
    for factor in ERROR_FACTORS:
        # The same deviates for both: only the factor differs.
        rng = np.random.default_rng(seeds[0])
        made = cells.printed(tuple(TESTED.values()), rng, config.resamples, factor)
        for formula in FORMULAS:
            rows += _ratios(made, formula, factor)
    rng = np.random.default_rng(seeds[1])
    ours = cells.from_tests(config.runs(), rng, config.resamples)
    return [*rows, *_ratios(ours, RETAINED, 1.0)]


def _ratios(made: Cells, formula: str, factor: float) -> Iterator[Ratio]:
    published_by = published.load("table-5.6").set_index(["perturbation", "architecture"])
    by_robot = improvement(made.mean)
    for m, net in enumerate(NETS):
        there = np.isfinite(by_robot[:, :, m]).all(axis=0)
        if not there.any():
            continue
        mean = made.mean[..., there, m : m + 1]
        draws = made.draws[..., there, m : m + 1]
        value, drawn = FORMULAS[formula](mean), FORMULAS[formula](draws)
        units = int(made.units[:, there, m].min())
        for j, perturbation in enumerate(PERTURBATIONS):
            ratio = by_robot[j, there, m]
            robots = np.array(ROBOTS)[there]
            logs = np.log(ratio[ratio > 0])
            low, high = cells.interval(drawn[:, j, 0], units)
            bounds = published_by.loc[(PRINTED_NAME[perturbation], net)]
            yield Ratio(
                made.source,
                perturbation,
                net,
                formula,
                factor,
                value=float(value[j, 0]),
                low=low,
                high=high,
                printed_low=bounds.low,
                printed_high=bounds.high,
                least_robot=str(robots[ratio.argmin()]),
                least=float(ratio.min()),
                p_tasks=float(ttest_1samp(logs, 0).pvalue) if len(logs) > 2 else np.nan,
                tasks=int(there.sum()),
                units=units,
                printed_budget=bool(made.printed_budget[:, there, m].all()),
            )


def _nets(perturbation: str, group: str) -> Callable[[str, pd.DataFrame], pd.DataFrame]:
    """What finds the rows of a group's nets, none unless all are there, with their bounds."""

    def rows(source: str, table: pd.DataFrame) -> pd.DataFrame:
        at = (table.source == source) & (table.perturbation == perturbation)
        at &= (table.formula == RETAINED) & (table.error_factor == 1.0)
        rows = table[at].set_index("architecture").reindex(list(GROUPS[group]))
        if rows.value.isna().any():
            return rows.iloc[:0]
        if source == "printed":
            return rows.assign(low=rows.printed_low, high=rows.printed_high)
        return rows

    return rows


def _bounds(rows: pd.DataFrame) -> str:
    listed = ", ".join(f"{r.low:.2f} to {r.high:.2f} ({r.Index})" for r in rows.itertuples())
    where = "under noise" if (rows.perturbation == "noise").all() else "over the switch"
    told = f"{where} training on hills multiplies the share kept by {listed}"
    if rows.p_tasks.isna().all():
        return told
    few = rows.index[rows.p_tasks < LEVEL]
    return f"{told}; with tasks as the unit p < {LEVEL:g} for {' and '.join(few) or 'no net'}"


def improves(rows: pd.DataFrame) -> Verdict:
    """Whether hill training helps each net: intervals above 1."""
    return graded((rows.low > 1).all(), (rows.value > 1).all(), denied=(rows.high < 1).any())


def leaves(rows: pd.DataFrame) -> Verdict:
    """Whether hill training has no effect: intervals near 1; a loss is direction only."""
    return graded(
        ((rows.low > 1 - NONE) & (rows.high < 1 + NONE)).all(),
        (rows.high < 1).any(),
        denied=(rows.low > 1).any(),
        otherwise=Verdict.INCONCLUSIVE,
    )


def not_helped(rows: pd.DataFrame) -> Verdict:
    """Whether hill training helps no net: every interval below what counts as none."""
    return graded(
        (rows.high < 1 + NONE).all(),
        denied=(rows.low > 1).any(),
        otherwise=Verdict.INCONCLUSIVE,
    )


def _hills(claim: str, *parts: tuple[str, str, Callable[[pd.DataFrame], Verdict]]) -> Criterion:
    """The criterion of what hill training does: under a perturbation, to nets, judged so."""

    def judge(source: str, table: pd.DataFrame) -> Evidence | None:
        found = [(verdict, _nets(what, group)(source, table)) for what, group, verdict in parts]
        return together(
            [
                None if rows.empty else of_rows(rows, verdict(rows), f"{_bounds(rows)}.")
                for verdict, rows in found
            ]
        )

    return both(claim, ratios)(judge)


helps_rnns = _hills("5.5.2-hill-helps-rnns", ("noise", "RNNs", improves))
not_fnns = _hills("5.5.2-hill-not-fnns", ("noise", "FNNs", leaves))
on_switch = _hills("5.5.2-hill-on-switch", ("switch", "RNNs", improves), ("switch", "FNNs", leaves))
rnn_not_fnn_under_noise = _hills(
    "1.4-hill-rnn-not-fnn", ("noise", "RNNs", improves), ("noise", "FNNs", not_helped)
)
rnn_not_fnn = _hills(
    "6-hill-rnn-not-fnn",
    *(("noise", "RNNs", improves), ("noise", "FNNs", not_helped)),
    *(("switch", "RNNs", improves), ("switch", "FNNs", not_helped)),
)
helps_gated = _hills(
    "5.5.2-hill-helps-gated", ("noise", "gated RNNs", lambda rows: graded((rows.low > 1).all()))
)


@both("5.5.2-esn-improves-least", ratios, rows=_nets("noise", "RNNs"))
def esn_improves_least(rows: pd.DataFrame) -> Said:
    """The ESN's ratio under noise against the other RNNs'."""
    esn, others = rows.loc["ESN"], rows.drop(index="ESN")
    least = esn.value <= others.value.min()
    following = others.loc[others.value.idxmin()]
    return (
        graded(least and esn.high < others.low.min(), least),
        "under noise training on hills multiplies the share that the ESN keeps by "
        f"{esn.low:.2f} to {esn.high:.2f}, that of the next, the {following.name}, by "
        f"{following.low:.2f} to {following.high:.2f}.",
    )


@both("ch5-hill-every-robot", ratios, rows=_nets("switch", "RNNs"))
def helps_on_every_robot(rows: pd.DataFrame) -> Said:
    """The least ratio of each RNN under the switch, and the robot it is on."""
    worse = rows.least < 1
    listed = ", ".join(f"{r.Index} {r.least_robot} {r.least:.2f}" for r in rows.itertuples())
    return graded(not worse.any(), denied=worse.all()), f"the least ratio: {listed}."


@criterion("table-5.6-drops", ratios)
def ratio_of_the_drops(table: pd.DataFrame) -> Finding:
    """What the text of section 5.5.2 says that is printed."""
    return _printed_is(DROPS, table)


@criterion("table-5.6-retained", ratios)
def ratio_of_what_is_retained(table: pd.DataFrame) -> Finding:
    """What we take it for."""
    return _printed_is(RETAINED, table)


def _printed_is(what: str, table: pd.DataFrame) -> Finding:
    """Whether a formula lies inside all printed bounds.

    How many of these each formula meets is told as well, with standard errors as printed and
    doubled.
    """
    rows = table[table.source == "printed"].copy()
    near = ((rows.low - rows.printed_low).abs() < ROUNDING).astype(int)
    rows["met"] = near + ((rows.high - rows.printed_high).abs() < ROUNDING)
    rows["inside"] = (rows.printed_low <= rows.value) & (rows.value <= rows.printed_high)
    met = rows.groupby(["formula", "error_factor"]).met.sum()
    inside = rows[rows.error_factor == 1].groupby("formula").inside.sum()
    count = len(rows[(rows.formula == DROPS) & (rows.error_factor == 1)])
    listed = "; ".join(
        f"{formula}: {inside[formula]} of {count} centres inside the printed bounds, "
        f"{met[formula, 1.0]} of {2 * count} bounds met with the printed standard errors and "
        f"{met[formula, 2.0]} with twice these"
        for formula in FORMULAS
    )
    return judged(
        inside[what] == count,
        f"Rebuilt from tables C.1 to C.3: {listed} (within {ROUNDING:g}).",
        {"inside": float(inside[what])},
        otherwise=Verdict.REFUTED,
    )


def draw(table: pd.DataFrame) -> Figure:
    """Printed bounds of table 5.6, those rebuilt from the printed tables, and ours."""
    fig, axes = plt.subplots(1, 2, figsize=(7.2, 3.6), sharey=True)
    places = np.arange(len(NETS))
    rebuilt = table[(table.source == "printed") & (table.formula == RETAINED)]
    shown = {
        "printed": (rebuilt[rebuilt.error_factor == 1], "printed_low", "printed_high", PRINTED),
        "rebuilt": (rebuilt[rebuilt.error_factor == 2], "low", "high", COLOURS[0]),
        "ours": (table[table.source == "ours"], "low", "high", COLOURS[1]),
    }
    for ax, what in zip(axes, PERTURBATIONS, strict=True):
        for shift, (label, (rows, low, high, colour)) in zip(
            (-0.2, 0.0, 0.2), shown.items(), strict=True
        ):
            own = rows[rows.perturbation == what].set_index("architecture").reindex(list(NETS))
            ax.vlines(places + shift, own[low], own[high], color=colour, lw=4, label=label)
        ax.axhline(1, color="grey", lw=0.8)
        ax.set_xticks(places, NETS, rotation=45)
        ax.set_title(what)
    axes[0].set_ylabel("improvement ratio")
    legend_of(axes[0], 3, "upper right")
    return fig
