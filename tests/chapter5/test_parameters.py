"""The parameters of chapter 5's pages on the benchmark, as papermill gives them."""

import re
from pathlib import Path

import nbformat
import papermill
import pytest

from tests.surroundings import ROOT

BENCHMARK = ROOT / "notebooks" / "ch05_benchmark.ipynb"
CHOSEN = ("tasks", "architectures", "seeds", "store")


@pytest.mark.parametrize("name", ["ch05_benchmark", "ch05_tests", "ch05_studies"])
def test_pages_that_read_the_store_say_which_runs_can_be_chosen(name: str) -> None:
    cells = nbformat.read(ROOT / "notebooks" / f"{name}.ipynb", as_version=4).cells
    source = {cell.id: cell.source for cell in cells}
    assert all(f'{parameter}: str = ""' in source["parameters"] for parameter in CHOSEN)
    first = source["results"].index("page.run(")
    assert source["results"].index(f"contrasts.chosen({', '.join(CHOSEN)})") < first
    # Nothing on the page reads the checkout's own store whatever was asked for.
    assert not re.search(r"read_runs\(\)", "".join(source.values()))


@pytest.mark.slow
def test_papermill_chooses_the_runs_of_a_page(tmp_path: Path) -> None:
    given = {"tasks": "Hopper", "architectures": "dtrnn", "seeds": "0 1"}
    out = tmp_path / "out.ipynb"
    asked = {"budget": "smoke", "workers": 1, **given}
    papermill.execute_notebook(BENCHMARK, out, asked, progress_bar=False)
    cells = {cell.get("id"): cell for cell in nbformat.read(out, as_version=4).cells}
    (shown,) = cells["tbl-learning"].outputs
    rows = shown.data["text/markdown"].splitlines()
    ours = [row for row in rows if "n = 2" in row]
    assert len(ours) == 2  # the Hopper on the flat and on hills
    # The row's heading and one net; the six others have not been chosen.
    assert all(row.count("–") == 6 for row in ours)
    assert sum("not run" in row for row in rows) == 8
    wrong = asked | {"tasks": "Hoper"}
    with pytest.raises(papermill.PapermillExecutionError, match="tasks has 'Hoper', but it must"):
        papermill.execute_notebook(BENCHMARK, out, wrong, progress_bar=False)
