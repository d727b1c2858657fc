r"""Train one policy on one task: the runs of section 5.4.

A run is a :class:`TrainConfig`.  Its iteration i draws everything random from the seed and
i alone, so that a run that was killed goes on from its last checkpoint to the same numbers
it would have reached without.
"""

from __future__ import annotations

import dataclasses
import fcntl
import hashlib
import json
import math
import os
import platform
import sys
import time
import typing
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from io import BytesIO
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from threadpoolctl import threadpool_limits

from thesis_lib.checkout import repository_root
from thesis_lib.edition.experiment import (
    check_seed,
    environment,
    replacing,
    writable_directory,
)
from thesis_lib.locomotion import BatchTask, make_task
from thesis_lib.locomotion.perturbations import SUBSETS
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.locomotion.terrain import hill_maps
from thesis_lib.optimisation import (
    PPO,
    TRPO,
    VPG,
    Learner,
    LinearBaseline,
    NaturalPG,
    Rollouts,
    UpdateReport,
    ValueNetwork,
    collect,
)
from thesis_lib.optimisation.problem import Algorithm
from thesis_lib.policies import ARCHITECTURES, DEEP_NETS, GaussianPolicy, make_policy
from thesis_lib.published import load as published

FORMAT = 3
"""Version of the checkpoints this library writes and reads."""

FILES = ("checkpoint.pt", "curve.csv", "run.json")
"""What a run keeps in its directory."""

TERRAINS = ("flat", "hill")
ALGORITHMS = ("trpo", "vpg", "natural", "ppo")
BASELINES = ("linear", "network")
FEATURES = ("thesis", "text", "literal", "code", "full")
SUBSET = "text"
"""The reading of table 5.1's feature subset that ``features="thesis"`` stands for."""
NARROWED = ("Swimmer", "Hopper")
"""Robots on which table 5.1 gives recurrent nets a subset of the sensors."""
PRECISIONS: Mapping[str, torch.dtype] = {"float32": torch.float32, "float64": torch.float64}

DUAN_DELTA: Mapping[str, float] = {"Swimmer": 0.1}
"""Step sizes of the nets that table 5.1 leaves out: it refers to Duan et al., whose text states
the swimmer's."""

OUR_DELTA = 0.05
"""The same for the other tasks, whose step sizes stand in a supplement we do not have.  Scripts of
Duan et al.'s group use this value."""

LOG_STD_RANGE = (-10.0, 10.0)
"""Where the logarithm of the actions' standard deviation may start."""

TASK_NAMES: Mapping[str, str] = {
    "swimmer": "Swimmer",
    "hopper": "Hopper",
    "halfcheetah": "HalfCheetah",
    "walker": "Walker2d",
    "walker2d": "Walker2d",
    "ant": "Ant",
}
"""Names under which a task is found; case, ``-`` and ``_`` do not matter."""

_PUBLISHED_TASKS = {
    "Swimmer": "swimmer",
    "Hopper": "hopper",
    "HalfCheetah": "half_cheetah",
    "Walker2d": "walker",
    "Ant": "ant",
}
_MAY_CHANGE = ("iterations", "checkpoint_every", "threads")
_NEEDS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "integrator": ("architecture", ("ctrnn",)),
    "time_constant": ("architecture", ("ctrnn",)),
    "constraint": ("architecture", ("ctrnn",)),
    "spectral_radius": ("architecture", ("esn",)),
    "density": ("architecture", ("esn",)),
    "leak": ("architecture", ("esn",)),
    "forget_bias": ("architecture", ("lstm",)),
    "gate_initialisation": ("architecture", ("gru", "lstm")),
    "time_constant_spread": ("architecture", ("ctrnn",)),
    "initialisation": ("architecture", ("ffwd", "dffwd", "dffwd-softplus", "ffwd-400")),
    "units": ("architecture", tuple(name for name in ARCHITECTURES if name not in DEEP_NETS)),
    "learning_rate": ("algorithm", ("vpg", "ppo")),
    "delta_kl": ("algorithm", ("trpo", "natural")),
    "cg_iterations": ("algorithm", ("trpo", "natural")),
    "damping": ("algorithm", ("trpo", "natural")),
    "kl_direction": ("algorithm", ("trpo",)),
    "difficulty": ("terrain", ("hill",)),
    "maps": ("terrain", ("hill",)),
}
_KEYS = {"task": 0, "noise": 1, "terrain": 2}


@dataclass(frozen=True)
class TrainConfig:
    """One training run; defaults from table 5.1, section 5.4 and the author's code."""

    task: str = "Hopper"
    """Swimmer, Hopper, HalfCheetah, Walker2d or Ant."""
    terrain: str = "flat"
    """flat, or hill: one map, drawn from the seed."""
    architecture: str = "dtrnn"
    """ffwd, dffwd, dtrnn, ctrnn, gru, lstm, esn, dffwd-softplus or ffwd-400."""
    seed: int = 0
    """All randomness comes from it."""
    iterations: int = 500
    """Iterations of the learning algorithm (tables average the first 500)."""
    batch_steps: int = 50_000
    """Steps of an iteration: whole episodes of at least this many together (Duan et al.)."""
    horizon: int = 500
    """Steps of an episode (Duan et al.)."""
    algorithm: str = "trpo"
    """trpo, vpg, natural or ppo."""
    delta_kl: float | None = None
    """Bound on the divergence in nats; default table 5.1; where it has no entry 0.05, and 0.1 for
    the swimmer."""
    learning_rate: float | None = None
    """Of vpg and ppo; default 0.01 and 0.0003."""
    discount: float = 0.99
    """gamma (Duan et al.)."""
    trace: float = 1.0
    """lambda of the advantage estimate; 1 is equation 2.12."""
    bootstrap: bool = False
    """Credit episodes cut at the horizon with the baseline; the author does not."""
    baseline: str = "linear"
    """linear (Duan et al.), or network: a neural one, fitted to lambda-returns."""
    cg_iterations: int = 10
    """Conjugate-gradient steps."""
    damping: float = 1e-5
    """Added to the diagonal of the Fisher matrix."""
    kl_direction: str = "old_new"
    """old_new (the author's code) or new_old (equation 2.14)."""
    features: str = "thesis"
    """What recurrent nets see of Hopper and Swimmer: a reading of table 5.1 (thesis, the default
    one; text, literal or code, see SUBSETS), or full."""
    difficulty: float = 0.5
    """Height of the hills in metres."""
    maps: int = 1
    """Number of hill maps the worlds share out; the author trained on one."""
    reading: str = "code"
    """code, text or duan: whose rewards and observations (see make_task)."""
    alive_bonus: float | None = None
    """Replaces the task's bonus for staying alive."""
    units: int | None = None
    """Hidden units of nets with one hidden layer; default section 5.4."""
    previous_action: bool | None = None
    """Whether the net sees its last action; default recurrent nets do."""
    integrator: str = "heun"
    """Of the CTRNN: heun (the author's "midpoint"), euler or midpoint."""
    time_constant: float = 1.0
    """Initial time constants of the CTRNN in seconds."""
    time_constant_spread: float = 1.0
    """Largest over smallest of them."""
    constraint: str = "clamp"
    """How the CTRNN's time constants stay above the step: clamp, softplus, exponential."""
    spectral_radius: float | None = None
    """Of the ESN; default table 5.1."""
    density: float | None = None
    """Of the ESN's recurrent weights; default table 5.1."""
    leak: float = 0.5
    """Of the ESN."""
    forget_bias: float = 1.0
    """Of the LSTM: constant added in its forget gate."""
    gate_initialisation: str | None = None
    """Law of a gated net's recurrent weights, glorot or orthogonal; default the author's: glorot
    for the GRU, orthogonal for the LSTM."""
    initial_log_std: float = 0.0
    """Start of the log standard deviation of the actions."""
    initialisation: str = "glorot"
    """Law of a feedforward net's initial weights: glorot (the author's code) or orthogonal."""
    head_scale: float = 1.0
    """What the initial weights of the output layer are multiplied with."""
    worlds: int | None = None
    """Worlds simulated side by side; default one for each episode of a full batch."""
    precision: str = "float32"
    """float32 or float64 networks, a neural baseline among them; physics, returns and the linear
    baseline are always float64."""
    threads: int = 1
    """Threads of the physics; the result does not depend on it."""
    checkpoint_every: int = 10
    """Iterations between checkpoints."""

    def __post_init__(self) -> None:
        check_seed(self.seed)
        for name, hint in typing.get_type_hints(TrainConfig).items():
            _check_kind(name, getattr(self, name), hint)
        object.__setattr__(self, "task", task_name(self.task))
        for name, allowed in (
            ("terrain", TERRAINS),
            ("architecture", tuple(ARCHITECTURES)),
            ("algorithm", ALGORITHMS),
            ("baseline", BASELINES),
            ("features", FEATURES),
            ("precision", tuple(PRECISIONS)),
        ):
            value = getattr(self, name)
            if value not in allowed:
                raise ValueError(
                    f"{name} {value!r} does not exist: choose one of {', '.join(allowed)}."
                )
        for name in ("iterations", "batch_steps", "horizon", "maps", "checkpoint_every"):
            value = getattr(self, name)
            if value < 1:
                raise ValueError(f"{name} is {value}, but it must be at least 1.")
        if self.worlds is not None and self.worlds < 1:
            raise ValueError(f"worlds is {self.worlds}, but at least 1 world is needed.")
        for name in ("delta_kl", "learning_rate"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} is {value}, but it must be positive.")
        low, high = LOG_STD_RANGE
        if not low <= self.initial_log_std <= high:
            raise ValueError(
                f"initial_log_std is {self.initial_log_std}, but it must be between {low:g} and "
                f"{high:g}: less noise explores nothing, and more is clipped from every action."
            )


_KINDS: Mapping[type, tuple[type, str]] = {
    bool: (bool, "True or False"),
    int: (Integral, "a whole number"),
    float: (Real, "a finite number"),
    str: (str, "text"),
}


def _check_kind(name: str, value: object, hint: Any) -> None:
    """Raise ValueError unless a setting is of its type, and finite; hints are T or T | None."""
    kinds = typing.get_args(hint) or (hint,)
    if value is None and len(kinds) > 1:
        return
    accepted, words = _KINDS[kinds[0]]
    if not isinstance(value, accepted) or (isinstance(value, Real) and not math.isfinite(value)):
        raise ValueError(f"{name} is {value!r}, but it must be {words}.")


def idle_settings(config: TrainConfig) -> dict[str, str]:
    """Settings that differ from their default and have no effect, with what they belong to."""
    default = TrainConfig()
    return {
        name: f"{by} {' or '.join(values)}"
        for name, (by, values) in _NEEDS.items()
        if getattr(config, name) != getattr(default, name) and getattr(config, by) not in values
    }


def task_name(name: str) -> str:
    """The robot's name for a task named in any spelling.

    Raises
    ------
    ValueError
        Naming the tasks there are.
    """
    plain = name.replace("_", "").replace("-", "").lower()
    if plain not in TASK_NAMES:
        raise ValueError(f"task {name!r} does not exist: choose one of {', '.join(ROBOTS)}.")
    return TASK_NAMES[plain]


def table_5_1(task: str, architecture: str, quantity: str) -> float | None:
    """A setting that table 5.1 or its caption prints, None where it prints none.

    Parameters
    ----------
    task
        Name of the robot.
    architecture
        Name of the net.
    quantity
        ``delta_kl``, ``spectral_radius`` or ``weight_density``.
    """
    table = published("table-5.1")
    chosen = table[
        (table.task == _PUBLISHED_TASKS[task])
        & (table.architecture == architecture.upper())
        & (table.quantity == quantity)
    ]
    return None if chosen.empty else float(chosen.value.iloc[0])


def default_directory(config: TrainConfig) -> Path:
    """Where a run goes unless asked otherwise; every task, terrain, net and seed has its own."""
    name = f"{config.task}-{config.terrain}-{config.architecture}-{config.seed}".lower()
    return repository_root() / "_build" / "runs" / name


def step_size(config: TrainConfig) -> float:
    """The bound on the divergence of a run: asked for, printed in table 5.1, or Duan et al.'s."""
    if config.delta_kl is not None:
        return config.delta_kl
    printed = table_5_1(config.task, config.architecture, "delta_kl")
    return DUAN_DELTA.get(config.task, OUR_DELTA) if printed is None else printed


def make_batch_task(config: TrainConfig) -> BatchTask:
    """The task of a run, in its worlds."""
    task = make_task(config.task, reading=config.reading, alive_bonus=config.alive_bonus)  # type: ignore[arg-type]
    n_worlds = config.worlds
    if n_worlds is None:
        n_worlds = max(1, min(100, config.batch_steps // config.horizon))
    terrain = None
    if config.terrain == "hill":
        seed = np.random.SeedSequence(config.seed, spawn_key=(_KEYS["terrain"],))
        maps = hill_maps(config.maps, config.difficulty, seed, robot=config.task)
        terrain = [maps[i % len(maps)] for i in range(n_worlds)]
    return BatchTask(
        task,
        n_worlds,
        threads=config.threads,
        seed=config.seed,
        terrain=terrain,
        max_episode_steps=config.horizon,
    )


def make_run_policy(config: TrainConfig, task: BatchTask) -> GaussianPolicy:
    """The policy of a run before training."""
    options: dict[str, Any] = {"initial_log_std": config.initial_log_std}
    # What a sweep sets for all its runs goes to the nets that have it.
    idle = idle_settings(config)
    if config.initialisation != "glorot" and "initialisation" not in idle:
        options["initialisation"] = config.initialisation
    if config.previous_action is not None:
        options["previous_action"] = config.previous_action
    if config.architecture == "ctrnn":
        options |= {
            "integrator": config.integrator,
            "time_constant": config.time_constant,
            "time_constant_spread": config.time_constant_spread,
            "constraint": config.constraint,
        }
    if config.architecture == "lstm":
        options["forget_bias"] = config.forget_bias
    if config.gate_initialisation is not None and "gate_initialisation" not in idle:
        options["initialisation"] = config.gate_initialisation
    if config.architecture == "esn":
        options["leak"] = config.leak
        for name, printed in (
            ("spectral_radius", "spectral_radius"),
            ("density", "weight_density"),
        ):
            asked = getattr(config, name)
            options[name] = table_5_1(config.task, "esn", printed) if asked is None else asked
    features = None
    recurrent = config.architecture in ("dtrnn", "ctrnn", "gru", "lstm", "esn")
    if recurrent and config.features != "full" and config.task in NARROWED:
        reading = SUBSET if config.features == "thesis" else config.features
        features = [int(i) for i in SUBSETS[reading][config.task]]
    return make_policy(
        config.architecture,
        task.observation_size,
        task.action_size,
        dt=task.task.robot.control_dt,
        seed=config.seed,
        units=None if "units" in idle else config.units,
        features=features,
        head_scale=config.head_scale,
        dtype=PRECISIONS[config.precision],
        **options,
    )


def _baseline(config: TrainConfig) -> dict[str, Any]:
    """The learner's baseline, and what it is fitted to."""
    if config.baseline == "linear":
        return {"baseline": LinearBaseline(), "targets": "returns"}
    network = ValueNetwork(seed=config.seed, dtype=PRECISIONS[config.precision])
    return {"baseline": network, "targets": "lambda"}


def make_algorithm(config: TrainConfig) -> Algorithm:
    """The rule a run learns by."""
    if config.algorithm == "vpg":
        return VPG(learning_rate=config.learning_rate or 0.01)
    if config.algorithm == "ppo":
        return PPO(learning_rate=config.learning_rate or 3e-4, seed=config.seed)
    if config.algorithm == "natural":
        return NaturalPG(
            delta=step_size(config),
            cg_iterations=config.cg_iterations,
            damping=config.damping,
        )
    return TRPO(
        delta=step_size(config),
        cg_iterations=config.cg_iterations,
        damping=config.damping,
        kl_direction=config.kl_direction,
    )


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


class TrainingStopped(RuntimeError):  # noqa: N818 - it names what happened to the run
    """A number that is not finite, or a full disk, ended a run; the message says when and why."""


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
        self.policy = make_run_policy(config, self.task)
        self.learner = Learner(
            self.policy,
            make_algorithm(config),
            discount=config.discount,
            trace=config.trace,
            bootstrap=config.bootstrap,
            **_baseline(config),
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
        return np.random.SeedSequence(self.config.seed, spawn_key=(_KEYS[use], self.iteration))

    def step(self) -> dict[str, Any]:
        """Collect a batch, learn from it and return the iteration's row of the curve.

        Raises
        ------
        TrainingStopped
            When a number is not finite.  The policy may be spoilt then.
        """
        wall, start = time.perf_counter(), time.process_time()
        before = self.policy.parameter_vector()
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

    def _save(self, folder: Path) -> Path:
        algorithm = self.learner.algorithm
        content = {
            "format": FORMAT,
            "config": dataclasses.asdict(self.config),
            "delta_kl": step_size(self.config),
            "iteration": self.iteration,
            "policy": self.policy.state_dict(),
            "baseline": self.learner.baseline.state_dict(),
            "algorithm": algorithm.state_dict() if isinstance(algorithm, PPO) else None,
            "rows": self.rows,
            "best": None if self.best is None else vars(self.best),
            "made_with": made_with(),
        }
        path = folder / "checkpoint.pt"
        # In this order: what the record says is done is in the checkpoint.
        write_tensors(content, path)
        with replacing(folder / "curve.csv") as temporary:
            self.curve.to_csv(temporary, index=False)
        with replacing(folder / "run.json") as temporary:
            record = {
                "config": dataclasses.asdict(self.config),
                "delta_kl": step_size(self.config),
                "parameters": self.policy.n_trainable,
                "iteration": self.iteration,
                "columns": dict(CURVE_COLUMNS),
                "code": code_digest(),
                **environment(),
            }
            temporary.write_text(json.dumps(record, indent=1) + "\n")
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
        try:
            saved = TrainConfig(**content["config"])
        except (TypeError, ValueError) as error:
            what = f"a setting this version does not have ({str(error).rstrip('.')})"
            raise _foreign(path, what) from error
        if not any_version:
            _check_made_with(content, path)
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
        try:
            self.policy.load_state_dict(content["policy"])
        except RuntimeError as error:
            raise _foreign(
                path, f"parameters that are not those of {self.config.architecture}"
            ) from error
        try:
            self.policy.check_finite()
        except FloatingPointError as error:
            raise _foreign(path, "a parameter that is not finite") from error
        baseline, algorithm = self.learner.baseline, self.learner.algorithm
        step = np.zeros((1, self.policy.feature_size)), np.zeros(1, dtype=np.int64)
        try:
            baseline.load_state_dict(content["baseline"])
            fits = bool(np.isfinite(baseline.predict(*step)).all())
        except (AttributeError, KeyError, RuntimeError, TypeError, ValueError):
            fits = False
        if not fits:
            raise _foreign(path, "a baseline that does not fit this run")
        if isinstance(algorithm, PPO):
            try:
                algorithm.load_state_dict(content["algorithm"])
            except (KeyError, TypeError, ValueError) as error:
                raise _foreign(path, "no state of ppo") from error
        self.iteration = content["iteration"]
        self.rows = content["rows"]
        try:
            self.best = None if content["best"] is None else Best(**content["best"])
        except (KeyError, TypeError) as error:
            raise _foreign(path, "no policy of its best batch") from error
        whole = (r for r in self.rows if isinstance(r, dict) and "steps" in r)
        if [r.get("iteration") for r in whole] != list(range(1, self.iteration + 1)):
            raise _foreign(path, f"another curve than that of its {self.iteration} iterations")


_CONTENT = {"config": dict, "iteration": int, "policy": dict, "baseline": dict, "rows": list}
"""What every checkpoint holds besides its format."""


_LEARNED_BY = ("locomotion", "policies", "optimisation")
"""Packages whose code decides the numbers of a run, besides this module's."""


@cache
def code_digest() -> str:
    """SHA-256, in hexadecimal, of all code that decides the numbers of a run."""
    library = Path(__file__).parents[1]
    files = [path for name in _LEARNED_BY for path in sorted((library / name).rglob("*.py"))]
    digest = hashlib.sha256()
    for path in (*files, Path(__file__)):
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def made_with() -> dict[str, str]:
    """What a run's numbers depend on besides its settings: code and versions."""
    needed = ("numpy", "torch", "mujoco", "gymnasium")
    versions = {name: metadata.version(name) for name in needed}
    return {"code": code_digest(), "python": platform.python_version(), **versions}


def _check_made_with(content: Mapping[str, Any], path: Path | str) -> None:
    """Raise ValueError unless a checkpoint was made by this code and these versions."""
    had = content.get("made_with") or {}
    for name, now in made_with().items():
        if had.get(name) != now:
            then = str(had.get(name, "unknown"))
            raise ValueError(
                f"the checkpoint in {str(path)!r} was made with {name} {then[:12]}, not "
                f"{now[:12]}, so that going on would mix two versions: go on all the same with "
                "--any-version, use the version that wrote it, or choose another directory."
            )


def write_tensors(content: object, path: Path) -> None:
    """Write what ``torch.save`` takes, aside and renamed.

    It goes by way of the memory: writing by itself, torch would not say why it cannot.
    """
    buffer = BytesIO()
    torch.save(content, buffer)
    with replacing(path) as temporary:
        temporary.write_bytes(buffer.getbuffer())


def _foreign(path: Path | str, what: str) -> ValueError:
    return ValueError(
        f"the checkpoint in {str(path)!r} has {what}: train again, or use the version of "
        "thesis_lib that wrote it."
    )


def differences(saved: Mapping[str, Any], config: TrainConfig) -> dict[str, tuple[object, object]]:
    """Settings in which a saved run is not the one asked for: what it has, and what is wanted.

    Parameters
    ----------
    saved
        With the entries ``config`` and ``delta_kl`` that checkpoints and records have.
    config
        The run that is asked for.
    """
    have = dataclasses.asdict(TrainConfig()) | dict(saved["config"])
    want = dataclasses.asdict(config)
    # A default may be another number in another version of this library.
    have["delta_kl"] = saved.get("delta_kl", have["delta_kl"])
    want["delta_kl"] = step_size(config)
    return {
        name: (have[name], want[name])
        for name in want
        if name not in _MAY_CHANGE and have[name] != want[name]
    }


def read_checkpoint(path: Path | str) -> dict[str, Any]:
    """The content of a checkpoint file; see :meth:`Training.load`."""
    file = Path(path)
    file = file / "checkpoint.pt" if file.is_dir() else file
    if not file.exists():
        raise FileNotFoundError(
            f"there is no checkpoint at {str(file)!r}: make one with `thesis train`."
        )
    try:
        content = torch.load(file, weights_only=True)
    except Exception as error:  # torch raises many kinds for a file that is not its own
        raise ValueError(f"{str(file)!r} is not a checkpoint of `thesis train`.") from error
    if not isinstance(content, dict) or "format" not in content:
        raise ValueError(f"{str(file)!r} is not a checkpoint of `thesis train`.")
    if "policies" in content:
        raise ValueError(
            f"{str(file)!r} holds the policies of a sweep, {', '.join(content['policies'])}: name "
            "one of them (--run)."
        )
    if content["format"] != FORMAT:
        raise ValueError(
            f"{str(file)!r} has checkpoint format {content['format']}, but this version of "
            f"thesis_lib reads format {FORMAT}: train again, or use the version that wrote it."
        )
    for name, kind in _CONTENT.items():
        if not isinstance(content.get(name), kind):
            raise _foreign(path, f"no {name}")
    return content


def train(
    config: TrainConfig,
    directory: Path | str | None = None,
    *,
    resume: bool = True,
    any_version: bool = False,
    report: Callable[[Training], None] | None = None,
) -> Training:
    """Run a training to its last iteration.

    Parameters
    ----------
    config
        The run.
    directory
        Where its checkpoint and learning curve go; None keeps nothing.
    resume
        Whether to go on from a checkpoint in the directory.
    any_version
        Whether to go on from one that other code or other versions made.
    report
        Called after every iteration.

    Returns
    -------
    Training
        The finished run.

    Raises
    ------
    TrainingStopped
        When a number is not finite or the disk is full: the last good checkpoint stays as
        it is.
    ValueError
        When the directory holds another run.
    """
    if directory is None:
        return _train(config, None, resume, any_version, report)
    folder = writable_directory(directory)
    with _alone(folder):
        return _train(config, folder, resume, any_version, report)


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Hold a directory, so that no two processes train into it at once.

    The lock goes with the process however it ends, and leaves no file behind.
    """
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise ValueError(
                f"another process is training in {str(folder)!r}: wait for it, or choose another "
                "directory."
            ) from None
        yield
    finally:
        os.close(handle)


def _train(
    config: TrainConfig,
    folder: Path | None,
    resume: bool,
    any_version: bool,
    report: Callable[[Training], None] | None,
) -> Training:
    has_checkpoint = folder is not None and (folder / "checkpoint.pt").exists()
    if has_checkpoint and not resume:
        raise ValueError(
            f"{str(folder)!r} already holds a run: go on with it (resume), or choose another "
            "directory."
        )
    if has_checkpoint and folder:
        run = Training.load(folder, config, any_version=any_version)
    else:
        run = Training(config)
    try:
        if folder is not None:
            # A run killed while it saved may have left an older curve and half a file.
            run.save(folder)
            for name in FILES:
                for half in folder.glob(f".{name}.*"):
                    half.unlink()
        while run.iteration < config.iterations:
            run.step()
            last = run.iteration == config.iterations
            if folder is not None and (last or run.iteration % config.checkpoint_every == 0):
                run.save(folder)
            if report is not None:
                report(run)
    except TrainingStopped as error:
        if folder is None:
            raise
        if not (folder / "checkpoint.pt").exists():
            raise TrainingStopped(f"{error} There is no checkpoint in {str(folder)!r}.") from error
        good = read_checkpoint(folder)["iteration"]
        raise TrainingStopped(
            f"{error} The last good checkpoint, of iteration {good}, is in {str(folder)!r}."
        ) from error
    return run


def use_one_thread() -> None:
    """Put this process's linear algebra on one thread.

    The nets are small, so that more threads make them slower; and a sum's last digits
    depend on the number of threads, so that runs repeat exactly only on equal numbers.
    """
    torch.set_num_threads(1)
    threadpool_limits(1)


class TerminalReport:
    """Show a run's progress on a terminal, and nothing elsewhere.

    Parameters
    ----------
    iterations
        Of the whole run.
    """

    def __init__(self, iterations: int) -> None:
        self.iterations = iterations
        self._shown = sys.stderr.isatty()
        self._start: tuple[float, int] | None = None

    def __call__(self, run: Training) -> None:
        """Overwrite the line with the run's last iteration."""
        if not self._shown:
            return
        row = run.rows[-1]
        if self._start is None:
            self._start = (time.perf_counter() - row["wall_seconds"], run.iteration - 1)
        spent = time.perf_counter() - self._start[0]
        pace = spent / (run.iteration - self._start[1])
        left = pace * (self.iterations - run.iteration)
        speed = (row["steps"] - (run.rows[-2]["steps"] if len(run.rows) > 1 else 0)) / max(
            row["wall_seconds"], 1e-9
        )
        line = (
            f"iteration {run.iteration}/{self.iterations}  return {row['mean_return']:.1f}  "
            f"KL {row['kl']:.3f}  entropy {row['entropy']:.2f}  {speed:,.0f} steps/s  "
            f"{_clock(left)} left"
        )
        end = "\n" if run.iteration == self.iterations else ""
        print(f"\r{line:<78}", end=end, file=sys.stderr, flush=True)


def _clock(seconds: float) -> str:
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours:d}:{minutes:02d}:{int(seconds):02d}"
