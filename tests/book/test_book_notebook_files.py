"""The notebooks as committed: stripped, readable, with parameters, and all in the book."""

import re
from importlib import import_module
from pathlib import Path
from typing import Any

import nbformat
import pandas as pd
import pytest
import yaml
from nbconvert import ScriptExporter

from thesis_lib.book.sources import TAKEAWAY_TAG, code_cells, parameter_names, read
from thesis_lib.book.thesis_numbers import thesis_number
from thesis_lib.edition.experiment import Experiment
from thesis_lib.edition.parameters import assigned_names

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
READABLE = re.compile(r"[a-z]+[a-z0-9]*(-[a-z0-9]+)*")
RANDOM = re.compile(r"[0-9a-f]{8}(-[0-9a-f]{4}){0,3}")
SECTIONS = """
2.1 2.2 2.3 2.3.1 2.3.2 2.3.3 2.3.4 2.3.5 2.4
3.1 3.2 3.3 3.3.1 3.3.2 3.3.3 3.3.4 3.3.5 3.3.6 3.4 3.4.1 3.4.2 3.4.3 3.4.4 3.5 3.5.1 3.5.2 3.6
4.1 4.1.1 4.1.2 4.2 4.3 4.3.1 4.4 4.5
5.1 5.1.1 5.2 5.2.1 5.2.2 5.2.3 5.2.4 5.2.5 5.3 5.4 5.5 5.5.1 5.5.2 5.6 5.7
"""
"""Of the thesis's chapters 2 to 5."""
RUN = r"page\.run\((\w+)\.(\w+)\)"
"""An experiment that a cell runs: its module and its name there."""


def experiment_of(notebook: str, module: str, name: str) -> Experiment[Any]:
    number = thesis_number(notebook)
    chapter = f"chapter{number}" if isinstance(number, int) else f"appendix_{number}".lower()
    found: Experiment[Any] = getattr(import_module(f"thesis_lib.{chapter}.{module}"), name)
    return found


def test_toc_covers_every_notebook_and_nothing_else() -> None:
    toc = (ROOT / "_toc.yml").read_text()
    pages = [*re.findall(r"file: (\S+)", toc), yaml.safe_load(toc)["root"]]
    listed = {page for page in pages if page.startswith("notebooks/")}
    assert listed == {f"notebooks/{path.stem}" for path in NOTEBOOKS}
    assert len(pages) == len(set(pages))
    assert all((ROOT / f"{page}.md").exists() for page in set(pages) - listed)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
class TestNotebook:
    @pytest.fixture
    def notebook(self, path: Path) -> Any:
        return read(path)

    def test_is_valid_and_stripped(self, path: Path, notebook: Any) -> None:
        nbformat.validate(notebook)
        for cell in code_cells(notebook):
            assert cell.outputs == [], f"{cell.id} has outputs"
            assert cell.execution_count is None, f"{cell.id} has an execution count"
        assert "widgets" not in notebook.metadata

    def test_becomes_a_script_that_python_runs(self, path: Path) -> None:
        """``jupyter nbconvert --to script`` asks the notebook for the language's own exporter."""
        written, resources = ScriptExporter().from_filename(path)
        assert resources["output_extension"] == ".py"
        compile(written, path.stem, "exec")

    def test_ids_are_stable_readable_and_unique(self, path: Path, notebook: Any) -> None:
        ids = [cell.id for cell in notebook.cells]
        assert len(ids) == len(set(ids))
        for name in ids:
            assert READABLE.fullmatch(name), name
            assert not RANDOM.fullmatch(name), name

    def test_parameters_come_first_and_are_annotated(self, path: Path, notebook: Any) -> None:
        first = code_cells(notebook)[0]
        assert first.id == "parameters"
        assert parameter_names(notebook)[:3] == ["budget", "seed", "workers"]
        assert first.source.splitlines()[0].startswith('budget: str = "book"')
        assert all(":" in line for line in first.source.splitlines() if assigned_names(line))

    def test_code_cells_are_short(self, path: Path, notebook: Any) -> None:
        for cell in code_cells(notebook):
            lines = cell.source.splitlines()
            assert len(lines) <= 15, f"{cell.id} has {len(lines)} lines"
            widest = max(map(len, lines), default=0)
            assert widest <= 68, f"{cell.id} is {widest} columns wide"

    def test_code_is_plain_python(self, path: Path, notebook: Any) -> None:
        for cell in code_cells(notebook):
            compile(cell.source, cell.id, "exec")

    def test_has_one_labelled_title(self, path: Path, notebook: Any) -> None:
        prose = "\n".join(c.source for c in notebook.cells if c.cell_type == "markdown")
        outside = re.sub(r"(?ms)^(`{3,}|:{3,}).*?^\1\s*$", "", prose)
        assert len(re.findall(r"(?m)^# ", outside)) == 1
        assert re.match(r"\(ch-[a-z0-9-]+\)=\n(\(sec-[a-z0-9-]+\)=\n)?# ", notebook.cells[0].source)

    def test_figures_have_a_name_a_caption_and_alternative_text(
        self, path: Path, notebook: Any
    ) -> None:
        for cell in code_cells(notebook):
            options = cell.metadata.get("mystnb", {})
            if "figure" in options:
                assert {"name", "caption"} <= set(options["figure"]), cell.id
                assert options["image"]["alt"].strip(), cell.id
            elif "plt.show()" in cell.source:
                pytest.fail(f"{cell.id} shows a figure without name, caption and alt")

    def test_numbers_in_headings_are_sections_of_the_thesis(
        self, path: Path, notebook: Any
    ) -> None:
        prose = "\n".join(c.source for c in notebook.cells if c.cell_type == "markdown")
        for heading in re.findall(r"(?m)^#+ (\d.*)", prose):
            for number in re.findall(r"\d[\d.]*\d", heading.partition("Figure")[0]):
                assert number in re.findall(r"\S+", SECTIONS), heading
                assert int(number[0]) == thesis_number(path.stem), heading

    def test_a_section_shows_a_small_instance_of_what_it_repeats(
        self, path: Path, notebook: Any
    ) -> None:
        """Where it runs the experiment of a numbered item, a visible cell calls the library."""
        items = pd.read_csv(ROOT / "book" / "thesis_items.csv").dropna(subset="experiment")
        numbered = {*items[items.kind != "footnote"].experiment}
        sections: list[list[Any]] = [[]]
        for cell in notebook.cells:
            if cell.cell_type == "markdown" and re.search(r"(?m)^## ", cell.source):
                sections.append([cell])
            sections[-1].append(cell)
        for section in sections:
            cells = [cell for cell in section if cell.cell_type == "code"]
            runs = [r for c in cells for r in re.findall(RUN, c.source)]
            if numbered.isdisjoint(experiment_of(path.stem, *run).id for run in runs):
                continue
            assert any(
                not re.search(r"page\.|plt\.", cell.source)
                and not {"hide-input", "remove-input", "remove-cell"}
                & {*cell.metadata.get("tags", ())}
                and re.search(r"\w\(", cell.source)
                for cell in cells
            ), section[0].source

    def test_ends_with_what_is_next_and_what_to_take_away(self, path: Path, notebook: Any) -> None:
        *_, before, last = notebook.cells
        assert last.metadata.tags == [TAKEAWAY_TAG]
        assert "{eval}`" in last.source
        assert re.search(r"\*\*Next\*\*: \[", before.source.splitlines()[-1])

    def test_says_how_long_it_takes(self, path: Path, notebook: Any) -> None:
        first, *others = code_cells(notebook)
        minutes = re.search(r"# Takes about (\d+) minutes? at budget", first.source)
        assert minutes
        runs = {run for c in others for run in re.findall(RUN, c.source)}
        told = sum(experiment_of(path.stem, *run).seconds for run in runs)
        assert told / 60 <= int(minutes[1]) <= told / 60 + 2
