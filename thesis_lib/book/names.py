"""A Sphinx extension that links the names of this package that prose and docstrings mention.

``{func}`~thesis_lib.potentials.q_star``` leads to the reference, wherever the name was
defined.  One that the reference does not describe, such as a field or an experiment's module,
is looked up in the package itself and shown as code; one that does not exist there either stays
unresolved, and the build fails.  Names of other libraries in docstrings are shown as they are:
there is no network to look them up in.  On the page Notation plain code is looked up, too.
Attributes that share a line are told apart, and none takes the words before a colon for its type.
"""

from __future__ import annotations

from functools import partial
from importlib import import_module
from typing import Any

from thesis_lib.imports import PACKAGE

NOTATION = "book/notation"
"""The page whose code spans are names of this package, less the package."""

_ABSENT = object()


def find(name: str) -> Any:
    """The object of a dotted name of this package; a field without a default is its name.

    Parameters
    ----------
    name
        Such as ``thesis_lib.mdp.model.TabularMDP.discount``.

    Raises
    ------
    LookupError
        If there is no such object.
    """
    parts = name.split(".")
    if parts[0] != PACKAGE:
        raise LookupError(name)
    for end in range(len(parts), 0, -1):
        try:
            found: Any = import_module(".".join(parts[:end]))
        except ModuleNotFoundError:
            continue
        for part in parts[end:]:
            if part in getattr(found, "__annotations__", {}) and part == parts[-1]:
                return getattr(found, part, part)
            found = getattr(found, part, _ABSENT)
            if found is _ABSENT:
                raise LookupError(name)
        return found
    raise LookupError(name)


def exists(name: str) -> bool:
    """Whether a dotted name of this package can be imported, attributes included."""
    try:
        find(name)
    except LookupError:
        return False
    return True


def _resolve(app: Any, env: Any, node: Any, content: Any) -> Any:
    """Link or show a name that Sphinx does not know (event ``missing-reference``)."""
    if node.get("refdomain") != "py":
        return None
    name = node["reftarget"]
    if name.split(".")[0] != PACKAGE:
        return content if node.get("py:module", "").startswith(PACKAGE) else None
    if not exists(name):
        return None
    found = find(name)
    defined = f"{getattr(found, '__module__', '')}.{getattr(found, '__qualname__', '')}"
    entry = env.domains["py"].objects.get(defined)
    if entry is None:
        return content
    from sphinx.util.nodes import make_refnode

    docname = node.get("refdoc", env.docname)
    return make_refnode(app.builder, docname, entry.docname, entry.node_id, content, name)


def _link_notation(app: Any, doctree: Any) -> None:
    """Make links of the names that the page Notation gives as code (event ``doctree-read``)."""
    from docutils import nodes
    from sphinx.addnodes import pending_xref

    if app.env.docname != NOTATION:
        return
    for code in list(doctree.findall(nodes.literal)):
        name = f"{PACKAGE}.{code.astext().partition('(')[0]}"  # without an argument
        if name.count(".") > 1 and exists(name):
            about = {"refdomain": "py", "reftype": "obj", "reftarget": name, "refwarn": False}
            link = pending_xref("", code.deepcopy(), refdoc=NOTATION, refexplicit=True, **about)
            code.replace_self(link)


def tell_attributes_apart() -> None:
    """Let napoleon read ``low, high`` among attributes as two, as it does among arguments."""
    from sphinx.ext.napoleon.docstring import NumpyDocstring

    as_one = NumpyDocstring._parse_attributes_section

    def parse_each(docstring: Any, section: str) -> list[str]:
        docstring._consume_fields = partial(docstring._consume_fields, multiple=True)
        lines: list[str] = as_one(docstring, section)
        del docstring._consume_fields
        return lines

    NumpyDocstring._parse_attributes_section = parse_each  # type: ignore[method-assign, assignment]


def keep_first_words() -> None:
    """Let napoleon read an attribute's own docstring as text, whatever stands before a colon."""
    from sphinx.ext.napoleon.docstring import NumpyDocstring

    def whole(docstring: Any) -> tuple[str, list[str]]:
        lines = docstring._dedent(docstring._consume_to_end())
        return "", NumpyDocstring(lines, docstring._config).lines()

    NumpyDocstring._consume_inline_attribute = whole  # type: ignore[method-assign, assignment]


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    tell_attributes_apart()
    keep_first_words()
    app.connect("doctree-read", _link_notation)
    app.connect("missing-reference", _resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
