"""Figure 5.5: is it depth, size or the transfer function? (section 5.5.2)"""

from __future__ import annotations

from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.chapter5 import cells
from thesis_lib.chapter5.cells import EXTRA_NETS, NETS
from thesis_lib.chapter5.contrasts import SMOKE, Config
from thesis_lib.chapter5.judging import Said, both, of_source
from thesis_lib.chapter5.networks import NAMES
from thesis_lib.edition.criteria import graded
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Criterion
from thesis_lib.edition.plots import COLOURS
from thesis_lib.edition.words import with_interval
from thesis_lib.robustness import quadrants

ALL_NETS = (*NETS, *EXTRA_NETS)


@dataclass(frozen=True)
class Score:
    """Mean score of a net under noise, trained on the flat, and by how much DFFWD leads it."""

    source: str
    """Printed or ours."""
    architecture: str
    """Net."""
    score: float
    """Equation 5.4, mean over robots."""
    low: float
    """Lower end of its 95% bootstrap interval over runs."""
    high: float
    """Upper end."""
    behind: float
    """DFFWD's score less its own."""
    behind_low: float
    """Lower end of the interval of that difference."""
    behind_high: float
    """Upper end."""
    robots: int
    """Robots on which every net shown has been run."""
    units: int
    """Fewest runs behind it."""
    printed_budget: bool
    """Whether all learned for as many steps as the thesis's."""


@experiment("figure-5.5", item="Figure 5.5", smoke=SMOKE, book=Config(), seconds=0.8)
def depth(config: Config, context: Context) -> list[Score]:
    """Scores under noise with a softplus net and a wide shallow one; their bars are a picture."""
    a, b = (np.random.default_rng(s) for s in context.seeds(2))
    printed = cells.printed(tuple(cells.TESTED.values()), a, config.resamples)
    across = ["terrain", "architecture"]  # the further nets have shorter runs alone
    ours = cells.from_tests(config.runs(), b, config.resamples, ALL_NETS, across)
    return [*_scores(printed, NETS), *_scores(ours, ALL_NETS)]


def _scores(made: cells.Cells, nets: tuple[str, ...]) -> list[Score]:
    mean, draws = quadrants(made.mean)[0, 0], quadrants(made.draws)[:, 0, 0]
    there = np.isfinite(mean).all(axis=-1)
    if not there.any():
        return []
    value, drawn = mean[there].mean(0), draws[:, there].mean(1)
    units = int(made.units[0, there].min())
    deep = nets.index("DFFWD")
    return [
        Score(
            made.source,
            net,
            float(value[m]),
            *cells.interval(drawn[:, m], units),
            float(value[deep] - value[m]),
            *cells.interval(drawn[:, deep] - drawn[:, m], units),
            int(there.sum()),
            units,
            bool(made.printed_budget[0, there].all()),
        )
        for m, net in enumerate(nets)
    ]


def _dffwd_leads(claim: str, net: str, name: str) -> Criterion:
    """The criterion that DFFWD leads a net, which is called so."""

    def rows(source: str, table: pd.DataFrame) -> pd.DataFrame:
        own = of_source(source, table)
        return own[own.architecture == net]

    def judge(rows: pd.DataFrame) -> Said:
        row = rows.iloc[0]
        return (
            graded(row.behind_low > 0, row.behind > 0, denied=row.behind_high < 0),
            f"DFFWD less {name} {with_interval(row.behind, row.behind_low, row.behind_high)}, "
            f"{f'mean of {row.robots} robots' if row.robots > 1 else 'on one robot'}.",
        )

    return both(claim, depth, rows=rows)(judge)


deep_over_wide = _dffwd_leads("5.5.2-depth", "FFWD-400", "one layer of 400 units")
tanh_over_softplus = _dffwd_leads("5.5.2-tanh", "DFFWD-SOFTPLUS", "the same net with softplus")


def draw(table: pd.DataFrame) -> Figure:
    """Mean scores under noise, flat-trained: printed, and ours with the two further nets."""
    fig, ax = plt.subplots(figsize=(7.2, 3.2))
    places = np.arange(len(ALL_NETS))
    for shift, source, colour in ((-0.2, "printed", COLOURS[7]), (0.2, "ours", COLOURS[0])):
        own = table[table.source == source]
        if own.empty:
            continue
        own = own.set_index("architecture").reindex(list(ALL_NETS))
        span = np.abs(own[["low", "high"]].sub(own.score, axis=0).to_numpy().T)
        ax.bar(places + shift, own.score, 0.4, yerr=span, color=colour, alpha=0.7, label=source)
    ax.set_xticks(places, [NAMES[net.lower()] for net in ALL_NETS], rotation=45, ha="right")
    ax.set(ylabel="score under noise", xlim=(-0.6, len(ALL_NETS) - 0.4))
    fig.legend(loc="outside upper right", ncols=2)
    return fig
