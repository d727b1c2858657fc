"""Copies of the package and surroundings that are not as usual, for tests of what breaks there."""

import ctypes
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]


def python(*arguments: str, root: Path = ROOT, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run this interpreter on the package in ``root``; ``env`` adds to the surroundings."""
    env = {**os.environ, "PYTHONPATH": str(root), **options.pop("env", {})}
    return subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        timeout=300,
        **{"cwd": root, **options},
        env={name: value for name, value in env.items() if value is not None},
    )


def small_copy(folder: Path, **modules: str) -> Path:
    """A checkout whose package is no more than its lowest modules and these."""
    package = folder / "thesis_lib"
    package.mkdir(parents=True)
    for name in ("__init__.py", "checkout.py", "compiled.py", "imports.py"):
        shutil.copy(ROOT / "thesis_lib" / name, package)
    for name, text in modules.items():
        (package / f"{name}.py").write_text(text)
    (package / "registration.py").write_text("def register():\n    pass\n")
    (folder / "pyproject.toml").write_text("")
    return folder


@contextmanager
def read_only(folder: Path) -> Iterator[dict[str, Any]]:
    """Make a folder read-only; yields options for a process that cannot get around it."""
    paths = [folder, *folder.rglob("*")]
    for path in paths:
        path.chmod(0o555 if path.is_dir() else 0o444)
    try:
        yield {"preexec_fn": _bound_by_permissions}
    finally:
        for path in paths:
            path.chmod(0o755 if path.is_dir() else 0o644)


def _bound_by_permissions() -> None:
    """Give up root's privilege of writing anywhere, from the next program on."""
    drop_from_bounding_set, dac_override = 24, 1  # of linux/prctl.h and linux/capability.h
    if os.geteuid() == 0:
        done = ctypes.CDLL(None).prctl(drop_from_bounding_set, dac_override, 0, 0, 0)
        assert done == 0, "root may write anywhere here"
