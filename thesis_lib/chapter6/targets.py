"""Section 6.1: how the three targets of a cross-task shaping function did on the whole."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence

import pandas as pd

from thesis_lib.chapter3 import best_kind, figure_3_1, table_3_1
from thesis_lib.chapter3.runs import LEARNERS, NAMES, SHAPED, at_best, compared
from thesis_lib.edition.criteria import best, no_greater, ordered, positive
from thesis_lib.edition.ledger import Finding, criterion

OTHERS = {name: tuple(other for other in SHAPED if other != name) for name in SHAPED}

DOMAINS = ("episodic cliff", "continuing cliff", "triangle", "stock")
"""As the settings of `best_kind.by_setting` begin."""


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
    """Mean over domains of how much less Q^mu earns than each other, as a share.

    Each domain has its mean over learners, discounts and sizes first, so that one which was run
    in more of them counts no more than another.
    """
    leads: dict[str, dict[str, list[tuple[float, float]]]] = {
        name: defaultdict(list) for name in OTHERS["Q_mu"]
    }
    for where, own in best_kind.by_setting(*tables).items():
        by = own.set_index("potential")
        if "Q_mu" not in by.index:
            continue
        domain = next(name for name in DOMAINS if where.startswith(name))
        size = float(by.mean_return.abs().mean())
        for name, found in leads.items():
            lead = float(by.mean_return[name] - by.mean_return["Q_mu"]) / size
            rows = by.loc[[name, "Q_mu"]]
            found[domain].append((lead, float((rows.sd**2 / rows.n_runs).sum()) / size**2))
    return positive(
        {f"{NAMES[name]} over Q^μ": _lead(found) for name, found in leads.items()},
        f"Mean lead over {len(leads['Q_star'])} domains, each a mean over its learners and "
        "settings, as a share of their mean return",
    )


def _lead(found: Mapping[str, Sequence[tuple[float, float]]]) -> tuple[float, float]:
    """Mean over domains of the mean lead in each, and its standard error."""
    mean, variance = _mean([_mean(own) for own in found.values()])
    return mean, variance**0.5


def _mean(found: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Mean of independent estimates, and its variance from theirs."""
    n = len(found)
    return sum(x for x, _ in found) / n, sum(v for _, v in found) / n**2


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
