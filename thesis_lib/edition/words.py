"""Numbers as a person would write them: two digits of the error, a true minus, no ``1e+04``."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np

_CODE = re.compile(r"(`[^`]*`|\$[^$]*\$|\{[^}]*\}|\]\([^)]*\))")
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_GREEK = {"alpha": "α", "gamma": "γ", "epsilon": "ε"}
_SYMBOLS = (
    *((r"\brho_inf\b", "ρ∞"), (r"\brho_k\b", "ρₖ"), (r"\brho_1\b", "ρ₁"), (r"\^2\b", "²")),
    (r"\^mu\b", "^μ"),
    (r"\bp = nan\b", "p not defined"),
    (r"(?<![\w.])[-−](0\.0+)(?![\d.])", r"\1"),
    (r"\b([a-z]{2,})_([a-z]{3,})\b", r"\1 \2"),
    (r"(?<![\w.)\]-])-(?=\.?\d)", "−"),
    *((rf"\b{name}\b(?= (?:= )?\.?\d)", sign) for name, sign in _GREEK.items()),
    (r"\bthe 1 (task|robot)s\b", r"the one \1"),
)
"""What a program writes, and what a person would."""


def number(value: float, error: float = 0.0, *, sign: bool = False) -> str:
    """A number to two digits of its error, or to three of its own without one.

    Parameters
    ----------
    value
        Finite.
    error
        Half-width of its interval, or anything else of the size of what is not known.
    sign
        Whether a positive number has a plus.
    """
    size, digits = (abs(error), 2) if error else (abs(value), 3)
    places = digits - 1 - int(np.floor(np.log10(size))) if size > 0 else 0
    rounded = round(value, places)
    text = f"{rounded:{'+' if sign else ''},.{max(0, places)}f}"
    if not error and "." in text:
        text = text.rstrip("0").rstrip(".")
    return text.replace("-", "−") if rounded else text.replace("-", "")


def plus_minus(mean: float, half_width: float) -> str:
    """A mean with the half-width of its interval."""
    return f"{number(mean, half_width)} ± {number(half_width, half_width)}"


def span(low: float, high: float) -> str:
    """An interval, ``-1.2 to 3.4``."""
    half = (high - low) / 2
    return f"{number(low, half)} to {number(high, half)}"


def probability(p: float) -> str:
    """A p-value: ``p = 0.03``, or ``p < 0.001``."""
    if p < 0.001:
        return "p < 0.001"
    return f"p = {p:.{max(2, 1 - int(np.floor(np.log10(p))))}f}"


def several(items: Iterable[str]) -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    *most, last = items
    return f"{', '.join(most)} and {last}" if most else last


def plain(text: str) -> str:
    """A text without marks of the program that wrote it, but for code and mathematics in it.

    >>> plain("by 2e-13 at after_next, or 1e-09; `a_b` 1e+04")
    'by 2 × 10⁻¹³ at after next, or 10⁻⁹; `a_b` 10⁴'
    """
    parts = _CODE.split(text)
    for i in range(0, len(parts), 2):
        power = r"(?<![\w.])(\d+(?:\.\d+)?)e([+-]?\d+)\b"
        parts[i] = re.sub(power, _power, parts[i])
        for machine, person in _SYMBOLS:
            parts[i] = re.sub(machine, person, parts[i])
    return "".join(parts)


def _power(found: re.Match[str]) -> str:
    """``2e-13`` as 2 × 10⁻¹³."""
    digits, exponent = float(found[1]), int(found[2])
    if digits == 0:
        return "0"
    raised = f"10{str(exponent).translate(_RAISED)}"
    return raised if digits == 1 else f"{found[1]} × {raised}"
