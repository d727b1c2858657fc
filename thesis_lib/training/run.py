r"""Train one policy on one task: the runs of section 5.4.

A run is a :class:`TrainConfig`.  Its iteration i draws everything random from the seed and
i alone, so that a run that was killed goes on from its last checkpoint to the same numbers
it would have reached without.
"""

from __future__ import annotations

import copy
import dataclasses
import time
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch

from thesis_lib.checkout import environment
from thesis_lib.checks import ForeseenError
from thesis_lib.files import replacing, writable_directory, write_json
from thesis_lib.optimisation import PPO, Learner, Rollouts, UpdateReport, collect
from thesis_lib.training.checkpoint import (
    FORMAT,
    check_made_with,
    code_digest,
    foreign,
    made_with,
    read_checkpoint,
    write_tensors,
)
from thesis_lib.training.config import SEED_KEYS, TrainConfig, differences, settled
from thesis_lib.training.parts import baseline, make_algorithm, make_batch_task, make_run_policy
from thesis_lib.training.trained import Best, saved_best, saved_config, take_up_policy

CURVE_COLUMNS: Mapping[str, str] = {
    "iteration": "iteration of the learning algorithm, from 1",
    "steps": "control steps learned from so far",
    "mean_return": "mean undiscounted return of the batch's episodes, under the stochastic policy",
    "std_return": "standard deviation of those returns",
    "min_return": "smallest of those returns",
    "max_return": "largest of those returns",
    "episodes": "episodes of the batch",
    "mean_length": "mean length of an episode in steps",
    "kl": "mean divergence between the old and the new policy, nats",
    "entropy": "entropy of the new policy, nats",
    "surrogate": "gain in the surrogate of equation 2.14",
    "step_norm": "norm of the change of the parameters",
    "accepted": "whether the policy moved",
    "backtracks": "times the line search shortened the step",
    "residual": "relative residual of conjugate gradient",
    "simulated": "control steps simulated for the batch, those thrown away included",
    "sampling_seconds": "processor seconds spent on collecting the batch",
    "update_seconds": "processor seconds spent on learning from it",
    "wall_seconds": "wall-clock seconds of the iteration",
}
"""Meaning and unit of each column of a learning curve."""

TIMING_COLUMNS = ("sampling_seconds", "update_seconds", "wall_seconds")
"""Columns that differ between two runs of the same config."""


class TrainingStopped(ForeseenError):  # noqa: N818 - it names what happened to the run
    """A number that is not finite, or a full disk, ended a run; the message says when and why."""


class Training:
    """A training run in progress.

    Parameters
    ----------
    config
        The run.

    Attributes
    ----------
    policy
        The policy as it is now.
    iteration
        Iterations done.
    best
        The policy that earned the highest mean return of a batch so far, None before the first.
    """

    def __init__(self, config: TrainConfig) -> None:
        self.config = config
        self.task = make_batch_task(config)
        self.policy = make_run_policy(config)
        self.learner = Learner(
            self.policy,
            make_algorithm(config),
            discount=config.discount,
            gae_lambda=config.gae_lambda,
            bootstrap=config.bootstrap,
            **baseline(config),
        )
        self.iteration = 0
        self.rows: list[dict[str, Any]] = []
        self.best: Best | None = None

    @property
    def curve(self) -> pd.DataFrame:
        """One row an iteration; columns in :data:`CURVE_COLUMNS`."""
        return pd.DataFrame(self.rows, columns=list(CURVE_COLUMNS))

    def _seed(self, use: str) -> np.random.SeedSequence:
        """Seed of one use in the coming iteration."""
        return np.random.SeedSequence(self.config.seed, spawn_key=(SEED_KEYS[use], self.iteration))

    def step(self) -> dict[str, Any]:
        """Collect a batch, learn from it and return the iteration's row of the curve.

        Raises
        ------
        TrainingStopped
            When a number is not finite.  The policy may be spoilt then.
        KeyboardInterrupt
            When it is interrupted; the run is then as it was before the iteration.
        """
        before = self.policy.parameter_vector()
        learner = copy.deepcopy(self._learner_state())
        done, best = self.iteration, self.best
        try:
            return self._step(before)
        except KeyboardInterrupt:
            # As if the iteration had not begun, so that the run can be saved.
            self.policy.set_parameter_vector(before)
            self.learner.baseline.load_state_dict(learner["baseline"])
            if isinstance(self.learner.algorithm, PPO):
                self.learner.algorithm.load_state_dict(learner["algorithm"])
            self.iteration, self.best = done, best
            del self.rows[done:]
            raise

    def _step(self, before: torch.Tensor) -> dict[str, Any]:
        wall, start = time.perf_counter(), time.process_time()
        try:
            self.task.reseed(self._seed("task"))
            generator = np.random.default_rng(self._seed("noise"))
            rollouts = collect(self.task, self.policy, self.config.batch_steps, generator)
            sampled = time.process_time()
            report = self.learner.improve(rollouts)
        except (FloatingPointError, np.linalg.LinAlgError) as error:
            raise TrainingStopped(
                f"training stopped in iteration {self.iteration + 1}: {error}"
            ) from error
        self.iteration += 1
        row = self._row(rollouts, report) | {
            "sampling_seconds": sampled - start,
            "update_seconds": time.process_time() - sampled,
            "wall_seconds": time.perf_counter() - wall,
        }
        self.rows.append(row)
        if self.best is None or row["mean_return"] > self.best.mean_return:
            self.best = Best(self.iteration, row["mean_return"], before)
        return row

    def _learner_state(self) -> dict[str, Any]:
        """What learning remembers besides the policy."""
        algorithm = self.learner.algorithm
        return {
            "baseline": self.learner.baseline.state_dict(),
            "algorithm": algorithm.state_dict() if isinstance(algorithm, PPO) else None,
        }

    def _row(self, rollouts: Rollouts, report: UpdateReport) -> dict[str, Any]:
        returns = rollouts.episode_returns
        before = self.rows[-1]["steps"] if self.rows else 0
        return {
            "iteration": self.iteration,
            "steps": before + rollouts.n_steps,
            "mean_return": float(returns.mean()),
            "std_return": float(returns.std()),
            "min_return": float(returns.min()),
            "max_return": float(returns.max()),
            "episodes": rollouts.n_episodes,
            "mean_length": float(rollouts.lengths.mean()),
            "kl": report.kl,
            "entropy": report.entropy,
            "surrogate": report.surrogate,
            "step_norm": report.step_norm,
            "accepted": report.accepted,
            "backtracks": report.backtracks,
            "residual": report.residual,
            "simulated": rollouts.n_simulated,
        }

    # ------------------------------------------------------------------- checkpoints
    def save(self, directory: Path | str) -> Path:
        """Write ``checkpoint.pt``, ``curve.csv`` and ``run.json``, each aside and renamed.

        Returns
        -------
        Path
            Of the checkpoint.

        Raises
        ------
        TrainingStopped
            When the disk is full; files that were there stay as they are.
        """
        try:
            return self._save(writable_directory(directory))
        except OSError as error:
            raise TrainingStopped(
                f"training stopped after iteration {self.iteration}, which could not be saved "
                f"({error.strerror}): make room, and give the same command again."
            ) from error

    @cached_property
    def _made(self) -> dict[str, Any]:
        """What made the run, by its state when it was first saved: a later commit is not its."""
        return {"made_with": made_with(), "made_by": {"code": code_digest(), **environment()}}

    def _save(self, folder: Path) -> Path:
        content = {
            "format": FORMAT,
            "config": dataclasses.asdict(self.config),
            **settled(self.config),
            "iteration": self.iteration,
            "policy": self.policy.state_dict(),
            **self._learner_state(),
            "rows": self.rows,
            "best": None if self.best is None else vars(self.best),
            **self._made,
        }
        path = folder / "checkpoint.pt"
        # In this order: what the record says is done is in the checkpoint.
        write_tensors(content, path)
        with replacing(folder / "curve.csv") as temporary:
            self.curve.to_csv(temporary, index=False)
        record = {
            "config": dataclasses.asdict(self.config),
            **settled(self.config),
            "parameters": self.policy.n_trainable,
            "iteration": self.iteration,
            "columns": dict(CURVE_COLUMNS),
            **self._made["made_by"],
        }
        write_json(folder / "run.json", record)
        return path

    @classmethod
    def load(
        cls, path: Path | str, config: TrainConfig | None = None, *, any_version: bool = True
    ) -> Training:
        """Take a run up where a checkpoint left it.

        Parameters
        ----------
        path
            A checkpoint, or the directory it is in.
        config
            The run that is asked for; it may ask for another number of iterations,
            other checkpoints or other threads, and for nothing else.
        any_version
            Whether a checkpoint made by other code or other versions of the libraries is
            taken up: its next numbers may then be others than they would have been.

        Raises
        ------
        FileNotFoundError
            When there is no checkpoint.
        ValueError
            When it cannot be read, has another format, lacks something or belongs to
            another run.
        """
        content = read_checkpoint(path)
        saved = saved_config(content, path)
        if not any_version:
            check_made_with(content, path)
        if config is not None:
            for name, (have, want) in differences(content, config).items():
                raise ValueError(
                    f"the checkpoint in {str(path)!r} was trained with {name} {have!r}, not "
                    f"{want!r}: choose another directory for this run (--out)."
                )
            if content["iteration"] > config.iterations:
                raise ValueError(
                    f"the checkpoint in {str(path)!r} has {content['iteration']} iterations "
                    f"already, more than the {config.iterations} asked for: ask for as many, or "
                    "choose another directory."
                )
        run = cls(config or saved)
        run._take_up(content, path)
        return run

    def _take_up(self, content: Mapping[str, Any], path: Path | str) -> None:
        """Set everything a run has learned from its checkpoint's content."""
        take_up_policy(self.policy, content, path)
        baseline, algorithm = self.learner.baseline, self.learner.algorithm
        step = np.zeros((1, self.policy.feature_size)), np.zeros(1, dtype=np.int64)
        try:
            baseline.load_state_dict(content["baseline"])
            fits = bool(np.isfinite(baseline.predict(*step)).all())
        except (AttributeError, KeyError, RuntimeError, TypeError, ValueError):
            fits = False
        if not fits:
            raise foreign(path, "a baseline that does not fit this run")
        if isinstance(algorithm, PPO):
            try:
                algorithm.load_state_dict(content["algorithm"])
            except (KeyError, TypeError, ValueError) as error:
                raise foreign(path, "no state of ppo") from error
        self.iteration = content["iteration"]
        self.rows = content["rows"]
        self.best = saved_best(content, path)
        whole = (r for r in self.rows if isinstance(r, dict) and "steps" in r)
        if [r.get("iteration") for r in whole] != list(range(1, self.iteration + 1)):
            raise foreign(path, f"another curve than that of its {self.iteration} iterations")
        self._take_up_makers(content)

    def _take_up_makers(self, content: Mapping[str, Any]) -> None:
        """Keep what made the run; what goes on with it in another version is named besides."""
        known = {name: content[name] for name in ("made_with", "made_by") if name in content}
        same = known.get("made_with") == made_with()
        if "made_by" in known and (same or self.iteration == self.config.iterations):
            self._made = known
        elif not same:
            # Checkpoints were without the commit at first.
            self._made["made_by"]["continued_from"] = known.get("made_by", known.get("made_with"))
