"""The staged book: everything Sphinx reads, laid out as in the checkout, under ``_build/src``.

Files are written only where they differ, so that Sphinx reads again only what changed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

import nbformat
import yaml

from thesis_lib.book.execution import Run, Task
from thesis_lib.book.paths import Paths
from thesis_lib.book.sources import merge
from thesis_lib.imports import hidden

#: Pages that the build writes from data, in the checkout as stubs and in the stage in full.
GENERATED = Path("book", "_generated")


def stage(
    paths: Paths, tasks: Mapping[str, Task], runs: Mapping[str, Run], pages: Mapping[str, str]
) -> None:
    """Bring the staged book up to date.

    Parameters
    ----------
    paths
        Where from and where to.
    tasks
        Every notebook, by name.
    runs
        Their runs, by name; a notebook without one is staged without outputs.
    pages
        Text of generated files by name, such as ``status.md``.
    """
    config = (paths.root / "_config.yml").read_text(encoding="utf-8")
    files: dict[Path, bytes] = {
        Path("_toc.yml"): (paths.root / "_toc.yml").read_bytes(),
        Path("_config.yml"): staged_config(config).encode(),
    }
    for file in sorted((paths.root / "book").rglob("*")):
        if file.is_file() and not hidden(file.relative_to(paths.root)):
            files[file.relative_to(paths.root)] = file.read_bytes()
    for name, text in pages.items():
        files[GENERATED / name] = text.encode()
    for name, task in tasks.items():
        run = runs.get(name)
        executed = run.notebook if run else None
        page = merge(task.source, executed, dict(task.parameters))
        files[Path("notebooks", f"{name}.ipynb")] = nbformat.writes(page, indent=1).encode()
    sync(files, paths.source)


def staged_config(text: str) -> str:
    """The book's settings with execution switched off, since papermill has done it."""
    config = yaml.safe_load(text)
    config["execute"]["execute_notebooks"] = "off"
    return str(yaml.safe_dump(config, sort_keys=False, allow_unicode=True))


def sync(files: Mapping[Path, bytes], folder: Path) -> None:
    """Make a folder hold exactly these files, leaving those that are the same untouched."""
    for relative, data in files.items():
        target = folder / relative
        if not target.is_file() or target.read_bytes() != data:
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(data)
    for target in sorted(folder.rglob("*"), reverse=True):
        if target.is_dir():
            if not any(target.iterdir()):
                target.rmdir()
        elif target.relative_to(folder) not in files:
            target.unlink()


def fingerprint(folder: Path) -> str:
    """Hash of a folder's files, names and contents."""
    hashed = hashlib.sha256()
    for file in sorted(folder.rglob("*")):
        if file.is_file():
            data = file.read_bytes()
            hashed.update(f"{file.relative_to(folder)}\0{len(data)}\0".encode() + data)
    return hashed.hexdigest()
