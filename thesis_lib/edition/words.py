"""Numbers as a person would write them: two digits of the error, a true minus, no ``1e+04``."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np


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
