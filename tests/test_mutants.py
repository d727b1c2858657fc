"""The drill of mutants fits the library as it is; running it takes an hour (benchmarks)."""

import runpy
from pathlib import Path

import pytest

from thesis_lib.edition.chapters import chapter
from thesis_lib.edition.saved import saved

ROOT = Path(__file__).parents[1]
MUTANTS = runpy.run_path(str(ROOT / "benchmarks" / "mutants.py"))["MUTANTS"]


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda m: m.name)
def test_it_changes_one_place_and_names_what_must_notice(mutant) -> None:
    text = (ROOT / "thesis_lib" / mutant.file).read_text(encoding="utf-8")
    assert text.count(mutant.before) == 1
    assert mutant.before != mutant.after
    file, which = mutant.test
    tests = (ROOT / file).read_text(encoding="utf-8")
    assert any(part in tests for part in which.split(" or "))
    assert mutant.claims or mutant.reason
    if mutant.claims:
        name, *ids = mutant.claims
        assert set(ids) <= {claim.id for claim in chapter(name).claims}


def test_every_mutant_of_the_committed_table_is_noticed() -> None:
    """By a test, and by a verdict or a reason why no claim depends on it."""
    table = saved("mutants/mutants").table
    known = {mutant.name: mutant for mutant in MUTANTS}
    assert set(table.mutant) == set(known)
    assert table.caught.all()
    for row in table.itertuples():
        mutant = known[row.mutant]
        assert row.file == mutant.file
        assert row.moved > 0 or (row.reason == mutant.reason != "")
