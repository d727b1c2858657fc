"""Experiments of chapter 4."""

from thesis_lib.experiments.base import Experiment

EXPERIMENTS: tuple[Experiment, ...] = ()
