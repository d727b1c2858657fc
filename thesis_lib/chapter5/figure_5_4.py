"""Figure 5.4: robustness scores by quadrant (section 5.5.2), and what the text says of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.stats import ttest_1samp

from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.chapter5 import cells
from thesis_lib.chapter5.cells import GROUPS, NETS, ROBOTS, Cells
from thesis_lib.chapter5.contrasts import SMOKE, Config, comparisons
from thesis_lib.chapter5.judging import (
    Evidence,
    Said,
    ahead,
    both,
    difference,
    leads,
    of_source,
    pick,
    together,
)
from thesis_lib.chapter5.runs import ENOUGH
from thesis_lib.edition.criteria import LEVEL, graded
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Criterion, Verdict
from thesis_lib.edition.plots import COLOURS, legend_of
from thesis_lib.edition.words import with_interval
from thesis_lib.robustness import CONDITIONS, PERTURBATIONS, TRAINED_ON, quadrants, score
from thesis_lib.stats import friedman, iqm, stratified_bootstrap_ci

ALL = "all"
"""Stands for the mean over robots, or over nets."""

QUADRANTS = len(TRAINED_ON) * len(PERTURBATIONS)

MATCH = 0.1
"""Score by which a net may be shown to be at most behind another and match it."""


@dataclass(frozen=True)
class Score:
    """One robustness score with its interval."""

    source: str
    """Printed or ours."""
    trained_on: str
    """Flat or hill."""
    perturbation: str
    """Noise or switch."""
    task: str
    """Robot, or all for a statistic over robots."""
    architecture: str
    """Net, or all for a statistic over nets."""
    statistic: str
    """Mean; spread (standard deviation over nets of their mean scores); or iqm, the interquartile
    mean over seeds and robots."""
    value: float
    """Equation 5.4."""
    low: float
    """Lower end of the 95% bootstrap interval over runs (printed: test runs; ours: seeds)."""
    high: float
    """Upper end."""
    units: int
    """Fewest runs behind it."""
    printed_budget: bool
    """Whether its cells learned for as many steps as the thesis's."""


@experiment("figure-5.4", item="Figure 5.4", smoke=SMOKE, book=Config(), seconds=4)
def scores(config: Config, context: Context) -> list[Score]:
    """Robustness scores (equation 5.4) by quadrant, robot and net, printed and ours."""
    a, b, c = (np.random.default_rng(s) for s in context.seeds(3))
    n = config.resamples
    printed = cells.printed(tuple(cells.TESTED.values()), a, n)
    ours = cells.from_tests(config.runs(), b, n)
    return [*_scores(printed, c, n), *_scores(ours, c, n)]


def _scores(made: Cells, rng: np.random.Generator, n: int) -> Iterator[Score]:
    """Rows of one source."""
    mean, draws = quadrants(made.mean), quadrants(made.draws)
    for i, ground in enumerate(TRAINED_ON):
        for j, perturbation in enumerate(PERTURBATIONS):
            value, drawn = mean[i, j], draws[:, i, j]
            units, whole = made.units[i], made.printed_budget[i] == 1
            there = np.isfinite(value).all(axis=-1)
            if not there.any():
                continue
            at = (made.source, ground, perturbation)
            for k in np.flatnonzero(there):
                name, depth = ROBOTS[k], (units[k].min(), bool(whole[k].all()))
                for m, net in enumerate(NETS):
                    yield _row(at, name, net, "mean", value[k, m], drawn[:, k, m], depth)
                yield _row(at, name, ALL, "mean", value[k].mean(), drawn[:, k].mean(-1), depth)
            over, drawn = value[there].mean(0), drawn[:, there].mean(1)
            depth = (units[there].min(), bool(whole[there].all()))
            for m, net in enumerate(NETS):
                yield _row(at, ALL, net, "mean", over[m], drawn[:, m], depth)
                if made.runs and depth[0] >= ENOUGH:
                    by_seed = _by_seed(made, i, j, m, np.flatnonzero(there), depth[0])
                    interval = stratified_bootstrap_ci(
                        by_seed, statistic=iqm, rng=rng, n_resamples=n
                    )
                    yield Score(*at, ALL, net, "iqm", iqm(by_seed), *interval, *depth)
            spread = drawn.std(axis=-1, ddof=1)
            yield _row(at, ALL, ALL, "spread", over.std(ddof=1), spread, depth)


def _row(
    at: tuple[str, str, str],
    robot: str,
    net: str,
    statistic: str,
    value: float,
    draws: FloatArray,
    depth: tuple[int, bool],
) -> Score:
    interval = cells.interval(draws, depth[0])
    return Score(*at, robot, net, statistic, float(value), *interval, *depth)


def _by_seed(made: Cells, i: int, j: int, m: int, robots: IntArray, seeds: int) -> FloatArray:
    """Scores of one net, shape ``(seeds, robots)``; scaled by the best of the nets' means."""
    base, other = CONDITIONS.index("base"), CONDITIONS.index(PERTURBATIONS[j])
    best = np.maximum(made.mean[i, base], made.mean[i, other]).max(axis=-1)
    runs = [made.runs[i, int(k), m][:seeds] for k in robots]
    return np.stack(
        [score(r[:, base], r[:, other], best[k]) for r, k in zip(runs, robots, strict=True)],
        axis=1,
    )


def _by_net(source: str, table: pd.DataFrame) -> pd.DataFrame:
    """Scores of each net on each robot."""
    own = of_source(source, table)
    own = own[own.statistic == "mean"]
    return own[(own.task != ALL) & (own.architecture != ALL)]


# ------------------------------------------------------------------ sensor noise
noise_flat = leads(
    *("5.5.2-noise-flat", "robustness", "flat noise"),
    firsts=["CTRNN", "DFFWD"],
    seconds=["DTRNN", "ESN", "FFWD", "GRU", "LSTM"],
    tasks=True,
)
noise_hill = leads(
    *("5.5.2-noise-hill", "robustness", "hill noise"), firsts=["CTRNN"], seconds=NETS, tasks=True
)
deep_over_shallow = leads(
    *("5.5.2-deep-over-shallow", "robustness", "flat noise"), firsts=["DFFWD"], seconds=["FFWD"]
)
gated_poor = leads(
    *("5.5.2-gated-poor", "robustness", "flat noise"),
    firsts=["CTRNN", "DTRNN", "ESN", "DFFWD", "FFWD"],
    seconds=GROUPS["gated RNNs"],
)


@both("1.4-ctrnn-noise", comparisons)
def ctrnn_under_noise(source: str, table: pd.DataFrame) -> Evidence | None:
    """CTRNN against all others, trained on the flat and on hills."""
    parts = []
    for ground in TRAINED_ON:
        part = ahead(table, source, "robustness", f"{ground} noise", ["CTRNN"], NETS, tasks=True)
        sentence = f"trained on {ground}: {part.sentence}" if part else ""
        parts.append(replace(part, sentence=sentence) if part else None)
    return together(parts)


def _flat_noise(source: str, table: pd.DataFrame) -> pd.DataFrame:
    own = _by_net(source, table)
    return own[(own.trained_on == "flat") & (own.perturbation == "noise")]


@both("5.5.2-noise-no-best", scores, rows=_flat_noise)
def no_best_under_noise(rows: pd.DataFrame) -> Said:
    """Nets with the highest score on each task, flat-trained, under noise."""
    best = rows.loc[rows.groupby("task").value.idxmax()]
    listed = ", ".join(f"{r.task} {r.architecture}" for r in best.itertuples())
    several = best.architecture.nunique() > 1
    return graded(several, otherwise=Verdict.REFUTED), f"highest score: {listed}."


# ------------------------------------------------------------------ switch to hills
fnns_on_switch = leads(
    *("5.5.2-switch-flat-fnn", "robustness", "flat switch"),
    firsts=GROUPS["FNNs"],
    seconds=GROUPS["RNNs"],
)
fnns_and_ctrnn_on_switch = leads(
    *("5.5.2-switch-hill", "robustness", "hill switch"),
    firsts=GROUPS["FNNs and CTRNN"],
    seconds=GROUPS["other RNNs"],
    tasks=True,
)


def _on_switch(source: str, table: pd.DataFrame) -> pd.DataFrame:
    """Scores under the switch, if there are some of both grounds."""
    own = of_source(source, table)
    own = own[own.perturbation == "switch"]
    return own if own.trained_on.nunique() == len(TRAINED_ON) else own.iloc[:0]


@both("5.5.2-switch-less-distinct", scores, rows=_on_switch)
def less_distinct(rows: pd.DataFrame) -> Said:
    """Spread of the nets' mean scores under the switch, hill-trained against flat-trained."""
    spread = rows[rows.statistic == "spread"].set_index("trained_on")
    flat, hill = spread.loc["flat"], spread.loc["hill"]
    return (
        graded(hill.high < flat.low, hill.value < flat.value, denied=hill.low > flat.high),
        "standard deviation over nets of their mean scores: "
        f"{with_interval(hill.value, hill.low, hill.high, '.3f')} trained on hills, "
        f"{with_interval(flat.value, flat.low, flat.high, '.3f')} trained on the flat.",
    )


@both("6.1-ctrnn-matches", comparisons)
def ctrnn_matches(source: str, table: pd.DataFrame) -> Evidence | None:
    """CTRNN against the FNNs under the switch, before and after training on hills."""
    behind = ahead(table, source, "robustness", "flat switch", GROUPS["FNNs"], ["CTRNN"])
    level = pick(table, source, "robustness", "hill switch", ["CTRNN"], GROUPS["FNNs"])
    if behind is None or level.empty:
        return None
    overtaken = ((level.difference < 0) & (level.p_runs < LEVEL)).any()
    on_par = (level.low > -MATCH).all()
    verdict = graded(
        on_par and behind.verdict is Verdict.REPRODUCED,
        on_par and behind.verdict is Verdict.DIRECTION,
        denied=overtaken or behind.verdict is Verdict.REFUTED,
        otherwise=behind.verdict if on_par else Verdict.INCONCLUSIVE,
    )
    listed = ", ".join(f"{r.second} {difference(r)}" for _, r in level.iterrows())
    return Evidence(
        verdict,
        f"trained on the flat, {behind.sentence} Trained on hills, CTRNN less {listed}.",
        min(behind.units, int(level.units.min())),
        min(behind.tasks, int(level.tasks.min())),
        behind.printed_budget and bool(level.printed_budget.all()),
    )


# ------------------------------------------------------------------ all quadrants
most_robust = leads(
    *("1.4-most-robust", "robustness", "all"),
    firsts=GROUPS["FNNs and CTRNN"],
    seconds=GROUPS["other RNNs"],
)
significantly_robust = leads(
    *("5-significantly-robust", "robustness", "all"),
    firsts=GROUPS["FNNs and CTRNN"],
    seconds=GROUPS["other RNNs"],
    tasks=True,
)
ctrnn_well = leads(
    *("5.7-ctrnn-well", "robustness", "all"), firsts=["CTRNN"], seconds=GROUPS["other RNNs"]
)


@both("5.7-simple-robust", comparisons)
def simple_more_robust(source: str, table: pd.DataFrame) -> Evidence | None:
    """Vanilla RNNs and FNNs, each against each gated net, in every quadrant."""
    simple, gated = GROUPS["simple nets"], GROUPS["gated RNNs"]
    whole = ahead(table, source, "robustness", ALL, simple, gated)
    if whole is None:
        return None
    at = [f"{ground} {what}" for ground in TRAINED_ON for what in PERTURBATIONS]
    rows = pd.concat(pick(table, source, "robustness", where, simple, gated) for where in at)
    over = (rows.difference > 0).groupby(rows.quadrant).all()
    against = rows[(rows.difference < 0) & (rows.p_runs < LEVEL)]
    listed = "; ".join(
        f"{r.quadrant}, {r['first']} less {r.second} {difference(r)}" for _, r in against.iterrows()
    )
    verdict = whole.verdict
    if verdict is Verdict.REPRODUCED and not over.all():
        verdict = Verdict.DIRECTION
    sentence = (
        f"{whole.sentence} In {over.sum()} of {len(over)} quadrants every simple net is ahead of "
        f"both gated ones{'; against it: ' + listed if listed else ''}."
    )
    return replace(whole, verdict=verdict, sentence=sentence)


# ------------------------------------------------------------------ robots
def _extreme(claim: str, robot: str, *, highest: bool) -> Criterion:
    """The criterion that a robot's mean score is the highest, or lowest, quadrant by quadrant.

    Robots that lack one of the quadrants are not compared.
    """

    def rows(source: str, table: pd.DataFrame) -> pd.DataFrame:
        own = _by_net(source, table)
        whole = own.groupby("task").value.transform("size") == QUADRANTS * len(NETS)
        return own[whole] if robot in set(own.task[whole]) else own.iloc[:0]

    def judge(rows: pd.DataFrame) -> Said:
        by = rows.pivot_table("value", "task", ["trained_on", "perturbation"])
        first = by.idxmax() if highest else by.idxmin()
        count = int((first == robot).sum())
        listed = ", ".join(f"{ground} {what} {name}" for (ground, what), name in first.items())
        which = "highest" if highest else "lowest"
        verdict = graded(count == QUADRANTS, 2 * count > QUADRANTS)
        return verdict, f"the {which} mean score over nets: {listed}."

    return both(claim, scores, rows=rows)(judge)


cheetah_robust = _extreme("5.5.2-cheetah-robust", "HalfCheetah", highest=True)
hopper_worst = _extreme("5.5.2-hopper-worst", "Hopper", highest=False)


def _hill_trained(source: str, table: pd.DataFrame) -> pd.DataFrame:
    """Scores of nets but the ESN, trained on hills, if there are some of every robot."""
    own = _by_net(source, table)
    own = own[(own.trained_on == "hill") & (own.architecture != "ESN")]
    whole = own.groupby("perturbation").task.nunique() == len(ROBOTS)
    return own if whole.sum() == len(PERTURBATIONS) else own.iloc[:0]


@both("5.5.2-ant-hill", scores, rows=_hill_trained)
def ant_hill_robust(rows: pd.DataFrame) -> Said:
    """Hill-trained Ant against the mean of the robots, net by net, ESN left out as in the text."""
    listed, above, sure = [], [], []
    for what in PERTURBATIONS:
        by = rows[rows.perturbation == what].pivot(
            index="architecture", columns="task", values="value"
        )
        gap = by.Ant - by.mean(axis=1)
        p = float(ttest_1samp(gap, 0).pvalue)
        above.append(gap.mean() > 0)
        sure.append(gap.mean() > 0 and p < LEVEL)
        place = by.mean().rank(ascending=False).Ant
        listed.append(f"under {what} {place:.0f} of {len(ROBOTS)} (p = {p:.2g})")
    sentence = f"the hill-trained Ant ranks {' and '.join(listed)}, tested against the mean robot."
    return graded(all(sure), all(above)), sentence


def _of_three_robots(source: str, table: pd.DataFrame) -> pd.DataFrame:
    """Scores by net and robot, if there are some of three robots or more in every quadrant."""
    own = _by_net(source, table)
    many = own.groupby(["trained_on", "perturbation"]).task.nunique() > 2
    return own if many.sum() == QUADRANTS else own.iloc[:0]


@both("5.7-varies-across-tasks", scores, rows=_of_three_robots)
def varies_across_tasks(rows: pd.DataFrame) -> Said:
    """Friedman's test that robots rank alike, nets as blocks, in each quadrant."""
    p = {
        f"{ground} {what}": friedman(
            own.pivot(index="architecture", columns="task", values="value")
        )
        for (ground, what), own in rows.groupby(["trained_on", "perturbation"])
    }
    verdict = graded(max(p.values()) < LEVEL)
    listed = ", ".join(f"{quadrant} p = {value:.2g}" for quadrant, value in p.items())
    return verdict, f"scores differ between robots, nets as blocks: {listed}."


def draw(table: pd.DataFrame) -> Figure:
    """Figure 5.4: mean score by net in each quadrant, with the scores on each robot as dots.

    Left of each pair by the printed tables, right by our runs; of these, means over the robots
    that have been run, and no bar where no robot has all nets.

    Parameters
    ----------
    table
        Of :data:`scores`.
    """
    fig, axes = plt.subplots(2, 2, figsize=(7.2, 5.6), sharex=True, sharey=True)
    places = np.arange(len(NETS))
    for (i, what), (j, ground) in product(enumerate(PERTURBATIONS), enumerate(TRAINED_ON)):
        ax = axes[i, j]
        for shift, source, edge in ((-0.2, "printed", COLOURS[7]), (0.2, "ours", COLOURS[0])):
            own = of_source(source, table)
            own = own[(own.perturbation == what) & (own.trained_on == ground)]
            own = own[own.statistic == "mean"]
            bars = own[own.task == ALL].set_index("architecture").reindex(list(NETS))
            span = np.abs(bars[["low", "high"]].sub(bars.value, axis=0).to_numpy().T)
            ax.bar(places + shift, bars.value, 0.38, yerr=span, color=edge, alpha=0.3, label=source)
            for robot, colour in zip(ROBOTS, COLOURS[1:], strict=False):
                points = own[own.task == robot].set_index("architecture").value.reindex(list(NETS))
                label = robot if source == "printed" else None
                ax.plot(places + shift, points, "o", ms=3, color=colour, label=label)
        ax.set_title(f"trained on {ground}, {what}")
        ax.set_xticks(places, NETS, rotation=45, ha="right")
    fig.supylabel("robustness score")
    legend_of(axes[0, 0], 4)
    return fig
