"""Which reading of section 3.4.1 fits the numbers of Table 3.1."""

from __future__ import annotations

from dataclasses import dataclass, replace

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy import stats

from thesis_lib.chapter3 import table_3_1
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import effect_of
from thesis_lib.edition.plots import PRINTED
from thesis_lib.edition.words import number, probability, several


@dataclass(frozen=True)
class Config:
    """Which readings are held against the printed numbers, and how."""

    n_runs: int = 400
    """Runs an entry and reading; more than the thesis's, to see the reading and not noise."""
    most_episodes: int = 700
    """Largest number of episodes."""
    every: int = 10
    """Spacing of the curve, in episodes."""


READINGS: dict[str, dict[str, float | str | bool]] = {
    "as fitted": {},
    "epsilon .12": {"epsilon": 0.12},
    "random action from the others": {"exploration": "others"},
    "random action from the others, epsilon .09": {"exploration": "others", "epsilon": 0.09},
    "fall costs 1200": {"fall_reward": -1200.0},
    "fall costs 1001": {"fall_costs_step": True},
}
"""Readings of section 3.4.1, one point varied at a time."""


@dataclass(frozen=True)
class Fit:
    """A reading held against the printed numbers, at one number of episodes."""

    reading: str
    """What is varied."""
    episodes: int
    """Episodes a run."""
    chi2: float
    """Sum over the table's entries of ((ours - printed) / standard error)^2."""
    dof: int
    """Number of entries compared."""
    p_value: float
    """Of chi2 with dof degrees of freedom."""
    worst_z: float
    """Largest standardised difference of an entry."""
    n_runs: int
    """Runs an entry."""


@experiment(
    "ch3-readings",
    item="Table 3.1, its reading",
    smoke=Config(n_runs=4, most_episodes=40, every=20),
    book=Config(n_runs=250),
    thesis=Config(),
    seconds=15,
)
def fit(config: Config, context: Context) -> list[Fit]:
    """How well readings of section 3.4.1 fit the printed numbers, over the episodes run."""
    records = []
    for name, changes in READINGS.items():
        settings = replace(
            table_3_1.Config(
                n_runs=config.n_runs,
                episodes=config.most_episodes,
                potentials=("none", "Q_star", "Q_tilde"),
            ),
            **changes,  # type: ignore[arg-type]
        )
        cells = table_3_1.all_cells(settings)
        keys = [(c.potential, c.algorithm, c.sensor) for c in cells]
        wanted = table_3_1.printed().set_index(["potential", "algorithm", "sensor"]).reindex(keys)
        wanted_se = wanted.printed_ci95.to_numpy() / stats.norm.ppf(0.975)
        totals = table_3_1.episode_returns(settings, cells, context).cumsum(axis=2) / table_3_1.UNIT
        for episodes in range(config.every, config.most_episodes + 1, config.every):
            total = totals[:, :, episodes - 1]
            se = total.std(axis=1, ddof=1) / np.sqrt(config.n_runs)
            z = (total.mean(axis=1) - wanted.printed_mean.to_numpy()) / np.hypot(se, wanted_se)
            chi2 = float((z**2).sum())
            p = float(stats.chi2.sf(chi2, len(cells)))
            worst = float(np.abs(z).max())
            records.append(Fit(name, episodes, chi2, len(cells), p, worst, config.n_runs))
    return records


@effect_of("3.4.1-episodes", fit)
def fitted_reading(table: pd.DataFrame) -> str:
    """What the number of episodes changes, from the goodness-of-fit curve."""
    curve = table[table.reading == "as fitted"].set_index("episodes")
    best = int(curve.chi2.idxmin())
    row, text = curve.loc[best], curve.loc[500]
    return (
        f"Over the {row.dof:.0f} entries outside the Q^μ row the fit is best at {best} episodes "
        f"(chi-square {number(row.chi2)}, {probability(row.p_value)}); at the 500 of the text it "
        f"is {number(text.chi2)} ({probability(text.p_value)}, worst entry {text.worst_z:.0f} "
        "standard errors off)."
    )


@effect_of("3.4.1-other-readings", fit)
def other_readings(table: pd.DataFrame) -> str:
    """The best other readings at 500 episodes."""
    at = table[(table.episodes == 500) & (table.reading != "as fitted")].sort_values("chi2")
    told = several(f"{number(r.chi2)} ({r.reading})" for r in at.itertuples())
    return f"Chi-square at 500 episodes when one other point is varied instead: {told}."


def figure(table: pd.DataFrame, stated: int = 500) -> Figure:
    """Chi-square of every reading over the number of episodes; ``stated`` is the text's."""
    fig, ax = plt.subplots()
    for i, (name, group) in enumerate(table.groupby("reading", sort=False)):
        ax.semilogy(group.episodes, group.chi2, label=name, lw=2.4 if i == 0 else 1.2)
    dof = int(table.dof.iloc[0])
    ax.axhspan(*stats.chi2.ppf([0.025, 0.975], dof), color="#d9d9d9", label="95% if it is right")
    ax.axvline(stated, color=PRINTED, ls=":", label="as the text says")
    low = max(1.0, float(table.chi2.min()) / 2)
    ax.set(xlabel="episodes a run", ylabel=f"chi-square, {dof} entries", ylim=(low, None))
    fig.legend(fontsize=8, loc="outside lower center", ncols=2)
    return fig
