"""The shapes of criteria: each takes numbers and returns a verdict with its evidence.

The evidence is written from the numbers that gave the verdict, so that it can state no outcome
they do not have.  A criterion that fits no shape is a function of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy import stats as distributions

from thesis_lib.edition.ledger import Finding, Verdict
from thesis_lib.edition.words import number, plus_minus, probability, several, span
from thesis_lib.stats import Summary, chi_square, equivalence, holm, least_power, welch

LEVEL = 0.05
"""Significance below which a difference counts."""

EXACT = 1e-9
"""Difference, often relative, below which results in double precision count as equal."""


@dataclass(frozen=True)
class Pair:
    """Two results compared.

    Attributes
    ----------
    first, second
        Means over runs; the claim says that the first is the greater, or that they are alike.
    names
        What the two are called.
    where
        In which setting, such as ``without sensor``; may be empty.
    """

    first: Summary
    second: Summary
    names: tuple[str, str]
    where: str = ""

    def __str__(self) -> str:
        first, second = (plus_minus(s.mean, _half(s)) for s in (self.first, self.second))
        where = f"{self.where}: " if self.where else ""
        return f"{where}{self.names[0]} {first}, {self.names[1]} {second}"


def summary(row: pd.Series) -> Summary:
    """A row's ``mean_return``, ``sd`` and ``n_runs``."""
    return Summary(float(row.mean_return), float(row.sd), int(row.n_runs))


def best(table: pd.DataFrame) -> pd.Series:
    """The row with the highest ``mean_return``."""
    return table.loc[table.mean_return.idxmax()]


def _half(of: Summary) -> float:
    return float(distributions.t.ppf(0.975, of.n - 1)) * of.sd / of.n**0.5


def graded(
    holds: object,
    direction: object = False,
    denied: object = False,
    otherwise: Verdict = Verdict.NOT_REPRODUCED,
) -> Verdict:
    """Reproduced; or else refuted, right in direction, or ``otherwise``.

    Parameters
    ----------
    holds, direction, denied
        Whether the numbers show it, at least go its way, or show the contrary.
    """
    if holds:
        return Verdict.REPRODUCED
    if denied:
        return Verdict.REFUTED
    return Verdict.DIRECTION if direction else otherwise


def judged(
    holds: object,
    evidence: str,
    numbers: Mapping[str, float] | None = None,
    *,
    direction: object = False,
    otherwise: Verdict = Verdict.NOT_REPRODUCED,
) -> Finding:
    """A finding that fits no other shape.

    Parameters
    ----------
    holds
        Whether the criterion does: then the claim is reproduced.
    evidence
        A sentence that is true whether it does or not.
    numbers
        That decided, by name.
    direction, otherwise
        See :func:`graded`.
    """
    return Finding(graded(holds, direction, otherwise=otherwise), evidence, numbers or {})


def ordered(pairs: Sequence[Pair], unit: str = "") -> Finding:
    """Whether every first is the greater: Welch's tests with Holm's correction.

    Reproduced when all are, significantly; refuted when one is significantly the lesser; right
    in direction only when all are greater and some not significantly; else inconclusive.

    Parameters
    ----------
    pairs
        At least one.
    unit
        What the numbers are, such as ``total reward in units of 10⁴``.
    """
    tests = [welch(p.first, p.second) for p in pairs]
    adjusted = holm([t.p_value for t in tests])
    right = [t.difference > 0 for t in tests]
    sure = [p < LEVEL for p in adjusted]
    wrong = sum(s and not r for r, s in zip(right, sure, strict=True))
    if wrong:
        verdict = Verdict.REFUTED
        lead = f"{_of(wrong, len(pairs))} significantly the other way"
    elif all(right) and all(sure):
        verdict, lead = Verdict.REPRODUCED, f"{_of(len(pairs), len(pairs))} significantly so"
    elif all(right):
        verdict = Verdict.DIRECTION
        but = f"{'only ' if any(sure) else ''}{_also(sum(sure), len(pairs))} significantly so"
        lead = f"{_of(len(pairs), len(pairs))} the way stated, but {but}"
    else:
        verdict = Verdict.INCONCLUSIVE
        lead = f"{_of(sum(right), len(pairs))} the way stated"
    told = "; ".join(
        f"{pair} ({number(t.difference, (t.high - t.low) / 2, sign=True)} "
        f"[{span(t.low, t.high)}], {probability(p)})"
        for pair, t, p in zip(pairs, tests, adjusted, strict=True)
    )
    return Finding(
        verdict,
        f"{lead} (Welch, Holm; {_runs(pairs)}{_in(unit)}; in brackets differences with 95% "
        f"intervals): {told}.",
        {key: t.difference for key, t in zip(_keys(pairs), tests, strict=True)},
    )


def _keys(pairs: Sequence[Pair]) -> list[str]:
    """Where each pair is, with what it compares unless the places tell all of them apart."""
    places = [p.where for p in pairs]
    if len(set(filter(None, places))) == len(pairs):
        return places
    return [": ".join(filter(None, (p.where, " over ".join(p.names)))) for p in pairs]


def equivalent(
    pairs: Sequence[Pair], margin: float, unit: str = "", *, refutable: bool = True
) -> Finding:
    """Whether the two of each pair are alike: two one-sided Welch tests.

    Reproduced when all are equivalent within the margin; else refuted when some pair differs
    significantly (Welch, Holm); else inconclusive, for too few runs show nothing.

    Parameters
    ----------
    pairs
        At least one.
    margin
        Largest difference that counts as none, as a share of the second mean.
    unit
        See :func:`ordered`.
    refutable
        Whether a significant difference that may be within the margin refutes the claim.
    """
    bounds = [margin * abs(p.second.mean) for p in pairs]
    tests = [equivalence(p.first, p.second, b) for p, b in zip(pairs, bounds, strict=True)]
    equal = sum(t.p_value < LEVEL for t in tests)
    p_differ = np.array([welch(p.first, p.second).p_value for p in pairs])
    differ = int((holm(p_differ) < LEVEL).sum())
    powers = [_power(p, b) for p, b in zip(pairs, bounds, strict=True)]
    denied = differ and refutable
    verdict = graded(equal == len(pairs), denied=denied, otherwise=Verdict.INCONCLUSIVE)
    lead, shown = _clearest(pairs, [1 - p for p in p_differ])
    return Finding(
        verdict,
        f"{_of(equal, len(pairs))} equivalent within {margin:.0%} (two one-sided tests) and "
        f"{_also(differ, len(pairs))} significantly different (Welch, Holm; "
        f"{_runs(pairs)}{_in(unit)}; without any difference the tests would find equivalence "
        f"in {min(powers):.0%} of samples or more); {lead}{'; '.join(map(str, shown))}.",
        {"equivalent": equal, "different": differ, "power": min(powers)},
    )


def _power(pair: Pair, bound: float) -> float:
    """Power of the two one-sided tests where there is no difference at all (normal)."""
    error = float(np.hypot(*(s.sd / s.n**0.5 for s in (pair.first, pair.second))))
    z = bound / error - distributions.norm.isf(LEVEL) if error else np.inf
    return float(max(0.0, 2 * distributions.norm.cdf(z) - 1))


def differ_but_one(pairs: Sequence[Pair], alike: Pair, margin: float = 0.05) -> Finding:
    """Whether the two of every pair differ significantly, and those of one further pair are alike.

    Reproduced when all differences are significant (Welch, Holm) and that pair is equivalent
    within the margin; refuted when a pair said to differ is equivalent, or the pair said to be
    alike differs significantly and by more than the margin; else inconclusive.
    """
    tests = [welch(p.first, p.second) for p in (*pairs, alike)]
    *p, p_alike = holm([t.p_value for t in tests])
    close = [
        equivalence(x.first, x.second, margin * abs(x.second.mean)).p_value < LEVEL
        for x in (*pairs, alike)
    ]
    apart, wrong = sum(q < LEVEL for q in p), sum(close[:-1])
    far = abs(tests[-1].difference) > margin * abs(alike.second.mean)
    verdict = Verdict.INCONCLUSIVE
    if wrong or (p_alike < LEVEL and far):
        verdict = Verdict.REFUTED
    elif apart == len(pairs) and close[-1]:
        verdict = Verdict.REPRODUCED
    return Finding(
        verdict,
        f"Of the {len(pairs)} pairs said to differ {apart or 'none'} "
        f"{'do' if apart > 1 else 'does'} significantly (Welch, Holm; "
        f"{_runs(pairs)}) and {_are(wrong)} equivalent within "
        f"{margin:.0%}. The pair said to be alike: {alike}, "
        f"{'equivalent' if close[-1] else 'not shown to be equivalent'}.",
        {"apart": apart, "wrongly_alike": wrong, "alike": float(close[-1])},
    )


def no_greater(
    pairs: Sequence[Pair],
    margin: float,
    unit: str = "",
    *,
    tolerant: bool = False,
    choices: int = 1,
) -> Finding:
    """Whether no first is the greater by more than a margin: one-sided Welch tests.

    Reproduced when all are shown to be at most so much greater; refuted when one is significantly
    greater by any amount (Welch, Holm); else inconclusive.

    Parameters
    ----------
    pairs, unit
        As of :func:`ordered`.
    margin
        As a share of the second mean.
    tolerant
        Whether only being greater by more than the margin refutes (Welch, Bonferroni).
    choices
        Settings among which each first was chosen after looking; corrects a refutation.
    """
    tests = [welch(p.first, p.second, level=1 - 2 * LEVEL) for p in pairs]
    bounds = [margin * abs(p.second.mean) for p in pairs]
    bounded = sum(t.high < b for t, b in zip(tests, bounds, strict=True))
    adjusted = holm([min(1.0, choices * t.p_value) for t in tests])
    greater = sum(t.difference > 0 and q < LEVEL for t, q in zip(tests, adjusted, strict=True))
    if tolerant:
        level = 1 - 2 * LEVEL / len(pairs) / choices
        strict = [welch(p.first, p.second, level=level) for p in pairs]
        greater = sum(t.low > b for t, b in zip(strict, bounds, strict=True))
    lead, shown = _clearest(pairs, [t.difference / abs(p.second.mean) if p.second.mean else 0.0
                                    for p, t in zip(pairs, tests, strict=True)])  # fmt: skip
    verdict = Verdict.REPRODUCED if bounded == len(pairs) else Verdict.INCONCLUSIVE
    if greater:
        verdict = Verdict.REFUTED
    bound = f"greater by at most {margin:.0%}" if margin else "no greater"
    return Finding(
        verdict,
        f"{_of(bounded, len(pairs))} shown to be {bound} (one-sided "
        f"Welch) and {_also(greater, len(pairs))} significantly greater "
        f"{'by more than that ' if tolerant else ''}(Welch, corrected for their number; "
        f"{_runs(pairs)}{_in(unit)}; without any difference each would be shown in at least "
        f"{least_power(bounds, [t.high - t.difference for t in tests], 1 - 2 * LEVEL, sides=1):.0%}"
        f" of samples); {lead}{'; '.join(map(str, shown))}.",
        {"bounded": bounded, "greater": int(greater)},
    )


def _clearest(pairs: Sequence[Pair], size: Sequence[float]) -> tuple[str, Sequence[Pair]]:
    """All pairs if they are few, else the one of the largest difference, and what to call it."""
    if len(pairs) <= 6:
        return "", pairs
    return "the clearest difference: ", [pairs[int(np.argmax(size))]]


def positive(contrasts: Mapping[str, tuple[float, float]], what: str) -> Finding:
    """Whether every contrast of independent means is above 0: z tests with Holm's correction.

    Verdicts are those of :func:`ordered`.

    Parameters
    ----------
    contrasts
        Estimate and standard error by setting; at least one.
    what
        What they are, as the sentence begins.
    """
    estimate, error = np.array(list(contrasts.values())).T
    p = holm(2 * distributions.norm.sf(np.abs(estimate) / np.maximum(error, 1e-300)))
    sure = p < LEVEL
    above, below = (estimate > 0).all(), (sure & (estimate < 0)).any()
    verdict = graded(
        above and sure.all(), direction=above, denied=below, otherwise=Verdict.INCONCLUSIVE
    )
    parts = [
        f"{where}: {plus_minus(e, 1.96 * se) if se else number(e)} ({probability(q)})"
        for (where, (e, se)), q in zip(contrasts.items(), p, strict=True)
    ]
    if len(parts) > 6:
        parts = [f"the least, {parts[estimate.argmin()]}", f"the most, {parts[estimate.argmax()]}"]
    return Finding(
        verdict,
        f"{what}: {'; '.join(parts)}; {_are(int((sure & (estimate > 0)).sum()))} "
        "significantly above 0 (z, Holm).",
        {where: float(e) for where, (e, _) in contrasts.items()},
    )


def near_printed(
    ours: ArrayLike,
    error: ArrayLike,
    printed: ArrayLike,
    printed_error: ArrayLike,
    *,
    fitted: int = 0,
) -> Finding:
    """Whether numbers meet the printed ones together: chi-square, p above .01.

    Parameters
    ----------
    ours, error, printed, printed_error
        Our means and what the thesis prints, with their standard errors, shape ``(n,)``.
    fitted
        How many settings were fitted to these numbers; each costs a degree of freedom.
    """
    mean, wanted = np.asarray(ours, float), np.asarray(printed, float)
    sd = np.hypot(np.asarray(error, float), np.asarray(printed_error, float))
    total = chi_square(mean, wanted, sd)
    dof = len(mean) - fitted
    p = float(distributions.chi2.sf(total, dof))
    far = np.abs(mean - wanted) / sd
    return Finding(
        Verdict.REPRODUCED if p > 0.01 else Verdict.NOT_REPRODUCED,
        f"The {len(mean)} numbers differ from the printed ones by chi-square {number(total, 1)} "
        f"on {dof} degrees of freedom ({probability(p)}), the farthest by "
        f"{far.max():.1f} standard errors.",
        {"chi_square": total, "p": p, "farthest": float(far.max())},
    )


def exact(holds: bool | np.bool_, evidence: str) -> Finding:
    """Whether an exact computation, which decides either way, shows the statement.

    Parameters
    ----------
    holds
        Refuted if not.
    evidence
        What was computed, in sentences that state no outcome.
    """
    return Finding(Verdict.REPRODUCED if holds else Verdict.REFUTED, evidence)


def within(values: Mapping[str, float], low: float, high: float, what: str) -> Finding:
    """Whether exact numbers all lie in an interval.

    Parameters
    ----------
    values
        By setting.
    low, high
        Inclusive.
    what
        What they are, as the sentence begins.
    """
    inside = sum(low <= v <= high for v in values.values())
    told = several(f"{number(v)} ({setting})" for setting, v in values.items())
    return Finding(
        Verdict.REPRODUCED if inside == len(values) else Verdict.NOT_REPRODUCED,
        f"{what}: {told}; {_are(inside)} between {number(low)} and {number(high)}.",
        dict(values),
    )


def share_at_least(
    held: Mapping[str, bool], share: float, what: str, *, direction: bool = False
) -> Finding:
    """Whether something holds in enough of the settings tried.

    Parameters
    ----------
    held
        By setting.
    share
        Of the settings, inclusive.
    what
        What holds, as the sentence begins.
    direction
        Whether fewer, but not none, are right in direction.
    """
    where = [setting for setting, holds in held.items() if holds]
    enough = len(where) >= share * len(held)
    some = Verdict.DIRECTION if direction and where else Verdict.NOT_REPRODUCED
    named = f" ({'; '.join(where)})" if 0 < len(where) < len(held) else ""
    every = "both" if len(held) == 2 else f"all {len(held)}"
    in_so_many = every if len(where) == len(held) else f"{len(where) or 'none'} of {len(held)}"
    return Finding(
        Verdict.REPRODUCED if enough else some,
        f"{what} in {in_so_many}{named}.",
        {"held": len(where), "of": len(held)},
    )


def _of(k: int, n: int) -> str:
    """``Of 5 comparisons 3 are``, ``Both comparisons are``, ``The one comparison is not``."""
    if n == 1:
        return f"The one comparison {_also(k, n)}"
    every = "Both comparisons are" if n == 2 else f"All {n} comparisons are"
    return every if k == n else f"Of {n} comparisons {_also(k, n)}"


def _also(k: int, n: int) -> str:
    """The same after a first clause that counts them: ``3 are``; of one, ``is`` or ``is not``."""
    if n == 1:
        return "is" if k else "is not"
    return _are(k)


def _are(k: int) -> str:
    """``3 are``, ``1 is``, ``none is``."""
    return f"{k} {'is' if k == 1 else 'are'}" if k else "none is"


def _runs(pairs: Sequence[Pair]) -> str:
    sizes = sorted({s.n for p in pairs for s in (p.first, p.second)})
    return f"n = {sizes[0]}" if len(sizes) == 1 else f"n = {sizes[0]} to {sizes[-1]}"


def _in(unit: str) -> str:
    return f"; {unit}" if unit else ""
