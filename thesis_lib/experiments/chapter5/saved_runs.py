"""Learning curves of long runs, as committed with the book (section 5.5.1)."""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd

from thesis_lib.experiments.base import Context, Experiment
from thesis_lib.experiments.saved import saved
from thesis_lib.experiments.sweep import CURVES_COLUMNS

COLUMNS = (
    *("task", "terrain", "architecture", "seed", "precision", "iteration", "steps"),
    *("mean_return", "std_return", "episodes", "kl", "accepted"),
    *("sampling_seconds", "update_seconds", "wall_seconds"),
)
"""Columns of the committed curves that the page needs."""


@dataclass(frozen=True)
class SavedConfig:
    """Which committed result is read."""

    name: str
    """Path below ``results`` without a suffix."""


def read(config: SavedConfig, context: Context) -> pd.DataFrame:
    """The committed table, the same at every budget and for every seed."""
    return saved(config.name).table[list(COLUMNS)]


def _experiment(identifier: str, name: str, title: str) -> Experiment[SavedConfig]:
    config = SavedConfig(name)
    return Experiment(
        id=identifier,
        item="Section 5.5.1",
        title=title,
        function=read,
        budgets={"smoke": config, "book": config, "thesis": config},
        columns={column: CURVES_COLUMNS[column] for column in COLUMNS},
        seconds={"smoke": 0.1, "book": 0.1, "thesis": 0.1},
    )


SECTION_5_5_1_CURVES = _experiment(
    "section-5.5.1-curves",
    "learning/curves",
    "Learning curves of nine networks on the five flat tasks (committed with the book)",
)

SECTION_5_5_1_PRECISION = _experiment(
    "section-5.5.1-precision",
    "precision/curves",
    "Learning curves with networks in float32 and in float64 (committed with the book)",
)
