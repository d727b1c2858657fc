"""Every result of chapter 3 at the smoke budget, and the ledger's rows for it."""

import pytest

from thesis_lib import chapter3
from thesis_lib.edition.chapters import read_chapter

CHAPTER = read_chapter(chapter3)


@pytest.mark.parametrize("experiment", CHAPTER.experiments, ids=lambda e: e.id)
def test_smoke_budget_runs_and_is_the_same_for_any_number_of_workers(experiment):
    one = experiment.run("smoke", seed=5, workers=1).table
    two = experiment.run("smoke", seed=5, workers=2).table
    ours = [c for c in one.columns if c != "cpu_seconds"]
    assert one[ours].equals(two[ours])
    assert len(one) > 0


def test_the_ledger_has_every_row_and_says_where_it_is_shown():
    assert len(CHAPTER.claims) == 53
    assert len(CHAPTER.differences) == 20
    assert all(row.at.startswith("sec-") for row in (*CHAPTER.claims, *CHAPTER.differences))
    assert [c.id for c in CHAPTER.claims if c.ours] == [
        "3.4.4-constant",
        "3.3.5-tour-as-potential",
        "3.6-reversal-is-level",
    ]
