r"""Train a grid of policies side by side, on one machine or many.

Dask hands the runs out: to processes of this machine, a core each, or to the workers of any
scheduler.  Every run has a directory of its own, so that a run that fails leaves the others
alone, and a sweep that was killed, or whose workers or scheduler were, goes on where its runs
left off.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from dask.base import tokenize
from distributed import Client, Future, Status, as_completed, get_worker
from distributed.scheduler import KilledWorker
from distributed.worker import thread_state
from tqdm import tqdm

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


class _Line:
    """Progress over all runs, by what they cost, on a terminal and nowhere else."""

    def __init__(self, configs: Sequence[TrainConfig], begun: Mapping[str, int]) -> None:
        self.named = {run_name(c): c for c in configs}
        self.share = {name: cost(c) / c.iterations for name, c in self.named.items()}
        self.left = {name: c.iterations - begun[name] for name, c in self.named.items()}
        self.running: set[str] = set()
        self.done = self.failed = 0
        self.bar = tqdm(
            total=sum(self.share[name] * left for name, left in self.left.items()),
            bar_format="{percentage:.0f}%, {remaining} left{postfix}",
            disable=None,
            leave=False,
            smoothing=0,
            mininterval=0,
            miniters=0,
        )

    def _now_left(self, name: str, left: int) -> None:
        failed = f", {self.failed} failed" * (self.failed > 0)
        self.bar.set_postfix_str(
            f"{self.done} of {len(self.left)} runs done, {len(self.running)} running{failed}",
            refresh=False,
        )
        self.bar.update(self.share[name] * (self.left[name] - left))
        self.left[name] = left

    def iteration(self, name: str, iteration: int) -> None:
        """Take note of how far a run has come."""
        self.running.add(name)
        self._now_left(name, self.named[name].iterations - iteration)

    def ended(self, outcome: Outcome) -> None:
        """Take note of the end of a run, and make way for a line on it."""
        self.running.discard(run_name(outcome.config))
        self.done += outcome.error is None
        self.failed += outcome.error is not None
        self._now_left(run_name(outcome.config), 0)
        self.bar.clear()
