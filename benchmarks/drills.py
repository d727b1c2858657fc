"""Fault drills: what is left after kills, full disks, bad input and two hands at once.

    .venv/bin/python benchmarks/drills.py run train sweep book others   # about half an hour
    .venv/bin/python benchmarks/drills.py run --kills 5

It prints a table and exits with 1 if a drill failed.  With ``--out results/drills`` the rows of
the commands that were drilled are replaced in the table that the book's page *Status* shows.

After each kill nothing of the command may go on computing, no line of a traceback may have been
printed, and the same command given again must end with the bytes of a run that nobody disturbed.
"""

import argparse
import contextlib
import filecmp
import io
import json
import multiprocessing
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import psutil

from thesis_lib import cli, cli_training  # noqa: F401 - the latter is for the forks
from thesis_lib.checkout import environment, repository_root
from thesis_lib.edition.chapters import experiments
from thesis_lib.edition.experiment import load, read_csv
from thesis_lib.files import replacing, writable_directory

EXPERIMENT = "figure-3.3"
NOTEBOOK = "appendix_a"
RUN = ["run", EXPERIMENT, "--budget", "smoke"]
SMALL = ["--batch-steps", "200", "--horizon", "100", "--checkpoint-every", "1"]
TRAIN = ["train", "--task", "HalfCheetah", "--architecture", "gru", *SMALL]
SWEEP = ["sweep", "--tasks", "HalfCheetah", "--architectures", "dtrnn", "gru", *SMALL]
BOOK = ["book", "--budget", "smoke", "--only", NOTEBOOK]
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
DESCRIBED = {
    "command": "what was drilled",
    "drill": "what was done to it",
    "good": "how often everything was as it should be",
    "of": "how often it was done",
    "commit": "of the code, with + where it had changes",
    "day": "in UTC",
}

FORKED = multiprocessing.get_context("forkserver")
"""Small commands are forked from a process that has imported everything, so that they take no
seconds to start and a random moment falls into their work."""


# ---------------------------------------------------------------------------------- processes
class Command:
    """A command that was started; ``forked`` ones share what is imported already."""

    def __init__(self, arguments: Sequence[str], *, forked: bool = True, limit: int = -1) -> None:
        self._told = tempfile.NamedTemporaryFile("r", suffix=".txt")  # noqa: SIM115
        given = [list(arguments), self._told.name, limit]
        if forked:
            self._process: Any = FORKED.Process(target=carry_out, args=given)
            self._process.start()
            pid = self._process.pid
        else:
            code = f"import drills\ndrills.carry_out(*{given!r})"
            folder = Path(__file__).parent
            self._process = subprocess.Popen([sys.executable, "-c", code], cwd=folder)
            pid = self._process.pid
        self.pid: int = pid

    def begun(self) -> bool:
        """Wait until it is at work; False if it has ended."""
        while not self.error.startswith("begun"):
            if not psutil.pid_exists(self.pid):
                return False
            time.sleep(0.01)
        return True

    @property
    def error(self) -> str:
        """What it has said."""
        return Path(self._told.name).read_text(encoding="utf-8")

    def status(self) -> int:
        """Wait for its end."""
        if isinstance(self._process, subprocess.Popen):
            return self._process.wait()
        self._process.join()
        return int(self._process.exitcode)

    def stop(self, number: signal.Signals) -> str:
        """Send it a signal; returns what was wrong afterwards."""
        try:
            family = psutil.Process(self.pid).children(recursive=True)
            os.kill(self.pid, number)
        except (psutil.NoSuchProcess, ProcessLookupError):
            family = []
        status = self.status()
        _, left = psutil.wait_procs(family, timeout=20)
        wrong = [f"{child.pid} goes on" for child in left if child.is_running()]
        if "Traceback" in self.error or status not in (0, -number, 128 + number):
            wrong.append(f"status {status}, {self.error[-300:]!r}")
        return "; ".join(wrong)


def carry_out(arguments: list[str], told: str, limit: int) -> None:
    """Be the command ``thesis``, as a shell in the foreground would start it."""
    os.setsid()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    log = os.open(told, os.O_WRONLY | os.O_APPEND)
    os.dup2(log, sys.stderr.fileno())
    print("begun", file=sys.stderr, flush=True)
    if limit < 0:
        sys.exit(cli.main(arguments))
    sys.dont_write_bytecode = True
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    with contextlib.redirect_stderr(io.StringIO()) as said:  # what it says is no file
        try:
            status = cli.main(arguments)
        except BaseException:
            traceback.print_exc()
            status = 1
    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)
    os.write(log, said.getvalue().encode())
    sys.exit(status)


def tell(what: str) -> None:
    print(f"  {what}", file=sys.stderr, flush=True)


# ------------------------------------------------------------------------------------- drills
def kills(n: int, start: Callable[[int], Command], whole: Callable[[int], str]) -> tuple[int, int]:
    """Stop a command n times at a random moment; ``whole`` says what is wrong afterwards."""
    for _ in range(2):  # the first compiles loops, which takes longer than all the rest
        undisturbed = start(-1)
        undisturbed.begun()
        clock = time.perf_counter()
        if undisturbed.status():
            raise RuntimeError(f"the command fails by itself: {undisturbed.error}")
    seconds, good = time.perf_counter() - clock, 0
    for i in range(n):
        command = start(i)
        command.begun()
        time.sleep(random.Random(i).uniform(0, seconds))
        number = SIGNALS[i % len(SIGNALS)]
        wrong = command.stop(number) or whole(i)
        if wrong:
            tell(f"{number.name} {i}: {wrong}")
        good += not wrong
    return good, n


def again(command: Command) -> str:
    """What is wrong with the same command given once more."""
    return f"the second time status {command.status()}, {command.error}" if command.status() else ""


def run_in(folder: Path, *more: str, **options: Any) -> Command:
    return Command([*RUN, "--out", str(folder), *more], **options)


def train_in(folder: Path, *more: str, **options: Any) -> Command:
    return Command([*TRAIN, "--iterations", "40", "--out", str(folder), *more], **options)


def sweep_in(folder: Path, iterations: int, workers: int = 2) -> Command:
    places = ["--out", str(folder / "out"), "--runs-in", str(folder / "runs")]
    more = ["--iterations", str(iterations), "--workers", str(workers)]
    return Command([*SWEEP, *more, *places], forked=False)


def same(one: Path, two: Path) -> str:
    """What differs between the results of two folders: seconds may, half files must not be."""
    for path in sorted(p for p in one.rglob("*") if p.is_file()):
        twin = two / path.relative_to(one)
        if not twin.exists():
            return f"{path.name} is missing"
        if path.suffix == ".csv":
            tables = [read_csv(p) for p in (path, twin)]
            kept = [t[[c for c in t if not c.endswith("seconds")]] for t in tables]
            if kept[0].to_csv() != kept[1].to_csv():
                return f"{path.name} differs"
        elif path.name == "policies.pt" and not filecmp.cmp(path, twin, shallow=False):
            return f"{path.name} differs"
    extra = {p.relative_to(two) for p in two.rglob("*")} - {
        p.relative_to(one) for p in one.rglob("*")
    }
    return f"{sorted(map(str, extra))} left" if extra else ""


def full_disk(start: Callable[[int], Command], whole: Callable[[int], str]) -> tuple[int, int]:
    """Let no file grow beyond ten sizes: one line says so, and what is there can be read."""
    limits = [0, *(100 * 2**i for i in range(9))]
    good = 0
    for limit in limits:
        command = start(limit)
        status = command.status()
        said = command.error.removeprefix("begun\n")
        told = status == 0 or (said.startswith("thesis: ") and said.count("\n") == 1)
        wrong = whole(limit) or ("" if told else f"status {status}, {said[-300:]!r}")
        if wrong:
            tell(f"limit {limit}: {wrong}")
        good += not wrong
    return good, len(limits)


def readable(folder: Path) -> str:
    """Whether a folder holds a table that can be read, or none at all."""
    names = {path.name for path in folder.glob("*")}
    if f"{EXPERIMENT}.json" not in names:
        return "" if names <= {f"{EXPERIMENT}.csv"} else f"{sorted(names)} left"
    table, record = load(EXPERIMENT, folder)
    return "" if len(table) == record["rows"] else "the table is not whole"


BAD = [
    *(["run", name] for name in ("", "tabel-3.1", "3.1", "../x", "täble", "table-3.1 ")),
    *(["run", EXPERIMENT, "--budget", b] for b in ("", "quick", "SMOKE", "book ")),
    *([*RUN, "--seed", seed] for seed in ("-1", str(2**64), str(10**30), "1.5", "nan", "x", "")),
    *([*RUN, "--workers", workers] for workers in ("0", "-3", "1.5", "many")),
    *([*RUN, "--repeats", n] for n in ("0", "-1", "x", "1e3")),
    *([*RUN, "--episodes", n] for n in ("0", "-5", "")),
    *([*RUN, "--alphas", *alphas] for alphas in (["x"], ["2"], [".5", "nan"], ["-1"])),
    *([*RUN, "--epsilons", epsilon] for epsilon in ("2", "-0.1", "inf")),
    *([*RUN, "--discount", discount] for discount in ("-1", "1.5", "x")),
    *([*RUN, "--names", name] for name in ("", "Q*", "q_star")),
    *([*RUN, *more] for more in (["--mu.method", "magic"], ["--mu.restarts", "0"])),
    *([*RUN, "--colour", "red"], [*RUN, "red"], ["run"]),
    *([*TRAIN, "--delta-kl", value] for value in ("0", "-1", "inf", "nan", "x")),
    *([*TRAIN, "--task", name] for name in ("", "humanoid", "Hopper ")),
    *([*TRAIN, "--iterations", n] for n in ("-1", "1.5")),
    *([*SWEEP, "--seeds", *seeds] for seeds in (["0", "0"], ["-1"], ["x"], [])),
    *([*SWEEP, "--workers", workers] for workers in ("0", "x")),
    [*SWEEP, "--variants", "wings=2"],
    *(["book", "--budget", b] for b in ("", "quick", "Book")),
    *(["book", "--seed", s] for s in ("-1", str(2**64), "x")),
    *(["book", "--budget", "smoke", "--only", name] for name in ("ch9", "", "../x")),
    *([], ["fly"], ["list", "--all"], ["claims", "9.9"], ["claims", "--seeds", "-1"]),
    *(["evaluate"], ["evaluate", "nowhere"], ["evaluate", "nowhere", "--runs", "0"]),
    *(["export", "nowhere", "x.npz"], ["export", "nowhere", "x.zip"], ["export", "nowhere"]),
    *(["merge", "nowhere", "--out", "x"], ["merge", "--out", "x"]),
    *(["test-policies", "nowhere"], ["test-policies", "nowhere", "--rule", "luck"]),
]
"""Command lines that cannot be carried out."""


def bad_input(family: str, folder: Path) -> tuple[int, int]:
    """Status 2, one sentence with what was given and what is right, and nothing written."""
    tried = [
        line for line in BAD if (line[0] if line[:1] and line[0] in DRILLS else "others") == family
    ]
    good = 0
    for arguments in tried:
        takes_out = len(arguments) > 1 and arguments[0] in ("run", "train", "sweep")
        out = ["--out", str(folder)] if takes_out else []
        command = Command([*arguments, *out])
        status, said = command.status(), command.error.removeprefix("begun\n")
        right = status == 2 and re.fullmatch(r"thesis: .+(: | but ).+\.\n", said)
        right = right and any(given.lstrip("-") in said for given in arguments[-2:] or [""])
        if not right or any(folder.iterdir()):
            tell(f"{arguments}: status {status}, {said[-200:]!r}")
        good += bool(right) and not any(folder.iterdir())
    return good, len(tried)


def kills_apart(n: int, command_in: Callable[[Path], Command], here: Path) -> tuple[int, int]:
    """Kills of a command, each in a folder of its own, beside ``whole``, which is left in peace."""
    return kills(
        n,
        lambda i: command_in(here / (str(i) if i >= 0 else "whole")),
        lambda i: again(command_in(here / str(i))) or same(here / "whole", here / str(i)),
    )


def drill_run(fresh: Callable[[], Path], n: int) -> Iterator[tuple[str, tuple[int, int]]]:
    here = fresh()
    yield "killed, then given again", kills_apart(n, run_in, here)
    here = fresh()
    yield "disk full", full_disk(lambda limit: run_in(here, limit=limit), lambda _: readable(here))
    yield "bad input", bad_input("run", fresh())
    here = fresh()
    for command in [run_in(here, "--seed", seed) for seed in "12"]:
        command.status()
    yield "twice at once in one directory", (int(not readable(here)), 1)
    here = fresh()
    for workers in "124":
        run_in(here / workers, "--workers", workers).status()
    equal = [not same(here / "1", here / workers) for workers in "24"]
    yield "1, 2 and 4 workers, equal bytes", (1 + sum(equal), 3)


def drill_train(fresh: Callable[[], Path], n: int) -> Iterator[tuple[str, tuple[int, int]]]:
    here = fresh()
    whole = here / "whole"
    yield "killed, then given again", kills_apart(n, train_in, here)
    begun = here / "begun"
    train_in(begun, "--iterations", "2").status()

    def without_room(limit: int) -> Command:
        return train_in(Path(shutil.copytree(begun, here / f"full-{limit}")), limit=limit)

    def with_room(limit: int) -> str:
        return again(train_in(here / f"full-{limit}")) or same(whole, here / f"full-{limit}")

    yield "disk full, then given again", full_disk(without_room, with_room)
    yield "bad input", bad_input("train", fresh())
    here = fresh()
    first = train_in(here, "--iterations", "100000")
    first.begun()
    while not (here / "checkpoint.pt").exists():
        time.sleep(0.05)
    second = train_in(here, "--iterations", "100000")
    refused = second.status() == 2 and "another process" in second.error
    yield "twice at once in one directory", (int(refused and not first.stop(SIGNALS[1])), 1)


def drill_sweep(fresh: Callable[[], Path], n: int) -> Iterator[tuple[str, tuple[int, int]]]:
    here = fresh()

    def checkpoints() -> list[int]:
        records = (here / "runs").glob("*/run.json")
        return [json.loads(r.read_text(encoding="utf-8"))["iteration"] for r in records]

    def start(i: int) -> Command:
        return sweep_in(here, 10 * (i + 2))  # always some that are left to do

    yield "killed again and again", kills(n, start, lambda i: "" if checkpoints() else "no runs")
    last = max(checkpoints()) + 2
    wrong = again(sweep_in(here, last))
    for workers in (1, 2, 4):
        whole = here.parent / f"workers-{workers}"
        wrong = again(sweep_in(whole, last, workers)) or wrong
    shutil.copytree(here, here.parent / "workers-0")
    equal = [not same(here.parent / "workers-1" / "out", here.parent / f"workers-{w}" / "out")
             for w in (0, 2, 4)]  # fmt: skip
    if wrong or not all(equal):
        tell(f"{wrong} {equal}")
    yield "then brought to its end, equal bytes", (int(equal[0] and not wrong), 1)
    yield "1, 2 and 4 workers, equal bytes", (1 + sum(equal[1:]), 3)
    yield "bad input", bad_input("sweep", fresh())


def drill_book(fresh: Callable[[], Path], n: int) -> Iterator[tuple[str, tuple[int, int]]]:
    here = fresh()
    done = repository_root() / "_build" / "executed" / "smoke" / NOTEBOOK
    before: set[Path] = set()

    def begun() -> set[Path]:
        return set(done.parent.glob(f".{NOTEBOOK}.*"))

    def start(i: int) -> Command:
        if i == 0:
            shutil.copytree(done / "results", here / "whole")
        shutil.rmtree(done, ignore_errors=True)
        before.update(begun())  # what SIGKILL left, until a build comes to where it clears it away
        return Command(BOOK, forked=False)

    def whole(i: int) -> str:
        # Half a run has no manifest and does not count.
        manifest = done / "manifest.json"
        if manifest.exists() and not json.loads(manifest.read_text(encoding="utf-8"))["digest"]:
            return "half a run is kept"
        left = [p.name for p in begun() - before]
        return f"{left} left" if left and SIGNALS[i % len(SIGNALS)] != signal.SIGKILL else ""

    yield "killed", kills(n, start, whole)
    wrong = again(Command(BOOK, forked=False)) or same(here / "whole", done / "results")
    wrong = wrong or ", ".join(p.name for p in begun())
    if wrong:
        tell(wrong)
    yield "then given again, equal bytes", (int(not wrong), 1)
    yield "bad input", bad_input("book", fresh())


def drill_others(fresh: Callable[[], Path], n: int) -> Iterator[tuple[str, tuple[int, int]]]:
    yield "bad input", bad_input("others", fresh())


DRILLS = {
    "run": drill_run,
    "train": drill_train,
    "sweep": drill_sweep,
    "book": drill_book,
    "others": drill_others,
}
NAMES = {name: f"thesis {name}" for name in DRILLS} | {"others": "other commands"}


def keep(rows: list[dict[str, Any]], out: Path) -> None:
    """Replace the rows of the commands that were drilled in a table with its provenance."""
    folder = writable_directory(out)
    table, file = pd.DataFrame(rows), folder / "drills.csv"
    if file.exists():
        before = read_csv(file)
        table = pd.concat([before[~before.command.isin(table.command)], table])
        table = table.sort_values(
            "command",
            key=lambda c: c.map(list(NAMES.values()).index),
            kind="stable",
        )
    names = set(table.command)
    with replacing(file) as temporary:
        table.to_csv(temporary, index=False)
    record = {
        "id": "drills",
        "title": "Fault drills.",
        "command": " ".join(["benchmarks/drills.py", *(n for n in DRILLS if NAMES[n] in names)]),
        "columns": DESCRIBED,
        "rows": len(table),
        **environment(),
    }
    with replacing(folder / "drills.json") as temporary:
        temporary.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("which", nargs="+", choices=list(DRILLS))
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    experiments()
    FORKED.set_forkserver_preload([m for m in sys.modules if m.startswith("thesis_lib")])
    rows: list[dict[str, Any]] = []
    for which in asked.which:
        made = {"commit": environment()["commit"], "day": time.strftime("%Y-%m-%d", time.gmtime())}
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
            places = (Path(name, str(i), "here") for i in range(1000))

            def fresh(places: Iterator[Path] = places) -> Path:
                folder = next(places)
                folder.mkdir(parents=True)
                return folder

            for drill, (good, of) in DRILLS[which](fresh, asked.kills):
                rows.append({"command": NAMES[which], "drill": drill, "good": good, "of": of})
                rows[-1] |= made
                print(f"{rows[-1]['command']:14} {drill:38} {good} of {of}", flush=True)
    if asked.out:
        keep(rows, asked.out)
    return int(any(row["good"] < row["of"] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
