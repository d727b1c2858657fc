"""The ledger: claim, evidence, criterion, verdict.

A claim paraphrases a statement of the thesis, names the experiments that are its
evidence, and carries a criterion fixed in code before looking.  The verdict is
computed from the experiments' tables and never typed.  The pages *Scoreboard* and
*Differences from the thesis* are written from here.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from importlib import import_module
from pathlib import Path
from typing import TypeVar

import pandas as pd

from thesis_lib.experiments.base import load

CHAPTERS = (
    "thesis_lib.claims.chapter2",
    "thesis_lib.claims.chapter3",
    "thesis_lib.claims.appendix_a",
    "thesis_lib.claims.chapter4",
    "thesis_lib.claims.chapter5",
    "thesis_lib.claims.learning",
)

ItemT = TypeVar("ItemT")

Tables = Mapping[str, pd.DataFrame]
"""Tables of experiments by id."""


class Verdict(StrEnum):
    """What the evidence says of a claim."""

    REPRODUCED = "reproduced"
    DIRECTION = "direction only"
    NOT_REPRODUCED = "not reproduced"
    REFUTED = "refuted"
    NOT_TESTABLE = "not testable"
    INCONCLUSIVE = "inconclusive at this budget"
    NOT_RUN = "not run"


MEANING = {
    Verdict.REPRODUCED: "the criterion holds",
    Verdict.DIRECTION: "the sign or order agrees, the size or significance does not",
    Verdict.NOT_REPRODUCED: "our runs do not show it",
    Verdict.REFUTED: "a proof, an exact computation or a significant result says the opposite",
    Verdict.NOT_TESTABLE: "the text does not say enough to test it",
    Verdict.INCONCLUSIVE: "too few runs at this budget to tell",
    Verdict.NOT_RUN: "the evidence has not been computed yet",
}


@dataclass(frozen=True)
class Finding:
    """A verdict with the computed sentence that supports it."""

    verdict: Verdict
    evidence: str


NO_MEANING = Finding(
    Verdict.INCONCLUSIVE,
    "The evidence was made at the smoke budget, whose values carry no meaning.",
)


@dataclass(frozen=True)
class Claim:
    """A statement of the thesis and how it is judged.

    Attributes
    ----------
    id
        Short and stable, such as ``3.4.1-sarsa-beats-q``.
    section
        Where the thesis says it, such as ``3.4.1`` or ``Table 3.1``.
    statement
        A short paraphrase.
    experiments
        Ids of the experiments whose tables are the evidence.
    criterion
        What must hold, in words; fixed before looking.
    judge
        Computes the finding from the tables, by experiment id.
    headline
        Whether the landing page tells it.
    """

    id: str
    section: str
    statement: str
    experiments: tuple[str, ...]
    criterion: str
    judge: Callable[[Tables], Finding]
    headline: bool = False


@dataclass(frozen=True)
class Difference:
    """A point where the text is silent, ambiguous or at odds with what fits its numbers.

    Attributes
    ----------
    id, section
        As for a claim.
    topic
        A few words.
    thesis
        What the text says.
    ours
        What we do.
    option
        The named option that chooses, as code.
    effect
        A sentence, or a function of tables that writes one, on what the choice changes.
    experiments
        The tables ``effect`` needs.
    """

    id: str
    section: str
    topic: str
    thesis: str
    ours: str
    option: str
    effect: str | Callable[[Tables], str]
    experiments: tuple[str, ...] = ()


@dataclass(frozen=True)
class Judgement:
    """A claim with its finding and the budget of its evidence."""

    claim: Claim
    finding: Finding
    budget: str


def claims() -> tuple[Claim, ...]:
    """All claims, in the order of the thesis."""
    return _collect("CLAIMS")


def differences() -> tuple[Difference, ...]:
    """All differences from the thesis, in its order."""
    return _collect("DIFFERENCES")


def _collect(attribute: str) -> tuple:
    found = [x for name in CHAPTERS for x in getattr(import_module(name), attribute)]
    twice = [i for i, n in Counter(x.id for x in found).items() if n > 1]
    if twice:
        raise RuntimeError(f"{attribute} has the id {twice[0]!r} twice; ids must be unique.")
    return tuple(found)


def judge(claim: Claim, results: Path | str) -> Judgement:
    """Judge one claim on saved results.

    Parameters
    ----------
    claim
        What to judge.
    results
        Directory of tables written by ``thesis run`` or by the book's build.

    Returns
    -------
    Judgement
        ``not run`` when a table is missing, and ``inconclusive`` when one was made at the
        smoke budget, whose values carry no meaning.
    """
    tables, budgets = {}, set()
    for identifier in claim.experiments:
        try:
            table, provenance = load(identifier, results)
        except FileNotFoundError:
            missing = f"Its evidence is not here yet: make it with `thesis run {identifier}`."
            return Judgement(claim, Finding(Verdict.NOT_RUN, missing), "none")
        tables[identifier] = table
        budgets.add(provenance["budget"])
    budget = ", ".join(sorted(budgets)) or "exact"
    if "smoke" in budgets:
        return Judgement(claim, NO_MEANING, budget)
    return Judgement(claim, claim.judge(tables), budget)


def judge_all(results: Path | str, only: Iterable[str] = ()) -> list[Judgement]:
    """Judge every claim, or those whose id or section starts with one of ``only``."""
    prefixes = tuple(only)
    return [
        judge(claim, results)
        for claim in claims()
        if not prefixes or claim.id.startswith(prefixes) or claim.section.startswith(prefixes)
    ]


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


def scoreboard_markdown(results: Path | str) -> str:
    """Body of the page *Scoreboard*: a tally, then every claim by chapter, as MyST Markdown."""
    judged = judge_all(results)
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
            return "Not shown at the smoke budget, whose values carry no meaning."
    return difference.effect(tables)


def findings_markdown(results: Path | str) -> str:
    """What was found, for the landing page: the tally and the verdicts on the headline claims."""
    judged = judge_all(results)
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


def verdicts(
    ledger: Iterable[Claim], tables: Tables, prefix: str = "", *, budget: str = "book"
) -> pd.DataFrame:
    """Judge the claims whose evidence is among the tables given, for a chapter's own page.

    Parameters
    ----------
    ledger
        A chapter's claims.
    tables
        Tables by experiment id.
    prefix
        Only claims whose id starts so.
    budget
        At ``smoke`` nothing is judged: every verdict is ``inconclusive``.

    Returns
    -------
    pandas.DataFrame
        Columns ``claim``, ``verdict``, ``evidence``; one row a claim.
    """
    ready = [c for c in ledger if c.id.startswith(prefix) and set(c.experiments) <= set(tables)]
    found = [(c, NO_MEANING if budget == "smoke" else c.judge(tables)) for c in ready]
    return pd.DataFrame(
        [(c.statement, str(f.verdict), f.evidence) for c, f in found],
        columns=["claim", "verdict", "evidence"],
    )
