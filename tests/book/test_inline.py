"""Numbers in prose, evaluated in the kernel."""

import json
import sys
from pathlib import Path
from typing import Any

import nbformat
import papermill
import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

import thesis_lib.book.engine  # noqa: F401  (makes it papermill's default)
from thesis_lib.book import inline
from thesis_lib.book.sources import merge

SPEC = {"name": "python3", "display_name": "Python 3", "language": "python"}


def notebook(*cells: Any) -> Any:
    parameters = new_code_cell("n: int = 3", metadata={"tags": ["parameters"]}, id="parameters")
    return new_notebook(cells=[parameters, *cells], metadata={"kernelspec": SPEC})


def prose(text: str, name: str = "words") -> Any:
    return new_markdown_cell(text, id=name)


def run(source: Any, folder: Path) -> Any:
    nbformat.write(source, folder / "in.ipynb")
    papermill.execute_notebook(
        folder / "in.ipynb", folder / "out.ipynb", {"n": 4}, progress_bar=False
    )
    return nbformat.read(folder / "out.ipynb", as_version=4)


def test_plain_papermill_writes_the_values_at_their_place(tmp_path: Path) -> None:
    caption = {"mystnb": {"figure": {"caption": "Half: {eval}`f'{n / 2:.1f}'`.", "name": "x"}}}
    source = notebook(
        prose("First {eval}`n` runs, {eval}`'of **two**'` kinds."),
        new_code_cell("n = n + 1", metadata=caption, id="figure"),
        prose("Then {eval}`n`; `code` stays.", "later"),
    )
    cells = run(source, tmp_path).cells
    by = {cell.id: cell for cell in cells if "id" in cell}
    assert by["words"].source == "First 4 runs, of **two** kinds."
    assert by["later"].source == "Then 5; `code` stays."
    assert by["figure"].metadata["mystnb"]["figure"]["caption"] == "Half: 2.5."
    # The book puts them into the prose as it stands, which may have changed since.
    source.cells[1].source = "Now {eval}`n` and {eval}`'of **two**'`."
    executed = new_notebook(
        cells=[c for c in cells if "injected-parameters" not in c.metadata.get("tags", ())]
    )
    merged = merge(source, executed, {})
    assert merged.cells[1].source == "Now 4 and of **two**."
    assert merged.cells[2].metadata["mystnb"]["figure"]["caption"] == "Half: 2.5."
    assert source.cells[1].source.startswith("Now {eval}")


def test_without_a_run_the_book_shows_dashes() -> None:
    assert merge(notebook(prose("{eval}`n` runs")), None, {}).cells[1].source == "– runs"


@pytest.mark.parametrize(
    ("expression", "message"),
    [
        ("nothing", r"cell 'words': \{eval\}`nothing` failed: NameError: name 'nothing'"),
        ("n / 3", "is 1.3333333333333333, but prose takes a text or a whole number"),
        ("n > 3", "is True, but prose"),
    ],
)
def test_an_expression_that_fails_stops_with_its_cell_and_text(
    tmp_path: Path, expression: str, message: str
) -> None:
    source = notebook(prose(f"So {{eval}}`{expression}` it is."), new_code_cell("print('went on')"))
    with pytest.raises(ValueError, match=message):
        run(source, tmp_path)


def test_every_cell_lists_its_expressions() -> None:
    assert inline.expressions(prose("{eval}`a`, {glue:}`b` and {eval}`c`")) == ["a", "c"]
    assert inline.expressions(new_code_cell("{'eval'}")) == []


def test_jupyterlab_is_told_to_evaluate_cells_that_are_not_on_the_screen() -> None:
    root = Path(__file__).parents[2]
    (plugin, wanted), *others = json.loads((root / "book" / "jupyterlab.json").read_text()).items()
    assert not others
    place = "etc/jupyter/labconfig/default_setting_overrides.d"
    for maker in ("Makefile", ".binder/postBuild"):
        assert place in (root / maker).read_text()
    package, name = plugin.split(":")
    schema = Path(sys.prefix, "share/jupyter/lab/schemas", package, f"{name}.json")
    if not schema.exists():
        pytest.skip("JupyterLab is not installed.")
    (option,) = wanted
    known = json.loads(schema.read_text(encoding="utf-8"))["properties"][option]
    assert wanted[option] in [choice["const"] for choice in known["oneOf"]]
