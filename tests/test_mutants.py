"""The drill of mutants fits the library as it is; running it takes an hour (benchmarks)."""

import runpy
from pathlib import Path

import pytest

from thesis_lib.book.mutants import code_of_mutant
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
    """By a test, and by a verdict that moves or a reason why no claim depends on it."""
    table = saved("mutants/mutants").table
    known = {mutant.name: mutant for mutant in MUTANTS}
    assert set(table.mutant) == set(known)
    assert table.caught.all()
    for row in table.itertuples():
        mutant = known[row.mutant]
        assert row.file == mutant.file
        assert row.moved > 0 or (row.reason == mutant.reason != "")
        errors = str(row.verdicts).count("-> error")
        assert row.stopped == errors, "what stops with an error has moved no verdict"
        assert row.moved <= len(mutant.claims[1:]) - errors


def test_a_digest_ties_a_row_to_its_module_its_test_and_its_claims() -> None:
    one = ("mdp/greedy.py", "tests/mdp/test_greedy.py -k 'all_actions'", (), "book")
    code = code_of_mutant(*one)
    assert code == code_of_mutant(*one[:1], "tests/mdp/test_greedy.py", *one[2:])
    for other in (
        ("mdp/evaluation.py", *one[1:]),
        (one[0], "tests/mdp/test_evaluation.py", *one[2:]),
        (*one[:2], ("A.1-values",), one[3]),
    ):
        assert code_of_mutant(*other) != code
