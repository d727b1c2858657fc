"""Experiments of chapter 5, Benchmarking Recurrent Architectures for Robust Continuous Control."""

from typing import Any

from thesis_lib.edition.experiment import Experiment
from thesis_lib.experiments.chapter5.architectures import (
    SECTION_5_2_2_INTEGRATORS,
    SECTION_5_2_5_EIGENVALUES,
    SECTION_5_2_GAIN,
    SECTION_5_2_RESPONSES,
)
from thesis_lib.experiments.chapter5.first_means import SECTION_5_4_FIRST_MEANS
from thesis_lib.experiments.chapter5.gaits import SECTION_5_5_2_GAITS
from thesis_lib.experiments.chapter5.live import SECTION_5_5_1_LIVE
from thesis_lib.experiments.chapter5.memory import SECTION_5_2_3_MEMORY, SECTION_5_2_5_RADIUS
from thesis_lib.experiments.chapter5.saved_runs import (
    SECTION_5_5_1_CURVES,
    SECTION_5_5_1_OPTIONS,
    SECTION_5_5_1_PEERS,
    SECTION_5_5_1_PRECISION,
)
from thesis_lib.experiments.chapter5.sizes import SECTION_5_4_SIZES
from thesis_lib.experiments.chapter5.time_constants import (
    SECTION_5_2_2_GRADIENTS,
    SECTION_5_2_2_STABILITY,
    SECTION_5_2_IDENTITIES,
)
from thesis_lib.experiments.chapter5.trained import (
    SECTION_5_2_2_TIME_CONSTANTS,
    SECTION_5_2_GAIN_TRAINED,
)
from thesis_lib.experiments.chapter5.untrained import BASELINE, METRONOME, NOISE, RECOVERY
from thesis_lib.experiments.chapter5.worlds import STARTS, TASKS, TERRAIN

EXPERIMENTS: tuple[Experiment[Any], ...] = (
    TASKS,
    TERRAIN,
    STARTS,
    BASELINE,
    RECOVERY,
    SECTION_5_2_IDENTITIES,
    SECTION_5_2_GAIN,
    SECTION_5_2_GAIN_TRAINED,
    SECTION_5_2_2_TIME_CONSTANTS,
    SECTION_5_2_RESPONSES,
    SECTION_5_2_2_INTEGRATORS,
    SECTION_5_2_2_GRADIENTS,
    SECTION_5_2_2_STABILITY,
    SECTION_5_2_3_MEMORY,
    SECTION_5_2_5_EIGENVALUES,
    SECTION_5_2_5_RADIUS,
    SECTION_5_4_SIZES,
    SECTION_5_4_FIRST_MEANS,
    SECTION_5_5_2_GAITS,
    NOISE,
    METRONOME,
    SECTION_5_5_1_LIVE,
    SECTION_5_5_1_CURVES,
    SECTION_5_5_1_OPTIONS,
    SECTION_5_5_1_PEERS,
    SECTION_5_5_1_PRECISION,
)
