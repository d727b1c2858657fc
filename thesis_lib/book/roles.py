"""A Sphinx extension by which pages quote the ledger: no verdict or number is typed.

``{claim}`3.4.1-numbers``` prints what a claim says, ``{verdict}`3.4.1-numbers``` the verdict on it,
with a link to its row of the Scoreboard, and ``{evidence}`3.4.1-numbers``` the sentences that
support it, or the first of them if the id is followed by ``first``.  An id that does not exist
fails the build.

A section that differences from the thesis concern ends with links to their rows.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.util.docutils import SphinxRole

LEDGER = Path("book", "_generated", "ledger.json")
DIFFERENCES = LEDGER.with_name("differences.json")


class _Quote(SphinxRole):
    """Looks a claim up."""

    def claim(self) -> dict[str, str]:
        """Words, verdict and evidence; the checkout's own pages have none before they are built."""
        file = Path(self.env.srcdir, LEDGER)
        self.env.note_dependency(str(file))
        ledger = json.loads(file.read_text(encoding="utf-8"))
        if ledger and self.text not in ledger:
            message = f"the ledger has no claim {self.text!r}"
            self.inliner.reporter.warning(message, line=self.lineno)
        missing = {"verdict": "not built"}
        missing |= dict.fromkeys(("statement", "evidence", "first"), "Not built.")
        return dict(ledger.get(self.text, missing))


def _link(target: str, words: str, docname: str) -> nodes.Node:
    """A link to a label."""
    return pending_xref(
        "",
        nodes.inline(words, words, classes=["xref", "std"]),
        refdomain="std",
        reftype="ref",
        reftarget=target.lower(),
        refexplicit=True,
        refwarn=True,
        refdoc=docname,
    )


class Statement(_Quote):
    """What a claim says."""

    def run(self) -> tuple[list[nodes.Node], list[nodes.system_message]]:
        """Make the text."""
        return [nodes.Text(self.claim()["statement"])], []


class Verdict(_Quote):
    """The verdict on a claim, which leads to its row."""

    def run(self) -> tuple[list[nodes.Node], list[nodes.system_message]]:
        """Make the link."""
        target = f"claim-{self.text}"
        return [_link(target, self.claim()["verdict"], self.env.docname)], []


class Evidence(_Quote):
    """The evidence for it."""

    def run(self) -> tuple[list[nodes.Node], list[nodes.system_message]]:
        """Make the text."""
        self.text, _, part = self.text.partition(" ")
        return [nodes.Text(self.claim()["first" if part == "first" else "evidence"])], []


def _tell_differences(app: Any, doctree: nodes.document) -> None:
    """End sections with links to the differences that concern them (event ``doctree-read``)."""
    file = Path(app.srcdir, DIFFERENCES)
    app.env.note_dependency(str(file))
    places = json.loads(file.read_text(encoding="utf-8"))
    for section in list(doctree.findall(nodes.section)):
        topics = [topic for name in section["names"] for topic in places.get(name, {}).items()]
        if not topics:
            continue
        line = nodes.paragraph("", "Different from the thesis: ", classes=["differences"])
        for i, (difference, topic) in enumerate(topics):
            line += [nodes.Text("; " * bool(i))]
            line += [_link(f"difference-{difference}", topic, app.env.docname)]
        line += [nodes.Text(".")]
        inner = (i for i, child in enumerate(section) if isinstance(child, nodes.section))
        section.insert(next(inner, len(section)), line)


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.add_role("claim", Statement())
    app.add_role("verdict", Verdict())
    app.add_role("evidence", Evidence())
    app.connect("doctree-read", _tell_differences)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
