"""The command ``thesis``: run experiments, train policies, judge claims, build the book."""

from __future__ import annotations

import dataclasses
import errno
import io
import os
import shlex
import signal
import sys
import textwrap
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

import pandas as pd
import tyro

from thesis_lib.checkout import repository_root
from thesis_lib.edition.chapters import experiments, find
from thesis_lib.edition.experiment import (
    BUDGETS,
    check_budget,
    check_seed,
    results_directory,
    writable_directory,
)
from thesis_lib.locomotion.rendering import NoGL, check_gl
from thesis_lib.training import curves
from thesis_lib.training.checkpoint import read_checkpoint
from thesis_lib.training.config import TrainConfig, idle_settings, task_name
from thesis_lib.training.evaluation import Disturbances, EvaluateConfig, evaluate, summarised, write
from thesis_lib.training.evaluation import idle_settings as idle_in_test
from thesis_lib.training.film import check_film, film
from thesis_lib.training.grid import GRID, GRID_COLUMNS, Grid, key, run_name
from thesis_lib.training.run import Training, TrainingStopped
from thesis_lib.training.sweep import Outcome, sweep
from thesis_lib.training.train import TerminalReport, default_directory, train, use_one_thread
from thesis_lib.training.trained import TrainedPolicies

SettingsT = TypeVar("SettingsT")


def _unchecked(kind: type[SettingsT], hidden: Sequence[str] = ()) -> type[SettingsT]:
    """A dataclass of the same fields that takes any value; :func:`_checked` checks them.

    The parser of the command line wraps what a dataclass raises into a box of its own, and
    we want one sentence.

    Parameters
    ----------
    kind
        A frozen dataclass.
    hidden
        Fields that cannot be set on the command line.
    """
    body: dict[str, Any] = {
        "__doc__": kind.__doc__,
        "__module__": kind.__module__,
        "__post_init__": lambda self: None,
        "__annotations__": dict.fromkeys(hidden, tyro.conf.Suppress[tyro.conf.Fixed[str]]),
    }
    return dataclass(frozen=True)(type(kind.__name__, (kind,), body))


def _checked(kind: type[SettingsT], given: Any) -> SettingsT:
    """The settings that were given, checked; ValueError for those that cannot be."""
    return kind(**{f.name: getattr(given, f.name) for f in dataclasses.fields(given)})


def _refuse(idle: Mapping[str, str]) -> None:
    """Raise ValueError for settings that have no effect, with what they would need."""
    for setting, owners in idle.items():
        raise ValueError(
            f"--{setting.replace('_', '-')} has no effect here, only with "
            f"{owners.replace('_', '-')}: leave it out."
        )


Budget = Annotated[str, tyro.conf.arg(metavar="{" + ",".join(BUDGETS) + "}")]


@dataclass(frozen=True)
class List:
    """List every experiment: id, seconds at the book budget on one core, what it measures."""

    def __call__(self) -> int:
        """Print the list, in lines of at most 100 columns."""
        known = experiments().values()
        wide = max(len(e.id) for e in known)
        for e in known:
            line = f"{e.id:{wide}} {e.seconds:5g} s  "
            print(line + textwrap.shorten(e.title, 100 - len(line), placeholder=" ..."))
        return 0


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
        experiment = find(self.id)
        default = experiment.config(self.budget)
        kind = type(default)
        config = _checked(
            kind,
            tyro.cli(
                _unchecked(kind),
                default=_checked(_unchecked(kind), default),
                args=list(overrides),
                prog=f"thesis run {self.id}",
                description=f"{experiment.item}: {experiment.title} Fields of the config:",
            ),
        )
        # A directory that cannot be written to is found out before the work, not after.
        out = writable_directory(self.out or results_directory(self.budget))
        result = experiment.run(self.budget, config=config, seed=self.seed, workers=self.workers)
        path = result.save(out)
        print(_text(result.table))
        wall = result.provenance["wall_seconds"]
        print(f"{experiment.item}: {len(result.table)} rows in {wall:.1f} s, written to {path}")
        return 0


@dataclass(frozen=True)
class Train:
    """Train one policy; given again, the same command goes on where it was killed.

    For instance ``thesis train --task hopper --architecture ctrnn``.
    """

    settings: Annotated[TrainConfig, tyro.conf.arg(name="", constructor=_unchecked(TrainConfig))]
    """Of the run."""
    out: Path | None = None
    """Where checkpoint.pt, curve.csv and run.json go; default a directory in _build/runs named
    after task, terrain, net and seed."""
    resume: bool = True
    """Go on with what is in the directory; otherwise a run that is there is an error."""
    any_version: bool = False
    """Go on even where other code or other versions of the libraries made it."""

    def __call__(self) -> int:
        """Train it."""
        config = _checked(TrainConfig, self.settings)
        _refuse(idle_settings(config))
        folder = writable_directory(self.out or default_directory(config))
        use_one_thread()
        report = TerminalReport(config.iterations)
        started = time.perf_counter()
        try:
            run = train(
                config,
                folder,
                resume=self.resume,
                any_version=self.any_version,
                report=report,
            )
        except KeyboardInterrupt as stop:
            good = read_checkpoint(folder)["iteration"]
            print(
                f"\nthesis: interrupted; the last checkpoint, of iteration {good}, is in {folder}: "
                "give the same command again to go on from it.",
                file=sys.stderr,
            )
            return _status(stop)
        curve = run.curve
        minutes, seconds = divmod(round(time.perf_counter() - started), 60)
        print(
            f"{config.architecture} on {config.task} ({config.terrain}), seed {config.seed}: "
            f"{run.iteration} iterations, {curve.steps.iloc[-1]:,} steps; mean return "
            f"{curve.mean_return.iloc[0]:.1f} in the first iteration, "
            f"{curve.mean_return.iloc[-1]:.1f} in the last, {curve.mean_return.max():.1f} in the "
            f"best; this command took {minutes} min {seconds:02d} s."
        )
        print(f"Learning curve {folder / 'curve.csv'}, checkpoint {folder / 'checkpoint.pt'}.")
        return 0


@dataclass(frozen=True)
class Evaluate:
    """Test a trained policy, by its mean action, with any perturbation.

    For instance ``thesis evaluate _build/runs/hopper-flat-ctrnn-0 --noise 1``.
    """

    checkpoint: tyro.conf.Positional[Path]
    """A checkpoint of ``thesis train``, the directory it is in, or ``policies.pt`` of a sweep."""
    settings: Annotated[
        EvaluateConfig, tyro.conf.arg(name="", constructor=_unchecked(EvaluateConfig))
    ]
    """Of the test."""
    disturbances: tyro.conf.OmitArgPrefixes[Disturbances]
    """Perturbations in short."""
    run: str | None = None
    """Which run of a sweep's ``policies.pt``, such as hopper-flat-gru-0-float32."""
    task: str | None = None
    """Refuse a checkpoint of another task."""
    architecture: str | None = None
    """Refuse a checkpoint of another net."""
    out: Path | None = None
    """Where evaluation.csv and evaluation.json go; default nowhere."""
    film: Path | None = None
    """Draw a run into this animated picture: .webp, .gif or .png."""
    film_run: int = 0
    """Which run to draw."""

    def __call__(self, command: str = "thesis evaluate") -> int:
        """Test it; ``command`` goes into the record."""
        config = _checked(EvaluateConfig, self.settings)
        _refuse(idle_in_test(config, self.disturbances))
        if self.film is None and self.film_run != 0:
            _refuse({"film_run": "film"})
        config = config.disturbed(self.disturbances)
        if self.run is None:
            trained = Training.load(self.checkpoint)
        else:
            trained = TrainedPolicies(self.checkpoint).load(self.run)
        self._check(trained.config)
        if self.out is not None:
            writable_directory(self.out)
        if self.film is not None:
            check_film(self.film, config, self.film_run)
            check_gl()
        use_one_thread()
        table = evaluate(trained, config)
        print(
            f"{trained.config.architecture} on {trained.config.task}, trained on "
            f"{trained.config.terrain} ground for {trained.iteration} iterations"
        )
        for perturbation in config.perturbations:
            print(f"  {perturbation}")
        print(_text(table))
        print(_text(summarised(table)))
        if self.out is not None:
            path = write(table, trained, config, self.out, command=command)
            print(f"Written to {path}.")
        if self.film is not None:
            print(f"Film {film(trained, self.film, config, run=self.film_run)}.")
        return 0

    def _check(self, trained: TrainConfig) -> None:
        """Raise ValueError when the checkpoint is not of the task or net asked for."""
        task = None if self.task is None else task_name(self.task)
        for name, asked in (("task", task), ("architecture", self.architecture)):
            have = getattr(trained, name)
            if asked is not None and asked != have:
                raise ValueError(
                    f"the checkpoint {str(self.checkpoint)!r} was trained with {name} {have!r}, "
                    f"not {asked!r}: choose another checkpoint, or leave --{name} out."
                )


@dataclass(frozen=True)
class Sweep:
    """Train a grid of policies, each in a process of its own, and merge their curves.

    Given again, it goes on where it was killed.
    """

    grid: Annotated[Grid, tyro.conf.arg(name="", constructor=_unchecked(Grid))]
    """Every combination of these."""
    settings: Annotated[
        TrainConfig,
        tyro.conf.arg(name="", constructor=_unchecked(TrainConfig, GRID)),
    ]
    """Of all runs."""
    workers: int = 1
    """Processes, each on one thread; no result depends on their number."""
    out: Path | None = None
    """Where curves.csv, curves.json and policies.pt go; default _build/results/sweep."""
    runs_in: Path | None = None
    """Where the runs' own directories are; default _build/runs/ and the last part of --out."""
    any_version: bool = False
    """Go on with runs even where other code or other versions of the libraries made them."""

    def __call__(self, command: str = "thesis sweep") -> int:
        """Train what is missing; ``command`` goes into the record."""
        configs = _checked(Grid, self.grid).runs(_checked(TrainConfig, self.settings))
        idle = [idle_settings(c) for c in configs]
        _refuse({name: by for name, by in idle[0].items() if all(name in i for i in idle)})
        out = writable_directory(self.out or repository_root() / "_build" / "results" / "sweep")
        runs = self.runs_in or repository_root() / "_build" / "runs" / out.name
        errors: dict[str, str] = {}

        def report(outcome: Outcome, ended: int) -> None:
            name = run_name(outcome.config)
            if outcome.error is None:
                row = curves.summary(curves.merged([outcome.config], runs)).iloc[0]
                news = (
                    f"return {row.first_return:.1f} -> {row.last_return:.1f}, "
                    f"{row.wall_seconds:.0f} s"
                )
            else:
                errors[name] = outcome.error
                news = f"FAILED: {outcome.error}"
            print(f"[{ended}/{len(configs)}] {name}: {news}", flush=True)
            curves.write(configs, runs, out, command=command, errors=errors)

        try:
            sweep(
                configs,
                runs,
                workers=self.workers,
                any_version=self.any_version,
                report=report,
            )
        except KeyboardInterrupt as stop:
            print(
                f"\nthesis: interrupted; the runs are kept in {runs}: give the same command again "
                "to go on from their last checkpoints.",
                file=sys.stderr,
            )
            return _status(stop)
        table = curves.summary(curves.merged(configs, runs))
        same = [c for c in GRID_COLUMNS if c != "task" and table[c].nunique() == 1]
        print(_text(table.drop(columns=same), most=len(table)))
        for column, name in curves.COMPARISONS.items():
            if len({key(c)[column] for c in configs}) > 1:
                print(_text(pd.read_csv(out / name)))
        print(f"{len(configs) - len(errors)} of {len(configs)} runs, written to {out}")
        return 1 if errors else 0


@dataclass(frozen=True)
class Claims:
    """Judge the thesis's claims on saved results and print the ledger."""

    only: tyro.conf.Positional[tuple[str, ...]] = ()
    """Claims whose id or section starts so; default all."""
    results: Path | None = None
    """Directory of results; default _build/results/book."""

    def __call__(self) -> int:
        """Print the ledger."""
        from thesis_lib.edition.scoreboard import judge_all

        judged = judge_all(self.results or results_directory("book"), self.only)
        for j in judged:
            print(f"{j.claim.id}  [{j.claim.section}]  {str(j.finding.verdict).upper()}")
            print(f"    claim:     {j.claim.statement}")
            print(f"    criterion: {j.claim.criterion}")
            print(f"    evidence:  {j.finding.evidence}")
        print(f"{len(judged)} claims")
        return 0


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

        check_budget(self.budget)
        check_seed(self.seed)
        return int(build(budget=self.budget, seed=self.seed, only=self.only) or 0)


def _recorded(arguments: Sequence[str]) -> str:
    """The command line for a record, without what depends on the machine and not the result."""
    kept: list[str] = []
    skip = False
    for argument in arguments:
        name = argument.partition("=")[0].replace("_", "-")
        if name in ("--out", "--runs-in", "--workers", "--film"):
            skip = "=" not in argument
        elif skip:
            skip = False
        else:
            kept.append(argument)
    return f"thesis {shlex.join(kept)}"


def _text(table: pd.DataFrame, most: int = 60) -> str:
    """A table as text, long ones with their middle left out."""
    shown = table
    note = ""
    if len(table) > most:
        shown = pd.concat([table.head(most // 2), table.tail(most // 2)])
        note = f"\n({len(table) - most} rows in the middle are not shown)"
    return shown.to_string(index=False, float_format=lambda v: f"{v:.5g}") + note


FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""What the system says when a disk, a quota or a limit of size leaves no room."""


def _status(stop: KeyboardInterrupt) -> int:
    """Exit status after an interrupt, as shells count: 128 and the signal's number."""
    return 128 + next(iter(stop.args), signal.SIGINT)


@contextmanager
def _manners() -> Iterator[None]:
    """Stop on SIGTERM and SIGHUP as on Ctrl-C, and print on any terminal what it can show."""

    def interrupt(number: int, frame: Any) -> None:
        raise KeyboardInterrupt(number)

    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    before: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGTERM, signal.SIGHUP):
            # One that is ignored, as SIGHUP is under nohup, stays so.
            if signal.getsignal(number) is signal.SIG_DFL:
                before[number] = signal.signal(number, interrupt)
    try:
        yield
    finally:
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
            named = next((a for a in arguments[1:] if not a.startswith("-")), None)
            if named:
                return Run(named)(["--help"])
        command, unknown = tyro.cli(
            List | Run | Train | Evaluate | Sweep | Claims | Book,
            args=arguments,
            prog="thesis",
            description="The living edition of Snel's thesis, on the command line.",
            return_unknown_args=True,
        )
        if isinstance(command, Run):
            return command(unknown)
        if unknown:
            raise ValueError(f"{unknown[0]!r} is not known: see `thesis {arguments[0]} --help`.")
        if isinstance(command, Evaluate | Sweep):
            return command(_recorded(arguments))
        return int(command())
    except (ValueError, FileNotFoundError) as error:
        print(f"thesis: {error}", file=sys.stderr)
        return 2
    except (TrainingStopped, FloatingPointError, NoGL) as error:
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
            way_out = "work in a copy that you may write to, or choose where to with --out"
        else:
            way_out = "see to it and give the command again"
        print(f"thesis: cannot use{where} ({error.strerror}): {way_out}.", file=sys.stderr)
        return 1
    except KeyboardInterrupt as stop:
        print("thesis: interrupted; no file was left half written.", file=sys.stderr)
        return _status(stop)


if __name__ == "__main__":
    sys.exit(main())
