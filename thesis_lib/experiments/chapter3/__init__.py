"""Experiments of chapter 3."""

from thesis_lib.experiments.base import Experiment

EXPERIMENTS: tuple[Experiment, ...] = ()
