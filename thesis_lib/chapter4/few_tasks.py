"""Section 4.3.1: whether FS-TEK helps most when few tasks were seen, and what IBKR removes."""

from __future__ import annotations

import numpy as np
import pandas as pd

from thesis_lib.chapter4 import figure_4_3, figure_4_4, figure_4_6
from thesis_lib.chapter4.protocol import FEW, gains, wider
from thesis_lib.edition.criteria import judged, positive
from thesis_lib.edition.ledger import Finding, criterion
from thesis_lib.edition.words import several


@criterion(
    "4.3.1-few-tasks",
    *(figure_4_3.by_method, figure_4_4.with_q_star, figure_4_4.with_q_tilde),
    figure_4_6.by_factors,
)
def helps_most_when_few(
    triangle: pd.DataFrame, star: pd.DataFrame, tilde: pd.DataFrame, stock: pd.DataFrame
) -> Finding:
    """Number of tasks at which FS-TEK gains most over no selection, by domain."""
    settings = {"triangle": triangle, "cliff, Q*": star, "cliff, Q~": tilde}
    low = stock[stock.global_factors < 4]
    settings |= {f"stock G = {g}": own for g, own in low.groupby("global_factors")}
    best, falls = {}, []
    for where, own in settings.items():
        by = gains(own)
        best[where] = n = int(by.fstek_minus.idxmax())
        falls.append(falls_to_the_last(by, n))
    few = max(best.values()) <= FEW
    return judged(
        few and all(falls),
        "FS-TEK gains most over no selection after this many tasks: "
        f"{several(f'{n} ({where})' for where, n in best.items())}; significantly more than after "
        f"the most in {sum(falls)} of {len(falls)} (corrected for the choice of the most).",
        best,
        direction=few,
    )


def falls_to_the_last(by: pd.DataFrame, n: int) -> bool:
    """Whether the gain after n tasks, chosen as the largest, is above that after the most.

    As if the two were independent, which numbers of tasks that share runs are not: the interval
    is the wider for it.  Bonferroni over the numbers n was chosen from.
    """
    at, last = by.loc[n], by.iloc[-1]
    half = wider(len(by) - 1) * np.hypot(at.fstek_minus_ci95, last.fstek_minus_ci95)
    return bool(at.fstek_minus - last.fstek_minus > half)


@criterion("4.3.1-ibkr-filters", figure_4_3.by_method, figure_4_6.by_factors)
def ibkr_filters_out_less(triangle: pd.DataFrame, stock: pd.DataFrame) -> Finding:
    """IBKR's false positive rate less FS-TEK's, mean over the numbers of tasks from three on."""
    tables = {"triangle": triangle}
    tables |= {f"stock G = {g}": own for g, own in stock.groupby("global_factors")}
    contrasts, kept = {}, {}
    for where, table in tables.items():
        own = table[table.tasks_seen >= 3].set_index("tasks_seen")
        first, second = (own[own.method == method] for method in ("ibkr", "fs-tek"))
        # At most the variance of a share, for the features of a run may go together; numbers of
        # tasks share runs, so that their errors are averaged.
        variance = sum(t.fpr * (1 - t.fpr) / t.n_runs for t in (first, second))
        error = float((variance**0.5).mean())
        contrasts[where] = (float((first.fpr - second.fpr).mean()), error)
        kept[where] = float((first.tpr - second.tpr).mean())
    found = positive(
        contrasts, "IBKR's false positive rate less FS-TEK's, mean over the tasks seen"
    )
    beside = several(f"{gap:+.2f} ({where})" for where, gap in kept.items())
    evidence = f"{found.evidence} Its true positive rate less FS-TEK's: {beside}."
    return Finding(found.verdict, evidence, found.numbers)
