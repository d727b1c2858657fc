"""Experiments of chapter 2, Background."""

from typing import Any

from thesis_lib.edition.experiment import Experiment
from thesis_lib.experiments.chapter2.cliff_learning import (
    SECTION_2_3_3,
    SECTION_2_3_3_CONVERGENCE,
    SECTION_2_3_3_CURVE,
    SECTION_2_3_3_EXPLORATION,
)
from thesis_lib.experiments.chapter2.dynamic_programming import SECTION_2_3_2
from thesis_lib.experiments.chapter2.estimators import SECTION_2_3_4, SECTION_2_3_5
from thesis_lib.experiments.chapter2.policy_search import (
    SECTION_2_3_5_LANDSCAPE,
    SECTION_2_3_5_LEARNING,
    SECTION_2_3_5_SETTINGS,
    SECTION_2_3_5_STEPS,
)

EXPERIMENTS: tuple[Experiment[Any], ...] = (
    SECTION_2_3_2,
    SECTION_2_3_3,
    SECTION_2_3_3_CURVE,
    SECTION_2_3_3_EXPLORATION,
    SECTION_2_3_3_CONVERGENCE,
    SECTION_2_3_4,
    SECTION_2_3_5,
    SECTION_2_3_5_LEARNING,
    SECTION_2_3_5_SETTINGS,
    SECTION_2_3_5_LANDSCAPE,
    SECTION_2_3_5_STEPS,
)
