r"""Test a trained policy: the greedy policy under perturbations (sections 5.3 and 5.4)."""

from __future__ import annotations

import ast
import dataclasses
import inspect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from PIL import Image

from thesis_lib.experiments.base import check_seed, replacing
from thesis_lib.experiments.training import TERRAINS, Training
from thesis_lib.locomotion import BatchTask, make_task, perturbations
from thesis_lib.locomotion.batch import Perturbation
from thesis_lib.locomotion.robots import Ground
from thesis_lib.locomotion.tasks import TEST_HORIZON
from thesis_lib.locomotion.terrain import hill_maps
from thesis_lib.optimisation import run_episodes
from thesis_lib.policies import GaussianPolicy

FILM_FORMATS = (".webp", ".gif", ".png")
"""Suffixes of the animated pictures a film can be written to."""

FRAMES_A_SECOND = 25
"""Of a film; time runs as in the simulation."""


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
        A name of :func:`known_perturbations`, with its fields as keywords, or alone.

    Raises
    ------
    ValueError
        When the name or a field does not exist, or a value is out of range.
    """
    known = known_perturbations()
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
    if name.id not in known:
        raise ValueError(
            f"perturbation {name.id!r} does not exist: choose one of {', '.join(sorted(known))}."
        )
    kind = known[name.id]
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


def _ground(config: EvaluateConfig, robot: str, run: int) -> Ground | None:
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
        One row a run: ``run``; ``return``, undiscounted, up to the end of the run;
        ``length`` in steps; ``terminated``, whether a limit of the task ended it.
    """
    chosen = config or EvaluateConfig()
    run = trained if isinstance(trained, Training) else Training.load(trained)
    task = evaluation_task(run, chosen, extra)
    noise = None if chosen.greedy else np.random.default_rng(chosen.seed)
    rollouts = run_episodes(task, run.policy, noise)
    return pd.DataFrame(
        {
            "run": np.arange(chosen.runs),
            "return": rollouts.episode_returns,
            "length": rollouts.lengths,
            "terminated": rollouts.terminated,
        }
    )


def positions(task: BatchTask, policy: GaussianPolicy, world: int = 0) -> NDArray[np.float64]:
    """Positions of one world's robot before every greedy step, shape ``(steps, nq)``."""
    states: list[NDArray[np.float64]] = []

    def watch(running: NDArray[np.bool_]) -> None:
        if running[world]:
            states.append(task.qpos[world])

    run_episodes(task, policy, watch=watch)
    return np.stack(states)


def film(
    trained: Training | Path | str,
    path: Path | str,
    config: EvaluateConfig | None = None,
    *,
    run: int = 0,
    width: int = 480,
    height: int = 320,
) -> Path:
    """Write a film of one run of a test as an animated picture.

    Parameters
    ----------
    trained
        A run, or the path of its checkpoint or directory.
    path
        Of the picture: ``.webp``, ``.gif`` or ``.png``.
    config
        The test.
    run
        Which of its runs to show.
    width, height
        Pixels.

    Raises
    ------
    ValueError
        When the suffix or the run does not exist.
    thesis_lib.locomotion.rendering.NoGL
        When nothing can be drawn on this machine.
    """
    from thesis_lib.locomotion.rendering import film as draw

    chosen = config or EvaluateConfig()
    target = Path(path)
    if target.suffix not in FILM_FORMATS:
        raise ValueError(
            f"a film cannot be written as {target.suffix!r}: choose one of "
            f"{', '.join(FILM_FORMATS)}."
        )
    if not 0 <= run < chosen.runs:
        raise ValueError(f"run is {run}, but the runs are 0 to {chosen.runs - 1}.")
    loaded = trained if isinstance(trained, Training) else Training.load(trained)
    task = evaluation_task(loaded, chosen)
    states = positions(task, loaded.policy, run)
    every = max(1, round(1 / (FRAMES_A_SECOND * task.task.robot.control_dt)))
    robot = task.task.robot.name
    ground = _ground(chosen, robot, run)
    pictures = draw(robot, states[::every], ground, width=width, height=height)
    frames = [Image.fromarray(p) for p in pictures]
    milliseconds = round(1000 * every * task.task.robot.control_dt)
    with replacing(target) as temporary:
        frames[0].save(
            temporary,
            format={".webp": "WEBP", ".gif": "GIF", ".png": "PNG"}[target.suffix],
            save_all=True,
            append_images=frames[1:],
            duration=milliseconds,
            loop=0,
        )
    return target
