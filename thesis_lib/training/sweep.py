r"""Train a grid of policies side by side, and merge their learning curves.

Every run is a process of its own with a directory of its own, so that a run that fails
leaves the others alone, and a sweep that was killed goes on where its runs left off.
"""

from __future__ import annotations

import multiprocessing
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from thesis_lib.files import writable_directory
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.curves import progress
from thesis_lib.training.grid import cost, first_repeated, run_name
from thesis_lib.training.run import TrainingStopped
from thesis_lib.training.train import train, use_one_thread


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
        raise ValueError(f"two runs of the sweep are called {first_repeated(names)!r}.")
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
