"""Chapters: their experiments, claims and differences.

A chapter's results and words stand in its ``claims.toml``, its functions in its modules; they are
brought together here.  Chapters are imported when asked for, so that a notebook depends on its own
only.
"""

from __future__ import annotations

import difflib
import re
import tomllib
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
from itertools import chain
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from thesis_lib.edition.experiment import Experiment
from thesis_lib.edition.ledger import (
    Claim,
    Criterion,
    Difference,
    Effect,
    Finding,
    Tables,
    Verdict,
)

CHAPTERS = ("chapter2", "chapter3", "appendix_a", "chapter4", "chapter5", "chapter6")
"""In the order in which they are listed."""

ItemT = TypeVar("ItemT", Experiment[Any], Claim, Difference)


@dataclass(frozen=True)
class Chapter:
    """What a chapter of the edition holds, in its order.

    Attributes
    ----------
    experiments, claims, differences
        Of all its results.
    """

    experiments: tuple[Experiment[Any], ...]
    claims: tuple[Claim, ...]
    differences: tuple[Difference, ...]


def read_chapter(package: ModuleType, results: Collection[str] | None = None) -> Chapter:
    """Bring a chapter's results and the words in its ``claims.toml`` together.

    Parameters
    ----------
    package
        Such as ``thesis_lib.chapter3``.
    results
        Only these of its modules; what the others judge and tell is then left out.

    Raises
    ------
    RuntimeError
        If a claim has no criterion, no reason why it cannot be tested and none to rest on, or a
        difference not exactly one effect.
    """
    file = Path(str(package.__file__)).with_name("claims.toml")
    words = tomllib.loads(file.read_text(encoding="utf-8"))
    chosen = [name for name in words["modules"] if results is None or name in results]
    modules = [import_module(f"{package.__name__}.{name}") for name in chosen]
    found = [item for module in modules for item in vars(module).values()]
    criteria = _only_one(x for x in found if isinstance(x, Criterion))
    effects = _only_one(x for x in found if isinstance(x, Effect))
    claims = tuple(
        _claim(row, criteria)
        for row in words.get("claim", ())
        if results is None or row["id"] in criteria
    )
    known = {claim.id: claim for claim in claims}
    differences = tuple(
        _difference(row, effects, known)
        for row in words.get("difference", ())
        if results is None or row["id"] in effects or row.get("claim") in known
    )
    for kind, unused in (("claim", criteria), ("difference", effects)):
        if unused:
            raise RuntimeError(f"claims.toml has no {kind} {next(iter(unused))!r}.")
    # A result may rest on another's experiment, which then is a member of both modules.
    experiments = {x.id: x for x in found if isinstance(x, Experiment)}
    return Chapter(tuple(experiments.values()), claims, differences)


def _only_one(found: Iterable[Criterion | Effect]) -> dict[str, Any]:
    """What judges or tells each claim or difference, by its id."""
    by: dict[str, Criterion | Effect] = {}
    for item in found:
        if by.setdefault(item.subject, item) is not item:
            raise RuntimeError(f"{item.subject!r} has two functions, but must have one.")
    return by


def _claim(row: dict[str, Any], criteria: dict[str, Criterion]) -> Claim:
    """A claim from its words; its criterion is taken out of those given."""
    reason = row.pop("not_testable", None)
    own = criteria.pop(row["id"], None)
    rests_on = tuple(row.pop("rests_on", ()))
    if (own is not None or reason is not None) + bool(rests_on) != 1:
        raise RuntimeError(
            f"claim {row['id']!r} must have a criterion or a `not_testable`, or else a `rests_on`."
        )
    if rests_on:
        row["criterion"] = f"That of {' and '.join(f'`{x}`' for x in rests_on)}."
        # chapters.claims() finds the claims, which may be another chapter's.
        return Claim(**row, experiments=(), judge=_unresolved, rests_on=rests_on)
    if reason is not None:

        def illustrated(tables: Tables) -> Finding:
            """Not testable; what a criterion finds besides is an illustration."""
            shown = f" {own.of(tables).evidence}" if own else ""
            if reason.endswith(":"):  # the sentence goes on, unless it begins with a symbol
                shown = re.sub(r"^ [A-Z](?=[a-z]* )", lambda first: first[0].lower(), shown)
            return Finding(Verdict.NOT_TESTABLE, f"{reason}{shown}")

        needs = own.needs if own else ()
        return Claim(**{"criterion": "None.", **row}, experiments=needs, judge=illustrated)
    assert own is not None
    return Claim(**row, experiments=own.needs, judge=own.of, criteria=(own,))


def _unresolved(tables: Tables) -> Finding:
    raise RuntimeError("a claim that rests on others is judged through chapters.claims() only.")


def _difference(
    row: dict[str, Any], effects: dict[str, Effect], claims: Mapping[str, Claim]
) -> Difference:
    """A difference from its words: its effect is told, computed, or the evidence of a claim."""
    own, claim = effects.pop(row["id"], None), row.pop("claim", None)
    if (own is not None) + (claim is not None) + ("effect" in row) != 1:
        raise RuntimeError(
            f"difference {row['id']!r} must have exactly one of an `effect`, a `claim` whose "
            "evidence tells it, and a function."
        )
    if own is not None:
        return Difference(**row, effect=own.of, experiments=own.needs)
    if claim is not None:
        judge = claims[claim].judge
        return Difference(
            **row,
            effect=lambda tables: judge(tables).evidence,
            experiments=claims[claim].experiments,
        )
    return Difference(**row)


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
    """The experiment of an id.

    Raises
    ------
    ValueError
        With the nearest ids when there is none of that name.
    """
    known = experiments()
    if identifier not in known:
        near = difflib.get_close_matches(identifier, known, 3, 0.4) or list(known)[:3]
        raise ValueError(
            f"there is no experiment {identifier!r}: did you mean {' or '.join(near)}? "
            "`thesis list` shows all."
        )
    return known[identifier]
