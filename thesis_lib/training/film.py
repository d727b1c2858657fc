"""Draw one run of a test as a film or an animated picture."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from thesis_lib.arrays import BoolArray, FloatArray
from thesis_lib.files import replacing, writable_directory
from thesis_lib.locomotion import BatchTask
from thesis_lib.optimisation import run_episodes
from thesis_lib.policies import GaussianPolicy
from thesis_lib.training.evaluation import (
    EvaluateConfig,
    acting,
    exploration,
    ground_of,
    no_robot,
    task_for,
)
from thesis_lib.training.run import Training
from thesis_lib.training.trained import Trained, read_trained

Picture = NDArray[np.uint8]

PICTURES = {".webp": "WEBP", ".gif": "GIF", ".png": "PNG"}
"""Animated pictures, by suffix."""

VIDEOS = {".mp4": "libx264", ".webm": "libvpx-vp9"}
"""Encoders of videos, which are a tenth of their size, by suffix."""

FILM_FORMATS = (*PICTURES, *VIDEOS)
"""Suffixes that a film can have."""

QUALITY = 30
"""Constant rate factor of videos: a higher one is smaller and coarser."""

FRAMES_A_SECOND = 25
"""Of a film; time runs as in the simulation."""


def positions(
    task: BatchTask,
    policy: GaussianPolicy,
    world: int = 0,
    noise: np.random.Generator | None = None,
) -> FloatArray:
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
    states: list[FloatArray] = []

    def watch(running: BoolArray) -> None:
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
    if target.suffix in VIDEOS and find_spec("av") is None:
        raise ValueError(
            f"a film is written as {target.suffix!r} by the package av: pip install "
            f"'thesis_lib[film]', or choose one of {', '.join(PICTURES)}."
        )
    if not 0 <= run < config.runs:
        raise ValueError(f"run is {run}, but the runs are 0 to {config.runs - 1}.")
    writable_directory(target.parent)
    return target


def pictures(
    trained: Training | Trained,
    config: EvaluateConfig,
    *,
    run: int = 0,
    width: int = 480,
    height: int = 320,
) -> tuple[list[Picture], int]:
    """Pictures of one run of a test, and how many of them make a second.

    Parameters
    ----------
    trained
        The policy.
    config
        The test.
    run
        Which of its runs to show.
    width, height
        Pixels.

    Raises
    ------
    ValueError
        When the policy is not a robot's.
    thesis_lib.locomotion.rendering.NoGL
        When nothing can be drawn on this machine.
    """
    from thesis_lib.locomotion.rendering import film as draw

    task = task_for(trained, config)
    if not isinstance(task, BatchTask):
        raise no_robot(trained.config.task, "film")
    robot, dt = task.task.robot.name, task.task.robot.control_dt
    states = positions(task, acting(trained.policy, config, dt), run, exploration(config))
    every = max(1, round(1 / (FRAMES_A_SECOND * dt)))
    drawn = draw(robot, states[::every], ground_of(config, robot, run), width=width, height=height)
    return drawn, round(1 / (every * dt))


def write_film(drawn: Sequence[Picture], rate: int, target: Path) -> None:
    """Write pictures as a film; its suffix is one of :data:`FILM_FORMATS`.

    Parameters
    ----------
    drawn
        The pictures, each ``(height, width, 3)`` with an even height and width for videos.
    rate
        Pictures a second.
    target
        The file.
    """
    with replacing(target) as temporary:
        if target.suffix in VIDEOS:
            _write_video(drawn, rate, temporary, target.suffix)
            return
        first, *others = [Image.fromarray(picture) for picture in drawn]
        first.save(
            temporary,
            format=PICTURES[target.suffix],
            save_all=True,
            append_images=others,
            duration=round(1000 / rate),
            loop=0,
        )


def _write_video(drawn: Sequence[Picture], rate: int, target: Path, suffix: str) -> None:
    """Encode, without sound, so that every browser plays it."""
    import av

    # The index goes to the front, so that a video plays before it is loaded.
    options = {"movflags": "+faststart"} if suffix == ".mp4" else {}
    with av.open(str(target), "w", format=suffix[1:], options=options) as container:
        stream = container.add_stream(VIDEOS[suffix], rate=rate)
        assert isinstance(stream, av.VideoStream)
        stream.height, stream.width = drawn[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.options = {"crf": str(QUALITY), **({"b": "0"} if suffix == ".webm" else {})}
        for picture in drawn:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())


def film(
    trained: Training | Trained | Path | str,
    path: Path | str,
    config: EvaluateConfig | None = None,
    *,
    run: int = 0,
    width: int = 480,
    height: int = 320,
) -> Path:
    """Write a film of one run of a test.

    Parameters
    ----------
    trained
        A run, or the path of its checkpoint or directory.
    path
        Of the film; its suffix is one of :data:`FILM_FORMATS`.
    config, run, width, height
        As in :func:`pictures`.

    Raises
    ------
    ValueError
        When the suffix or the run does not exist.
    thesis_lib.locomotion.rendering.NoGL
        When nothing can be drawn on this machine.
    """
    chosen = config or EvaluateConfig()
    target = check_film(path, chosen, run)
    loaded = read_trained(trained) if isinstance(trained, Path | str) else trained
    write_film(*pictures(loaded, chosen, run=run, width=width, height=height), target)
    return target
