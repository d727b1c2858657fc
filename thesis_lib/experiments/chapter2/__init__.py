"""Experiments of chapter 2."""

from thesis_lib.experiments.base import Experiment

EXPERIMENTS: tuple[Experiment, ...] = ()
