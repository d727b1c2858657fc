"""Settings from outside: what they may be, as Python's own numbers and text."""

from __future__ import annotations

import math
import textwrap
import typing
from collections.abc import Iterable, Mapping
from numbers import Integral, Real
from typing import Any

import numpy as np

_KINDS: Mapping[type, tuple[Any, str]] = {
    bool: (bool, "True or False"),
    int: (Integral, "a whole number"),
    float: (Real, "a finite number"),
    str: (str, "text"),
}


class ForeseenError(RuntimeError):
    """Work that cannot go on, for a reason that its message says in full."""


def check_seed(seed: int) -> int:
    """Return the seed if it is an integer from 0 to below 2**64, as torch's; else ValueError."""
    whole = isinstance(seed, Integral) and not isinstance(seed, bool)
    if not whole or not 0 <= int(seed) < 2**64:
        raise ValueError(
            f"seed is {shown(seed)}, but a seed must be an integer of at least 0 and below 2**64."
        )
    return int(seed)


def plain_settings(config: Any) -> None:
    """Make the fields of a frozen dataclass what they say they are, from its ``__post_init__``.

    NumPy's numbers become Python's, and arrays, lists and ranges become tuples: those can be
    compared, written to a file and read again.

    Parameters
    ----------
    config
        Its fields are annotated with bool, int, float or str, with tuples of those, and with
        None as an alternative; fields of other types are left as they are.

    Raises
    ------
    ValueError
        Naming the field, its value and what it must be.
    """
    for name, hint in typing.get_type_hints(type(config)).items():
        value = _plain(name, getattr(config, name), hint)
        object.__setattr__(config, name, value)


def _plain(name: str, value: Any, hint: Any) -> Any:
    options = [hint] if hint in _KINDS else list(typing.get_args(hint)) or [hint]
    if typing.get_origin(hint) is tuple:
        options = [hint]
    if value is None and type(None) in options:
        return None
    kind = options[0]
    if typing.get_origin(kind) is tuple:
        return _plain_tuple(name, value, typing.get_args(kind))
    if kind not in _KINDS:
        return value
    if isinstance(value, np.generic) or (isinstance(value, np.ndarray) and value.ndim == 0):
        value = value.item()
    accepted, words = _KINDS[kind]
    if not isinstance(value, accepted) or (isinstance(value, Real) and not math.isfinite(value)):
        raise ValueError(f"{name} is {shown(value)}, but it must be {words}.")
    return kind(value)


def _plain_tuple(name: str, values: Any, kinds: tuple[Any, ...]) -> tuple[Any, ...]:
    if isinstance(values, str | Mapping) or not isinstance(values, Iterable):
        raise ValueError(f"{name} is {shown(values)}, but it must be several values: a tuple.")
    found = tuple(values)
    if kinds[-1] is ...:
        kinds = (kinds[0],) * len(found)
    if len(found) != len(kinds):
        raise ValueError(
            f"{name} has {len(found)} entries, {shown(found)}, but it must have {len(kinds)}."
        )
    return tuple(_plain(name, v, kind) for v, kind in zip(found, kinds, strict=True))


def shown(value: object) -> str:
    """A value for a sentence: on one line, and shortened where it is long."""
    return textwrap.shorten(repr(value), 100, placeholder=" ...") or repr(value)[:100]
