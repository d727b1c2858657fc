r"""Test a trained policy: the greedy policy under perturbations (sections 5.3 and 5.4)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast, get_args

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from thesis_lib.checkout import environment
from thesis_lib.checks import check_seed, one_of, plain_settings, positive_integer
from thesis_lib.files import replacing, writable_directory, write_json
from thesis_lib.locomotion import BatchTask, make_task
from thesis_lib.locomotion.robots import Ground
from thesis_lib.locomotion.tasks import TEST_HORIZON, Termination
from thesis_lib.locomotion.terrain import hill_maps
from thesis_lib.optimisation import GymnasiumTask, run_episodes
from thesis_lib.policies import GaussianPolicy
from thesis_lib.stats import mean_ci
from thesis_lib.surroundings import own_settings
from thesis_lib.training.columns import columns
from thesis_lib.training.config import TERRAINS, is_robot
from thesis_lib.training.disturbances import Disturbances, parse_perturbation
from thesis_lib.training.run import Training
from thesis_lib.training.trained import Trained, read_trained

RUN_COLUMNS: Mapping[str, str] = columns("test")
"""Meaning and unit of each column of a test, one row a run."""

SUMMARY_COLUMNS: Mapping[str, str] = columns("evaluation")
"""Meaning and unit of each column of :func:`summarised`."""


@dataclass(frozen=True)
class EvaluateConfig:
    """A test of 20 runs of 1000 steps (section 5.4)."""

    runs: int = 20
    """Number of runs; run i differs from the others by its start, noise and terrain."""
    steps: int = TEST_HORIZON
    """Control steps of a run."""
    terrain: str = "flat"
    """flat, or hill: a map of its own for every run, the same for every policy."""
    difficulty: float = 1.0
    """Height of the hills in metres."""
    perturbations: tuple[str, ...] = ()
    """Such as "WhiteNoise(sigma=1.0, onset=100)" or "TerrainSwitch"."""
    termination: str = "test"
    """test (the author's test mode), train or never: which limits end a run."""
    greedy: bool = True
    """Act by the mean of the policy."""
    memory: bool = True
    """Whether the net remembers; otherwise its state is at every step that of a start."""
    previous_action: bool = True
    """Whether the net sees its last action; otherwise it reads zero."""
    input_filter: float = 0.0
    """Time constant in seconds of a first-order filter between the sensors and the net; 0 is
    none."""
    seed: int = 0
    """All randomness comes from it."""

    def __post_init__(self) -> None:
        check_seed(self.seed)
        plain_settings(self)
        for name in ("runs", "steps"):
            positive_integer(name, getattr(self, name))
        if self.input_filter < 0:
            raise ValueError(
                f"input_filter is {self.input_filter}, but a time constant is at least 0 s."
            )
        one_of("terrain", self.terrain, TERRAINS)
        one_of("termination", self.termination, get_args(Termination))

    def disturbed(self, disturbances: Disturbances) -> EvaluateConfig:
        """The test with more perturbations; ValueError when the ground is hilly twice."""
        if self.terrain == "hill" and disturbances.switch_at is not None:
            raise ValueError(
                "terrain is hill and switch_at is given, but a switch starts on flat ground: "
                "leave one of them out."
            )
        more = disturbances.perturbations(self.difficulty, self.seed)
        return dataclasses.replace(
            self, perturbations=(*self.perturbations, *(repr(p) for p in more))
        )


def idle_settings(config: EvaluateConfig, disturbances: Disturbances) -> dict[str, str]:
    """Settings that differ from their default and have no effect, with what they belong to."""
    found = {}
    hilly = config.terrain == "hill" or disturbances.switch_at is not None
    if config.difficulty != EvaluateConfig().difficulty and not hilly:
        found["difficulty"] = "terrain hill or switch_at"
    default = Disturbances()
    if disturbances.correlation_time != default.correlation_time and disturbances.noise is None:
        found["correlation_time"] = "noise"
    late = set(vars(default)) - {"switch_at", "onset", "correlation_time"}
    if disturbances.onset != default.onset and all(
        getattr(disturbances, name) == getattr(default, name) for name in late
    ):
        found["onset"] = " or ".join(sorted(late))
    return found


def evaluation_task(
    robot: str,
    config: EvaluateConfig,
    *,
    reading: str = "code",
    alive_bonus: float | None = None,
) -> BatchTask:
    """The task of a test, one world for every run.

    Parameters
    ----------
    robot
        Name of the robot.
    config
        The test.
    reading, alive_bonus
        See :func:`~thesis_lib.locomotion.make_task`.
    """
    task = make_task(
        robot,
        reading=reading,  # type: ignore[arg-type]
        alive_bonus=alive_bonus,
        termination=config.termination,  # type: ignore[arg-type]
    )
    terrain = _hills(config, task.robot.name)
    return BatchTask(
        task,
        config.runs,
        seed=config.seed,
        terrain=terrain,
        perturbations=tuple(map(parse_perturbation, config.perturbations)),
        max_episode_steps=config.steps,
    )


def _hills(config: EvaluateConfig, robot: str) -> Sequence[Ground] | None:
    """A map for each run of a test on hills."""
    if config.terrain == "flat":
        return None
    return hill_maps(config.runs, config.difficulty, config.seed, robot=robot)


def ground_of(config: EvaluateConfig, robot: str, run: int) -> Ground | None:
    """The terrain of one run of a test."""
    offers = [_hills(config, robot)]
    seed = np.random.SeedSequence(config.seed)
    for perturbation in map(parse_perturbation, config.perturbations):
        offers.append(perturbation.ground(robot, config.runs, seed))
    return next((maps[run] for maps in offers if maps is not None), None)


def evaluate(
    trained: Training | Trained | Path | str, config: EvaluateConfig | None = None
) -> pd.DataFrame:
    """Test a policy.

    Parameters
    ----------
    trained
        A run, or the path of its checkpoint or directory.
    config
        The test; default that of section 5.4 without perturbation.

    Returns
    -------
    pandas.DataFrame
        Columns as in :data:`RUN_COLUMNS`, one row a run.
    """
    chosen = config or EvaluateConfig()
    run = read_trained(trained) if isinstance(trained, Path | str) else trained
    return tested(task_for(run, chosen), run.policy, chosen)


def task_for(trained: Training | Trained, config: EvaluateConfig) -> BatchTask | GymnasiumTask:
    """The task of a test for a run: its robot, rewards and observations, or its environment.

    Raises
    ------
    ValueError
        When an environment that is no robot's is to be tested in another way than as it is.
    """
    run = trained.config
    if is_robot(run.task):
        return evaluation_task(run.task, config, reading=run.reading, alive_bonus=run.alive_bonus)
    for name in ("terrain", "perturbations", "termination"):
        if getattr(config, name) != getattr(EvaluateConfig(), name):
            raise no_robot(run.task, name)
    return GymnasiumTask(run.task, config.runs, seed=config.seed, max_episode_steps=config.steps)


def no_robot(task: str, setting: str) -> ValueError:
    """The error that a setting of a test needs a robot."""
    return ValueError(
        f"{task} is no robot's name, and terrain, perturbations, termination and film are "
        f"for robots alone: leave {setting} out."
    )


def tested(
    task: BatchTask | GymnasiumTask, policy: GaussianPolicy, config: EvaluateConfig
) -> pd.DataFrame:
    """One run in every world; columns as in :data:`RUN_COLUMNS`."""
    dt = task.dt if isinstance(task, GymnasiumTask) else task.task.robot.control_dt
    with own_settings():
        rollouts = run_episodes(task, acting(policy, config, dt), exploration(config))
    return pd.DataFrame(
        {
            "run": np.arange(config.runs),
            "return": rollouts.episode_returns,
            "length": rollouts.lengths,
            "terminated": rollouts.terminated,
        }
    )


class _Acting:
    """A policy that acts and does not learn; see :func:`acting`."""

    keeps_hidden = False

    def __init__(self, policy: GaussianPolicy, config: EvaluateConfig) -> None:
        self._policy, self._config = policy, config

    def __getattr__(self, name: str) -> Any:
        return getattr(self._policy, name)

    def step(self, observation: Tensor, before: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        if not self._config.memory:
            state = self._policy.initial_state(len(observation))
        if not self._config.previous_action:
            before = torch.zeros_like(before)
        return self._policy.step(observation, before, state)


class _Filtered(_Acting):
    """The same behind a first-order filter, whose output is the last part of the state."""

    def __init__(self, policy: GaussianPolicy, config: EvaluateConfig, dt: float) -> None:
        super().__init__(policy, config)
        self._gain = -math.expm1(-dt / config.input_filter)

    def initial_state(self, n: int) -> Tensor:
        unfiltered = torch.full((n, self.observation_size), torch.nan, dtype=torch.float64)
        return torch.cat([self._policy.initial_state(n), unfiltered], dim=1)

    def step(self, observation: Tensor, before: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        size = observation.shape[1]
        before_it, last = state[:, :-size].to(self._policy.dtype), state[:, -size:]
        last = torch.where(last.isnan(), observation, last)  # starts from what it sees first
        filtered = last.lerp(observation, self._gain)
        mean, after = super().step(filtered, before, before_it)
        return mean, torch.cat([after, filtered], dim=1)


def acting(policy: GaussianPolicy, config: EvaluateConfig, dt: float) -> GaussianPolicy:
    """A policy as it acts in a test: with or without memory, its last action and a filter.

    Parameters
    ----------
    policy
        The policy.
    config
        The test.
    dt
        Control step of the task in seconds.
    """
    if config.input_filter:
        return cast(GaussianPolicy, _Filtered(policy, config, dt))
    return cast(GaussianPolicy, _Acting(policy, config))


def exploration(config: EvaluateConfig) -> np.random.Generator | None:
    """Source of a test's exploration noise, None where it acts greedily."""
    return None if config.greedy else np.random.default_rng(config.seed)


def summarised(table: pd.DataFrame) -> pd.DataFrame:
    """What a test came to.

    Parameters
    ----------
    table
        From :func:`evaluate`.

    Returns
    -------
    pandas.DataFrame
        One row; columns as in :data:`SUMMARY_COLUMNS`.  A single run has no interval.
    """
    returns = table["return"]
    n = len(returns)
    half = mean_ci(returns).half_width if n > 1 else np.nan
    row = {
        "n": n,
        "mean_return": returns.mean(),
        "low": returns.mean() - half,
        "high": returns.mean() + half,
        "sd": returns.std(),
        "min": returns.min(),
        "max": returns.max(),
        "mean_length": table.length.mean(),
        "terminated": table.terminated.mean(),
    }
    return pd.DataFrame([row], columns=list(SUMMARY_COLUMNS))


def write(
    table: pd.DataFrame,
    trained: Training | Trained,
    config: EvaluateConfig,
    out: Path | str,
    *,
    command: str,
) -> Path:
    """Write a test as ``evaluation.csv`` with its provenance ``evaluation.json``.

    Parameters
    ----------
    table
        From :func:`evaluate`.
    trained
        What was tested.
    config
        The test.
    out
        Directory to write to.
    command
        What made it.

    Returns
    -------
    Path
        Of the table.
    """
    folder = writable_directory(out)
    record: dict[str, Any] = {
        "id": "evaluation",
        "title": "Returns of one policy in a test.",
        "command": command,
        "trained": dataclasses.asdict(trained.config),
        "iteration": trained.iteration,
        "config": dataclasses.asdict(config),
        "summary": summarised(table).iloc[0].to_dict(),
        "rows": len(table),
        "columns": dict(RUN_COLUMNS),
        "summary_columns": dict(SUMMARY_COLUMNS),
        **environment(),
        "table": "evaluation.csv",
    }
    with replacing(folder / "evaluation.csv") as temporary:
        table.to_csv(temporary, index=False)
    write_json(folder / "evaluation.json", record)
    return folder / "evaluation.csv"
