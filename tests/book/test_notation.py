"""Every name that the page Notation gives exists in the code."""

import dataclasses
import importlib
import inspect
import re
from pathlib import Path
from typing import Any

import pytest

PAGE = Path(__file__).resolve().parents[2] / "book" / "notation.md"
NAME = re.compile(r"`([a-z_]\w*\.[\w.]+)(?:\((\w+)\))?`")
LINES = PAGE.read_text(encoding="utf-8").splitlines()
ROWS = [r for r in LINES if r.startswith("| ") and not r.startswith(("| Symbol", "| :--"))]
NAMES = sorted({match for row in ROWS for match in NAME.findall(row)})


def resolve(path: str) -> Any:
    """Import the longest module path and follow attributes from there."""
    parts = path.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found: Any = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for name in parts[cut:]:
            fields = {f.name for f in dataclasses.fields(found)} if _is_dataclass(found) else set()
            if name in fields or name in inspect.get_annotations(found):
                return name
            found = getattr(found, name)
        return found
    raise ModuleNotFoundError(path)


def _is_dataclass(found: Any) -> bool:
    return inspect.isclass(found) and dataclasses.is_dataclass(found)


@pytest.mark.parametrize(("path", "argument"), NAMES)
def test_names_resolve(path: str, argument: str) -> None:
    found = resolve(f"thesis_lib.{path}")
    if argument:
        assert argument in inspect.signature(found).parameters


def test_every_symbol_has_a_name_and_a_section() -> None:
    assert len(ROWS) > 30
    for row in ROWS:
        assert NAME.search(row) or "](ch-" in row, row
        assert re.search(r"\| (\d(\.\d+)+|\[ours\]\(#sec-[\w-]+\)) \|$", row), row


def test_a_name_that_is_not_there_is_noticed() -> None:
    with pytest.raises(AttributeError):
        resolve("thesis_lib.mdp.planning.solve_quickly")
