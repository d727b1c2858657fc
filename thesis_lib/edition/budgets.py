"""The names of the budgets, which a command line needs before anything else."""

from __future__ import annotations

BUDGETS = ("smoke", "book", "thesis")
"""smoke: seconds, every code path, values without meaning.  book: what the shipped book
shows.  thesis: as printed."""
