r"""Train a grid of policies side by side, on one machine or many.

Dask hands the runs out: to processes of this machine, a core each, or to the workers of any
scheduler.  Every run has a directory of its own, so that a run that fails leaves the others
alone, and a sweep that was killed, or whose workers or scheduler were, goes on where its runs
left off.
"""

from __future__ import annotations

import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from dask.base import tokenize
from distributed import Client, Future, Status, as_completed, get_worker
from distributed.scheduler import KilledWorker
from distributed.worker import thread_state

from thesis_lib.training.cluster import SchedulerLost, connected
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.curves import progress
from thesis_lib.training.grid import first_repeated, run_name
from thesis_lib.training.plan import cost, memory
from thesis_lib.training.run import Training, TrainingStopped
from thesis_lib.training.store import Store
from thesis_lib.training.train import train

PATIENCE = 600.0
"""Seconds a run waits for a process that is still in its directory, such as one that has not yet
noticed that its scheduler is gone."""

_TOPIC = "thesis-sweep"


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


def sweep(
    configs: Sequence[TrainConfig],
    runs: Path | str,
    *,
    workers: int | None = None,
    scheduler: str | Client | None = None,
    any_version: bool = False,
    report: Callable[[Outcome, int], None] | None = None,
) -> list[Outcome]:
    """Bring every run to its last iteration; a run that fails leaves the others alone.

    Parameters
    ----------
    configs
        The runs.
    runs
        Directory or URL (:class:`~thesis_lib.training.store.Store`) in which each has its own
        directory, named by :func:`run_name`.
    workers
        Processes of this machine, or SLURM jobs, each on one thread; default one a core.  No
        result depends on their number.
    scheduler
        Address of a Dask scheduler whose workers train instead, such as ``tcp://head:8786``;
        ``slurm``; or a client.  All must see the same directory or URL.
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
        When there are no workers, no scheduler, or two runs of the same name.
    SchedulerLost
        When the scheduler ends before the runs do.
    """
    names = [run_name(c) for c in configs]
    if len(set(names)) < len(names):
        raise ValueError(f"two runs of the sweep are called {first_repeated(names)!r}.")
    store = Store(runs)
    outcomes: dict[str, Outcome] = {}

    def ended(outcome: Outcome) -> None:
        outcomes[run_name(outcome.config)] = outcome
        line.ended(outcome)
        if report is not None:
            report(outcome, len(outcomes))

    for name in names:
        store.pull(name)
    begun = {name: progress(c, store.folder) for name, c in zip(names, configs, strict=True)}
    line = _Line(configs, begun)
    waiting = []
    for config in configs:
        if begun[run_name(config)] == config.iterations:
            ended(Outcome(config))
        else:
            waiting.append(config)
    if waiting:
        gigabytes = max(map(memory, waiting))
        try:
            with connected(len(waiting), workers, scheduler, gigabytes) as client:
                for outcome in _outcomes(client, in_order(waiting), store, any_version, line):
                    store.pull(run_name(outcome.config))
                    ended(outcome)
        except SchedulerLost as error:
            raise SchedulerLost(
                f"the scheduler ended; the runs are kept in {store.place}: give the same "
                "command again to go on from their last checkpoints."
            ) from error
    return [outcomes[name] for name in names]


def in_order(configs: Sequence[TrainConfig]) -> list[TrainConfig]:
    """The runs as they are handed out.

    A long run that starts last would be waited for by idle workers; seeds come first, so that
    at any moment the grid is whole for as many seeds as can be.
    """
    return sorted(configs, key=lambda config: (config.seed, -cost(config)))


def _outcomes(
    client: Client, configs: Sequence[TrainConfig], store: Store, any_version: bool, line: _Line
) -> Iterator[Outcome]:
    """Outcomes in the order in which the runs end."""
    client.subscribe_topic(_TOPIC, lambda event: line.iteration(*event[1]))
    futures: dict[Future, TrainConfig] = {}
    for i, config in enumerate(configs):
        arguments = (config, store.place, any_version)
        key = ("train", run_name(config), tokenize(*arguments))
        futures[client.submit(_work, *arguments, key=key, priority=-i)] = config
    try:
        for future in as_completed(futures):
            if future.status == "cancelled":
                raise SchedulerLost
            yield Outcome(futures[future], _error(future))
    finally:
        client.unsubscribe_topic(_TOPIC)
        # Workers that are still training save what they have, and stop.
        client.cancel(list(futures), msg="the sweep ended")


def _error(future: Future) -> str | None:
    """What stopped a run that has ended."""
    if future.status == "finished":
        error: str | None = future.result()
        return error
    cause = future.exception()
    if isinstance(cause, KilledWorker):
        return (
            "its worker process died again and again, as for want of memory; give the same "
            "command again to go on from its last checkpoint."
        )
    return f"{type(cause).__name__}: {cause}"


def _work(config: TrainConfig, place: str, any_version: bool) -> str | None:
    """Train one run in a worker; what stopped it, None when it finished."""
    worker, key, name = get_worker(), thread_state.key, run_name(config)
    shown_at = 0.0

    def report(run: Training) -> None:
        nonlocal shown_at
        last = run.iteration == config.iterations
        if last or run.iteration % config.checkpoint_every == 0:
            store.push(name)
        if last or time.monotonic() - shown_at > 1:
            shown_at = time.monotonic()
            worker.log_event(_TOPIC, (name, run.iteration))
        task = worker.state.tasks.get(key)
        if worker.status != Status.running or task is None or task.state == "cancelled":
            raise KeyboardInterrupt  # nobody waits for this run any more

    try:
        store = Store(place)
        store.pull(name)
        train(
            config, store.folder / name, any_version=any_version, report=report, patience=PATIENCE
        )
    except (TrainingStopped, ValueError) as error:
        return str(error)
    except KeyboardInterrupt:
        store.push(name)
        return "it was stopped; give the same command again to go on from its last checkpoint."
    except Exception as error:  # a fault of ours: the sweep goes on, and the place is shown
        traceback.print_exc()
        return f"{type(error).__name__}: {error}"
    return None


@dataclass
class _Line:
    """One line of progress over all runs, overwritten, on a terminal and nowhere else."""

    configs: Sequence[TrainConfig]
    begun: dict[str, int]
    done: int = 0
    failed: int = 0
    start: float = field(default_factory=time.monotonic)
    shown: bool = field(default_factory=lambda: sys.stderr.isatty())

    def __post_init__(self) -> None:
        self.named = {run_name(c): c for c in self.configs}
        self.share = {name: cost(c) / c.iterations for name, c in self.named.items()}
        self.left = {name: c.iterations for name, c in self.named.items()}
        for name, iteration in self.begun.items():
            self.left[name] -= iteration
        self.total = self._left()
        self.running: set[str] = set()

    def _left(self) -> float:
        """About how many processor seconds all runs still need."""
        return sum(self.share[name] * left for name, left in self.left.items())

    def iteration(self, name: str, iteration: int) -> None:
        """Take note of how far a run has come."""
        self.left[name] = self.named[name].iterations - iteration
        self.running.add(name)
        self._show()

    def ended(self, outcome: Outcome) -> None:
        """Take note of the end of a run."""
        name = run_name(outcome.config)
        self.running.discard(name)
        self.left[name] = 0
        self.done += outcome.error is None
        self.failed += outcome.error is not None
        if self.shown:
            print(f"\r{'':<119}\r", end="", file=sys.stderr, flush=True)

    def text(self, now: float) -> str:
        """The line at a time of the monotonic clock, in seconds."""
        left, spent = self._left(), now - self.start
        text = f"{self.done} of {len(self.configs)} runs done, {len(self.running)} running"
        text += f", {self.failed} failed" if self.failed else ""
        if left < self.total:
            seconds = left * spent / (self.total - left)
            hours, minutes = divmod(round(seconds / 60), 60)
            text += f", about {hours} h {minutes:02d} min left"
        return text

    def _show(self) -> None:
        if self.shown:
            text = self.text(time.monotonic())
            print(f"\r{text[:119]:<119}", end="", file=sys.stderr, flush=True)
