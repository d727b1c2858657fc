"""Experiments of appendix A, Stationary Memoryless Multi-Task Policies; all are exact."""

from typing import Any

from thesis_lib.edition.experiment import Experiment
from thesis_lib.experiments.appendix_a.fact_1 import FIGURE_A_1
from thesis_lib.experiments.appendix_a.fact_2 import FIGURE_A_2
from thesis_lib.experiments.appendix_a.policy_dependent import FIGURE_A_3, FIGURE_A_3_NUMBERS

EXPERIMENTS: tuple[Experiment[Any], ...] = (
    FIGURE_A_1,
    FIGURE_A_2,
    FIGURE_A_3,
    FIGURE_A_3_NUMBERS,
)
