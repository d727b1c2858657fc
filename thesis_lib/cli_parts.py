"""What the commands of ``thesis`` share: settings that are checked by us, tables, exit status."""

from __future__ import annotations

import dataclasses
import re
import signal
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import tyro

if TYPE_CHECKING:
    import pandas as pd

try:
    from tyro import _errors as tyro_errors
except ImportError:  # a tyro of another version draws its box
    tyro_errors = None  # type: ignore[assignment]


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


def parsed(
    kind: Any, arguments: Sequence[str], prog: str, *, command: str = "", **options: Any
) -> Any:
    """What ``tyro.cli`` makes of arguments; what it cannot read is one sentence, and no box.

    Parameters
    ----------
    kind, arguments, prog, **options
        Of ``tyro.cli``.
    command
        Whose ``--help`` the sentence names; default ``prog``.

    Raises
    ------
    ValueError
        With what was given, what is allowed, and where to read on.
    """
    see = f"see `{command or prog} --help`."

    def refuse(event: Any) -> None:
        fields = vars(event)
        if commands := fields.get("subcommand_spec"):
            given = f"there is no command {arguments[0]!r}" if arguments else "a command is missing"
            raise ValueError(f"{given}: choose one of {', '.join(commands.parser_from_name)}.")
        if missing := fields.get("missing_arguments"):
            names = " and ".join(m.arg.field.intern_name for m in missing)
            raise ValueError(f"`{command or prog}` needs {names}: {see}")
        if fields.get("argument"):
            flag = fields["argument"].lowered
            why = fields.get("message", "").partition("\n\n")[0]
            value = re.search(r"(\[.*\]|'[^']*')\.?$", why)
            has = f"is {value[1]}" if value else "has no value"
            raise ValueError(
                f"{'/'.join(flag.name_or_flags)} {has}, but takes {flag.metavar}: {see}"
            )
        if fields.get("tokens"):
            raise ValueError(f"{fields['tokens'][0]!r} is not known: {see}")

    with tyro_errors.on_parse_error(refuse) if tyro_errors else nullcontext():
        return tyro.cli(kind, args=list(arguments), prog=prog, **options)


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
