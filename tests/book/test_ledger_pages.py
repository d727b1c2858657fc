"""The pages written from the ledger."""

import doctest
import json
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import pytest

from thesis_lib.book import ledger, roles
from thesis_lib.edition import chapters, roots
from thesis_lib.edition.ledger import Claim, Difference, Finding, Judgement, OverRoots, Verdict
from thesis_lib.edition.words import typeset

ROOT = Path(__file__).resolve().parents[2]
CLAIM = Claim(
    *("3.4.1-numbers", "Table 3.1", "The means are ours.", ("table-3.1",), "Near.", lambda _: None),
    headline=True,
    at="sec-table-3-1",
    figure="fig-ch3-table-3-1",
)
OVER = OverRoots({Verdict.REFUTED: 10}, "book", "", False)
JUDGED = Judgement(CLAIM, Finding(Verdict.REFUTED, "Off by 3."), "book", OVER)
OWN = Judgement(
    Claim("B.1-own", "B.1", "Ours.", (), "Exact.", lambda _: None, ours=True),
    Finding(Verdict.REPRODUCED, "It is."),
    "exact",
)


def test_a_claim_has_a_row_with_verdict_place_evidence_and_what_its_command_takes() -> None:
    page = ledger.scoreboard_markdown([OWN, JUDGED])
    assert "* - [refuted]{.verdict .refuted}\n    10 of 10\n  - (claim-3.4.1-numbers)=" in page
    for part in (
        "    The means are ours.",
        "    Off by 3.",
        "*Id*: `3.4.1-numbers`; shown in {numref}`fig-ch3-table",
        "  - [Table 3.1](#sec-table-3-1)\n    [headline]{.mark}",
    ):
        assert part in page, part
    assert "On the tables shown" not in page
    assert "claim-B.1-own" not in page
    ours = ledger.more_markdown([OWN, JUDGED])
    assert "## Claims of our own\n\n::::{list-table} Claims of our own, which" in ours
    for part in ("  - (claim-B.1-own)=", "*Id*: `B.1-own`.", "  - [B.1](#sec-ch4-appendix-b)\n"):
        assert part in ours, part
    assert "3.4.1-numbers" not in ours


def test_a_row_tells_where_the_tables_shown_say_another_verdict_and_how_they_are_made() -> None:
    claim = replace(CLAIM, experiments=("figure-4.4", "table-3.1"))
    found = Finding(Verdict.REPRODUCED, "It is.")
    deep = Judgement(claim, found, "book, thesis", OVER)
    page = ledger.scoreboard_markdown([deep])
    assert "*On the tables shown* the verdict is reproduced." in page
    assert (
        "`3.4.1-numbers`; shown is `thesis run figure-4.4 --budget "
        "thesis` (budget: book, thesis); shown in" in page
    )
    named = "The means are ours ([3.4.1-numbers](#claim-3.4.1-numbers))"
    listed = f"1 claim reads otherwise\n\n- {named}: refuted (10 of 10; there reproduced).\n"
    assert listed in ledger.more_markdown([deep])
    told = ledger.findings_markdown([deep])
    assert "[Refuted](#claim-3.4.1-numbers) (reproduced by a table of more runs).\n" in told
    drawn_deep = replace(deep, over=replace(OVER, budget="thesis"))
    assert "judged with `--budget thesis`" in ledger.scoreboard_markdown([drawn_deep])
    assert "judged with" not in page
    others = (
        drawn_deep,
        replace(deep, budget="book"),
        replace(deep, finding=JUDGED.finding),
    )
    for other in others:
        assert "otherwise" not in ledger.more_markdown([other])
        assert "more runs" not in ledger.findings_markdown([other])


def test_what_has_not_been_run_has_no_frequency() -> None:
    over = OverRoots({Verdict.NOT_RUN: 8}, "book", "", False)
    page = ledger.scoreboard_markdown(
        [replace(JUDGED, finding=Finding(Verdict.NOT_RUN, "Not yet."), over=over)]
    )
    assert "* - [not run]{.verdict .not-run}\n  - (claim-3.4.1-numbers)=" in page
    assert "has not been computed yet | 1 |  |" in page


def test_a_row_has_all_of_its_evidence_once_and_a_long_list_behind_a_click() -> None:
    items = [f"{name} {n} ± 1" for n, name in enumerate("abcdefghi", 10)]
    many = "Of 9: " + "; ".join(items) + ". So it is."
    page = ledger.scoreboard_markdown([replace(JUDGED, finding=Finding(Verdict.REFUTED, many))])
    head, _, rest = page.partition("<details><summary>… and the rest</summary>")
    assert "    Of 9: a 10 ± 1;" in head
    assert "i 18 ± 1. So it is." in rest
    for item in items:
        assert page.count(item) == 1
    assert "on the Scoreboard" not in page
    assert page.count("<details>") == page.count("</details>") == 2
    assert "the rest" not in ledger.scoreboard_markdown([JUDGED])


def test_evidence_that_two_claims_share_stands_with_the_first() -> None:
    long = replace(JUDGED, finding=Finding(Verdict.REFUTED, f"{'Off. ' * 40}By 3."))
    also = replace(long, claim=replace(CLAIM, id="3.4.1-also"))
    page = ledger.scoreboard_markdown([long, also])
    assert page.count("By 3.") == 1
    assert "That of [the claim 3.4.1-numbers](#claim-3.4.1-numbers)." in page
    short = [replace(j, finding=JUDGED.finding) for j in (long, also)]
    assert ledger.scoreboard_markdown(short).count("Off by 3.") == 2


def test_a_claim_that_rests_on_others_links_to_them() -> None:
    whole = replace(CLAIM, id="6.1-whole", rests_on=("3.4.1-a", "3.4.1-b"))
    page = ledger.scoreboard_markdown([replace(JUDGED, claim=whole)])
    assert "*Criterion*: That of [3.4.1-a](#claim-3.4.1-a) and [3.4.1-b](#claim-3.4.1-b).\n" in page


def test_every_claim_leads_to_a_section_and_its_figure_to_one_that_is_there() -> None:
    text = "\n".join(file.read_text(encoding="utf-8") for file in ROOT.glob("notebooks/*.ipynb"))
    places = set(re.findall(r"\((sec-[\w-]+)\)=", text))
    figures = set(re.findall(r"\b(?:fig|tbl)-[\w-]+", text))
    for claim in chapters.claims():
        assert claim.at in places, claim.id
        assert not claim.figure or claim.figure in figures, claim.id


def test_ids_stand_as_they_are_typed() -> None:
    for claim in chapters.claims():
        assert typeset(f"ID {claim.id};") == f"ID {claim.id};"


def test_a_difference_has_a_row() -> None:
    row = Difference(
        *("3-row", "3.4.1", "Q* of Q^mu", "It says.", "1e-5.", "`x`"), effect="Little."
    )
    page = ledger.differences_markdown([row], "nowhere")
    assert (
        "* - [3.4.1](#ch-potentials)\n  - (difference-3-row)=\n    **Q\\* of Q<sup>μ</sup>.** 10⁻⁵."
        in page
    )
    assert "*The thesis*: It says." in page
    assert "*What it changes*: Little." in page
    there = replace(row, at="sec-cliff")
    assert json.loads(ledger.by_place([there])) == {"sec-cliff": {"3-row": "Q* of Q^μ"}}


def test_other_pages_quote_verdict_and_evidence() -> None:
    finding = Finding(Verdict.REFUTED, "3 of 4. And so.")
    told = json.loads(ledger.quoted([replace(JUDGED, finding=finding)]))
    assert told["3.4.1-numbers"]["statement"] == "The means are ours."
    assert told["3.4.1-numbers"]["verdict"] == "refuted (10 of 10)"
    assert told["3.4.1-numbers"]["evidence"] == "3 of 4. And so."
    assert told["3.4.1-numbers"]["first"] == "3 of 4."


@pytest.mark.parametrize("built", [True, False])
def test_a_page_prints_what_a_claim_says(tmp_path: Path, *, built: bool) -> None:
    file = tmp_path / roles.LEDGER
    file.parent.mkdir(parents=True)
    file.write_text(ledger.quoted([JUDGED] if built else []), encoding="utf-8")
    env = SimpleNamespace(srcdir=tmp_path, note_dependency=lambda _: None)
    role = roles.Statement()
    role.inliner = SimpleNamespace(document=SimpleNamespace(settings=SimpleNamespace(env=env)))
    role.text = "3.4.1-numbers"
    (said,), _ = role.run()
    assert said == ("The means are ours." if built else "Not built.")


def test_what_is_new_says_each_claim_beside_its_verdict() -> None:
    lines = (ROOT / "book" / "new.md").read_text(encoding="utf-8").splitlines()
    for before, line in pairwise(lines):
        assert not re.search(r"(claim|implies)\*: \{verdict\}", line), line
        if verdict := re.fullmatch(r"\*Verdict\*: \{verdict\}`(.+)`\.", line):
            assert before.endswith(f"*: {{claim}}`{verdict[1]}`"), line
    assert sum("{claim}" in line for line in lines) >= 12


def test_findings_count_the_claims_of_the_thesis() -> None:
    ours = replace(OWN, claim=replace(OWN.claim, headline=True))
    text = ledger.findings_markdown([JUDGED, ours])
    assert "Of the thesis's 1 claims that are no proofs and repeat no other: 1 refuted." in text
    assert "- The means are ours. [Refuted](#claim-3.4.1-numbers)." in text
    assert "B.1-own" not in text


def test_sections_sort_as_in_the_thesis() -> None:
    sections = [
        "Summary",
        "B.1",
        "Table 3.1",
        "3.4.1",
        "Appendix A, fact 1",
        "3.3",
        "3.10",
        "5",
        "5.1",
    ]
    assert sorted(sections, key=ledger.in_order) == [
        *("3.3", "3.4.1", "3.10", "Table 3.1", "5", "5.1", "Appendix A, fact 1", "B.1"),
        "Summary",
    ]


def test_the_questions_name_claims_that_are_there() -> None:
    """Each of section 1.3's six questions has both answers."""
    rows = ledger.questions()
    assert len(rows) == 6
    named = {x for row in rows for x in re.findall(r"\{([^} ]+)[^}]*\}", row["ours"])}
    assert named <= {claim.id for claim in chapters.claims()}
    for row in rows:
        quoted = re.findall(r"\{(\S+) evidence\}", row["ours"])
        assert len(quoted) == 1, row["text"]
        assert f"{{{quoted[0]}}}" in row["ours"]  # a number stands beside its verdict
        assert row["thesis"]
        assert set(row["holds"]) <= set(re.findall(r"\{(\S+)\}", row["ours"]))


def test_the_answers_in_a_sentence_are_those_of_the_committed_verdicts() -> None:
    """Else the page leaves them out: write new ones."""
    over = roots.read()
    for row in ledger.questions():
        assert {claim: over[claim].verdict for claim in row["holds"]} == row["holds"], row["text"]


def test_questions_tell_verdicts() -> None:
    row = {"text": "What?", "thesis": "This.", "ours": "It is {3.4.1-numbers}."}
    row |= {"answer": "No Q_d.", "holds": {"3.4.1-numbers": "refuted"}}
    told = ledger.questions_markdown([row], [JUDGED])
    assert (
        "**This edition.** **No Q<sub>d</sub>.**\n\n"
        "It is [refuted](#claim-3.4.1-numbers).\n" in told
    )
    other = ledger.questions_markdown([row | {"holds": {"3.4.1-numbers": "reproduced"}}], [JUDGED])
    assert "**This edition.** It is [refuted](#claim-3.4.1-numbers).\n" in other
    assert "1. What?\n\n   [[refuted](#claim-3.4.1-numbers)]{.square .refuted}\n" in told
    assert "[]{.square .refuted} refuted, []{.square} open." in told
    squares = ledger.squares_markdown([row], [JUDGED])
    assert squares.startswith("1. [[refuted](#claim-3.4.1-numbers)]{.square .refuted}\n\n[]{")
    row |= {"ours": "It is {3.4.1-numbers}.\n{3.4.1-numbers evidence}"}
    more = Finding(Verdict.REFUTED, "Off by Q_d. Not by more.")
    quoted = ledger.questions_markdown([row], [replace(JUDGED, finding=more)])
    assert "(#claim-3.4.1-numbers).\nOff by Q<sub>d</sub>.\n" in quoted
    assert quoted.count("{.square .refuted}\n") == told.count("{.square .refuted}\n") == 1
    with pytest.raises(ValueError, match=r"'0\.2'"):
        ledger.questions_markdown([row | {"ours": "It is {0.2}."}], [JUDGED])


def test_the_scoreboard_tells_what_waits_what_flips_and_what_was_mended() -> None:
    split = OverRoots({Verdict.REFUTED: 6, Verdict.REPRODUCED: 4}, "book", "", False)
    mended = replace(CLAIM, id="3.4.1-mended", was="reproduced", because="Noise passed it.")
    waiting = Judgement(replace(CLAIM, id="3.4.1-waits"), JUDGED.finding, "book")
    same = Judgement(replace(mended, id="3.4.1-same", was="refuted"), JUDGED.finding, "book", OVER)
    judged = [replace(JUDGED, over=split), replace(JUDGED, claim=mended), waiting, same]
    page = ledger.scoreboard_markdown(judged)
    assert (
        "Judged over draws are 3 claims, 3 of them by an earlier state of the code or the "
        "committed runs; 1 more wait for their draws.\n"
        "[](#scoreboard-more) lists those on which no verdict came out in eight of ten draws "
        "and those that changed ({numref}`tbl-claims-mended`).\n" in page
    )
    after = ledger.more_markdown(judged)
    assert (
        "## No verdict came out in eight of ten draws on 1 claim\n\n- The means are ours "
        "([3.4.1-numbers](#claim-3.4.1-numbers)): refuted in 6, reproduced in 4 of 10.\n" in after
    )
    assert (
        "* - The means are ours ([3.4.1-mended](#claim-3.4.1-mended))\n"
        "  - reproduced, now refuted\n  - Noise" in after
    )
    assert "#claim-3.4.1-same" not in after
    tally = "| [refuted]{.verdict .refuted}: a proof, an exact computation or a significant"
    assert f"{tally} result says the opposite | 3 | 2 in all draws, 1 waiting |" in page


def test_the_scoreboard_tells_what_one_root_confirmed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ledger.roots, "code_of_claim", lambda claim, budget: "present")
    whole = OverRoots({Verdict.REFUTED: 8}, "book", "present", False)
    of_one = replace(whole, confirmed=3)
    earlier = replace(of_one, code="earlier")
    judged = [
        replace(JUDGED, claim=replace(CLAIM, id=f"3.4.1-{i}"), over=over)
        for i, over in enumerate((whole, of_one, of_one, earlier))
    ]
    page = ledger.scoreboard_markdown(judged)
    assert "Judged over draws are 4 claims, 1 of them by an earlier state" in page
    assert "\nOf 2 the present state judged one draw only, which its code chose:" in page
    assert "one draw only" not in ledger.scoreboard_markdown(judged[:1])


def test_a_verdict_that_changed_has_a_reason() -> None:
    with pytest.raises(ValueError, match="both a `was` and a `because`"):
        replace(CLAIM, was="refuted")
    with pytest.raises(ValueError, match="true"):
        replace(CLAIM, was="true", because="So it is.")


def test_the_examples_in_its_docstrings() -> None:
    assert doctest.testmod(ledger).failed == 0
