"""Section 3.6: whether one kind of potential is best everywhere."""

from __future__ import annotations

import pandas as pd

from thesis_lib.chapter3 import figure_3_1, figure_3_3, figure_3_4, table_3_1
from thesis_lib.chapter3.runs import LEARNERS, NAMES, SHAPED
from thesis_lib.edition.criteria import best
from thesis_lib.edition.ledger import Finding, Verdict, criterion


@criterion(
    "3.6-best-kind-depends",
    *(table_3_1.entries, figure_3_1.by_alpha, figure_3_3.by_alpha, figure_3_4.by_alpha),
)
def best_kind_depends(
    cliff: pd.DataFrame, continuing: pd.DataFrame, triangle: pd.DataFrame, stock: pd.DataFrame
) -> Finding:
    """Which of the three potentials is best, by domain and learner."""
    settings = {
        f"episodic cliff {'with' if sensor else 'without'} sensor, {LEARNERS[algorithm]}": own
        for (sensor, algorithm), own in cliff.groupby(["sensor", "algorithm"])
    }
    settings |= {"triangle": triangle, "stock": figure_3_4.two_stocks(stock)}
    for algorithm, own in continuing.groupby("algorithm"):
        settings[f"continuing cliff, {LEARNERS[algorithm]}"] = own
    top = {
        where: NAMES[best(own[own.potential.isin(SHAPED)]).potential]
        for where, own in settings.items()
    }
    kinds = len(set(top.values()))
    return Finding(
        Verdict.REPRODUCED if kinds > 1 else Verdict.NOT_REPRODUCED,
        f"Highest mean: {'; '.join(f'{where}: {name}' for where, name in top.items())}.",
        {"kinds": kinds},
    )
