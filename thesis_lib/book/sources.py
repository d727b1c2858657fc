"""Reading a notebook's source, and putting a run's outputs into it."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import nbformat

from thesis_lib.book import inline
from thesis_lib.edition.parameters import assigned_names

PARAMETERS_TAG = "parameters"

TAKEAWAY_TAG = "takeaway"
"""Of the cell that sums a notebook up: computed at its end, and shown at its head."""

IMPORTS = "imports"
"""Id of the cell that imports a chapter, which the book folds."""


def read(path: Path) -> Any:
    """Read a notebook and check that the build can run it.

    Returns
    -------
    nbformat.NotebookNode
        The notebook.

    Raises
    ------
    ValueError
        If it is no notebook, or its first code cell, and no other, is not tagged
        ``parameters``.
    """
    try:
        notebook = nbformat.read(path, as_version=4)
    except OSError:
        raise
    except Exception as error:  # nbformat fails in many ways on what is no notebook
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise ValueError(
            f"{path.name} is not a notebook ({reason}): restore or remove it."
        ) from None
    tagged = [PARAMETERS_TAG in cell.metadata.get("tags", ()) for cell in code_cells(notebook)]
    if tagged[:1] != [True] or sum(tagged) != 1:
        raise ValueError(
            f"{path.name} must have one cell tagged '{PARAMETERS_TAG}', its first code cell; "
            f"of its {len(tagged)} code cells {sum(tagged)} have the tag."
        )
    return notebook


def code_cells(notebook: Any) -> list[Any]:
    """Code cells in order."""
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def parameter_names(notebook: Any) -> list[str]:
    """Names that the parameters cell assigns."""
    return assigned_names(code_cells(notebook)[0].source)


def with_values(source: str, values: dict[str, object]) -> str:
    """A parameters cell with other values, its annotations and comments kept.

    Parameters
    ----------
    source
        The cell, one assignment a line.
    values
        Value by name; names that the cell does not assign are left out.
    """
    lines = []
    for line in source.splitlines():
        names = assigned_names(line)
        if names and names[0] in values:
            left, _, right = line.partition("=")
            _, mark, comment = right.partition("#")
            line = f"{left.rstrip()} = {values[names[0]]!r}" + (f"  {mark}{comment}" * bool(mark))
        lines.append(line)
    return "\n".join(lines)


def merge(source: Any, executed: Any | None, values: dict[str, object]) -> Any:
    """The source's prose with a run's outputs and the values of its expressions.

    Parameters
    ----------
    source
        The notebook as committed.
    executed
        A run of the same code cells, with papermill's injected cell taken out; None leaves the
        cells without outputs.
    values
        Parameter values of the run, written into the parameters cell, so that a reader who
        downloads the page runs what it shows.

    Returns
    -------
    nbformat.NotebookNode
        A new notebook.
    """
    merged = copy.deepcopy(source)
    cells = code_cells(merged)
    known: dict[str, dict[str, str]] = {}
    if executed is not None:
        known = {cell.id: inline.values(cell) for cell in executed.cells}
        for cell, run in zip(cells, code_cells(executed), strict=True):
            cell.outputs = run.outputs
            cell.execution_count = run.execution_count
        cells[0].source = with_values(cells[0].source, values)
    for cell in merged.cells:
        inline.fill(cell, known.get(cell.id, {}))
        if cell.id == IMPORTS:
            _fold(cell, "the imports")
    takeaways = [cell for cell in merged.cells if TAKEAWAY_TAG in cell.metadata.get("tags", ())]
    title, *others = [cell for cell in merged.cells if cell not in takeaways]
    merged.cells = [title, *takeaways, *others]
    return merged


def _fold(cell: Any, what: str) -> None:
    """Hide a cell's code behind a button that names it; what it prints stays in sight."""
    cell.metadata["tags"] = [*cell.metadata.get("tags", ()), "hide-input"]
    prompts = {"code_prompt_show": f"Show {what}", "code_prompt_hide": f"Hide {what}"}
    cell.metadata["mystnb"] = {**cell.metadata.get("mystnb", {}), **prompts}
