"""Committed tables at the thesis's budget give way to nothing shallower."""

import json
from dataclasses import asdict, dataclass

import pandas as pd
import pytest

from thesis_lib.checks import as_json
from thesis_lib.edition import chapters, deepest
from thesis_lib.edition import page as nb
from thesis_lib.edition.experiment import Experiment, load
from thesis_lib.edition.ledger import Claim, Finding, Verdict, judge


@dataclass(frozen=True)
class Config:
    runs: tuple[int, ...] = (1,)


def count(config, context):
    return pd.DataFrame({"runs": [config.runs[0]]})


BUDGETS = {"smoke": Config(), "book": Config((10,)), "thesis": Config((500,))}
TOY = Experiment("toy", "toy", "", count, BUDGETS, {"runs": ""}, 0.0)
CLAIM = Claim(
    *("c", "4", "So it is.", ("toy",), "500 runs."),
    lambda tables: Finding(Verdict.REPRODUCED, f"{tables['toy'].runs.iloc[0]} runs."),
)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(deepest, "committed", lambda: tmp_path / "thesis")
    TOY.run("thesis").save(tmp_path / "thesis")
    return tmp_path


@pytest.mark.parametrize(("budget", "runs"), [("smoke", 1), ("book", 500), ("thesis", 500)])
def test_only_a_table_of_the_book_gives_way(folder, budget, runs):
    table, provenance = deepest.deepest(*_parts(TOY.run(budget)))
    assert table.runs.tolist() == [runs]
    assert provenance["budget"] == ("smoke" if budget == "smoke" else "thesis")


def test_page_and_ledger_judge_the_same_table(folder):
    TOY.run("book").save(folder / "book")
    assert judge(CLAIM, folder / "book").finding.evidence == "500 runs."
    assert judge(CLAIM, folder / "book").budget == "thesis"
    page = nb.Page("book", claims={"c": CLAIM})
    assert page.run(TOY).runs.tolist() == [10]
    assert page.evidence("c") == "500 runs."


def test_a_book_budget_that_is_the_thesiss_shows_its_own_run(folder):
    own = Experiment("toy", "toy", "", count, BUDGETS | {"book": Config((500,))}, TOY.columns, 0.0)
    assert deepest.deepest(*_parts(own.run("book")))[1]["budget"] == "book"


def test_what_is_committed_was_made_at_the_thesiss_budget_as_it_is():
    records = sorted(deepest.committed().glob("*.json"))
    assert records
    for record in records:
        experiment = chapters.find(record.stem)
        table, provenance = load(record.stem, record.parent)
        config = json.loads(json.dumps(asdict(experiment.config("thesis")), default=as_json))
        assert (provenance["budget"], provenance["config"]) == ("thesis", config)
        assert config != json.loads(json.dumps(asdict(experiment.config("book")), default=as_json))
        assert set(table) == set(experiment.columns)


def _parts(result):
    return result.table, result.provenance
