"""Experiments of chapter 5, Benchmarking Recurrent Architectures for Robust Continuous Control."""

from typing import Any

from thesis_lib.experiments.base import Experiment
from thesis_lib.experiments.chapter5.untrained import BASELINE, METRONOME, NOISE, RECOVERY
from thesis_lib.experiments.chapter5.worlds import STARTS, TASKS, TERRAIN

EXPERIMENTS: tuple[Experiment[Any], ...] = (
    TASKS,
    TERRAIN,
    STARTS,
    BASELINE,
    RECOVERY,
    NOISE,
    METRONOME,
)
