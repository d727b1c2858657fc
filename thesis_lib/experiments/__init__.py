"""Experiments: one package a chapter, each a tuple ``EXPERIMENTS``.

They are imported when asked for, so that a notebook depends on its own chapter only.
"""

from __future__ import annotations

import difflib
from importlib import import_module
from typing import Any

from thesis_lib.experiments.base import Experiment

CHAPTERS = (
    "thesis_lib.experiments.chapter2",
    "thesis_lib.experiments.chapter3",
    "thesis_lib.experiments.appendix_a",
    "thesis_lib.experiments.chapter4",
    "thesis_lib.experiments.chapter5",
)


def experiments() -> dict[str, Experiment[Any]]:
    """All experiments by id, in the order of the thesis."""
    found: dict[str, Experiment[Any]] = {}
    for name in CHAPTERS:
        for experiment in import_module(name).EXPERIMENTS:
            if experiment.id in found:
                raise RuntimeError(f"two experiments are called {experiment.id!r}.")
            found[experiment.id] = experiment
    return found


def find(identifier: str) -> Experiment[Any]:
    """The experiment of an id.

    Raises
    ------
    ValueError
        With the nearest ids when there is none of that name.
    """
    known = experiments()
    if identifier not in known:
        near = difflib.get_close_matches(identifier, known, 3, 0.4) or list(known)[:3]
        raise ValueError(
            f"there is no experiment {identifier!r}: did you mean {' or '.join(near)}? "
            "`thesis list` shows all."
        )
    return known[identifier]
