"""Tables as rows of a dataclass: its fields are the columns, the words under them document them."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import docstring_parser
import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from thesis_lib.stats import mean_ci


@dataclass(frozen=True)
class Returns:
    """Base of rows that tell returns of independent runs."""

    mean_return: float
    """Mean total reward of a run."""
    ci95: float
    """Half-width of its 95% t interval over runs."""
    sd: float
    """Standard deviation over runs."""
    n_runs: int
    """Number of runs."""


def returns(values: ArrayLike) -> dict[str, Any]:
    """The fields of :class:`Returns`, for runs of any shape, one number each."""
    total = np.asarray(values, dtype=float)
    summary = mean_ci(total)
    return {
        "mean_return": summary.mean,
        "ci95": summary.half_width,
        "sd": float(total.std(ddof=1)),
        "n_runs": summary.n,
    }


def column_names(row: type) -> list[str]:
    """Fields of a row in the table's order: its own before those it inherits."""
    own = [inspect.get_annotations(cls) for cls in row.__mro__]
    return list(dict.fromkeys(name for names in own for name in names))


def columns_of(row: type) -> dict[str, str]:
    """Meaning of each field of a row, from the words under it in the dataclass.

    Raises
    ------
    ValueError
        If a field has none.
    """
    words: dict[str, str | None] = {}
    for cls in row.__mro__[-2::-1]:
        found = docstring_parser.parse_from_object(cls).params
        words |= {p.arg_name: p.description for p in found}
    for name in column_names(row):
        if not words.get(name):
            raise ValueError(f"{row.__name__}.{name} is not documented: say below it what it is.")
    return {name: " ".join(str(words[name]).split()).rstrip(".") for name in column_names(row)}


def table_of(row: type, records: Sequence[Any]) -> pd.DataFrame:
    """A tidy table of rows of one dataclass, its fields the columns."""
    names = column_names(row)
    return pd.DataFrame({name: [getattr(record, name) for record in records] for name in names})
