"""Checkpoints: what a run keeps on the disk, what made it, and how it is read again."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from functools import cache
from importlib import metadata
from io import BytesIO
from pathlib import Path
from typing import Any

import torch

from thesis_lib import imports
from thesis_lib.files import replacing

FORMAT = 3
"""Version of the checkpoints this library writes and reads."""

FILES = ("checkpoint.pt", "curve.csv", "run.json")
"""What a run keeps in its directory."""

_CONTENT = {"config": dict, "iteration": int, "policy": dict, "baseline": dict, "rows": list}
"""What every checkpoint holds besides its format."""


_LIBRARY = Path(imports.__file__).parent


@cache
def code_digest(module: str = "thesis_lib.training.run") -> str:
    """SHA-256, in hexadecimal, of all code and data a run's numbers come from.

    These are the modules that a module imports, directly or through others, with the tables
    beside them.

    Parameters
    ----------
    module
        That of the runs; for those of a test :mod:`thesis_lib.training.suite`.
    """
    modules = imports.closure([f"import {module}"], _LIBRARY.parent)
    digest = hashlib.sha256()
    for path in sorted({*modules.values(), *imports.data_files(modules)}):
        name = path.relative_to(_LIBRARY).as_posix()
        digest.update(name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def made_with() -> dict[str, str]:
    """What a run's numbers depend on besides its settings: code and versions."""
    needed = ("numpy", "torch", "mujoco", "gymnasium")
    versions = {name: metadata.version(name) for name in needed}
    return {"code": code_digest(), "python": platform.python_version(), **versions}


def check_made_with(content: Mapping[str, Any], path: Path | str) -> None:
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


def foreign(path: Path | str, what: str) -> ValueError:
    """The error for a checkpoint that has something this version cannot use."""
    return ValueError(
        f"the checkpoint in {str(path)!r} has {what}: train again, or use the version of "
        "thesis_lib that wrote it."
    )


def _not_one(file: Path) -> str:
    return (
        f"{str(file)!r} is not a checkpoint of `thesis train`, or is damaged: name another, or "
        "remove it and train again."
    )


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
        raise ValueError(_not_one(file)) from error
    if not isinstance(content, dict) or "format" not in content:
        raise ValueError(_not_one(file))
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
            raise foreign(path, f"no {name}")
    return content
