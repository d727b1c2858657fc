"""The ledger."""

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest

from thesis_lib.edition import chapters, ledger, scoreboard
from thesis_lib.edition import experiment as base
from thesis_lib.edition.ledger import Claim, Difference, Finding, Verdict, criterion, effect_of


def positive(tables: ledger.Tables) -> Finding:
    mean = tables["toy"].value.mean()
    good = mean > 0
    return Finding(Verdict.REPRODUCED if good else Verdict.NOT_REPRODUCED, f"mean {mean:.1f}")


@dataclass(frozen=True)
class Config:
    value: tuple[float, ...] = ()


CLAIM = Claim("0.1-toy", "3.4.1", "The mean is positive.", ("toy",), "mean > 0", positive, True)


TOY = base.Experiment(
    id="toy",
    item="Toy",
    title="",
    function=lambda config, context: pd.DataFrame({"value": config.value}),
    budgets=dict.fromkeys(base.BUDGETS, Config()),
    columns={"value": ""},
    seconds=0.0,
)


@criterion("0.1-toy", TOY)
def JUDGED(table):  # noqa: N802
    return positive({"toy": table})


def saved(directory, values, budget="book"):
    budgets = dict.fromkeys(base.BUDGETS, Config(tuple(values)))
    replace(TOY, budgets=budgets).run(budget).save(directory)


def test_verdict_comes_from_the_table(tmp_path):
    saved(tmp_path, [1.0, 2.0])
    assert ledger.judge(CLAIM, tmp_path).finding == Finding(Verdict.REPRODUCED, "mean 1.5")
    small = replace(CLAIM, judge=lambda tables: Finding(Verdict.REFUTED, "mean 3e-7"))
    assert ledger.judge(small, tmp_path).finding.evidence == "mean 3 × 10⁻⁷"
    saved(tmp_path, [-1.0, -2.0])
    assert ledger.judge(CLAIM, tmp_path).finding.verdict is Verdict.NOT_REPRODUCED


def test_a_claim_without_its_table_is_an_error(tmp_path, monkeypatch):
    with pytest.raises(FileNotFoundError, match="thesis run toy"):
        ledger.judge(CLAIM, tmp_path)
    monkeypatch.setattr(scoreboard, "claims", lambda: (CLAIM,))
    with pytest.raises(FileNotFoundError, match="thesis run toy"):
        scoreboard.judge_all(tmp_path)
    (judged,) = scoreboard.judge_all(tmp_path, draft=True)
    assert judged.verdict is Verdict.NOT_RUN


def test_smoke_evidence_is_inconclusive(tmp_path):
    saved(tmp_path, [1.0], budget="smoke")
    assert ledger.judge(CLAIM, tmp_path).finding.verdict is Verdict.INCONCLUSIVE


def test_every_claim_is_judged(tmp_path, monkeypatch):
    saved(tmp_path, [1.0, 2.0])
    monkeypatch.setattr(scoreboard, "claims", lambda: (CLAIM,))
    assert [j.verdict for j in scoreboard.judge_all(tmp_path)] == [Verdict.REPRODUCED]


def test_what_a_difference_changes(tmp_path):
    row = Difference(
        *("0.1-row", "3.4.1", "Topic", "says", "do", "`x`"),
        effect=lambda tables: f"mean {tables['toy'].value.mean():.1f}",
        experiments=("toy",),
    )
    assert scoreboard.effect(row, tmp_path).startswith("Not computed yet")
    saved(tmp_path, [1.0, 2.0])
    assert scoreboard.effect(row, tmp_path) == "mean 1.5"


def test_every_claim_of_the_ledger_is_whole():
    known = chapters.experiments()
    for claim in chapters.claims():
        assert claim.statement.endswith("."), claim.id
        assert claim.criterion.endswith("."), claim.id
        assert set(claim.experiments) <= set(known), claim.id
    for row in chapters.differences():
        assert set(row.experiments) <= set(known), row.id
        assert all((row.thesis, row.ours, row.option)), row.id


OUTCOME = re.compile(r"reproduc|refut|confirm|disprov|contradict|inconclusive", re.IGNORECASE)


def judging_texts(source: str) -> Iterator[str]:
    """Texts in functions that judge, their docstrings left out."""
    for function in ast.walk(ast.parse(source)):
        if isinstance(function, ast.FunctionDef):
            body = function.body[ast.get_docstring(function) is not None :]
            parts = [part for line in body for part in ast.walk(line)]
            made = {ast.unparse(part.func) for part in parts if isinstance(part, ast.Call)}
            judges = any("criterion(" in ast.unparse(d) for d in function.decorator_list)
            if judges or made & {"Finding", "judged"}:
                yield from (p.value for p in parts if isinstance(getattr(p, "value", 0), str))


def test_what_is_judged_by_hand_gives_numbers_and_leaves_the_outcome_to_the_verdict():
    """A sentence with an outcome of its own would stay when the numbers turn."""
    package = Path(chapters.__file__).parents[1]
    files = [f for name in chapters.CHAPTERS for f in (package / name).glob("*.py")]
    texts = [text for file in files for text in judging_texts(file.read_text())]
    assert len(texts) > 1000
    assert [text for text in texts if OUTCOME.search(text)] == []
    own = 'def f(t):\n    """Refuted."""\n    return judged(t > 0, f"{t} confirms it")'
    assert [text for text in judging_texts(own) if OUTCOME.search(text)] == [" confirms it"]


def test_ids_are_unique(monkeypatch):
    monkeypatch.setattr(chapters, "CHAPTERS", ("one", "two"))
    monkeypatch.setattr(chapters, "chapter", lambda name: chapters.Chapter((), (CLAIM,), ()))
    with pytest.raises(RuntimeError, match="twice"):
        chapters.claims()


def test_an_id_that_is_not_there_names_the_nearest(monkeypatch):
    toy = replace(TOY, id="ch0-toy")
    monkeypatch.setattr(chapters, "experiments", lambda: {"ch0-toy": toy})
    assert chapters.find("ch0-toy") is toy
    with pytest.raises(ValueError, match="did you mean ch0-toy"):
        chapters.find("ch0-tay")


class TestReadChapter:
    """Words in ``claims.toml``, functions beside the experiments."""

    WORDS = """
        modules = ["toy"]

        [[claim]]
        id = "0.1-toy"
        section = "3.4.1"
        statement = "The mean is positive."
        criterion = "Mean above 0."
        kind = "identity"

        [[claim]]
        id = "0.2-lost"
        section = "3.4.1"
        statement = "The figure shows it."
        not_testable = "The figure is lost."

        [[difference]]
        id = "0.1-row"
        section = "3.4.1"
        topic = "Topic"
        thesis = "says"
        ours = "do"
        option = "`x`"
        claim = "0.1-toy"
    """

    @pytest.fixture(autouse=True)
    def _modules(self, monkeypatch):
        monkeypatch.setattr(chapters, "import_module", lambda name: self.module)

    def chapter(self, tmp_path, words=WORDS, **members):
        (tmp_path / "claims.toml").write_text(words)
        self.module = SimpleNamespace(**{"toy": TOY, "judged": JUDGED, **members})
        package = SimpleNamespace(__name__="toys", __file__=str(tmp_path / "__init__.py"))
        return chapters.read_chapter(package)

    def test_words_and_functions_meet(self, tmp_path):
        chapter = self.chapter(tmp_path)
        assert chapter.experiments == (TOY,)
        mean, lost = chapter.claims
        assert mean.experiments == ("toy",)
        assert mean.kind == "identity"
        tables = {"toy": pd.DataFrame({"value": [1.0, 2.0]})}
        assert mean.judge(tables) == Finding(Verdict.REPRODUCED, "mean 1.5")
        assert lost.judge({}) == Finding(Verdict.NOT_TESTABLE, "The figure is lost.")
        assert chapter.differences[0].effect(tables) == "mean 1.5"

    def test_a_page_may_be_about_some_of_the_results(self, tmp_path):
        self.chapter(tmp_path)
        package = SimpleNamespace(__name__="toys", __file__=str(tmp_path / "__init__.py"))
        own = chapters.read_chapter(package, ("toy",))
        assert [claim.id for claim in own.claims] == ["0.1-toy"]
        assert [row.id for row in own.differences] == ["0.1-row"]
        assert chapters.read_chapter(package, ()) == chapters.Chapter((), (), ())

    def test_what_cannot_be_tested_may_be_illustrated(self, tmp_path):
        shown = criterion("0.2-lost", TOY)(lambda table: Finding(Verdict.REPRODUCED, "Ours does."))
        lost = self.chapter(tmp_path, shown=shown).claims[1]
        assert lost.experiments == ("toy",)
        found = lost.judge({"toy": pd.DataFrame()})
        assert found == Finding(Verdict.NOT_TESTABLE, "The figure is lost. Ours does.")

    def test_a_criterion_can_be_asked_of_any_table(self):
        assert JUDGED(pd.DataFrame({"value": [-1.0]})).verdict is Verdict.NOT_REPRODUCED

    @pytest.mark.parametrize(
        ("words", "members", "message"),
        [
            (WORDS, {"judged": None}, "'0.1-toy' must have a criterion"),
            (WORDS, {"again": criterion("0.1-toy", TOY)(JUDGED)}, "'0.1-toy' has two functions"),
            (WORDS, {"more": criterion("0.9", TOY)(JUDGED)}, "claims.toml has no claim '0.9'"),
            (WORDS, {"told": effect_of("0.1-row", TOY)(str)}, "'0.1-row' must have exactly one"),
        ],
    )
    def test_every_row_has_exactly_one_function(self, tmp_path, words, members, message):
        with pytest.raises(RuntimeError, match=message):
            self.chapter(tmp_path, words, **members)


@pytest.mark.parametrize(
    ("verdicts", "expected"),
    [
        ([Verdict.REPRODUCED], Verdict.REPRODUCED),
        ([Verdict.REPRODUCED] * 2, Verdict.REPRODUCED),
        ([Verdict.REPRODUCED, Verdict.REFUTED], Verdict.REFUTED),
        ([Verdict.NOT_REPRODUCED, Verdict.REFUTED], Verdict.REFUTED),
        ([Verdict.INCONCLUSIVE, Verdict.NOT_REPRODUCED], Verdict.NOT_REPRODUCED),
        ([Verdict.INCONCLUSIVE, Verdict.DIRECTION], Verdict.INCONCLUSIVE),
        ([Verdict.DIRECTION, Verdict.REPRODUCED], Verdict.DIRECTION),
    ],
)
def test_a_claim_that_rests_on_others(verdicts, expected):
    parts = [
        replace(CLAIM, id=str(i), experiments=(f"e{i}",), judge=lambda t, v=v: Finding(v, "So."))
        for i, v in enumerate(verdicts)
    ]
    whole = CLAIM.resting_on(parts)
    assert whole.experiments == tuple(f"e{i}" for i in range(len(parts)))
    assert whole.judge({}).verdict is expected


def test_a_claim_that_rests_on_others_is_tested_where_the_first_is():
    first = replace(CLAIM, at="sec-toy", figure="fig-toy")
    assert CLAIM.resting_on([first]).at == CLAIM.resting_on([first, CLAIM]).at == "sec-toy"
    assert CLAIM.resting_on([first]).figure == "fig-toy"
    assert CLAIM.resting_on([first, CLAIM]).figure == ""  # one figure does not show both
    assert replace(CLAIM, at="sec-own").resting_on([first]).at == "sec-own"


def test_a_claim_cannot_rest_on_what_is_not_there(monkeypatch):
    monkeypatch.setattr(chapters, "CHAPTERS", ("one",))
    lost = replace(CLAIM, rests_on=("9.9",))
    monkeypatch.setattr(chapters, "chapter", lambda name: chapters.Chapter((), (lost,), ()))
    with pytest.raises(RuntimeError, match=r"rests on '9\.9'"):
        chapters.claims()
