"""Table 5.2 at its own length: learning runs of 500 iterations of 50,000 control steps.

The tables and figures of section 5.5 take for each cell the longest runs of which there are enough
seeds.  Here are all runs as long as the thesis's, seed by seed, beside the printed mean and beside
what shorter runs have earned after as many steps.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from thesis_lib.chapter5.cells import NETS, ROBOTS, as_published
from thesis_lib.chapter5.contrasts import Config
from thesis_lib.chapter5.figure_5_3 import bins, by_cell
from thesis_lib.chapter5.runs import CELL, PRINTED_STEPS
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.plots import COLOURS, PRINTED, panels
from thesis_lib.robustness import TRAINED_ON


@dataclass(frozen=True)
class Point:
    """Some iterations of one run as long as the thesis's."""

    task: str
    """Robot."""
    trained_on: str
    """Flat or hill."""
    architecture: str
    """Net."""
    seed: int
    """Seed of the run."""
    iteration: float
    """Mean of the iterations."""
    steps: float
    """Control steps learned from after the last of them."""
    mean_return: float
    """Mean return over these iterations."""
    shorter: float
    """Of shorter runs of the cell in the same span of steps, mean over seeds; none beyond their
    end."""
    shorter_seeds: int
    """How many seeds these have."""
    printed: float
    """Mean over the 500 iterations by table 5.2."""
    printed_error: float
    """Its printed standard error, over five runs."""


@experiment(
    "ch5-printed-length",
    item="Table 5.2 (printed length)",
    smoke=Config(),
    book=Config(),
    seconds=2,
)
def curves(config: Config, context: Context) -> list[Point]:
    """Learning curves of runs as long as the thesis's, seed by seed."""
    store = config.runs()
    budgets = store.depths()
    long = budgets.steps >= PRINTED_STEPS
    cells, others = (
        by_cell(store.curves, some.drop_duplicates(CELL))
        for some in (budgets[long], budgets[~long])
    )
    by = as_published("table-5.2")
    rows = []
    for robot, ground, net in product(ROBOTS, TRAINED_ON, NETS):
        if (runs := cells.get((robot, ground, net))) is None:
            continue
        printed = by.loc[(ground, robot, net)]
        rest = others.get((robot, ground, net), runs.iloc[:0])
        rows += [
            Point(robot, ground, net, *point, float(printed.value), float(printed.standard_error))
            for point in _points(runs, rest)
        ]
    return rows


def _points(
    runs: pd.DataFrame, rest: pd.DataFrame
) -> Iterator[tuple[int, float, float, float, float, int]]:
    """Seed, iteration, steps, return, that of shorter runs and how many, of each point."""
    for seed, run in runs.sort_values("iteration").groupby("seed"):
        before = 0.0
        for _, some in run.groupby(bins(run.iteration)):
            upto = float(some.steps.max())
            same = rest[(rest.steps > before) & (rest.steps <= upto)]
            by_seed = same.groupby("seed").mean_return.mean()
            shorter = float(by_seed.mean()) if len(by_seed) else np.nan
            mean = float(some.mean_return.mean())
            yield int(seed), float(some.iteration.mean()), upto, mean, shorter, len(by_seed)
            before = upto


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Printed mean, ours by seed, at the end of learning, and of shorter runs; one row a net."""
    rows = []
    for (robot, ground, net), own in table.groupby(
        ["task", "trained_on", "architecture"], sort=False
    ):
        by_seed = own.groupby("seed")
        first = own.iloc[0]
        spans = own.dropna(subset=["shorter"]).drop_duplicates("iteration")
        rows.append(
            {
                "on": f"{robot}, {ground}",
                "net": net,
                "printed": f"{first.printed:.0f} ({first.printed_error:.0f})",
                "ours": _each(by_seed.mean_return.mean()),
                "ours at the end": _each(by_seed.mean_return.last()),
                "shorter runs": f"{spans.shorter.mean():.0f}" if len(spans) else "",
            }
        )
    columns = ["on", "net", "printed", "ours", "ours at the end", "shorter runs"]
    return pd.DataFrame(rows, columns=columns)


def _each(by_seed: pd.Series) -> str:
    return ", ".join(f"{value:.0f}" for value in by_seed.sort_index())


def reading(table: pd.DataFrame) -> str:
    """How near these runs come to the printed means, and what shorter ones leave out."""
    if table.empty:
        return "No run of ours is as long yet."
    by_cell = table.groupby(["task", "trained_on", "architecture"])
    near = by_cell.mean_return.mean() / by_cell.printed.first()
    short = by_cell.shorter.mean() / by_cell.mean_return.mean()
    after = table.steps.where(table.shorter.notna()).max() / 1e6
    words = (
        f"Over {by_cell.ngroups} cells our means are {near.min():.0%} to {near.max():.0%} of the "
        f"printed ones, {near.median():.0%} in the median."
    )
    if short.isna().all():
        return words
    return (
        f"{words} Over their {after:.0f} million steps the shorter runs earned {short.min():.0%} "
        f"to {short.max():.0%} of what these earned over theirs."
    )


def draw(table: pd.DataFrame) -> Figure:
    """A panel a net: curves by seed with their means, and the printed mean, in a colour a ground.

    Of the robot that comes first.
    """
    table = table[table.task == table.task.iloc[0]] if len(table) else table
    nets = [net for net in NETS if net in set(table.architecture)] or [NETS[0]]
    fig, axes = panels(len(nets), 4, 1.9, 0.8, sharex=True, sharey=True)
    shown = [ground for ground in TRAINED_ON if ground in set(table.trained_on)]
    for ax, net in zip(axes, nets, strict=True):
        ax.set_title(net, fontsize=9)
        if table.empty:
            ax.text(0.5, 0.5, "not run yet", transform=ax.transAxes, ha="center")
        edge: dict[str, Any] = {
            "transform": ax.get_yaxis_transform(),
            "clip_on": False,
            "ls": "none",
        }
        for ground, colour in zip(shown, COLOURS, strict=False):
            own = table[(table.architecture == net) & (table.trained_on == ground)]
            for _, run in own.groupby("seed"):
                ax.plot(run.steps / 1e6, run.mean_return, color=colour, lw=0.9)
                ax.plot([1.03], [run.mean_return.mean()], "<", color=colour, **edge)
            for mean in own.printed.unique():
                ax.axhline(mean, color=colour, lw=1, ls="--")
    fig.supxlabel("million control steps", fontsize=9)
    fig.supylabel("mean return", fontsize=9)
    handles = [Line2D([], [], color=c) for c, _ in zip(COLOURS, shown, strict=False)]
    names = [f"{ground}, a line a seed" for ground in shown]
    if shown:
        handles += [
            Line2D([], [], color=PRINTED, marker="<", ls="none"),
            Line2D([], [], color=PRINTED, ls="--"),
        ]
        fig.legend(
            *(handles, [*names, "its mean", "printed mean"]),
            loc="outside upper center",
            ncols=4,
            fontsize=8,
        )
    return fig
