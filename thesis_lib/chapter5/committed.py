"""Learning curves of long runs that are committed with the book (section 5.5.1)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from scipy import stats

from thesis_lib.edition import plots
from thesis_lib.edition.experiment import Context, Experiment, experiment
from thesis_lib.edition.saved import saved
from thesis_lib.edition.words import several
from thesis_lib.training.config import TrainConfig, head_scale
from thesis_lib.training.curves import CURVES_COLUMNS

COLUMNS: Mapping[str, str] = {
    name: CURVES_COLUMNS[name]
    for name in (
        *("task", "terrain", "architecture", "seed", "precision", "variant", "iteration", "steps"),
        *("mean_return", "std_return", "episodes", "kl", "accepted"),
        *("sampling_seconds", "update_seconds", "wall_seconds"),
    )
}
"""Columns of committed curves that the page needs."""

AUTHORS_TIME_CONSTANT = 1.0
"""Initial time constants of the CTRNN in the author's code, in seconds."""


@dataclass(frozen=True)
class Config:
    """Which committed results are read."""

    names: tuple[str, ...]
    """Paths below ``results`` without a suffix."""


def experiment_of(
    identifier: str, name: str, title: str, columns: Mapping[str, str] = COLUMNS
) -> Experiment[Config]:
    """The experiment that reads committed curves, the same at every budget and for every seed.

    Parameters
    ----------
    identifier
        Of the experiment.
    name
        Path below ``results`` without a suffix.
    title
        One line on what is measured.
    columns
        Meaning of the columns that are kept.
    """

    def curves(config: Config, context: Context) -> pd.DataFrame:
        tables = [saved(name).table[list(columns)] for name in config.names]
        return pd.concat(tables, ignore_index=True)

    curves.__doc__ = title
    read = Config((name,))
    return experiment(
        identifier, item="Section 5.5.1", smoke=read, book=read, seconds=0.01, columns=columns
    )(curves)


def commits(provenance: Mapping[str, Any]) -> str:
    """From which commits the runs of a sweep were made, in words.

    Parameters
    ----------
    provenance
        Of the sweep; each of its ``runs`` names its ``commit``, or the entry of ``made_by`` that
        does.
    """
    makers = provenance.get("made_by", ())
    of = [
        run["commit"] if "commit" in run else makers[run["made_by"]]["commit"]
        for run in provenance["runs"]
    ]
    count = pd.Series(of).value_counts()
    most = f"{count.iloc[0]} of its {len(of)} runs at commit {count.index[0]}"
    if len(count) == 1:
        return most
    changed = sum(commit.endswith("+") for commit in of)
    marks = f"; a + after one, as {changed} of them have, marks changes not committed"
    return (
        f"{most}, the others at {len(count) - 1} more; the record beside the curves names each "
        f"run's{marks if changed else ''}"
    )


def time_constant(provenance: Mapping[str, Any]) -> float:
    """Initial time constants of a sweep's default CTRNN in seconds.

    A record has what all its runs share.  Where a variant changes the time constant it has none,
    and the default is the author's, as it was of all sweeps before the calibration.
    """
    return float(provenance["config"].get("time_constant", AUTHORS_TIME_CONSTANT))


def former(*names: str) -> str:
    """How the defaults of committed sweeps differ from those of today, net by net; or nothing.

    Parameters
    ----------
    names
        Paths below ``results`` without a suffix.
    """
    apart: dict[str, dict[str, None]] = {}
    for name in names:
        sweep = saved(name)
        scale = {run["run"]: run.get("head_scale", 1.0) for run in sweep.provenance["runs"]}
        for net in sweep.table.architecture.unique():
            now = TrainConfig(architecture=net)
            then = time_constant(sweep.provenance)
            if net == "ctrnn" and then != now.time_constant:
                words = f"time constants of {then:g} s (now {now.time_constant:g} s)"
                apart.setdefault(words, {})[net.upper()] = None
            plain = re.compile(rf".*-{net}-\d+-float\d\d")
            scales = {s for run, s in scale.items() if plain.fullmatch(run)}
            if scales and scales != {head_scale(now)}:
                words = (
                    f"output weights at {min(scales):g} of their scale (now {head_scale(now):g})"
                )
                apart.setdefault(words, {})[net.upper()] = None
    return "; ".join(f"{several(nets)} with {words}" for words, nets in apart.items())


def band(
    ax: Axes, curves: pd.DataFrame, iteration: str, colour: str, label: str, style: str = "-"
) -> None:
    """Mean of the seeds' curves with its 95% Student interval."""
    by = curves.groupby(iteration).mean_return
    table = pd.DataFrame({"mean_return": by.mean()})
    table["ci95"] = by.sem() * stats.t.ppf(0.975, by.count() - 1)
    table["steps"] = curves.groupby(iteration).steps.mean() / 1000
    plots.band(ax, table, "steps", color=colour, label=label, ls=style, lw=1.4)
