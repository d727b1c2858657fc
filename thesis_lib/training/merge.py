"""Bring the finished runs of several sweeps together, as of a grid that is trained bit by bit.

What a sweep wrote is enough: its learning curves with their record, and its policies.  Each run
keeps the provenance it had.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from thesis_lib.files import writable_directory
from thesis_lib.training.checkpoint import write_tensors
from thesis_lib.training.curves import COMPARISONS, finished, write_tables
from thesis_lib.training.grid import GRID_COLUMNS, named
from thesis_lib.training.trained import FORMAT, TrainedPolicies

COMMON = ("iterations", "batch_steps", "horizon")
"""Settings that all runs of one table share."""


@dataclass(frozen=True)
class Swept:
    """What a sweep wrote, less the runs that it did not finish.

    Attributes
    ----------
    folder
        Where.
    record
        Of ``curves.json``.
    curves
        By the name of the run, its rows of ``curves.csv`` and ``curves.seconds.csv``.
    policies
        By the name of the run, its entry in ``policies.pt``.
    """

    folder: Path
    record: dict[str, Any]
    curves: dict[str, pd.DataFrame]
    policies: dict[str, Any]


def read_sweep(folder: Path | str) -> Swept:
    """The finished runs of a sweep.

    Raises
    ------
    ValueError
        When the directory lacks one of a sweep's files, or they were not all written.
    """
    folder = Path(folder)
    for name in ("curves.json", "curves.csv", "curves.seconds.csv", "policies.pt"):
        if not (folder / name).is_file():
            raise ValueError(
                f"there is no {name} in {str(folder)!r}: name a directory that `thesis sweep` "
                "wrote to (--out)."
            )
    record = json.loads((folder / "curves.json").read_text(encoding="utf-8"))
    done = set(finished(record))
    curves, seconds = (pd.read_csv(folder / n) for n in ("curves.csv", "curves.seconds.csv"))
    if {len(curves), len(seconds)} != {record["rows"]}:
        raise ValueError(
            f"{str(folder)!r} has {len(curves)} rows in curves.csv, {len(seconds)} in "
            f"curves.seconds.csv and {record['rows']} by curves.json, but these must be the same "
            "(what wrote them was interrupted): restore it from git, or sweep again."
        )
    table = pd.concat([curves, seconds], axis=1)
    parts = {
        named(dict(zip(GRID_COLUMNS, run, strict=True))): rows
        for run, rows in table.groupby(list(GRID_COLUMNS), sort=False)
    }
    policies = TrainedPolicies(folder / "policies.pt")._policies
    return Swept(
        folder,
        record,
        {name: rows for name, rows in parts.items() if name in done},
        {name: policy for name, policy in policies.items() if name in done},
    )


def merge(folders: Sequence[Path | str], out: Path | str, *, command: str) -> pd.DataFrame:
    """Write the finished runs of several sweeps as one sweep would have.

    Parameters
    ----------
    folders
        What the sweeps wrote to.  A run that is in several is taken from the first.
    out
        Where the files go; may be one of them.
    command
        What is done, for the record.

    Returns
    -------
    pandas.DataFrame
        Learning curves of all runs, by task, terrain, net and seed.

    Raises
    ------
    ValueError
        When a directory is no sweep's, or two differ in iterations, batch or horizon.
    """
    sweeps = [read_sweep(folder) for folder in folders]
    first = sweeps[0].record
    for sweep in sweeps[1:]:
        for name in COMMON:
            here, there = first["config"][name], sweep.record["config"][name]
            if here != there:
                raise ValueError(
                    f"{name} is {here} in {str(sweeps[0].folder)!r} but {there} in "
                    f"{str(sweep.folder)!r}: merge sweeps of one budget."
                )
    source: dict[str, Swept] = {}
    for sweep in sweeps:
        for name in sweep.curves:
            source.setdefault(name, sweep)
    if not source:
        raise ValueError(f"no run in {', '.join(map(str, folders))} is finished.")
    table = pd.concat([sweep.curves[name] for name, sweep in source.items()])
    table = table.sort_values([*GRID_COLUMNS, "iteration"], ignore_index=True)
    grid = {name: sorted(table[name].unique().tolist()) for name in GRID_COLUMNS}
    makers: list[dict[str, Any]] = []
    runs = []
    for name in sorted(source):
        own = source[name].record
        run = next(r for r in own["runs"] if r["run"] == name)
        maker = own["made_by"][run["made_by"]]
        if maker not in makers:
            makers.append(maker)
        runs.append({**run, "made_by": makers.index(maker)})
    record = {k: v for k, v in first.items() if k != "compared_columns"} | {
        "command": command,
        "config": {
            name: value
            for name, value in first["config"].items()
            if all((name, value) in s.record["config"].items() for s in sweeps)
        },
        "grid": grid,
        "made_by": makers,
        "runs": runs,
    }
    target = writable_directory(out)
    policies = {name: source[name].policies[name] for name in sorted(source)}
    write_tensors({"format": FORMAT, "policies": policies}, target / "policies.pt")
    for name in COMPARISONS.values():
        (target / name).unlink(missing_ok=True)
    write_tables(table, record, target)
    return table
