"""The command ``thesis``: run experiments, train policies, judge claims, build the book."""

from __future__ import annotations

import dataclasses
import os
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

import pandas as pd
import tyro

from thesis_lib.experiments import experiments, find
from thesis_lib.experiments import sweep as sweeps
from thesis_lib.experiments.base import (
    BUDGETS,
    check_budget,
    check_seed,
    repository_root,
    results_directory,
    writable_directory,
)
from thesis_lib.experiments.training import TrainConfig

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


Budget = Annotated[str, tyro.conf.arg(metavar="{" + ",".join(BUDGETS) + "}")]


@dataclass(frozen=True)
class List:
    """List every experiment: id, thesis item, expected seconds at each budget."""

    def __call__(self) -> int:
        """Print the list."""
        table = pd.DataFrame(
            [
                {
                    "id": e.id,
                    "item": e.item,
                    **{f"{b} [s]": f"{e.seconds[b]:g}" for b in BUDGETS},
                    "what it measures": e.title,
                }
                for e in experiments().values()
            ]
        )
        print(_text(table))
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
        config = tyro.cli(
            type(default),
            default=default,
            args=list(overrides),
            prog=f"thesis run {self.id}",
            description=f"{experiment.item}: {experiment.title} Fields of the config:",
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
class Sweep:
    """Train a grid of policies, each in a process of its own, and merge their curves.

    Given again, it goes on where it was killed.
    """

    grid: Annotated[sweeps.Grid, tyro.conf.arg(name="", constructor=_unchecked(sweeps.Grid))]
    """Every combination of these."""
    settings: Annotated[
        TrainConfig,
        tyro.conf.arg(name="", constructor=_unchecked(TrainConfig, tuple(sweeps.GRID_COLUMNS))),
    ]
    """Of all runs."""
    workers: int = 1
    """Processes, each on one thread; no result depends on their number."""
    out: Path | None = None
    """Where curves.csv and curves.json go; default _build/results/sweep."""
    runs: Path | None = None
    """Where the runs' own directories are; default _build/runs/ and the last part of --out."""

    def __call__(self, command: str = "thesis sweep") -> int:
        """Train what is missing; ``command`` goes into the record."""
        configs = _checked(sweeps.Grid, self.grid).runs(_checked(TrainConfig, self.settings))
        out = writable_directory(self.out or repository_root() / "_build" / "results" / "sweep")
        runs = self.runs or repository_root() / "_build" / "runs" / out.name
        errors: dict[str, str] = {}

        def report(outcome: sweeps.Outcome, ended: int) -> None:
            name = sweeps.run_name(outcome.config)
            if outcome.error is None:
                row = sweeps.summary(sweeps.merged([outcome.config], runs)).iloc[0]
                news = (
                    f"return {row.first_return:.1f} -> {row.last_return:.1f}, "
                    f"{row.wall_seconds:.0f} s"
                )
            else:
                errors[name] = outcome.error
                news = f"FAILED: {outcome.error}"
            print(f"[{ended}/{len(configs)}] {name}: {news}", flush=True)
            sweeps.write(configs, runs, out, command=command, errors=errors)

        sweeps.sweep(configs, runs, workers=self.workers, report=report)
        print(_text(sweeps.summary(sweeps.merged(configs, runs)), most=500))
        if len(self.grid.precisions) > 1:
            print(_text(pd.read_csv(out / "precision.csv")))
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
        from thesis_lib.claims import judge_all

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


def _text(table: pd.DataFrame, most: int = 60) -> str:
    """A table as text, long ones with their middle left out."""
    shown = table
    note = ""
    if len(table) > most:
        shown = pd.concat([table.head(most // 2), table.tail(most // 2)])
        note = f"\n({len(table) - most} rows in the middle are not shown)"
    return shown.to_string(index=False, float_format=lambda v: f"{v:.5g}") + note


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point of the command ``thesis``; returns the exit status."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    try:
        if arguments[:1] == ["run"] and len(arguments) > 2 and {"-h", "--help"} & set(arguments):
            named = next((a for a in arguments[1:] if not a.startswith("-")), None)
            if named:
                return Run(named)(["--help"])
        command, unknown = tyro.cli(
            List | Run | Sweep | Claims | Book,
            args=arguments,
            prog="thesis",
            description="The living edition of Snel's thesis, on the command line.",
            return_unknown_args=True,
        )
        if isinstance(command, Run):
            return command(unknown)
        if unknown:
            raise ValueError(f"{unknown[0]!r} is not known: see `thesis {arguments[0]} --help`.")
        if isinstance(command, Sweep):
            return command(f"thesis {shlex.join(arguments)}")
        return int(command())
    except (ValueError, FileNotFoundError) as error:
        print(f"thesis: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:
        # The reader of our output, such as `head`, has seen enough.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        print("thesis: interrupted; no file was left half written.", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
