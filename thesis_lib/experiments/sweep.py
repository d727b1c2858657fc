r"""Train a grid of policies side by side, and merge their learning curves.

Every run is a process of its own with a directory of its own, so that a run that fails
leaves the others alone, and a sweep that was killed goes on where its runs left off.
"""

from __future__ import annotations

import ast
import dataclasses
import itertools
import json
import multiprocessing
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from thesis_lib.edition.experiment import environment, replacing, writable_directory
from thesis_lib.experiments.trained import write_policies
from thesis_lib.experiments.training import (
    CURVE_COLUMNS,
    TASK_NAMES,
    TrainConfig,
    TrainingStopped,
    differences,
    idle_settings,
    train,
    use_one_thread,
)
from thesis_lib.policies import ARCHITECTURES
from thesis_lib.stats import holm, mean_ci

LAST = 5
"""Iterations whose mean return says how well a net did at the end."""

MARGIN = 0.1
"""Difference of two mean returns, as a share of the second, that counts as none."""

GRID = ("task", "terrain", "architecture", "seed", "precision")
"""Settings a sweep has a list of."""

BUDGET = ("iterations", "batch_steps", "horizon", "worlds", "threads", "checkpoint_every")
"""Settings all runs of a sweep share."""

DEFAULT = "default"
"""The variant that leaves all other settings as they are."""

GRID_COLUMNS: Mapping[str, str] = {
    "task": "robot",
    "terrain": "flat or hill",
    "architecture": "net",
    "seed": "seed of the run",
    "precision": "number type of the net",
    "variant": "settings that differ from those of `thesis train`",
}
"""Columns that tell the runs of a sweep apart."""

CURVES_COLUMNS: Mapping[str, str] = {
    **GRID_COLUMNS,
    **{
        name: CURVE_COLUMNS[name]
        for name in (
            "iteration",
            "steps",
            "mean_return",
            "std_return",
            "episodes",
            "mean_length",
            "kl",
            "entropy",
            "accepted",
            "backtracks",
            "sampling_seconds",
            "update_seconds",
            "wall_seconds",
        )
    },
}
"""Meaning and unit of each column of the merged curves, one row an iteration of a run."""

SUMMARY_COLUMNS: Mapping[str, str] = {
    **GRID_COLUMNS,
    "iterations": "iterations done",
    "steps": "control steps learned from",
    "first_return": "mean return of the first batch, that of the untrained policy",
    "last_return": f"mean return of the last {LAST} batches",
    "best_return": "mean return of the best batch",
    "average_return": "mean return over all iterations, the measure of table 5.2",
    "rejected": "updates the line search rejected",
    "steps_per_second": "control steps learned from in a second of processor time",
    "wall_seconds": "wall-clock seconds of all iterations",
}
"""Meaning and unit of each column of :func:`summary`, one row a run."""


@dataclass(frozen=True)
class Grid:
    """The runs of a sweep: every combination of these."""

    tasks: tuple[str, ...] = tuple(dict.fromkeys(TASK_NAMES.values()))
    """Swimmer, Hopper, HalfCheetah, Walker2d, Ant."""
    terrains: tuple[str, ...] = ("flat",)
    """flat, hill."""
    architectures: tuple[str, ...] = tuple(ARCHITECTURES)
    """ffwd, dffwd, dtrnn, ctrnn, gru, lstm, esn, dffwd-softplus, ffwd-400."""
    seeds: tuple[int, ...] = (0,)
    """Seeds."""
    precisions: tuple[str, ...] = ("float32",)
    """float32, float64."""
    variants: tuple[str, ...] = ()
    """Settings to try besides the default, such as "bootstrap=True" or "trace=0.97,damping=0.1";
    nets on which they have no effect are left out."""

    def __post_init__(self) -> None:
        for f in dataclasses.fields(self):
            values = getattr(self, f.name)
            if not values and f.name != "variants":
                raise ValueError(f"{f.name} is empty, but a sweep needs at least one of them.")
            if len(set(values)) != len(values):
                raise ValueError(f"{f.name} names {_first_repeated(values)!r} twice.")

    def runs(self, base: TrainConfig | None = None) -> list[TrainConfig]:
        """The runs, tasks outermost.

        Parameters
        ----------
        base
            All other settings.

        Raises
        ------
        ValueError
            When a value does not exist.
        """
        base = base or TrainConfig()
        variants = [{}, *map(parse_variant, self.variants)]
        found = []
        for task, terrain, net, variant, seed, precision in itertools.product(
            self.tasks, self.terrains, self.architectures, variants, self.seeds, self.precisions
        ):
            config = dataclasses.replace(
                base, task=task, terrain=terrain, architecture=net, seed=seed, precision=precision
            )
            changed = dataclasses.replace(config, **variant)
            if not set(variant) & set(idle_settings(changed)):
                found.append(changed)
        return found


def parse_variant(text: str) -> dict[str, Any]:
    """Read settings from text such as ``"trace=0.97,damping=0.1"``.

    Raises
    ------
    ValueError
        When a setting does not exist, or is not for variants.
    """
    allowed = [f.name for f in dataclasses.fields(TrainConfig) if f.name not in (*GRID, *BUDGET)]
    found: dict[str, Any] = {}
    for part in text.split(","):
        name, equals, value = (p.strip() for p in part.partition("="))
        if not equals or name not in allowed:
            raise ValueError(
                f"variant {text!r} does not name a setting and its value: write for instance "
                f"bootstrap=True; the settings are {', '.join(allowed)}."
            )
        try:
            found[name] = ast.literal_eval(value)
        except (SyntaxError, ValueError):
            found[name] = value
    return found


def variant(config: TrainConfig) -> str:
    """Settings of a run that differ from the defaults and have an effect, as text."""
    default, idle = TrainConfig(), idle_settings(config)
    parts = [
        f"{f.name}={getattr(config, f.name)}"
        for f in dataclasses.fields(config)
        if f.name not in (*GRID, *BUDGET)
        and f.name not in idle
        and getattr(config, f.name) != getattr(default, f.name)
    ]
    return ", ".join(parts) or DEFAULT


def key(config: TrainConfig) -> dict[str, Any]:
    """What tells a run apart, by :data:`GRID_COLUMNS`."""
    return {name: getattr(config, name) for name in GRID} | {"variant": variant(config)}


def _first_repeated(values: Sequence[Any]) -> Any:
    return next(v for i, v in enumerate(values) if v in values[:i])


def run_name(config: TrainConfig) -> str:
    """Name of a run within its sweep, such as ``hopper-flat-gru-0-float32``."""
    parts = [str(part) for part in key(config).values()]
    if parts[-1] == DEFAULT:
        parts.pop()
    return "-".join(parts).lower().replace(", ", "-").replace("=", "-")


@dataclass(frozen=True)
class Outcome:
    """How a run of a sweep ended.

    Attributes
    ----------
    config
        The run.
    error
        What stopped it, None when it finished.
    """

    config: TrainConfig
    error: str | None = None


# ------------------------------------------------------------------------------------ planning
STEP_COST: Mapping[tuple[str, str], float] = {
    ("Swimmer", "flat"): 40.0,
    ("Swimmer", "hill"): 240.0,
    ("Hopper", "flat"): 35.0,
    ("Hopper", "hill"): 52.0,
    ("HalfCheetah", "flat"): 19.0,
    ("HalfCheetah", "hill"): 23.0,
    ("Walker2d", "flat"): 26.0,
    ("Walker2d", "hill"): 30.0,
    ("Ant", "flat"): 78.0,
    ("Ant", "hill"): 89.0,
}
"""Processor microseconds a control step takes, about, learning from it included; median over the
nets of section 5.2 but Ant's ESN, measured in batches of 50,000."""

ANT_ESN_COST = 570.0
"""The same for the ESN on the Ant, whose reservoir has 3,256 units."""


def cost(config: TrainConfig) -> float:
    """About how many processor seconds a run takes from its first iteration to its last."""
    micro = STEP_COST[config.task, config.terrain]
    if config.task == "Ant" and config.architecture == "esn":
        micro = ANT_ESN_COST
    return config.iterations * config.batch_steps * micro * 1e-6


# ------------------------------------------------------------------------------------ running
@dataclass
class _Active:
    """A run that is being trained in a process of its own."""

    config: TrainConfig
    process: BaseProcess
    iteration: int = 0
    error: str | None = None


def sweep(
    configs: Sequence[TrainConfig],
    runs: Path | str,
    *,
    workers: int = 1,
    any_version: bool = False,
    report: Callable[[Outcome, int], None] | None = None,
) -> list[Outcome]:
    """Bring every run to its last iteration; a run that fails leaves the others alone.

    Parameters
    ----------
    configs
        The runs.
    runs
        Directory in which each has its own, named by :func:`run_name`.
    workers
        Processes at a time, each on one thread; no result depends on their number.
    any_version
        Whether to go on with runs that other code or other versions made.
    report
        Called with each run that ends and the number of those that have.

    Returns
    -------
    list of Outcome
        In the order of the configs.

    Raises
    ------
    ValueError
        When there are no workers or two runs have the same name.
    """
    if workers < 1:
        raise ValueError(f"workers is {workers}, but at least 1 worker is needed.")
    names = [run_name(c) for c in configs]
    if len(set(names)) < len(names):
        raise ValueError(f"two runs of the sweep are called {_first_repeated(names)!r}.")
    folder = writable_directory(runs)
    outcomes: dict[str, Outcome] = {}
    line = _Line(len(configs))
    for outcome in _outcomes(configs, folder, workers, any_version, line):
        outcomes[run_name(outcome.config)] = outcome
        line.clear()
        if report is not None:
            report(outcome, len(outcomes))
    return [outcomes[name] for name in names]


def _outcomes(
    configs: Sequence[TrainConfig],
    folder: Path,
    workers: int,
    any_version: bool,
    line: _Line,
) -> Iterator[Outcome]:
    """Outcomes in the order in which the runs end."""
    # Not forked: a fork of a process whose libraries have threads may hang.
    spawn = multiprocessing.get_context("spawn")
    waiting = []
    for config in configs:
        if progress(config, folder) == config.iterations:
            line.done += 1
            yield Outcome(config)
        else:
            waiting.append(config)
    # A long run that starts last would be waited for by idle workers; seeds come first, so that at
    # any moment the grid is whole for as many seeds as can be.
    waiting.sort(key=lambda config: (config.seed, -cost(config)))
    active: dict[Connection, _Active] = {}
    try:
        while waiting or active:
            while waiting and len(active) < workers:
                config = waiting.pop(0)
                ours, theirs = spawn.Pipe(duplex=False)
                path = folder / run_name(config)
                process = spawn.Process(target=_work, args=(config, path, any_version, theirs))
                process.start()
                theirs.close()
                active[ours] = _Active(config, process, progress(config, folder))
            ready: list[Any] = wait(list(active))
            for channel in ready:
                run = active[channel]
                try:
                    message = channel.recv()
                except EOFError:
                    del active[channel]
                    run.process.join()
                    line.done += 1
                    yield Outcome(run.config, _cause(run))
                    continue
                if isinstance(message, str):
                    run.error = message
                else:
                    run.iteration = message
                    line.trained += 1
                line.show(list(active.values()), waiting)
    finally:
        for run in active.values():
            run.process.terminate()
        for run in active.values():
            run.process.join()


def _cause(run: _Active) -> str | None:
    """What stopped a run whose process has ended."""
    code = run.process.exitcode
    if run.error is not None or code == 0:
        return run.error
    if code is not None and code < 0:
        return (
            f"its process was ended by {signal.Signals(-code).name} after iteration "
            f"{run.iteration}; give the same command again to go on from its last checkpoint."
        )
    return f"its process ended with status {code}."


def _work(config: TrainConfig, folder: Path, any_version: bool, channel: Connection) -> None:
    """Train one run and tell the parent of every iteration, or of what stopped it."""
    # Ctrl-C reaches the whole group; the parent ends its children in good order.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    use_one_thread()
    try:
        # Without a parent to listen, send fails and the run ends with it.
        train(
            config,
            folder,
            any_version=any_version,
            report=lambda run: channel.send(run.iteration),
        )
    except (TrainingStopped, ValueError) as error:
        channel.send(str(error))
    except BrokenPipeError:
        sys.exit(1)
    except Exception as error:  # a fault of ours: the sweep goes on, and the place is shown
        traceback.print_exc()
        channel.send(f"{type(error).__name__}: {error}")


@dataclass
class _Line:
    """One line of progress, overwritten, on a terminal and nowhere else."""

    total: int
    done: int = 0
    trained: int = 0
    start: float = field(default_factory=time.perf_counter)
    shown: bool = field(default_factory=lambda: sys.stderr.isatty())

    def show(self, active: Sequence[_Active], waiting: Sequence[TrainConfig]) -> None:
        if not self.shown or self.trained == 0:
            return
        left = sum(a.config.iterations - a.iteration for a in active)
        left += sum(c.iterations for c in waiting)
        seconds = left * (time.perf_counter() - self.start) / self.trained
        hours, minutes = divmod(round(seconds / 60), 60)
        now = ", ".join(f"{run_name(a.config)} {a.iteration}/{a.config.iterations}" for a in active)
        text = f"{self.done}/{self.total} runs, about {hours} h {minutes:02d} min left; {now}"
        print(f"\r{text[:119]:<119}", end="", file=sys.stderr, flush=True)

    def clear(self) -> None:
        if self.shown:
            print(f"\r{'':<119}\r", end="", file=sys.stderr, flush=True)


# ------------------------------------------------------------------------------------ merging
def progress(config: TrainConfig, runs: Path | str) -> int:
    """Iterations a run has kept on the disk, 0 when its directory has none of this run."""
    record = _record(config, runs)
    return 0 if record is None else int(record["iteration"])


def _record(config: TrainConfig, runs: Path | str) -> dict[str, Any] | None:
    file = Path(runs) / run_name(config) / "run.json"
    if not file.exists():
        return None
    record: dict[str, Any] = json.loads(file.read_text())
    return None if differences(record, config) else record


def merged(configs: Sequence[TrainConfig], runs: Path | str) -> pd.DataFrame:
    """Learning curves of all runs, as far as each has come.

    Returns
    -------
    pandas.DataFrame
        Columns as in :data:`CURVES_COLUMNS`, one row an iteration of a run.
    """
    parts = []
    for config in configs:
        if _record(config, runs) is not None:
            curve = pd.read_csv(Path(runs) / run_name(config) / "curve.csv")
            parts.append(curve.assign(**key(config)))
    columns = list(CURVES_COLUMNS)
    parts = [p for p in parts if len(p)]
    return pd.concat(parts, ignore_index=True)[columns] if parts else pd.DataFrame(columns=columns)


def summary(curves: pd.DataFrame, last: int = LAST) -> pd.DataFrame:
    """What each run came to.

    Parameters
    ----------
    curves
        From :func:`merged`.
    last
        Batches whose mean return says how well a net did at the end.

    Returns
    -------
    pandas.DataFrame
        Columns as in :data:`SUMMARY_COLUMNS`, one row a run.
    """
    records = []
    for run, curve in curves.groupby(list(GRID_COLUMNS), sort=False):
        returns, steps = curve.mean_return, int(curve.steps.iloc[-1])
        seconds = curve.sampling_seconds.sum() + curve.update_seconds.sum()
        records.append(
            {
                **dict(zip(GRID_COLUMNS, run, strict=True)),
                "iterations": len(curve),
                "steps": steps,
                "first_return": returns.iloc[0],
                "last_return": returns.tail(last).mean(),
                "best_return": returns.max(),
                "average_return": returns.mean(),
                "rejected": int((~curve.accepted.astype(bool)).sum()),
                "steps_per_second": steps / seconds,
                "wall_seconds": curve.wall_seconds.sum(),
            }
        )
    return pd.DataFrame(records, columns=list(SUMMARY_COLUMNS))


PAIRED_COLUMNS: Mapping[str, str] = {
    **{name: GRID_COLUMNS[name] for name in ("task", "terrain", "architecture")},
    "changed": "what is compared: a number type or a variant",
    "reference": "what it is compared with",
    "n": "seeds that both have finished",
    "mean_changed": "return averaged over the curve, mean over seeds",
    "mean_reference": "the same for the reference",
    "difference": "mean over seeds of the difference with the same seed",
    "low": "lower end of the 95% Student interval of the difference",
    "high": "upper end",
    "p_difference": "paired t-test that the difference is 0",
    "p_holm": "the same, adjusted by Holm for all rows of the table",
    "p_equivalence": (
        f"two one-sided paired t-tests that it is within {MARGIN:.0%} of the reference"
    ),
}
"""Meaning and unit of each column of :func:`compared`."""


COMPARISONS: Mapping[str, str] = {"precision": "precision.csv", "variant": "variants.csv"}
"""Files that :func:`write` makes for what it compares."""


def compared(curves: pd.DataFrame, column: str) -> pd.DataFrame:
    """Paired tests of the return over the curve: what a number type or a variant changes.

    Parameters
    ----------
    curves
        From :func:`merged`.
    column
        ``precision`` (float32 against float64) or ``variant`` (each against the first).

    Returns
    -------
    pandas.DataFrame
        Columns as in :data:`PAIRED_COLUMNS`, one row for each net, task, terrain and
        change that has at least 2 seeds on both sides.
    """
    runs = summary(curves)
    rest = [c for c in GRID_COLUMNS if c not in (column, "seed")]
    records = []
    for _, group in runs.groupby(rest, sort=False):
        # Only curves of the same length can be averaged over and compared.
        longest = group[group.iterations == group.iterations.max()]
        values = list(dict.fromkeys(longest[column]))
        reference = "float64" if column == "precision" else values[0]
        table = longest.pivot(index="seed", columns=column, values="average_return")
        for changed in (v for v in values if v != reference):
            if reference not in table:
                continue
            pairs = table[[changed, reference]].dropna()
            if len(pairs) < 2:
                continue
            names = {c: group[c].iloc[0] for c in ("task", "terrain", "architecture")}
            names |= {"changed": changed, "reference": reference}
            records.append(names | _paired(pairs[changed], pairs[reference]))
    found = pd.DataFrame(records, columns=list(PAIRED_COLUMNS))
    return found.assign(p_holm=holm(found.p_difference) if len(found) else [])


def _paired(changed: pd.Series, reference: pd.Series) -> dict[str, float]:
    """Statistics of two samples with the same seeds."""
    difference = (changed - reference).to_numpy()
    interval = mean_ci(difference)
    margin = MARGIN * abs(float(reference.mean()))
    return {
        "n": len(difference),
        "mean_changed": changed.mean(),
        "mean_reference": reference.mean(),
        "difference": interval.mean,
        "low": interval.mean - interval.half_width,
        "high": interval.mean + interval.half_width,
        "p_difference": _one_sample(difference, 0.0, "two-sided"),
        "p_equivalence": max(
            _one_sample(difference, -margin, "greater"),
            _one_sample(difference, margin, "less"),
        ),
    }


def _one_sample(values: np.ndarray, centre: float, alternative: str) -> float:
    """p-value of the t-test that the mean of the values is ``centre``."""
    if np.ptp(values) == 0:  # the test divides by the deviation
        gap = values[0] - centre
        agrees = {"two-sided": gap == 0, "greater": gap <= 0, "less": gap >= 0}
        return float(agrees[alternative])
    return float(stats.ttest_1samp(values, centre, alternative=alternative).pvalue)


def write(
    configs: Sequence[TrainConfig],
    runs: Path | str,
    out: Path | str,
    *,
    command: str,
    errors: Mapping[str, str] | None = None,
) -> pd.DataFrame:
    """Merge the runs and write ``curves.csv`` with its provenance ``curves.json``.

    With both number types ``precision.csv`` is written too, with variants ``variants.csv``,
    and always ``policies.pt``, the policies as they are now (see
    :class:`~thesis_lib.experiments.trained.TrainedPolicies`).

    Parameters
    ----------
    configs
        The runs.
    runs
        Directory they are in.
    out
        Directory to write to.
    command
        What made them.
    errors
        What stopped runs, by :func:`run_name`.

    Returns
    -------
    pandas.DataFrame
        The merged curves.
    """
    folder = writable_directory(out)
    curves = merged(configs, runs)
    begun = [(run_name(c), Path(runs) / run_name(c)) for c in configs]
    begun = [(name, run) for name, run in begun if (run / "checkpoint.pt").exists()]
    left_out = write_policies(begun, folder / "policies.pt")
    record: dict[str, Any] = {
        "id": "curves",
        "title": "Learning curves of a sweep.",
        "command": command,
        "config": _shared(configs),
        "grid": {n: sorted({key(c)[n] for c in configs}) for n in GRID_COLUMNS},
        "wall_seconds": round(float(curves.wall_seconds.sum()), 1),
        "processor_seconds": round(
            float(curves.sampling_seconds.sum() + curves.update_seconds.sum()), 1
        ),
        "runs": [_run_record(c, runs, left_out | dict(errors or {})) for c in configs],
        "rows": len(curves),
        "columns": dict(CURVES_COLUMNS),
        "written": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        **environment(),
        "table": "curves.csv",
    }
    with replacing(folder / "curves.csv") as temporary:
        curves.to_csv(temporary, index=False, float_format="%.6g")
    for column, name in COMPARISONS.items():
        if len({key(c)[column] for c in configs}) > 1:
            record["compared_columns"] = dict(PAIRED_COLUMNS)
            with replacing(folder / name) as temporary:
                compared(curves, column).to_csv(temporary, index=False, float_format="%.6g")
    with replacing(folder / "curves.json") as temporary:
        temporary.write_text(json.dumps(record, indent=1) + "\n")
    return curves


def _shared(configs: Sequence[TrainConfig]) -> dict[str, Any]:
    """Settings all runs of the sweep have."""
    settings = [dataclasses.asdict(c) for c in configs]
    return {
        name: value
        for name, value in settings[0].items()
        if name not in GRID and all(s[name] == value for s in settings)
    }


def _run_record(config: TrainConfig, runs: Path | str, errors: Mapping[str, str]) -> dict[str, Any]:
    name = run_name(config)
    found = _record(config, runs) or {"iteration": 0}
    kept: dict[str, Any] = {"run": name}
    kept |= {k: found[k] for k in ("iteration", "delta_kl", "parameters", "commit") if k in found}
    if name in errors:
        kept["error"] = errors[name]
    return kept
