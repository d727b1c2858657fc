"""FS-TEK as a threshold on an F-ratio: the threshold, and whether it makes the same decisions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.chapter4.random_solutions import noise_to_signal
from thesis_lib.edition.criteria import judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, criterion
from thesis_lib.edition.plots import COLOURS, PRINTED
from thesis_lib.relevance import estimate, remove
from thesis_lib.selection import FSTEK, f_threshold, fit_inverse, fstek_threshold

EVERY = 10**6
"""More combinations than there are: algorithm 8 lists them all, and the curve is fitted as is."""


@dataclass(frozen=True)
class Config:
    """Settings of the threshold curves."""

    tasks_seen: tuple[int, ...] = (*range(4, 21), 25, 30, 31, 32, 35, 40, 50)
    """Numbers of observed tasks."""
    alphas: tuple[float, ...] = (1e-4, 1e-3, 1e-2, 0.1, 0.3)
    """Levels of FS-TEK."""
    checked: tuple[int, ...] = (4, 5, 6, 7, 8, 9, 10)
    """Numbers of tasks at which decisions are compared; all combinations are listed there."""
    domains: int = 100
    """Random domains of three features at each."""


@dataclass(frozen=True)
class Limit:
    """The threshold after one number of tasks at one level."""

    tasks_seen: int
    """Number of observed tasks n."""
    alpha: float
    """Level of FS-TEK."""
    threshold: float
    """F-ratio up to which it removes a feature."""
    calibrated: float
    """F-ratio up to which the jackknife F-test removes one, at 5%."""
    asymptote: float
    """h(n) of the fit to 1/k."""
    standard_error: float
    """sigma(n) of the fit to 1/k."""
    agree: int
    """Decisions of algorithm 7, fitted to sequences listed by algorithm 8, that the threshold
    predicts."""
    removed: int
    """Decisions to remove among them."""
    n_decisions: int
    """Decisions compared."""


@experiment(
    "ch4-threshold",
    item="FS-TEK explained",
    smoke=Config(tasks_seen=(4, 5, 20), alphas=(1e-3,), checked=(4,), domains=3),
    book=Config(),
    thesis=Config(domains=300),
    seconds=6,
)
def limits(config: Config, context: Context) -> list[Limit]:
    """The F-ratio up to which FS-TEK removes a feature, and its decisions beside the rule's."""

    def one(n: int) -> list[Limit]:
        agree, removed, compared = np.zeros((3, len(config.alphas)), dtype=int)
        domains = config.domains if n in config.checked else 0
        for index, seed in enumerate(context.seeds(domains, 9, n)):
            solutions = noise_to_signal(np.random.default_rng(seed), n, index)
            ratios = [estimate(solutions, remove(solutions, [i])).f_ratio for i in range(3)]
            for j, alpha in enumerate(config.alphas):
                for check in FSTEK(alpha, max_seqs=EVERY).fit(solutions).history_[0].checks:
                    goes = ratios[check.feature] <= fstek_threshold(n, alpha)
                    agree[j] += goes == (check.verdict == "remove")
                    removed[j] += check.verdict == "remove"
                    compared[j] += 1
        fit = fit_inverse(n)
        return [
            Limit(
                tasks_seen=n,
                alpha=alpha,
                threshold=fstek_threshold(n, alpha),
                calibrated=f_threshold(n, 0.05),
                asymptote=fit.asymptote,
                standard_error=fit.standard_error,
                agree=int(agree[j]),
                removed=int(removed[j]),
                n_decisions=int(compared[j]),
            )
            for j, alpha in enumerate(config.alphas)
        ]

    return [row for part in context.map(one, config.tasks_seen, "threshold") for row in part]


@criterion("4.1.2-exponential", limits)
def exponential_fits(table: pd.DataFrame) -> Finding:
    """Asymptote of the exponential fitted to the true form 1/k, at 20 tasks."""
    by = table.drop_duplicates("tasks_seen").set_index("tasks_seen").asymptote
    return judged(
        abs(by[20]) <= 0.05,
        "Fitted to U + (b - U)/k, which k-relevance is where tasks share p(x|m), the exponential "
        f"has an asymptote that is off U by {by[5]:+.2f} (b - U) at 5 tasks and by "
        f"{by[20]:+.2f} (b - U) at 20.",
        {"asymptote": float(by[20])},
        direction=abs(by[20]) < abs(by[5]),
    )


def figure(table: pd.DataFrame) -> Figure:
    """FS-TEK's threshold on the F-ratio over the number of tasks, by level."""
    fig, ax = plt.subplots(figsize=(7.2, 3.4))
    for i, (alpha, own) in enumerate(table.groupby("alpha")):
        look: dict[str, Any] = {"color": COLOURS[i], "label": rf"FS-TEK, {alpha:g}"}
        ax.plot(own.tasks_seen, own.threshold, "o-", ms=3, **look)
    one = table.drop_duplicates("tasks_seen")
    ax.plot(one.tasks_seen, one.calibrated, "--", color=PRINTED, label="jackknife F, 5%")
    ax.axhline(0, color="#7f7f7f", lw=1)
    ax.axhline(1, color="#7f7f7f", lw=1, ls=":")
    ax.set(xlabel="observed tasks n", ylabel="largest F-ratio removed")
    ax.set(yscale="symlog", ylim=(-1, 200))
    ax.legend(fontsize=8, ncols=2)
    return fig


def misfit_figure(curve: Sequence[float], fitted: Sequence[float], k: Sequence[float]) -> Figure:
    """The curve 1/k at the numbers of tasks, and the exponential fitted to it, far beyond.

    Parameters
    ----------
    curve
        1/k at k = 1 .. n.
    fitted, k
        The exponential at some k.
    """
    fig, ax = plt.subplots(figsize=(7.2, 3.0))
    ax.plot(np.arange(1, len(curve) + 1), curve, "o", color=COLOURS[0], label="D(k) = 1/k")
    ax.plot(k, fitted, color=COLOURS[1], label="fitted exponential")
    ax.plot(k, 1 / np.asarray(k), ":", color=COLOURS[0], label="the law")
    ax.axhline(0, color=PRINTED, lw=1, label="true limit")
    ax.set(xlabel="k", ylabel="relevance / (b - U)", xlim=(0.5, max(k)))
    ax.legend(fontsize=8)
    return fig
