"""The notebooks as committed: stripped, readable, with parameters, and all in the book."""

import re
from pathlib import Path
from typing import Any

import nbformat
import pytest
import yaml
from nbconvert import ScriptExporter

from thesis_lib.book.sources import code_cells, parameter_names, read
from thesis_lib.edition.page import assigned_names

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
READABLE = re.compile(r"[a-z]+[a-z0-9]*(-[a-z0-9]+)*")
RANDOM = re.compile(r"[0-9a-f]{8}(-[0-9a-f]{4}){0,3}")


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
        assert re.match(r"\(ch-[a-z0-9-]+\)=\n# ", notebook.cells[0].source)

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
