"""Helpers of the notebooks that have not moved to :mod:`thesis_lib.edition.page` yet."""

from __future__ import annotations

import importlib.util

import numpy as np

from thesis_lib.edition.page import Page, start, table

__all__ = ["Page", "glue", "start", "table"]


def glue(name: str, value: object) -> None:
    """Store a value under a name, for use in the page's prose.

    In Markdown, ``{glue:text}`name:.2f``` prints a number with two decimals and
    ``{glue:}`name``` anything else.  Where ``myst_nb`` is missing (Colab, a bare Jupyter), the
    value is printed instead, so the reader still sees what the prose means.

    Parameters
    ----------
    name
        Name of the value, unique on the page.
    value
        A number, a string, a table or a figure.
    """
    if isinstance(value, np.generic):
        value = value.item()  # numpy's own text form, np.float64(...), cannot be formatted
    if importlib.util.find_spec("myst_nb") is None:
        print(f"{name} = {value}  (myst_nb is not installed: the prose shows this in the book)")
        return
    from myst_nb import glue as store

    store(name, value, display=False)
