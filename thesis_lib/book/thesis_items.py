"""The numbered items of the thesis: where this edition has each, and what it did with it.

They stand in ``book/thesis_items.csv``, a row an item.  The pages take their numbers from it, and
the page *Map of the thesis* is written from it.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from thesis_lib.book.tables import rows_markdown
from thesis_lib.edition.chapters import experiments
from thesis_lib.edition.deepest import committed
from thesis_lib.edition.experiment import Experiment
from thesis_lib.edition.ledger import Judgement
from thesis_lib.edition.reach import ROOT, place, reached

ITEMS = Path("book", "thesis_items.csv")
"""The file, in the checkout and in the staged book."""

_PROVED = ("theorem", "corollary", "lemma", "fact")


@dataclass(frozen=True)
class Item:
    """A numbered item of the thesis.

    Attributes
    ----------
    kind
        ``equation``, ``algorithm``, ``definition``, ``theorem``, ``corollary``, ``lemma``,
        ``fact``, ``table``, ``figure`` or ``footnote``.
    number
        As the thesis prints it; a footnote's has its chapter before it.
    about
        A few words.
    labels
        Where this edition has it, the parts in order.
    experiment
        Id of the experiment that re-runs it, or nothing.
    claim
        Id of the claim of the ledger that judges it, or nothing.
    state
        What was done with it, where neither tells.
    """

    kind: str
    number: str
    about: str
    labels: tuple[str, ...]
    experiment: str
    claim: str
    state: str


def read_items(path: Path) -> list[Item]:
    """Read the file; its rows are in the order of the page."""
    with path.open(encoding="utf-8", newline="") as file:
        return [
            Item(
                *(row["kind"], row["number"], row["about"], tuple(row["label"].split())),
                *(row["experiment"], row["claim"], row["state"]),
            )
            for row in csv.DictReader(file)
        ]


def items_markdown(items: Iterable[Item], judged: Iterable[Judgement]) -> str:
    """Body of the page *Map of the thesis*: a table for each kind of item, as MyST Markdown.

    Parameters
    ----------
    items
        In the file's order.
    judged
        The ledger's verdicts.
    """
    known, verdicts = experiments(), {j.claim.id: j.in_words() for j in judged}
    lines: list[str] = []
    for heading, group in groupby(items, key=_heading):
        rows = []
        for item in group:
            state = [item.state]
            if item.experiment:
                state.append(_run(known[item.experiment], item.kind))
            if item.claim:
                state.append(f"claim {verdicts[item.claim]}")
            here, done = ", ".join(map(link, item.labels)), "; ".join(filter(None, state))
            rows.append((f"{item.kind} {item.number}", item.about, here, done))
        table = rows_markdown(("thesis", "what", "here", "state"), rows)
        lines += [f"## {heading}", "", *table, ""]
    return "\n".join(lines)


def _heading(item: Item) -> str:
    proved = item.kind in _PROVED
    return "Theorems, lemmas and facts" if proved else f"{item.kind.capitalize()}s"


def link(label: str) -> str:
    """A link to an item or a section, that shows its number or its title."""
    kind = label.partition("-")[0]
    if kind == "eq":
        return f"{{eq}}`{label}`"
    if kind in ("fig", "tbl"):
        return f"{{numref}}`{label}`"
    return f"[](#{label})" if kind in ("sec", "ch") else f"{{prf:ref}}`{label}`"


def _run(experiment: Experiment, kind: str) -> str:
    """How an item's experiment is run for the shipped book, with the command."""
    if kind not in ("table", "figure"):  # the thesis printed no budget, and mostly ran nothing
        return f"run here, `thesis run {experiment.id}`"
    _, files = reached([place(experiment)])
    if any(file.is_relative_to(ROOT / "results") for file in files):
        made = "re-run in part, from committed runs"
    elif (
        experiment.config("book") == experiment.config("thesis")
        or (committed() / f"{experiment.id}.json").is_file()
    ):
        made = "re-run at the printed budget"
    else:
        made = "re-run with other numbers"
    return f"{made}, `thesis run {experiment.id}`"
