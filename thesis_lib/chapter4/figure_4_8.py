"""Figure 4.8: feature selection on the heat domain, places in ROC space."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.chapter4 import looks
from thesis_lib.chapter4.heat_runs import BOOK, SMOKE, Config, by_noise, measure_heat
from thesis_lib.chapter4.runs import Placed, place
from thesis_lib.edition.criteria import judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.plots import unclutter
from thesis_lib.edition.words import several


@dataclass(frozen=True)
class Place(Placed):
    """One method after one number of observed tasks at one level of noise."""

    sensor: float
    """sigma_sensor; sigma_slip is .1."""
    method: str
    """fs-tek, ibkr, jackknife (this edition's), fixed, random, none, constant."""
    keeps_x: float
    """Share of runs that keep x."""
    keeps_y: float
    """Share of runs that keep y."""
    keeps_heading: float
    """Share of runs that keep the heading."""
    keeps_heat: float
    """Share of runs that keep the heat."""
    keeps_a: float
    """Share of runs that keep the action."""
    unsure: float
    """Mean number of features the selector is unsure about, and keeps."""


@experiment("figure-4.8", item="Figure 4.8", smoke=SMOKE, book=BOOK, thesis=Config(), seconds=21)
def places(config: Config, context: Context) -> list[Place]:
    """Feature selection on the heat domain: ROC space by sensor noise, over tasks seen."""
    records, protocol, truth = [], config.protocol, config.truth
    for sensor in config.sensors:
        space = config.space.with_noise(sensor)
        runs = measure_heat(config, space, context, test=False)
        for (i, method), (j, n) in product(
            enumerate(protocol.methods), enumerate(protocol.tasks_seen)
        ):
            own = runs.support[:, j, i]
            keeps = zip(space.feature_names, own.mean(axis=0).tolist(), strict=True)
            records.append(
                Place(
                    sensor=sensor,
                    method=method,
                    tasks_seen=n,
                    unsure=float(runs.unsure[:, j, i].mean()),
                    **{f"keeps_{name}": share for name, share in keeps},
                    **place(own, truth),
                )
            )
    return records


@criterion("4.3-heat-fpr", places)
def false_positives(table: pd.DataFrame) -> Finding:
    """FS-TEK's false positive rate over the levels of noise, mean over the numbers of tasks."""
    own = table[(table.method == "fs-tek") & (table.tasks_seen > 3)].groupby("sensor")
    by = own[["fpr", "fpr_ci95", "keeps_x", "keeps_y", "keeps_heading"]].mean()
    first, last = by.iloc[0], by.iloc[-1]
    listed = several(f"{r.fpr:.2f} ± {r.fpr_ci95:.2f} at {r.Index:g}" for r in by.itertuples())
    keeps = several(
        f"{f} in {first[f'keeps_{f}']:.0%} and {last[f'keeps_{f}']:.0%}"
        for f in ("x", "y", "heading")
    )
    gap, half = float(last.fpr - first.fpr), float(np.hypot(first.fpr_ci95, last.fpr_ci95))
    return judged(
        gap > half,
        f"Mean false positive rate from 4 tasks on: {listed}. At the lowest and the highest noise "
        f"it keeps {keeps}.",
        {"gap": gap},
        otherwise=Verdict.REFUTED if gap < -half else Verdict.INCONCLUSIVE,
    )


def figure(table: pd.DataFrame) -> Figure:
    """ROC space, one panel a level of noise, clockwise from the top left."""
    fig, axes = by_noise(table, looks.roc, height=6.0, legend_columns=3)
    for ax in axes[:, 1]:
        ax.set_ylabel("")
    return unclutter(fig)
