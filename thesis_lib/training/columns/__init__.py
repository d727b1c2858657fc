"""What the columns of the training system's tables mean, in the words of ``columns.toml``."""

from __future__ import annotations

import tomllib
from pathlib import Path


def columns(table: str, **numbers: object) -> dict[str, str]:
    """Meaning and unit of each column of a table, in order.

    Parameters
    ----------
    table
        One of those in ``columns.toml``.
    numbers
        What its words leave open, by name.
    """
    words = tomllib.loads(Path(__file__).with_name("columns.toml").read_text(encoding="utf-8"))
    return {name: text.format(**numbers) for name, text in words[table].items()}
