"""Figure 4.1: k-relevance of single features of the triangle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, get_args

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.chapter4.runs import exact_solutions
from thesis_lib.domains import triangle
from thesis_lib.edition.criteria import judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, criterion
from thesis_lib.edition.plots import COLOURS, legend_of
from thesis_lib.edition.words import several
from thesis_lib.relevance import k_relevance, keep, remove
from thesis_lib.relevance.exact import Direction

FEATURES: Mapping[str, str] = {
    **{"a": "action", "x1": "state number", "x2": "distance", "x3": "colour"},
}
SYMBOLS: Mapping[str, str] = {
    **{"a": "action $a$", "x1": "state $x_1$", "x2": "distance $x_2$", "x3": "colour $x_3$"},
}


@dataclass(frozen=True)
class Config:
    """Settings of figure 4.1."""

    longest: int = 20
    """Largest k."""


@dataclass(frozen=True)
class Relevance:
    """k-relevance of one feature for one k."""

    feature: str
    """x1 state, x2 inverse squared distance, x3 colour, a action."""
    direction: str
    """forward: variance the feature alone explains, which is what the figure shows; backward:
    error made by removing it."""
    k: int
    """Sequence length."""
    relevance: float
    """k-relevance, squared reward."""


@experiment("figure-4.1", item="Figure 4.1", smoke=Config(longest=12), book=Config(), seconds=0.01)
def curves(config: Config, context: Context) -> list[Relevance]:
    """k-relevance of single features of the triangle, exactly, in both directions."""
    solutions = exact_solutions(triangle())
    k = np.arange(1, config.longest + 1)
    records = []
    for direction in get_args(Direction):
        abstraction = keep if direction == "forward" else remove
        for feature in solutions.feature_names:
            labels = abstraction(solutions, [feature])
            curve = k_relevance(solutions, labels, k, direction=direction)
            records += [
                Relevance(feature, direction, int(i), float(rho))
                for i, rho in zip(k, curve, strict=True)
            ]
    return records


def _forward(table: pd.DataFrame) -> dict[str, pd.Series]:
    """Forward curves over k by feature."""
    own = table[table.direction == "forward"]
    return {str(f): curve.set_index("k").relevance for f, curve in own.groupby("feature")}


@criterion("4.1.1-plateau", curves)
def some_plateau(table: pd.DataFrame) -> Finding:
    """Whether action and distance fall and stay above zero, and the position goes."""
    by = _forward(table)
    left = {f: float(curve.iloc[-1] / curve[1]) for f, curve in by.items()}
    ends = several(f"{FEATURES[f]} from {c[1]:.2f} to {abs(c.iloc[-1]):.2f}" for f, c in by.items())
    misfit = max(map(_misfit, by.values())) / max(curve.abs().max() for curve in by.values())
    return judged(
        all(0.1 < left[f] < 1 for f in ("a", "x2")) and left["x1"] < 0.1,
        f"Exact forward relevance from k = 1 to {table.k.max()}: {ends}. From a + b/k through its "
        f"ends each curve differs by at most {misfit:.0g} of the largest relevance.",
        left,
    )


def _misfit(curve: pd.Series) -> float:
    """Largest distance of a curve over k from a + b/k through its ends."""
    part = (1 / curve.index - 1 / curve.index[-1]) / (1 / curve.index[0] - 1 / curve.index[-1])
    law = curve.iloc[-1] + (curve.iloc[0] - curve.iloc[-1]) * part
    return float((curve - law).abs().max())


@criterion("4.1.1-twelve", curves)
def gone_at_twelve(table: pd.DataFrame) -> Finding:
    """Forward relevance of the position at k = 12 over that at k = 1."""
    curve = _forward(table)["x1"]
    share = float(curve[12] / curve[1])
    return judged(
        share <= 0.1,
        f"At k = 12 the forward relevance of the state number is {curve[12]:.3f}, {share:.1%} of "
        "what it is at k = 1; by the law, with a limit of 0, that is a twelfth.",
        {"share": share},
        direction=share < 0.5,
    )


def figure(table: pd.DataFrame) -> Figure:
    """k-relevance of single features, forward and backward."""
    fig, axes = plt.subplots(1, 2, figsize=(7.2, 3.4))
    for ax, direction in zip(axes, ("forward", "backward"), strict=True):
        own = table[table.direction == direction]
        for i, (name, curve) in enumerate(own.groupby("feature")):
            look: dict[str, Any] = {"color": COLOURS[i], "label": SYMBOLS[str(name)]}
            ax.plot(curve.k, curve.relevance, marker="o", ms=3, **look)
        ax.set(xlabel="sequence length k", title=direction, ylim=(-0.2, None))
    axes[0].set_ylabel("k-relevance [squared reward]")
    legend_of(axes[0], 4)
    return fig
