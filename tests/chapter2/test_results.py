"""Every result of chapter 2 at the smoke budget, and the ledger's rows for it."""

import pytest

from thesis_lib import chapter2
from thesis_lib.edition.chapters import read_chapter

CHAPTER = read_chapter(chapter2)


@pytest.mark.parametrize("experiment", CHAPTER.experiments, ids=lambda e: e.id)
def test_smoke_budget_runs_and_is_the_same_for_any_number_of_workers(experiment):
    one, two = (experiment.run("smoke", seed=5, workers=n).table for n in (1, 2))
    assert one.equals(two)
    assert len(one) > 0


def test_the_ledger_has_every_row_and_says_where_it_is_shown():
    assert len(CHAPTER.experiments) == 11
    assert len(CHAPTER.claims) == 16
    assert len(CHAPTER.differences) == 5
    assert all(row.at.startswith("sec-") for row in (*CHAPTER.claims, *CHAPTER.differences))
