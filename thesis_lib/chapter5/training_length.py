"""What longer training does to robustness: the share of its return that a policy keeps, by length.

The thesis trains for 25 million control steps, most runs of ours are shorter.  Where all nets of a
row have been trained and tested at two lengths, the shares kept under noise and over the switch
stand beside each other and beside those of tables C.1 to C.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.stats import binomtest, spearmanr

from thesis_lib.chapter5 import cells
from thesis_lib.chapter5.cells import NETS, ROBOTS
from thesis_lib.chapter5.contrasts import Config
from thesis_lib.chapter5.networks import STYLES
from thesis_lib.chapter5.runs import CELL, ENOUGH, Runs, plain
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.plots import legend_of, panels
from thesis_lib.robustness import CONDITIONS, PERTURBATIONS, TRAINED_ON
from thesis_lib.stats import mean_ci


@dataclass(frozen=True)
class Kept:
    """What the policies of one net keep of their return, by the length of their training."""

    task: str
    """Robot."""
    trained_on: str
    """Flat or hill."""
    architecture: str
    """Net."""
    perturbation: str
    """Noise or switch."""
    steps: int
    """Control steps of training."""
    kept: float
    """Perturbed return over regular return, mean over seeds."""
    ci95: float
    """Half-width of its 95% interval over seeds."""
    seeds: int
    """Learning runs; policies that earn nothing in the regular test have nothing to keep."""
    printed: float
    """The same by tables C.1 to C.3."""


@experiment(
    "ch5-training-length", item="Tables C.1 to C.3", smoke=Config(), book=Config(), seconds=1
)
def kept_by_length(config: Config, context: Context) -> list[Kept]:
    """Shares of the return kept by nets that were trained for two lengths or more."""
    printed = cells.printed_cells(tuple(cells.TESTED.values()))[0]
    rows = []
    for (robot, ground, net, steps), own in _shares(config.runs()).groupby(
        ["task", "terrain", "architecture", "steps"]
    ):
        at = TRAINED_ON.index(ground), slice(None), ROBOTS.index(robot), NETS.index(net)
        base, *others = printed[at]
        for perturbation, value in zip(PERTURBATIONS, others, strict=True):
            mean = mean_ci(own[perturbation].to_numpy())
            rows.append(
                Kept(
                    robot,
                    ground,
                    net,
                    perturbation,
                    int(steps),
                    mean.mean,
                    mean.half_width,
                    len(own),
                    float(value / base),
                )
            )
    return rows


def _shares(store: Runs) -> pd.DataFrame:
    """One row a policy, on robots and grounds where every net has been tested at two lengths."""
    tests = plain(store.tests)
    lengths = store.depths()[[*CELL, "layer", "steps"]]
    tests = tests[tests.policy == "last"].merge(lengths, on=[*CELL, "layer"])
    tests = tests.assign(architecture=tests.architecture.str.upper())
    wide = tests[tests.architecture.isin(NETS)].pivot_table(
        index=["task", "terrain", "architecture", "steps", "seed"],
        columns="condition",
        values="return",
    )
    wide = wide.reindex(columns=list(CONDITIONS)).dropna().reset_index()
    wide = wide[wide.base > 0]
    for perturbation in PERTURBATIONS:
        wide[perturbation] = wide[perturbation] / wide.base
    seeds = wide.groupby(["task", "terrain", "steps", "architecture"]).size()
    whole = seeds[seeds >= ENOUGH].groupby(["task", "terrain", "steps"]).size() == len(NETS)
    rows = whole[whole].reset_index()[["task", "terrain", "steps"]]
    several = rows.groupby(["task", "terrain"]).steps.transform("size") > 1
    return wide.merge(rows[several], on=["task", "terrain", "steps"])


_GROUND = {"flat": "flat ground", "hill": "hills"}


def where(table: pd.DataFrame) -> str:
    """The robots and grounds of the table: ``HalfCheetah, flat``."""
    return "; ".join(dict.fromkeys(table.task + ", " + table.trained_on))


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Shares by net: printed, and ours by length; noise and switch beside each other."""
    rows: dict[tuple[str, str], dict[str, str]] = {}
    for row in table.itertuples():
        key = f"{row.task}, {row.trained_on}", str(row.architecture)
        own = rows.setdefault(key, {"on": key[0], "net": key[1]})
        own[f"{row.perturbation}, printed"] = f"{row.printed:.2f}"
        ours = f"{row.kept:.2f} ± {row.ci95:.2f}"
        own[f"{row.perturbation}, {row.steps / 1e6:.0f} million"] = ours
    order = {net: i for i, net in enumerate(NETS)}
    listed = sorted(rows.values(), key=lambda own: (own["on"], order[own["net"]]))
    columns = ["on", "net"] if len({on for on, _ in rows}) > 1 else ["net"]
    lengths = sorted(table.steps.unique())
    for perturbation in PERTURBATIONS:
        columns += [f"{perturbation}, printed"]
        columns += [f"{perturbation}, {steps / 1e6:.0f} million" for steps in lengths]
    return pd.DataFrame(listed, columns=columns)


def draw(table: pd.DataFrame) -> Figure:
    """Shares by length of training, with 95% intervals, and as printed: a row a robot and ground.

    Lines lead from length to length; dotted ones to the printed share of the same net.  The axes
    are those of the shares: intervals over few seeds may reach beyond.
    """
    rows = [*table.groupby(["task", "trained_on"], sort=False)] or [(("", ""), table)]
    places = list(product([key for key, _ in rows], PERTURBATIONS))
    fig, axes = panels(len(places), len(PERTURBATIONS), 2.6, 0.8, sharey=True)
    for ax, ((robot, ground), perturbation) in zip(axes, places, strict=True):
        own = table[(table.task == robot) & (table.trained_on == ground)]
        own = own[own.perturbation == perturbation].sort_values("steps")
        for i, net in enumerate(NETS):
            at = own[own.architecture == net]
            # Nets side by side, so that their intervals do not cover each other.
            x = np.arange(len(at)) + 0.04 * (i - len(NETS) / 2)
            colour, style = STYLES[net.lower()]
            filled = colour if style == "-" else "white"
            look: dict[str, Any] = {"color": colour, "lw": 1.2, "mfc": filled}
            ax.plot(x, at.kept, f"o{style}", ms=4, label=net, **look)
            ax.errorbar(x, at.kept, yerr=at.ci95, fmt="none", ecolor=colour, alpha=0.4)
            if len(at):
                ax.plot([x[-1], len(at)], [at.kept.iloc[-1], at.printed.iloc[-1]], ":", **look)
                ax.plot([len(at)], [at.printed.iloc[-1]], "<", **look)
        lengths = [f"{steps / 1e6:.0f} million\nsteps" for steps in own.steps.unique()]
        ax.set_xticks(range(len(lengths) + 1), [*lengths, "printed"])
        ax.set(title=f"{robot}, {ground}: {perturbation}", xlim=(-0.3, len(lengths) + 0.15))
    axes[0].set_ylim(0, max(1.05, 1.05 * table[["kept", "printed"]].max(axis=None)))
    fig.supylabel("share of the regular return", fontsize=10)
    legend_of(axes[0], 7, fontsize=8)
    return fig


def _ends(own: pd.DataFrame) -> tuple[pd.DataFrame, int, str]:
    """Shares by net after the shortest and the longest training, losers, and when, in words."""
    wide = own.pivot(index="architecture", columns="steps", values="kept")
    ends = wide.iloc[:, [0, -1]]
    short, long = ends.columns / 1e6
    less = int((ends.iloc[:, 1] < ends.iloc[:, 0]).sum())
    return ends, less, f"after {long:.0f} million steps than after {short:.0f} million"


def losers(table: pd.DataFrame) -> str:
    """How many nets keep less after the longest training than after the shortest, by row."""
    told = []
    for (robot, ground), own in table.groupby(["task", "trained_on"], sort=False):
        (nets, noise, when), (_, switch, _) = (
            _ends(own[own.perturbation == what]) for what in PERTURBATIONS
        )
        told.append(
            f"of the nets that learned on {_GROUND[ground]} ({robot}) {noise} of {len(nets)} keep "
            f"less under noise {when}, and {switch} of {len(nets)} over the switch"
        )
    return "; ".join(told) if told else "no row has been trained for two lengths yet"


def reading(table: pd.DataFrame) -> str:
    """How many nets keep less after longer training, and which length orders them as printed."""
    if table.empty:
        return "No row has been trained for two lengths yet."
    told = []
    for (robot, ground, perturbation), own in table.groupby(
        ["task", "trained_on", "perturbation"], sort=False
    ):
        nets, less, when = _ends(own)
        p = binomtest(less, len(nets)).pvalue
        printed = own.groupby("architecture").printed.first()[nets.index]
        ranks = [spearmanr(nets[steps], printed) for steps in nets]
        where = "under noise" if perturbation == "noise" else "over the switch"
        told.append(
            f"On the {robot} trained on {_GROUND[ground]} {less} of {len(nets)} nets keep less "
            f"{where} {when} (sign test p = {p:.2g}); the rank correlation of what they keep with "
            f"the printed shares is {ranks[1].statistic:.2f} (p = {ranks[1].pvalue:.2g}) after the "
            f"longer training and {ranks[0].statistic:.2f} (p = {ranks[0].pvalue:.2g}) after the "
            "shorter."
        )
    return " ".join(told)
