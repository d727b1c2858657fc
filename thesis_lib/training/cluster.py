"""Where work is done side by side: processes of this machine, a Dask scheduler, or SLURM."""

from __future__ import annotations

import logging
import math
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import dask
from distributed import Client, LocalCluster
from distributed.client import ClosedClientError, FutureCancelledError
from distributed.comm import CommClosedError

from thesis_lib.checks import ForeseenError, positive_integer

SLURM = "slurm"
"""The scheduler that is jobs of SLURM, by dask-jobqueue."""

KEEP_MEMORY = {
    "MALLOC_MMAP_THRESHOLD_": 1 << 32,
    "MALLOC_TRIM_THRESHOLD_": 1 << 34,
    "MALLOC_TOP_PAD_": 1 << 28,
}
"""Environment in which glibc keeps what a batch frees for the next one, in bytes.

Dask has its workers give back all but 64 kB, and each batch, of hundreds of megabytes, would be
fetched from the system and zeroed anew.
"""

SETTINGS: dict[str, Any] = {
    # A long update holds the interpreter, and is no sign of death.
    "distributed.scheduler.worker-ttl": None,
    # A worker takes a run when it is free, and not before.
    "distributed.scheduler.worker-saturation": 1.0,
    "distributed.scheduler.default-task-durations": {"train": "1h", "test": "10s"},
    "distributed.worker.profile.enabled": False,
    # What a dashboard would show is measured many times a second, beside runs that need the core.
    "distributed.admin.system-monitor.interval": "10s",
    "distributed.admin.tick.interval": "1s",
    "distributed.scheduler.work-stealing": False,
    # What is set in the environment already goes before these.
    "distributed.nanny.pre-spawn-environ": KEEP_MEMORY
    | dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), 1),
    # A terminal sends Ctrl-C to workers too, but it is for their parent to stop them.
    "distributed.worker.preload": ["import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)"],
}
"""Dask's settings; a scheduler that is started apart keeps its own.

:meta hide-value:
"""

GUARD = (
    "the processes that are to work could not be started: a script that is run must have what "
    'it does under `if __name__ == "__main__":`, for each of them imports it.'
)

_LOST = (CommClosedError, ClosedClientError, FutureCancelledError, TimeoutError)
"""What a client raises, wherever it is, once its scheduler is gone."""


def check_guard() -> None:
    """End a process that only imports the script which starts it, and would start more."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise SystemExit(GUARD)


class SchedulerLost(ForeseenError):  # noqa: N818 - it names what happened
    """A scheduler ended before the work that it had been given."""


@contextmanager
def connected(
    tasks: int, workers: int | None, scheduler: str | Client | None, gigabytes: float = 1.0
) -> Iterator[Client]:
    """A client of the scheduler that was asked for, or of one that ends with this block.

    Parameters
    ----------
    tasks
        How many there are: no more workers than that are started.
    workers
        Processes of this machine, or SLURM jobs; default one a core.
    scheduler
        An address such as ``tcp://head:8786``, ``slurm``, a client, or None for this machine.
    gigabytes
        Memory the largest task needs, which SLURM is asked for.

    Raises
    ------
    ValueError
        When there are no workers, or no scheduler answers.
    SchedulerLost
        When the scheduler ends within this block.
    """
    try:
        with _client(tasks, workers, scheduler, gigabytes) as client:
            yield client
    except _LOST as error:
        raise SchedulerLost("the scheduler ended: give the same command again.") from error


@contextmanager
def _client(
    tasks: int, workers: int | None, scheduler: str | Client | None, gigabytes: float
) -> Iterator[Client]:
    if workers is not None:
        positive_integer("workers", workers)
    if isinstance(scheduler, Client):
        yield scheduler
        return
    with dask.config.set(SETTINGS), _quiet():
        if scheduler is None or scheduler == SLURM:
            n = min(workers or len(os.sched_getaffinity(0)), tasks)
            with ExitStack() as stack:
                with _signals_wait():
                    cluster = (
                        _local_cluster(n) if scheduler is None else slurm_cluster(n, gigabytes)
                    )
                    stack.enter_context(cluster)
                yield stack.enter_context(Client(cluster))
            return
        try:
            client = Client(scheduler, timeout=10)
        except (OSError, ValueError) as error:
            raise ValueError(
                f"there is no Dask scheduler at {scheduler!r}: start one with `dask scheduler`, "
                "and workers with `dask worker ADDRESS --nthreads 1`."
            ) from error
        with client:
            yield client


@contextmanager
def _signals_wait() -> Iterator[None]:
    """Hold signals that come within this block back until its end.

    A cluster that is stopped while it starts can neither be used nor closed.
    """
    came: list[int] = []
    before = {}
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if callable(signal.getsignal(number)):  # neither ignored nor left to the system
                before[number] = signal.signal(number, lambda number, _: came.append(number))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])


@contextmanager
def _quiet() -> Iterator[None]:
    """What ends a scheduler is told in one sentence by whom it concerns, and not by Dask's log."""
    known = logging.root.manager.loggerDict
    loggers = [logging.getLogger(name) for name in known if name.split(".")[0] == "distributed"]
    speaking = [logger for logger in loggers if not logger.disabled]
    for logger in speaking:
        logger.disabled = True
    try:
        yield
    finally:
        for logger in speaking:
            logger.disabled = False


def _local_cluster(workers: int) -> LocalCluster:
    """Processes of this machine, each on one thread; they end with this process."""
    check_guard()
    try:
        return LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            memory_limit=0,
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        )
    except RuntimeError as error:
        if "failed to start" in str(error) and hasattr(sys.modules["__main__"], "__file__"):
            raise ValueError(GUARD) from error
        raise


def slurm_cluster(jobs: int, gigabytes: float) -> Any:
    """Jobs of SLURM, each on one core.

    Queue, account, wall time and what else a site asks for come from Dask's own configuration
    file ``jobqueue.yaml``; ``job_script()`` of what is returned is the script.  A job that ends
    before the sweep is not started again: give ``walltime`` at least the hours that ``--plan``
    prints for so many cores, or give the command again, which goes on from the checkpoints.

    Raises
    ------
    ValueError
        When dask-jobqueue is not installed.
    """
    try:
        from dask_jobqueue import SLURMCluster
    except ImportError:
        raise ValueError(
            "SLURM needs dask-jobqueue: install it with `pip install 'thesis_lib[slurm]'`."
        ) from None
    return SLURMCluster(n_workers=jobs, cores=1, processes=1, memory=f"{math.ceil(gigabytes)} GB")
