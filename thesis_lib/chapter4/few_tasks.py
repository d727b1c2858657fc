"""Section 4.3.1: whether FS-TEK helps most when few tasks have been seen."""

from __future__ import annotations

import pandas as pd

from thesis_lib.chapter4 import figure_4_3, figure_4_4, figure_4_6
from thesis_lib.chapter4.protocol import gains
from thesis_lib.edition.criteria import judged
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
    best = {where: int(gains(own).fstek_minus.idxmax()) for where, own in settings.items()}
    return judged(
        max(best.values()) <= 6,
        "FS-TEK gains most over no selection after this many tasks: "
        f"{several(f'{n} ({where})' for where, n in best.items())}.",
        best,
        direction=True,
    )
