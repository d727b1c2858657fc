"""Trained policies in one small file, which the book can carry.

Such a file holds what training changed, a parameter vector a run, beside the settings from
which the rest is made again: an echo state network's reservoir comes from its seed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

from thesis_lib.training.checkpoint import write_tensors
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.run import Best, Training

FORMAT = 1
"""Format of the file."""


def write_policies(runs: Sequence[tuple[str, Path]], path: Path | str) -> dict[str, str]:
    """Put the policies of runs into one file; one that cannot be read leaves the others alone.

    Parameters
    ----------
    runs
        A name for each run, and the directory of its checkpoint.
    path
        The file, such as ``policies.pt``.

    Returns
    -------
    dict
        Why a run's policy is left out, by name.
    """
    policies: dict[str, Any] = {}
    unread: dict[str, str] = {}
    for name, directory in runs:
        try:
            run = Training.load(directory)
        except ValueError as error:
            unread[name] = str(error)
            continue
        policies[name] = {
            "config": dataclasses.asdict(run.config),
            "iteration": run.iteration,
            "parameters": run.policy.parameter_vector(),
            "best": None if run.best is None else vars(run.best),
        }
    write_tensors({"format": FORMAT, "policies": policies}, Path(path))
    return unread


class TrainedPolicies:
    """The policies of a file that ``thesis sweep`` wrote.

    Parameters
    ----------
    path
        Such as ``results/trained/policies.pt``.

    Raises
    ------
    FileNotFoundError
        When there is no such file.
    ValueError
        When it is not one of these files, or has another format.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        if not self.path.is_file():
            raise FileNotFoundError(
                f"there is no file of policies at {str(path)!r}: make one with `thesis sweep`."
            )
        try:
            content = torch.load(self.path, weights_only=True)
            found, self._policies = content["format"], dict(content["policies"])
        except Exception as error:  # torch raises many kinds for a file that is not its own
            raise ValueError(
                f"{str(path)!r} is not a file of policies of `thesis sweep`."
            ) from error
        if found != FORMAT:
            raise ValueError(
                f"{str(path)!r} has format {found}, but this version of thesis_lib reads format "
                f"{FORMAT}: sweep again, or use the version that wrote it."
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the runs, such as ``hopper-flat-gru-0-float32``."""
        return tuple(self._policies)

    def load(self, name: str) -> Training:
        """A run with its trained policy; what else training had learned is not there.

        Parameters
        ----------
        name
            One of :attr:`names`.

        Raises
        ------
        ValueError
            When there is no such run, or it does not fit this version of the library.
        """
        if name not in self._policies:
            raise ValueError(
                f"run {name!r} is not in {str(self.path)!r}: choose one of {', '.join(self.names)}."
            )
        kept = self._policies[name]
        try:
            run = Training(TrainConfig(**kept["config"]))
            run.policy.set_parameter_vector(kept["parameters"])
            run.policy.check_finite()
            run.iteration = int(kept["iteration"])
            # Files of the first kind hold the last policies alone.
            run.best = Best(**kept["best"]) if kept.get("best") else None
        except (
            AttributeError,
            FloatingPointError,
            KeyError,
            RuntimeError,
            TypeError,
            ValueError,
        ) as error:
            cause = f"it has no {error}" if isinstance(error, KeyError) else str(error).rstrip(".")
            raise ValueError(
                f"run {name!r} in {str(self.path)!r} does not fit this version of thesis_lib "
                f"({cause}): sweep again, or use the version that wrote it."
            ) from error
        return run
