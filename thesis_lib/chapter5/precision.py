"""Whether the number type of the networks matters (section 5.4)."""

from __future__ import annotations

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.chapter5.committed import band, experiment_of
from thesis_lib.edition.criteria import LEVEL
from thesis_lib.edition.ledger import effect_of
from thesis_lib.edition.plots import COLOURS
from thesis_lib.training.curves import MARGIN, compared

curves = experiment_of(
    *("ch5-precision", "precision/curves"),
    "Learning curves with networks in float32 and in float64 (committed with the book).",
)


@effect_of("5.4-number-type", curves)
def effect(table: pd.DataFrame) -> str:
    """The two number types compared, seed by seed."""
    return (
        "Runs that differ in their last digits soon differ visibly, much as two seeds do. "
        f"{reading(table)}"
    )


def reading(table: pd.DataFrame) -> str:
    """Return averaged over all iterations, float32 against float64, in sentences."""
    (row,) = compared(table, "precision").itertuples()
    shown = "are" if row.p_equivalence < LEVEL else "cannot be"
    half = (row.high - row.low) / 2
    return (
        f"Averaged over {table.iteration.max()} iterations of the {row.architecture.upper()} on "
        f"{row.task} float32 earns {row.mean_changed:.1f} and float64 {row.mean_reference:.1f}, a "
        f"difference seed by seed of {row.difference:.1f} ± {half:.1f} (95%, n = {row.n}). "
        f"With a margin of a tenth, {MARGIN * abs(row.mean_reference):.1f}, the two {shown} shown "
        f"to be equivalent (paired TOST, p = {row.p_equivalence:.2g})."
    )


def figure(table: pd.DataFrame) -> Figure:
    """Mean learning curves with 95% bands by number type of the network."""
    fig, ax = plt.subplots(figsize=(7.2, 3.3))
    for (name, own), colour in zip(table.groupby("precision"), COLOURS, strict=False):
        band(ax, own, "iteration", colour, str(name))
    ax.set(xlabel="thousands of control steps", ylabel="mean return of an episode")
    ax.legend()
    return fig
