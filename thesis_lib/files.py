"""Files are written aside and renamed, so that whoever is killed leaves no half file."""

from __future__ import annotations

import fcntl
import json
import math
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from thesis_lib.checks import as_json


def writable_directory(directory: Path | str) -> Path:
    """Make a directory if it is missing and check that it can be written to.

    Raises
    ------
    ValueError
        With the path and the way out.
    """
    folder = Path(directory)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise ValueError(
            f"{str(folder)!r} cannot be written to ({error.strerror}): choose a directory you "
            "may write to with --out."
        ) from None
    return folder


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Write to a temporary file beside ``path`` and rename it, so that no half file is left."""
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        # Pandas writes numbers as NumPy prints them, which a user may have set otherwise.
        with np.printoptions(legacy=False):
            yield temporary
        # mkstemp makes private files; a result is as readable as any other new file.
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write_json(path: Path, value: object) -> None:
    """Write a value as JSON, aside and renamed, with NumPy's numbers as Python's."""
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(value, indent=1, default=as_json) + "\n", encoding="utf-8")


@contextmanager
def alone(
    path: Path, busy: Callable[[], object] = lambda: None, *, patience: float = 0.0
) -> Iterator[None]:
    """Hold a folder, or a file that is made if missing, which one process at a time can.

    The lock goes with the process however it ends.

    Parameters
    ----------
    path
        What is held.
    busy
        Called once when another process still holds it after a while; unless it raises, the
        wait goes on.
    patience
        That while, in seconds.
    """
    handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR | os.O_CREAT, 0o666)
    patient_until = time.monotonic() + patience
    try:
        while not _taken(handle):
            if time.monotonic() >= patient_until:
                busy()
                patient_until = math.inf
            time.sleep(0.2)
        yield
    finally:
        os.close(handle)


def _taken(handle: int) -> bool:
    """Take a lock, if no other process holds it."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
