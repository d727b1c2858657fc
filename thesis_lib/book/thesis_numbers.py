"""A Sphinx extension that numbers chapters and what is in them as the thesis does.

``ch03_potentials`` is chapter 3 wherever it stands in the table of contents, and ``appendix_a``
is appendix A: the names of files tell.  An equation, a figure, a table, an algorithm or a theorem
that the thesis prints has the thesis's number, from ``book/thesis_items.csv``; what is ours
alone has a letter, such as figure 3.c, or table a outside the chapters.  Sphinx alone would
number by position.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from docutils.nodes import make_id

from thesis_lib.book.thesis_items import ITEMS, Item, read_items

_KINDS = {"displaymath": "equation", "proposition": "fact"}
"""Kinds of the thesis's items where Sphinx has another word."""

_CHAPTER = re.compile(r"(?:^|/)(?:ch(?P<chapter>\d+)|appendix_(?P<appendix>[a-z]))(?:_|$)")


def thesis_number(docname: str) -> int | str | None:
    """The number of a page in the thesis.

    Parameters
    ----------
    docname
        Path of the page without suffix, such as ``notebooks/appendix_a``.

    Returns
    -------
    int or str or None
        A chapter's number, an appendix's capital letter, or None for any other page.
    """
    match = _CHAPTER.search(docname)
    if match is None:
        return None
    if match["chapter"]:
        return int(match["chapter"])
    return match["appendix"].upper()


def _numbered(env: Any, docname: str) -> Iterator[Any]:
    """Nodes of a page that carry its section numbers: its title and its entries in the toc."""
    nodes = [env.titles[docname], *env.tocs[docname].findall()]
    return (node for node in nodes if getattr(node, "attributes", {}).get("secnumber"))


def _renumber(env: Any) -> None:
    """Replace the first part of every section number by the page's number in the thesis."""
    for docname, numbers in env.toc_secnumbers.items():
        first = thesis_number(docname)
        if first is None:
            continue
        for anchor, number in numbers.items():
            if number:
                numbers[anchor] = (first, *number[1:])
        for node in _numbered(env, docname):
            node["secnumber"] = [first, *node["secnumber"][1:]]


def letter(count: int) -> str:
    """The count-th of a, b, ..., z, aa, ab, ..., from 1.

    >>> [letter(n) for n in (1, 26, 27, 53)]
    ['a', 'z', 'aa', 'ba']
    """
    before, last = divmod(count - 1, 26)
    return (letter(before) if before else "") + chr(ord("a") + last)


def printed_numbers(items: Iterable[Item]) -> dict[tuple[str, str], str]:
    """The thesis's number of what a page shows, by kind and by the identifier on the page.

    An item shown in parts has a, b, ... added; a part that shows two items has both numbers.
    """
    found: dict[tuple[str, str], list[str]] = {}
    for item in items:
        for part, label in enumerate(item.labels, start=1):
            number = item.number + (letter(part) if len(item.labels) > 1 else "")
            prefix = "equation-" if item.kind == "equation" else ""
            found.setdefault((item.kind, make_id(prefix + label)), []).append(number)
    return {key: ", ".join(numbers) for key, numbers in found.items()}


def _number_items(env: Any, printed: Mapping[tuple[str, str], str]) -> None:
    """Give figures, equations and their like the numbers of the thesis, or letters."""
    counts: Counter[tuple[int | str | None, str]] = Counter()
    for docname, by_kind in env.toc_fignumbers.items():
        chapter = thesis_number(docname)
        for kind, numbers in by_kind.items():
            if kind in ("exercise", "solution"):
                continue
            for node_id in numbers:
                known = printed.get((_KINDS.get(kind, kind), make_id(node_id)))
                if known is None:
                    counts[chapter, kind] += 1
                    own = letter(counts[chapter, kind])
                    numbers[node_id] = (own,) if chapter is None else (chapter, own)
                else:
                    numbers[node_id] = (known,)


class _ReadOnce:
    """An environment that reads a page from disk once, for all the numbers looked up on it."""

    def __init__(self, env: Any) -> None:
        self._env = env
        self.get_doctree = cache(env.get_doctree)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._env, name)


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx, around the numbering by position that Jupyter Book has set up.

    A page is read once for all references to its numbers, where Sphinx reads it for each.
    """
    from sphinx.domains.std import StandardDomain
    from sphinx_external_toc.collectors import TocTreeCollectorWithStyles as Collector

    assign, assign_items = Collector.assign_section_numbers, Collector.assign_figure_numbers

    def assign_thesis_numbers(collector: Any, env: Any) -> list[str]:
        before = dict(env.toc_secnumbers)
        assign(collector, env)
        _renumber(env)
        return [name for name, now in env.toc_secnumbers.items() if now != before.get(name)]

    def assign_thesis_items(collector: Any, env: Any) -> list[str]:
        before = dict(env.toc_fignumbers)
        assign_items(collector, env)
        _number_items(env, printed_numbers(read_items(Path(env.srcdir) / ITEMS)))
        return [name for name, now in env.toc_fignumbers.items() if now != before.get(name)]

    resolve: Any = StandardDomain._resolve_numref_xref
    read_once = cache(_ReadOnce)

    def resolve_number(domain: StandardDomain, env: Any, *about: Any) -> Any:
        return resolve(domain, read_once(env), *about)

    StandardDomain._resolve_numref_xref = resolve_number  # type: ignore[method-assign, assignment]
    Collector.assign_section_numbers = assign_thesis_numbers  # type: ignore[method-assign]
    Collector.assign_figure_numbers = assign_thesis_items  # type: ignore[method-assign, assignment]
    return {"parallel_read_safe": True, "parallel_write_safe": True}
