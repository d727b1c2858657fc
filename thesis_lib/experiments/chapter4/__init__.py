"""Experiments of chapter 4, Relevant Representations for Multi-Task RL."""

from typing import Any

from thesis_lib.edition.experiment import Experiment
from thesis_lib.experiments.chapter4.calibration import CALIBRATION, ROC
from thesis_lib.experiments.chapter4.cost import COST, SCALE
from thesis_lib.experiments.chapter4.curves import FIGURE_4_1, FIGURE_4_2
from thesis_lib.experiments.chapter4.domains_compared import RELEVANCES
from thesis_lib.experiments.chapter4.functions import FUNCTION_LAW, FUNCTION_SELECTION
from thesis_lib.experiments.chapter4.heat import FIGURE_4_7, FIGURE_4_8
from thesis_lib.experiments.chapter4.heat_readings import HEAT_READINGS, HEAT_RELEVANCE
from thesis_lib.experiments.chapter4.readings import READINGS_COMPARED
from thesis_lib.experiments.chapter4.selection_figures import (
    EPISODIC,
    FIGURE_4_3,
    FIGURE_4_4,
    FIGURE_4_5,
    FIGURE_4_6,
)
from thesis_lib.experiments.chapter4.task_relevance import TASK_RELEVANCE
from thesis_lib.experiments.chapter4.theorems import (
    COROLLARY_1,
    COUNTEREXAMPLES,
    ESTIMATORS,
    LEMMA_3,
    LEMMAS,
    THEOREM_2,
    THEOREM_3,
)
from thesis_lib.experiments.chapter4.threshold import THRESHOLD

EXPERIMENTS: tuple[Experiment[Any], ...] = (
    FIGURE_4_1,
    FIGURE_4_2,
    THEOREM_2,
    COUNTEREXAMPLES,
    COROLLARY_1,
    THEOREM_3,
    LEMMAS,
    LEMMA_3,
    ESTIMATORS,
    COST,
    SCALE,
    THRESHOLD,
    RELEVANCES,
    READINGS_COMPARED,
    FIGURE_4_3,
    FIGURE_4_4,
    FIGURE_4_5,
    EPISODIC,
    FIGURE_4_6,
    HEAT_RELEVANCE,
    FIGURE_4_7,
    FIGURE_4_8,
    HEAT_READINGS,
    CALIBRATION,
    ROC,
    TASK_RELEVANCE,
    FUNCTION_LAW,
    FUNCTION_SELECTION,
)
