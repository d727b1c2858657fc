"""Test every policy of a store under the thesis's conditions, and choose the best (section 5.4)."""

from __future__ import annotations

import dataclasses
import fnmatch
import hashlib
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
from tqdm import tqdm

from thesis_lib.checkout import environment
from thesis_lib.checks import ForeseenError, one_of, plain_settings
from thesis_lib.files import replacing, writable_directory, write_json
from thesis_lib.locomotion import BatchTask
from thesis_lib.training.checkpoint import code_digest
from thesis_lib.training.columns import columns
from thesis_lib.training.disturbances import Disturbances
from thesis_lib.training.evaluation import RUN_COLUMNS, EvaluateConfig, evaluation_task, tested
from thesis_lib.training.grid import GRID_COLUMNS, key
from thesis_lib.training.store import Store
from thesis_lib.training.trained import Trained, TrainedPolicies, read_trained

if TYPE_CHECKING:
    from distributed import Client, Future

CONDITIONS: Mapping[str, str] = {
    "base": "flat ground, nothing else",
    "noise": "noise on all sensors from some step on",
    "switch": "flat ground that turns hilly",
    "hill": "hilly ground from the start",
}
"""Conditions of a test; the thesis's are the first three."""

POLICIES = ("last", "best")
RULES = ("seed", "all")

COLUMNS: Mapping[str, str] = {
    **GRID_COLUMNS,
    **columns("policy", conditions=", ".join(CONDITIONS)),
    **{{"run": "test"}.get(name, name): words for name, words in RUN_COLUMNS.items()},
}
"""Meaning and unit of each column of :func:`evaluate_all`, one row a run of a test."""

BEST_COLUMNS: Mapping[str, str] = {
    **{name: words for name, words in GRID_COLUMNS.items() if name != "seed"},
    "condition": COLUMNS["condition"],
    **columns("best"),
}
"""Meaning and unit of each column of :func:`best`."""


@dataclass(frozen=True)
class SuiteConfig:
    """The tests of section 5.4: 20 runs of 1000 steps, on the same maps and seeds for all."""

    conditions: tuple[str, ...] = ("base", "noise", "switch")
    """base, noise, switch, hill."""
    policy: str = "last"
    """Which policy of a run: last, or that of its best batch."""
    runs: int = 20
    """Runs of a test."""
    steps: int = 1000
    """Control steps of a run."""
    termination: str = "train"
    """train, test (the author's test mode) or never: which limits end a run."""
    noise: float = 1.0
    """Standard deviation of the noise, in each sensor's own unit."""
    correlation_time: float = 0.0
    """Control steps over which the noise is correlated; 0 is the thesis's white noise."""
    onset: int = 100
    """Control step from which the noise acts."""
    difficulty: float = 1.0
    """Height of the hills in metres."""
    switch_at: str = "task"
    """Where flat ground turns hilly: at x metres, or "task" where the task says so."""
    memory: bool = True
    """Whether nets remember; otherwise their state is at every step that of a start."""
    previous_action: bool = True
    """Whether nets see their last action; otherwise they read zero."""
    input_filter: float = 0.0
    """Time constant in seconds of a first-order filter between the sensors and the nets; 0 is
    none."""
    seed: int = 0
    """All randomness comes from it."""

    def __post_init__(self) -> None:
        plain_settings(self)
        for name, allowed in (("conditions", CONDITIONS), ("policy", POLICIES)):
            given = getattr(self, name)
            for value in (given,) if isinstance(given, str) else given:
                one_of(name, value, allowed)
        if not self.conditions or len(set(self.conditions)) < len(self.conditions):
            raise ValueError(
                f"conditions are {self.conditions}, but they must be some of "
                f"{', '.join(CONDITIONS)}, each once."
            )
        for condition in CONDITIONS:  # what a test would refuse is refused here
            self.test(condition)

    @property
    def intervention(self) -> str:
        """What is done to the nets, in words."""
        done = {
            "no memory": not self.memory,
            "no previous action": not self.previous_action,
            "input filter": self.input_filter > 0,
        }
        return ", ".join(name for name, is_done in done.items() if is_done) or "none"

    def test(self, condition: str) -> EvaluateConfig:
        """The test of one condition."""
        shared = ("runs", "steps", "termination", "memory", "previous_action", "input_filter")
        test = EvaluateConfig(
            terrain="hill" if condition == "hill" else "flat",
            **{name: getattr(self, name) for name in (*shared, "seed", "difficulty")},
        )
        if condition == "noise":
            return test.disturbed(
                Disturbances(
                    noise=self.noise, correlation_time=self.correlation_time, onset=self.onset
                )
            )
        if condition == "switch":
            return test.disturbed(Disturbances(switch_at=self.switch_at))
        return test


def policies_in(place: Path | str) -> list[str]:
    """Names of the trained policies in a place.

    Parameters
    ----------
    place
        A sweep's ``policies.pt``, or a :class:`~thesis_lib.training.store.Store` of runs.

    Raises
    ------
    ValueError
        When there are none.
    """
    names = list(_file(place).names) if _is_file(place) else Store(place).names()
    if not names:
        raise ValueError(
            f"there are no policies in {str(place)!r}: name the directory of a sweep's runs, or "
            "its policies.pt."
        )
    return names


def evaluate_all(
    place: Path | str,
    config: SuiteConfig | None = None,
    *,
    names: Sequence[str] | None = None,
    workers: int | None = None,
    scheduler: str | Client | None = None,
) -> pd.DataFrame:
    """Test every policy of a store in every condition.

    Parameters
    ----------
    place
        See :func:`policies_in`.
    config
        The tests.
    names
        Of policies to test, or patterns such as ``hopper-*-gru-*``; default all.
    workers, scheduler
        See :func:`thesis_lib.training.cluster.connected`; no result depends on them.

    Returns
    -------
    pandas.DataFrame
        Columns as in :data:`COLUMNS`, one row a run of a test, policies in the order of their
        names in the store.

    Raises
    ------
    ValueError
        When there are no policies, or none of such a name.
    """
    from distributed import as_completed

    from thesis_lib.training.cluster import connected

    chosen, known = config or SuiteConfig(), policies_in(place)
    names = known if names is None else _named(names, known)
    found: dict[str, pd.DataFrame] = {}
    with connected(len(names), workers, scheduler, gigabytes=2) as client:
        # Robots apart, so that a worker seldom has to build another's worlds.
        futures = {
            client.submit(_test, str(place), name, chosen, priority=-i, pure=False): name
            for i, name in enumerate(sorted(names))
        }
        try:
            with tqdm(total=len(names), disable=None, leave=False) as bar:
                for future in as_completed(futures):
                    found[futures[future]] = _result(future, futures[future])
                    bar.update()
        finally:
            client.cancel(list(futures))
    return pd.concat([found[name] for name in names], ignore_index=True)


def _result(future: Future, name: str) -> pd.DataFrame:
    """The tests of one policy that have ended."""
    from distributed.scheduler import KilledWorker

    try:
        table: pd.DataFrame = future.result()
    except KilledWorker as error:
        raise ForeseenError(
            f"a worker process died again and again while it tested {name!r}, as for want of "
            "memory: give the command again with fewer --workers."
        ) from error
    return table


def check_kept(place: Path | str, names: Sequence[str], out: Path | str) -> None:
    """Raise ValueError where tests of other policies than these are in a directory."""
    file = Path(out) / "tests.parquet"
    if not file.is_file():
        return
    kept = _named(names, policies_in(place))
    lost = [run for run in pd.read_parquet(file, columns=["run"]).run.unique() if run not in kept]
    if lost:
        raise ValueError(
            f"{str(out)!r} holds tests of other policies, such as {lost[0]}, and would lose "
            f"{len(lost)} of them: choose another --out, or name them too (--names)."
        )


def _named(patterns: Sequence[str], known: Sequence[str]) -> list[str]:
    """Those of some names that a pattern matches, in their order."""
    for pattern in patterns:
        if not any(fnmatch.fnmatchcase(name, pattern) for name in known):
            raise ValueError(
                f"no policy is named {pattern!r}: name some of the {len(known)}, such as "
                f"{known[0]!r}, or a pattern such as 'hopper-*-gru-*'."
            )
    return [name for name in known if any(fnmatch.fnmatchcase(name, p) for p in patterns)]


def _test(place: str, name: str, config: SuiteConfig) -> pd.DataFrame:
    """All tests of one policy."""
    trained = _read(place, name)
    iteration = trained.iteration
    if config.policy == "best":
        if trained.best is None:
            raise ValueError(
                f"run {name!r} kept no policy of its best batch: test the last ones instead."
            )
        trained.policy.set_parameter_vector(trained.best.parameters)
        iteration = trained.best.iteration - 1
    parts = []
    for condition in config.conditions:
        test = config.test(condition)
        run = trained.config
        task = _worlds(threading.get_ident(), run.task, run.reading, run.alive_bonus, test)
        task.reseed(test.seed)
        table = tested(task, trained.policy, test).rename(columns={"run": "test"})
        correlation = config.correlation_time if condition == "noise" else 0.0
        parts.append(table.assign(condition=condition, correlation=correlation))
    table = pd.concat(parts, ignore_index=True).assign(
        **key(trained.config),
        run=name,
        policy=config.policy,
        intervention=config.intervention,
        iteration=iteration,
        last_return=trained.last_return,
    )
    return table[list(COLUMNS)]


@lru_cache(maxsize=8)
def _worlds(
    thread: int, task: str, reading: str, alive_bonus: float | None, test: EvaluateConfig
) -> BatchTask:
    """Worlds of a test, the same for all policies of a robot; each thread has its own."""
    return evaluation_task(task, test, reading=reading, alive_bonus=alive_bonus)


def _is_file(place: Path | str) -> bool:
    return "://" not in str(place) and Path(place).is_file()


def _file(place: Path | str) -> TrainedPolicies:
    return _read_file(place, Path(place).stat().st_mtime_ns)


@lru_cache(maxsize=1)
def _read_file(place: Path | str, written: int) -> TrainedPolicies:
    return TrainedPolicies(place)


def _read(place: str, name: str) -> Trained:
    if _is_file(place):
        return _file(place).load(name)
    store = Store(place)
    store.pull(name)
    return read_trained(store.folder / name)


def best(table: pd.DataFrame, rule: str = "seed") -> pd.DataFrame:
    """What each architecture came to, by a rule for which of its policies counts.

    Parameters
    ----------
    table
        From :func:`evaluate_all`.
    rule
        ``seed``: the one policy whose training ended best (``last_return``), as the thesis
        probably did; ``all``: the mean over all seeds, with the error over seeds.

    Returns
    -------
    pandas.DataFrame
        Columns as in :data:`BEST_COLUMNS`, one row an architecture and condition.

    Raises
    ------
    ValueError
        When there is no such rule, or it is not known how training ended.
    """
    one_of("rule", rule, RULES)
    if rule == "seed" and table.last_return.isna().any():
        raise ValueError(
            "the rule seed needs the returns training ended with, which are not kept in this "
            "file of policies: test the directory of runs, or take the rule all."
        )
    nets = [name for name in GRID_COLUMNS if name != "seed"]
    records = []
    for names, group in table.groupby([*nets, "condition"], sort=False):
        if rule == "seed":
            group = group[group.seed == group.loc[group.last_return.idxmax(), "seed"]]
        seeds = group.groupby("seed")["return"].mean()
        one = len(seeds) == 1
        records.append(
            {
                **dict(zip([*nets, "condition"], names, strict=True)),
                "seeds": len(seeds),
                "seed": seeds.index[0] if one else None,
                "mean_return": group["return"].mean(),
                "se_runs": group["return"].sem() if one else None,
                "se_seeds": None if one else seeds.sem(),
            }
        )
    return pd.DataFrame(records, columns=list(BEST_COLUMNS))


def write(
    table: pd.DataFrame, place: Path | str, config: SuiteConfig, out: Path | str, *, command: str
) -> Path:
    """Write tests as ``tests.parquet`` with their provenance ``tests.json``.

    Parameters
    ----------
    table
        From :func:`evaluate_all`.
    place
        What was tested.
    config
        The tests.
    out
        Directory to write to.
    command
        What made them.

    Returns
    -------
    Path
        Of the table.
    """
    folder = writable_directory(out)
    record: dict[str, Any] = {
        "id": "tests",
        "title": "Returns of trained policies in tests, one row a run.",
        "command": command,
        "config": dataclasses.asdict(config),
        "tests": {c: dataclasses.asdict(config.test(c)) for c in config.conditions},
        "store": Path(str(place)).name,
        "policies": hashlib.sha256(Path(place).read_bytes()).hexdigest()
        if _is_file(place)
        else None,
        "rows": len(table),
        "columns": dict(COLUMNS),
        "written": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        **environment(),
        "code": code_digest(__name__),
        "table": "tests.parquet",
    }
    with replacing(folder / "tests.parquet") as temporary:
        table.to_parquet(temporary, index=False)
    write_json(folder / "tests.json", record)
    return folder / "tests.parquet"
