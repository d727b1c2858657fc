"""Results of long runs that are committed with the book: tables with their provenance.

They lie in ``results``, each a table ``NAME.csv`` beside ``NAME.json``, which says by what
command and from which commit it was made.  Columns that differ each time it is made, such as
seconds, may stand in ``NAME.seconds.csv``, row by row.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from thesis_lib.checkout import repository_root
from thesis_lib.edition.experiment import read_csv


@dataclass(frozen=True)
class Saved:
    """A committed result.

    Attributes
    ----------
    table
        Tidy, one row an observation.
    provenance
        What made it: command, config, versions, commit, wall time.
    """

    table: pd.DataFrame
    provenance: Mapping[str, Any]


def saved(name: str, root: Path | str | None = None) -> Saved:
    """Read a committed result.

    Parameters
    ----------
    name
        Path below ``results`` without a suffix, such as ``learning/curves``.
    root
        The checkout; default the one this library runs from.

    Raises
    ------
    FileNotFoundError
        When the table or its provenance is missing.
    """
    folder = (repository_root() if root is None else Path(root)) / "results"
    files = [folder / f"{name}.{suffix}" for suffix in ("csv", "json")]
    for file in files:
        if not file.is_file():
            raise FileNotFoundError(
                f"the committed result {name!r} is not complete: {file.name} is missing in "
                f"results/{Path(name).parent}; get it with `git checkout -- results`, or make it "
                "with `thesis sweep`."
            )
    table = read_csv(files[0])
    seconds = files[0].with_suffix(".seconds.csv")
    if seconds.is_file():
        table = table.join(read_csv(seconds))
    return Saved(table, json.loads(files[1].read_text(encoding="utf-8")))
