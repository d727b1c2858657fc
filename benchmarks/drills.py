"""Fault drills of `thesis run` and `thesis book`: what is left after kills, full disks, bad input.

    .venv/bin/python benchmarks/drills.py run            # minutes
    .venv/bin/python benchmarks/drills.py run book       # the book too, by one notebook

It prints a table and exits with 1 if a drill failed.
"""

import argparse
import filecmp
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil

from thesis_lib.checkout import repository_root
from thesis_lib.edition.experiment import load

EXPERIMENT = "figure-3.3"
NOTEBOOK = "appendix_a"
COMMAND = [sys.executable, "-m", "thesis_lib.cli"]


def thesis(*arguments: str, **options: object) -> subprocess.Popen[str]:
    """Start a command, as a shell in the foreground would."""
    return subprocess.Popen(
        [*COMMAND, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        **options,  # type: ignore[call-overload]
    )


def run(out: Path, *more: str, **options: object) -> subprocess.Popen[str]:
    return thesis("run", EXPERIMENT, "--budget", "smoke", "--out", str(out), *more, **options)


def whole(folder: Path) -> bool:
    """Whether a folder holds a table that can be read, or none at all."""
    names = {path.name for path in folder.glob("*") if not path.name.startswith(".")}
    if f"{EXPERIMENT}.json" not in names:
        return names <= {f"{EXPERIMENT}.csv"}
    table, record = load(EXPERIMENT, folder)
    return len(table) == record["rows"]


def kills(start: Callable[[], subprocess.Popen[str]], check: Callable[[], bool], n: int) -> str:
    """Kill a command n times at a random moment; count what was left as it should be."""
    started = time.perf_counter()
    start().communicate()
    seconds, good = time.perf_counter() - started, 0
    for i in range(n):
        process = start()
        time.sleep(random.Random(i).uniform(0, seconds))
        family = psutil.Process(process.pid).children(recursive=True) if process.poll() is None \
            else []  # fmt: skip
        process.send_signal((signal.SIGKILL, signal.SIGTERM, signal.SIGINT)[i % 3])
        _, error = process.communicate()
        _, left = psutil.wait_procs(family, timeout=10)
        right = check() and not left and "Traceback" not in error
        if not right:
            print(f"  kill {i}: {len(left)} left, {error[-300:]!r}")
        good += right
    return f"{good} of {n}"


def full_disk(folder: Path, n: int = 10) -> str:
    """Let no file grow beyond n sizes; the command must say so in one line and leave no half."""
    good = 0
    for i in range(n):
        limit = 50 * 2**i if i < n - 1 else 0

        def small(limit: int = limit) -> None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)

        process = run(folder, preexec_fn=small, env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"})
        _, error = process.communicate()
        told = process.returncode == 0 or error.splitlines()[-1].startswith("thesis: ")
        right = whole(folder) and told and "Traceback" not in error
        if not right:
            print(f"  limit {limit}: status {process.returncode}, {error[-300:]!r}")
        good += right
    return f"{good} of {n}"


def bad_input(folder: Path) -> str:
    """40 command lines that cannot be carried out: status 2, one line, nothing written."""
    wrong = [
        *(["run", name] for name in ("", "tabel-3.1", "3.1", "../x", "täble", "table-3.1 ")),
        *(["run", EXPERIMENT, "--budget", b] for b in ("", "quick", "SMOKE", "book ")),
        *(
            ["run", EXPERIMENT, "--budget", "smoke", "--seed", seed]
            for seed in ("-1", str(2**64), str(10**30), "1.5", "nan", "x", "")
        ),
        *(
            ["run", EXPERIMENT, "--budget", "smoke", "--workers", workers]
            for workers in ("0", "-3", "1.5", "many")
        ),
        *(
            ["run", EXPERIMENT, "--budget", "smoke", field, value]
            for field, value in (
                ("--repeats", "0"),
                ("--repeats", "-1"),
                ("--repeats", "x"),
                ("--repeats", "1e3"),
                ("--episodes", "0"),
                ("--episodes", "-5"),
                ("--colour", "red"),
            )
        ),
        *(["book", "--budget", b] for b in ("", "quick", "Book")),
        *(["book", "--seed", s] for s in ("-1", str(2**64), "x")),
        *(["book", "--budget", "smoke", "--only", name] for name in ("ch9", "", "../x")),
        *(["fly"], ["run"], ["list", "--all"]),
    ]
    good = 0
    for arguments in wrong:
        out = ["--out", str(folder)] if arguments[0] == "run" and len(arguments) > 1 else []
        process = thesis(*arguments, *out)
        _, error = process.communicate()
        right = process.returncode == 2 and "Traceback" not in error and not any(folder.iterdir())
        if not right:
            print(f"  {arguments}: status {process.returncode}, {error[-200:]!r}")
        good += right
    return f"{good} of {len(wrong)}"


def two_at_once(folder: Path) -> str:
    """Two processes write one directory at the same time; the result is one of them, whole."""
    both = [run(folder, "--seed", seed) for seed in ("1", "2")]
    for process in both:
        process.communicate()
    _, record = load(EXPERIMENT, folder)
    return "whole" if whole(folder) and record["seed"] in (1, 2) else "mixed"


def workers(folder: Path) -> str:
    for n in ("1", "2", "4"):
        run(folder / n, "--workers", n).communicate()
    files = [folder / n / f"{EXPERIMENT}.csv" for n in ("1", "2", "4")]
    same = all(filecmp.cmp(files[0], file, shallow=False) for file in files[1:])
    return "equal bytes" if same else "different"


def book_is_whole() -> bool:
    """Whether no half run is kept: each executed notebook has its manifest, or does not count."""
    executed = repository_root() / "_build" / "executed" / "smoke" / NOTEBOOK
    manifest = executed / "manifest.json"
    return not manifest.exists() or bool(json.loads(manifest.read_text(encoding="utf-8")))


def drills(which: list[str], n: int) -> Iterator[tuple[str, str]]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)

        def fresh() -> Path:
            shutil.rmtree(folder)
            folder.mkdir()
            return folder

        if "run" in which:
            yield "thesis run, killed", kills(lambda: run(folder), lambda: whole(folder), n)
            yield "thesis run, disk full", full_disk(fresh())
            yield "bad input", bad_input(fresh())
            yield "two processes, one directory", two_at_once(fresh())
            yield "1, 2 and 4 workers", workers(fresh())
        if "book" in which:
            build = ("book", "--budget", "smoke", "--only", NOTEBOOK)

            def afresh() -> subprocess.Popen[str]:
                done = repository_root() / "_build" / "executed" / "smoke" / NOTEBOOK
                shutil.rmtree(done, ignore_errors=True)
                return thesis(*build)

            yield "thesis book, killed", kills(afresh, book_is_whole, n)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("which", nargs="+", choices=["run", "book"])
    parser.add_argument("--kills", type=int, default=20)
    asked = parser.parse_args()
    failed = False
    for drill, outcome in drills(asked.which, asked.kills):
        print(f"{drill:32} {outcome}", flush=True)
        good, _, of = outcome.partition(" of ")
        failed |= good != of if of else outcome in ("mixed", "different")
    sys.exit(int(failed))
