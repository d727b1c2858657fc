"""The drill of mutants on the page *Status*, and the digest that ties a row to the code."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import pandas as pd

from thesis_lib.book.tables import table_markdown
from thesis_lib.checkout import repository_root
from thesis_lib.edition import chapters, roots
from thesis_lib.edition.reach import digest

STOPS = "stops with an error"
"""Outcome of evidence that a mutant keeps from being made: noticed, but no verdict."""


def code_of_mutant(file: str, test: str, claims: Sequence[str], budget: str) -> str:
    """Digest of what a mutant's row rests on.

    Parameters
    ----------
    file
        The module it changes, below ``thesis_lib``.
    test
        The file of the test that must fail; what is after a space does not count.
    claims
        Ids whose verdicts it may move.
    budget
        Of their evidence.
    """
    known = {claim.id: claim for claim in chapters.claims()}
    codes = [roots.code_of_claim(known[claim], budget) for claim in claims]
    module = f"thesis_lib.{file.removesuffix('.py').replace('/', '.')}"
    tests = (repository_root() / test.partition(" ")[0]).read_text(encoding="utf-8")
    return digest([(module, "")], tests, *codes)


def mutants_markdown(mutants: pd.DataFrame) -> str:
    """The table of mutants on the page *Status*.

    Parameters
    ----------
    mutants
        What ``benchmarks/mutants.py`` wrote.
    """
    rows = (
        (
            *(m.mutant, f"`{m.file}`", "yes" if m.caught else "no"),
            _moved(_text(m.verdicts)) + (f" (none: {m.reason})" if _text(m.reason) else ""),
            *(short_commit(m.commit), _since(m)),
        )
        for m in mutants.itertuples()
    )
    title = "Faults put into the library: a test must fail, and a verdict change"
    heads = ("mutant", "of", "a test fails", "verdicts", "commit", "the code since then")
    return "\n".join(table_markdown(title, "tbl-status-mutants", heads, rows, look="cards"))


def _text(value: object) -> str:
    """A cell of a table, in which what is empty may be no text."""
    return value if isinstance(value, str) else ""


def _moved(verdicts: str) -> str:
    """Which verdicts a mutant moves; a message of Python's would say nothing here."""
    return re.sub(r"error: [^;]*", STOPS, verdicts.replace("->", "→"))


def short_commit(commit: str) -> str:
    """Eight digits of a commit, with the plus sign of one with changes on top."""
    if commit == "unknown":
        return "not recorded"
    return commit[:8] + ("+" if commit.endswith("+") else "")


def _since(row: Any) -> str:
    """Whether the code that a row rests on is as it was."""
    if not (code := _text(row.code)):
        return "not recorded"
    claims = re.findall(r"(?:^|; )([^:;]+): [^;]* -> ", _text(row.verdicts))
    same = code_of_mutant(row.file, row.test, claims, row.budget) == code
    return "as it was" if same else "changed"
