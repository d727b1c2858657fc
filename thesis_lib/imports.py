"""Which modules a piece of code depends on, found by reading its imports.

The build re-executes a notebook, and numba compiles a loop again, when a module it imports,
directly or through others, has changed.  Imports are read and not run; those inside functions
count as well.  An import by name (``importlib.import_module``) cannot be seen, which is how
``thesis_lib.edition.chapters`` can know every chapter without making each notebook depend on all.
"""

from __future__ import annotations

import ast
import threading
from collections.abc import Iterable
from functools import cache
from pathlib import Path

PACKAGE = "thesis_lib"

BY_NAME = "thesis_lib.edition.saved"
READERS = {
    BY_NAME: "results",
    "thesis_lib.edition.roots": "results/claims",
    "thesis_lib.edition.deepest": "results/thesis",
    "thesis_lib.edition.remembered": "results/remembered",
    "thesis_lib.chapter5.runs": "results/study",
    "thesis_lib.chapter5.calibration": "results/calibration",
    "thesis_lib.chapter5.gain_trained": "results/trained",
}
"""Modules through which committed results of long runs are read, and where these lie; through one
of them each by its name."""

_ONE_AT_A_TIME = threading.Lock()


def parsed(source: str) -> ast.Module:
    """Syntax tree of Python source, by one thread at a time.

    Up to Python 3.11.7 two threads that parse at once can end in a SystemError
    (python/cpython#106905), and experiments and notebooks run several at a time.

    Raises
    ------
    SyntaxError
        If the source is not Python.
    """
    with _ONE_AT_A_TIME:
        return ast.parse(source)


def expression(source: str) -> ast.expr:
    """Syntax tree of one Python expression, by one thread at a time.

    Raises
    ------
    SyntaxError
        If the source is not one expression.
    """
    with _ONE_AT_A_TIME:
        return ast.parse(source, mode="eval").body


def module_file(name: str, root: Path) -> Path | None:
    """File of a module of this package, or None if there is no such module.

    Parameters
    ----------
    name
        Absolute, such as ``thesis_lib.mdp.model``.
    root
        Folder that holds the package.
    """
    base = root.joinpath(*name.split("."))
    for file in (base / "__init__.py", base.with_suffix(".py")):
        if file.is_file():
            return file
    return None


@cache
def imported(source: str, package: str = "") -> frozenset[str]:
    """Names of this package's modules that some source may import.

    Parameters
    ----------
    source
        Python source.
    package
        Package that holds it, against which relative imports are resolved.

    Returns
    -------
    frozenset of str
        Absolute names, with every package on the way to them; ``from a import b`` gives both
        ``a`` and ``a.b``, of which the latter need not be a module.

    Raises
    ------
    SyntaxError
        If the source is not Python.
    """
    names: set[str] = set()
    for node in ast.walk(parsed(source)):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parents = package.split(".")
                above = parents[: len(parents) - node.level + 1]
                base = ".".join([*above, base] if base else above)
            names.add(base)
            names.update(f"{base}.{alias.name}" for alias in node.names)
    parts = [name.split(".") for name in names if name.split(".")[0] == PACKAGE]
    return frozenset(".".join(part[:i]) for part in parts for i in range(1, len(part) + 1))


def closure(sources: Iterable[str], root: Path) -> dict[str, Path]:
    """Modules of this package that some sources depend on, directly or through others.

    Parameters
    ----------
    sources
        Python sources, such as a notebook's code cells.
    root
        Folder that holds the package.

    Returns
    -------
    dict
        File by module name, sorted by name.
    """
    found: dict[str, Path] = {}
    waiting = {name for source in sources for name in imported(source)}
    while waiting:
        name = waiting.pop()
        file = module_file(name, root)
        if name in found or file is None:
            continue
        found[name] = file
        package = name if file.name == "__init__.py" else name.rpartition(".")[0]
        waiting |= imported(file.read_text(encoding="utf-8"), package)
    return dict(sorted(found.items()))


def hidden(path: Path) -> bool:
    """Whether a relative path is what file managers and editors leave (``._x``, ``.DS_Store``)."""
    return any(part.startswith(".") for part in path.parts)


def data_files(modules: dict[str, Path]) -> list[Path]:
    """Files other than Python's that lie beside the packages among some modules.

    A package that reads its own data (``thesis_lib.published``) changes with them.
    """
    folders = [file.parent for file in modules.values() if file.name == "__init__.py"]
    return sorted(
        file
        for folder in folders
        for file in folder.iterdir()
        if file.is_file()
        and file.suffix not in {".py", ".pyc", ".so"}
        and not hidden(Path(file.name))
    )


def saved_results(modules: dict[str, Path], root: Path, asked: str | None = None) -> list[Path]:
    """Committed results of long runs, if some modules read any.

    A notebook that imports the reader depends on all of them, whichever it asks for.

    Parameters
    ----------
    modules
        From :func:`closure`.
    root
        The checkout, where ``results`` lies.
    asked
        Text, such as a config's, that quotes the results that are read by name: no others of
        these are given.  Default all.
    """
    files: set[Path] = set()
    for reader, folder in READERS.items():
        if reader in modules:
            own = {file for file in (root / folder).rglob("*") if file.is_file()}
            if reader == BY_NAME and asked is not None:
                below = {f: f.relative_to(root / folder).with_suffix("").as_posix() for f in own}
                own = {file for file in own if f"'{below[file]}'" in asked}
            files |= own
    return sorted(file for file in files if not hidden(file.relative_to(root)))
