"""Numbers in prose: ``{eval}`` expressions, evaluated in the notebook's kernel as it runs.

A text cell, or the caption of a figure, says ``{eval}`f"{gap:.2f}"```.  When papermill reaches
the cell, the expression is evaluated in the kernel and its text takes its place, so that the
executed notebook reads as the page does.  The values are kept in the cell's metadata under
``user_expressions``, where jupyterlab-myst, which shows them live, keeps them too.
:mod:`thesis_lib.book.engine` does the evaluating.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from typing import Any

from thesis_lib.edition.words import typeset

_ROLE = re.compile(r"\{eval\}`([^`]+)`")
_KEPT = "user_expressions"


def texts(cell: Any) -> list[str]:
    """The texts of a cell that may hold expressions: its prose, or its figure's caption."""
    if cell.cell_type == "markdown":
        return [cell.source]
    caption = cell.metadata.get("mystnb", {}).get("figure", {}).get("caption")
    return [] if caption is None else [caption]


def expressions(cell: Any) -> list[str]:
    """The expressions of a cell, in order."""
    return [found for text in texts(cell) for found in _ROLE.findall(text)]


def filled(text: str, values: Mapping[str, str]) -> str:
    """A text with its expressions' values; a dash stands for one that has none."""
    return _ROLE.sub(lambda found: values.get(found[1], "–"), text)


def values(cell: Any) -> dict[str, str]:
    """Values of a cell's expressions, as a run has kept them."""
    kept = cell.metadata.get(_KEPT, ())
    return {one["expression"]: one["result"]["data"]["text/plain"] for one in kept}


def keep(cell: Any, found: Mapping[str, str]) -> None:
    """Keep values by expression in a cell's metadata, as jupyterlab-myst does."""
    cell.metadata[_KEPT] = [
        {
            "expression": expression,
            "result": {"status": "ok", "data": {"text/plain": text}, "metadata": {}},
        }
        for expression, text in found.items()
    ]


def fill(cell: Any, known: Mapping[str, str]) -> None:
    """Put values in place of a cell's expressions."""
    if cell.cell_type == "markdown":
        cell.source = filled(cell.source, known)
    elif expressions(cell):
        figure = cell.metadata["mystnb"]["figure"]
        figure["caption"] = filled(figure["caption"], known)


def shown(result: Mapping[str, Any], expression: str, cell: str) -> str:
    """The text of a value; ValueError names cell and expression when there is none to show."""
    where = f"cell {cell!r}: {{eval}}`{expression}`"
    if result["status"] != "ok":
        raise ValueError(f"{where} failed: {result['ename']}: {result['evalue']}")
    printed = str(result["data"]["text/plain"])
    try:
        value = ast.literal_eval(printed)
    except (ValueError, SyntaxError):
        value = None
    if not isinstance(value, (str, int)) or isinstance(value, bool):
        raise ValueError(
            f"{where} is {printed}, but prose takes a text or a whole number: give it a format, "
            'such as f"{x:.2f}".'
        )
    return typeset(str(value))
