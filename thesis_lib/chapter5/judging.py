"""How a claim of chapter 5 is judged: on the printed tables, and on our runs.

Both kinds of evidence are told.  A claim is as good as the weaker of the two; what the printed
tables bear out and we have not run, or not long enough, is *not run* or *inconclusive*, and what
the printed tables themselves deny is denied.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import pandas as pd

from thesis_lib.chapter5.cells import ROBOTS
from thesis_lib.chapter5.contrasts import comparisons
from thesis_lib.chapter5.runs import ENOUGH
from thesis_lib.edition.criteria import LEVEL, graded
from thesis_lib.edition.experiment import Experiment
from thesis_lib.edition.ledger import WEAKEST_FIRST, Criterion, Finding, Verdict, criterion
from thesis_lib.edition.words import with_interval
from thesis_lib.stats import Comparison, holm

_WORDS = {
    Verdict.REFUTED: "deny it",
    Verdict.NOT_REPRODUCED: "do not show it",
    Verdict.DIRECTION: "agree in direction only",
    Verdict.REPRODUCED: "bear it out",
    Verdict.INCONCLUSIVE: "are too few or too short to tell",
}


@dataclass(frozen=True)
class Evidence:
    """What one source says.

    Attributes
    ----------
    verdict
        By the criterion.
    sentence
        The numbers behind it.
    units
        Fewest runs behind a cell.
    tasks
        Tasks with every net.
    printed_budget
        Whether all runs learned for as long as the thesis's.
    of_tasks
        Tasks the claim is about.
    """

    verdict: Verdict
    sentence: str
    units: int = 20
    tasks: int = len(ROBOTS)
    printed_budget: bool = True
    of_tasks: int = len(ROBOTS)


_PARTS = re.compile(rf"(The printed tables|Our runs(?: \([^)]*\))?) ({'|'.join(_WORDS.values())}):")
"""Where the sentences of each source begin in the evidence for a claim."""

Said = tuple[Verdict, str]
"""A verdict, and the numbers behind it in a sentence."""


def both(
    claim: str, *experiments: Experiment[Any], rows: Callable[..., pd.DataFrame] | None = None
) -> Callable[[Callable[..., Any]], Criterion]:
    """Make a function of a source, ``printed`` or ``ours``, and tables the criterion of a claim.

    Parameters
    ----------
    claim, *experiments
        As of :func:`~thesis_lib.edition.ledger.criterion`.
    rows
        From a source and tables to the rows that the claim rests on, as :func:`of_rows` takes
        them.  With it, the function is one of these rows to what is :data:`Said`, and is not asked
        if there are none.  Without, it returns :class:`Evidence`, or None without any run.
    """

    def make(function: Callable[..., Any]) -> Criterion:
        def say(source: str, *tables: pd.DataFrame) -> Evidence | None:
            if rows is None:
                return cast("Evidence | None", function(source, *tables))
            found = rows(source, *tables)
            return None if found.empty else of_rows(found, *function(found))

        def judge(*tables: pd.DataFrame) -> Finding:
            return weigh(say("printed", *tables), say("ours", *tables))

        return criterion(claim, *experiments)(judge)

    return make


def weigh(printed: Evidence | None, ours: Evidence | None) -> Finding:
    """The finding of both sources.

    Parameters
    ----------
    printed, ours
        What each says; None where the thesis prints no numbers, or nothing has been run.
    """
    own = _own(ours)
    if printed is None:
        theirs = "The thesis prints no numbers."
    else:
        tell = {**_WORDS, Verdict.INCONCLUSIVE: "do not tell"}[printed.verdict]
        theirs = f"The printed tables {tell}: {printed.sentence}"
    if ours is None:
        mine = "Ours have not all been run yet."
    else:
        deep = "" if ours.printed_budget else ", not all as long as the thesis's"
        some = "" if ours.tasks == ours.of_tasks else f", {ours.tasks} of {ours.of_tasks} robots"
        mine = f"Our runs ({ours.units} seeds or more{some}{deep}) {_WORDS[own]}: {ours.sentence}"
    verdicts = [own] if printed is None else [printed.verdict, own]
    return Finding(min(verdicts, key=WEAKEST_FIRST.index), f"{theirs} {mine}")


def side_by_side(verdicts: pd.DataFrame) -> pd.DataFrame:
    """Verdicts with what each source says of the claim by itself.

    Parameters
    ----------
    verdicts
        Columns ``claim``, ``verdict`` and ``evidence``, the last as :func:`weigh` writes it.

    Returns
    -------
    pandas.DataFrame
        Columns ``claim``, ``verdict``, ``printed``, ``ours`` and ``why``: the verdicts of the
        sources, none where one says nothing, and the sentences behind them.
    """
    meant = {words: str(verdict) for verdict, words in _WORDS.items()}
    sources = {"printed": "The printed tables", "ours": "Our runs"}
    rows = []
    for claim, verdict, evidence in verdicts[["claim", "verdict", "evidence"]].itertuples(
        index=False
    ):
        by = {name: meant[words] for name, words in _PARTS.findall(evidence)}
        said = {
            source: next((v for name, v in by.items() if name.startswith(start)), None)
            for source, start in sources.items()
        }
        rows.append({"claim": claim, "verdict": verdict, **said, "why": evidence})
    return pd.DataFrame(rows, columns=["claim", "verdict", *sources, "why"])


def in_short(evidence: str) -> str:
    """What each source says of a claim, without the numbers behind it.

    >>> in_short("The printed tables bear it out: 3 of 4. Our runs (3 seeds) deny it: 0 of 4.")
    'The printed tables bear it out; our runs (3 seeds) deny it.'
    """
    said = "; ".join(f"{name} {words}" for name, words in _PARTS.findall(evidence))
    return f"{said.replace('; Our', '; our')}." if said else evidence


def _own(ours: Evidence | None) -> Verdict:
    """The verdict of our runs: fewer seeds, tasks or steps than it takes decide nothing."""
    if ours is None:
        return Verdict.NOT_RUN
    whole = ours.units >= ENOUGH and ours.tasks == ours.of_tasks and ours.printed_budget
    return ours.verdict if whole else Verdict.INCONCLUSIVE


def of_source(source: str, table: pd.DataFrame) -> pd.DataFrame:
    """The rows of one source."""
    return table[table.source == source]


def of_rows(rows: pd.DataFrame, verdict: Verdict, sentence: str) -> Evidence:
    """Evidence from rows that say what is behind them.

    Parameters
    ----------
    rows
        Columns ``units`` and ``printed_budget``; how many robots there are in ``tasks`` or
        ``robots``, or their names in ``task``; and ``of_tasks`` where not all were asked for.
    verdict, sentence
        Of the evidence.
    """
    counts = [rows[name].min() for name in ("tasks", "robots") if name in rows]
    asked = rows.of_tasks.min() if "of_tasks" in rows else len(ROBOTS)
    return Evidence(
        verdict,
        sentence,
        int(rows.units.min()),
        int(counts[0] if counts else rows.task[rows.task.isin(ROBOTS)].nunique()),
        bool(rows.printed_budget.all()),
        int(asked),
    )


def together(parts: list[Evidence | None]) -> Evidence | None:
    """Evidence for a claim of several parts: as good as the weakest."""
    found = [part for part in parts if part is not None]
    if len(found) < len(parts):
        return None
    first, *others = (part.sentence for part in found)
    return Evidence(
        min((part.verdict for part in found), key=WEAKEST_FIRST.index),
        " ".join([first, *(other[0].upper() + other[1:] for other in others)]),
        min(part.units for part in found),
        min(part.tasks for part in found),
        all(part.printed_budget for part in found),
    )


def leads(
    claim: str,
    measure: str,
    quadrant: str,
    firsts: Sequence[str],
    seconds: Sequence[str],
    *,
    tasks: bool = False,
) -> Criterion:
    """The criterion that each of some nets is ahead of each of others, as :func:`ahead` says."""
    return both(claim, comparisons)(
        lambda source, table: ahead(table, source, measure, quadrant, firsts, seconds, tasks=tasks)
    )


def ahead(
    table: pd.DataFrame,
    source: str,
    measure: str,
    quadrant: str,
    firsts: Sequence[str],
    seconds: Sequence[str],
    *,
    tasks: bool = False,
) -> Evidence | None:
    """Whether each of some nets is ahead of each of others.

    Parameters
    ----------
    table
        Of :data:`~thesis_lib.chapter5.contrasts.comparisons`.
    source, measure, quadrant, firsts, seconds
        Which of its rows.
    tasks
        Whether "significantly" must hold with tasks as the unit too.

    Returns
    -------
    Evidence or None
        Reproduced if every difference is above 0 over runs, p < .05 after Holm (and with tasks as
        the unit too); direction only if all are above 0; refuted if one is below 0 with p < .05;
        None without rows.
    """
    rows = pick(table, source, measure, quadrant, firsts, seconds)
    if rows.empty:
        return None
    p_runs, p_tasks = _holm(rows.p_runs), _holm(rows.p_tasks)
    enough = not tasks or bool((p_tasks < LEVEL).all())
    above, below = rows.difference > 0, rows.difference < 0
    verdict = graded(
        enough and (above & (p_runs < LEVEL)).all(),
        above.all(),
        denied=(below & (p_runs < LEVEL)).any(),
    )
    least = rows.loc[rows.difference.idxmin()]
    sentence = (
        f"{least['first']} less {least.second} {difference(least)} "
        f"{'in score' if measure == 'robustness' else 'of the best return'}"
        f"{f', the least of {len(rows)} differences' if len(rows) > 1 else ''}: "
        f"{_significant(p_runs)} over runs{_over_tasks(p_tasks, least)}."
    )
    return of_rows(rows, verdict, sentence)


def pick(
    table: pd.DataFrame,
    source: str,
    measure: str,
    quadrant: str,
    firsts: Sequence[str],
    seconds: Sequence[str],
) -> pd.DataFrame:
    """Contrasts of each of some nets with each of others by one source, measure and quadrant."""
    at = (table.source == source) & (table.measure == measure) & (table.quadrant == quadrant)
    at &= table["first"].isin(firsts) & table.second.isin(seconds)
    return table[at & (table["first"] != table.second)]


def difference(row: pd.Series | Comparison) -> str:
    """A difference with its interval, as text."""
    return with_interval(row.difference, row.low, row.high)


def _over_tasks(p_tasks: np.ndarray, row: pd.Series) -> str:
    """What tests with tasks as the unit say, if there are several tasks."""
    if np.isnan(p_tasks).any():
        return ""
    return (
        f" and {_significant(p_tasks)} with the {row.tasks} tasks as the unit "
        f"(Friedman over all seven nets p = {row.p_friedman:.2g})"
    )


def _significant(p: np.ndarray) -> str:
    if len(p) == 1:
        return f"p = {p[0]:.2g}"
    sure = int((p < LEVEL).sum())
    if sure == len(p):
        return "all significant"
    return f"{sure or 'none'} of {len(p)} significant"


def _holm(p: pd.Series) -> np.ndarray:
    """Holm's adjustment; unknown where one is unknown."""
    return np.full(len(p), np.nan) if p.isna().any() else holm(p)
