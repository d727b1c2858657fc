"""What several pages need is made once: dear results, kept on disk with the code of them."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable
from dataclasses import asdict
from functools import lru_cache, wraps
from pathlib import Path
from typing import Any, TypeVar

from thesis_lib.checkout import cache_folders, environment, repository_root
from thesis_lib.edition.reach import digest, place
from thesis_lib.files import alone, writable_directory, write_json

RecordT = TypeVar("RecordT")


def remembered(kind: type[RecordT]) -> Callable[[Callable[..., RecordT]], Callable[..., RecordT]]:
    """Keep what a function makes of its arguments for this process and all others.

    It is made anew for another argument, after a change of a definition that the function
    reaches, and with other versions of the packages.  Two processes that ask at once make it
    once.  It lies in the checkout's ``_build`` or the user's cache, and where neither can be
    written to each process makes it again; what the book needs is :func:`committed`.

    Parameters
    ----------
    kind
        Dataclass that the function returns, of numbers, texts and tuples of these.  Arguments
        are told apart by their ``repr``.
    """

    def decorate(function: Callable[..., RecordT]) -> Callable[..., RecordT]:
        asked = inspect.signature(function)

        @lru_cache(maxsize=64)
        @wraps(function)
        def recalled(*args: Any) -> RecordT:
            given = asked.bind(*args)
            given.apply_defaults()
            state = digest([place(recalled)], repr(given.args), repr(environment()["versions"]))
            name = f"{function.__name__}-{state}.json"
            if (made := _read(committed() / name, kind)) is not None:
                return made
            file = _file(name)
            if file is None:
                return function(*args)
            with alone(file.with_suffix(".lock")):
                if (made := _read(file, kind)) is None:
                    made = function(*args)
                    write_json(file, asdict(made))  # type: ignore[call-overload]
                return made

        return recalled

    return decorate


def committed() -> Path:
    """Folder of what the book needs and takes minutes to make: copies out of ``_build``."""
    return repository_root() / "results" / "remembered"


def _read(file: Path, kind: type[RecordT]) -> RecordT | None:
    """A kept result, or None for one that is not there or damaged."""
    try:
        kept: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        return kind(**{k: _tuples(v) for k, v in kept.items()})
    except (OSError, ValueError, TypeError):
        return None


def _file(name: str) -> Path | None:
    for folder in cache_folders():
        try:
            return writable_directory(folder / "remembered") / name
        except ValueError:
            continue
    return None


def _tuples(value: Any) -> Any:
    """JSON's lists as the tuples they were."""
    return tuple(map(_tuples, value)) if isinstance(value, list) else value
