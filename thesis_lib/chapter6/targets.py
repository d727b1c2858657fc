"""Section 6.1: how the three targets of a cross-task shaping function did on the whole."""

from __future__ import annotations

import pandas as pd

from thesis_lib.chapter3 import best_kind, figure_3_1, table_3_1
from thesis_lib.chapter3.runs import LEARNERS, NAMES, SHAPED, at_best, compared
from thesis_lib.edition.criteria import best, no_greater, ordered, positive
from thesis_lib.edition.ledger import Finding, criterion

OTHERS = {name: tuple(other for other in SHAPED if other != name) for name in SHAPED}


@criterion("6.1-q-star", *best_kind.TABLES)
def q_star_does_not_outperform(*tables: pd.DataFrame) -> Finding:
    """Q* against the better of the others, on every domain and learner."""
    pairs = []
    for where, own in best_kind.by_setting(*tables).items():
        other = best(own[own.potential != "Q_star"]).potential
        pairs.append(compared(own, "Q_star", other, where))
    return no_greater(pairs, 0.05, choices=len(OTHERS["Q_star"]))


@criterion("6.1-q-tilde", *best_kind.TABLES)
def q_tilde_is_on_par_or_better(*tables: pd.DataFrame) -> Finding:
    """Both others against Q~, on every domain and learner."""
    return no_greater(
        [
            compared(own, other, "Q_tilde", where)
            for where, own in best_kind.by_setting(*tables).items()
            for other in OTHERS["Q_tilde"]
            if other in set(own.potential)
        ],
        0.05,
        tolerant=True,
    )


@criterion("6.1-q-mu-average", *best_kind.TABLES)
def q_mu_does_worse_on_average(*tables: pd.DataFrame) -> Finding:
    """Mean over domains and learners of how much less Q^mu earns than each other, as a share."""
    gaps: dict[str, list[tuple[float, float]]] = {name: [] for name in OTHERS["Q_mu"]}
    for own in best_kind.by_setting(*tables).values():
        by = own.set_index("potential")
        if "Q_mu" not in by.index:
            continue
        size = float(by.mean_return.abs().mean())
        for name, found in gaps.items():
            gap = float(by.mean_return[name] - by.mean_return["Q_mu"]) / size
            rows = by.loc[[name, "Q_mu"]]
            found.append((gap, float((rows.sd**2 / rows.n_runs).sum()) / size**2))
    n = {name: len(found) for name, found in gaps.items()}
    return positive(
        {
            f"{NAMES[name]} over Q^μ": (
                sum(g for g, _ in found) / n[name],
                sum(v for _, v in found) ** 0.5 / n[name],
            )
            for name, found in gaps.items()
        },
        "Mean lead over domains and learners, as a share of their mean return",
    )


@criterion("6.1-q-mu-high-risk", figure_3_1.by_alpha)
def q_mu_does_well_where_risk_is_high(table: pd.DataFrame) -> Finding:
    """Q^mu against no shaping and Q* for Q-learning on the continuing cliff."""
    pairs = []
    for gamma, group in table[table.algorithm == "q_learning"].groupby("discount"):
        at = at_best(group)
        where = f"gamma {gamma:g}"
        pairs += [compared(at, "Q_mu", other, where) for other in ("none", "Q_star")]
    return ordered(pairs, "cumulative reward at the best alphas")


@criterion("6.1-wrong-values", figure_3_1.by_alpha)
def wrong_values_are_detrimental(table: pd.DataFrame) -> Finding:
    """Unshaped Sarsa against Sarsa shaped by what Sarsa has learned, on the continuing cliff."""
    pairs = []
    for gamma, group in table[table.algorithm == "sarsa"].groupby("discount"):
        at = at_best(group)
        pairs.append(compared(at, "none", "Q_tilde_sarsa", f"gamma {gamma:g}"))
    return ordered(pairs, "cumulative reward at the best alphas")


@criterion("6.1-too-optimistic", table_3_1.entries)
def q_star_is_too_optimistic(table: pd.DataFrame) -> Finding:
    """The less optimistic Q~ against Q* on the episodic cliff with sensor, for both learners."""
    own = table[table.sensor]
    pairs = [compared(group, "Q_tilde", "Q_star", LEARNERS[name])
             for name, group in own.groupby("algorithm")]  # fmt: skip
    return ordered(pairs, table_3_1.UNITS)
