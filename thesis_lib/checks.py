"""Arguments and settings from outside: what they may be, as Python's own numbers and text."""

from __future__ import annotations

import copy
import dataclasses
import math
import textwrap
import types
import typing
from collections.abc import Collection, Iterable, Mapping
from functools import cache
from numbers import Integral, Real
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np

ConfigT = TypeVar("ConfigT")

Choice = TypeVar("Choice", bound=str)

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


def generator(rng: np.random.Generator | int) -> np.random.Generator:
    """Turn a seed into a generator, and let a generator through.

    Parameters
    ----------
    rng
        A NumPy generator, or a seed: an integer of at least 0.

    Raises
    ------
    ValueError
        When the seed is negative or no integer.
    """
    if isinstance(rng, np.random.Generator):
        return rng
    if isinstance(rng, bool) or not isinstance(rng, (int, np.integer)) or rng < 0:
        raise ValueError(
            f"rng is {rng!r}, but it must be a numpy Generator or a seed, an integer of at least 0."
        )
    return np.random.default_rng(int(rng))


def one_of(name: str, value: Choice, allowed: Collection[Choice]) -> Choice:
    """Return ``value`` if it is one of ``allowed``, and raise ValueError otherwise."""
    if value not in allowed:
        raise ValueError(f"{name} {value!r} does not exist: choose one of {', '.join(allowed)}.")
    return value


def positive_integer(name: str, value: int) -> int:
    """Return ``value`` if it is an integer of at least 1, and raise ValueError otherwise."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
        raise ValueError(f"{name} is {value!r}, but it must be an integer of at least 1.")
    return int(value)


def probability(name: str, value: float) -> float:
    """Return ``value`` if it is in [0, 1], and raise ValueError otherwise."""
    if not 0.0 <= value <= 1.0:
        raise ValueError(f"{name} is {value}, but it must be in [0, 1].")
    return float(value)


def positive_number(name: str, value: float) -> float:
    """Return ``value`` if it is finite and above 0, and raise ValueError otherwise."""
    if not 0.0 < value < np.inf:
        raise ValueError(f"{name} is {value}, but it must be positive and finite.")
    return float(value)


def plain_settings(config: Any) -> None:
    """Make the fields of a frozen dataclass what they say they are, from its ``__post_init__``.

    NumPy's numbers become Python's, and arrays, lists and ranges become tuples: those can be
    compared, written to a file and read again.

    Parameters
    ----------
    config
        Its fields are annotated with bool, int, float, str, a Literal or another such dataclass,
        with tuples of those, and with alternatives; fields of other types are left as they are.

    Raises
    ------
    ValueError
        Naming the field, its value and what it must be.
    """
    hints = _hints(type(config))  # type: ignore[arg-type]
    for field in dataclasses.fields(config):
        value = _plain(field.name, getattr(config, field.name), hints[field.name])
        object.__setattr__(config, field.name, value)


@cache
def _hints(kind: type) -> dict[str, Any]:
    """Types of the fields of a dataclass; reading them takes longer than checking the values."""
    return typing.get_type_hints(kind)


def plain(config: ConfigT) -> ConfigT:
    """A copy of a dataclass with :func:`plain_settings`; ValueError as there."""
    copied = copy.copy(config)
    plain_settings(copied)
    return copied


def _plain(name: str, value: Any, hint: Any) -> Any:
    options = [hint]
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        options = [option for option in typing.get_args(hint) if option is not type(None)]
        if value is None and len(options) < len(typing.get_args(hint)):
            return None
    errors = []
    for option in options:
        try:
            return _plain_as(option, name, value)
        except ValueError as error:
            errors.append(error)
    raise errors[0]


def _plain_as(kind: Any, name: str, value: Any) -> Any:
    if typing.get_origin(kind) is tuple:
        return _plain_tuple(name, value, typing.get_args(kind))
    if isinstance(kind, type) and dataclasses.is_dataclass(kind) and isinstance(value, kind):
        return plain(value)
    if isinstance(value, np.generic) or (isinstance(value, np.ndarray) and value.ndim == 0):
        value = value.item()
    if typing.get_origin(kind) is Literal:
        allowed = typing.get_args(kind)
        if not any(type(value) is type(one) and value == one for one in allowed):
            words = ", ".join(map(str, allowed))
            raise ValueError(f"{name} {shown(value)} does not exist: choose one of {words}.")
    elif kind in _KINDS:
        accepted, words = _KINDS[kind]
        right = isinstance(value, accepted) and isinstance(value, bool) == (kind is bool)
        if not right or (isinstance(value, Real) and not math.isfinite(value)):
            raise ValueError(f"{name} is {shown(value)}, but it must be {words}.")
        return kind(value)
    return value


def _plain_tuple(name: str, values: Any, kinds: tuple[Any, ...]) -> tuple[Any, ...]:
    scalar = isinstance(values, str | Mapping) or not isinstance(values, Iterable)
    if scalar or (isinstance(values, np.ndarray) and values.ndim == 0):
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


def as_json(value: object) -> object:
    """What ``json.dumps`` is to write for what it does not know (its ``default``)."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, set | frozenset):
        return sorted(value)
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")
