"""Running notebooks, and knowing when a run is still good.

A run is good while its digest is: a hash of the notebook's code cells, the parameters it was
given, the lock file, the Python version, the modules and data of this package that its code
depends on, and the committed results it reads.  Prose is not part of it, but the expressions in
it are.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import nbformat
from nbconvert.filters import strip_ansi

from thesis_lib.book.child import Children
from thesis_lib.book.inline import expressions
from thesis_lib.book.paths import Paths
from thesis_lib.book.sources import code_cells, parameter_names, read
from thesis_lib.checkout import environment
from thesis_lib.edition.experiment import Experiment
from thesis_lib.edition.page import RESULTS_VARIABLE
from thesis_lib.edition.parameters import check_parameters
from thesis_lib.imports import PACKAGE, closure, data_files, imported, saved_results

_OUTPUT, _MANIFEST, _TABLES = "notebook.ipynb", "manifest.json", "results"

_KERNEL = "thesis"
"""A name of our own: ``python3`` is whatever a user's folders say."""

_PROBE = f"""\
import json, sys
loaded = {{n: getattr(m, "__file__", None) for n, m in sys.modules.items()}}
loaded = {{n: f for n, f in loaded.items() if n.split(".")[0] == {PACKAGE!r}}}
print(json.dumps({{"python": sys.executable, "modules": loaded}}))
"""

_KEPT = ("NUMBA_CACHE_DIR",)
_FOREIGN = ("PYTHON", "NUMBA_", "MPL", "MATPLOTLIB", "IPYTHON", "JUPYTER", "JPY_", "FORCE_COLOR")
"""Variables that begin so are settings of a user for other work, and stay out of the book."""


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

    @property
    def cells(self) -> list[str]:
        """Sources of its code cells, and the expressions in its prose."""
        asked = [text for cell in self.source.cells for text in expressions(cell)]
        return [*(cell.source for cell in code_cells(self.source)), *asked]


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


def plan(paths: Paths, seed: int, names: Iterable[str]) -> list[Task]:
    """Notebooks of the book, by name, with their digests.

    Raises
    ------
    ValueError
        If a notebook cannot be run: no notebook at all, no parameters cell, or not plain Python.
    """
    return [task(paths.notebooks / f"{name}.ipynb", paths, seed) for name in names]


def task(path: Path, paths: Paths, seed: int) -> Task:
    """One notebook with its digest."""
    notebook = read(path)
    parameters: dict[str, object] = {"budget": paths.budget, "seed": seed}
    try:
        check_parameters([*parameters, "workers"], parameter_names(notebook))
        cells = [cell.source for cell in code_cells(notebook)]
        asked = [text for cell in notebook.cells for text in expressions(cell)]
        modules = closure(cells, paths.root)
    except (ValueError, SyntaxError) as error:
        raise ValueError(f"{path.name} cannot be run: {error}") from None
    return Task(
        name=path.stem,
        source=notebook,
        parameters=parameters,
        modules=modules,
        digest=digest([*cells, *asked], parameters, modules, paths.root),
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
        Sources of its code cells, and the expressions in its prose.
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
        return Run(folder, json.loads((folder / _MANIFEST).read_text(encoding="utf-8")))
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
    children = Children()
    _prepare(paths)

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
    ordered = sorted(tasks, key=lambda task: -expected_seconds(task, paths))
    with ThreadPoolExecutor(at_once) as pool:
        try:
            errors = list(pool.map(one, ordered))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            children.stop()
            raise
    return {task.name: error for task, error in zip(ordered, errors, strict=True) if error}


def expected_seconds(task: Task, paths: Paths) -> float:
    """Seconds a notebook's last run took; of one that never ran, what its experiments state."""
    run = last_run(task.name, paths)
    if run:
        return float(run.manifest["seconds"])
    text = "\n".join(task.cells)
    direct = {name for cell in task.cells for name in imported(cell)}
    return sum(
        (
            item.seconds
            for name in direct & set(task.modules)
            if name.startswith(f"{PACKAGE}.") and name.count(".") == 2
            for attribute, item in vars(import_module(name)).items()
            if isinstance(item, Experiment) and f"{name.split('.')[-1]}.{attribute}" in text
        ),
        0.0,
    )


def _execute(task: Task, paths: Paths, workers: int, children: Children) -> None:
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
        made_with = environment()
        started, clock = time.time(), time.perf_counter()
        code, printed = children.run(
            "thesis_lib.book.engine",
            [
                *(str(given), str(output), *options, "--kernel", _KERNEL),
                *("--start-timeout", "300", "--no-progress-bar", "--no-log-output"),
            ],
            cwd=paths.root,
            env={**surroundings(paths), RESULTS_VARIABLE: str(tables)},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
        seconds = time.perf_counter() - clock
        if code:
            raise NotebookFailedError(_failure(task, paths, output, printed))
        _finish(task, work, output, paths)
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
            **made_with,
        }
        (work / _MANIFEST).write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")
        work.chmod(0o755)
        target = paths.executed / task.name
        # The manifest goes first: without it a run does not count, whatever else is left of it.
        (target / _MANIFEST).unlink(missing_ok=True)
        shutil.rmtree(target, ignore_errors=True)
        work.rename(target)
    finally:
        shutil.rmtree(work, ignore_errors=True)


def surroundings(paths: Paths) -> dict[str, str]:
    """Environment of the build's processes: what a user set for other work is left out.

    Among it are a backend or a style of matplotlib, start-up files, a kernel of the same name
    that runs another interpreter, and folders of other packages.
    """
    own = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(_FOREIGN) or name in _KEPT
    }
    threads = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    return {
        **own,
        **dict.fromkeys(threads, "1"),
        "IPYTHONDIR": str(paths.build / "ipython"),
        "JUPYTER_PATH": str(paths.build / "jupyter"),
        "JUPYTER_DATA_DIR": str(paths.build / "jupyter"),
        "JUPYTER_CONFIG_DIR": str(paths.build / "jupyter"),
        "MPLCONFIGDIR": str(_matplotlib(paths)),
        "PYTHONPATH": str(paths.root),
        "PYTHONUTF8": "1",
    }


def _prepare(paths: Paths) -> None:
    """Write the settings of kernels, and let matplotlib list the fonts once.

    It would else announce that in the first notebook.
    """
    profile = paths.build / "ipython" / "profile_default"
    kernel = paths.build / "jupyter" / "kernels" / _KERNEL
    for folder in (profile, kernel):
        folder.mkdir(parents=True, exist_ok=True)
    # Kernels warn on every start that they listen on an unencrypted local port.
    (profile / "ipython_kernel_config.py").write_text(
        "c.IPKernelApp.log_level = 40\n", encoding="utf-8"
    )
    command = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
    described = {"argv": command, "display_name": "Python 3", "language": "python"}
    (kernel / "kernel.json").write_text(json.dumps(described), encoding="utf-8")
    fonts = _matplotlib(paths)
    if not any(fonts.glob("fontlist-*.json")):
        fonts.mkdir(parents=True, exist_ok=True)
        subprocess.run(
            [sys.executable, "-c", "import matplotlib.font_manager"],
            env=surroundings(paths),
            capture_output=True,
            check=True,
        )


def _matplotlib(paths: Paths) -> Path:
    """Where matplotlib keeps its list of fonts: in the virtual environment the fonts are in.

    Its usual place is shared by all environments of a user, and a list that names the fonts
    of one that is gone makes every figure complain.
    """
    home = Path(sys.prefix)
    return (home if os.access(home, os.W_OK) else paths.build) / "matplotlib"


def _failure(task: Task, paths: Paths, output: Path, printed: str) -> str:
    """Keep what is left of a failed run and say in a few lines what went wrong."""
    log = paths.reports / f"{task.name}.log"
    printed = strip_ansi(printed)
    log.write_text(printed, encoding="utf-8")
    if output.exists():
        output.replace(paths.reports / f"{task.name}.ipynb")
    shown = printed.rstrip().splitlines()[-25:]
    return "\n".join([f"{task.name} failed; the whole log is {log}. It ends with:", *shown])


def _finish(task: Task, work: Path, output: Path, paths: Paths) -> None:
    """Take what the build added out of an executed notebook, and check what it ran and drew."""
    notebook = nbformat.read(output, as_version=4)
    probe = notebook.cells.pop()
    notebook.cells = [
        cell
        for cell in notebook.cells
        if "injected-parameters" not in cell.metadata.get("tags", ())
    ]
    found = json.loads("".join(part.text for part in probe.outputs))
    loaded = {name: Path(file) for name, file in found["modules"].items()}
    unseen = [name for name in loaded if name not in task.modules]
    if unseen:
        raise NotebookFailedError(
            f"{task.name} loaded {', '.join(unseen)} without an import that the build can see, "
            "so a change there would not re-execute it; import it in a code cell."
        )
    foreign = [file for name, file in loaded.items() if not file.samefile(task.modules[name])]
    if found["python"] != sys.executable or foreign:
        raise NotebookFailedError(
            f"{task.name} ran {found['python']} on {foreign or paths.root}, but the build must "
            f"run {sys.executable} on {paths.root}: take other versions of this package out of "
            "what Python starts with (its .pth files)."
        )
    for cell in notebook.cells:
        figure = cell.metadata.get("mystnb", {}).get("figure")
        drawn = [kind for out in cell.get("outputs", ()) for kind in out.get("data", ())]
        if figure and not any(kind.startswith("image/") for kind in drawn):
            raise NotebookFailedError(
                f"{task.name}: the cell {cell.id} drew no picture for {figure['name']}; it must "
                "end with a figure, and nothing may take matplotlib's inline backend away."
            )
    if digest(task.cells, task.parameters, task.modules, paths.root) != task.digest:
        raise NotebookFailedError(
            f"{task.name}: a file it depends on changed while it ran, so it may show a mixture "
            "of both; build again."
        )
    nbformat.write(notebook, work / _OUTPUT)
