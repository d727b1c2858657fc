"""What a result rests on: the definitions its code reaches and the runs it reads, and a digest.

A table and a verdict hold for the code that made them, and for the committed results of long runs
that it read.  What counts of that code are the functions, classes and constants it reaches,
wherever they stand: one that is moved to another file changes nothing, nor does one that is added
beside it.  Docstrings, comments and what keeps experiments, files and versions in order decide no
number and are left out.
"""

from __future__ import annotations

import ast
import hashlib
import sys
from collections.abc import Iterable, Iterator
from copy import deepcopy
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path

from thesis_lib.imports import PACKAGE, data_files, module_file, parsed, saved_results

ROOT = Path(__file__).resolve().parents[2]

FRAMEWORK = f"{PACKAGE}.edition"
EDITION = (FRAMEWORK, f"{PACKAGE}.chapter", f"{PACKAGE}.appendix_a")
"""What the names of the modules begin with that are the edition's, and not the library's."""

DECIDES = tuple(f"{FRAMEWORK}.{name}" for name in ("context", "criteria", "rows", "saved"))
"""Modules of the framework that reckon with numbers, or read them."""

ORDER = tuple(f"{PACKAGE}.{name}" for name in ("checkout", "compiled", "imports", "registration"))
"""Modules that decide no number: where files lie, what imports what, compiling, Gymnasium."""

Place = tuple[str, str]
"""A module and a name in it; with no name the whole module."""


def place(value: object) -> Place:
    """Where a loaded module of the package has a value.

    Raises
    ------
    LookupError
        When none has.
    """
    for module in list(sys.modules):
        if module.startswith(f"{PACKAGE}."):
            for name, own in vars(sys.modules[module]).items():
                if own is value:
                    return module, name
    raise LookupError(f"no module of {PACKAGE} holds {value!r}.")


def digest(starts: Iterable[Place], *texts: str, root: Path = ROOT) -> str:
    """Hash of texts and of the code that some places reach.

    Parameters
    ----------
    starts
        From :func:`place`.
    *texts
        What else decides, such as a config.
    root
        Folder that holds the package and the committed results.
    """
    code, files = reached(starts, "".join(texts), root)
    hashed = hashlib.sha256("\0".join([*texts, *sorted(code)]).encode())
    for file in files:
        hashed.update(file.read_bytes())
    return hashed.hexdigest()[:12]


def digest_of_judging(starts: Iterable[Place], root: Path = ROOT) -> str:
    """Hash of the edition's code that some places reach, without the sentences in it.

    Parameters
    ----------
    starts
        Criteria, from :func:`place`.
    root
        Folder that holds the package.
    """
    pieces = [
        piece
        for piece in _pieces(starts, root)
        if any(module.startswith(EDITION) for module in piece.module)
    ]
    texts = sorted(set().union(*(p.without_sentences for p in pieces)))
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()[:12]


def reached(
    starts: Iterable[Place], asked: str = "", root: Path = ROOT
) -> tuple[set[str], list[Path]]:
    """Definitions that some places reach, as text, and the data they read.

    The data are the files beside the packages, and the committed results of long runs; of those
    that are read by name such as are quoted in what is asked.

    A name is taken for the module's, though a variable of a function may be called so: too much
    is reached then, never too little.
    """
    modules: dict[str, Path] = {}
    code: set[str] = set()
    for piece in _pieces(starts, root):
        code |= piece.code
        modules |= piece.module
    beside = [f for f in data_files(modules) if f.name != "claims.toml"]
    return code, beside + saved_results(modules, root, asked)


def _pieces(starts: Iterable[Place], root: Path) -> Iterator[_Piece]:
    """What stands at some places, and at all that they name."""
    seen: set[Place] = set()
    waiting = list(starts)
    while waiting:
        if (at := waiting.pop()) in seen:
            continue
        seen.add(at)
        if (piece := _piece(at, root)) is not None:
            yield piece
            waiting += piece.uses


@dataclass(frozen=True)
class _Piece:
    """What stands at a place: statements, the places they name, and the module with its file.

    Of a name that is only imported, no more than where it comes from.
    """

    nodes: tuple[ast.stmt, ...] = ()
    uses: tuple[Place, ...] = ()
    module: dict[str, Path] = field(default_factory=dict)

    @cached_property
    def code(self) -> frozenset[str]:
        """Its statements as text."""
        return frozenset(map(ast.dump, self.nodes))

    @cached_property
    def without_sentences(self) -> frozenset[str]:
        """The same with one text for all f-strings and texts of several words."""
        return frozenset(ast.dump(_WithoutSentences().visit(deepcopy(x))) for x in self.nodes)


class _WithoutSentences(ast.NodeTransformer):
    def visit_JoinedStr(self, node: ast.JoinedStr) -> ast.AST:
        return ast.Constant("")

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        several = isinstance(node.value, str) and " " in node.value
        return ast.Constant("") if several else node


@cache
def _piece(at: Place, root: Path) -> _Piece | None:
    """What stands at a place, or None for nothing of the package that decides a number."""
    module, name = at
    found = _read(module, root)
    if found is not None and name in found.imported:
        return _Piece(uses=(found.imported[name],))
    if found is None or _keeps_order(module):
        return None
    if name and name not in found.defined:
        inner = f"{module}.{name}"
        return _Piece(uses=((inner, ""),)) if module_file(inner, root) else None
    nodes = found.defined[name] if name else [n for own in found.defined.values() for n in own]
    nodes = [*nodes, *found.loose]
    return _Piece(
        tuple(nodes),
        tuple({use for node in nodes for use in _uses(node, module, found.imported, root)}),
        {module: found.file},
    )


def _keeps_order(module: str) -> bool:
    """Whether nothing of a module decides a number."""
    return module in ORDER or (module.startswith(FRAMEWORK) and module not in DECIDES)


@dataclass(frozen=True)
class _Module:
    """A module's top level: what it defines, what it imports, and what it does besides."""

    file: Path
    defined: dict[str, list[ast.stmt]] = field(default_factory=dict)
    imported: dict[str, Place] = field(default_factory=dict)
    loose: list[ast.stmt] = field(default_factory=list)


@cache
def _read(module: str, root: Path) -> _Module | None:
    """A module of the package, or None for any other."""
    file = module_file(module, root) if module.partition(".")[0] == PACKAGE else None
    if file is None:
        return None
    made = _Module(file)
    for node in _bare(parsed(file.read_text(encoding="utf-8"))).body:
        if not isinstance(node, ast.FunctionDef | ast.ClassDef):
            made.imported.update(_imports(node))
        if isinstance(node, ast.Import | ast.ImportFrom):
            continue
        names = [node.name] if isinstance(node, ast.FunctionDef | ast.ClassDef) else [
            x.id for x in ast.walk(node) if isinstance(x, ast.Name) and isinstance(x.ctx, ast.Store)
        ]  # fmt: skip
        for name in names:
            made.defined.setdefault(name, []).append(node)
        if not names:
            made.loose.append(node)
    for nodes in made.defined.values():
        for node in nodes:
            if isinstance(node, ast.FunctionDef):
                node.decorator_list = [
                    d for d in node.decorator_list if not _of_framework(d, made.imported)
                ]
    return made


def _bare(tree: ast.Module) -> ast.Module:
    """A tree without docstrings."""
    for node in ast.walk(tree):
        if isinstance(body := getattr(node, "body", None), list):
            bare = [
                x for x in body
                if not (isinstance(x, ast.Expr) and isinstance(x.value, ast.Constant))
            ]  # fmt: skip
            node.body = bare  # type: ignore[attr-defined]
    return tree


def _imports(node: ast.AST) -> Iterator[tuple[str, Place]]:
    """Names that a statement imports, within it as well, and what they are."""
    for part in ast.walk(node):
        if isinstance(part, ast.ImportFrom):
            for alias in part.names:
                yield alias.asname or alias.name, (part.module or "", alias.name)
        elif isinstance(part, ast.Import):
            for alias in part.names:
                if alias.asname:
                    package, _, name = alias.name.rpartition(".")
                    yield alias.asname, (package, name)


def _of_framework(decorator: ast.expr, imported: dict[str, Place]) -> bool:
    """Whether a decorator only enters a function in the edition's lists."""
    called = decorator.func if isinstance(decorator, ast.Call) else decorator
    name = called.id if isinstance(called, ast.Name) else ""
    return imported.get(name, ("", ""))[0].startswith(FRAMEWORK)


def _uses(node: ast.AST, module: str, imported: dict[str, Place], root: Path) -> Iterator[Place]:
    """Places that a piece of a module names."""
    imported = {**imported, **dict(_imports(node))}
    waiting = [node]
    while waiting:
        part = waiting.pop()
        names = []
        base = part
        while isinstance(base, ast.Attribute):
            names.append(base.attr)
            base = base.value
        if not isinstance(base, ast.Name):
            waiting += ast.iter_child_nodes(part)
        elif base.id in imported:
            # Of a module only the member named counts.
            at = imported[base.id]
            while at[1] and module_file(".".join(at), root):
                at = (".".join(at), names.pop() if names else "")
            yield at
        else:
            yield module, base.id
