"""The pages written from the ledger: findings, Scoreboard, Differences from the thesis."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

import pandas as pd

from thesis_lib.edition.chapters import claims, differences
from thesis_lib.edition.experiment import load
from thesis_lib.edition.ledger import (
    MEANING,
    SMOKE_TELLS_NOTHING,
    Difference,
    Finding,
    Judgement,
    Verdict,
    judge,
)

ItemT = TypeVar("ItemT")


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
    prefixes = tuple(only)
    judged = []
    for claim in claims():
        if not prefixes or claim.id.startswith(prefixes) or claim.section.startswith(prefixes):
            try:
                judged.append(judge(claim, results))
            except FileNotFoundError as error:
                if not draft:
                    raise
                judged.append(Judgement(claim, Finding(Verdict.NOT_RUN, str(error)), "none"))
    return judged


def scoreboard(results: Path | str) -> pd.DataFrame:
    """The ledger as a table: one row a claim, with verdict and evidence."""
    return pd.DataFrame(
        [
            {
                "id": j.claim.id,
                "section": j.claim.section,
                "statement": j.claim.statement,
                "criterion": j.claim.criterion,
                "verdict": str(j.finding.verdict),
                "evidence": j.finding.evidence,
                "experiments": ", ".join(j.claim.experiments),
                "budget": j.budget,
            }
            for j in judge_all(results)
        ],
        columns=[
            *("id", "section", "statement", "criterion"),
            *("verdict", "evidence", "experiments", "budget"),
        ],
    )


def scoreboard_markdown(results: Path | str, *, draft: bool = False) -> str:
    """Body of the page *Scoreboard*: a tally, then every claim by chapter, as MyST Markdown."""
    judged = judge_all(results, draft=draft)
    tally = Counter(j.finding.verdict for j in judged)
    lines = ["| verdict | meaning | claims |", "| :-- | :-- | --: |"]
    lines += [f"| **{v}** | {MEANING[v]} | {tally[v]} |" for v in Verdict if tally[v]]
    lines += [f"| | all claims | {len(judged)} |", ""]
    chapter = None
    for j in _by_chapter(judged, lambda j: j.claim.section):
        title = _chapter_of(j.claim.section)
        if title != chapter:
            chapter = title
            lines += [f"## {chapter}", ""]
        lines += [
            f"### {j.claim.statement}",
            "",
            f"**Verdict: {j.finding.verdict}.** {j.finding.evidence}",
            "",
            f"- *Where*: {j.claim.section}; claim `{j.claim.id}`",
            f"- *Criterion*: {j.claim.criterion}",
            "- *Evidence*: "
            + (", ".join(f"`thesis run {e}`" for e in j.claim.experiments) or "exact computation")
            + f" (budget: {j.budget})",
            "",
        ]
    return "\n".join(lines)


def differences_markdown(results: Path | str) -> str:
    """Body of the page *Differences from the thesis*, as MyST Markdown."""
    lines: list[str] = []
    chapter = None
    for d in _by_chapter(differences(), lambda d: d.section):
        title = _chapter_of(d.section)
        if title != chapter:
            chapter = title
            lines += [f"## {chapter}", ""]
        lines += [
            f"### {d.topic}",
            "",
            f"- *Where*: {d.section}; row `{d.id}`",
            f"- *The thesis*: {d.thesis}",
            f"- *Here*: {d.ours}",
            f"- *Option*: {d.option}",
            f"- *What it changes*: {effect(d, results)}",
            "",
        ]
    return "\n".join(lines)


def effect(difference: Difference, results: Path | str) -> str:
    """What a difference changes, computed from tables where it needs them."""
    if isinstance(difference.effect, str):
        return difference.effect
    tables = {}
    for identifier in difference.experiments:
        try:
            tables[identifier], provenance = load(identifier, results)
        except FileNotFoundError:
            return f"Not computed yet: `thesis run {identifier}` makes it."
        if provenance["budget"] == "smoke":
            return SMOKE_TELLS_NOTHING
    return difference.effect(tables)


def findings_markdown(results: Path | str, *, draft: bool = False) -> str:
    """What was found, for the landing page: the tally and the verdicts on the headline claims."""
    judged = judge_all(results, draft=draft)
    tally = Counter(j.finding.verdict for j in judged)
    counts = ", ".join(f"{tally[v]} {v}" for v in Verdict if tally[v])
    lines = [f"Of {len(judged)} claims examined so far: {counts}.", ""]
    lines += [
        f"- {j.claim.statement} *{str(j.finding.verdict).capitalize()}.*"
        for j in judged
        if j.claim.headline
    ]
    return "\n".join([*lines, ""])


def _by_chapter(items: Iterable[ItemT], section: Callable[[ItemT], str]) -> list[ItemT]:
    """Items of one chapter together, chapters in the order of their first item."""
    listed = list(items)
    order = list(dict.fromkeys(_chapter_of(section(item)) for item in listed))
    return sorted(listed, key=lambda item: order.index(_chapter_of(section(item))))


def _chapter_of(section: str) -> str:
    """Heading under which a section, table, figure or appendix is listed."""
    if appendix := re.match(r"(?:Appendix |Figure )?([A-Z])\b", section):
        return f"Appendix {appendix[1]}"
    number = re.search(r"\d+", section)
    return f"Chapter {number[0]}" if number else section
