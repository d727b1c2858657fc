"""Policy-gradient algorithms with steps from much too short to much too long (section 2.3.5)."""

from __future__ import annotations

from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.chapter2.two_parameters import COLOUR, NAMES, Runs, best_return, expected_return
from thesis_lib.edition.criteria import LEVEL
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.words import number, plus_minus, probability
from thesis_lib.optimisation import TRPO, VPG, NaturalPG
from thesis_lib.optimisation.problem import Algorithm
from thesis_lib.stats import mean_ci, welch

LOST = -1e6
"""A run whose expected return falls below this is given up: its policy drives the state away."""

ENOUGH = 0.9
"""Share of the possible gain in return at which a run counts as arrived."""

MATTERS = 0.01
"""Shares of the possible gain that differ by less count as the same, significant or not."""


@dataclass(frozen=True)
class Config(Runs):
    """Settings of each algorithm, and runs with each."""

    vpg: tuple[float, ...] = (0.0002, 0.001, 0.005, 0.01, 0.02, 0.05, 0.1)
    """Rates alpha of algorithm 5."""
    natural: tuple[float, ...] = (0.01, 0.05, 0.2, 0.5, 1.0, 2.0, 4.0, 8.0)
    """Rates of the natural gradient: one over the price of the divergence."""
    trpo: tuple[float, ...] = (0.0005, 0.005, 0.02, 0.05, 0.2, 0.5, 1.0, 2.0, 5.0)
    """Bounds delta_KL of TRPO [nat]."""
    iterations: int = 30
    """Iterations of each run."""

    def algorithm(self, key: str, setting: float) -> Algorithm:
        """An algorithm of :data:`NAMES` with its one setting."""
        if key == "vpg":
            return VPG(learning_rate=setting)
        return NaturalPG(learning_rate=setting) if key == "natural" else TRPO(delta=setting)


@dataclass(frozen=True)
class Outcome:
    """What becomes of a run with one setting."""

    algorithm: str
    """vpg, natural (fixed rate) or trpo."""
    setting: float
    """Learning rate, or delta_KL [nat]."""
    run: int
    """Number of the run."""
    arrived: float
    """First iteration with 90% of the possible gain in exact return; empty if none."""
    mean_share: float
    """Mean over iterations of the share of the possible gain."""
    last_share: float
    """That share at the end."""
    lowest_share: float
    """The lowest one on the way."""
    lost: bool
    """Whether the run was given up at an expected return below -10^6."""
    iterations: int
    """Iterations a run may take."""


@experiment(
    "ch2-settings",
    item="Section 2.3.5",
    smoke=Config(
        vpg=(0.01, 0.1), natural=(0.2, 1.0), trpo=(0.05,), iterations=2, runs=2, batch_steps=200
    ),
    book=Config(runs=5),
    thesis=Config(),
    seconds=30,
)
def outcomes(config: Config, context: Context) -> list[Outcome]:
    """Policy-gradient algorithms with steps from too short to too long."""
    jobs = [
        (key, setting, run)
        for key in ("vpg", "natural", "trpo")
        for setting in getattr(config, key)
        for run in range(config.runs)
    ]
    first, best = expected_return(*config.start), best_return()

    def learn(job: tuple[str, float, int]) -> Outcome:
        key, setting, run = job
        returns = []
        for old, _, _ in config.updates(config.algorithm(key, setting), context, run):
            returns.append(expected_return(*old))
            if returns[-1] < LOST:
                break
        share = (np.array(returns) - first) / (best - first)
        arrived = np.flatnonzero(share >= ENOUGH)
        return Outcome(
            *(key, setting, run),
            arrived=arrived[0] if len(arrived) else np.nan,
            mean_share=share.mean(),
            last_share=share[-1],
            lowest_share=share.min(),
            lost=bool(returns[-1] < LOST),
            iterations=config.iterations,
        )

    return context.map(learn, jobs, "runs")


def by_setting(table: pd.DataFrame, algorithm: str) -> pd.DataFrame:
    """One row a setting: share of runs that arrive and ``stay``, and that end ``worse``."""
    by = table.assign(
        stay=table.arrived.notna() & (table.last_share >= ENOUGH), worse=table.last_share < 0
    )
    by = by[by.algorithm == algorithm].groupby("setting")
    return by[["stay", "worse", "mean_share"]].mean()


def good_range(table: pd.DataFrame, algorithm: str) -> float:
    """How far apart in length steps may be with which every run arrives and stays.

    A step is as long as the rate of a gradient, and as the root of TRPO's bound; in length
    the ranges of both can be compared.

    Parameters
    ----------
    table
        Of :func:`outcomes`.
    algorithm
        vpg, natural or trpo.

    Returns
    -------
    float
        The longest over the shortest, among the settings tried; NaN when there is none.
    """
    by = by_setting(table.assign(mean_share=0.0), algorithm)
    lengths = by.index[by.stay == 1].to_numpy(dtype=float)
    if len(lengths) == 0:
        return float("nan")
    ratio = float(lengths.max() / lengths.min())
    return ratio**0.5 if algorithm == "trpo" else ratio


@criterion("2.3.5-step-size", outcomes)
def step_size(table: pd.DataFrame) -> Finding:
    """Where vanilla policy gradient ends with its highest, lowest and best rate."""
    by = by_setting(table, "vpg")
    own = table[table.algorithm == "vpg"]
    fallen = own[own.lowest_share < 0]
    stuck = (fallen.last_share < 0).mean() if len(fallen) else 0.0
    low, high, best = by.index.min(), by.index.max(), by.mean_share.idxmax()
    bad, slow = by.worse[high] > 0.5 and stuck > 0.5, by.stay[low] < 0.5
    if bad and slow and by.stay.max() > 0.5:
        verdict = Verdict.REPRODUCED
    else:
        verdict = Verdict.DIRECTION if bad or slow else Verdict.NOT_REPRODUCED
    return Finding(
        verdict,
        f"Of vanilla policy gradient's runs with rate {high:g} {by.worse[high]:.0%} end below "
        f"where they began, with rate {number(low)} {by.stay[low]:.0%} get 90% of the possible "
        f"gain in {own.iterations.iloc[0]} iterations, and with the best rate, {best:g}, "
        f"{by.stay[best]:.0%}. Of the {len(fallen)} runs that ever fell below their start "
        f"{stuck:.0%} end there.",
        {"worse": by.worse[high], "slow": by.stay[low], "stuck": stuck},
    )


def _against(table: pd.DataFrame, other: str) -> Finding:
    """TRPO against another algorithm, each at the setting with the highest mean share."""
    best = {a: float(by_setting(table, a).mean_share.idxmax()) for a in ("trpo", other)}
    trpo, rival = (
        table[(table.algorithm == a) & (table.setting == s)].mean_share for a, s in best.items()
    )
    gap = welch(trpo, rival)
    if gap.p_value < LEVEL and abs(gap.difference) > MATTERS:
        verdict = Verdict.REPRODUCED if gap.difference > 0 else Verdict.REFUTED
    else:
        verdict = Verdict.DIRECTION if gap.difference > 0 else Verdict.NOT_REPRODUCED
    shares = [plus_minus(mean.mean, mean.half_width) for mean in map(mean_ci, (trpo, rival))]
    ranges = [good_range(table, a) for a in best]
    width = [f"a factor {x:.3g}" if np.isfinite(x) else "none" for x in ranges]
    return Finding(
        verdict,
        "Mean share of the possible gain over all iterations, each at its best setting: TRPO "
        f"(bound {best['trpo']:g}) {shares[0]}, {NAMES[other]} (rate {best[other]:g}) {shares[1]} "
        f"(Welch, n = {len(trpo)}, {probability(gap.p_value)}). All runs arrive and stay over "
        f"{width[0]} in the length of TRPO's step, the root of its bound, and {width[1]} in that "
        "of the other's, its rate.",
        {"difference": gap.difference, "p": gap.p_value},
    )


@criterion("2.3.5-penalty", outcomes)
def against_the_natural_gradient(table: pd.DataFrame) -> Finding:
    """TRPO against the natural gradient of fixed rate."""
    return _against(table, "natural")


@criterion("2.3.5-trpo-better", outcomes)
def against_vanilla(table: pd.DataFrame) -> Finding:
    """TRPO against vanilla policy gradient."""
    return _against(table, "vpg")


def figure(table: pd.DataFrame) -> Figure:
    """When each run arrives, by setting; runs that do not are told apart above."""
    limit = table.iterations.iloc[0]
    never, worse = 1.15 * limit, 1.32 * limit
    labels = {"vpg": r"rate $\alpha$", "natural": r"rate $\alpha$", "trpo": r"bound $\delta_{KL}$"}
    fig, axes = plt.subplots(1, len(labels), figsize=(7.2, 3.3), sharey=True)
    for ax, (name, text) in zip(axes, labels.items(), strict=True):
        own = table[table.algorithm == name]
        height = own.arrived.fillna(never).where(~((own.last_share < 0) | own.lost), worse)
        spread = 10 ** (0.02 * (own.run - own.run.mean()))
        ax.semilogx(own.setting * spread, height, "o", ms=3.5, mfc="none", color=COLOUR[name])
        middle = height.groupby(own.setting).median()
        ax.plot(middle.index, middle, color=COLOUR[name], lw=1)
        ax.set(title=NAMES[name].split(",")[0], xlabel=text)
        ax.axhspan(1.07 * limit, 1.4 * limit, color="0.93", zorder=0)
        ax.tick_params(labelsize=8)
    ticks = np.linspace(0, limit, 4).round().astype(int)
    axes[0].set_yticks([*ticks, never, worse], [*map(str, ticks), "not yet", "worse"])
    axes[0].set(ylabel="updates to 90% of the gain", ylim=(0, 1.4 * limit))
    return fig
