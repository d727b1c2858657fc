"""The commands of ``thesis`` that train, test and export policies, imported late."""

from __future__ import annotations

import difflib
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import pandas as pd
import tyro

from thesis_lib.checkout import repository_root
from thesis_lib.checks import one_of
from thesis_lib.cli_parts import checked, status, text, unchecked
from thesis_lib.edition.words import several
from thesis_lib.files import replacing, writable_directory
from thesis_lib.locomotion.rendering import check_gl
from thesis_lib.policies.portable import dumps, to_onnx
from thesis_lib.training import curves
from thesis_lib.training.checkpoint import read_checkpoint
from thesis_lib.training.config import TrainConfig, idle_settings, is_robot, task_name
from thesis_lib.training.disturbances import Disturbances
from thesis_lib.training.evaluation import (
    EvaluateConfig,
    evaluate,
    no_robot,
    summarised,
    write,
)
from thesis_lib.training.evaluation import idle_settings as idle_in_test
from thesis_lib.training.film import check_film, film
from thesis_lib.training.grid import GRID, GRID_COLUMNS, Grid, key, run_name
from thesis_lib.training.merge import merge
from thesis_lib.training.plan import CORES, cost, makespan, memory, not_measured, plan
from thesis_lib.training.store import Store
from thesis_lib.training.suite import RULES, SuiteConfig, best, check_kept, evaluate_all
from thesis_lib.training.suite import write as write_tests
from thesis_lib.training.train import TerminalReport, default_directory, train
from thesis_lib.training.trained import Trained, TrainedPolicies, read_trained

NEAR = 5
"""Names of runs that are told when one is missing: a sweep may have hundreds."""


def _refuse(idle: Mapping[str, str]) -> None:
    """Raise ValueError for settings that have no effect, with what they would need."""
    for setting, owners in idle.items():
        raise ValueError(
            f"--{setting.replace('_', '-')} has no effect here, only with "
            f"{owners.replace('_', '-')}: leave it out."
        )


@dataclass(frozen=True)
class Train:
    """``thesis train``."""

    settings: Annotated[TrainConfig, tyro.conf.arg(name="", constructor=unchecked(TrainConfig))]
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
        config = checked(TrainConfig, self.settings)
        _refuse(idle_settings(config))
        folder = writable_directory(self.out or default_directory(config))
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
            if not (folder / "checkpoint.pt").exists():
                raise
            good = read_checkpoint(folder)["iteration"]
            print(
                f"\nthesis: interrupted; the last checkpoint, of iteration {good}, is in {folder}: "
                "give the same command again to go on from it.",
                file=sys.stderr,
            )
            return status(stop)
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


def _read(checkpoint: Path, run: str | None) -> Trained:
    """The policy of a run's checkpoint, or of one of the runs in a sweep's ``policies.pt``.

    Raises
    ------
    ValueError
        With a few names where a sweep's file is given without the name of a run of it.
    """
    if run is None:
        try:
            names = TrainedPolicies(checkpoint).names
        except (OSError, ValueError):  # no sweep's
            return read_trained(checkpoint)
        raise ValueError(
            f"{str(checkpoint)!r} holds the policies of a sweep, {len(names)} of them, such as "
            f"{several(names[:NEAR])}: name one of them (--run)."
        )
    policies = TrainedPolicies(checkpoint)
    if run not in policies.names:
        near = difflib.get_close_matches(run, policies.names, NEAR, 0.4) or policies.names[:NEAR]
        raise ValueError(
            f"run {run!r} is not in {str(checkpoint)!r}, which has {len(policies.names)}: did you "
            f"mean {' or '.join(near)}?"
        )
    return policies.load(run)


def _told(trained: Trained) -> str:
    """A policy in words."""
    run = trained.config
    ground = f"on {run.terrain} ground " if is_robot(run.task) else ""
    return f"{run.architecture} on {run.task}, trained {ground}for {trained.iteration} iterations"


@dataclass(frozen=True)
class Evaluate:
    """``thesis evaluate``."""

    checkpoint: tyro.conf.Positional[Path]
    """A checkpoint of ``thesis train``, the directory it is in, or ``policies.pt`` of a sweep."""
    settings: Annotated[
        EvaluateConfig, tyro.conf.arg(name="", constructor=unchecked(EvaluateConfig))
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
    """Draw a run into this film: .mp4 or .webm, or an animated .webp, .gif or .png."""
    film_run: int = 0
    """Which run to draw."""

    def __call__(self, command: str = "thesis evaluate") -> int:
        """Test it; ``command`` goes into the record."""
        config = checked(EvaluateConfig, self.settings)
        _refuse(idle_in_test(config, self.disturbances))
        if self.film is None and self.film_run != 0:
            _refuse({"film_run": "film"})
        config = config.disturbed(self.disturbances)
        trained = _read(self.checkpoint, self.run)
        self._check(trained.config)
        if self.out is not None:
            writable_directory(self.out)
        if self.film is not None:
            if not is_robot(trained.config.task):
                raise no_robot(trained.config.task, "film")
            check_film(self.film, config, self.film_run)
            check_gl()
        table = evaluate(trained, config)
        print(_told(trained))
        for perturbation in config.perturbations:
            print(f"  {perturbation}")
        print(text(table))
        print(text(summarised(table)))
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
class Export:
    """``thesis export``."""

    checkpoint: tyro.conf.Positional[Path]
    """A checkpoint of ``thesis train``, the directory it is in, or ``policies.pt`` of a sweep."""
    out: tyro.conf.Positional[Path]
    """Where to: .npz (weights and a JSON card that says what they are) or .onnx (one step of the
    policy, for onnxruntime)."""
    run: str | None = None
    """Which run of a sweep's ``policies.pt``, such as hopper-flat-gru-0-float32."""

    def __call__(self) -> int:
        """Write it."""
        forms = {".npz": dumps, ".onnx": to_onnx}
        if self.out.suffix not in forms:
            raise ValueError(
                f"a policy cannot be written as {self.out.name!r}: choose {' or '.join(forms)}."
            )
        writable_directory(self.out.parent)
        trained = _read(self.checkpoint, self.run)
        try:
            data = forms[self.out.suffix](trained.policy)
        except ImportError as error:
            raise ValueError(str(error)) from error
        with replacing(self.out) as temporary:
            temporary.write_bytes(data)
        print(f"{_told(trained)}: {self.out}, {len(data):,} bytes.")
        return 0


@dataclass(frozen=True)
class TestPolicies:
    """``thesis test-policies``."""

    __test__ = False  # pytest: it is no test

    store: tyro.conf.Positional[str]
    """Directory (or fsspec URL) of a sweep's runs, or its policies.pt."""
    settings: Annotated[SuiteConfig, tyro.conf.arg(name="", constructor=unchecked(SuiteConfig))]
    """Of the tests."""
    names: tuple[str, ...] = ()
    """Policies to test, or patterns such as "hopper-*-gru-*"; default all."""
    rule: str = "seed"
    """Which policies the printed table counts: seed (that whose training ended best) or all."""
    workers: int | None = None
    """Processes of this machine, each on one thread; default one a core."""
    scheduler: str | None = None
    """Hand the policies to the workers of this Dask scheduler, such as tcp://head:8786."""
    out: Path | None = None
    """Where tests.parquet and tests.json go; default _build/results/tests."""

    def __call__(self, command: str = "thesis test-policies") -> int:
        """Test them; ``command`` goes into the record."""
        config = checked(SuiteConfig, self.settings)
        one_of("rule", self.rule, RULES)
        out = writable_directory(self.out or repository_root() / "_build" / "results" / "tests")
        names = self.names or None
        if names is not None:
            check_kept(self.store, names, out)
        table = evaluate_all(
            self.store, config, names=names, workers=self.workers, scheduler=self.scheduler
        )
        path = write_tests(table, self.store, config, out, command=command)
        print(text(best(table, self.rule)))
        print(f"{len(table)} runs of {table.run.nunique()} policies, written to {path}")
        return 0


@dataclass(frozen=True)
class Sweep:
    """``thesis sweep``."""

    grid: Annotated[Grid, tyro.conf.arg(name="", constructor=unchecked(Grid))]
    """Every combination of these."""
    settings: Annotated[
        TrainConfig,
        tyro.conf.arg(name="", constructor=unchecked(TrainConfig, GRID)),
    ]
    """Of all runs."""
    workers: int | None = None
    """Processes of this machine (or SLURM jobs), each on one thread; default one a core.  No
    result depends on their number."""
    scheduler: str | None = None
    """Hand the runs to the workers of this Dask scheduler, such as tcp://head:8786, or to jobs of
    SLURM (slurm); --runs-in must be a place they all see."""
    out: Path | None = None
    """Where curves.csv, curves.json and policies.pt go; default _build/results/sweep."""
    runs_in: str | None = None
    """Where the runs' own directories are, a path or a URL that fsspec knows; default _build/runs/
    and the last part of --out."""
    any_version: bool = False
    """Go on with runs even where other code or other versions of the libraries made them."""
    plan: bool = False
    """Print what is left to do and what it will take, and train nothing."""

    def __call__(self, command: str = "thesis sweep") -> int:
        """Train what is missing; ``command`` goes into the record."""
        from thesis_lib.training.sweep import Outcome, sweep

        configs = checked(Grid, self.grid).runs(checked(TrainConfig, self.settings))
        idle = [idle_settings(c) for c in configs]
        _refuse({name: by for name, by in idle[0].items() if all(name in i for i in idle)})
        out = self.out or repository_root() / "_build" / "results" / "sweep"
        store = Store(self.runs_in or repository_root() / "_build" / "runs" / out.name)
        runs = store.folder
        if self.plan:
            return self._plan(configs, store)
        if lost := curves.only_in(out, store.names()):
            raise ValueError(
                f"{str(out)!r} holds finished runs that {store.place!r} has not, such as "
                f"{lost[0]}, and would lose {len(lost)} of them: choose another --out, and bring "
                "the two together with `thesis merge`."
            )
        writable_directory(out)
        errors: dict[str, str] = {}
        written, took = 0.0, 0.0

        def report(outcome: Outcome, ended: int) -> None:
            nonlocal written, took
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
            # Tables of many runs take a while, so not after every run.
            start = time.monotonic()
            if ended == len(configs) or start - written > 20 * took:
                curves.write(configs, runs, out, command=command, errors=errors)
                written = time.monotonic()
                took = written - start

        try:
            sweep(
                configs,
                store.place,
                workers=self.workers,
                scheduler=self.scheduler,
                any_version=self.any_version,
                report=report,
            )
        except KeyboardInterrupt as stop:
            print(
                f"\nthesis: interrupted; the runs are kept in {store.place}: give the same command "
                "again to go on from their last checkpoints.",
                file=sys.stderr,
            )
            return status(stop)
        table = curves.summary(curves.merged(configs, runs))
        same = [c for c in GRID_COLUMNS if c != "task" and table[c].nunique() == 1]
        print(text(table.drop(columns=same), most=len(table)))
        for column, name in curves.COMPARISONS.items():
            if len({key(c)[column] for c in configs}) > 1:
                print(text(pd.read_csv(out / name)))
        print(f"{len(configs) - len(errors)} of {len(configs)} runs, written to {out}")
        return 1 if errors else 0

    def _plan(self, configs: Sequence[TrainConfig], store: Store) -> int:
        """Print runs, processor hours and memory, times on so many cores, and SLURM's script."""
        from thesis_lib.training.cluster import SLURM, slurm_cluster
        from thesis_lib.training.sweep import in_order

        for config in configs:
            store.pull(run_name(config))
        left = [c for c in in_order(configs) if curves.progress(c, store.folder) < c.iterations]
        print(f"{len(configs) - len(left)} of {len(configs)} runs are done.")
        if not left:
            return 0
        table = plan(left)
        print(text(table))
        print(f"{len(left)} runs, about {table.core_hours.sum():.1f} processor hours:")
        if guessed := not_measured(left):
            print(f"  (a guess: {', '.join(guessed)} counts as the median of what was measured)")
        seconds = [cost(c) for c in left]
        for cores in CORES:
            hours = makespan(seconds, cores) / 3600
            gigabytes = sum(sorted(map(memory, left))[-cores:])
            print(
                f"  on {cores} cores {hours:.1f} hours, with at most {gigabytes:.0f} GB of memory"
            )
        if self.scheduler == SLURM:
            with slurm_cluster(0, max(map(memory, left))) as cluster:
                print(cluster.job_script())
        return 0


@dataclass(frozen=True)
class Merge:
    """``thesis merge``."""

    sweeps: tyro.conf.Positional[tuple[Path, ...]]
    """What ``thesis sweep`` wrote to (its --out); a run in several is taken from the first."""
    out: Path
    """Where the files go; may be one of these."""

    def __call__(self, command: str = "thesis merge") -> int:
        """Merge them; ``command`` goes into the record."""
        if not self.sweeps:
            raise ValueError("merge was given no sweep: name what `thesis sweep` wrote to (--out).")
        table = merge(self.sweeps, self.out, command=command)
        runs = len(table.groupby(list(GRID_COLUMNS)))
        print(f"{runs} finished runs of {len(self.sweeps)} sweeps, written to {self.out}")
        return 0


COMMANDS = {
    "train": Train,
    "evaluate": Evaluate,
    "export": Export,
    "test-policies": TestPolicies,
    "sweep": Sweep,
    "merge": Merge,
}
