"""Verdicts over roots: how often each comes out when every random number is drawn anew.

A claim whose evidence is drawn is judged on several independent roots, the seeds 1 to n (the
book's own pages show root 0).  Its verdict is the one that comes out in at least eight of ten,
else inconclusive; once the roots left cannot change that, no more are made for it, so that
"8 of 8" is as settled as "10 of 10".  Evidence that no run draws is exact, and judged once.

``thesis claims --seeds 10`` makes the tables, below ``_build/claims``, and judges them, one group
of claims after the other; killed, it goes on with the first table that is missing or was made by
other code.  What it finds is committed as ``results/claims/verdicts.csv``, which the pages read.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import signal
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from multiprocessing import get_context, parent_process
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from thesis_lib.checkout import commit, repository_root
from thesis_lib.checks import ForeseenError, positive_integer
from thesis_lib.edition import chapters
from thesis_lib.edition.experiment import Experiment, load, read_csv
from thesis_lib.edition.ledger import Claim, Finding, OverRoots, Verdict, finding
from thesis_lib.edition.reach import digest, digest_of_judging, place
from thesis_lib.files import alone, replacing, writable_directory

COLUMNS = (
    *("claim", "root", "verdict", "budget", "numbers"),
    *("code", "criterion", "confirmed", "commit"),
)
"""Of ``verdicts.csv``.  Root 0 stands for evidence that is exact; ``numbers`` are those that
decided, as JSON; ``code`` is a digest of what made and judged the evidence, committed runs
included, and ``criterion`` of the criterion alone; ``confirmed`` is the root on which later code,
then that of ``code``, found the same (:mod:`thesis_lib.edition.confirm`), or 0; ``commit`` is the
state that judged."""


def committed() -> Path:
    """Where the verdicts lie that the pages read."""
    return repository_root() / "results" / "claims" / "verdicts.csv"


def read(file: Path | None = None) -> dict[str, OverRoots]:
    """Verdicts over roots by claim; none where the file is missing."""
    file = committed() if file is None else file
    return over_roots(read_csv(file)) if file.is_file() else {}


def over_roots(table: pd.DataFrame) -> dict[str, OverRoots]:
    """Verdicts over roots by claim, of a table with :data:`COLUMNS`."""
    found = {}
    for claim, own in table.groupby("claim", sort=False):
        counts = Counter(Verdict(v) for v in own.verdict)
        exact = bool((own["root"] == 0).all())
        found[str(claim)] = OverRoots(
            counts=dict(counts.most_common()),
            budget=own.budget.iloc[0],
            code=own.code.iloc[0],
            exact=exact,
            confirmed=int(own.confirmed.iloc[0]),
        )
    return found


# ------------------------------------------------------------------------------ tables
@cache
def experiments() -> dict[str, Experiment[Any]]:
    """Every experiment by id."""
    return chapters.experiments()


def read_config(experiment: Experiment[Any], budget: str) -> Any:
    """The config at a budget, without what no claim reads."""
    return dataclasses.replace(experiment.config(budget), **experiment.claims_read)


def tables_folder(work: Path | None) -> Path:
    """Where the tables of roots are kept; default ``_build/claims``."""
    return writable_directory(work or repository_root() / "_build" / "claims")


@dataclass(frozen=True)
class Job:
    """One experiment on one root."""

    experiment: str
    root: int
    budget: str
    work: Path
    code: str

    @property
    def folder(self) -> Path:
        """Where its table lies."""
        return self.work / self.budget / f"root-{self.root}"

    @property
    def table(self) -> Path:
        """Its table."""
        return self.folder / f"{self.experiment}.csv"

    @property
    def record(self) -> Path:
        """The provenance of that."""
        return self.table.with_suffix(".json")

    def recorded(self) -> dict[str, Any] | None:
        """The provenance of its table, whatever code made it; None without a table."""
        if not self.record.is_file():
            return None
        found: dict[str, Any] = json.loads(self.record.read_text(encoding="utf-8"))
        return found

    def provenance(self) -> dict[str, Any] | None:
        """That of its table, if there is one made by the code as it is."""
        found = self.recorded()
        return found if found and found.get("code") == self.code else None

    def __call__(self) -> Job:
        """Make the table."""
        known = experiments()[self.experiment]
        config = read_config(known, self.budget)
        result = known.run(self.budget, config=config, seed=self.root)
        stamped = {**result.provenance, "code": self.code}
        dataclasses.replace(result, provenance=stamped).save(self.folder)
        return self


POOL_PAYS = 30.0
"""Seconds of work from which on several processes are started for it."""

TOGETHER = 600.0
"""Seconds of evidence a root that several processes make before its claims are judged and kept."""


def _in_turn(jobs: Sequence[Job]) -> list[list[Job]]:
    """Jobs in lists that one process each does in turn: those of one root with the same config.

    What one keeps in memory, such as figure 4.7 what its tasks have learned, the next one takes.
    """
    lists: dict[Any, list[Job]] = {}
    for job in jobs:
        lists.setdefault((job.root, _settings(job.experiment, job.budget)), []).append(job)
    return list(lists.values())


def _settings(experiment: str, budget: str) -> str:
    """A text that experiments with the same config share."""
    config = read_config(experiments()[experiment], budget)
    return f"{type(config).__module__} {config!r}"


def _do(jobs: Sequence[Job]) -> list[Job]:
    return [job() for job in jobs]


def make(jobs: Sequence[Job], workers: int, say: Callable[[str], None]) -> None:
    """Make the tables that are missing, in processes of their own if there are several workers."""
    missing = [job for job in jobs if job.provenance() is None]

    def report(job: Job, done: int) -> None:
        seconds = (job.provenance() or {}).get("wall_seconds", 0.0)
        say(f"{job.experiment}, root {job.root}: {seconds:.0f} s ({done} of {len(missing)})")

    work = _seconds(job.experiment for job in missing)
    if workers == 1 or work < POOL_PAYS:
        for done, job in enumerate(missing, 1):
            report(job(), done)
        return
    pool = _pool(workers)
    with _deaf():
        waiting = {pool.submit(_do, jobs) for jobs in _in_turn(missing)}
    done = 0
    try:
        while waiting:
            ready, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            for job in (job for future in ready for job in future.result()):
                done += 1
                report(job, done)
    except BaseException as error:
        _pool.cache_clear()
        for process in list(pool._processes.values()):
            process.terminate()
        pool.shutdown(cancel_futures=True)
        if not isinstance(error, BrokenProcessPool):
            raise
        raise ForeseenError(
            "a process ended before its table was made: give the same command again, with "
            "fewer workers where memory is short; a script must have what it does under "
            '`if __name__ == "__main__":`.'
        ) from error


@cache
def _pool(workers: int) -> ProcessPoolExecutor:
    """Processes for all groups of claims: to start them takes longer than many a table."""
    from thesis_lib.training.cluster import check_guard  # takes a second to import

    check_guard()
    return ProcessPoolExecutor(
        workers, mp_context=get_context("spawn"), initializer=_end_with_parent
    )


@contextmanager
def _deaf() -> Iterator[None]:
    """Have processes that start within this block leave Ctrl-C to the one that starts them."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with_parent() -> None:
    """End this process as soon as the one that started it has ended, however that did."""
    parent = parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


# ------------------------------------------------------------------------------ code
def code_of_table(experiment: Experiment[Any], config: Any) -> str:
    """Digest of a config and of the code that makes a table of it."""
    return digest([place(experiment)], repr(config))


def code_of_claim(claim: Claim, budget: str) -> str:
    """Digest of what makes and judges a claim's evidence."""
    known = [experiments()[e] for e in claim.experiments]
    configs = [repr(read_config(e, budget)) for e in known]
    return digest([place(x) for x in (*claim.criteria, *known)], *claim.rests_on, *configs)


def code_of_criterion(claim: Claim) -> str:
    """Digest of what judges a claim, without its sentences and the library that it calls."""
    return digest_of_judging(place(x) for x in claim.criteria)


# ------------------------------------------------------------------------------ verdicts
@dataclass(frozen=True)
class Judged:
    """A claim's findings by root, the first of them first, and the code before they were made.

    ``confirmed`` is the root that the code as it is made anew, where it let other tables stand.
    """

    claim: Claim
    findings: Mapping[int, Finding]
    code: str
    confirmed: int = 0


def parts(claims: Iterable[Claim], together: float = 0.0) -> list[list[Claim]]:
    """Claims in groups that share no evidence and no settings, the cheapest to make first.

    Parameters
    ----------
    claims
        Which.
    together
        Groups whose evidence takes less than so many seconds a root are joined: with one table at
        a time to make, all processes but one would wait.
    """
    known = experiments()
    alike: dict[str, set[str]] = {}
    for one in known:
        alike.setdefault(_settings(one, "book"), set()).add(one)
    groups: list[tuple[set[str], list[Claim]]] = []
    for claim in claims:
        own = set(claim.experiments)
        near = own.union(*(alike[_settings(e, "book")] for e in own))
        shared = [g for g in groups if g[0] & near]
        groups = [g for g in groups if not g[0] & near]
        members = [c for _, those in shared for c in those]
        groups.append((own.union(*(e for e, _ in shared)), [*members, claim]))
    groups.sort(key=lambda g: _seconds(g[0]))
    joined = groups[:1]
    for needed, members in groups[1:]:
        before = joined[-1]
        if _seconds(before[0]) < together:
            joined[-1] = (before[0] | needed, [*before[1], *members])
        else:
            joined.append((needed, members))
    return [members for _, members in joined]


def _seconds(wanted: Iterable[str]) -> float:
    return sum(experiments()[e].seconds for e in wanted)


def judge_over(
    claims: Sequence[Claim],
    roots: int,
    *,
    budget: str,
    workers: int = 1,
    only: int = 0,
    work: Path | None = None,
    say: Callable[[str], None] = print,
) -> list[Judged]:
    """Judge claims on independent roots, making the tables that are missing.

    Parameters
    ----------
    claims
        Which.
    roots
        How many; the seeds are 1 to this number.
    budget
        Of the evidence; at ``smoke`` nothing is judged.
    workers
        Processes.
    only
        The one root to judge on, or 0 for all.
    work
        Where tables are kept; default ``_build/claims``.
    say
        Called with a line for each table made.

    Returns
    -------
    list of Judged
        Root 0 where nothing is drawn.

    Raises
    ------
    ValueError
        For less than 1 root or worker.
    """
    positive_integer("seeds", roots)
    positive_integer("workers", workers)
    folder = tables_folder(work)
    needed = dict.fromkeys(e for claim in claims for e in claim.experiments)
    known = sorted((experiments()[e] for e in needed), key=lambda e: -float(e.seconds))
    codes = {e.id: code_of_table(e, read_config(e, budget)) for e in known}
    # A run that is committed while tables are made may be one that they did not read.
    judged_by = {claim.id: code_of_claim(claim, budget) for claim in claims}

    found: dict[str, dict[int, Finding]] = {claim.id: {} for claim in claims}
    stochastic: set[str] = set()
    least = math.ceil(OverRoots.HOLDS * roots)
    first = only or 1

    def table(experiment: str, root: int) -> pd.DataFrame:
        chosen = root if experiment in stochastic else first
        return load(experiment, Job(experiment, chosen, budget, folder, "").folder)[0]

    # Which experiments draw at all is known from their first root; no verdict holds before
    # ``least`` of them.
    later = [] if only else [range(2, least + 1), *([r] for r in range(least + 1, roots + 1))]
    for group in ([first], *later):
        going = [c for c in claims if not _decided(found[c.id], least, roots)]
        wanted = {e for claim in going for e in claim.experiments}
        jobs = [
            Job(e.id, root, budget, folder, codes[e.id])
            for root in group
            for e in known
            if e.id in wanted and (root == first or e.id in stochastic)
        ]
        make(jobs, workers, say)
        if first in group:
            stochastic |= {j.experiment for j in jobs if (j.provenance() or {})["drawn"]}

        for claim in going:
            drawn = not stochastic.isdisjoint(claim.experiments)
            for root in group if drawn else [0] if first in group else []:
                tables = {e: table(e, root) for e in claim.experiments}
                found[claim.id][root] = finding(claim, tables, budget)

    def confirmed(claim: Claim) -> int:
        """The root of the tables that earlier code made, if there are any."""
        jobs = [Job(e, first, budget, folder, codes[e]) for e in claim.experiments]
        return max(((job.provenance() or {}).get("confirmed", 0) for job in jobs), default=0)

    return [Judged(c, found[c.id], judged_by[c.id], confirmed(c)) for c in claims]


def _decided(findings: Mapping[int, Finding], least: int, roots: int) -> bool:
    """Whether no verdict of the roots left can change what those so far come to."""
    if 0 in findings:
        return True
    most = max(Counter(f.verdict for f in findings.values()).values(), default=0)
    return most >= least or most + roots - len(findings) < least


def save(judged: Sequence[Judged], budget: str, file: Path) -> dict[str, OverRoots]:
    """Write verdicts beside those of other claims in a file, and return what they come to."""
    state, rows = commit(), []
    for j in judged:
        evidence = budget if j.claim.experiments else "exact"
        judged_by = (j.code, code_of_criterion(j.claim), j.confirmed, state)
        rows += [
            (j.claim.id, root, str(f.verdict), evidence, rounded(f.numbers), *judged_by)
            for root, f in j.findings.items()
        ]
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    mine = over_roots(table)
    writable_directory(file.parent)

    def join(others: pd.DataFrame) -> pd.DataFrame:
        joined = pd.concat([others[~others.claim.isin(mine)], table]) if len(others) else table
        return joined.sort_values(["claim", "root"], kind="stable")

    rewrite(file, join)
    return mine


def rewrite(file: Path, change: Callable[[pd.DataFrame], pd.DataFrame]) -> None:
    """Change a table of verdicts, or an empty one where there is none, while no other does."""
    with alone(file.parent):
        table = read_csv(file) if file.is_file() else pd.DataFrame(columns=list(COLUMNS))
        with replacing(file) as temporary:
            change(table).to_csv(temporary, index=False)


def rounded(numbers: Mapping[str, float]) -> str:
    """Numbers as JSON, to four digits; what is not finite as null."""
    return json.dumps(
        {k: float(f"{v:.4g}") if np.isfinite(v) else None for k, v in numbers.items()},
        ensure_ascii=False,
    )
