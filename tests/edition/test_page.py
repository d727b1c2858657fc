"""What notebooks call."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import nbformat
import numpy as np
import pandas as pd
import papermill
import pytest
from nbformat.v4 import new_code_cell, new_notebook

from thesis_lib.edition import page as nb
from thesis_lib.edition.experiment import Experiment
from thesis_lib.edition.ledger import Claim, Finding, OverRoots, Tables, Verdict

GOOD = {"budget": "smoke", "seed": 0, "workers": 1}
CELL = "budget: str = 'book'\nseed: int = 0\nworkers: int = 2"


@pytest.fixture(autouse=True)
def shown(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What the helpers display."""
    found: list[Any] = []
    monkeypatch.setattr(nb, "display", found.append)
    with mpl.rc_context():
        yield found


def test_start_returns_the_parameters_and_warns_at_smoke(shown: list[Any]) -> None:
    page = nb.start(GOOD)
    assert (page.budget, page.seed, page.workers) == ("smoke", 0, 1)
    forms = shown[0]._repr_mimebundle_()
    assert "shapes, not values" in forms["text/markdown"]
    assert "shapes, not values" in forms["text/html"]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"budget": "fast"}, "'fast'.*smoke, book, thesis"),
        ({"seed": -1}, "-1"),
        ({"seed": 1.5}, "1.5"),
        ({"workers": 0}, "0.*at least 1"),
        ({"workers": True}, "True.*at least 1"),
    ],
)
def test_values_that_do_not_exist_stop_at_once(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        nb.start(GOOD | wrong)


def test_forgotten_parameters_cell_is_named() -> None:
    with pytest.raises(ValueError, match="did not set seed, workers"):
        nb.start({"budget": "smoke"})


@pytest.mark.parametrize("injected", ["# Parameters\nbuget = 'smoke'", "# Parameters\nn_runs = 3"])
def test_unknown_names_that_papermill_injects_stop_at_once(injected: str) -> None:
    name = injected.split()[2]
    with pytest.raises(ValueError, match=f"{name}.*takes budget, seed, workers"):
        nb.start(GOOD | {"In": ["", CELL, injected]})


def test_known_injected_names_pass() -> None:
    nb.start(GOOD | {"In": ["", CELL + "\nn_runs = 1", "# Parameters\nn_runs = 3"]})


def test_what_papermill_adds_by_itself_passes() -> None:
    """``--inject-paths`` and its like."""
    added = "# Parameters\nPAPERMILL_INPUT_PATH = 'a'\nPAPERMILL_OUTPUT_PATH = 'b'\nseed = 1"
    nb.start(GOOD | {"In": ["", CELL, added]})


def test_unknown_parameter_stops_papermill(tmp_path: Path) -> None:
    source, out = tmp_path / "in.ipynb", tmp_path / "out.ipynb"
    start = "from thesis_lib.edition.page import start\nstart(globals())"
    cells = [
        new_code_cell(CELL, metadata={"tags": ["parameters"]}),
        new_code_cell(start),
        new_code_cell("print('went on')"),
    ]
    spec = {"name": "python3", "display_name": "Python 3", "language": "python"}
    nbformat.write(new_notebook(cells=cells, metadata={"kernelspec": spec}), source)
    with pytest.raises(papermill.PapermillExecutionError, match="unknown parameter 'buget'"):
        papermill.execute_notebook(source, out, {"buget": "smoke"}, progress_bar=False)
    assert not nbformat.read(out, as_version=4).cells[-1].outputs


def test_style_is_opaque_whatever_the_users_own_is() -> None:
    mpl.rcParams.update({"text.color": "white", "text.usetex": True, "figure.facecolor": "none"})
    nb.start(GOOD)
    assert mpl.rcParams["text.color"] == "black"
    assert not mpl.rcParams["text.usetex"]
    assert mpl.rcParams["figure.facecolor"] == "white"
    assert mpl.rcParams["savefig.facecolor"] == "white"


def test_table(shown: list[Any]) -> None:
    frame = pd.DataFrame(
        {
            "potential": ["none", "a|b"],
            "mean": [-4.114, np.nan],
            "n": [100, 3],
            "sensor": [True, False],
            "error": ["1,200 ± 30", "not run"],
        }
    )
    nb.table(frame, name="tbl-x", caption="Returns, $R$.", decimals={"mean": 1})
    forms = shown[0]._repr_mimebundle_()
    assert forms["text/markdown"].splitlines() == [
        "::::{table} Returns, $R$.",
        ":name: tbl-x",
        "",
        "| potential | mean | n | sensor | error |",
        "| :--- | ---: | ---: | :--- | :--- |",
        "| none | −4.1 | 100 | yes | 1,200\u00a0±\u00a030 |",  # no number breaks
        "| a\\|b | – | 3 | no | not run |",
        "::::",
    ]
    assert "<caption>Returns, $R$.</caption>" in forms["text/html"]
    assert "−4.1" in forms["text/html"]
    assert ">a|b<" in forms["text/html"]  # Markdown's escape is not HTML's
    sides = re.findall(r"td\.col(\d) {\s*text-align: (\w+)", forms["text/html"])
    assert [side for _, side in sides] == ["left", "right", "right", "left", "left"]


def test_a_table_in_jupyter_has_no_marks_of_markdown(shown: list[Any]) -> None:
    frame = pd.DataFrame({"run by `f`": ["**1,072 (109)**", "2 of $Q^{*}$"]})
    nb.table(frame, name="tbl-x", caption="As {numref}`tbl-y` by `f`, $2^{**}$.")
    html = shown[0]._repr_mimebundle_()["text/html"]
    assert "<caption>As tbl-y by <code>f</code>, $2^{**}$.</caption>" in html
    assert "run by <code>f</code></th>" in html
    assert "<strong>1,072 (109)</strong></td>" in html
    assert "2 of $Q^{*}$</td>" in html


def test_verdicts_in_a_table_have_their_colours(shown: list[Any]) -> None:
    row = {"claim": "refuted", "verdict": "not reproduced (9 of 10)", "ours": None, "why": "0 (1)"}
    nb.table(pd.DataFrame([row]), name="t", caption="c")
    forms = shown[0]._repr_mimebundle_()
    assert forms["text/markdown"].splitlines()[2:-1] == [
        ":class: verdicts",
        "",
        "| claim | verdict | ours | why |",
        "| :--- | :--- | :--- | :--- |",
        "| [refuted]{.verdict .refuted} "
        "| [not reproduced]{.verdict .not-reproduced} (9\u00a0of\u00a010) | – | 0\u00a0(1) |",
    ]
    assert "not reproduced (9\u00a0of\u00a010)" in forms["text/html"]
    nb.table(pd.DataFrame({"x": ["refuted"]}), name="t", caption="c")
    assert "| refuted |" in shown[1]._repr_mimebundle_()["text/markdown"]


def test_numbers_of_a_table_have_four_digits_at_most(shown: list[Any]) -> None:
    column = [0.1234, -9.876, 56.744, -254.62, 1234.5, -43525.0, np.inf]
    nb.table(pd.DataFrame({"x": column}), name="t", caption="c", decimals=3)
    rows = shown[0]._repr_mimebundle_()["text/markdown"].splitlines()[5:-1]
    numbers = ["0.123", "−9.876", "56.74", "−254.6", "1,234", "−43,525", "inf"]
    assert rows == [f"| {number} |" for number in numbers]


def test_table_can_show_its_index(shown: list[Any]) -> None:
    nb.table(pd.DataFrame({"x": [1]}, index=pd.Index(["a"], name="row")), name="t", caption="c",
             index=True)  # fmt: skip
    assert "| row | x |" in shown[0]._repr_mimebundle_()["text/markdown"]


class TestRun:
    @pytest.fixture
    def experiment(self) -> Experiment[Any]:
        return Experiment(
            id="table-0",
            item="Table 0",
            title="Nothing.",
            function=lambda config, context: pd.DataFrame({"x": [context.seed]}),
            budgets=dict.fromkeys(("smoke", "book", "thesis"), nb.Page("smoke")),
            columns={"x": "the seed"},
            seconds=dict.fromkeys(("smoke", "book", "thesis"), 0.0),
        )

    def test_in_a_build_the_table_is_stored(
        self, experiment: Experiment[Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv(nb.RESULTS_VARIABLE, str(tmp_path))
        page = nb.Page("smoke", seed=7)
        assert page.run(experiment).x.tolist() == [7]
        assert {f.name for f in tmp_path.iterdir()} == {"table-0.csv", "table-0.json"}

    def test_another_config_is_not_stored(
        self, experiment: Experiment[Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv(nb.RESULTS_VARIABLE, str(tmp_path))
        nb.Page("smoke").run(experiment, config=nb.Page("book"))
        assert list(tmp_path.iterdir()) == []

    def test_chosen_fields_reach_the_configs_of_their_class(
        self, experiment: Experiment[Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv(nb.RESULTS_VARIABLE, str(tmp_path))
        seen = replace(
            experiment,
            function=lambda config, context: pd.DataFrame({"x": [config.seed]}),
        )
        page = nb.Page("smoke")
        page.choose(Claim, seed=7)  # another class with a field of that name
        page.choose(nb.Page, seed=5)
        assert page.run(seen).x.tolist() == page.tables["table-0"].x.tolist() == [5]
        assert list(tmp_path.iterdir()) == []
        page.choose(nb.Page, seed=0)  # as the budget has it
        assert page.run(seen).x.tolist() == [0]
        assert {f.name for f in tmp_path.iterdir()} == {"table-0.csv", "table-0.json"}

    def test_outside_a_build_nothing_is_stored(
        self, experiment: Experiment[Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.delenv(nb.RESULTS_VARIABLE, raising=False)
        monkeypatch.chdir(tmp_path)
        nb.Page("smoke").run(experiment)
        assert list(tmp_path.iterdir()) == []


class TestVerdicts:
    @pytest.fixture
    def page(self) -> nb.Page:
        def judge(tables: Tables) -> Finding:
            good = tables["table-0"].x.mean() > 0
            return Finding(Verdict.REPRODUCED if good else Verdict.REFUTED, "By its mean.")

        claims = [
            Claim("0.1-mean", "0.1", "The mean is positive.", ("table-0",), "It is.", judge),
            Claim("0.2-other", "0.2", "Another.", ("table-1",), "It is.", judge),
        ]
        return nb.Page("book", claims={c.id: c for c in claims})

    def test_they_come_from_the_tables_of_the_page(self, page: nb.Page) -> None:
        page.tables["table-0"] = pd.DataFrame({"x": [1.0, 2.0]})
        assert page.verdict("0.1-mean") == "reproduced"
        assert page.evidence("0.1-mean") == "By its mean."
        assert page.verdicts("0.1").verdict.tolist() == ["reproduced"]
        page.tables["table-0"] = pd.DataFrame({"x": [-1.0]})
        assert page.verdict("0.1-mean") == "refuted"

    def test_long_evidence_unfolds_and_none_is_lost_or_repeated(self, page: nb.Page) -> None:
        items = [f"{9 * name} {n} ± 1" for n, name in enumerate("abc", 10)]

        def judge(table: pd.DataFrame) -> Finding:
            return Finding(Verdict.REPRODUCED, f"Of 3: {'; '.join(items)}. So it is.")

        long = Claim("0.3-long", "0.3", "Many.", ("table-0",), "It is.", judge)
        page.claims["0.3-long"] = long
        page.tables["table-0"] = pd.DataFrame({"x": [1.0]})
        (text,) = page.verdicts("0.3").evidence
        head, _, rest = text.partition("</summary>")
        assert head.startswith("<details><summary>Of 3: aaaaaaaaa 10 ± 1;")
        assert rest.endswith("ccccccccc 12 ± 1. So it is.</details>")
        assert all(text.count(item) == 1 for item in items)
        assert page.verdicts("0.1").evidence.tolist() == ["By its mean."]

    def test_a_claim_whose_experiment_has_not_run_is_an_error(self, page: nb.Page) -> None:
        with pytest.raises(ValueError, match="rests on table-0: run it above first"):
            page.verdict("0.1-mean")
        page.tables["table-0"] = pd.DataFrame({"x": [1.0]})
        with pytest.raises(ValueError, match="-other' rests on table-1"):
            page.verdicts("0.")
        assert page.verdicts().claim.tolist() == ["The mean is positive."]

    def test_an_unknown_claim_is_named(self, page: nb.Page) -> None:
        with pytest.raises(ValueError, match=r"no claim '9.9'; see claims\.toml"):
            page.verdict("9.9")
        page.tables["table-0"] = pd.DataFrame({"x": [1.0]})
        with pytest.raises(ValueError, match=r"starts with '9\.'; see claims\.toml"):
            page.verdicts("0.1", "9.")

    def test_a_sentence_tells_how_often_a_verdict_came_out(self, page: nb.Page) -> None:
        page.tables["table-0"] = pd.DataFrame({"x": [1.0]})
        over = {"0.1-mean": OverRoots({Verdict.REFUTED: 8}, "book", "", False)}
        assert replace(page, over=over).verdict("0.1-mean") == "refuted (8 of 8; here reproduced)"

    def test_at_smoke_nothing_is_told(self, page: nb.Page) -> None:
        smoke = nb.Page("smoke", claims=page.claims, tables={"table-0": pd.DataFrame({"x": [1.0]})})
        assert smoke.verdict("0.1-mean") == "inconclusive at this budget"
