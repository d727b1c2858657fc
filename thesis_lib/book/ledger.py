"""The ledger as pages: tallies, one table of claims, one of differences, and what others quote."""

from __future__ import annotations

import json
import re
import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from thesis_lib.book.tables import rows_markdown
from thesis_lib.book.thesis_items import link
from thesis_lib.edition import roots
from thesis_lib.edition.deepest import committed
from thesis_lib.edition.ledger import MEANING, Claim, Difference, Judgement, Verdict
from thesis_lib.edition.scoreboard import effect
from thesis_lib.edition.words import brief, parted, plain, several, typeset

_CLASSES = ("exact", "in all draws", "in most draws", "in no eight of ten", "waiting")

_NAMED = re.compile(r"\{([^} ]+)( evidence)?\}")
"""A claim, or its evidence, in an answer of :func:`questions`."""

_CHAPTERS = {
    "1": "ch-introduction",
    "2": "ch-background",
    "3": "ch-potentials",
    "4": "ch-relevance",
    "5": "ch-recurrent-policies",
    "6": "ch-conclusions",
    "A": "ch-appendix-a",
    "B": "sec-ch4-appendix-b",
}
"""Labels of our pages, for rows that name no section of them."""


def quoted(judged: Iterable[Judgement]) -> str:
    """Words, verdict and evidence of every claim by id, as JSON, for the roles of other pages."""
    verdicts = {
        j.claim.id: {
            "statement": plain(j.claim.statement),
            "verdict": j.in_words(),
            "evidence": brief(j.finding.evidence),
            "first": first_sentence(j.finding.evidence),
        }
        for j in judged
    }
    return json.dumps(verdicts, indent=1, ensure_ascii=False) + "\n"


def first_sentence(evidence: str) -> str:
    """The first sentence of evidence, without long lists of numbers.

    >>> first_sentence("It is 3 of 4. The rest follows.")
    'It is 3 of 4.'
    """
    return f"{brief(evidence).partition('. ')[0].rstrip('.')}."


def by_place(rows: Iterable[Difference]) -> str:
    """Topics of the differences by id, by the label of the section they concern, as JSON."""
    places: dict[str, dict[str, str]] = {}
    for row in rows:
        places.setdefault(row.at, {})[row.id] = plain(row.topic)
    return json.dumps(places, indent=1, ensure_ascii=False) + "\n"


def scoreboard_markdown(judged: Sequence[Judgement]) -> str:
    """Body of the page *Scoreboard*: tallies and a table of the thesis's claims, as MyST.

    The verdicts are those over draws where they are committed, except at the smoke budget.
    """
    flips, mended = bool(_flips(judged)), bool(_mended(judged))
    state = _state(judged, _earlier(judged), flips=flips, mended=mended)
    title = "Every claim of the thesis, in its order"
    table = _claims(judged, title, ours=False, name="tbl-claims", look="ledger")
    return "\n".join([*_tally(judged), *state, *table])


def more_markdown(judged: Sequence[Judgement]) -> str:
    """Body of the page *More about the verdicts*, as MyST.

    These are the claims whose verdict changes with the draw, the runs or a mended criterion, and
    the table of our own.
    """
    title = "Claims of our own, which the thesis at most implies or our runs suggested"
    ours = [f"## {title.partition(',')[0]}", ""]
    ours += _claims(judged, title, ours=True, name="tbl-claims-ours", look="cards")
    return "\n".join([*_flips(judged), *_deeper(judged), *_mended(judged), *ours])


def _claims(
    judged: Sequence[Judgement], title: str, *, ours: bool, name: str, look: str
) -> list[str]:
    """A table of the thesis's claims, or of ours, with a label and a class of ``book.css``."""
    earlier = _earlier(judged)
    listed = sorted(judged, key=lambda j: in_order(j.claim.section))
    lines = [f"::::{{list-table}} {title}", f":name: {name}", f":class: {look}"]
    lines += [":header-rows: 1", "", "* - verdict", "  - claim", "  - where"]
    told: dict[str, str] = {}
    for j in (j for j in listed if j.claim.ours == ours):
        # Claims that one result decides share long sentences, which stand with the first.
        first = told.setdefault(j.finding.evidence, j.claim.id)
        repeats = first if first != j.claim.id and len(j.finding.evidence) > 120 else ""
        lines += _claim(j, earlier=j.claim.id in earlier, repeats=repeats)
    return [*lines, "::::", ""]


def _claim(j: Judgement, *, earlier: bool, repeats: str = "") -> list[str]:
    """One row of the table of claims; ``earlier`` as for :func:`_state`.

    ``repeats`` is the claim above, if any, whose evidence is the same.
    """
    claim = j.claim
    about = [claim.section]
    about += ["headline"] * claim.headline
    about += ["identity"] * (claim.kind == "identity")
    deep = {f.stem for f in committed().glob("*.json")} if "thesis" in j.budget else set()
    usual = j.budget in ("book", "exact")
    source = [f"`{claim.id}`"]
    source += [f"shown is `thesis run {e} --budget thesis`" for e in claim.experiments if e in deep]
    source[-1] += "" if usual else f" (budget: {j.budget})"
    drawn_deep = j.over is not None and j.over.budget == "thesis"
    source += ["judged with `--budget thesis`"] * drawn_deep
    source += [f"shown in {link(claim.figure)}"] if claim.figure else []
    source += ["the verdicts over draws are of earlier code or runs"] * earlier
    same = f"That of [the claim {repeats}](#claim-{repeats})."
    head, rest = (same, "") if repeats else parted(j.finding.evidence)
    details: list[str | _Folded] = [
        *([f"*On the tables shown* the verdict is {j.here}."] if j.here else []),
        head,
        *([_Folded("… and the rest", [rest])] if rest else []),
        f"*Criterion*: {_criterion(claim)}",
        f"*Id*: {'; '.join(source)}.",
    ]
    return [
        f"* - {j.verdict.badge}",
        *([f"    {j.over.frequency}"] if j.over and j.verdict is not Verdict.NOT_RUN else []),
        f"  - (claim-{claim.id})=",
        f"    {typeset(claim.statement)}",
        *_dropdown(_Folded("Evidence", details)),
        f"  - {_where(claim.at, claim.section)}",
        *(f"    [{word}]{{.mark}}" for word in about[1:]),
    ]


def _criterion(claim: Claim) -> str:
    """What must hold, or links to the claims that decide."""
    if not claim.rests_on:
        return claim.criterion
    return f"That of {several(f'[{x}](#claim-{x})' for x in claim.rests_on)}."


def differences_markdown(rows: Iterable[Difference], results: Path | str) -> str:
    """Body of the page *Differences from the thesis*: one table, as MyST Markdown."""
    lines = ["::::{list-table} Every difference, in the thesis's order"]
    lines += [":name: tbl-differences", ":class: ledger", ":header-rows: 1", ""]
    lines += ["* - where", "  - the thesis, and what is done here"]
    for row in sorted(rows, key=lambda row: in_order(row.section)):
        topic = typeset(row.topic).replace("*", r"\*")
        details = [
            f"*The thesis*: {row.thesis}",
            f"*Option*: {row.option}",
            f"*What it changes*: {effect(row, results)}",
        ]
        lines += [
            f"* - {_where(row.at, row.section)}",
            f"  - (difference-{row.id})=",
            f"    **{topic}.** {typeset(row.ours)}",
            *_dropdown(_Folded("The text, the option, the effect", details)),
        ]
    return "\n".join([*lines, "::::", ""])


def findings_markdown(judged: Sequence[Judgement]) -> str:
    """The tally and the verdicts on the headline claims, for chapter 6."""
    tally = Counter(j.verdict for j in judged if _counts(j))
    counts = several(f"{tally[v]} {v}" for v in Verdict if tally[v])
    lines = [
        f"Of the thesis's {tally.total()} claims that are no proofs and repeat no other: {counts}.",
        "",
    ]
    lines += [
        f"- {typeset(j.claim.statement)} [{str(j.verdict).capitalize()}](#claim-{j.claim.id})"
        f"{f' ({there} by a table of more runs)' if (there := _by_more_runs(j)) else ''}."
        for j in judged
        if j.claim.headline and not j.claim.ours
    ]
    return "\n".join([*lines, ""])


def questions() -> list[dict[str, Any]]:
    """The six research questions: ``text``, ``thesis``, ``answer``, ``holds`` and ``ours``.

    ``answer`` is ours in a sentence, written for the verdicts that ``holds`` has by claim.  In
    ``ours`` a claim's id in braces stands for its verdict, and one that ``evidence`` follows for
    the first sentence of its evidence.
    """
    file = resources.files("thesis_lib.chapter6") / "questions.toml"
    found: list[dict[str, Any]] = tomllib.loads(file.read_text(encoding="utf-8"))["question"]
    return found


def questions_markdown(rows: Iterable[Mapping[str, Any]], judged: Iterable[Judgement]) -> str:
    """The research questions, each answered by the thesis and from the ledger, as MyST Markdown.

    An answer in a sentence that was written for other verdicts is left out.

    Raises
    ------
    ValueError
        For an answer that names a claim which is not there.
    """
    by_id = {j.claim.id: j for j in judged}

    def told(found: re.Match[str]) -> str:
        own = _answering(found[1], by_id)
        if found[2]:
            return first_sentence(own.finding.evidence)
        return f"[{own.verdict}](#claim-{found[1]})"

    overview, answers = [], []
    for number, row in enumerate(rows, 1):
        overview += [f"{number}. {row['text']}", "", f"   {_squares(row, by_id)}", ""]
        answers += [f"### {row['text']}", "", f"**The thesis.** {row['thesis']}", ""]
        holds = all(_answering(c, by_id).verdict == v for c, v in row["holds"].items())
        answer = f"**{row['answer']}**\n\n" if holds else ""
        ours = f"**This edition.** {answer}{_NAMED.sub(told, row['ours'].strip())}"
        answers += [typeset(ours), ""]
    return "\n".join([*overview, f"{_legend()}.", "", *answers])


def squares_markdown(rows: Iterable[Mapping[str, Any]], judged: Iterable[Judgement]) -> str:
    """The claims that help to answer each research question as squares, a line a question."""
    by_id = {j.claim.id: j for j in judged}
    lines = [f"{number}. {_squares(row, by_id)}" for number, row in enumerate(rows, 1)]
    return "\n".join([*lines, "", f"{_legend()}.", ""])


def _answering(claim: str, by_id: Mapping[str, Judgement]) -> Judgement:
    if claim not in by_id:
        raise ValueError(f"questions.toml names a claim {claim!r}, which is not there.")
    return by_id[claim]


def _squares(row: Mapping[str, Any], by_id: Mapping[str, Judgement]) -> str:
    """The claims of an answer as squares, by verdict."""
    ids = [claim for claim, evidence in _NAMED.findall(row["ours"]) if not evidence]
    named = sorted((_answering(c, by_id) for c in ids), key=lambda j: [*Verdict].index(j.verdict))
    return " ".join(
        f"[[{j.verdict}](#claim-{j.claim.id})]{{.square .{j.verdict.slug}}}" for j in named
    )


def _legend() -> str:
    """What the colours of squares mean."""
    settled = (Verdict.REPRODUCED, Verdict.DIRECTION, Verdict.NOT_REPRODUCED, Verdict.REFUTED)
    legend = [f"[]{{.square .{verdict.slug}}} {verdict}" for verdict in settled]
    return ", ".join([*legend, "[]{.square} open"])


def in_order(section: str) -> tuple[str, list[float]]:
    """A key that sorts what names sections, tables and figures in the thesis's order.

    A table or a figure comes after the sections of its chapter.

    >>> sorted(["B.1", "Table 3.1", "3.4.1", "Appendix A, fact 1", "3.3"], key=in_order)
    ['3.3', '3.4.1', 'Table 3.1', 'Appendix A, fact 1', 'B.1']
    """
    number = re.search(r"\b([A-C]|\d)(?:\.([\d.]*\d))?\b", section)
    if number is None:
        return "~", []  # the summary
    parts = [float(part) for part in (number[2] or "0").split(".")]
    return number[1], parts if section.startswith(number[0]) else [float("inf"), *parts]


def _tally(judged: Iterable[Judgement]) -> list[str]:
    """How many claims have which verdict, and how often it came out."""
    judged = list(judged)
    evidence = [j for j in judged if _counts(j)]
    identities = sum(
        j.claim.kind == "identity" and not (j.claim.ours or j.claim.rests_on) for j in judged
    )
    ours = sum(j.claim.ours for j in judged)
    repeated = sum(bool(j.claim.rests_on) for j in judged)
    rows = []
    for verdict in Verdict:
        own = [j for j in evidence if j.verdict is verdict]
        by = Counter(_frequency_class(j) for j in own)
        if own:
            mark = f"{verdict.badge}: {MEANING[verdict]}"
            often = ", ".join(f"{by[name]} {name}" for name in _CLASSES if by[name])
            rows.append((mark, len(own), often))
    rows.append(("all that are no proofs and repeat no other", len(evidence), ""))
    return [
        *rows_markdown(("verdict", "claims", "how often it came out"), rows, right=["claims"]),
        "",
        f"Besides these, {identities} claims are proofs or arithmetic, which no experiment can "
        f"deny, {repeated} repeat or sum up others, and {ours} are our own.",
        "",
    ]


def _state(
    judged: Sequence[Judgement], earlier: Set[str], *, flips: bool, mended: bool
) -> list[str]:
    """How many claims were judged over draws, and where those stand that differ or were mended.

    ``earlier`` are the claims whose verdicts over draws are of earlier code or runs; ``flips`` and
    ``mended`` say whether there are any.
    """
    drawn = [j for j in judged if j.over and not j.over.exact]
    if not drawn:
        return []
    waiting = sum(_frequency_class(j) == "waiting" for j in judged if not j.claim.rests_on)
    stale = sum(j.claim.id in earlier for j in drawn)
    judged_by = f"{stale} of them by an earlier" if stale else "all of them by the present"
    more = f"; {waiting} more wait for their draws" if waiting else ""
    lines = [
        f"Judged over draws are {len(drawn)} claims, {judged_by} state of the code or the "
        f"committed runs{more}."
    ]
    if on_one := sum(j.claim.id not in earlier and bool(j.over.confirmed) for j in drawn if j.over):
        lines.append(
            f"Of {on_one} the present state judged one draw only, which its code chose: the "
            "verdict and every number came out as they were, and those of the other draws stand."
        )
    after = ["those on which no verdict came out in eight of ten draws"] * flips
    after += ["those that changed ({numref}`tbl-claims-mended`)"] * mended
    if after:
        lines += [f"[](#scoreboard-more) lists {several(after)}."]
    return [*lines, ""]


def _flips(judged: Iterable[Judgement]) -> list[str]:
    """The claims on which no verdict came out in eight of ten draws."""
    flips = [
        f"- {_named(j.claim)}: {j.over.frequency}."
        for j in judged
        if j.over and not j.over.exact and not j.over.held
    ]
    if not flips:
        return []
    claims = f"{len(flips)} claim{'s' * (len(flips) > 1)}"
    return [f"## No verdict came out in eight of ten draws on {claims}", "", *flips, ""]


def _mended(judged: Iterable[Judgement]) -> list[str]:
    """The claims whose verdict changed when their criterion or its evidence was mended."""
    mended = [j for j in judged if j.claim.was not in ("", j.verdict, j.finding.verdict)]
    if not mended:
        return []
    title = "Verdicts that changed when a criterion or its evidence was mended"
    lines = ["## Verdicts that changed", "", f"::::{{list-table}} {title}"]
    lines += [":name: tbl-claims-mended", ":class: cards", ":header-rows: 1", ""]
    lines += ["* - claim", "  - was, and is", "  - because"]
    for j in mended:
        lines += [f"* - {_named(j.claim)}", f"  - {j.claim.was}, now {j.verdict}"]
        lines += [f"  - {j.claim.because}"]
    return [*lines, "::::", ""]


def _named(claim: Claim) -> str:
    """A claim's words, with its id as the link to its row."""
    return f"{typeset(claim.statement).removesuffix('.')} ([{claim.id}](#claim-{claim.id}))"


def _earlier(judged: Iterable[Judgement]) -> set[str]:
    """The claims whose verdicts over draws are of earlier code or runs."""
    return {j.claim.id for j in judged if _by_earlier_code(j)}


def _by_earlier_code(judgement: Judgement) -> bool:
    """Whether the committed verdicts over draws are of another state of the code or the runs."""
    claim, over = judgement.claim, judgement.over
    return over is not None and over.code != roots.code_of_claim(claim, over.budget)


def _by_more_runs(judgement: Judgement) -> Verdict | None:
    """The verdict on a committed table of more runs than the others had, where it is another."""
    over = judgement.over
    deeper = "thesis" in judgement.budget and over is not None and "thesis" not in over.budget
    return judgement.here if deeper else None


def _deeper(judged: Iterable[Judgement]) -> list[str]:
    """The claims on which a committed table of more runs gives another verdict."""
    found = [
        f"- {_named(j.claim)}: {j.in_words().replace('; here ', '; there ')}."
        for j in judged
        if _by_more_runs(j)
    ]
    if not found:
        return []
    claims = f"{len(found)} claim{'s read' if len(found) > 1 else ' reads'}"
    title = f"By a table of more runs, made at the thesis's budget, {claims} otherwise"
    return [f"## {title}", "", *found, ""]


def _frequency_class(judgement: Judgement) -> str:
    over = judgement.over
    if judgement.verdict is Verdict.NOT_RUN:
        return ""
    if over is None:
        return "waiting" if judgement.claim.experiments else "exact"
    if over.exact:
        return "exact"
    if over.held == over.of:
        return "in all draws"
    return "in most draws" if over.held else "in no eight of ten"


def _counts(judgement: Judgement) -> bool:
    """Whether a claim is the thesis's own, no repetition, and decided by evidence."""
    claim = judgement.claim
    return not claim.ours and not claim.rests_on and claim.kind == "evidence"


def _where(label: str, section: str) -> str:
    """A link to where our book treats a section of the thesis, that shows the thesis's name."""
    target = label or _CHAPTERS.get(in_order(section)[0], "")
    return f"[{section}](#{target})" if target else section


@dataclass(frozen=True)
class _Folded:
    """A part of a cell that unfolds: its title, and paragraphs or parts within it."""

    title: str
    parts: Sequence[str | _Folded]


def _dropdown(folded: _Folded) -> list[str]:
    """A part of a cell that unfolds, as plain HTML: the page has hundreds."""
    lines = ["", *_raw(f"<details><summary>{folded.title}</summary>"), ""]
    for part in folded.parts:
        lines += [f"    {typeset(part)}"] if isinstance(part, str) else _dropdown(part)
        lines += [""]
    return [*lines, *_raw("</details>")]


def _raw(markup: str) -> list[str]:
    return ["    ```{raw} html", f"    {markup}", "    ```"]
