"""Experiments of appendix_a."""

from thesis_lib.experiments.base import Experiment

EXPERIMENTS: tuple[Experiment, ...] = ()
