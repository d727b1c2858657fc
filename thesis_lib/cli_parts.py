"""What the commands of ``thesis`` share: settings that are checked by us, tables, exit status."""

from __future__ import annotations

import dataclasses
import signal
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import tyro

if TYPE_CHECKING:
    import pandas as pd

SettingsT = TypeVar("SettingsT")


def unchecked(kind: type[SettingsT], hidden: Sequence[str] = ()) -> type[SettingsT]:
    """A dataclass of the same fields that takes any value; :func:`checked` checks them.

    The parser of the command line wraps what a dataclass raises into a box of its own, and
    we want one sentence.

    Parameters
    ----------
    kind
        A frozen dataclass.
    hidden
        Fields that cannot be set on the command line.
    """
    body: dict[str, Any] = {
        "__doc__": kind.__doc__,
        "__module__": kind.__module__,
        "__post_init__": lambda self: None,
        "__annotations__": dict.fromkeys(hidden, tyro.conf.Suppress[tyro.conf.Fixed[str]]),
    }
    return dataclass(frozen=True)(type(kind.__name__, (kind,), body))


def checked(kind: type[SettingsT], given: Any) -> SettingsT:
    """The settings that were given, checked; ValueError for those that cannot be."""
    return kind(**{f.name: getattr(given, f.name) for f in dataclasses.fields(given)})


def text(table: pd.DataFrame, most: int = 60) -> str:
    """A table as text, long ones with their middle left out."""
    import pandas as pd

    shown = table
    note = ""
    if len(table) > most:
        shown = pd.concat([table.head(most // 2), table.tail(most // 2)])
        note = f"\n({len(table) - most} rows in the middle are not shown)"
    return shown.to_string(index=False, float_format=lambda v: f"{v:.5g}") + note


def status(stop: KeyboardInterrupt) -> int:
    """Exit status after an interrupt, as shells count: 128 and the signal's number."""
    return 128 + next(iter(stop.args), signal.SIGINT)
