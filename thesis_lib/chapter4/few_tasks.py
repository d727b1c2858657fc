"""Section 4.3.1: whether FS-TEK helps most when few tasks were seen, and what IBKR removes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from thesis_lib.chapter4 import figure_4_3, figure_4_4, figure_4_6
from thesis_lib.chapter4.protocol import FEW, gains, wider
from thesis_lib.edition.criteria import graded, positive
from thesis_lib.edition.ledger import Finding, Verdict, criterion
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
    by = {where: gains(own) for where, own in settings.items()}
    verdict, best, fall, rise = most_after_few(by)
    return Finding(
        verdict,
        "FS-TEK gains most over no selection after this many tasks: "
        f"{several(f'{n} ({where})' for where, n in best.items())}; significantly more than after "
        f"the most in {fall} of {len(best)} (corrected for the choice of the most), and "
        f"significantly more after some number above {FEW} than after each up to it in {rise}.",
        best,
    )


def most_after_few(by: Mapping[Any, pd.DataFrame]) -> tuple[Verdict, dict[Any, int], int, int]:
    """Whether FS-TEK gains most after few tasks in every setting.

    Parameters
    ----------
    by
        Gains by number of tasks, from :func:`~thesis_lib.chapter4.protocol.gains`, by setting.

    Returns
    -------
    tuple
        The verdict; after how many tasks the gain is the largest, by setting; in how many settings
        it falls from there to the last (:func:`falls_to_the_last`), and rises again
        (:func:`rise_after_few`).
    """
    best = {where: int(at.fstek_minus.idxmax()) for where, at in by.items()}
    falls = [falls_to_the_last(by[where], n) for where, n in best.items()]
    rises = rise_after_few(list(by.values()))
    few = max(best.values()) <= FEW
    verdict = graded(
        few and all(falls), direction=few, denied=any(rises), otherwise=Verdict.INCONCLUSIVE
    )
    return verdict, best, sum(falls), sum(rises)


def falls_to_the_last(by: pd.DataFrame, n: int) -> bool:
    """Whether the gain after n tasks, chosen as the largest, is above that after the most.

    Numbers of tasks share runs, and the two may go together in any way: their half-widths add up.
    Bonferroni over the numbers n was chosen from.
    """
    at, last = by.loc[n], by.iloc[-1]
    half = wider(len(by) - 1) * (at.fstek_minus_ci95 + last.fstek_minus_ci95)
    return bool(at.fstek_minus - last.fstek_minus > half)


def rise_after_few(settings: Sequence[pd.DataFrame]) -> list[bool]:
    """Whether a gain after more than few tasks is above that after each few, by setting.

    By intervals as of :func:`falls_to_the_last`; Bonferroni over all numbers of more than few
    tasks, of which any will do.

    Parameters
    ----------
    settings
        Gains by number of tasks, from :func:`~thesis_lib.chapter4.protocol.gains`.
    """
    choices = sum(int((by.index > FEW).sum()) for by in settings)
    found = []
    for by in settings:
        few, more = by[by.index <= FEW], by[by.index > FEW]
        gap = np.subtract.outer(more.fstek_minus.to_numpy(), few.fstek_minus.to_numpy())
        half = np.add.outer(more.fstek_minus_ci95.to_numpy(), few.fstek_minus_ci95.to_numpy())
        found.append(bool((gap > wider(choices) * half).all(axis=1).any()))
    return found


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
