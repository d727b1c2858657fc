"""Pictures beside the findings of the front page, from the library and from the build's tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import altair as alt
import numpy as np
import pandas as pd

from thesis_lib.book.charts import CHARTS, drawn, law, picture, svg, threshold
from thesis_lib.chapter3.figure_3_4 import two_stocks
from thesis_lib.chapter3.runs import NAMES
from thesis_lib.edition.deepest import deepest
from thesis_lib.edition.experiment import load
from thesis_lib.edition.plots import COLOURS
from thesis_lib.stats import mean_ci

WIDTH, HEIGHT = 260, 150
"""Pixels of a picture, without its axes."""


def steps() -> alt.Chart:
    """Ratio of successive steps of k-relevance by its law, and a bound that theorem 2 asks for."""
    ks = np.arange(2, 31)
    law = 1 / np.arange(1, 32)
    ratios = np.diff(law)[1:] / np.diff(law)[:-1]
    rows = [
        {"k": int(k), "ratio": float(ratio), "of": "steps of k-relevance"}
        for k, ratio in zip(ks, ratios, strict=True)
    ]
    rows += [{"k": int(k), "ratio": 0.8, "of": "a constant below 1"} for k in ks]
    return (
        alt.Chart(pd.DataFrame(rows))
        .mark_line(strokeWidth=2)
        .encode(
            x=alt.X("k:Q", title="length of the sequence, k"),
            y=alt.Y("ratio:Q", title="next step over this", scale=alt.Scale(domain=[0, 1])),
            color=alt.Color("of:N", title=None, sort=None),
        )
    )


def constant(table: pd.DataFrame) -> alt.Chart:
    """Return of each potential on stock trading at its best learning rate; of ``figure-3.4``."""
    own = two_stocks(table).assign(name=lambda t: t.potential.map(NAMES).str.replace("^", ""))
    own = own.assign(low=own.mean_return - own.ci95, high=own.mean_return + own.ci95)
    base = alt.Chart(own[["name", "mean_return", "low", "high"]]).encode(
        y=alt.Y("name:N", title=None, sort="-x")
    )
    names = own.name[own.potential == "constant"].tolist()
    colour = alt.condition(
        alt.FieldOneOfPredicate("name", names), alt.value(COLOURS[3]), alt.value("#bbbbbb")
    )
    bars = base.mark_bar().encode(x=alt.X("mean_return:Q", title="return of a run"), color=colour)
    return bars + base.mark_rule(strokeWidth=2).encode(x="low:Q", x2="high:Q")


def noise(table: pd.DataFrame) -> alt.Chart:
    """Shares of the return kept over the noise's correlation time; of ``ch5-correlated-noise``."""
    rows = []
    for (arm, correlation), own in table.groupby(["arm", "correlation"]):
        mean = mean_ci(own.retained.to_numpy())
        rows.append(
            {"network": arm, "time": f"{correlation:g}", "share": mean.mean}
            | {"low": mean.mean - mean.half_width, "high": mean.mean + mean.half_width}
        )
    data = pd.DataFrame(rows, columns=["network", "time", "share", "low", "high"])
    base = alt.Chart(data).encode(
        x=alt.X(
            "time:O",
            title="correlation time of the noise, steps",
            sort=None,
            axis=alt.Axis(labelAngle=0),
        ),
        color=alt.Color("network:N", title=None),
    )
    share = alt.Y("share:Q", title="share kept", scale=alt.Scale(zero=False))
    return base.mark_line(point=True).encode(y=share) + base.mark_rule().encode(
        y="low:Q", y2="high:Q"
    )


OF_TABLES: Mapping[str, tuple[Callable[[pd.DataFrame], alt.Chart], str, str]] = {
    "constant": (constant, "figure-3.4", "Returns on stock trading by potential"),
    "noise": (
        noise,
        "ch5-correlated-noise",
        "Shares of the return kept over the noise's correlation time",
    ),
}
"""What makes each picture, of which experiment's table, and what it shows."""


def findings(results: Path | str, *, draft: bool = False) -> dict[str, str]:
    """The pictures as files: ``picture-NAME.md`` are to be included.

    Parameters
    ----------
    results
        Directory of the build's tables.
    draft
        Whether a picture whose table is missing stays away; else it is an error.

    Raises
    ------
    FileNotFoundError
        If a table is missing and this is no draft.
    """
    shown: dict[str, tuple[alt.Chart, str]] = {
        "law-small": (law(), CHARTS["law"][1]),
        "threshold-small": (threshold(), CHARTS["threshold"][1]),
        "steps": (steps(), "Ratio of successive steps of k-relevance over k"),
    }
    made = {}
    for name, (make, experiment, words) in OF_TABLES.items():
        try:
            table, _ = deepest(*load(experiment, results))
        except FileNotFoundError:
            if not draft:
                raise
            made[f"picture-{name}.md"] = ""
            continue
        shown[name] = make(table), words
    for name, (chart, words) in shown.items():
        made[f"chart-{name}.svg"] = svg(drawn(chart, WIDTH, HEIGHT))
        made[f"picture-{name}.md"] = picture(name, words)
    return made
