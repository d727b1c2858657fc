"""Claims of section 4.3 on the heat domain, and the readings chosen there."""

from __future__ import annotations

import numpy as np
import pandas as pd

from thesis_lib.claims import Claim, Difference, Finding, Tables, Verdict
from thesis_lib.domains.heat import LAYOUTS, HeatWorld

FEW = 6
"""Largest number of tasks that counts as few."""

MANY = 10
"""Smallest number of tasks that counts as many."""

MARGIN = 0.1
"""Returns within this share of that without selection count as on a par."""

DIP = (6, 40)
"""The early episodes after those that the left panel counts."""


def _gains(table: pd.DataFrame, panel: str = "first episodes") -> pd.DataFrame:
    """FS-TEK's paired gain over no selection, by noise, tasks seen and episodes."""
    own = table[(table.method == "none") & (table.panel == panel)]
    return own.sort_values(["sensor", "tasks_seen", "first_episode"])


def _pooled(own: pd.DataFrame) -> tuple[float, float]:
    """Mean gain over some rows, and a bound on its 95% half-width.

    Rows share runs, so their errors may be fully correlated: half-widths are averaged.
    """
    return float(own.fstek_minus.mean()), float(own.fstek_minus_ci95.mean())


def reward(tables: Tables) -> Finding:
    """The reward of a step by its formula."""
    value = HeatWorld().step_reward
    return Finding(
        Verdict.REPRODUCED if round(value, 2) == -0.71 else Verdict.REFUTED,
        f"-10 over the diagonal of the area is {value:.4f}.",
    )


def features(tables: Tables) -> Finding:
    """Whether a product grid with four tilings has 1664 tiles."""
    found = {}
    for name, intervals in LAYOUTS.items():
        coding = HeatWorld().coding(intervals)
        found[name] = (coding.n_features, coding.tilings, coding.tiles)
    told = "; ".join(
        f"{t} tilings of {' x '.join(map(str, tiles))} (x, y, heading, heat) give {n}"
        for n, t, tiles in found.values()
    )
    return Finding(
        Verdict.REPRODUCED if all(n == 1664 for n, *_ in found.values()) else Verdict.REFUTED,
        f"{told}, with one weight for each feature and action; the text does not say which.",
    )


def information(tables: Tables) -> Finding:
    """Domain relevance of position and heading together, as a share."""
    table = tables["section-4.3-heat"]
    own = table[table.removed == "x, y, heading"]
    low = float((own.share - own.share_ci95).min())
    told = ", ".join(
        f"{r.share:.1%} ± {r.share_ci95:.1%} at {r.sensor:g}" for r in own.itertuples()
    )
    evidence = (
        f"Share of the domain relevance of all features that goes with x, y and heading: {told} "
        f"({int(own.n_tasks.iloc[0])} tasks each)."
    )
    if low > 0:
        small = float(own.share.max()) <= 0.1
        return Finding(Verdict.REPRODUCED if small else Verdict.DIRECTION, evidence)
    return Finding(Verdict.NOT_REPRODUCED, evidence)


def jump(tables: Tables) -> Finding:
    """FS-TEK against no selection over the first episodes, for few tasks, at each noise."""
    own = _gains(tables["figure-4.7"])
    few = own[own.tasks_seen <= FEW]
    told, sure = [], []
    for sensor, at in few.groupby("sensor"):
        # Bonferroni over up to four numbers of tasks, on normal quantiles.
        safe = at.fstek_minus - at.fstek_minus_ci95 * 2.5 / 1.96
        best = at.loc[at.fstek_minus.idxmax()]
        sure.append(bool((safe > 0).any()))
        told.append(
            f"{best.fstek_minus:+.0f} ± {best.fstek_minus_ci95:.0f} of {best.mean_return:.0f} "
            f"after {int(best.tasks_seen)} tasks at {sensor:g}"
        )
    evidence = (
        f"Largest paired gain over no selection for at most {FEW} tasks, in the return of the "
        f"first {int(own.last_episode.max())} episodes: {'; '.join(told)} (n = "
        f"{int(own.n_runs.iloc[0])} runs)."
    )
    if all(sure):
        return Finding(Verdict.REPRODUCED, evidence)
    return Finding(Verdict.DIRECTION if any(sure) else Verdict.NOT_REPRODUCED, evidence)


def control(tables: Tables) -> Finding:
    """A constant potential against FS-TEK and against no selection, for few tasks."""
    table = tables["figure-4.7"]
    own = table[(table.method == "constant") & (table.panel == "first episodes")]
    own = own[own.tasks_seen <= FEW]
    behind = own.none_minus - own.none_minus_ci95 > 0
    beaten = own.fstek_minus - own.fstek_minus_ci95 > 0
    evidence = (
        f"For at most {FEW} tasks the constant potential earns significantly less than no "
        f"selection in {int(behind.sum())} and less than FS-TEK in {int(beaten.sum())} of "
        f"{len(own)} comparisons."
    )
    return Finding(Verdict.REPRODUCED if beaten.mean() > 0.5 else Verdict.NOT_REPRODUCED, evidence)


def _by_noise(tables: Tables) -> tuple[list[float], dict[float, tuple[float, float]], str]:
    own = _gains(tables["figure-4.7"])
    few = own[(own.tasks_seen <= FEW) & (own.tasks_seen > 3)]
    by = {float(str(s)): _pooled(at) for s, at in few.groupby("sensor")}
    plain = few.groupby("sensor").mean_return.mean()
    told = ", ".join(
        f"{m:+.0f} ± {h:.0f} at {s:g} ({m / abs(plain[s]):.0%} of the return without selection)"
        for s, (m, h) in by.items()
    )
    return sorted(by), by, f"Mean paired gain after 4 to {FEW} tasks by sensor noise: {told}."


def _more(high: tuple[float, float], low: tuple[float, float]) -> bool:
    """Whether one gain is above another beyond both intervals."""
    return high[0] - low[0] > float(np.hypot(high[1], low[1]))


def grows_with_noise(tables: Tables) -> Finding:
    """Gain for few tasks at .02, and at the highest noise, against that at .01."""
    levels, by, told = _by_noise(tables)
    low, second, highest = by[levels[0]], by[levels[min(1, len(levels) - 1)]], by[levels[-1]]
    if _more(second, low):
        return Finding(Verdict.REPRODUCED, told)
    if _more(low, second):
        return Finding(Verdict.REFUTED, told)
    return Finding(Verdict.DIRECTION if _more(highest, low) else Verdict.NOT_REPRODUCED, told)


def peaks(tables: Tables) -> Finding:
    """Gain for few tasks above .02 against that at .02."""
    levels, by, told = _by_noise(tables)
    middle = by[levels[min(1, len(levels) - 1)]]
    above = [by[s] for s in levels[2:]] or [middle]
    if all(_more(middle, one) for one in above):
        return Finding(Verdict.REPRODUCED, told)
    if any(_more(one, middle) for one in above):
        return Finding(Verdict.REFUTED, told)
    below = all(one[0] < middle[0] for one in above)
    return Finding(Verdict.DIRECTION if below else Verdict.NOT_REPRODUCED, told)


def on_a_par(tables: Tables) -> Finding:
    """FS-TEK against no selection for many tasks, with a margin."""
    own = _gains(tables["figure-4.7"])
    at = own[own.tasks_seen >= min(MANY, int(own.tasks_seen.max()))]
    reach = at.fstek_minus.abs() + at.fstek_minus_ci95
    near = reach < MARGIN * at.mean_return.abs()
    worst = at.loc[(at.fstek_minus / at.mean_return).abs().idxmax()]
    evidence = (
        f"After {int(at.tasks_seen.min())} tasks and more the paired 95% interval lies within "
        f"{MARGIN:.0%} of the return without selection in {int(near.sum())} of {len(at)} "
        f"combinations; the largest gap is {worst.fstek_minus:+.0f} ± "
        f"{worst.fstek_minus_ci95:.0f} of {worst.mean_return:.0f}, after "
        f"{int(worst.tasks_seen)} tasks at {worst.sensor:g}."
    )
    if near.all():
        return Finding(Verdict.REPRODUCED, evidence)
    sure = at.fstek_minus.abs() - at.fstek_minus_ci95 > MARGIN * at.mean_return.abs()
    return Finding(Verdict.REFUTED if sure.mean() > 0.5 else Verdict.NOT_REPRODUCED, evidence)


def false_positives(tables: Tables) -> Finding:
    """FS-TEK's false positive rate over the levels of noise, mean over the numbers of tasks."""
    table = tables["figure-4.8"]
    own = table[(table.method == "fs-tek") & (table.tasks_seen > 3)]
    by = own.groupby("sensor")[["fpr", "fpr_ci95"]].mean()
    told = ", ".join(f"{r.fpr:.2f} ± {r.fpr_ci95:.2f} at {s:g}" for s, r in by.iterrows())
    kept = own.groupby("sensor")[["keeps_x", "keeps_y", "keeps_heading"]].mean().iloc[[0, -1]]
    first, last = by.iloc[0], by.iloc[-1]
    gap = float(last.fpr - first.fpr)
    half = float(np.hypot(first.fpr_ci95, last.fpr_ci95))
    evidence = (
        f"Mean false positive rate from 4 tasks on: {told}. At the lowest and the highest noise "
        f"it keeps x in {kept.keeps_x.iloc[0]:.0%} and {kept.keeps_x.iloc[1]:.0%}, y in "
        f"{kept.keeps_y.iloc[0]:.0%} and {kept.keeps_y.iloc[1]:.0%}, heading in "
        f"{kept.keeps_heading.iloc[0]:.0%} and {kept.keeps_heading.iloc[1]:.0%}."
    )
    if gap - half > 0:
        return Finding(Verdict.REPRODUCED, evidence)
    if gap + half < 0:
        return Finding(Verdict.REFUTED, evidence)
    return Finding(Verdict.DIRECTION if gap > 0 else Verdict.NOT_REPRODUCED, evidence)


def _early(table: pd.DataFrame, method: str) -> dict[int, tuple[float, float]]:
    """A method's gain an episode over no selection in the early episodes, by tasks seen."""
    own = table[(table.method == method) & (table.panel == "by episode")]
    own = own[(own.first_episode >= DIP[0]) & (own.last_episode <= DIP[1])]
    by = {}
    for n, at in own.groupby("tasks_seen"):
        length = float((at.last_episode - at.first_episode + 1).sum())
        # Blocks of one run may be fully correlated, so half-widths add up.
        gain, half = -float(at.none_minus.sum()), float(at.none_minus_ci95.sum())
        by[int(str(n))] = gain / length, half / length
    return by


def dip(tables: Tables) -> Finding:
    """Gain in early episodes by number of tasks, at the noise of the right panel."""
    table = tables["figure-4.7"]
    by, fixed = _early(table, "fs-tek"), _early(table, "fixed")
    told = ", ".join(f"{m:+.1f} ± {h:.1f} after {n}" for n, (m, h) in by.items())
    ends = " and ".join(
        f"{fixed[n][0]:+.1f} ± {fixed[n][1]:.1f} after {n}" for n in (min(fixed), max(fixed))
    )
    evidence = (
        f"FS-TEK's paired gain an episode in early episodes (from {DIP[0]} to at most {DIP[1]}): "
        f"{told} tasks. Where it removes nothing there is nothing to dip. Heat and action alone "
        f"gain {ends} tasks."
    )
    dips = [n for n, (m, h) in by.items() if m + h < 0]
    if dips and max(dips) == max(by):
        return Finding(Verdict.REPRODUCED, evidence)
    if dips:
        return Finding(Verdict.DIRECTION, evidence)
    return Finding(Verdict.NOT_REPRODUCED, evidence)


def whole(tables: Tables) -> Finding:
    """FS-TEK's and fixed features' gain over all episodes followed."""
    table = tables["figure-4.7"]
    own = table[table.panel == "all followed"]
    last = int(own.last_episode.max())
    told = {}
    for method in ("fs-tek", "fixed", "jackknife"):
        at = own[own.method == method]
        told[method] = ", ".join(
            f"{-r.none_minus:+.0f} ± {r.none_minus_ci95:.0f} after {r.tasks_seen}"
            for r in at.itertuples()
        )
    at = own[own.method == "fs-tek"]
    better = bool((at.none_minus + at.none_minus_ci95 < 0).any())
    worse = bool((at.none_minus - at.none_minus_ci95 > 0).any())
    evidence = (
        f"Total of {last} episodes, paired gain over no selection: FS-TEK {told['fs-tek']} tasks; "
        f"heat and action alone {told['fixed']}; jackknife F {told['jackknife']}."
    )
    if better and not worse:
        return Finding(Verdict.REPRODUCED, evidence)
    return Finding(Verdict.DIRECTION if better else Verdict.NOT_REPRODUCED, evidence)


def overcome(tables: Tables) -> Finding:
    """FS-TEK's gain in the last of the episodes followed."""
    own = _gains(tables["figure-4.7"], "by episode")
    late = own[own.last_episode == own.last_episode.max()]
    length = late.last_episode - late.first_episode + 1
    near = (late.fstek_minus.abs() < 0.05 * late.mean_return.abs()).all()
    told = ", ".join(
        f"{g:+.2f} after {n}"
        for n, g in zip(late.tasks_seen, late.fstek_minus / length, strict=True)
    )
    return Finding(
        Verdict.REPRODUCED if near else Verdict.NOT_REPRODUCED,
        f"Mean paired gain an episode in episodes {int(late.first_episode.min())} to "
        f"{int(late.last_episode.max())}: {told} tasks, of "
        f"{float((late.mean_return / length).mean()):.1f}.",
    )


def few_tasks(tables: Tables) -> Finding:
    """Number of tasks at which FS-TEK gains most, by noise."""
    own = _gains(tables["figure-4.7"])
    best = {s: int(at.loc[at.fstek_minus.idxmax()].tasks_seen) for s, at in own.groupby("sensor")}
    told = ", ".join(f"{n} at {s:g}" for s, n in best.items())
    return Finding(
        Verdict.REPRODUCED if max(best.values()) <= FEW else Verdict.NOT_REPRODUCED,
        f"On the heat domain FS-TEK gains most over no selection after this many tasks: {told}.",
    )


CLAIMS: tuple[Claim, ...] = (
    Claim(
        "4.3-heat-reward",
        "4.3",
        "The reward of a step on the heat domain is -10 over the area's diagonal, -0.71.",
        (),
        "Equal when rounded.",
        reward,
    ),
    Claim(
        "4.3-heat-features",
        "4.3",
        "Four overlapping tilings, coded jointly, give 1664 features.",
        (),
        "A product grid over x, y, heading and heat that gives this number exists.",
        features,
    ),
    Claim(
        "4.3-heat-jump",
        "4.3",
        "On the heat domain FS-TEK brings a significant jump over the initial episodes for few "
        "tasks (Figure 4.7, left).",
        ("figure-4.7",),
        "At every noise level the paired gain over no selection in the first five episodes is "
        "above 0 at some number of tasks up to six (95%, Bonferroni).",
        jump,
        headline=True,
    ),
    Claim(
        "4.3-heat-constant",
        "4.3",
        "That jump comes from the features that FS-TEK keeps (implied; the control is ours).",
        ("figure-4.7",),
        "For few tasks a constant potential earns significantly less than FS-TEK in more than half "
        "of the comparisons.",
        control,
    ),
    Claim(
        "4.3-heat-noise",
        "4.3",
        "The benefit increases to some extent with the noise level (the chapter's hypothesis).",
        ("figure-4.7",),
        "Mean paired gain after 4 to 6 tasks larger at sensor noise .02 than at .01, beyond both "
        "intervals; direction only if that holds of the highest noise alone.",
        grows_with_noise,
    ),
    Claim(
        "4.3-heat-peak",
        "4.3",
        "Feature selection has less benefit for noise levels above .02.",
        ("figure-4.7",),
        "Mean paired gain after 4 to 6 tasks at .04 and at .06 below that at .02, beyond both "
        "intervals.",
        peaks,
    ),
    Claim(
        "4.3-heat-par",
        "4.3",
        "For many tasks FS-TEK performs on a par with regular shaping.",
        ("figure-4.7",),
        "From ten tasks on every paired interval lies within 10% of the return without selection.",
        on_a_par,
    ),
    Claim(
        "4.3-heat-fpr",
        "4.3",
        "FS-TEK's false positive rate increases as noise increases (Figure 4.8).",
        ("figure-4.8",),
        "Mean rate from four tasks on higher at the highest noise than at the lowest, beyond both "
        "intervals.",
        false_positives,
    ),
    Claim(
        "4.3-heat-dip",
        "4.3",
        "As the number of tasks increases, the gain dips in early episodes (Figure 4.7, right).",
        ("figure-4.7",),
        "At the largest number of tasks the mean paired gain in episodes 6 to 40 is significantly "
        "below 0; direction only if it is so at some smaller number.",
        dip,
    ),
    Claim(
        "4.3-heat-information",
        "4.3",
        "The features that FS-TEK discards contain some small amount of information.",
        ("section-4.3-heat",),
        "Position and heading together have a positive domain relevance (95%) of at most a tenth "
        "of that of all features.",
        information,
    ),
    Claim(
        "4.3-heat-total",
        "4.3",
        "Selection pays on the heat domain (implied by the jump; the longer horizon is ours).",
        ("figure-4.7",),
        "Over all episodes followed the paired gain over no selection is above 0 at some number of "
        "tasks and below 0 at none; direction only if there are both.",
        whole,
    ),
    Claim(
        "4.3-heat-overcome",
        "4.3",
        "The slightly wrong bias of the smaller potential is quickly overcome.",
        ("figure-4.7",),
        "In the last block of the episodes followed the mean gain is within 5% of the return.",
        overcome,
    ),
)

SUMMARY: tuple[Claim, ...] = (
    Claim(
        "4.3.1-few-tasks-heat",
        "4.3.1",
        "The benefit of FS-TEK is greatest when few tasks have been seen: the heat domain.",
        ("figure-4.7",),
        "The largest gain over no selection at no more than six tasks, at every noise level.",
        few_tasks,
    ),
)


def _told(tables: Tables, *readings: str) -> str:
    """What a change of reading does to FS-TEK's gain and rates, at the lower noise."""
    table = tables["figure-4.7-readings"]
    few = int(table.tasks_seen.min())
    at = table[(table.sensor == table.sensor.min()) & (table.tasks_seen == few)]
    by = at.set_index("reading")
    told = [
        f"{name} {r.gain:+.0f} ± {r.gain_ci95:.0f} of {r.none_return:.0f}, {r.fpr:.2f}/{r.tpr:.2f}"
        for name, r in ((name, by.loc[name]) for name in ("as used", *readings) if name in by.index)
    ]
    return (
        f"FS-TEK's gain after {few} tasks in the first five episodes, and its FPR/TPR: "
        + "; ".join(told)
        + f" (n = {int(at.n_runs.iloc[0])} runs)."
    )


EVIDENCE = ("figure-4.7-readings",)

DIFFERENCES: tuple[Difference, ...] = (
    Difference(
        "4.3-heat-layout",
        "4.3",
        "Layout of the 1664 features",
        '"4 overlapping tilings, resulting in a total of 1664 features"; no grid.',
        "4 tilings of 2 x 2 x 8 x 13 tiles of x, y, heading and heat, jointly, each tiling "
        "displaced by its own fraction of a tile; a variable that does not wrap around has one "
        "tile more than intervals. One weight for each feature and action.",
        '`HeatSpace(layout="headings" | "positions")`',
        lambda t: _told(t, "positions fine"),
        EVIDENCE,
    ),
    Difference(
        "4.3-heat-tiling",
        "4.3",
        "The tiling as a feature",
        'Abstractions are computed "directly in feature space".',
        "Tiles are named by their tiling too. A tiling is no property of a state; were it one more "
        "feature, a selector would be asked about it, and an abstraction could merge tiles that "
        "are active at once.",
        '`HeatSpace(tilings="kept" | "feature")`',
        lambda t: _told(t, "tiling may go"),
        EVIDENCE,
    ),
    Difference(
        "4.3-heat-weighting",
        "4.3",
        "p(x|m) with function approximation",
        "p(m|f = 1) in equation 3.5; how often a feature is active is not said to be measured.",
        "The share of visits of each pair of feature and action while the task was learned.",
        '`HeatSpace(weighting="visits" | "uniform")`',
        lambda t: _told(t, "p(x|m) uniform"),
        EVIDENCE,
    ),
    Difference(
        "4.3-heat-moves",
        "4.3",
        "Stride and turn",
        '"By going forward or backward, or turning left or right by a small amount".',
        "Half a unit, and pi/8.",
        "`HeatWorld(stride=0.5, turn=pi / 8)`",
        lambda t: _told(t, "stride .25", "stride 1", "turn pi/16", "turn pi/4"),
        EVIDENCE,
    ),
    Difference(
        "4.3-heat-law",
        "4.3",
        "How heat falls off",
        '"The intensity of the heat emitted by the source".',
        "min(1, 1/d^2) at distance d from the robot's centre.",
        '`HeatWorld(intensity="inverse_square" | "exponential" | "linear")`',
        lambda t: _told(t, "heat exponential", "heat linear"),
        EVIDENCE,
    ),
    Difference(
        "4.3-heat-noise-scale",
        "4.3",
        "Scale of the sensor noise",
        '"Sensor noise adds xi ~ N(0, sigma_sensor) to all state features".',
        "As said, the same number for lengths, radians and heat; readings stay in their ranges. "
        "sigma is a standard deviation.",
        '`HeatWorld(noise_scale="raw" | "range")`',
        lambda t: _told(t, "noise in shares of the range"),
        EVIDENCE,
    ),
    Difference(
        "4.3-heat-alpha",
        "4.3",
        "Learning rate, traces and discount",
        "lambda = .9 and epsilon = .05; the learning rate, the kind of traces and gamma are not "
        "printed.",
        "A rate of .3 shared by the four active features, replacing traces, gamma = 1.",
        '`HeatLearner(alpha=0.3, traces="replacing" | "accumulating", discount=1.0)`',
        lambda t: _told(t, "alpha .1", "alpha .6", "accumulating traces", "gamma .98"),
        EVIDENCE,
    ),
    Difference(
        "4.3-heat-level",
        "4.3",
        "FS-TEK's level on the heat domain",
        "Not printed.",
        "The schedule of the triangle.",
        "`HeatConfig.fstek`",
        lambda t: _told(t, "level 1e-4", "level 1e-3"),
        EVIDENCE,
    ),
    Difference(
        "4.3-heat-truth",
        "4.3",
        "Truth labels in ROC space on the heat domain",
        "Not said; after the cliff's example, what is very weakly relevant counts as irrelevant.",
        "Heat and action count as relevant; x, y and heading do not.",
        "`HeatConfig.relevant`",
        lambda t: information(t).evidence,
        ("section-4.3-heat",),
    ),
    Difference(
        "4.3-heat-start",
        "4.3",
        "Where sources are and robots start, and when an episode is cut off",
        "Not said.",
        "Sources are drawn evenly from where the robot can reach them, robots start anywhere but "
        "at the source with any heading; an episode ends after 2000 steps at the latest. A source "
        "near a wall can be met from a short stretch along it only: about one task in a few "
        "hundred is very hard.",
        '`HeatSpace(sources="reachable" | "inside")`, `sarsa_lambda(max_episode_steps=2000)`',
        lambda t: _told(t, "sources off the walls"),
        EVIDENCE,
    ),
    Difference(
        "4.3-heat-solutions",
        "4.3",
        "Solutions of the observed tasks, with function approximation",
        "Tasks are learned one after another, each with the potential built so far.",
        "Each observed task is learned from weights 0 for 500 episodes, so that what is selected "
        "from does not depend on what was selected before; every run learns its tasks afresh.",
        '`HeatConfig(lessons="plain" | "shaped")`; shaped without selection',
        lambda t: _told(t, "observed tasks shaped"),
        EVIDENCE,
    ),
    Difference(
        "4.3-heat-episodes",
        "4.3",
        "Episodes of a test task",
        "500; figure 4.7 counts the first five on the left, and shows an unknown number on the "
        "right.",
        "Five where five count; at the noise of the right panel one hundred.",
        "`HeatConfig(first=5, followed=100)`",
        lambda t: overcome(t).evidence,
        ("figure-4.7",),
    ),
    Difference(
        "4.3-heat-tasks-seen",
        "4.3",
        "Numbers of observed tasks on the heat domain",
        '"Lower k" and "higher k"; the ends of the figures are not in the text.',
        "3 to 12.",
        "`Protocol.tasks_seen`",
        lambda t: on_a_par(t).evidence,
        ("figure-4.7",),
    ),
)
