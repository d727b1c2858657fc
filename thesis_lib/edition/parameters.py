"""The parameters of a notebook: which it has, and whether those papermill gives are among them."""

from __future__ import annotations

import ast
from collections.abc import Iterable

from thesis_lib.imports import parsed

#: First line of the cell in which papermill assigns the parameters it was given.
_INJECTED = "# Parameters"

#: What papermill adds by itself when asked to (``--inject-paths`` and its like).
_OF_PAPERMILL = ("PAPERMILL_INPUT_PATH", "PAPERMILL_OUTPUT_PATH")


def assigned_names(source: str) -> list[str]:
    """Names assigned at the top level of a cell, in order.

    Parameters
    ----------
    source
        Python source of one code cell.

    Returns
    -------
    list of str
        Targets of plain and annotated assignments; empty if the cell is not plain Python
        (an IPython magic, for example).
    """
    try:
        tree = parsed(source)
    except SyntaxError:
        return []
    names = []
    for node in tree.body:
        targets: list[ast.expr] = []
        if isinstance(node, ast.Assign):
            targets = list(node.targets)
        elif isinstance(node, ast.AnnAssign):
            targets = [node.target]
        names += [target.id for target in targets if isinstance(target, ast.Name)]
    return names


def check_parameters(given: Iterable[str], allowed: Iterable[str]) -> None:
    """Refuse parameter names that the notebook does not have.

    Raises
    ------
    ValueError
        If a given name is not among the allowed ones.
    """
    allowed = list(allowed)
    unknown = [name for name in given if name not in allowed]
    if unknown:
        raise ValueError(
            f"unknown parameter {', '.join(map(repr, unknown))}; this notebook takes "
            f"{', '.join(allowed)}."
        )


def check_injected(history: Iterable[str]) -> None:
    """Compare the names papermill injected with those of the cell above them.

    papermill itself only logs a name it does not know, so a typing error would go unseen.
    """
    parameters: list[str] = []
    for source in history:
        names = assigned_names(source)
        if source.startswith(_INJECTED):
            check_parameters(names, [*parameters, *_OF_PAPERMILL])
        elif "budget" in names:
            parameters = names
