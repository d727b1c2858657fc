"""Build the book: run what changed, write the generated pages, run Sphinx."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from thesis_lib.book.child import Children
from thesis_lib.book.execution import Run, Task, execute, finished, last_run, plan, surroundings
from thesis_lib.book.pages import generated
from thesis_lib.book.paths import Paths
from thesis_lib.book.staging import fingerprint, stage
from thesis_lib.checks import check_seed, one_of
from thesis_lib.edition.budgets import BUDGETS
from thesis_lib.files import alone, replacing, write_json
from thesis_lib.imports import PACKAGE

PAGE_BYTES = 300 * 1024
"""What the HTML of a page weighs at most: a telephone reads it in a second or two."""

_STAMP = ".built.json"
_COLLECTED = ".from-notebooks"


def build(
    budget: str = "book",
    seed: int = 0,
    only: Sequence[str] = (),
    *,
    root: Path | None = None,
    say: Callable[[str], None] | None = None,
) -> int:
    """Execute the notebooks that need it and build the book.

    Parameters
    ----------
    budget
        ``smoke``, ``book`` or ``thesis``.
    seed
        Seed of every notebook.
    only
        Names of notebooks to execute, such as ``ch03_potentials``, for a draft in
        ``_build/html-draft``: the others are shown as they last ran, and warnings do not fail
        the build.  All when empty.
    root
        The checkout; default the one this library runs from.
    say
        Told what happens, a line at a time; prints by default.

    Returns
    -------
    int
        Exit status: 0, or 1 if a notebook or Sphinx failed.

    Raises
    ------
    ValueError
        If the budget, the seed or a notebook's name is not one that exists.
    """
    say = say or partial(print, flush=True)
    paths = Paths.of(one_of("budget", budget, BUDGETS), root, draft=bool(only))
    check_seed(seed)
    paths.build.mkdir(exist_ok=True)
    waiting = partial(say, "Waiting for another build to end ...")
    with alone(paths.build / f".lock-{budget}", waiting):
        started = time.perf_counter()
        tasks = {task.name: task for task in plan(paths, seed, _listed(only, paths, say))}
        if not _run(tasks, only, paths, say):
            return 1
        found = {
            name: last_run(name, paths) if only else finished(task, paths)
            for name, task in tasks.items()
        }
        runs = {name: run for name, run in found.items() if run and _shows(run, tasks[name])}
        collect_tables(runs, paths.results)
        stage(paths, tasks, runs, generated(paths.root, paths.results, runs, draft=paths.draft))
        status = _render(paths, strict=not only, say=say)
        if status == 0:
            for page, size in heavy(paths.html).items():
                say(
                    f"{page} is too heavy: it weighs {size:,} bytes, and a page at most "
                    f"{PAGE_BYTES:,}; shorten or split it."
                )
            say(
                f"The book is built ({time.perf_counter() - started:.0f} s).  Open\n"
                f"  {paths.html / 'index.html'}\n"
                "in a browser" + (", or run `make serve`." if budget == "book" else ".")
            )
        return status


def heavy(html: Path) -> dict[str, int]:
    """The pages of a built book that weigh more than :data:`PAGE_BYTES`, with their bytes.

    ``tests/book/test_built_book.py`` holds it, and how tall pages are, which takes a browser.
    """
    sizes = {
        file.relative_to(html).as_posix(): file.stat().st_size
        for file in sorted(html.rglob("*.html"))
    }
    return {page: size for page, size in sizes.items() if size > PAGE_BYTES}


def collect_tables(runs: Mapping[str, Run], results: Path) -> None:
    """Bring the notebooks' tables to where the ledger reads them.

    A table of the same name from elsewhere (``thesis run``) is replaced, so that the verdicts
    rest on the run that the pages show.  One that a notebook used to make and makes no longer
    is removed; one that none ever made is left alone.
    """
    results.mkdir(parents=True, exist_ok=True)
    record = results / _COLLECTED
    before = set(json.loads(record.read_text(encoding="utf-8"))) if record.exists() else set()
    tables = {table.name: table.read_bytes() for run in runs.values() for table in run.tables}
    for name, data in tables.items():
        target = results / name
        if not target.exists() or target.read_bytes() != data:
            with replacing(target) as temporary:
                temporary.write_bytes(data)
    for name in before - set(tables):
        (results / name).unlink(missing_ok=True)
    write_json(record, sorted(tables))


def _listed(only: Sequence[str], paths: Paths, say: Callable[[str], None]) -> list[str]:
    """The notebooks that are in the table of contents, or asked for by name.

    Others are left unread: an editor's new or empty file must not stop the build.
    """
    names = sorted(f.stem for f in paths.notebooks.glob("*.ipynb") if f.name[0] != ".")
    unknown = [name for name in only if name not in names]
    if unknown:
        raise ValueError(
            f"there is no notebook {', '.join(map(repr, unknown))}: choose among "
            f"{', '.join(names)}."
        )
    toc = (paths.root / "_toc.yml").read_text(encoding="utf-8")
    listed = {name for name in names if re.search(rf"\bnotebooks/{re.escape(name)}\b", toc)}
    for name in names:
        if name not in listed:
            say(f"notebooks/{name}.ipynb is not in _toc.yml, so it gets no page.")
    return [name for name in names if name in listed or name in only]


def _run(
    tasks: Mapping[str, Task], only: Sequence[str], paths: Paths, say: Callable[[str], None]
) -> bool:
    """Execute what needs it; returns whether all went well."""
    wanted = [task for task in tasks.values() if not only or task.name in only]
    stale = [task for task in wanted if finished(task, paths) is None]
    say(
        f"{len(wanted)} notebooks at the {paths.budget} budget: {len(wanted) - len(stale)} "
        f"unchanged, {len(stale)} to execute."
    )
    if stale:
        for leftover in paths.executed.glob(".*"):  # of runs that were killed
            shutil.rmtree(leftover)
    errors = execute(stale, paths, say)
    for error in errors.values():
        say(f"\n{error}")
    return not errors


def _shows(run: Run, task: Task) -> bool:
    """Whether a run has outputs for the notebook's cells as they stand."""
    cells = [cell for cell in task.source.cells if cell.cell_type == "code"]
    return sum(cell.cell_type == "code" for cell in run.notebook.cells) == len(cells)


def _render(paths: Paths, *, strict: bool, say: Callable[[str], None]) -> int:
    """Run Sphinx, unless the pages are those of the staged book already.

    A book is made afresh, beside the last one, and takes its place when it is whole: when
    Sphinx brings pages up to date, it leaves some citations pointing nowhere, does not copy a
    changed style sheet, and keeps silent about what it warned of before.  A draft lives with
    that, and is quicker.
    """
    if not strict:
        return _sphinx(paths, paths.html, strict=False, say=say)
    stamp, search = paths.html / _STAMP, paths.html / "searchindex.js"
    made = (
        json.loads(stamp.read_text(encoding="utf-8")) if stamp.exists() and search.exists() else {}
    )
    made_from = fingerprint(paths.source) + _package(paths.root)
    # A bare `jupyter-book build .` writes to the same place; the time tells.
    if made and made == {"from": made_from, "at": search.stat().st_mtime_ns}:
        say("No page changed.")
        return 0
    fresh = paths.html.with_name(f".{paths.html.name}.new")
    for folder in (fresh, paths.doctrees):
        shutil.rmtree(folder, ignore_errors=True)
    status = _sphinx(paths, fresh, strict=True, say=say)
    if status == 0:
        at = (fresh / search.name).stat().st_mtime_ns
        (fresh / _STAMP).write_text(json.dumps({"from": made_from, "at": at}), encoding="utf-8")
        shutil.rmtree(paths.html, ignore_errors=True)
        fresh.rename(paths.html)
    return status


def _sphinx(paths: Paths, html: Path, *, strict: bool, say: Callable[[str], None]) -> int:
    """Run Sphinx in a process of its own; returns 0, or 1 with a word on where to look."""
    folders = [str(folder) for folder in (paths.source, html, paths.doctrees)]
    status, _ = Children().run(
        "thesis_lib.book.render",
        [*folders, *(["--strict"] if strict else [])],
        env=surroundings(paths),
    )
    if status:
        say("The book was not built: see the warnings and errors above.")
    return int(status != 0)


def _package(root: Path) -> str:
    """Hash of the package, whose docstrings and Sphinx extensions are part of the pages."""
    files = sorted(f for kind in ("*.py", "*.html") for f in (root / PACKAGE).rglob(kind))
    return hashlib.sha256(b"\0".join(file.read_bytes() for file in files)).hexdigest()
