"""The pages written from the ledger: findings, Scoreboard, Differences from the thesis."""

from __future__ import annotations

import re
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import TypeVar

import pandas as pd

from thesis_lib.edition import roots
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
    select,
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


def scoreboard(results: Path | str) -> pd.DataFrame:
    """The ledger as a table: one row a claim, with verdict and evidence."""
    return pd.DataFrame(
        [
            {
                "id": j.claim.id,
                "section": j.claim.section,
                "statement": j.claim.statement,
                "criterion": j.claim.criterion,
                "verdict": str(j.verdict),
                "frequency": j.over.frequency if j.over else "",
                "evidence": j.finding.evidence,
                "experiments": ", ".join(j.claim.experiments),
                "budget": j.budget,
            }
            for j in judge_all(results)
        ],
        columns=[
            *("id", "section", "statement", "criterion"),
            *("verdict", "frequency", "evidence", "experiments", "budget"),
        ],
    )


def scoreboard_markdown(results: Path | str, *, draft: bool = False) -> str:
    """Body of the page *Scoreboard*: tallies, then every claim by chapter, as MyST Markdown.

    The verdicts are those over roots where they are committed, except at the smoke budget.
    """
    judged = judge_all(results, draft=draft)
    lines = _tally(judged)
    chapter = None
    for j in _by_chapter((j for j in judged if not j.claim.ours), lambda j: j.claim.section):
        if (here := _chapter_of(j.claim.section)) != chapter:
            chapter = here
            lines += [f"## {chapter}", ""]
        lines += _row(j)
    lines += [
        "## Claims of our own",
        "",
        "What the thesis at most implies, and is not counted.",
        "",
    ]
    for j in judged:
        lines += _row(j) if j.claim.ours else []
    return "\n".join(lines)


def _tally(judged: list[Judgement]) -> list[str]:
    """How many claims have which verdict, and how often it came out."""
    evidence = [j for j in judged if _counts(j)]
    identities = sum(j.claim.kind == "identity" and not j.claim.ours for j in judged)
    ours = sum(j.claim.ours for j in judged)
    repeated = sum(bool(j.claim.rests_on) for j in judged)
    lines = [
        f"| verdict | meaning | {' | '.join(_CLASSES)} | claims |",
        f"| :-- | :-- | {'--: | ' * len(_CLASSES)}--: |",
    ]
    for verdict in Verdict:
        own = [j for j in evidence if j.verdict is verdict]
        by = Counter(_frequency_class(j) for j in own)
        if own:
            cells = " | ".join(str(by[name] or "") for name in _CLASSES)
            lines.append(f"| **{verdict}** | {MEANING[verdict]} | {cells} | {len(own)} |")
    return [
        *lines,
        f"| | all that evidence decides {'| ' * len(_CLASSES)}| {len(evidence)} |",
        "",
        f"Besides these, {identities} claims are proofs or arithmetic, which no experiment can "
        f"deny, {repeated} repeat or sum up others, and {ours} are our own.",
        "",
    ]


_CLASSES = ("exact", "in all roots", "in most", "in fewer", "one root")


def _frequency_class(judgement: Judgement) -> str:
    over = judgement.over
    if over is None:
        return "one root" if judgement.claim.experiments else "exact"
    if over.exact:
        return "exact"
    held = over.counts.get(over.verdict, 0)
    return "in all roots" if held == over.of else "in most" if held else "in fewer"


def _counts(judgement: Judgement) -> bool:
    """Whether a claim is the thesis's own, no repetition, and decided by evidence."""
    claim = judgement.claim
    return not claim.ours and not claim.rests_on and claim.kind == "evidence"


def _row(j: Judgement) -> list[str]:
    """One claim of the page *Scoreboard*."""
    kind = " (an identity: not counted as evidence)" if j.claim.kind == "identity" else ""
    made = ", ".join(f"`thesis run {e}`" for e in j.claim.experiments) or "exact computation"
    lines = [
        f"### {j.claim.statement}",
        "",
        f"**Verdict: {j.told()}.** {j.finding.evidence}",
        "",
        f"- *Where*: {j.claim.section}; claim `{j.claim.id}`{kind}",
        f"- *Criterion*: {j.claim.criterion}",
        f"- *Evidence*: {made} (budget: {j.budget})",
    ]
    if j.claim.experiments:
        lines.append(f"- *Judge it again*: `thesis claims {j.claim.id} --seeds 10`")
    if j.over and j.over.code != roots.code_of_claim(j.claim, j.over.budget):
        lines.append("- *State*: the verdicts over roots were made by an earlier state of the code")
    return [*lines, ""]


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
    tally = Counter(j.verdict for j in judged if _counts(j))
    counts = ", ".join(f"{tally[v]} {v}" for v in Verdict if tally[v])
    lines = [f"Of {tally.total()} claims that evidence decides: {counts}.", ""]
    lines += [
        f"- {j.claim.statement} *{str(j.verdict).capitalize()}.*"
        for j in judged
        if j.claim.headline
    ]
    return "\n".join([*lines, ""])


def questions_markdown(results: Path | str, *, draft: bool = False) -> str:
    """The research questions, each answered by the thesis and from the ledger, as MyST Markdown.

    Raises
    ------
    ValueError
        For an answer that names a claim which is not there.
    """
    told = {j.claim.id: f"*{j.told()}*" for j in judge_all(results, draft=draft)}

    def verdict(found: re.Match[str]) -> str:
        if found[1] not in told:
            raise ValueError(f"questions.toml names a claim {found[1]!r}, which is not there.")
        return told[found[1]]

    lines = []
    for row in _questions():
        ours = re.sub(r"\{([^}]+)\}", verdict, row["ours"].strip())
        lines += [f"### {row['text']}", "", f"**The thesis.** {row['thesis']}", ""]
        lines += [f"**This edition.** {ours}", ""]
    return "\n".join(lines)


def _questions() -> list[dict[str, str]]:
    file = resources.files("thesis_lib.chapter6") / "questions.toml"
    found: list[dict[str, str]] = tomllib.loads(file.read_text(encoding="utf-8"))["question"]
    return found


def _by_chapter(items: Iterable[ItemT], section: Callable[[ItemT], str]) -> list[ItemT]:
    """Items of one chapter together: chapters by number, then appendices, then the summary."""

    def place(item: ItemT) -> tuple[bool, str]:
        chapter = _chapter_of(section(item))
        return not chapter.startswith("Chapter"), chapter

    return sorted(items, key=place)


def _chapter_of(section: str) -> str:
    """Heading under which a section, table, figure or appendix is listed."""
    if appendix := re.match(r"(?:Appendix |Figure )?([A-Z])\b", section):
        return f"Appendix {appendix[1]}"
    number = re.search(r"\d+", section)
    return f"Chapter {number[0]}" if number else section
