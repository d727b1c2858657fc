"""Experiments of chapter 5."""

from thesis_lib.experiments.base import Experiment

EXPERIMENTS: tuple[Experiment, ...] = ()
