"""Where numba keeps the loops it compiled, so that it never runs an outdated one."""

from __future__ import annotations

import hashlib
import platform
from pathlib import Path

from thesis_lib.book.imports import PACKAGE, closure


def numba_cache(root: Path) -> Path:
    """Folder for compiled loops, one for every state of the modules that compiled code uses.

    numba looks only at the file of the function it loads; a changed function or constant in
    another file, inlined into it, would go unseen.  So any change to a module that imports
    numba, or to one such a module imports, starts afresh.
    """
    compiled = [
        file.relative_to(root).with_suffix("").as_posix().replace("/", ".")
        for file in (root / PACKAGE).rglob("*.py")
        if b"numba" in file.read_bytes()
    ]
    hashed = hashlib.sha256(platform.python_version().encode())
    hashed.update((root / "constraints.txt").read_bytes())
    for name, file in closure([f"import {name}" for name in compiled], root).items():
        hashed.update(name.encode() + b"\0" + file.read_bytes())
    return root / "_build" / "numba" / hashed.hexdigest()[:16]
