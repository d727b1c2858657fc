"""Section 3.6: whether one kind of potential is best everywhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from thesis_lib.chapter3 import figure_3_1, figure_3_3, figure_3_4, table_3_1
from thesis_lib.chapter3.runs import LEARNERS, NAMES, SHAPED, at_best, compared
from thesis_lib.edition.criteria import (
    LEVEL,
    Pair,
    equivalent,
    graded,
    judged,
    no_greater,
    summary,
)
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.stats import holm, welch

TABLES = (table_3_1.entries, figure_3_1.by_alpha, figure_3_3.by_alpha, figure_3_4.by_alpha)
"""Returns with every potential, on every domain of the chapter."""

NEAR = 0.05
"""Largest difference of returns that counts as none, as a share of the return."""


def by_setting(
    cliff: pd.DataFrame, continuing: pd.DataFrame, triangle: pd.DataFrame, stock: pd.DataFrame
) -> dict[str, pd.DataFrame]:
    """The thesis's three potentials at their best settings, by domain and learner."""
    settings = {
        f"episodic cliff {'with' if sensor else 'without'} sensor, {LEARNERS[algorithm]}": own
        for (sensor, algorithm), own in cliff.groupby(["sensor", "algorithm"])
    }
    for (gamma, algorithm), own in continuing.groupby(["discount", "algorithm"]):
        settings[f"continuing cliff, gamma {gamma:g}, {LEARNERS[algorithm]}"] = at_best(own)
    settings["triangle"] = at_best(triangle[triangle.epsilon == triangle.epsilon.min()])
    for stocks, where in figure_3_4.SIZES.items():
        settings[f"stock, {where}"] = at_best(figure_3_4.of_size(stock, stocks))
    return {where: own[own.potential.isin(SHAPED)] for where, own in settings.items()}


@criterion("3.6-best-kind-depends", *TABLES)
def best_kind_depends(
    cliff: pd.DataFrame, continuing: pd.DataFrame, triangle: pd.DataFrame, stock: pd.DataFrame
) -> Finding:
    """Which of the three potentials is best, by domain and learner."""
    told, p = [], []
    settings = by_setting(cliff, continuing, triangle, stock)
    for where, own in settings.items():
        ranked = own.set_index("potential").sort_values("mean_return", ascending=False)
        first, second = (summary(row) for _, row in ranked.iloc[:2].iterrows())
        # The best is chosen after looking: of three, either of the others might have been.
        p.append(min(1.0, 3 * welch(first, second).p_value))
        told.append((where, NAMES[ranked.index[0]]))
    adjusted = holm(p)
    sure = {name for (_, name), q in zip(told, adjusted, strict=True) if q < LEVEL}
    words = (
        f"{where}: {name}{' (significantly)' if q < LEVEL else ''}"
        for (where, name), q in zip(told, adjusted, strict=True)
    )
    kinds = len({name for _, name in told})
    one = [NAMES[kind] for kind in SHAPED if _nowhere_behind(settings, kind)]
    otherwise = Verdict.NOT_REPRODUCED if one else Verdict.INCONCLUSIVE
    return Finding(
        graded(len(sure) > 1, direction=kinds > 1 and sure, otherwise=otherwise),
        f"Best of the three, each at its best setting (Welch against the second, Holm): "
        f"{'; '.join(words)}; shown to be at most {NEAR:.0%} behind everywhere: "
        f"{' and '.join(one) or 'none'}.",
        {"kinds": kinds, "significant": len(sure)},
    )


def _nowhere_behind(settings: Mapping[str, pd.DataFrame], kind: str) -> bool:
    """Whether no other potential is more than a margin ahead of one kind, in any setting."""
    pairs = [
        compared(own, other, kind, where)
        for where, own in settings.items()
        for other in SHAPED
        if other != kind and {other, kind} <= set(own.potential)
    ]
    return no_greater(pairs, NEAR).verdict is Verdict.REPRODUCED


@criterion("3.6-average-not-always-best", *TABLES)
def q_star_is_not_always_best(
    cliff: pd.DataFrame, continuing: pd.DataFrame, triangle: pd.DataFrame, stock: pd.DataFrame
) -> Finding:
    """Either other potential against Q*, on every domain and for every learner."""
    pairs = [
        compared(own, other, "Q_star", where)
        for where, own in by_setting(cliff, continuing, triangle, stock).items()
        for other in SHAPED
        if other != "Q_star" and other in set(own.potential)
    ]
    tests = [welch(p.first, p.second) for p in pairs]
    adjusted = holm([t.p_value for t in tests])
    sure = [q < LEVEL for q in adjusted]
    ahead = [t.difference > 0 for t in tests]
    beaten = sum(s and a for s, a in zip(sure, ahead, strict=True))
    behind = sum(sure) - beaten
    clearest = max(
        range(len(pairs)), key=lambda i: tests[i].difference / (tests[i].high - tests[i].low)
    )
    return judged(
        beaten,
        f"Another potential earns significantly more than Q* in {beaten} of {len(pairs)} "
        f"comparisons, and significantly less in {behind} (Welch, Holm); where Q* does worst, "
        f"{pairs[clearest]}.",
        {"beaten": beaten, "behind": behind},
        otherwise=Verdict.REFUTED if behind == len(pairs) else Verdict.INCONCLUSIVE,
    )


@criterion("3.6-tilde-in-two-of-three", *TABLES)
def q_tilde_helps_more_in_two_domains(
    cliff: pd.DataFrame, continuing: pd.DataFrame, triangle: pd.DataFrame, stock: pd.DataFrame
) -> Finding:
    """Q~ against Q* for a Q-learner, on each domain of the chapter, for both E of stock."""
    settings = by_setting(cliff, continuing, triangle, stock)
    parts, told = {}, dict[str, None]()
    for where in figure_3_4.SIZES.values():
        at = {
            "cliff": settings["episodic cliff without sensor, Q-learning"],
            "triangle": settings["triangle"],
            f"stock ({where})": settings[f"stock, {where}"],
        }
        pairs = [compared(own, "Q_tilde", "Q_star", name) for name, own in at.items()]
        parts[where] = _of_three(pairs)
        told |= dict.fromkeys(map(str, pairs))
    verdicts = {verdict for verdict, _ in parts.values()}
    more = {where: n for where, (_, n) in parts.items()}
    counted = " and ".join(f"{n or 'none'} with {where}" for where, n in more.items())
    return Finding(
        verdicts.pop() if len(verdicts) == 1 else Verdict.INCONCLUSIVE,
        f"Of the three domains Q~ helps significantly more than Q* in {counted} (Welch, Holm): "
        f"{'; '.join(told)}.",
        more,
    )


def _of_three(pairs: Sequence[Pair]) -> tuple[Verdict, int]:
    """Whether the first is significantly greater in two of three pairs and equivalent in one.

    And in how many it is.
    """
    tests = [welch(p.first, p.second) for p in pairs]
    more = [t.difference > 0 and q < LEVEL
            for t, q in zip(tests, holm([t.p_value for t in tests]), strict=True)]  # fmt: skip
    rest = [p for p, m in zip(pairs, more, strict=True) if not m]
    alike = bool(rest) and equivalent(rest, NEAR).verdict is Verdict.REPRODUCED
    # Where two are alike or the other way, two of three cannot be more, whatever the third is.
    less = sum(equivalent([p], NEAR).verdict is Verdict.REPRODUCED or t.high < 0
               for p, t in zip(pairs, tests, strict=True))  # fmt: skip
    otherwise = Verdict.NOT_REPRODUCED if less >= 2 else Verdict.INCONCLUSIVE
    holds = sum(more) == 2 and alike
    return graded(holds, direction=any(more) and less < 2, otherwise=otherwise), sum(more)
