"""Trained policies: read from a run's checkpoint, or from one small file the book can carry.

Such a file holds what training changed, a parameter vector a run, beside the settings from
which the rest is made again: an echo state network's reservoir comes from its seed.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from thesis_lib.policies import GaussianPolicy
from thesis_lib.training.checkpoint import foreign, read_checkpoint, write_tensors
from thesis_lib.training.config import TrainConfig, renamed
from thesis_lib.training.parts import make_run_policy

FORMAT = 1
"""Format of the file."""

LAST = 5
"""Batches whose mean return says how well a net did at the end."""


@dataclass(frozen=True)
class Best:
    """The policy of the best batch of a run.

    Attributes
    ----------
    iteration
        Which batch that was, from 1.
    mean_return
        Mean return of its episodes.
    parameters
        What the policy that collected it had learned (``parameter_vector``).
    """

    iteration: int
    mean_return: float
    parameters: torch.Tensor


@dataclass
class Trained:
    """What training came to.

    Attributes
    ----------
    config
        The run.
    policy
        As the last iteration left it.
    iteration
        Iterations done.
    best
        The policy of the best batch, None where it was not kept.
    last_return
        Mean return of the last :data:`LAST` batches, NaN where it was not kept.
    """

    config: TrainConfig
    policy: GaussianPolicy
    iteration: int
    best: Best | None
    last_return: float = math.nan


def read_trained(path: Path | str) -> Trained:
    """The policy in a checkpoint, or in the one of a directory.

    Raises
    ------
    FileNotFoundError
        When there is no checkpoint.
    ValueError
        When it cannot be read, has another format or lacks something.
    """
    content = read_checkpoint(path)
    config = saved_config(content, path)
    policy = make_run_policy(config)
    take_up_policy(policy, content, path)
    last = [row["mean_return"] for row in content["rows"][-LAST:]]
    last_return = sum(last) / len(last) if last else math.nan
    best = saved_best(content, path)
    return Trained(config, policy, content["iteration"], best, last_return)


def saved_config(content: Mapping[str, Any], path: Path | str) -> TrainConfig:
    """The run a checkpoint is of; ValueError where this version has no such settings."""
    try:
        return TrainConfig(**renamed(content["config"]))
    except (TypeError, ValueError) as error:
        what = f"a setting this version does not have ({str(error).rstrip('.')})"
        raise foreign(path, what) from error


def take_up_policy(policy: GaussianPolicy, content: Mapping[str, Any], path: Path | str) -> None:
    """Set a policy to what a checkpoint holds; ValueError where that does not fit it."""
    try:
        policy.load_state_dict(content["policy"])
    except RuntimeError as error:
        net = content["config"]["architecture"]
        raise foreign(path, f"parameters that are not those of {net}") from error
    try:
        policy.check_finite()
    except FloatingPointError as error:
        raise foreign(path, "a parameter that is not finite") from error


def saved_best(content: Mapping[str, Any], path: Path | str) -> Best | None:
    """The policy of the best batch in a checkpoint."""
    try:
        return None if content["best"] is None else Best(**content["best"])
    except (KeyError, TypeError) as error:
        raise foreign(path, "no policy of its best batch") from error


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
            run = read_trained(directory)
        except (FileNotFoundError, ValueError) as error:
            unread[name] = str(error)
            continue
        policies[name] = {
            "config": dataclasses.asdict(run.config),
            "iteration": run.iteration,
            "parameters": run.policy.parameter_vector(),
            "best": None if run.best is None else vars(run.best),
            "last_return": run.last_return,
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

    def load(self, name: str) -> Trained:
        """What a run came to.

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
            config = TrainConfig(**renamed(kept["config"]))
            policy = make_run_policy(config)
            policy.set_parameter_vector(kept["parameters"])
            policy.check_finite()
            # The first of these files held the last policies alone.
            best = Best(**kept["best"]) if kept.get("best") else None
            last_return = kept.get("last_return", math.nan)
            return Trained(config, policy, int(kept["iteration"]), best, last_return)
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
