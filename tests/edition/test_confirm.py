"""Verdicts of earlier code: they stand where one root, drawn by the code, comes out as it was."""

import pandas as pd
import pytest

from tests.edition.test_roots import CLAIMS, drawn, judged, known, toy
from thesis_lib.checks import ForeseenError
from thesis_lib.edition import confirm, roots
from thesis_lib.edition.experiment import read_csv

__all__ = ["known"]  # the fixture, used by every test here


@pytest.fixture
def file(tmp_path):
    """Verdicts on ten roots: of two claims on what is drawn, and of one that is exact."""
    made = tmp_path / "out" / "verdicts.csv"
    roots.save(judged(tmp_path), "book", made)
    return made


@pytest.fixture
def other_code(monkeypatch):
    """The code of claims and of tables is another from here on."""

    def change():
        monkeypatch.setattr(roots, "code_of_table", lambda experiment, config: "other")
        monkeypatch.setattr(roots, "code_of_claim", lambda claim, budget: f"other {claim.id}")

    return change


def confirmed(file, tmp_path, lines=None):
    say = [].append if lines is None else lines.append
    waiting = confirm.aged(CLAIMS, file)
    found = confirm.confirm(waiting, file, budget="book", work=tmp_path / "work", say=say)
    return {aged.claim.id: aged.why for aged in found}


def test_nothing_is_done_where_the_code_is_the_same(file, tmp_path):
    before = file.read_bytes()
    assert confirm.aged(CLAIMS, file) == []
    assert confirmed(file, tmp_path) == {}
    assert file.read_bytes() == before


def test_one_root_lets_all_stand(file, tmp_path, other_code):
    before = read_csv(file)
    other_code()
    lines = []
    assert confirmed(file, tmp_path, lines) == {"often": "", "seldom": "", "sure": ""}
    # One table of each experiment is made, of ten and one.
    assert len(lines) == 2
    after = read_csv(file)
    unchanged = ["claim", "root", "verdict", "budget", "numbers", "criterion", "commit"]
    pd.testing.assert_frame_equal(before[unchanged], after[unchanged])
    assert (after.code == "other " + after.claim).all()
    roots_used = set(after.confirmed[after.claim != "sure"])
    assert len(roots_used) == 1
    assert roots_used <= set(range(1, 9))
    assert (after.confirmed[after.claim == "sure"] == 0).all()  # judged whole
    assert confirm.aged(CLAIMS, file) == []


def test_the_code_draws_the_root(file, monkeypatch):
    """Over many states of the code every root that was judged comes up, and no other."""
    drawn_roots = set()
    for state in range(200):
        monkeypatch.setattr(roots, "code_of_claim", lambda claim, budget, s=state: f"{s} {claim}")
        drawn_roots.add(confirm._root(CLAIMS, "book", most=8))
    assert drawn_roots == set(range(1, 9))


def test_a_number_that_moves_is_to_be_judged_anew(file, tmp_path, other_code, known):
    before = read_csv(file)
    other_code()
    known["drawn"] = toy("drawn", lambda config, context: drawn(config, context) + 1e-2)
    why = confirmed(file, tmp_path)
    assert why["sure"] == ""
    assert why["often"].startswith("on root ")
    assert "its numbers were" in why["often"]
    after = read_csv(file)
    own = after.claim != "sure"
    pd.testing.assert_frame_equal(before[own], after[own])
    assert [claim.id for claim in confirm.aged(CLAIMS, file)] == ["often", "seldom"]


def test_a_verdict_that_moves_is_to_be_judged_anew(file, tmp_path, other_code, known):
    other_code()
    known["drawn"] = toy("drawn", lambda config, context: -drawn(config, context))
    root = confirm._root(CLAIMS, "book", most=8)
    was = "reproduced" if root >= 3 else "refuted"
    why = confirmed(file, tmp_path)["often"]
    if was == "reproduced":
        assert why == f"on root {root} it was reproduced, and is refuted"
    else:
        assert "its numbers were" in why


def test_another_criterion_needs_every_root(file, tmp_path, other_code, monkeypatch):
    other_code()
    monkeypatch.setattr(roots, "code_of_criterion", lambda claim: "other")
    why = confirmed(file, tmp_path)
    assert why == {"often": "its criterion is another", "seldom": why["often"], "sure": ""}


def test_evidence_that_is_drawn_now_needs_every_root(file, tmp_path, other_code, known):
    other_code()
    known["fixed"] = toy("fixed", drawn)
    assert confirmed(file, tmp_path)["sure"] == "its evidence was exact, and is drawn now"


def test_a_table_that_is_missing_is_told(tmp_path):
    with pytest.raises(ForeseenError, match=r"no verdicts to confirm, for .* --out"):
        confirm.aged(CLAIMS, tmp_path / "verdicts.csv")


def reused(tmp_path, n=10):
    lines = []
    found = confirm.reuse(CLAIMS, n, budget="book", work=tmp_path / "work", say=lines.append)
    return found, lines


def test_tables_of_earlier_code_stand_where_one_is_as_it_was(file, tmp_path, other_code):
    other_code()
    found, lines = reused(tmp_path)
    assert found == ["drawn"]  # of what is exact there is one table, which is made anew
    assert len(lines) == 1
    root = int(lines[0].partition("root ")[2].partition(":")[0])
    judged_again = judged(tmp_path, lines=lines)
    assert len(lines) == 2  # that one
    by = {j.claim.id: j.confirmed for j in judged_again}
    assert by == {"often": root, "seldom": root, "sure": 0}
    roots.save(judged_again, "book", file)
    table = read_csv(file)
    assert (table.confirmed[table.claim != "sure"] == root).all()
    assert reused(tmp_path) == ([], [])


def test_a_table_that_differs_in_a_bit_lets_none_stand(file, tmp_path, other_code, known):
    other_code()
    known["drawn"] = toy("drawn", lambda config, context: drawn(config, context) + 1e-12)
    found, lines = reused(tmp_path)
    assert found == []
    assert len(lines) == 1
    judged(tmp_path, lines=lines)
    assert len(lines) == 11  # the other nine roots, and what is exact


def test_without_tables_there_is_nothing_to_reuse(tmp_path):
    assert reused(tmp_path) == ([], [])
