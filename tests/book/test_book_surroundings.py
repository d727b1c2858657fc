"""What a user has set for other work stays out of the book, and no process outlives the build."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import nbformat
import psutil
import pytest
from nbformat.v4 import new_code_cell, new_notebook

from tests.book.test_book_execution import PARAMETERS
from tests.surroundings import ROOT, python
from thesis_lib.book.execution import NotebookFailedError, Run, execute, finished, plan
from thesis_lib.book.paths import Paths

START = "from thesis_lib.edition.page import start\npage = start(globals())"
FIGURE = {"mystnb": {"figure": {"name": "fig-x", "caption": "A line."}}}
DRAW = "import matplotlib.pyplot as plt\nplt.plot([0, 1])\nplt.title('title');"
TELL = """\
import json, os, sys, matplotlib as mpl
print(json.dumps({
    "python": sys.executable, "text": mpl.rcParams["text.color"],
    "tex": mpl.rcParams["text.usetex"], "spoilt": "spoilt" in globals(),
    "threads": os.environ["OMP_NUM_THREADS"], "encoding": open(os.devnull).encoding,
    "jit": os.environ.get("NUMBA_DISABLE_JIT")}))"""


def write(root: Path, name: str, *cells: str, figure: str | None = None) -> Path:
    """A notebook whose last cell, where given, is to draw a figure."""
    code = [
        new_code_cell(PARAMETERS, id="parameters", metadata={"tags": ["parameters"]}),
        *(new_code_cell(cell, id=f"cell-{i}") for i, cell in enumerate(cells)),
        *([new_code_cell(figure, id="draw", metadata=FIGURE)] if figure else []),
    ]
    kernel = {"name": "python3", "display_name": "", "language": "python"}
    path = root / "notebooks" / f"{name}.ipynb"
    nbformat.write(new_notebook(cells=code, metadata={"kernelspec": kernel}), path)
    return path


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A checkout with this package and notebooks of its own."""
    root = tmp_path_factory.mktemp("checkout")
    (root / "thesis_lib").symlink_to(ROOT / "thesis_lib")
    for name in ("notebooks", "book"):
        (root / name).mkdir()
    (root / "_config.yml").write_text("title: t\nexecute: {execute_notebooks: cache}\n")
    (root / "_toc.yml").write_text(
        "format: jb-book\nroot: book/intro\nchapters:\n- file: notebooks/long\n"
    )
    (root / "constraints.txt").write_text("")
    return root


@pytest.fixture
def foreign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """Surroundings of a user who does other work with Python as well."""
    (tmp_path / "matplotlibrc").write_text("text.color: white\ntext.usetex: True\nno.such: key\n")
    (tmp_path / "startup.py").write_text("spoilt = True\nprint('started')\n")
    kernel = tmp_path / "jupyter" / "kernels" / "python3"
    kernel.mkdir(parents=True)
    other = tmp_path / "other-python"
    other.write_text(f'#!/bin/sh\nexec "{sys.executable}" "$@"\n')
    other.chmod(0o755)
    command = ["/usr/bin/env", "OTHER=1", str(other), "-c", "raise SystemExit('another kernel')"]
    (kernel / "kernel.json").write_text(
        json.dumps({"argv": command, "display_name": "Other", "language": "python"})
    )
    settings = {
        "MPLBACKEND": "Agg",
        "MATPLOTLIBRC": str(tmp_path / "matplotlibrc"),
        "JUPYTER_PATH": str(tmp_path / "jupyter"),
        "PYTHONSTARTUP": str(tmp_path / "startup.py"),
        "NUMBA_DISABLE_JIT": "1",
        "OMP_NUM_THREADS": "7",
        "LC_ALL": "C",
        "PYTHONUTF8": "0",
        "PYTHONCOERCECLOCALE": "0",
        "HOME": "/nonexistent",
    }
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    return settings


def ran(root: Path, name: str) -> tuple[Run | None, NotebookFailedError | None, list[str]]:
    paths, said = Paths.of("smoke", root), []
    tasks = plan(paths, 0, [name])
    errors = execute(tasks, paths, said.append)
    return finished(tasks[0], paths), errors.get(name), said


def test_what_a_user_has_set_stays_out(root: Path, foreign: dict[str, str]) -> None:
    write(root, "settings", START, TELL, figure=DRAW)
    run, error, _ = ran(root, "settings")
    assert run, error
    told, drawn = (cell.outputs for cell in run.notebook.cells[-2:])
    assert json.loads(told[0].text) == {
        "python": sys.executable,
        "text": "black",
        "tex": False,
        "spoilt": False,
        "threads": "1",
        "encoding": "utf-8",
        "jit": None,
    }
    assert [kind for out in drawn for kind in out.data if kind.startswith("image/")]
    assert not [out for cell in run.notebook.cells for out in cell.outputs if "name" in out
                and out.name == "stderr"]  # fmt: skip


def test_a_run_that_lacks_a_figure_is_not_kept(root: Path) -> None:
    write(root, "blank", figure="import matplotlib\nmatplotlib.use('Agg')\n" + DRAW)
    run, error, said = ran(root, "blank")
    assert run is None
    assert "blank: the cell draw drew no picture for fig-x" in str(error)
    assert any("FAILED" in line for line in said)


def test_a_run_whose_sources_changed_meanwhile_is_not_kept(root: Path) -> None:
    change = f"open({str(root / 'constraints.txt')!r}, 'a').write('# changed')"
    write(root, "changing", change)
    run, error, _ = ran(root, "changing")
    assert run is None
    assert "changed while it ran" in str(error)


def test_a_kernel_that_dies_ends_the_run(root: Path) -> None:
    """As one does for want of memory; papermill once waited for it for ever (its issue 125)."""
    write(root, "dying", "import os, signal\nos.kill(os.getpid(), signal.SIGKILL)")
    run, error, said = ran(root, "dying")
    assert run is None
    assert "DeadKernelError" in str(error)
    assert any("FAILED" in line for line in said)


def test_papermill_by_itself_draws_every_figure(
    root: Path, foreign: dict[str, str], tmp_path: Path
) -> None:
    source = write(root, "alone", START, figure=DRAW)
    output = tmp_path / "out.ipynb"
    # Which python3 is meant is the user's own affair here.
    done = python(
        *("-m", "papermill", str(source), str(output), "-p", "budget", "smoke"),
        *("--inject-paths", "--no-progress-bar"),
        env={"JUPYTER_PATH": None, "PYTHONPATH": str(ROOT), "HOME": str(tmp_path)},
    )
    assert done.returncode == 0, done.stderr
    drawn = nbformat.read(output, as_version=4).cells[-1].outputs
    assert [kind for out in drawn for kind in out.get("data", ()) if kind.startswith("image/")]


# ------------------------------------------------------------------------------------- signals
def until(true: Callable[[], Any], seconds: float) -> bool:
    end = time.monotonic() + seconds
    while not true() and time.monotonic() < end:
        time.sleep(0.05)
    return bool(true())


def _heed_signals() -> None:
    """A shell starts what runs in the background with SIGINT ignored, and nohup with SIGHUP."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.fixture
def building(root: Path, tmp_path: Path) -> Iterator[tuple[subprocess.Popen[str], list[int]]]:
    """A build in the middle of a notebook, with the processes it has started."""
    mark = tmp_path / "pid"
    write(
        root, "long",
        f"import os, pathlib, time\npathlib.Path({str(mark)!r}).write_text(str(os.getpid()))\n"
        "while True:\n    time.sleep(1)",
    )  # fmt: skip
    code = (
        "import pathlib, sys\nimport thesis_lib.book.paths as paths\nfrom thesis_lib import cli\n"
        f"paths.repository_root = lambda: pathlib.Path({str(root)!r})\n"
        "sys.exit(cli.main(['book', '--budget', 'smoke', '--only', 'long']))"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=_heed_signals,
    )
    family: list[psutil.Process] = []
    try:
        assert until(lambda: mark.exists() and mark.read_text(), 120), process.poll()
        family = psutil.Process(process.pid).children(recursive=True)
        assert int(mark.read_text()) in [child.pid for child in family]
        yield process, [child.pid for child in family]
    finally:
        process.kill()
        process.communicate()
        for child in family:
            if child.is_running():
                child.kill()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_build_that_is_stopped_leaves_nothing_computing(
    building: tuple[subprocess.Popen[str], list[int]], number: signal.Signals
) -> None:
    process, family = building
    process.send_signal(number)
    _, error = process.communicate(timeout=30)
    assert until(lambda: not any(map(psutil.pid_exists, family)), 10)
    if number != signal.SIGKILL:
        assert process.returncode == 128 + number
        assert error == "thesis: interrupted; no file was left half written.\n"
