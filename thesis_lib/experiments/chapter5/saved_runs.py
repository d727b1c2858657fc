"""Learning curves of long runs, as committed with the book (section 5.5.1)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import pandas as pd

from thesis_lib.edition.experiment import Context, Experiment
from thesis_lib.edition.saved import saved
from thesis_lib.training.curves import CURVES_COLUMNS, PAIRED_COLUMNS, compared

COLUMNS = (
    *("task", "terrain", "architecture", "seed", "precision", "iteration", "steps"),
    *("mean_return", "std_return", "episodes", "kl", "accepted"),
    *("sampling_seconds", "update_seconds", "wall_seconds"),
)
"""Columns of the committed curves that the page needs."""


OPTIONS = ("dtrnn", "ctrnn", "esn", "previous_action", "dffwd", "softplus")
"""Sweeps of settings, folders of ``results/options``."""

PEERS_COLUMNS: Mapping[str, str] = {
    "task": "robot",
    "bound": "nats: both bound the divergence by .05; dimension: by .05 an action dimension",
    "side": "ours (neural baseline), linear (ours, linear baseline) or peer (sb3-contrib's TRPO)",
    "seed": "seed of the run",
    "batch": "batches so far",
    "steps": "steps asked for so far; whole episodes of ours take a little more",
    "mean_return": "mean return of the batch's episodes; of the peer, of those that ended in it",
}
"""Columns of the comparison with another library, which ``benchmarks/sb3_learners.py`` makes."""


@dataclass(frozen=True)
class SavedConfig:
    """Which committed results are read."""

    names: tuple[str, ...]
    """Paths below ``results`` without a suffix."""
    columns: tuple[str, ...]
    """Columns that are kept."""


def read(config: SavedConfig, context: Context) -> pd.DataFrame:
    """The committed tables one after the other, the same at every budget and for every seed."""
    tables = [saved(name).table[list(config.columns)] for name in config.names]
    return pd.concat(tables, ignore_index=True)


def compare(config: SavedConfig, context: Context) -> pd.DataFrame:
    """Each committed sweep's variants against its default; p-values are Holm's for a sweep."""
    tables = [compared(saved(name).table, "variant") for name in config.names]
    return pd.concat(tables, ignore_index=True)[list(config.columns)]


def _experiment(
    identifier: str,
    names: tuple[str, ...],
    columns: Mapping[str, str],
    title: str,
    function: Callable[[SavedConfig, Context], pd.DataFrame] = read,
) -> Experiment[SavedConfig]:
    config = SavedConfig(names, tuple(columns))
    return Experiment(
        id=identifier,
        item="Section 5.5.1",
        title=f"{title} (committed with the book)",
        function=function,
        budgets={"smoke": config, "book": config, "thesis": config},
        columns=dict(columns),
        seconds={"smoke": 0.1, "book": 0.1, "thesis": 0.1},
    )


_CURVES = {column: CURVES_COLUMNS[column] for column in COLUMNS}

SECTION_5_5_1_CURVES = _experiment(
    "section-5.5.1-curves",
    ("learning/curves",),
    _CURVES,
    "Learning curves of nine networks on the five flat tasks",
)

SECTION_5_5_1_PRECISION = _experiment(
    "section-5.5.1-precision",
    ("precision/curves",),
    _CURVES,
    "Learning curves with networks in float32 and in float64",
)

SECTION_5_5_1_OPTIONS = _experiment(
    "section-5.5.1-options",
    tuple(f"options/{name}/curves" for name in OPTIONS),
    PAIRED_COLUMNS,
    "Returns with settings changed one at a time",
    compare,
)

SECTION_5_5_1_PEERS = _experiment(
    "section-5.5.1-peers",
    ("peers/curves",),
    PEERS_COLUMNS,
    "Learning curves of TRPO, ours and sb3-contrib's",
)
