"""Tables of the generated pages, as MyST Markdown."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence


def rows_markdown(
    heads: Sequence[str], rows: Iterable[Iterable[object]], right: Collection[str] = ()
) -> list[str]:
    """Lines of a table.

    Parameters
    ----------
    heads
        Of its columns.
    rows
        Their cells.
    right
        Heads of the columns that are flush right.
    """
    lines = [heads, ["--:" if head in right else ":--" for head in heads], *rows]
    return [f"| {' | '.join(map(str, cells))} |" for cells in lines]


def table_markdown(
    title: str,
    name: str,
    heads: Sequence[str],
    rows: Iterable[Iterable[object]],
    right: Collection[str] = (),
    look: str = "",
) -> list[str]:
    """Lines of a table with a title, a label and, if it has a look of its own, its class."""
    options = [f":name: {name}", *([f":class: {look}"] if look else [])]
    return [
        *(f"::::{{table}} {title}", *options, ""),
        *rows_markdown(heads, rows, right),
        *("::::", ""),
    ]
