"""Every result of chapter 4 at the smoke budget, and the ledger's rows for it."""

import re
from importlib import import_module
from pathlib import Path

import pytest

from thesis_lib import chapter4
from thesis_lib.edition.chapters import read_chapter
from thesis_lib.edition.ledger import Verdict

CHAPTER = read_chapter(chapter4)
NOTEBOOKS = [*(Path(__file__).resolve().parents[2] / "notebooks").glob("ch04_*.ipynb")]


@pytest.mark.parametrize("experiment", CHAPTER.experiments, ids=lambda e: e.id)
def test_smoke_budget_is_the_same_for_any_number_of_workers(experiment, smoke):
    one, two = smoke[experiment.id], experiment.run("smoke", seed=5, workers=2).table
    ours = [c for c in one.columns if c != "cpu_seconds"]
    assert one[ours].equals(two[ours])
    assert len(one) > 0


@pytest.mark.parametrize("claim", CHAPTER.claims, ids=lambda c: c.id)
def test_every_claim_can_be_judged(claim, smoke):
    finding = claim.judge(smoke)
    assert isinstance(finding.verdict, Verdict)
    assert finding.evidence.endswith(".")
    assert "nan" not in finding.evidence


@pytest.mark.parametrize("difference", CHAPTER.differences, ids=lambda d: d.id)
def test_every_difference_can_be_told(difference, smoke):
    effect = difference.effect
    assert len(effect(smoke) if callable(effect) else effect) > 20


def test_the_ledger_has_every_row_and_says_where_it_is_shown():
    assert len(CHAPTER.claims) == 81
    assert len(CHAPTER.differences) == 29
    text = "".join(file.read_text(encoding="utf-8") for file in NOTEBOOKS)
    for row in (*CHAPTER.claims, *CHAPTER.differences):
        assert f"({row.at})=" in text, row.id
    for claim in CHAPTER.claims:
        assert f'"{claim.figure}"' in text.replace('\\"', '"'), claim.id
    headlines = [claim.id for claim in CHAPTER.claims if claim.headline]
    assert headlines == [
        "4.1.2-theorem-2",
        "4.3-triangle-improves",
        "4.3-stock-outperforms",
        "4.3-heat-jump",
    ]


def test_a_claim_with_a_figure_stands_where_both_this_and_its_runs_are():
    at_home = 0
    for file in NOTEBOOKS:
        text = file.read_text(encoding="utf-8").replace('\\"', '"')
        runs = {
            getattr(import_module(f"thesis_lib.chapter4.{module}"), name).id
            for module, name in re.findall(r"page\.run\((\w+)\.(\w+)\)", text)
        }
        named = {*re.findall(r"""name(?:=|": )"([\w-]+)\"""", text)}
        for claim in CHAPTER.claims:
            if claim.figure and f"({claim.at})=" in text:
                assert claim.figure in named, claim.id
                assert runs >= {*claim.experiments}, claim.id
                at_home += 1
    assert at_home == sum(bool(claim.figure) for claim in CHAPTER.claims)
