"""Draw one run of a test as an animated picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from thesis_lib.files import replacing, writable_directory
from thesis_lib.locomotion import BatchTask
from thesis_lib.optimisation import run_episodes
from thesis_lib.policies import GaussianPolicy
from thesis_lib.training.evaluation import (
    EvaluateConfig,
    acting,
    exploration,
    ground_of,
    task_for,
)
from thesis_lib.training.run import Training
from thesis_lib.training.trained import Trained, read_trained

FILM_FORMATS = (".webp", ".gif", ".png")
"""Suffixes of the animated pictures a film can be written to."""

FRAMES_A_SECOND = 25
"""Of a film; time runs as in the simulation."""


def positions(
    task: BatchTask,
    policy: GaussianPolicy,
    world: int = 0,
    noise: np.random.Generator | None = None,
) -> NDArray[np.float64]:
    """Positions of one world's robot before every step, shape ``(steps, nq)``.

    Parameters
    ----------
    task, policy
        What acts in which worlds.
    world
        Whose positions.
    noise
        Source of the exploration noise; None acts greedily.
    """
    states: list[NDArray[np.float64]] = []

    def watch(running: NDArray[np.bool_]) -> None:
        if running[world]:
            states.append(task.qpos[world])

    run_episodes(task, policy, noise, watch=watch)
    return np.stack(states)


def check_film(path: Path | str, config: EvaluateConfig, run: int = 0) -> Path:
    """The path of a film if it can be made; ValueError when its suffix or run does not exist."""
    target = Path(path)
    if target.suffix not in FILM_FORMATS:
        raise ValueError(
            f"a film cannot be written as {target.suffix!r}: choose one of "
            f"{', '.join(FILM_FORMATS)}."
        )
    if not 0 <= run < config.runs:
        raise ValueError(f"run is {run}, but the runs are 0 to {config.runs - 1}.")
    writable_directory(target.parent)
    return target


def film(
    trained: Training | Trained | Path | str,
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
    target = check_film(path, chosen, run)
    loaded = read_trained(trained) if isinstance(trained, Path | str) else trained
    task = task_for(loaded, chosen)
    dt = task.task.robot.control_dt
    states = positions(task, acting(loaded.policy, chosen, dt), run, exploration(chosen))
    every = max(1, round(1 / (FRAMES_A_SECOND * dt)))
    robot = task.task.robot.name
    ground = ground_of(chosen, robot, run)
    pictures = draw(robot, states[::every], ground, width=width, height=height)
    frames = [Image.fromarray(p) for p in pictures]
    milliseconds = round(1000 * every * dt)
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
