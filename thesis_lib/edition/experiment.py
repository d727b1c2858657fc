"""What an experiment is, and how its table and provenance reach the disk.

An experiment is a function from a frozen config dataclass and a context to rows, one an
observation (``context.py`` and ``rows.py``, which a result's file has from here).
:func:`experiment` takes everything else from the function it decorates.
"""

from __future__ import annotations

import dataclasses
import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import wraps
from pathlib import Path
from typing import Any, Generic, TypeVar, get_args, get_type_hints

import pandas as pd

from thesis_lib.checkout import environment, repository_root
from thesis_lib.checks import check_seed, one_of, plain, shown
from thesis_lib.edition.budgets import BUDGETS
from thesis_lib.edition.context import Context
from thesis_lib.edition.rows import Returns, columns_of, returns, table_of
from thesis_lib.files import alone, replacing, writable_directory, write_json
from thesis_lib.surroundings import own_settings

__all__ = [
    "Context",
    "Experiment",
    "Result",
    "Returns",
    "experiment",
    "load",
    "read_csv",
    "results_directory",
    "returns",
]

ROWS_IN_CSV = 20_000
"""A table with more rows is written as parquet."""

ConfigT = TypeVar("ConfigT")


@dataclass(frozen=True)
class Experiment(Generic[ConfigT]):
    """One table or figure of the thesis, or one of ours.

    Attributes
    ----------
    id
        The thesis's own name, such as ``table-3.1``, or ours, such as ``ch3-scaling``.
    item
        For people, such as ``Table 3.1``.
    title
        One line on what is measured.
    function
        Maps a config and a :class:`Context` to a tidy table.
    budgets
        The config at each budget.
    columns
        Meaning and unit of each column of the table.
    seconds
        How long the book budget took on one core, in seconds.
    claims_read
        Changes of the config that leave out what no claim reads; with them its claims are judged
        over roots.
    """

    id: str
    item: str
    title: str
    function: Callable[[ConfigT, Context], pd.DataFrame]
    budgets: Mapping[str, ConfigT]
    columns: Mapping[str, str]
    seconds: float
    claims_read: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if set(self.budgets) != set(BUDGETS):
            raise ValueError(
                f"experiment {self.id!r} has budgets for {sorted(self.budgets)}, but needs exactly "
                f"{', '.join(BUDGETS)}."
            )

    def config(self, budget: str) -> ConfigT:
        """The config at a budget; ValueError names the budgets when it does not exist."""
        return self.budgets[one_of("budget", budget, BUDGETS)]

    def run(
        self,
        budget: str = "book",
        *,
        config: ConfigT | None = None,
        seed: int = 0,
        workers: int = 1,
    ) -> Result:
        """Run the experiment.

        Parameters
        ----------
        budget
            ``smoke``, ``book`` or ``thesis``.
        config
            Replaces the budget's config where given.
        seed
            Non-negative; the same seed gives the same table for any number of workers.
        workers
            Number of threads.

        Returns
        -------
        Result
            The table with its provenance.
        """
        default = self.config(budget)
        if config is not None and not isinstance(config, type(default)):
            raise ValueError(
                f"config is {shown(config)}, but {self.id} takes a {type(default).__name__} of "
                f"{type(default).__module__}."
            )
        chosen = plain(default if config is None else config)
        _check_counts(chosen, tuple(self.budgets.values()))
        seed = check_seed(seed)
        context = Context(seed=seed, workers=workers)
        made_with = environment()  # a later commit is not what ran
        started, cpu = time.time(), time.process_time()
        clock = time.perf_counter()
        with own_settings():
            table = self.function(chosen, context)
        unknown = set(table.columns) ^ set(self.columns)
        if unknown:
            raise RuntimeError(
                f"experiment {self.id!r} documents {sorted(self.columns)} but returned "
                f"{sorted(table.columns)}; the two must be the same columns."
            )
        provenance = {
            "id": self.id,
            "item": self.item,
            "title": self.title,
            "budget": budget if chosen == default else "custom",
            "config": dataclasses.asdict(chosen),  # type: ignore[call-overload]
            "seed": seed,
            "drawn": context.drawn,
            "workers": context.workers,
            "wall_seconds": round(time.perf_counter() - clock, 3),
            "cpu_seconds": round(time.process_time() - cpu, 3),
            "started": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(started)),
            "rows": len(table),
            "columns": dict(self.columns),
            **made_with,
        }
        return Result(self, table, provenance)


def _check_counts(config: Any, budgets: Sequence[Any]) -> None:
    """Raise ValueError for a count below 1, or several values of which there are none.

    A count is a whole number in a config, or in those within it; 0 is right where one of the
    same config at the budgets has it.
    """
    for part in dataclasses.fields(config):
        value, usual = getattr(config, part.name), [getattr(b, part.name) for b in budgets]
        if dataclasses.is_dataclass(value):
            _check_counts(value, usual)
            continue
        if isinstance(value, tuple) and not value and () not in usual:
            raise ValueError(f"{part.name} is empty, but it must have at least one value.")
        least = min([1, *_whole(usual)])
        for n in _whole(value):
            if n < least:
                raise ValueError(f"{part.name} is {shown(value)}, but it must be at least {least}.")


def _whole(value: Any) -> list[int]:
    """The whole numbers in a value and the sequences within it."""
    if isinstance(value, tuple | list):
        return [n for one in value for n in _whole(one)]
    return [value] if isinstance(value, int) and not isinstance(value, bool) else []


def experiment(
    identifier: str,
    *,
    item: str,
    smoke: ConfigT,
    book: ConfigT,
    thesis: ConfigT | None = None,
    seconds: float,
    columns: Mapping[str, str] | None = None,
    claims_read: Mapping[str, Any] | None = None,
) -> Callable[[Callable[[ConfigT, Context], Any]], Experiment[ConfigT]]:
    """Make an experiment of a function from a config and a context to rows.

    The function's first line is the title; the dataclass in its return annotation, such as
    ``list[Entry]``, gives the columns.

    Parameters
    ----------
    identifier, item, seconds, claims_read
        See :class:`Experiment`.
    smoke, book, thesis
        The config at each budget; without ``thesis`` the thesis ran what the book does.
    columns
        Of a function that returns a table whose columns are documented elsewhere, and not rows.
    """

    def make(function: Callable[[ConfigT, Context], Any]) -> Experiment[ConfigT]:
        row = None if columns else get_args(get_type_hints(function)["return"])[0]

        @wraps(function)
        def table(config: ConfigT, context: Context) -> pd.DataFrame:
            found = function(config, context)
            return found if row is None else table_of(row, found)

        return Experiment(
            id=identifier,
            item=item,
            title=(function.__doc__ or "").partition("\n")[0],
            function=table,
            budgets={"smoke": smoke, "book": book, "thesis": book if thesis is None else thesis},
            columns=dict(columns or {}) if row is None else columns_of(row),
            seconds=seconds,
            claims_read=claims_read or {},
        )

    return make


@dataclass(frozen=True)
class Result:
    """A table with its provenance.

    Attributes
    ----------
    experiment
        What was run.
    table
        Tidy, one row an observation.
    provenance
        Config, seed, versions, commit, wall time.
    """

    experiment: Experiment[Any]
    table: pd.DataFrame
    provenance: Mapping[str, Any]

    def save(self, directory: Path | str) -> Path:
        """Write ``ID.csv`` (``.parquet`` when large) and ``ID.json``, each aside and renamed.

        Parameters
        ----------
        directory
            Made if missing.

        Returns
        -------
        Path
            Of the table.

        Raises
        ------
        ValueError
            When the directory cannot be written to.
        """
        folder = writable_directory(directory)
        large = len(self.table) > ROWS_IN_CSV
        path = folder / f"{self.experiment.id}.{'parquet' if large else 'csv'}"
        stale = path.with_suffix(".csv" if large else ".parquet")
        record = {**self.provenance, "table": path.name}
        with alone(folder):  # another's record would not be that of this table
            with replacing(path) as temporary:
                if large:
                    self.table.to_parquet(temporary, index=False)
                else:
                    self.table.to_csv(temporary, index=False)
            write_json(folder / f"{self.experiment.id}.json", record)
            stale.unlink(missing_ok=True)
        return path


def read_csv(file: Path) -> pd.DataFrame:
    """A table saved as csv: an empty field is missing, ``NA`` and ``None`` are text."""
    return pd.read_csv(file, keep_default_na=False, na_values=[""])


def load(identifier: str, directory: Path | str) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Read a saved table and its provenance.

    Parameters
    ----------
    identifier
        Such as ``table-3.1``.
    directory
        Where :meth:`Result.save` wrote it.

    Raises
    ------
    FileNotFoundError
        When it has not been run; the message gives the command.
    """
    record = Path(directory) / f"{identifier}.json"
    if not record.exists():
        raise FileNotFoundError(
            f"there is no result {identifier!r} in {str(directory)!r}: "
            f"make it with `thesis run {identifier} --out {directory}`."
        )
    provenance = json.loads(record.read_text(encoding="utf-8"))
    path = record.with_name(provenance["table"])
    table = pd.read_parquet(path) if path.suffix == ".parquet" else read_csv(path)
    return table, provenance


def results_directory(budget: str = "book") -> Path:
    """Where results of a budget are kept unless asked otherwise.

    The environment variable ``THESIS_RESULTS`` overrides it; the book's build sets it so
    that notebooks and the ledger meet.
    """
    override = os.environ.get("THESIS_RESULTS")
    return Path(override) if override else repository_root() / "_build" / "results" / budget
