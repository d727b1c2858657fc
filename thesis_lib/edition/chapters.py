"""All chapters: their experiments, claims and differences.

They are imported when asked for, so that a notebook depends on its own chapter only.
"""

from __future__ import annotations

import difflib
import warnings
from collections import Counter
from importlib import import_module
from itertools import chain
from typing import Any, TypeVar

from thesis_lib.edition.experiment import Experiment
from thesis_lib.edition.ledger import Chapter, Claim, Difference, read_chapter

CHAPTERS = ("chapter2", "chapter3", "appendix_a", "chapter4", "chapter5", "chapter6")
"""In the order in which they are listed."""

ItemT = TypeVar("ItemT", Experiment[Any], Claim, Difference)


def chapter(name: str) -> Chapter:
    """A chapter's results, such as those of ``thesis_lib.chapter3``."""
    return read_chapter(import_module(f"thesis_lib.{name}"))


def experiments() -> dict[str, Experiment[Any]]:
    """All experiments by id."""
    return {e.id: e for e in _unique(chain.from_iterable(chapter(n).experiments for n in CHAPTERS))}


def claims() -> tuple[Claim, ...]:
    """All claims; those that rest on others are judged by them."""
    found = _unique(chain.from_iterable(chapter(n).claims for n in CHAPTERS))
    by = {claim.id: claim for claim in found}
    unknown = [(c.id, x) for c in found for x in c.rests_on if x not in by]
    if unknown:
        raise RuntimeError("claim {!r} rests on {!r}, which is not there.".format(*unknown[0]))
    return tuple(c.resting_on([by[x] for x in c.rests_on]) if c.rests_on else c for c in found)


def differences() -> tuple[Difference, ...]:
    """All differences from the thesis."""
    return _unique(chain.from_iterable(chapter(n).differences for n in CHAPTERS))


def _unique(items: chain[ItemT]) -> tuple[ItemT, ...]:
    found = tuple(items)
    twice = [i for i, n in Counter(x.id for x in found).items() if n > 1]
    if twice:
        raise RuntimeError(f"the id {twice[0]!r} is there twice; ids must be unique.")
    return found


def find(identifier: str) -> Experiment[Any]:
    """The experiment of an id, or of one it had before.

    Raises
    ------
    ValueError
        With the nearest ids when there is none of that name.
    """
    known = experiments()
    renamed = {e.was: e for e in known.values() if e.was}
    if identifier in renamed:
        now = renamed[identifier]
        warnings.warn(f"{identifier!r} is called {now.id!r} now: use that.", stacklevel=2)
        return now
    if identifier not in known:
        near = difflib.get_close_matches(identifier, known, 3, 0.4) or list(known)[:3]
        raise ValueError(
            f"there is no experiment {identifier!r}: did you mean {' or '.join(near)}? "
            "`thesis list` shows all."
        )
    return known[identifier]
