"""A Sphinx extension that numbers chapters as the thesis does, from their file names.

``ch03_potentials`` is chapter 3 wherever it stands in the table of contents, and ``appendix_a``
is appendix A, with figures A.1, A.2, ...  Sphinx alone would number by position.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

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


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx, around the numbering by position that Jupyter Book has set up."""
    from sphinx_external_toc.collectors import TocTreeCollectorWithStyles as Collector

    assign = Collector.assign_section_numbers

    def assign_thesis_numbers(collector: Any, env: Any) -> list[str]:
        before = dict(env.toc_secnumbers)
        assign(collector, env)
        _renumber(env)
        return [name for name, now in env.toc_secnumbers.items() if now != before.get(name)]

    Collector.assign_section_numbers = assign_thesis_numbers  # type: ignore[method-assign]
    return {"parallel_read_safe": True, "parallel_write_safe": True}
