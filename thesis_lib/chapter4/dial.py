"""Section 4.3.1: the level as a dial between few false positives and many true positives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any, get_args

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.stats import norm

from thesis_lib.chapter4 import looks
from thesis_lib.chapter4.looks import SYMBOLS
from thesis_lib.chapter4.protocol import Flat
from thesis_lib.chapter4.roc import labelled
from thesis_lib.chapter4.runs import Placed, place
from thesis_lib.edition.criteria import LEVEL, graded
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.plots import legend_of, panels
from thesis_lib.selection import FSTEK, JackknifeF, Selector, fstek_threshold

DOMAINS: Mapping[str, Flat] = {
    "triangle": "unsure",
    "cliff": "unsure",
    "stock G=1": "limit",
    "stock G=3": "limit",
}
"""Domains of section 4.3, and what FS-TEK makes of a constant relevance there."""

SELECTORS: Mapping[tuple[str, str], Callable[[float], Selector]] = {
    **{("fs-tek", flat): partial(FSTEK, flat=flat) for flat in get_args(Flat)},
    ("jackknife", ""): JackknifeF,
}
"""Selectors with a level, and what a constant relevance is to them."""

LOW, HIGH = 0.1, 0.95
"""A false positive rate that is low, and a true positive rate that is high."""


@dataclass(frozen=True)
class Config:
    """Which levels are tried, and where."""

    levels: tuple[float, ...] = (1e-8, 1e-6, 1e-4, 1e-3, 1e-2, 0.05, 0.2, 0.5, 0.9)
    """Each in (0, 1)."""
    tasks_seen: int = 5
    """Number of observed tasks; at least 4 for FS-TEK's interval."""
    domains: tuple[str, ...] = tuple(DOMAINS)
    """Domains."""
    runs: int = 100
    """Sequences of tasks a domain."""


@dataclass(frozen=True)
class Dialled(Placed):
    """One selector at one level on one domain."""

    domain: str
    """Name."""
    method: str
    """fs-tek or jackknife."""
    flat: str
    """What a constant relevance is to FS-TEK: unsure or limit; empty for the jackknife."""
    level: float
    """Its alpha."""
    unsure: float
    """Share of the domain-irrelevant features kept for want of a fit, over all runs."""


@experiment(
    "ch4-dial",
    item="Section 4.3.1 (level)",
    smoke=Config(levels=(1e-4, 0.5), domains=("triangle",), runs=2),
    book=Config(),
    thesis=Config(runs=500),
    seconds=12,
)
def dial(config: Config, context: Context) -> list[Dialled]:
    """False and true positive rates of FS-TEK and the jackknife F over their level."""

    def one(name: str) -> list[Dialled]:
        solutions, truth = labelled(name)
        made = [
            (method, flat, level, make(level))
            for ((method, flat), make), level in product(SELECTORS.items(), config.levels)
        ]
        support = np.empty((len(made), config.runs, len(truth)), dtype=bool)
        unsure = np.zeros_like(support)
        seeds = context.seeds(config.runs, 45, tuple(DOMAINS).index(name))
        for r, seed in enumerate(seeds):
            tasks = np.random.default_rng(seed).integers(solutions.n_tasks, size=config.tasks_seen)
            seen = solutions.take(tasks)
            for i, (*_, selector) in enumerate(made):
                support[i, r] = selector.fit(seen).support_
                unsure[i, r] = seen.mask(getattr(selector, "unsure_", ()))
        return [
            Dialled(
                domain=name,
                method=method,
                flat=flat,
                level=level,
                tasks_seen=config.tasks_seen,
                unsure=float(unsure[i][:, ~truth].mean()),
                **place(support[i], truth),
            )
            for i, (method, flat, level, _) in enumerate(made)
        ]

    return [row for part in context.map(one, config.domains, "dial") for row in part]


def _ends(own: pd.DataFrame, wider: float) -> tuple[bool, bool]:
    """Whether some level has a low false, and some a high true positive rate.

    A selector that keeps or removes at random has them too: the true positive rate must exceed the
    false one.  ``wider`` multiplies the 95% intervals; with 0 the estimates themselves count.
    """
    apart = own.tpr - own.fpr > wider * np.hypot(own.tpr_ci95, own.fpr_ci95)
    low = apart & (own.fpr + wider * own.fpr_ci95 <= LOW)
    high = apart & (own.tpr - wider * own.tpr_ci95 >= HIGH)
    return bool(low.any()), bool(high.any())


def as_read(table: pd.DataFrame) -> pd.DataFrame:
    """The rows in which a constant relevance is to FS-TEK what :data:`DOMAINS` says."""
    return table[(table.flat == "") | (table.flat == table.domain.map(DOMAINS))]


@criterion("4.3.1-tuned", dial)
def level_tunes_the_rates(table: pd.DataFrame) -> Finding:
    """Whether FS-TEK's level reaches a low FPR and a high TPR, by domain and reading."""
    fstek = table[table.method == "fs-tek"]
    wider = norm.isf(LEVEL / 2 / fstek.level.nunique()) / norm.isf(LEVEL / 2)
    told, besides, surely, nearly, never = [], [], [], [], []
    for domain, both in fstek.groupby("domain", sort=False):
        own = both[both.flat == DOMAINS[str(domain)]]
        other = both[both.flat != DOMAINS[str(domain)]]
        surely.append(all(_ends(own, wider)))
        nearly.append(all(_ends(own, 0.0)))
        # Not even where its intervals end, at any level, whatever a constant relevance is.
        never.append(not any(all(_ends(read, -wider)) for _, read in both.groupby("flat")))
        told.append(f"{domain} {_span(own)}")
        besides.append((f"{domain} {_span(other)}", all(_ends(other, wider))))
    shown = sum(sure for _, sure in besides)
    return Finding(
        graded(
            all(surely),
            direction=all(nearly),
            denied=any(never),
            otherwise=Verdict.NOT_REPRODUCED,
        ),
        f"FPR/TPR after {fstek.tasks_seen.iloc[0]} tasks from level {fstek.level.min():g} to "
        f"{fstek.level.max():g}: {'; '.join(told)}. Levels with a low FPR and with a high TPR, "
        f"each above chance, are shown on {sum(surely)} of {len(told)} domains (Bonferroni). With "
        "the other reading of a constant relevance, a limit on triangle and cliff and unsure on "
        f"stock: {'; '.join(span for span, _ in besides)}, shown on {shown}; on {sum(never)} "
        "neither reading's intervals reach both.",
        {"shown": sum(surely), "other": shown, "denied": sum(never)},
    )


def _span(own: pd.DataFrame) -> str:
    """Rates at the strictest and at the laxest level."""
    strict, lax = own.loc[own.level.idxmin()], own.loc[own.level.idxmax()]
    return f"{strict.fpr:.2f}/{strict.tpr:.2f} to {lax.fpr:.2f}/{lax.tpr:.2f}"


@criterion("4.5-alpha", dial)
def level_trades_the_rates(table: pd.DataFrame) -> Finding:
    """Whether FPR rises and TPR falls from FS-TEK's strictest to its laxest level, by domain."""
    fstek = as_read(table)
    fstek = fstek[fstek.method == "fs-tek"].sort_values("level")
    rates = ("fpr", "tpr")
    by = [(str(domain), own) for domain, own in fstek.groupby("domain", sort=False)]
    wider = norm.isf(LEVEL / 2 / len(rates) / len(by)) / norm.isf(LEVEL / 2)
    change = pd.DataFrame({d: own[[*rates]].iloc[-1] - own[[*rates]].iloc[0] for d, own in by}).T
    half = pd.DataFrame(
        {d: {r: wider * np.hypot(*own[f"{r}_ci95"].iloc[[0, -1]]) for r in rates} for d, own in by}
    ).T
    up, down = change > half, change < -half
    n, levels = int(fstek.tasks_seen.iloc[0]), sorted(fstek.level.unique())
    threshold = [fstek_threshold(n, level) for level in levels]
    falls = bool((np.diff(threshold) < 0).all())
    told = "; ".join(
        f"{d} {change.fpr[d]:+.2f} ± {half.fpr[d]:.2f} and {change.tpr[d]:+.2f} ± {half.tpr[d]:.2f}"
        for d in change.index
    )
    return Finding(
        graded(
            up.fpr.mean() > 0.5 and down.tpr.mean() > 0.5,
            denied=(up.fpr & up.tpr).any() and not down.tpr.any(),
            otherwise=Verdict.INCONCLUSIVE,
        ),
        f"From level {levels[0]:g} to {levels[-1]:g} after {n} tasks FPR and TPR change by (95%, "
        f"Bonferroni): {told}. FPR rises significantly on {up.fpr.sum()} of {len(by)} domains; TPR "
        f"falls significantly on {down.tpr.sum()} and rises on {up.tpr.sum()}. Where tasks share "
        f"p(x|m) the threshold on the F-ratio {'falls' if falls else 'does not fall'} from level "
        "to level; where it falls, fewer features of every kind are removed.",
        {"fall": int(down.tpr.sum()), "rise": int(up.tpr.sum()), "falls": float(falls)},
    )


def figure(table: pd.DataFrame) -> Figure:
    """ROC curves over the level, a panel a domain; FS-TEK's printed 1e-4 is marked."""
    table = as_read(table)
    domains = table.domain.unique()
    fig, axes = panels(len(domains), len(domains), 2.6, sharex=True, sharey=True)
    for ax, domain in zip(axes, domains, strict=True):
        for method, own in table[table.domain == domain].groupby("method", sort=False):
            name = str(method)
            own = own.sort_values("level")
            look: dict[str, Any] = {"color": looks.COLOUR[name], "marker": looks.MARKER[name]}
            ax.plot(own.fpr, own.tpr, ms=3, lw=1, label=SYMBOLS[name], **look)
            if name == "fs-tek":
                at = own[np.isclose(own.level, 1e-4)]
                ax.plot(at.fpr, at.tpr, "o", ms=9, mfc="none", color=looks.PRINTED, ls="none",
                        label="FS-TEK at 1e-4")  # fmt: skip
        ax.plot([0, 1], [0, 1], lw=0.6, ls=":", color=looks.PRINTED)
        ax.set_title(domain, fontsize=8)
        ax.set(xlim=(-0.04, 1.06), ylim=(-0.04, 1.08))
        ax.set_xlabel("false positive rate", fontsize=8)
    axes[0].set_ylabel("true positive rate", fontsize=8)
    legend_of(axes[0], 3, fontsize=8)
    return fig
