"""The checkout this library runs from, and what a result may say made it: commit and versions."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

from thesis_lib import IMPORTED, __version__
from thesis_lib.imports import PACKAGE

_HOME = Path(__file__).resolve().parents[1]


def repository_root() -> Path:
    """The checkout this library runs from, or the working directory when it is installed."""
    return _HOME if (_HOME / "pyproject.toml").exists() else Path.cwd()


def cache_folders(chosen: str = "") -> Iterator[Path]:
    """Folders for what can be made again, the best first; not each can be written to.

    Parameters
    ----------
    chosen
        A folder that a user has set for this.
    """
    if chosen:
        yield Path(chosen, PACKAGE)
    if (_HOME / "pyproject.toml").exists():
        yield _HOME / "_build"
    home = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    if home.is_absolute():  # a user of a container may have no home
        yield home / PACKAGE


def commit() -> str:
    """The commit of this library, with ``+`` when files differ from it, or ``unknown``.

    It is unknown where the library is no checkout of its own, as in an installed wheel or in a
    copy inside another repository, and where a file changed after this process loaded it.
    """
    try:
        if Path(_git("rev-parse", "--show-toplevel")).resolve() != _HOME:
            return "unknown"
        # Each fails or is empty where this repository does not hold this package.
        tracked = _git("ls-files", "--", str(Path(PACKAGE, "__init__.py")))
        head = _git("rev-parse", "--short=12", "HEAD")
        differing = _git("status", "--porcelain", "--untracked-files=no")
        new = _git("ls-files", "--others", "--exclude-standard", "--", PACKAGE)
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    if not tracked or _changed_since_loaded():
        return "unknown"
    return head + ("+" if differing or new else "")


def environment() -> dict[str, Any]:
    """Versions, commit and machine, for provenance."""
    packages = ("numpy", "scipy", "numba", "torch", "mujoco", "gymnasium", "pandas")
    return {
        "python": platform.python_version(),
        "versions": {
            "thesis_lib": __version__,
            **{name: metadata.version(name) for name in packages},
        },
        "commit": commit(),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
    }


def _git(*arguments: str) -> str:
    """What git says of the folder that holds this package, whatever repository a user works in."""
    done = subprocess.run(
        ["git", "--no-optional-locks", "-C", str(_HOME), *arguments],
        env={name: value for name, value in os.environ.items() if not name.startswith("GIT_")},
        capture_output=True,
        text=True,
        encoding="utf-8",
        errors="replace",
        check=True,
    )
    return done.stdout.strip()


def _changed_since_loaded() -> bool:
    """Whether a file of this package that is loaded has changed since."""
    loaded = [module for name, module in sys.modules.items() if name.split(".")[0] == PACKAGE]
    files = [Path(file) for module in loaded if (file := getattr(module, "__file__", None))]
    return any(not file.exists() or file.stat().st_ctime > IMPORTED for file in files)
