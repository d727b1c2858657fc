"""Learning curves of a sweep: merged, summarised, compared, written with their provenance."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from thesis_lib.checkout import environment
from thesis_lib.files import replacing, writable_directory, write_json
from thesis_lib.stats import holm, mean_ci
from thesis_lib.training.columns import columns
from thesis_lib.training.config import TrainConfig, differences
from thesis_lib.training.grid import GRID, GRID_COLUMNS, key, run_name
from thesis_lib.training.run import CURVE_COLUMNS, TIMING_COLUMNS
from thesis_lib.training.trained import LAST, write_policies

MARGIN = 0.1
"""Difference of two mean returns, as a share of the second, that counts as none."""

_OF_A_RUN_ALONE = ("min_return", "max_return", "surrogate", "step_norm", "residual", "simulated")
CURVES_COLUMNS: Mapping[str, str] = {
    **GRID_COLUMNS,
    **{name: words for name, words in CURVE_COLUMNS.items() if name not in _OF_A_RUN_ALONE},
}
"""Meaning and unit of each column of the merged curves, one row an iteration of a run."""

SUMMARY_COLUMNS: Mapping[str, str] = {**GRID_COLUMNS, **columns("summary", last=LAST)}
"""Meaning and unit of each column of :func:`summary`, one row a run."""


def progress(config: TrainConfig, runs: Path | str) -> int:
    """Iterations a run has kept on the disk, 0 when its directory has none of this run."""
    record = _record(config, runs)
    return 0 if record is None else int(record["iteration"])


def _record(config: TrainConfig, runs: Path | str) -> dict[str, Any] | None:
    file = Path(runs) / run_name(config) / "run.json"
    if not file.exists():
        return None
    record: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return None if differences(record, config) else record


def finished(record: Mapping[str, Any]) -> list[str]:
    """Names of the runs that a sweep's record (``curves.json``) calls finished."""
    last = record["config"].get("iterations")
    return [r["run"] for r in record["runs"] if r["iteration"] == last and "error" not in r]


def only_in(out: Path | str, kept: Iterable[str]) -> list[str]:
    """Finished runs of which the tables in a directory tell and that are not among those kept."""
    file = Path(out) / "curves.json"
    if not file.is_file():
        return []
    own = set(kept)
    record = json.loads(file.read_text(encoding="utf-8"))
    return [name for name in finished(record) if name not in own]


def merged(configs: Sequence[TrainConfig], runs: Path | str) -> pd.DataFrame:
    """Learning curves of all runs, as far as each has come.

    Returns
    -------
    pandas.DataFrame
        Columns as in :data:`CURVES_COLUMNS`, one row an iteration of a run.
    """
    parts = []
    for config in configs:
        if _record(config, runs) is not None:
            curve = pd.read_csv(Path(runs) / run_name(config) / "curve.csv")
            parts.append(curve.assign(**key(config)))
    columns = list(CURVES_COLUMNS)
    parts = [p for p in parts if len(p)]
    return pd.concat(parts, ignore_index=True)[columns] if parts else pd.DataFrame(columns=columns)


def summary(curves: pd.DataFrame, last: int = LAST) -> pd.DataFrame:
    """What each run came to.

    Parameters
    ----------
    curves
        From :func:`merged`.
    last
        Batches whose mean return says how well a net did at the end.

    Returns
    -------
    pandas.DataFrame
        Columns as in :data:`SUMMARY_COLUMNS`, one row a run.
    """
    records = []
    for run, curve in curves.groupby(list(GRID_COLUMNS), sort=False):
        returns, steps = curve.mean_return, int(curve.steps.iloc[-1])
        seconds = curve.sampling_seconds.sum() + curve.update_seconds.sum()
        records.append(
            {
                **dict(zip(GRID_COLUMNS, run, strict=True)),
                "iterations": len(curve),
                "steps": steps,
                "first_return": returns.iloc[0],
                "last_return": returns.tail(last).mean(),
                "best_return": returns.max(),
                "average_return": returns.mean(),
                "rejected": int((~curve.accepted.astype(bool)).sum()),
                "steps_per_second": steps / seconds,
                "wall_seconds": curve.wall_seconds.sum(),
            }
        )
    return pd.DataFrame(records, columns=list(SUMMARY_COLUMNS))


PAIRED_COLUMNS: Mapping[str, str] = {
    **{name: GRID_COLUMNS[name] for name in ("task", "terrain", "architecture")},
    **columns("paired", margin=MARGIN),
}
"""Meaning and unit of each column of :func:`compared`."""


COMPARISONS: Mapping[str, str] = {"precision": "precision.csv", "variant": "variants.csv"}
"""Files that :func:`write` makes for what it compares."""


def compared(curves: pd.DataFrame, column: str) -> pd.DataFrame:
    """Paired tests of the return over the curve: what a number type or a variant changes.

    Parameters
    ----------
    curves
        From :func:`merged`.
    column
        ``precision`` (float32 against float64) or ``variant`` (each against the first).

    Returns
    -------
    pandas.DataFrame
        Columns as in :data:`PAIRED_COLUMNS`, one row for each net, task, terrain and
        change that has at least 2 seeds on both sides.
    """
    runs = summary(curves)
    rest = [c for c in GRID_COLUMNS if c not in (column, "seed")]
    records = []
    for _, group in runs.groupby(rest, sort=False):
        # Only curves of the same length can be averaged over and compared.
        longest = group[group.iterations == group.iterations.max()]
        values = list(dict.fromkeys(longest[column]))
        reference = "float64" if column == "precision" else values[0]
        table = longest.pivot(index="seed", columns=column, values="average_return")
        for changed in (v for v in values if v != reference):
            if reference not in table:
                continue
            pairs = table[[changed, reference]].dropna()
            if len(pairs) < 2:
                continue
            names = {c: group[c].iloc[0] for c in ("task", "terrain", "architecture")}
            names |= {"changed": changed, "reference": reference}
            records.append(names | _paired(pairs[changed], pairs[reference]))
    found = pd.DataFrame(records, columns=list(PAIRED_COLUMNS))
    return found.assign(p_holm=holm(found.p_difference) if len(found) else [])


def _paired(changed: pd.Series, reference: pd.Series) -> dict[str, float]:
    """Statistics of two samples with the same seeds."""
    difference = (changed - reference).to_numpy()
    interval = mean_ci(difference)
    margin = MARGIN * abs(float(reference.mean()))
    return {
        "n": len(difference),
        "mean_changed": changed.mean(),
        "mean_reference": reference.mean(),
        "difference": interval.mean,
        "low": interval.mean - interval.half_width,
        "high": interval.mean + interval.half_width,
        "p_difference": _one_sample(difference, 0.0, "two-sided"),
        "p_equivalence": max(
            _one_sample(difference, -margin, "greater"),
            _one_sample(difference, margin, "less"),
        ),
    }


def _one_sample(values: np.ndarray, centre: float, alternative: str) -> float:
    """p-value of the t-test that the mean of the values is ``centre``."""
    if np.ptp(values) == 0:  # the test divides by the deviation
        gap = values[0] - centre
        agrees = {"two-sided": gap == 0, "greater": gap <= 0, "less": gap >= 0}
        return float(agrees[alternative])
    return float(stats.ttest_1samp(values, centre, alternative=alternative).pvalue)


def made(found: Mapping[str, Any]) -> dict[str, Any]:
    """What a run's record says made it."""
    kept = ("code", "commit", "python", "versions", "machine", "continued_from")
    return {name: found[name] for name in kept if name in found}


def write(
    configs: Sequence[TrainConfig],
    runs: Path | str,
    out: Path | str,
    *,
    command: str,
    errors: Mapping[str, str] | None = None,
) -> pd.DataFrame:
    """Merge the runs and write ``curves.csv`` with its provenance ``curves.json``.

    The table is the same, byte for byte, however often the sweep was stopped; what it took
    stands in ``curves.seconds.csv``, row by row.  Each run has the provenance of its own: the
    entry of ``made_by`` whose number it names.  With both number types ``precision.csv`` is
    written too, with variants ``variants.csv``, and always ``policies.pt``, the policies as they
    are now (see :class:`~thesis_lib.training.trained.TrainedPolicies`).

    Parameters
    ----------
    configs
        The runs.
    runs
        Directory they are in.
    out
        Directory to write to.
    command
        What made them.
    errors
        What stopped runs, by :func:`run_name`.

    Returns
    -------
    pandas.DataFrame
        The merged curves.
    """
    folder = writable_directory(out)
    curves = merged(configs, runs)
    found = {run_name(c): _record(c, runs) or {} for c in configs}
    begun = [(name, Path(runs) / name) for name, own in found.items() if own]
    left_out = write_policies(begun, folder / "policies.pt")
    makers = list({json.dumps(made(r)): made(r) for r in found.values() if r}.values())
    numbers = {name: makers.index(made(r)) for name, r in found.items() if r}
    errors = left_out | dict(errors or {})
    record: dict[str, Any] = {
        "id": "curves",
        "title": "Learning curves of a sweep.",
        "command": command,
        "config": _shared(configs),
        "grid": {n: sorted({key(c)[n] for c in configs}) for n in GRID_COLUMNS},
        "made_by": makers,
        "runs": [_run_record(name, r, numbers, errors) for name, r in found.items()],
        "columns": {k: v for k, v in CURVES_COLUMNS.items() if k not in TIMING_COLUMNS},
        "seconds_columns": {k: CURVES_COLUMNS[k] for k in TIMING_COLUMNS},
        "table": "curves.csv",
    }
    write_tables(curves, record, folder)
    return curves


def write_tables(curves: pd.DataFrame, record: dict[str, Any], folder: Path) -> None:
    """Write merged curves, what is compared in them, and then their record.

    What the curves say themselves, and who writes them and when, is put into the record here.
    """
    spent = curves.sampling_seconds + curves.update_seconds
    record |= {
        "wall_seconds": round(float(curves.wall_seconds.sum()), 1),
        "processor_seconds": round(float(spent.sum()), 1),
        "rows": len(curves),
        "written": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "written_by": made(environment()),
    }
    timings = list(TIMING_COLUMNS)
    for name, table in (
        ("curves.csv", curves.drop(columns=timings)),
        ("curves.seconds.csv", curves[timings]),
    ):
        with replacing(folder / name) as temporary:
            table.to_csv(temporary, index=False, float_format="%.6g")
    for column, name in COMPARISONS.items():
        if len(record["grid"][column]) > 1:
            record["compared_columns"] = dict(PAIRED_COLUMNS)
            with replacing(folder / name) as temporary:
                compared(curves, column).to_csv(temporary, index=False, float_format="%.6g")
    write_json(folder / "curves.json", record)


def _shared(configs: Sequence[TrainConfig]) -> dict[str, Any]:
    """Settings all runs of the sweep have."""
    settings = [dataclasses.asdict(c) for c in configs]
    return {
        name: value
        for name, value in settings[0].items()
        if name not in GRID and all(s[name] == value for s in settings)
    }


def _run_record(
    name: str,
    found: Mapping[str, Any],
    numbers: Mapping[str, int],
    errors: Mapping[str, str],
) -> dict[str, Any]:
    kept: dict[str, Any] = {"run": name, "iteration": 0}
    kept |= {
        k: found[k] for k in ("iteration", "delta_kl", "head_scale", "parameters") if k in found
    }
    if name in numbers:
        kept["made_by"] = numbers[name]
    if name in errors:
        kept["error"] = errors[name]
    return kept
