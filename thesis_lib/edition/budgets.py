"""The names of the budgets, which a command line needs before anything else."""

from __future__ import annotations

BUDGETS = ("smoke", "book", "thesis")
"""smoke: seconds, every code path, values without meaning.  book: what the shipped book
shows.  thesis: as printed."""


def check_budget(budget: str) -> str:
    """Return the budget if it exists.

    Raises
    ------
    ValueError
        Naming the budgets there are.
    """
    if budget not in BUDGETS:
        raise ValueError(f"budget {budget!r} does not exist: choose one of {', '.join(BUDGETS)}.")
    return budget
