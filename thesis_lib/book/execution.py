"""Running notebooks, and knowing when a run is still good.

A run is good while its digest is: a hash of the notebook's code cells, the parameters it was
given, the lock file, the Python version, the modules and data of this package that its code
depends on, and the committed results it reads.  Prose is not part of it.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import nbformat

from thesis_lib.book.paths import Paths
from thesis_lib.book.sources import code_cells, parameter_names, read
from thesis_lib.edition.experiment import environment
from thesis_lib.edition.page import RESULTS_VARIABLE, check_parameters
from thesis_lib.imports import PACKAGE, closure, data_files, saved_results

_OUTPUT, _MANIFEST, _TABLES = "notebook.ipynb", "manifest.json", "results"

_PROBE = f"""\
import json, sys
print(json.dumps(sorted(m for m in sys.modules if m.split(".")[0] == {PACKAGE!r})))
"""


@dataclass(frozen=True)
class Task:
    """A notebook with the parameters it is to run with.

    Attributes
    ----------
    name
        File name without its suffix.
    source
        The notebook as committed.
    parameters
        What decides its results; ``workers`` is not among them.
    modules
        Modules of this package it depends on, by name.
    digest
        Of all that its results depend on, in hexadecimal.
    """

    name: str
    source: Any
    parameters: Mapping[str, object]
    modules: Mapping[str, Path]
    digest: str


@dataclass(frozen=True)
class Run:
    """A finished run on disk.

    Attributes
    ----------
    folder
        Holds the outputs, the manifest and the tables.
    manifest
        Name, parameters, digest, duration, versions, commit, tables.
    """

    folder: Path
    manifest: Mapping[str, Any]

    @property
    def notebook(self) -> Any:
        """The executed notebook."""
        return nbformat.read(self.folder / _OUTPUT, as_version=4)

    @property
    def tables(self) -> list[Path]:
        """Tables and their provenance that the notebook stored."""
        return sorted((self.folder / _TABLES).iterdir())


class NotebookFailedError(Exception):
    """A notebook stopped with an error; the message says where and why."""


def plan(paths: Paths, seed: int) -> list[Task]:
    """Every notebook of the book with its digest, in order of name.

    Raises
    ------
    ValueError
        If a notebook cannot be run: no parameters cell, or not plain Python.
    """
    return [task(path, paths, seed) for path in sorted(paths.notebooks.glob("*.ipynb"))]


def task(path: Path, paths: Paths, seed: int) -> Task:
    """One notebook with its digest."""
    notebook = read(path)
    parameters: dict[str, object] = {"budget": paths.budget, "seed": seed}
    try:
        check_parameters([*parameters, "workers"], parameter_names(notebook))
        cells = [cell.source for cell in code_cells(notebook)]
        modules = closure(cells, paths.root)
    except (ValueError, SyntaxError) as error:
        raise ValueError(f"{path.name} cannot be run: {error}") from None
    return Task(
        name=path.stem,
        source=notebook,
        parameters=parameters,
        modules=modules,
        digest=digest(cells, parameters, modules, paths.root),
    )


def digest(
    cells: Sequence[str],
    parameters: Mapping[str, object],
    modules: Mapping[str, Path],
    root: Path,
) -> str:
    """Hash of everything that decides what a notebook computes.

    Parameters
    ----------
    cells
        Sources of its code cells.
    parameters
        Values it is given.
    modules
        Modules it depends on.
    root
        The checkout, where ``constraints.txt`` lies.
    """
    hashed = hashlib.sha256()

    def add(*parts: str | bytes) -> None:
        for part in parts:
            data = part.encode() if isinstance(part, str) else part
            hashed.update(len(data).to_bytes(8, "big") + data)

    add(platform.python_version(), json.dumps(dict(parameters), sort_keys=True), *cells)
    add((root / "constraints.txt").read_bytes())
    found = dict(modules)
    for file in [*modules.values(), *data_files(found), *saved_results(found, root)]:
        add(file.relative_to(root).as_posix(), file.read_bytes())
    return hashed.hexdigest()


def finished(task: Task, paths: Paths) -> Run | None:
    """The run of a task, if there is a good one."""
    run = last_run(task.name, paths)
    return run if run and run.manifest["digest"] == task.digest else None


def last_run(name: str, paths: Paths) -> Run | None:
    """The last run of a notebook, good or not."""
    folder = paths.executed / name
    try:
        return Run(folder, json.loads((folder / _MANIFEST).read_text()))
    except FileNotFoundError:
        return None


def execute(
    tasks: Sequence[Task], paths: Paths, say: Callable[[str], None] = print
) -> dict[str, NotebookFailedError]:
    """Run notebooks, two at a time, and keep those that succeed.

    Parameters
    ----------
    tasks
        What to run.
    paths
        Where to.
    say
        Told when a notebook starts and ends.

    Returns
    -------
    dict
        Errors by notebook; empty when all went well.
    """
    if not tasks:
        return {}
    for folder in (paths.executed, paths.reports):
        folder.mkdir(parents=True, exist_ok=True)
    cores = os.cpu_count() or 1
    at_once = min(2, len(tasks), cores)
    children = _Children()
    _find_fonts(paths)

    def one(task: Task) -> NotebookFailedError | None:
        say(f"  {task.name}: executing ...")
        started = time.perf_counter()
        try:
            # As many threads each as there are cores: the last one running has them all.
            _execute(task, paths, cores, children)
        except NotebookFailedError as error:
            if not children.stopped:
                say(f"  {task.name}: FAILED after {time.perf_counter() - started:.0f} s")
            return error
        say(f"  {task.name}: done in {time.perf_counter() - started:.0f} s")
        return None

    # The longest go first, so that none is left to run alone at the end.
    ordered = sorted(tasks, key=lambda task: -_seconds(task, paths))
    with ThreadPoolExecutor(at_once) as pool:
        try:
            errors = list(pool.map(one, ordered))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            children.stop()
            raise
    return {task.name: error for task, error in zip(ordered, errors, strict=True) if error}


def _seconds(task: Task, paths: Paths) -> float:
    run = last_run(task.name, paths)
    return float(run.manifest["seconds"]) if run else float("inf")


class _Children:
    """Processes under way, so that an interrupt can end them."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._running: set[subprocess.Popen[str]] = set()
        self.stopped = False

    def run(self, command: Sequence[str], **options: Any) -> tuple[int, str]:
        """Run a command to its end; returns its exit status and what it printed."""
        with self._lock:
            if self.stopped:
                return 130, "interrupted"
            child = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                # A session of its own: the child's kernel is in it and ends with it.
                start_new_session=True,
                **options,
            )
            self._running.add(child)
        try:
            printed, _ = child.communicate()
        finally:
            with self._lock:
                self._running.discard(child)
        return child.returncode, printed

    def stop(self) -> None:
        """End every process under way, with the kernels they started."""
        with self._lock:
            self.stopped = True
            for child in self._running:
                os.killpg(child.pid, signal.SIGTERM)


def _execute(task: Task, paths: Paths, workers: int, children: _Children) -> None:
    """Run one notebook aside and move the finished run into place."""
    work = Path(tempfile.mkdtemp(prefix=f".{task.name}.", dir=paths.executed))
    try:
        tables = work / _TABLES
        tables.mkdir()
        probed = nbformat.from_dict(task.source)
        probe = nbformat.v4.new_code_cell(_PROBE, id="probe")
        probed = nbformat.from_dict({**probed, "cells": [*probed.cells, probe]})
        given, output = work / "given.ipynb", work / "output.ipynb"
        nbformat.write(probed, given)
        options = [
            part
            for name, value in {**task.parameters, "workers": workers}.items()
            for part in ("-p", name, str(value))
        ]
        started, clock = time.time(), time.perf_counter()
        code, printed = children.run(
            [
                *(sys.executable, "-m", "papermill", str(given), str(output), *options),
                *("--kernel", "python3", "--start-timeout", "300"),
                *("--no-progress-bar", "--no-log-output"),
            ],
            cwd=paths.root,
            env=_environment(paths, tables),
        )
        seconds = time.perf_counter() - clock
        if code:
            raise NotebookFailedError(_failure(task, paths, output, printed))
        _finish(task, work, output)
        given.unlink()
        output.unlink()
        manifest = {
            "name": task.name,
            "parameters": dict(task.parameters),
            "digest": task.digest,
            "started": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(started)),
            "seconds": round(seconds, 1),
            "modules": list(task.modules),
            "tables": [path.stem for path in sorted(tables.glob("*.json"))],
            **environment(),
        }
        (work / _MANIFEST).write_text(json.dumps(manifest, indent=1) + "\n")
        work.chmod(0o755)
        target = paths.executed / task.name
        # The manifest goes first: without it a run does not count, whatever else is left of it.
        (target / _MANIFEST).unlink(missing_ok=True)
        shutil.rmtree(target, ignore_errors=True)
        work.rename(target)
    finally:
        shutil.rmtree(work, ignore_errors=True)


def _environment(paths: Paths, tables: Path) -> dict[str, str]:
    """Environment of a notebook's kernel."""
    ipython = paths.build / "ipython"
    profile = ipython / "profile_default"
    profile.mkdir(parents=True, exist_ok=True)
    # Kernels warn on every start that they listen on an unencrypted local port.
    (profile / "ipython_kernel_config.py").write_text("c.IPKernelApp.log_level = 40\n")
    threads = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    return {
        **os.environ,
        **dict.fromkeys(threads, "1"),
        RESULTS_VARIABLE: str(tables),
        # Not the reader's own: start-up files there could change a result.
        "IPYTHONDIR": str(ipython),
        "MPLCONFIGDIR": str(_matplotlib(paths)),
        "PYTHONPATH": os.pathsep.join(
            [str(paths.root), *filter(None, [os.environ.get("PYTHONPATH")])]
        ),
    }


def _matplotlib(paths: Paths) -> Path:
    """Where matplotlib keeps its list of fonts: in the virtual environment the fonts are in.

    Its usual place is shared by all environments of a user, and a list that names the fonts
    of one that is gone makes every figure complain.
    """
    home = Path(sys.prefix)
    return (home if os.access(home, os.W_OK) else paths.build) / "matplotlib"


def _find_fonts(paths: Paths) -> None:
    """Let matplotlib list the fonts once, which it would else announce in the first notebook."""
    folder = _matplotlib(paths)
    if not any(folder.glob("fontlist-*.json")):
        folder.mkdir(parents=True, exist_ok=True)
        subprocess.run(
            [sys.executable, "-c", "import matplotlib.font_manager"],
            env={**os.environ, "MPLCONFIGDIR": str(folder)},
            capture_output=True,
            check=True,
        )


def _failure(task: Task, paths: Paths, output: Path, printed: str) -> str:
    """Keep what is left of a failed run and say in a few lines what went wrong."""
    log = paths.reports / f"{task.name}.log"
    log.write_text(printed)
    if output.exists():
        output.replace(paths.reports / f"{task.name}.ipynb")
    shown = printed.rstrip().splitlines()[-25:]
    return "\n".join([f"{task.name} failed; the whole log is {log}. It ends with:", *shown])


def _finish(task: Task, work: Path, output: Path) -> None:
    """Take what the build added out of an executed notebook, and check what it imported."""
    notebook = nbformat.read(output, as_version=4)
    probe = notebook.cells.pop()
    notebook.cells = [
        cell
        for cell in notebook.cells
        if "injected-parameters" not in cell.metadata.get("tags", ())
    ]
    loaded = json.loads("".join(part.text for part in probe.outputs))
    unseen = [name for name in loaded if name not in task.modules]
    if unseen:
        raise NotebookFailedError(
            f"{task.name} loaded {', '.join(unseen)} without an import that the build can see, "
            "so a change there would not re-execute it; import it in a code cell."
        )
    nbformat.write(notebook, work / _OUTPUT)
