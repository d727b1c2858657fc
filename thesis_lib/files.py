"""Files are written aside and renamed, so that whoever is killed leaves no half file."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np


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
