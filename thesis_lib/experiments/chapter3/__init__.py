"""Experiments of chapter 3, Learning Potential Functions for Multi-Task RL."""

from typing import Any

from thesis_lib.edition.experiment import Experiment
from thesis_lib.experiments.chapter3.beyond import ALPHA, LEARNERS, SCALING, TWO_VALUES
from thesis_lib.experiments.chapter3.continuing_cliff import (
    FIGURE_3_1,
    FIGURE_3_2,
    FIGURE_3_2_RUNS,
    HUDDLE,
    SARSA_SOLUTION,
)
from thesis_lib.experiments.chapter3.q_mu_row import Q_MU_ROW
from thesis_lib.experiments.chapter3.section_3_3 import LEVELS, MU_STAR, WEIGHTINGS_COMPARED
from thesis_lib.experiments.chapter3.sweeps import FIGURE_3_3, FIGURE_3_4
from thesis_lib.experiments.chapter3.table_3_1 import TABLE_3_1, TABLE_3_1_FIT
from thesis_lib.experiments.chapter3.theorem_1 import THEOREM_1

EXPERIMENTS: tuple[Experiment[Any], ...] = (
    THEOREM_1,
    LEVELS,
    MU_STAR,
    WEIGHTINGS_COMPARED,
    TABLE_3_1,
    TABLE_3_1_FIT,
    Q_MU_ROW,
    ALPHA,
    LEARNERS,
    FIGURE_3_1,
    SARSA_SOLUTION,
    FIGURE_3_2,
    FIGURE_3_2_RUNS,
    HUDDLE,
    FIGURE_3_3,
    FIGURE_3_4,
    SCALING,
    TWO_VALUES,
)
