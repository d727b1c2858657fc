r"""Test a trained policy: the greedy policy under perturbations (sections 5.3 and 5.4)."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import pandas as pd

from thesis_lib.checkout import environment
from thesis_lib.checks import check_seed
from thesis_lib.files import replacing, writable_directory
from thesis_lib.locomotion import BatchTask, make_task, perturbations
from thesis_lib.locomotion.batch import Perturbation
from thesis_lib.locomotion.robots import Ground
from thesis_lib.locomotion.tasks import TEST_HORIZON, Termination
from thesis_lib.locomotion.terrain import hill_maps
from thesis_lib.optimisation import run_episodes
from thesis_lib.registration import find
from thesis_lib.stats import mean_ci
from thesis_lib.training.config import TERRAINS
from thesis_lib.training.run import Training

RUN_COLUMNS: Mapping[str, str] = {
    "run": "number of the run, from 0",
    "return": "undiscounted return up to the end of the run",
    "length": "control steps",
    "terminated": "whether a limit of the task ended it",
}
"""Meaning and unit of each column of a test, one row a run."""

SUMMARY_COLUMNS: Mapping[str, str] = {
    "n": "runs",
    "mean_return": "mean return",
    "low": "lower end of the 95% Student interval of the mean over runs of this one policy",
    "high": "upper end",
    "sd": "standard deviation of the return over runs",
    "min": "smallest return",
    "max": "largest return",
    "mean_length": "mean length in control steps",
    "terminated": "share of the runs that a limit of the task ended",
}
"""Meaning and unit of each column of :func:`summarised`."""


@dataclass(frozen=True)
class Disturbances:
    """The perturbations there are, in short: each is left out unless it is asked for."""

    noise: float | None = None
    """Standard deviation of white noise on all sensors, in each one's own unit."""
    dead_sensors: tuple[str, ...] = ()
    """Sensors that read 0, by name."""
    switch_at: str | None = None
    """Flat ground that turns hilly: at x metres, or "task" where the task says so."""
    dead_actuators: tuple[str, ...] = ()
    """Motors that go limp, by name."""
    delay: int | None = None
    """Control steps by which actions are late."""
    mass: float | None = None
    """Factor on the mass of the robot."""
    friction: float | None = None
    """Factor on the friction of ground and robot."""
    push: tuple[float, float, float] | None = None
    """Push on the torso, as the change of velocity in m/s along x, y and z."""
    onset: int = perturbations.NOISE_ONSET
    """Control step from which they act; hills are met where they are."""

    def perturbations(self, difficulty: float = 1.0, seed: int = 0) -> tuple[Perturbation, ...]:
        """What was asked for.

        Parameters
        ----------
        difficulty
            Height of the hills in metres.
        seed
            Decides the hills.

        Raises
        ------
        ValueError
            When a value is out of range.
        """
        onset = self.onset
        found: list[Perturbation] = []
        if self.switch_at is not None:
            place = _place(self.switch_at)
            found.append(perturbations.TerrainSwitch(difficulty, place, seed))
        if self.mass is not None:
            found.append(perturbations.MassChange(self.mass, onset=onset))
        if self.friction is not None:
            found.append(perturbations.FrictionChange(self.friction, onset=onset))
        if self.dead_actuators:
            found.append(perturbations.ActuatorFailure(self.dead_actuators, onset=onset))
        if self.delay is not None:
            found.append(perturbations.ActionDelay(self.delay, onset=onset))
        if self.push is not None:
            found.append(perturbations.Push(self.push, onset=onset))
        if self.noise is not None:
            found.append(perturbations.WhiteNoise(self.noise, onset))
        if self.dead_sensors:
            # After the noise: a sensor that is dead does not tremble.
            found.append(perturbations.SensorFailure(self.dead_sensors, onset=onset))
        return tuple(found)


def _place(text: str) -> float | Literal["task"]:
    if text == "task":
        return "task"
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"switch_at is {text!r}, but it must be metres, or task.") from None


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
    seed: int = 0
    """All randomness comes from it."""

    def __post_init__(self) -> None:
        check_seed(self.seed)
        for name in ("runs", "steps"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}, but it must be at least 1.")
        if self.terrain not in TERRAINS:
            raise ValueError(
                f"terrain {self.terrain!r} does not exist: choose one of {', '.join(TERRAINS)}."
            )
        if self.termination not in get_args(Termination):
            raise ValueError(
                f"termination {self.termination!r} does not exist: choose one of "
                f"{', '.join(get_args(Termination))}."
            )

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
    late = set(vars(default)) - {"switch_at", "onset"}
    if disturbances.onset != default.onset and all(
        getattr(disturbances, name) == getattr(default, name) for name in late
    ):
        found["onset"] = " or ".join(sorted(late))
    return found


def known_perturbations() -> Mapping[str, type[Perturbation]]:
    """The perturbations there are, by name."""
    return {
        name: kind
        for name, kind in vars(perturbations).items()
        if inspect.isclass(kind) and issubclass(kind, Perturbation) and kind is not Perturbation
    }


def parse_perturbation(text: str) -> Perturbation:
    """Read a perturbation from text such as ``"MassChange(factor=1.5)"``.

    Parameters
    ----------
    text
        A name of :func:`known_perturbations` or one that an installed package offers
        (:mod:`thesis_lib.registration`), with its fields as keywords, or alone.

    Raises
    ------
    ValueError
        When the name or a field does not exist, or a value is out of range.
    """
    try:
        tree = ast.parse(text.strip(), mode="eval").body
        name, given = (tree.func, tree.keywords) if isinstance(tree, ast.Call) else (tree, [])
        if not isinstance(name, ast.Name) or (isinstance(tree, ast.Call) and tree.args):
            raise ValueError
        values = {str(k.arg): ast.literal_eval(k.value) for k in given}
    except (SyntaxError, ValueError) as error:
        raise ValueError(
            f"{text!r} is not a perturbation: write a name with its fields as keywords, such as "
            "WhiteNoise(sigma=1.0, onset=100)."
        ) from error
    kind = find("perturbation", name.id, known_perturbations())
    fields = [f.name for f in dataclasses.fields(kind)]  # type: ignore[arg-type]
    for field in values:
        if field not in fields:
            raise ValueError(
                f"{name.id} has no field {field!r}: its fields are {', '.join(fields)}."
            )
    try:
        return kind(**values)
    except TypeError as error:
        raise ValueError(f"{text!r} is incomplete: {error}.") from error


def evaluation_task(
    trained: Training, config: EvaluateConfig, extra: Sequence[Perturbation] = ()
) -> BatchTask:
    """The task of a test, one world for every run.

    Parameters
    ----------
    trained
        Decides robot, rewards and observations.
    config
        The test.
    extra
        Perturbations besides those the config names.
    """
    task = make_task(
        trained.config.task,
        reading=trained.config.reading,  # type: ignore[arg-type]
        alive_bonus=trained.config.alive_bonus,
        termination=config.termination,  # type: ignore[arg-type]
    )
    terrain = _hills(config, task.robot.name)
    return BatchTask(
        task,
        config.runs,
        seed=config.seed,
        terrain=terrain,
        perturbations=(*map(parse_perturbation, config.perturbations), *extra),
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
    trained: Training | Path | str,
    config: EvaluateConfig | None = None,
    extra: Sequence[Perturbation] = (),
) -> pd.DataFrame:
    """Test a policy.

    Parameters
    ----------
    trained
        A run, or the path of its checkpoint or directory.
    config
        The test; default that of section 5.4 without perturbation.
    extra
        Perturbations besides those the config names.

    Returns
    -------
    pandas.DataFrame
        Columns as in :data:`RUN_COLUMNS`, one row a run.
    """
    chosen = config or EvaluateConfig()
    run = trained if isinstance(trained, Training) else Training.load(trained)
    task = evaluation_task(run, chosen, extra)
    rollouts = run_episodes(task, run.policy, exploration(chosen))
    return pd.DataFrame(
        {
            "run": np.arange(chosen.runs),
            "return": rollouts.episode_returns,
            "length": rollouts.lengths,
            "terminated": rollouts.terminated,
        }
    )


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
    trained: Training,
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
    with replacing(folder / "evaluation.json") as temporary:
        temporary.write_text(json.dumps(record, indent=1, default=float) + "\n", encoding="utf-8")
    return folder / "evaluation.csv"
