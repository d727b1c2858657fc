"""Every claim judged, and what every difference from the thesis changes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from thesis_lib.edition import roots
from thesis_lib.edition.chapters import claims
from thesis_lib.edition.deepest import deepest
from thesis_lib.edition.experiment import load
from thesis_lib.edition.ledger import (
    SMOKE_TELLS_NOTHING,
    Difference,
    Finding,
    Judgement,
    Verdict,
    judge,
    select,
)


def judge_all(
    results: Path | str, only: Iterable[str] = (), *, draft: bool = False
) -> list[Judgement]:
    """Judge every claim, or those whose id or section starts with one of ``only``.

    Parameters
    ----------
    results
        Directory of tables.
    only
        What ids or sections start with; all when empty.
    draft
        Whether a claim without its tables is ``not run``; else it is an error.
    """
    judged, over = [], roots.read()
    for claim in select(claims(), only):
        try:
            own = judge(claim, results)
        except FileNotFoundError as error:
            if not draft:
                raise
            own = Judgement(claim, Finding(Verdict.NOT_RUN, str(error)), "none")
        judged.append(own if own.budget == "smoke" else replace(own, over=over.get(claim.id)))
    return judged


def effect(difference: Difference, results: Path | str) -> str:
    """What a difference changes, computed from tables where it needs them."""
    if isinstance(difference.effect, str):
        return difference.effect
    tables = {}
    for identifier in difference.experiments:
        try:
            tables[identifier], provenance = deepest(*load(identifier, results))
        except FileNotFoundError:
            return f"Not computed yet: `thesis run {identifier}` makes it."
        if provenance["budget"] == "smoke":
            return SMOKE_TELLS_NOTHING
    return difference.effect(tables)
