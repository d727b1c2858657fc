"""The ledger."""

from types import SimpleNamespace

import pandas as pd
import pytest

from thesis_lib import claims
from thesis_lib.claims import Claim, Difference, Finding, Verdict
from thesis_lib.experiments import base, experiments


def positive(tables: claims.Tables) -> Finding:
    mean = tables["toy"].value.mean()
    good = mean > 0
    return Finding(Verdict.REPRODUCED if good else Verdict.NOT_REPRODUCED, f"mean {mean:.1f}")


CLAIM = Claim("0.1-toy", "3.4.1", "The mean is positive.", ("toy",), "mean > 0", positive, True)


def saved(directory, values, budget="book"):
    experiment = base.Experiment(
        id="toy",
        item="Toy",
        title="",
        function=lambda config, context: pd.DataFrame({"value": values}),
        budgets=dict.fromkeys(base.BUDGETS, Finding(Verdict.NOT_RUN, "")),
        columns={"value": ""},
        seconds=dict.fromkeys(base.BUDGETS, 0.0),
    )
    experiment.run(budget).save(directory)


def test_verdict_comes_from_the_table(tmp_path):
    saved(tmp_path, [1.0, 2.0])
    assert claims.judge(CLAIM, tmp_path).finding == Finding(Verdict.REPRODUCED, "mean 1.5")
    saved(tmp_path, [-1.0, -2.0])
    assert claims.judge(CLAIM, tmp_path).finding.verdict is Verdict.NOT_REPRODUCED


def test_without_evidence_nothing_is_claimed(tmp_path):
    judged = claims.judge(CLAIM, tmp_path)
    assert judged.finding.verdict is Verdict.NOT_RUN
    assert "thesis run toy" in judged.finding.evidence


def test_smoke_evidence_is_inconclusive(tmp_path):
    saved(tmp_path, [1.0], budget="smoke")
    assert claims.judge(CLAIM, tmp_path).finding.verdict is Verdict.INCONCLUSIVE


def test_pages_tell_every_claim_and_difference(tmp_path, monkeypatch):
    saved(tmp_path, [1.0, 2.0])
    row = Difference(
        *("0.1-row", "3.4.1", "Topic", "says", "do", "`x`"),
        effect=lambda tables: f"mean {tables['toy'].value.mean():.1f}",
        experiments=("toy",),
    )
    monkeypatch.setattr(claims, "claims", lambda: (CLAIM,))
    monkeypatch.setattr(claims, "differences", lambda: (row,))
    page = claims.scoreboard_markdown(tmp_path)
    assert "**Verdict: reproduced.** mean 1.5" in page
    assert "## Chapter 3" in page
    assert "mean 1.5" in claims.differences_markdown(tmp_path)
    assert "Of 1 claims examined so far: 1 reproduced" in claims.findings_markdown(tmp_path)
    assert claims.scoreboard(tmp_path).loc[0, "verdict"] == "reproduced"


def test_every_claim_of_the_ledger_is_whole():
    known = experiments()
    for claim in claims.claims():
        assert claim.statement.endswith("."), claim.id
        assert claim.criterion.endswith("."), claim.id
        assert set(claim.experiments) <= set(known), claim.id
    for row in claims.differences():
        assert set(row.experiments) <= set(known), row.id
        assert all((row.thesis, row.ours, row.option)), row.id


def test_ids_are_unique(monkeypatch):
    module = SimpleNamespace(CLAIMS=(CLAIM, CLAIM))
    monkeypatch.setattr(claims, "CHAPTERS", ("one",))
    monkeypatch.setattr(claims, "import_module", lambda name: module)
    with pytest.raises(RuntimeError, match="twice"):
        claims.claims()


@pytest.mark.parametrize(
    ("section", "chapter"),
    [
        ("3.4.1", "Chapter 3"),
        ("Table 3.1", "Chapter 3"),
        ("Figure 4.3", "Chapter 4"),
        ("Appendix A", "Appendix A"),
        ("Appendix A, fact 1", "Appendix A"),
        ("Figure A.3", "Appendix A"),
    ],
)
def test_chapter_of_a_section(section, chapter):
    assert claims._chapter_of(section) == chapter
