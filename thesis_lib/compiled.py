"""Compiled loops, and where numba keeps them so that it never runs an outdated one."""

from __future__ import annotations

import atexit
import hashlib
import shutil
import tempfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numba
import numpy as np
from numba.core.caching import FunctionCache

from thesis_lib import IMPORTED
from thesis_lib.checkout import cache_folders
from thesis_lib.imports import PACKAGE, closure, data_files

_CONFIG: Any = numba.config  # its attributes are not declared
FunctionT = TypeVar("FunctionT", bound=Callable[..., Any])

_ROOT = Path(__file__).resolve().parents[1]
_MONTH = 30 * 24 * 3600.0


def njit(**options: Any) -> Callable[[FunctionT], FunctionT]:
    """``numba.njit`` without the interpreter's lock, kept on disk by the state of all its sources.

    numba looks only at the file of the function it loads; a changed function or constant of
    another file, inlined into it, would go unseen.  Here the folder is named after every module
    of this package that the function's module imports, directly or through others.  A folder
    that a user chose (``NUMBA_CACHE_DIR``) holds ours; a user's own functions are left alone.

    Parameters
    ----------
    **options
        Of ``numba.njit``, such as ``error_model``.
    """

    def decorate(function: FunctionT) -> FunctionT:
        before = _CONFIG.CACHE_DIR, _CONFIG.CACHE_LOCATOR_CLASSES
        _CONFIG.CACHE_DIR = str(cache_folder(Path(function.__code__.co_filename)))
        _CONFIG.CACHE_LOCATOR_CLASSES = "UserProvidedCacheLocator"
        try:
            compiled = numba.njit(nogil=True, **options)(function)
            compiled._cache = _Mending(function)  # as its enable_caching does
            return compiled
        finally:
            _CONFIG.CACHE_DIR, _CONFIG.CACHE_LOCATOR_CLASSES = before

    return decorate


class _Mending(FunctionCache):
    """A cache that is made anew where it cannot be read, as after a power cut."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """What was compiled for a signature, or None."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # numba tells no kind of damage from another
            self.flush()
            return None


def cache_folder(file: Path) -> Path:
    """Folder for the compiled loops of one file, another for every state of what it imports.

    It lies in the first of these that can be written to: ``NUMBA_CACHE_DIR``, the checkout's
    ``_build/numba``, the user's cache; else in a folder that goes with this process.

    Parameters
    ----------
    file
        A module of this package.
    """
    modules = closure([file.read_text(encoding="utf-8")], _ROOT)
    sources = sorted({file, *modules.values(), *data_files(modules)})
    # What changed under a running process may differ from what it has loaded.
    if all(source.stat().st_ctime < IMPORTED for source in sources):
        hashed = hashlib.sha256(f"{numba.__version__} {np.__version__}".encode())
        for source in sources:
            data = source.read_bytes()
            hashed.update(f"{source.name} {len(data)}\0".encode() + data)
        for base in cache_folders(_CONFIG.CACHE_DIR):
            folder = base / "numba" / f"{file.stem}-{hashed.hexdigest()[:16]}"
            if _writable(folder):
                return folder
    return _private()


def _writable(folder: Path) -> bool:
    """Make a folder if it is missing, and remove those of old states; False if that fails."""
    try:
        if not folder.exists():
            folder.mkdir(parents=True, exist_ok=True)
            for old in folder.parent.glob(f"{folder.name.rpartition('-')[0]}-*"):
                if old.stat().st_mtime < IMPORTED - _MONTH:
                    shutil.rmtree(old, ignore_errors=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


@lru_cache(maxsize=1)
def _private() -> Path:
    """A folder of this process: what another user may write to must not be loaded."""
    folder = Path(tempfile.mkdtemp(prefix=f"{PACKAGE}-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
