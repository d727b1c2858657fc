"""Experiments of chapter 3, Learning Potential Functions for Multi-Task RL."""

from typing import Any

from thesis_lib.experiments.base import Experiment
from thesis_lib.experiments.chapter3.continuing_cliff import (
    FIGURE_3_1,
    FIGURE_3_2,
    FIGURE_3_2_RUNS,
    HUDDLE,
    SARSA_SOLUTION,
)
from thesis_lib.experiments.chapter3.table_3_1 import TABLE_3_1, TABLE_3_1_FIT

EXPERIMENTS: tuple[Experiment[Any], ...] = (
    TABLE_3_1,
    TABLE_3_1_FIT,
    FIGURE_3_1,
    SARSA_SOLUTION,
    FIGURE_3_2,
    FIGURE_3_2_RUNS,
    HUDDLE,
)
