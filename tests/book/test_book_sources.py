"""Notebook sources: reading them, and merging a run's outputs into them."""

import nbformat
import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

from thesis_lib.book.sources import TAKEAWAY_TAG, merge, with_values
from thesis_lib.book.thesis_numbers import thesis_number


def test_values_replace_defaults_and_keep_annotations_and_comments() -> None:
    source = 'budget: str = "book"  # smoke, book or thesis\nseed: int = 0\n# a note\nn = 5  # runs'
    assert with_values(source, {"budget": "smoke", "seed": 3, "absent": 1}) == (
        "budget: str = 'smoke'  # smoke, book or thesis\nseed: int = 3\n# a note\nn = 5  # runs"
    )


def notebook(prose: str, *, executed: bool) -> nbformat.NotebookNode:
    outputs = [new_output("stream", text="1\n")] if executed else []
    return new_notebook(
        cells=[
            new_code_cell("budget = 'book'", id="p", metadata={"tags": ["parameters"]}),
            new_markdown_cell(prose, id="m"),
            new_code_cell("print(1)", id="c", outputs=outputs, execution_count=2),
        ]
    )


def test_merge_takes_prose_from_the_source_and_outputs_from_the_run() -> None:
    source, run = notebook("new", executed=False), notebook("old", executed=True)
    merged = merge(source, run, {"budget": "smoke"})
    assert [cell.source for cell in merged.cells] == ["budget = 'smoke'", "new", "print(1)"]
    assert merged.cells[2].outputs[0].text == "1\n"
    assert source.cells[2].outputs == []  # the source is left as it was


def test_what_to_take_away_comes_after_the_title() -> None:
    source = notebook("prose", executed=False)
    source.cells.append(new_markdown_cell("in short", metadata={"tags": [TAKEAWAY_TAG]}))
    title, *others, told = source.cells
    assert merge(source, None, {}).cells == [title, told, *others]


def test_the_book_folds_imports_and_shows_parameters_and_what_both_print() -> None:
    source = notebook("prose", executed=False)
    source.cells[2].id = "imports"
    run = notebook("prose", executed=True)
    parameters, _, imports = merge(source, run, {}).cells
    assert parameters.metadata.tags == ["parameters"]
    assert imports.metadata.tags == ["hide-input"]
    assert imports.metadata.mystnb["code_prompt_show"] == "Show the imports"
    assert imports.outputs[0].text == "1\n"
    assert "tags" not in source.cells[2].metadata


def test_merge_without_a_run_is_the_source() -> None:
    source = notebook("new", executed=False)
    assert merge(source, None, {"budget": "smoke"}) == source


@pytest.mark.parametrize(
    ("page", "number"),
    [
        ("notebooks/ch03_potentials", 3),
        ("book/ch06_conclusions", 6),
        ("notebooks/appendix_a", "A"),
        ("notebooks/appendix_b_networks", "B"),
        ("book/intro", None),
        ("book/searching", None),
        ("book/appendix", None),
    ],
)
def test_numbers_come_from_file_names(page: str, number: int | str | None) -> None:
    assert thesis_number(page) == number
