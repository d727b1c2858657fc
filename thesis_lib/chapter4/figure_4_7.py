"""Figure 4.7: feature selection with function approximation on the heat domain, returns."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from thesis_lib.arrays import BoolArray
from thesis_lib.chapter4 import looks
from thesis_lib.chapter4.few_tasks import most_after_few
from thesis_lib.chapter4.heat_runs import BOOK, SMOKE, Config, by_noise, measure_heat
from thesis_lib.chapter4.looks import SYMBOLS
from thesis_lib.chapter4.protocol import (
    FEW,
    Protocol,
    Selected,
    ahead,
    behind,
    gains,
    summarise,
    wider,
)
from thesis_lib.chapter4.runs import Run
from thesis_lib.edition.criteria import judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.plots import COLOURS, PRINTED
from thesis_lib.edition.words import several
from thesis_lib.stats import least_power

MANY = 10
"""Smallest number of tasks that counts as many."""

MARGIN = 0.1
"""Returns within this share of that without selection count as on a par."""

DIP = (6, 40)
"""The early episodes after those that the left panel counts."""


@dataclass(frozen=True)
class HeatSelected(Selected):
    """One method after one number of observed tasks, over some episodes of a test task."""

    sensor: float
    """sigma_sensor; sigma_slip is .1."""
    panel: str
    """first episodes (left), by episode (right), or all followed, their total."""
    first_episode: int
    """First episode of a test task that counts, from 1."""
    last_episode: int
    """Last episode that counts."""
    mean_return: float
    """Mean total reward of these episodes of a test task, over runs."""


@experiment("figure-4.7", item="Figure 4.7", smoke=SMOKE, book=BOOK, thesis=Config(), seconds=48)
def by_episodes(config: Config, context: Context) -> list[HeatSelected]:
    """Feature selection on the heat domain: return of the first episodes, and by episode."""
    records = []
    for sensor in config.sensors:
        space, size = config.space.with_noise(sensor), config.protocol
        runs = measure_heat(config, space, context, test=True)
        spans = [("first episodes", 1, config.first)]
        records += _over_spans(sensor, spans, runs, size, config.truth)
        if sensor != config.followed_sensor or not config.followed:
            continue
        at = [j for j, n in enumerate(size.tasks_seen) if n in config.followed_at]
        part = runs.after(at)
        size = replace(size, tasks_seen=tuple(size.tasks_seen[j] for j in at))
        spans = [("by episode", *block) for block in blocks(config.followed)]
        spans = [("all followed", 1, config.followed), *spans]
        records += _over_spans(sensor, spans, part, size, config.truth)
    return records


def _over_spans(
    sensor: float, spans: list[tuple[str, int, int]], runs: Run, size: Protocol, truth: BoolArray
) -> list[HeatSelected]:
    """Rows on the total return of the episodes of some spans: panel, first and last episode."""
    records = []
    for panel, first, last in spans:
        total = replace(runs, returns=runs.returns[..., first - 1 : last].sum(axis=-1))
        head: dict[str, Any] = {"first_episode": first, "last_episode": last}
        records += [
            HeatSelected(sensor=sensor, panel=panel, **head, **fields)
            for fields in summarise(size, total, truth)
        ]
    return records


def blocks(last: int) -> list[tuple[int, int]]:
    """Blocks of episodes that widen in proportion, as pairs of first and last, from 1 on."""
    edges = np.unique(np.geomspace(1, last + 1, 18).round().astype(int)).tolist()
    return [(a, b - 1) for a, b in pairwise(edges)]


def _gains(table: pd.DataFrame, panel: str = "first episodes") -> pd.DataFrame:
    """FS-TEK's paired gain over no selection, by noise, tasks seen and episodes."""
    own = table[(table.method == "none") & (table.panel == panel)]
    return own.sort_values(["sensor", "tasks_seen", "first_episode"])


@criterion("4.3-heat-jump", by_episodes)
def jumps(table: pd.DataFrame) -> Finding:
    """FS-TEK against no selection over the first episodes, for few tasks, at each noise."""
    own = _gains(table)
    few = own[own.tasks_seen <= FEW]
    # Corrected for the numbers of tasks; that it is so at some noise, for the levels as well.
    size = few.groupby("sensor").size().max()
    sure, some = (
        (few.fstek_minus > few.fstek_minus_ci95 * wider(n)).groupby(few.sensor).any()
        for n in (size, len(few))
    )
    best = few.loc[few.groupby("sensor").fstek_minus.idxmax()]
    listed = "; ".join(
        f"{r.fstek_minus:+.0f} ± {r.fstek_minus_ci95:.0f} of {r.mean_return:.0f} after "
        f"{r.tasks_seen} tasks at noise {r.sensor:g}"
        for r in best.itertuples()
    )
    return judged(
        sure.all(),
        f"Largest paired gain over no selection for at most {FEW} tasks, in the return of the "
        f"first {own.last_episode.max()} episodes: {listed} (n = {own.n_runs.iloc[0]} runs).",
        dict(zip(map(str, best.sensor), best.fstek_minus, strict=True)),
        direction=some.any(),
        otherwise=Verdict.NOT_REPRODUCED
        if (few.fstek_minus + few.fstek_minus_ci95 < 0).all()
        else Verdict.INCONCLUSIVE,
    )


@criterion("4.3-heat-constant", by_episodes)
def constant_earns_less(table: pd.DataFrame) -> Finding:
    """A constant potential against FS-TEK and against no selection, for few tasks."""
    own = table[(table.method == "constant") & (table.panel == "first episodes")]
    own = own[own.tasks_seen <= FEW]
    beaten = ahead(own)
    return judged(
        beaten.mean() > 0.5,
        f"For at most {FEW} tasks the constant potential earns significantly less than no "
        f"selection in {ahead(own, 'none_minus').sum()} and less than FS-TEK in {beaten.sum()} of "
        f"{len(own)} comparisons.",
        {"share": float(beaten.mean())},
        otherwise=Verdict.REFUTED if behind(own).mean() > 0.5 else Verdict.INCONCLUSIVE,
    )


def _by_noise(table: pd.DataFrame) -> tuple[pd.DataFrame, str]:
    """FS-TEK's ``gain`` with its half-width ``half`` for few tasks by noise, and a sentence.

    Rows of one noise share runs, so their errors may be fully correlated: half-widths are
    averaged.
    """
    own = _gains(table)
    few = own[(own.tasks_seen <= FEW) & (own.tasks_seen > 3)].groupby("sensor")
    by = few[["fstek_minus", "fstek_minus_ci95", "mean_return"]].mean()
    by = by.set_axis(["gain", "half", "none"], axis=1)
    listed = several(
        f"{r.gain:+.0f} ± {r.half:.0f} at {r.Index:g} ({r.gain / abs(r.none):.0%})"
        for r in by.itertuples()
    )
    return by, (
        f"Mean paired gain after 4 to {FEW} tasks by sensor noise, in brackets as a share of the "
        f"return without selection: {listed}."
    )


def _more(high: pd.Series, low: pd.Series) -> bool:
    """Whether one gain is above another beyond both intervals."""
    return bool(high.gain - low.gain > np.hypot(high.half, low.half))


@criterion("4.3-heat-noise", by_episodes)
def grows_with_noise(table: pd.DataFrame) -> Finding:
    """Gain for few tasks at .02, and at the highest noise, against that at .01."""
    by, evidence = _by_noise(table)
    low, second, highest = by.iloc[0], by.iloc[min(1, len(by) - 1)], by.iloc[-1]
    opposite = _more(low, second)
    return judged(
        _more(second, low),
        evidence,
        {"low": float(low.gain), "second": float(second.gain), "highest": float(highest.gain)},
        direction=_more(highest, low) and not opposite,
        otherwise=Verdict.REFUTED if opposite else Verdict.INCONCLUSIVE,
    )


@criterion("4.3-heat-peak", by_episodes)
def peaks(table: pd.DataFrame) -> Finding:
    """Gain for few tasks above .02 against that at .02."""
    by, evidence = _by_noise(table)
    middle = by.iloc[min(1, len(by) - 1)]
    above = [row for _, row in by.iloc[2:].iterrows()] or [middle]
    opposite = any(_more(row, middle) for row in above)
    return judged(
        all(_more(middle, row) for row in above),
        evidence,
        {"middle": float(middle.gain), "above": max(float(row.gain) for row in above)},
        direction=all(row.gain < middle.gain for row in above) and not opposite,
        otherwise=Verdict.REFUTED if opposite else Verdict.INCONCLUSIVE,
    )


@criterion("4.3-heat-par", by_episodes)
def on_a_par(table: pd.DataFrame) -> Finding:
    """FS-TEK against no selection for many tasks, with a margin."""
    own = _gains(table)
    at = own[own.tasks_seen >= min(MANY, own.tasks_seen.max())]
    gap, half, margin = at.fstek_minus.abs(), at.fstek_minus_ci95, MARGIN * at.mean_return.abs()
    near, far = gap + half < margin, gap - half * wider(len(at)) > margin
    worst = at.loc[(at.fstek_minus / at.mean_return).abs().idxmax()]
    return judged(
        near.all(),
        f"After {at.tasks_seen.min()} tasks and more the paired 95% interval lies within "
        f"{MARGIN:.0%} of the return without selection in {near.sum()} of {len(at)} "
        f"combinations, and without any difference each would lie so in at least "
        f"{least_power(margin, half):.0%} of samples; the largest gap is "
        f"{worst.fstek_minus:+.0f} ± "
        f"{worst.fstek_minus_ci95:.0f} of {worst.mean_return:.0f}, after {worst.tasks_seen} tasks "
        f"at noise {worst.sensor:g}.",
        {"near": float(near.mean())},
        otherwise=Verdict.REFUTED if far.any() else Verdict.INCONCLUSIVE,
    )


def _early(table: pd.DataFrame, method: str) -> pd.DataFrame:
    """A method's ``gain`` an episode over no selection in early episodes, by tasks seen."""
    own = table[(table.method == method) & (table.panel == "by episode")]
    own = own[(own.first_episode >= DIP[0]) & (own.last_episode <= DIP[1])]
    # Blocks of one run may be fully correlated, so half-widths add up.
    by = own.assign(length=own.last_episode - own.first_episode + 1).groupby("tasks_seen")
    total = by[["none_minus", "none_minus_ci95", "length"]].sum()
    gain, half = -total.none_minus / total.length, total.none_minus_ci95 / total.length
    cell = gain.map("{:+.1f}".format) + " ± " + half.map("{:.1f}".format)
    return pd.DataFrame({"gain": gain, "half": half, "cell": cell})


def _loses(early: pd.DataFrame) -> bool:
    """Whether a gain of :func:`_early` is below 0 at some number of tasks, corrected for them."""
    return bool((early.gain + early.half * wider(len(early)) < 0).any())


@criterion("4.3-heat-dip", by_episodes)
def dips(table: pd.DataFrame) -> Finding:
    """Gain in early episodes by number of tasks, at the noise of the right panel."""
    own, fixed = _early(table, "fs-tek"), _early(table, "fixed")
    first, last = own.iloc[0], own.iloc[-1]
    falls = first.gain - last.gain > np.hypot(first.half, last.half)
    listed, ends = (
        several(f"{r.cell} after {r.Index}" for r in rows.itertuples())
        for rows in (own, fixed.loc[[fixed.index.min(), fixed.index.max()]])
    )
    return judged(
        last.gain + last.half < 0 and falls,
        f"FS-TEK's paired gain an episode in early episodes (from {DIP[0]} to at most {DIP[1]}): "
        f"{listed} tasks. A potential that removes no feature has no dip. Heat and action alone "
        f"gain {ends} tasks.",
        dict(zip(map(str, own.index), own.gain, strict=True)),
        direction=_loses(own),
        otherwise=Verdict.NOT_REPRODUCED if last.gain > last.half else Verdict.INCONCLUSIVE,
    )


@criterion("4.3-heat-total", by_episodes)
def pays_in_the_end(table: pd.DataFrame) -> Finding:
    """FS-TEK's and fixed features' gain over all episodes followed."""
    own = table[table.panel == "all followed"]
    listed = {
        method: several(
            f"{-r.none_minus:+.0f} ± {r.none_minus_ci95:.0f} after {r.tasks_seen}"
            for r in own[own.method == method].itertuples()
        )
        for method in ("fs-tek", "fixed", "jackknife")
    }
    at = own[own.method == "fs-tek"]
    # Corrected for the numbers of tasks, of which any will do.
    half = at.none_minus_ci95 * wider(len(at))
    better, worse = (-at.none_minus > half).any(), (at.none_minus > half).any()
    return judged(
        better and not worse,
        f"Total of {own.last_episode.max()} episodes, paired gain over no selection: FS-TEK "
        f"{listed['fs-tek']} tasks; heat and action alone {listed['fixed']}; jackknife F "
        f"{listed['jackknife']}.",
        dict(zip(map(str, at.tasks_seen), -at.none_minus, strict=True)),
        direction=better,
        otherwise=Verdict.NOT_REPRODUCED if worse else Verdict.INCONCLUSIVE,
    )


@criterion("4.3-heat-overcome", by_episodes)
def is_overcome(table: pd.DataFrame) -> Finding:
    """FS-TEK's loss in the last of the episodes followed, if there was one in early episodes."""
    early, own = _early(table, "fs-tek"), _gains(table, "by episode")
    late = own[own.last_episode == own.last_episode.max()].set_index("tasks_seen")
    length = late.last_episode - late.first_episode + 1
    gain, half = late.fstek_minus / length, late.fstek_minus_ci95 / length
    earned = late.mean_return / length
    margin, lost = 0.05 * earned.abs(), _loses(early)
    listed = several(
        f"{g:+.2f} ± {h:.2f} after {n}" for n, g, h in zip(late.index, gain, half, strict=True)
    )
    worst = early.gain.idxmin()
    return judged(
        lost and (gain - half > -margin).all(),
        f"FS-TEK's paired gain an episode is least, {early.cell[worst]}, after {worst} tasks in "
        f"episodes from {DIP[0]} to at most {DIP[1]}, "
        f"{'' if lost else 'not '}significantly below 0 (corrected for the choice). In episodes "
        f"{late.first_episode.min()} to {late.last_episode.max()} it is {listed} tasks, where "
        f"without selection an episode earns {earned.mean():.1f}.",
        dict(zip(map(str, late.index), gain, strict=True)),
        otherwise=Verdict.REFUTED
        if (gain + half * wider(len(late)) < -margin).any()
        else Verdict.INCONCLUSIVE,
    )


@criterion("4.3.1-few-tasks-heat", by_episodes)
def helps_most_when_few(table: pd.DataFrame) -> Finding:
    """Number of tasks at which FS-TEK gains most, by noise."""
    own = table[table.panel == "first episodes"]
    by = {sensor: gains(at).sort_index() for sensor, at in own.groupby("sensor")}
    verdict, best, fall, rise = most_after_few(by)
    return Finding(
        verdict,
        "On the heat domain FS-TEK gains most over no selection after "
        f"{several(f'{n} (noise {sensor:g})' for sensor, n in best.items())} tasks; significantly "
        f"more than after {own.tasks_seen.max()} at {fall or 'none'} of the {len(best)} "
        "levels of noise (corrected for the choice of the most), and significantly "
        f"more after some number above {FEW} than after each up to it at {rise or 'none'}.",
        {f"{sensor:g}": n for sensor, n in best.items()},
    )


def figure(table: pd.DataFrame) -> Figure:
    """FS-TEK's gain over no selection: first episodes by noise, and episode by episode."""
    own = table[table.method == "none"]
    left, right = own[own.panel == "first episodes"], own[own.panel == "by episode"]
    fig, axes = plt.subplots(1, 2, figsize=(7.2, 3.8))
    for i, (sensor, at) in enumerate(left.groupby("sensor")):
        label = rf"$\sigma_{{sensor}}$ = {sensor:g}"
        look: dict[str, Any] = {
            "color": COLOURS[i],
            "marker": "o",
            "ms": 3,
            "capsize": 2,
            "lw": 1.2,
        }
        x = at.tasks_seen + 0.06 * (i - 1.5)
        axes[0].errorbar(x, at.fstek_minus, yerr=at.fstek_minus_ci95, label=label, **look)
    last = left.last_episode.max()
    axes[0].set(xlabel="tasks seen", ylabel=f"gain in the first {last} episodes [reward]")
    _over_episodes(axes[1], right, "fstek_minus", 1)
    for ax in axes:
        ax.axhline(0, color=PRINTED, lw=0.8)
        ax.legend(fontsize=7, ncols=2 if ax is axes[1] else 1)
    return fig


def episodes_figure(table: pd.DataFrame, methods: tuple[str, ...]) -> Figure:
    """Gain over no selection episode by episode, one panel a method."""
    own = table[table.panel == "by episode"]
    fig, axes = plt.subplots(1, len(methods), figsize=(7.2, 3.6), sharey=True, squeeze=False)
    for ax, method in zip(axes[0], methods, strict=True):
        _over_episodes(ax, own[own.method == method], "none_minus", -1)
        ax.axhline(0, color=PRINTED, lw=0.8)
        ax.set_title(SYMBOLS[method])
    for ax in axes[0, 1:]:
        ax.set_ylabel("")
    axes[0, 0].legend(fontsize=7, ncols=2)
    return fig


def _over_episodes(ax: Axes, rows: pd.DataFrame, gap: str, sign: int) -> None:
    """Gain an episode over blocks of episodes, one line a number of tasks."""
    grid = sorted(rows.tasks_seen.unique())
    for i, n in enumerate(grid):
        at = rows[rows.tasks_seen == n].sort_values("first_episode")
        length = at.last_episode - at.first_episode + 1
        middle, mean = (at.first_episode + at.last_episode) / 2, sign * at[gap] / length
        half = at[f"{gap}_ci95"] / length
        colour = plt.get_cmap("viridis")(0.9 * i / max(len(grid) - 1, 1))
        ax.plot(middle, mean, "o-", ms=2.5, color=colour, lw=1.2, label=f"{n} tasks")
        ax.fill_between(middle, mean - half, mean + half, color=colour, alpha=0.15, lw=0)
    ax.set(xlabel="episode", ylabel="gain an episode [reward]", xscale="log")
    ax.set_yscale("symlog", linthresh=10.0)


def methods_figure(table: pd.DataFrame) -> Figure:
    """Return of the first episodes for all methods, one panel a level of noise."""
    own = table[table.panel == "first episodes"]
    fig, axes = by_noise(own, looks.returns, height=5.6, legend_columns=4)
    for ax in axes[:, 0]:
        ax.set_ylabel("return, first episodes")
    return fig
