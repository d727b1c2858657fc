"""What a run is given besides its config: a seed, workers, and a bar that shows how far it is."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from tqdm import tqdm

from thesis_lib.checks import check_seed, plain_settings, positive_integer

ItemT = TypeVar("ItemT")
ResultT = TypeVar("ResultT")


@dataclass(frozen=True)
class Context:
    """What a run is given besides its config.

    Attributes
    ----------
    seed
        All randomness comes from it.
    workers
        How many threads may work; the result does not depend on it.
    drawn
        Whether the run has asked for the seed so far; a result of one that never does is exact.
    """

    seed: int = 0
    workers: int = 1
    drawn: bool = field(default=False, init=False, repr=False, compare=False)

    def __getattribute__(self, name: str) -> Any:
        if name == "seed":
            object.__setattr__(self, "drawn", True)
        return super().__getattribute__(name)

    def __post_init__(self) -> None:
        check_seed(self.seed)
        plain_settings(self)
        object.__setattr__(self, "drawn", False)
        positive_integer("workers", self.workers)

    def seeds(self, n: int, *key: int) -> list[np.random.SeedSequence]:
        """Independent seed sequences for n runs.

        Parameters
        ----------
        n
            How many.
        *key
            Integers that set this use of the seed apart from others, such as the index
            of a configuration.
        """
        if n < 0:
            raise ValueError(f"the number of runs is {n}, but at least 1 is needed.")
        return np.random.SeedSequence(self.seed, spawn_key=tuple(key)).spawn(n)

    def map(
        self,
        function: Callable[[ItemT], ResultT],
        items: Iterable[ItemT],
        label: str = "",
    ) -> list[ResultT]:
        """Apply a function to every item, on ``workers`` threads, in order.

        The learners are compiled and release the interpreter's lock, so that threads
        run side by side.  A progress bar shows on a terminal and nowhere else.
        """
        work = list(items)
        with progress(total=len(work), label=label) as bar:
            if self.workers == 1:
                results = []
                for item in work:
                    results.append(function(item))
                    bar.update()
                return results
            with ThreadPoolExecutor(self.workers) as pool:
                results = []
                try:
                    for result in pool.map(function, work):
                        results.append(result)
                        bar.update()
                except BaseException:
                    pool.shutdown(cancel_futures=True)
                    raise
                return results


@contextmanager
def progress(total: int, label: str = "") -> Iterator[tqdm]:
    """A progress bar on stderr when it is a terminal, silence elsewhere."""
    with tqdm(total=total, desc=label, disable=not sys.stderr.isatty(), leave=False) as bar:
        yield bar
