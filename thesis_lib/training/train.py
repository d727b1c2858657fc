"""Bring a run to its last iteration, alone in its directory, and show how it goes."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from tqdm import tqdm

from thesis_lib.checkout import repository_root
from thesis_lib.files import alone, writable_directory
from thesis_lib.surroundings import own_settings
from thesis_lib.training.checkpoint import FILES, read_checkpoint
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.run import Training, TrainingStopped


def default_directory(config: TrainConfig) -> Path:
    """Where a run goes unless asked otherwise; every task, terrain, net and seed has its own."""
    name = f"{config.task}-{config.terrain}-{config.architecture}-{config.seed}".lower()
    return repository_root() / "_build" / "runs" / re.sub("[/:]", "-", name)


def train(
    config: TrainConfig,
    directory: Path | str | None = None,
    *,
    resume: bool = True,
    any_version: bool = False,
    report: Callable[[Training], None] | None = None,
    patience: float = 0.0,
) -> Training:
    """Run a training to its last iteration.

    A run that is interrupted saves what it has learned up to the last whole iteration.

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
    patience
        Seconds to wait for another process that trains in the directory.

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

    Examples
    --------
    >>> from thesis_lib.training.config import TrainConfig
    >>> short = dict(batch_steps=200, horizon=50, iterations=2)
    >>> run = train(TrainConfig("Pendulum-v1", architecture="gru", **short))
    >>> run.curve.steps.tolist()
    [200, 400]
    """
    if directory is None:
        with own_settings():
            return _train(config, None, resume, any_version, report)
    folder = writable_directory(directory)

    def busy() -> None:
        raise ValueError(
            f"another process is training in {str(folder)!r}: wait for it, or choose another "
            "directory."
        )

    with alone(folder, busy, patience=patience), own_settings():
        return _train(config, folder, resume, any_version, report)


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
    except KeyboardInterrupt:
        if folder is not None:
            run.save(folder)
        raise
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


class TerminalReport:
    """Show a run's progress on a terminal, and nothing elsewhere.

    Parameters
    ----------
    iterations
        Of the whole run.
    """

    def __init__(self, iterations: int) -> None:
        self.iterations = iterations
        self._bar: tqdm | None = None

    def __call__(self, run: Training) -> None:
        """Overwrite the line with the run's last iteration."""
        row = run.rows[-1]
        taken = row["steps"] - (run.rows[-2]["steps"] if len(run.rows) > 1 else 0)
        if self._bar is None:
            self._bar = tqdm(
                total=self.iterations,
                initial=run.iteration,
                disable=None,
                leave=False,
                smoothing=0,
            )
        self._bar.n = run.iteration
        self._bar.set_postfix_str(
            f"return {row['mean_return']:.1f}, KL {row['kl']:.3f}, entropy {row['entropy']:.2f}, "
            f"{taken / max(row['wall_seconds'], 1e-9):,.0f} steps/s"
        )
        if run.iteration == self.iterations:
            self._bar.close()
