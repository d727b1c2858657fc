"""Section 3.3: how high the potentials are and which actions they prefer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib import potentials
from thesis_lib.arrays import FloatArray
from thesis_lib.chapter3.runs import SETTINGS, SYMBOLS, MuSearch
from thesis_lib.domains import Domain
from thesis_lib.edition.criteria import share_at_least
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.words import number
from thesis_lib.mdp.greedy import greedy_actions


@dataclass(frozen=True)
class Config:
    """Which domains the levels of the potentials are compared on."""

    domains: tuple[str, ...] = tuple(SETTINGS)
    """Domains of chapter 3."""
    mu: MuSearch = field(default_factory=MuSearch)
    """The search for the cross-task policy."""


@dataclass(frozen=True)
class Level:
    """One potential of one domain."""

    domain: str
    """Which domain."""
    potential: str
    """Q_star, Q_tilde or Q_mu, all with uniform p(x|m)."""
    mean: float
    """Mean over pairs."""
    lowest: float
    """Least value."""
    highest: float
    """Largest value."""
    largest_rise: float
    """Largest amount by which it exceeds Q_star at some pair."""
    mean_gap: float
    """Mean over pairs of Q_star less it."""
    same_greedy_actions: float
    """Share of observations with the same greedy actions as Q_star."""


@experiment(
    "ch3-levels",
    item="Section 3.3, the levels of the potentials",
    smoke=Config(domains=("triangle",), mu=MuSearch(restarts=1)),
    book=Config(),
    seconds=3,
)
def levels(config: Config, context: Context) -> list[Level]:
    """How high each potential is and which actions it prefers, exact."""
    records = []
    for name in config.domains:
        domain = SETTINGS[name].domain()
        epsilon = SETTINGS[name].learners[0].epsilon
        # Averages of the same weights throughout, so that only the task values differ.
        policy = config.mu.policy(domain, context.seed)
        phi = {
            "Q_star": potentials.q_star(domain),
            "Q_tilde": potentials.q_tilde(domain, epsilon),
            "Q_mu": potentials.q_mu(domain, policy),
        }
        best = greedy_actions(phi["Q_star"])
        for potential, values in phi.items():
            gap = phi["Q_star"] - values
            records.append(
                Level(
                    domain=name,
                    potential=potential,
                    mean=float(values.mean()),
                    lowest=float(values.min()),
                    highest=float(values.max()),
                    largest_rise=float((-gap).max()),
                    mean_gap=float(gap.mean()),
                    same_greedy_actions=float((greedy_actions(values) == best).all(axis=1).mean()),
                )
            )
    return records


@criterion("3.4.3-levels", levels)
def triangle_levels(table: pd.DataFrame) -> Finding:
    """Means of Q*, Q~ and Q^mu in that order, none above Q* anywhere, and the greedy actions."""
    at = table[table.domain == "triangle"].set_index("potential")
    star, tilde, mu = (float(at.loc[name, "mean"]) for name in ("Q_star", "Q_tilde", "Q_mu"))
    is_ordered = star > tilde > mu and float(at.largest_rise.max()) <= 1e-9
    same = float(at.same_greedy_actions.min())
    if is_ordered and same == 1.0:
        verdict = Verdict.REPRODUCED
    else:
        verdict = Verdict.DIRECTION if is_ordered else Verdict.NOT_REPRODUCED
    return Finding(
        verdict,
        f"Mean over pairs: Q* {number(star)}, Q~ {number(tilde)}, Q^μ {number(mu)}; some potential "
        f"has the greedy actions of Q* at only {same:.0%} of the observations."
        if same < 1
        else f"Mean over pairs: Q* {number(star)}, Q~ {number(tilde)}, Q^μ {number(mu)}; all have "
        "the same greedy actions.",
        {"Q_star": star, "Q_tilde": tilde, "Q_mu": mu, "same": same},
    )


@criterion("3.3.5-conservative", levels)
def cross_task_values_are_conservative(table: pd.DataFrame) -> Finding:
    """The mean of Q^mu against those of Q* and Q~, by domain."""
    mean = table.pivot(index="domain", columns="potential", values="mean")
    mean = mean.reindex(list(dict.fromkeys(table.domain)))
    lower = (mean.Q_mu < mean[["Q_star", "Q_tilde"]].min(axis=1)).to_dict()
    held = {
        f"{d}: Q* {number(v.Q_star)}, Q~ {number(v.Q_tilde)}, Q^μ {number(v.Q_mu)}": lower[d]
        for d, v in mean.iterrows()
    }
    return share_at_least(held, 1.0, "The mean of Q^μ lies below both others")


@criterion("3.6-lower", levels)
def never_above_q_star(table: pd.DataFrame) -> Finding:
    """Largest amount by which Q~ or Q^mu exceeds Q* at a pair, with the same weights."""
    most = float(table.largest_rise.max())
    return Finding(
        Verdict.REPRODUCED if most <= 1e-9 else Verdict.REFUTED,
        f"With uniform weights neither exceeds Q* anywhere on {table.domain.nunique()} domains."
        if most <= 1e-9
        else f"One of them exceeds Q* by {number(most)} at some pair.",
        {"rise": most},
    )


def value_maps(domain: Domain, phi: Mapping[str, FloatArray]) -> Figure:
    """State values, the best action's, of potentials on the cliff's grid: maps and surfaces."""
    fig = plt.figure(figsize=(7.2, 4.4))
    rows = fig.add_gridspec(2, len(phi), height_ratios=(1.0, 1.25))
    for i, (name, values) in enumerate(phi.items()):
        grid = np.full((4, 4), np.nan)
        x, y = domain.observations[:, 0], domain.observations[:, 1]
        grid[y, x] = values.max(axis=1)
        ax = fig.add_subplot(rows[0, i])
        picture = ax.imshow(grid, origin="lower")
        ax.set(title=SYMBOLS[name], xticks=range(4), yticks=range(4), xlabel="x")
        ax.tick_params(labelsize=8)
        ax.grid(False)
        bar = fig.colorbar(picture, ax=ax, fraction=0.046, pad=0.04).ax
        bar.tick_params(labelsize=7)
        bar.locator_params(nbins=5)
        if i == 0:
            ax.set_ylabel("y")
        hill = fig.add_subplot(rows[1, i], projection="3d")
        hill.plot_surface(
            *np.meshgrid(range(4), range(4)), grid, cmap="cividis", edgecolor="k", lw=0.3
        )
        hill.set(xticks=range(4), yticks=range(4))
        hill.set_xlabel("x", labelpad=-9)
        hill.set_ylabel("y", labelpad=-9)
        hill.tick_params(labelsize=7, pad=-3)
        hill.tick_params(axis="z", pad=0)
        hill.locator_params(axis="z", nbins=4)
        hill.set_box_aspect((4, 4, 3), zoom=1.1)
    return fig


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Level of each potential, and in what share of observations its actions are those of Q*."""
    words = {
        "potential": table.potential.map(SYMBOLS),
        "order": table.same_greedy_actions.map("{:.0%}".format),
    }
    return table.assign(**words)[["domain", "potential", "mean", "lowest", "highest", "order"]]
