"""The command ``thesis``: run experiments, train policies, judge claims, build the book."""

from __future__ import annotations

import errno
import hashlib
import io
import operator
import os
import shlex
import signal
import sys
import textwrap
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from typing import Annotated, Any

import tyro

from thesis_lib.checkout import cache_folders, repository_root
from thesis_lib.checks import ForeseenError, check_seed, one_of
from thesis_lib.cli_parts import checked, parsed, status, text, unchecked
from thesis_lib.edition.budgets import BUDGETS
from thesis_lib.files import replacing, writable_directory

Budget = Annotated[str, tyro.conf.arg(metavar="{" + ",".join(BUDGETS) + "}")]


@dataclass(frozen=True)
class List:
    """List every experiment: id, seconds at the book budget on one core, what it measures.

    ``thesis run`` takes about 4 seconds more, for its imports.
    """

    def __call__(self) -> int:
        """Print the list, in lines of at most 100 columns."""
        # Importing every chapter takes seconds, so the list of this state of the code is kept.
        sources = sorted(Path(__file__).parent.rglob("*.py"))
        state = hashlib.sha256(b"\0".join(file.read_bytes() for file in sources)).hexdigest()
        kept = [folder / f"list-{state[:16]}.txt" for folder in cache_folders()]
        text = next((file.read_text(encoding="utf-8") for file in kept if file.exists()), "")
        if not text:
            text = _listing()
            for file in kept[:1]:
                with suppress(OSError, ValueError):
                    writable_directory(file.parent)
                    for old in file.parent.glob("list-*.txt"):
                        old.unlink()
                    with replacing(file) as temporary:
                        temporary.write_text(text, encoding="utf-8")
        print(text)
        return 0


def _listing() -> str:
    """The lines of ``thesis list``."""
    from thesis_lib.edition.chapters import experiments

    known = experiments().values()
    wide = max(len(e.id) for e in known)
    heads = [f"{e.id:{wide}} {e.seconds:5g} s  " for e in known]
    titles = [
        textwrap.shorten(e.title, 100 - len(head), placeholder=" ...")
        for head, e in zip(heads, known, strict=True)
    ]
    return "\n".join(head + title for head, title in zip(heads, titles, strict=True))


@dataclass(frozen=True)
class Run:
    """Run an experiment, write its table and provenance, and print the table.

    Any field of the experiment's config can be set as well, for instance
    ``thesis run table-3.1 --episodes 500``; ``thesis run table-3.1 --help`` lists them.
    """

    id: tyro.conf.Positional[str]
    """The experiment, as ``thesis list`` names it."""
    budget: Budget = "book"
    """smoke (seconds, no meaning), book (what the book shows) or thesis (as printed)."""
    seed: int = 0
    """All randomness comes from it."""
    workers: int = 1
    """Threads; the table does not depend on their number."""
    out: Path | None = None
    """Where ID.csv (or ID.parquet) and ID.json go; default _build/results/BUDGET."""

    def __call__(self, overrides: Sequence[str] = ()) -> int:
        """Run it; ``overrides`` are command-line fields of the experiment's config."""
        from thesis_lib.edition.chapters import find
        from thesis_lib.edition.experiment import results_directory
        from thesis_lib.edition.roots import code_of_table

        experiment = find(self.id)
        default = experiment.config(self.budget)
        kind = type(default)
        config = checked(
            kind,
            parsed(
                unchecked(kind),
                overrides,
                f"thesis run {self.id}",
                default=checked(unchecked(kind), default),
                description=f"{experiment.item}: {experiment.title} Fields of the config:",
            ),
        )
        # A directory that cannot be written to is found out before the work, not after.
        out = writable_directory(self.out or results_directory(self.budget))
        code = code_of_table(experiment, config)
        result = experiment.run(self.budget, config=config, seed=self.seed, workers=self.workers)
        path = replace(result, provenance={**result.provenance, "code": code}).save(out)
        print(text(result.table))
        wall = result.provenance["wall_seconds"]
        print(f"{experiment.item}: {len(result.table)} rows in {wall:.1f} s, written to {path}")
        return 0


@dataclass(frozen=True)
class Claims:
    """Judge the thesis's claims on saved results, or over seeds, and print the ledger.

    A claim without results is told with the committed verdict over seeds.
    With ``--seeds 10`` each claim is judged on 10 independent roots, whose tables are made first;
    killed, the same command goes on where it was.  With ``--confirm`` those that other code judged
    are judged on one root only, and stand where nothing comes out otherwise.
    """

    only: tyro.conf.Positional[tuple[str, ...]] = ()
    """Claims of these ids, or whose id or section starts so; default all."""
    results: Path | None = None
    """Directory of results; default _build/results/book, over seeds _build/claims."""
    seeds: int = 0
    """How many roots to judge on; 0 judges the saved results."""
    confirm: bool = False
    """Confirm the verdicts over seeds in --out that other code judged, on one root."""
    reuse: bool = False
    """With --seeds: let tables of earlier code stand where one root, made anew, is as it was."""
    budget: Budget = "book"
    """Of the evidence over seeds; only with --seeds or --confirm, as are --workers and --out."""
    workers: int = 1
    """Processes that make the evidence over seeds."""
    out: Path | None = None
    """Where verdicts.csv over seeds goes; default _build/claims.  The book reads results/claims."""

    def __call__(self) -> int:
        """Print the ledger."""
        one_of("budget", self.budget, BUDGETS)
        if self.seeds and self.confirm:
            raise ValueError(
                "--seeds judges on every root and --confirm on one: give one of the two."
            )
        if self.reuse and not self.seeds:
            raise ValueError(
                "--reuse is about the tables of many roots: give --seeds 10 as well, or leave "
                "it out."
            )
        if self.seeds:
            return self._over_seeds()
        if self.confirm:
            return self._confirm()
        for name in ("budget", "workers", "out"):
            if (value := getattr(self, name)) != getattr(Claims, name):
                raise ValueError(
                    f"--{name} is {value}, but it concerns evidence over seeds alone: give --seeds "
                    f"10 or --confirm as well, or leave --{name} out."
                )
        from thesis_lib.edition.experiment import results_directory
        from thesis_lib.edition.scoreboard import judge_all

        folder = self.results or results_directory("book")
        judged = judge_all(folder, self.only, draft=True)
        missing = [j.finding for j in judged if j.budget == "none"]
        if self.results and len(missing) == len(judged):
            raise FileNotFoundError(missing[0].evidence)
        for j in judged:
            kept = j.over if j.budget == "none" else None
            over = f" ({kept.frequency}, as committed)" if kept else ""
            verdict = kept.verdict if kept else j.finding.verdict
            _print_claim(j.claim, f"{str(verdict).upper()}{over}", j.finding.evidence)
        without = f", {len(missing)} of them without results in {folder}" if missing else ""
        print(f"{len(judged)} claims{without}")
        return 0

    def _folder(self) -> Path:
        """Where the verdicts over seeds lie."""
        return self.out or repository_root() / "_build" / "claims"

    def _over_seeds(self) -> int:
        from thesis_lib.edition import confirm, roots
        from thesis_lib.edition.chapters import claims
        from thesis_lib.edition.ledger import select

        out = writable_directory(self._folder())
        chosen = select(claims(), self.only)
        made: dict[str, Any] = {
            **{"budget": self.budget, "workers": self.workers, "work": self.results},
            "say": lambda line: print(line, flush=True),
        }
        for part in roots.parts(chosen, roots.TOGETHER if self.workers > 1 else 0.0):
            if self.reuse and (stand := confirm.reuse(part, self.seeds, **made)):
                print(f"Tables that stand: {', '.join(stand)}", flush=True)
            judged = roots.judge_over(part, self.seeds, **made)
            # What is judged is kept, whatever becomes of the rest.
            found = roots.save(judged, self.budget, out / "verdicts.csv")
            for j in judged:
                over, first = found[j.claim.id], next(iter(j.findings))
                evidence = j.findings[first].evidence
                text = f"root {first}: {evidence}" if first else evidence
                _print_claim(j.claim, f"{str(over.verdict).upper()} ({over.frequency})", text)
        print(f"{len(chosen)} claims, written to {out / 'verdicts.csv'}")
        return 0

    def _confirm(self) -> int:
        from thesis_lib.edition import confirm, roots
        from thesis_lib.edition.chapters import claims
        from thesis_lib.edition.ledger import select

        file = self._folder() / "verdicts.csv"
        found: list[confirm.Aged] = []
        waiting = confirm.aged(select(claims(), self.only), file)
        for part in roots.parts(waiting, roots.TOGETHER):
            found += confirm.confirm(
                part,
                file,
                budget=self.budget,
                workers=self.workers,
                work=self.results,
                say=lambda line: print(line, flush=True),
            )
        changed = [aged for aged in found if aged.why]
        for aged in changed:
            print(f"{aged.claim.id}: {aged.why}")
        print(f"{len(found) - len(changed)} of {len(found)} aged verdicts stand, in {file}")
        if changed:
            names = " ".join(aged.claim.id for aged in changed)
            print(f"To be judged anew: thesis claims {names} --seeds 10 --out {file.parent}")
        return 0


def _print_claim(claim: Any, verdict: str, evidence: str) -> None:
    """One claim of the ledger."""
    print(f"{claim.id}  [{claim.section}]  {verdict}")
    print(f"    claim:     {claim.statement}")
    print(f"    criterion: {claim.criterion}")
    print(f"    evidence:  {evidence}")


@dataclass(frozen=True)
class Book:
    """Execute the notebooks that need it and build the book."""

    budget: Budget = "book"
    """smoke, book or thesis."""
    seed: int = 0
    """Seed of every notebook."""
    only: tuple[str, ...] = ()
    """Notebooks to execute, such as ch03_potentials; default all."""

    def __call__(self) -> int:
        """Build the book."""
        from thesis_lib.book.build import build

        one_of("budget", self.budget, BUDGETS)
        check_seed(self.seed)
        return int(build(budget=self.budget, seed=self.seed, only=self.only) or 0)


def recorded(arguments: Sequence[str]) -> str:
    """The command line for a record, without what depends on the machine and not the result.

    Of a path from the root of the file system the part within the checkout stays, or its last name.
    """
    kept: list[str] = []
    skip = False
    for argument in arguments:
        name = argument.partition("=")[0].replace("_", "-")
        if name in ("--out", "--runs-in", "--workers", "--scheduler", "--film"):
            skip = "=" not in argument
        elif skip:
            skip = False
        else:
            option, equals, value = argument.rpartition("=")
            kept.append(f"{option}{equals}{_without_machine(value)}")
    return f"thesis {shlex.join(kept)}"


def _without_machine(value: str) -> str:
    """A path without the folders that only this machine has; any other text as it is."""
    path = Path(os.path.expanduser(value))
    if not path.is_absolute():
        return value
    root = repository_root()
    return str(path.relative_to(root)) if path.is_relative_to(root) else path.name


_LATE = {
    "train": "Train one policy; given again, the same command goes on where it was killed.\n\n"
    "For instance ``thesis train --task hopper --architecture ctrnn``.",
    "evaluate": "Test a trained policy, by its mean action, with any perturbation.\n\n"
    "For instance ``thesis evaluate _build/runs/hopper-flat-ctrnn-0 --noise 1``.",
    "export": "Write a policy for other programs: weights with a card (.npz), or ONNX.\n\n"
    "For instance ``thesis export _build/runs/hopper-flat-ctrnn-0 hopper.onnx``.",
    "test-policies": "Test every policy of a sweep: base, noise and switch (section 5.4).\n\n"
    "For instance ``thesis test-policies _build/runs/sweep --out _build/results/tests``.",
    "sweep": "Train a grid of policies, on one machine or many, and merge their curves.\n\n"
    "Given again, it goes on where it was killed.",
    "merge": "Bring the finished runs of several sweeps together, tables and policies.\n\n"
    "For instance ``thesis merge results/study/breadth _build/results/more --out results/study/"
    "breadth``.",
}
"""Commands of :mod:`thesis_lib.cli_training`, which takes seconds to import."""


@dataclass(frozen=True)
class _Late:
    """Stands for such a command while another, or help, was asked for."""


FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""What the system says when a disk, a quota or a limit of size leaves no room."""


@contextmanager
def _manners() -> Iterator[None]:
    """Stop on SIGTERM and SIGHUP as on Ctrl-C, print what the terminal can show, draw to files."""

    def interrupt(number: int, frame: Any) -> None:
        raise KeyboardInterrupt(number)

    def dropped(lost: sys.UnraisableHookArgs) -> None:
        # One that comes while a compiled library calls back, as LLVM does, is lost there.
        if isinstance(lost.exc_value, KeyboardInterrupt):
            number = next(iter(lost.exc_value.args), signal.SIGINT)
            signal.signal(signal.SIGALRM, lambda _, frame: interrupt(number, frame))
            signal.setitimer(signal.ITIMER_REAL, 0.05)
        else:
            hook(lost)

    hook, sys.unraisablehook = sys.unraisablehook, dropped
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    before: dict[int, Any] = {}
    backend = os.environ.pop("MPLBACKEND", None)  # of a user's screen
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGTERM, signal.SIGHUP):
            # One that is ignored, as SIGHUP is under nohup, stays so.
            if signal.getsignal(number) is signal.SIG_DFL:
                before[number] = signal.signal(number, interrupt)
    try:
        yield
    finally:
        sys.unraisablehook = hook
        if backend is not None:
            os.environ["MPLBACKEND"] = backend
        for replaced, handler in before.items():
            signal.signal(replaced, handler)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point of the command ``thesis``; returns the exit status."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    with _manners():
        return _main(arguments)


def _main(arguments: list[str]) -> int:
    """Carry out a command line; every failure that is foreseen is one sentence."""
    try:
        if arguments[:1] == ["run"] and len(arguments) > 2 and {"-h", "--help"} & set(arguments):
            named = arguments[1]  # after an option its value would be taken for the experiment
            if not named.startswith("-"):
                return Run(named)(["--help"])
        late: dict[str, type] = dict.fromkeys(_LATE, _Late)
        if arguments[:1] and arguments[0] in _LATE:
            from thesis_lib.cli_training import COMMANDS

            late = COMMANDS
        described = [
            Annotated[kind, tyro.conf.subcommand(name, description=_LATE[name])]
            for name, kind in late.items()
        ]
        kinds: list[Any] = [List, Run, *described, Claims, Book]
        command, unknown = parsed(
            reduce(operator.or_, kinds),
            arguments,
            "thesis",
            command=" ".join(["thesis", *arguments[:1]]),
            description="The living edition of Snel's thesis, on the command line.",
            return_unknown_args=True,
        )
        if isinstance(command, Run):
            return command(unknown)
        if unknown:
            raise ValueError(f"{unknown[0]!r} is not known: see `thesis {arguments[0]} --help`.")
        takes_record = arguments[0] in ("evaluate", "test-policies", "sweep", "merge")
        return int(command(recorded(arguments)) if takes_record else command())
    except (ValueError, FileNotFoundError) as error:
        print(f"thesis: {error}", file=sys.stderr)
        return 2
    except (ForeseenError, FloatingPointError, ImportError) as error:
        print(f"thesis: {error}", file=sys.stderr)
        return 1
    except BrokenPipeError:
        # The reader of our output, such as `head`, has seen enough.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        where = f" {error.filename!r}" if error.filename else ""
        if error.errno in FULL:
            way_out = "make room and give the command again; no file was left half written"
        elif error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
            way_out = "work in a copy that you may write to"
            way_out += "" if arguments[0] == "book" else ", or choose where to with --out"
        else:
            way_out = "see to it and give the command again"
        print(f"thesis: cannot use{where} ({error.strerror}): {way_out}.", file=sys.stderr)
        return 1
    except KeyboardInterrupt as stop:
        print("thesis: interrupted; no file was left half written.", file=sys.stderr)
        return status(stop)


if __name__ == "__main__":
    sys.exit(main())
