"""Numbers as a person would write them: two digits of the error, a true minus, no ``1e+04``."""

from __future__ import annotations

import re
from collections.abc import Iterable
from itertools import takewhile

import numpy as np

_CODE = re.compile(r"(`[^`]*`|\$[^$]*\$|\{[^}]*\}|\]\([^)]*\))")
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_GREEK = {
    **{"alpha": "α", "gamma": "γ", "delta": "δ", "epsilon": "ε", "theta": "θ", "kappa": "κ"},
    **{"lambda": "λ", "mu": "μ", "pi": "π", "rho": "ρ", "sigma": "σ", "tau": "τ"},
}
_SYMBOLS = (
    *((r"\brho_inf\b", "ρ∞"), (r"\brho_k\b", "ρₖ"), (r"\brho_1\b", "ρ₁"), (r"\^2\b", "²")),
    (r"\^mu\b", "^μ"),
    (r"\bp = nan\b", "p not defined"),
    (r"(?<![\w.])[-−](0\.0+)(?![\d.])", r"\1"),
    (r"\b([a-z]{2,})_([a-z]{3,})\b", r"\1 \2"),
    (r"(?<![\w.)\]-])-(?=\.?\d)", "−"),
    (r"\btheta_1\b", "θ₁"),
    *((rf"(?<![\w^-]){name}(?![\w-])", sign) for name, sign in _GREEK.items()),
    (r"(?<=\d) x (?=\d)", " × "),
    (r"(?<=[\w)∞]) - (?=[\w(])", " − "),
    (r"\((\w)-(\d)\)", r"(\1 − \2)"),
    (r"\((\w)\+(\d)\)", r"(\1 + \2)"),
    (r"\bthe 1 (task|robot)s\b", r"the one \1"),
)
"""What a program writes, and what a person would."""

_NUMBER = re.compile(r"\d[\d,.]*")
_OF_SERIES = re.compile(r"\d.* (at|after) .*\d|\d.* to .*\d \(")


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
    """A mean with the half-width of its interval, small ones with one power of ten for both.

    >>> plus_minus(0.000611, 0.000048), plus_minus(0.0159, 0.0028)
    ('(6.11 ± 0.48) × 10⁻⁴', '0.0159 ± 0.0028')
    """
    if 0 < half_width < 1e-4 and abs(mean) < 0.01:
        power = int(np.floor(np.log10(max(abs(mean), half_width))))
        return f"({plus_minus(mean / 10.0**power, half_width / 10.0**power)}) × {_ten(power)}"
    return f"{number(mean, half_width)} ± {number(half_width, half_width)}"


def span(low: float, high: float) -> str:
    """An interval, ``-1.2 to 3.4``."""
    half = (high - low) / 2
    return f"{number(low, half)} to {number(high, half)}"


def with_interval(value: float, low: float, high: float, form: str = "+.3f") -> str:
    """A number and, in brackets, its interval, which is left out where it is not known.

    >>> with_interval(0.5, -0.25, 1.25, "+.2f"), with_interval(0.5, np.nan, np.nan, ".1f")
    ('+0.50 [-0.25, +1.25]', '0.5')
    """
    return f"{value:{form}}" + ("" if np.isnan(low) else f" [{low:{form}}, {high:{form}}]")


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
        parts[i] = re.sub(r"(?<![\w.,])0\.0{4,}[1-9]\d*", _tiny, parts[i])
    return "".join(parts)


def typeset(text: str) -> str:
    """A plain text with its indices lowered and raised, as the book and Jupyter show them.

    >>> typeset("Q^mu and Q_d by `a_b`, (2^E - 1) 2^G or $Q_d$, p(y|c_i)")
    'Q<sup>μ</sup> and Q<sub>d</sub> by `a_b`, (2<sup>E</sup> − 1) 2<sup>G</sup> or $Q_d$, \
p(y|c<sub>i</sub>)'
    """
    parts = _CODE.split(plain(text))
    for i in range(0, len(parts), 2):
        raised = re.sub(r"(?<=[\w)])\^(\w)(?!\w)", r"<sup>\1</sup>", parts[i])
        parts[i] = re.sub(r"\b([a-zA-Z])_(\w)(?!\w)", r"\1<sub>\2</sub>", raised)
    return "".join(parts)


def brief(text: str, numbers: int = 8) -> str:
    """Evidence whose long lists of numbers are cut; the Scoreboard has them whole.

    Of items that semicolons part, in a sentence or in brackets, as many stay as have some
    numbers; of a series that commas part, the first, or first three, and the last.

    >>> brief("Of 4 (Holm; n = 9): a 1 ± 3; b 2 ± 4; c 3 ± 5; d 4 ± 6; one is 5. So.")
    'Of 4 (Holm; n = 9): a 1 ± 3; b 2 ± 4; c 3 ± 5; d 4 ± 6; one is 5. So.'
    >>> brief("Of 4 (Holm; n = 9): a 1 ± 3; b 2 ± 4; c 3 ± 5; d 4 ± 6; one is 5. So.", 4)
    'Of 4 (Holm; n = 9): a 1 ± 3; 3 more on the Scoreboard; one is 5. So.'
    >>> brief("Left: 9% at 1, 8% at 2, 7% at 3, 6% at 4, 5% at 5, 4% at 6 and 3% at 7.")
    'Left: 9% at 1, 8% at 2, 7% at 3, … and 3% at 7.'
    >>> brief("By 1 to 2 (A), 2 to 3 (B), 3 to 4 (C), 4 to 5 (D); none is 5.")
    'By 1 to 2 (A), … and 4 to 5 (D); none is 5.'
    """
    return " ".join(_brief(sentence, numbers) for sentence in re.split(r"(?<=\.) (?=[A-Z])", text))


def parted(text: str, numbers: int = 8, *, sentences: bool = False) -> tuple[str, str]:
    """Evidence up to where its short form leaves something out, and the rest, if it does.

    Parameters
    ----------
    text, numbers
        As of :func:`brief`.
    sentences
        Whether all after the first sentence is rest.

    Examples
    --------
    >>> parted("It is 3 of 4. So it is.")
    ('It is 3 of 4. So it is.', '')
    >>> parted("It is 3 of 4. So it is.", sentences=True)
    ('It is 3 of 4.', 'So it is.')
    >>> parted("Left: 9% at 1, 8% at 2, 7% at 3, 6% at 4, 5% at 5, 4% at 6 and 3% at 7. So.")
    ('Left: 9% at 1, 8% at 2, 7% at 3,', '6% at 4, 5% at 5, 4% at 6 and 3% at 7. So.')
    """
    short = brief(text, numbers)
    same = sum(
        1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(short, text, strict=False))
    )
    shared = text[:same]
    if shared != text:  # back to where an item ends, as the next may begin with the same digits
        shared = shared[: max(shared.rfind(mark) for mark in (". ", "; ", ", ", ": ")) + 1]
    if sentences and (end := re.search(r"(?<=\.) (?=[A-Z])", shared)):
        shared = shared[: end.start()]
    return (shared.rstrip(), text[len(shared) :].lstrip()) if shared else (text, "")


def _brief(sentence: str, numbers: int) -> str:
    if inner := re.search(r"\(([^()]*;[^()]*:[^()]*)\)", sentence):
        start, end = inner.span(1)
        sentence = sentence[:start] + _first(inner[1], numbers) + sentence[end:]
    return _first(sentence.removesuffix("."), numbers) + "." * sentence.endswith(".")


def _first(text: str, numbers: int) -> str:
    """The first items of those that semicolons part outside brackets, and what follows them."""
    parts = [_ends(part) for part in re.split(r"; (?![^(]*\))", text)]
    size = [_size(re.sub(r"\([^()]*\)", "", part)) + _size(part) for part in parts]
    least = 1 if re.search("[±:]", parts[0]) else 2  # what says of what they are is none
    enough = (n for n in range(least, len(parts)) if sum(size[: n + 1]) > 2 * numbers)
    kept = next(enough, len(parts))
    last = max((n for n, part in enumerate(parts, 1) if re.search("[±:]", part)), default=0)
    if last <= kept or (last == kept + 1 and size[kept] <= numbers):
        return "; ".join(parts)
    return "; ".join([*parts[:kept], f"{last - kept} more on the Scoreboard", *parts[last:]])


def _ends(text: str) -> str:
    """Of a long series that commas part, the first, or the first three if short, and the last."""
    items = re.split(r", (?![^(]*\))", text)
    for start in range(len(items)):
        run = [*takewhile(_OF_SERIES.search, items[start:])]
        head = 3 if run[1:] and _size(run[1]) == 2 and " to " not in run[1] else 1
        if len(run) > head + 2:
            last = run[-1].rpartition(" and ")[2]
            return ", ".join([*items[: start + head], f"… and {last}", *items[start + len(run) :]])
    return text


def _size(text: str) -> int:
    return len(_NUMBER.findall(text))


def _tiny(found: re.Match[str]) -> str:
    """``0.00000175`` as 1.75 × 10⁻⁶."""
    return plain(f"{float(found[0]):.3g}")


def _power(found: re.Match[str]) -> str:
    """``2e-13`` as 2 × 10⁻¹³."""
    digits, exponent = float(found[1]), int(found[2])
    if digits == 0:
        return "0"
    return _ten(exponent) if digits == 1 else f"{found[1]} × {_ten(exponent)}"


def _ten(exponent: int) -> str:
    """``-13`` as 10⁻¹³."""
    return f"10{str(exponent).translate(_RAISED)}"
