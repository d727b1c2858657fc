"""Algorithms 5 and 6 and their neighbours learn a policy with two parameters."""

from __future__ import annotations

from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy import stats

from thesis_lib.chapter2.two_parameters import (
    COLOUR,
    NAMES,
    Rates,
    Runs,
    best_return,
    expected_divergence,
    expected_return,
)
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion, effect_of
from thesis_lib.edition.plots import PRINTED
from thesis_lib.edition.words import several


@dataclass(frozen=True)
class Config(Rates, Runs):
    """Rates of the algorithms, and runs of each."""


@dataclass(frozen=True)
class Policy:
    """A policy on the way, exactly judged, and the update that follows it."""

    algorithm: str
    """A key of NAMES."""
    run: int
    """Number of the run; its noise is the same for all algorithms at the start."""
    iteration: int
    """Updates made so far."""
    expected_return: float
    """Exact undiscounted return of the policy."""
    best_return: float
    """The same of the best linear policy without noise."""
    gain: float
    """k."""
    log_std: float
    """log sigma."""
    kl_sampled: float
    """Divergence of the next update on its own batch, old from new [nat]."""
    kl_exact: float
    """The same in expectation over the old policy's states [nat]."""
    backtracks: float
    """Times the line search shortened the next update."""
    delta_kl: float
    """The bound [nat]."""


@experiment(
    "ch2-learning",
    item="Algorithms 5 and 6",
    smoke=Config(iterations=3, runs=2, batch_steps=200),
    book=Config(runs=6),
    thesis=Config(),
    seconds=18,
)
def curves(config: Config, context: Context) -> list[Policy]:
    """Policy-gradient algorithms on a linear-quadratic task: return, and divergence made."""
    jobs = [(key, run) for key in NAMES for run in range(config.runs)]
    best = best_return()

    def learn(job: tuple[str, int]) -> list[Policy]:
        key, run = job
        updates = config.updates(config.algorithms(run)[key], context, run)
        return [
            Policy(
                *(key, run, iteration),
                expected_return=expected_return(*old),
                best_return=best,
                gain=old[0],
                log_std=old[1],
                kl_sampled=np.nan if report is None else report.kl,
                kl_exact=np.nan if report is None else expected_divergence(old, new),
                backtracks=np.nan if report is None else report.backtracks,
                delta_kl=config.delta_kl,
            )
            for iteration, (old, report, new) in enumerate(updates)
        ]

    return [policy for run in context.map(learn, jobs, "runs") for policy in run]


def updates_made(table: pd.DataFrame) -> pd.DataFrame:
    """Every update, with ``reach`` and ``exact_reach``: its divergence over the bound."""
    made = table.dropna(subset="kl_sampled")
    return made.assign(
        reach=made.kl_sampled / made.delta_kl, exact_reach=made.kl_exact / made.delta_kl
    )


@criterion("2.3.5-hard-constraint", curves)
def hard_constraint(table: pd.DataFrame) -> Finding:
    """Divergence of TRPO's updates on their batches, over the bound."""
    made = updates_made(table)
    reach = made.groupby("algorithm").reach
    trpo = made[made.algorithm == "trpo"]
    highest = reach.max()
    others = several(f"{NAMES[a]} {x:.3g}" for a, x in highest.items() if a != "trpo")
    return Finding(
        Verdict.REPRODUCED if highest["trpo"] <= 1 + 1e-9 else Verdict.REFUTED,
        f"On its batch TRPO reaches at most {highest['trpo']:.3f} of the bound, "
        f"{reach.median()['trpo']:.2f} of it in the median of {len(trpo)} updates; the largest of "
        f"the others: {others}. In expectation over the states rather than on the batch TRPO is "
        f"above the bound in {(trpo.exact_reach > 1).mean():.0%} of its updates, by at most a "
        f"factor {trpo.exact_reach.max():.3f}.",
        {"reach": highest["trpo"], "exact_reach": trpo.exact_reach.max()},
    )


@effect_of("2.3.5-line-search", curves)
def line_search(table: pd.DataFrame) -> str:
    """How far updates without a line search pass the bound, and how often it shortens one."""
    made = updates_made(table)
    free, held = (made[made.algorithm == a] for a in ("natural_delta", "trpo"))
    return (
        f"Without the search {(free.reach > 1).mean():.0%} of updates pass the bound on their own "
        f"batch, the furthest by a factor {free.reach.max():.2f}; with it "
        f"{(held.backtracks > 0).mean():.0%} of updates are shortened, at most "
        f"{held.backtracks.max():.0f} times."
    )


def figure(table: pd.DataFrame) -> Figure:
    """What is left of the possible gain, and the divergence of every update."""
    first = table[table.iteration == 0].expected_return.iloc[0]
    gain = table.best_return - first
    table = table.assign(left=(table.best_return - table.expected_return) / gain)
    last, bound = table.iteration.max(), table.delta_kl.iloc[0]
    fig, (left, right) = plt.subplots(1, 2, figsize=(7.2, 4.0))
    for name, own in table.groupby("algorithm", sort=False):
        colour = COLOUR[str(name)]
        by = own.groupby("iteration").left
        mean, half = by.mean(), by.sem() * stats.t.ppf(0.975, by.count() - 1)
        left.semilogy(mean.index, mean, color=colour, label=NAMES[str(name)])
        left.fill_between(mean.index, mean - half, mean + half, color=colour, alpha=0.2, lw=0)
        made = own.dropna(subset="kl_sampled").groupby("iteration").kl_sampled
        right.semilogy(made.median().index + 1, made.median(), color=colour)
        low, high = made.min(), made.max()
        right.fill_between(low.index + 1, low, high, color=colour, alpha=0.15, lw=0)
    right.axhline(bound, xmax=0.95, color=PRINTED, lw=1.2, ls="--")
    right.text(1.02 * last, bound, r"$\delta_{KL}$", va="center", fontsize=10)
    right.set(xlabel="update", ylabel="divergence on its batch [nat]")
    right.set(xlim=(0, 1.1 * last), ylim=(1e-4, 10))
    left.set(xlabel="updates made", ylabel="share of the possible gain left", ylim=(1e-4, 1.5))
    fig.legend(loc="outside lower center", ncols=3, fontsize=9)
    return fig
