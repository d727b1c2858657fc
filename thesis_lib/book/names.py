"""A Sphinx extension that checks the names of this package that prose mentions.

``{func}`~thesis_lib.potentials.q_star``` prints as code.  There is no index of the package's
names in the book to link to, so the name is looked up in the package itself; one that does not
exist there stays unresolved, and the build fails.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from thesis_lib.imports import PACKAGE


def exists(name: str) -> bool:
    """Whether a dotted name of this package can be imported, attributes included.

    Parameters
    ----------
    name
        Such as ``thesis_lib.mdp.model.TabularMDP.discount``.
    """
    parts = name.split(".")
    if parts[0] != PACKAGE:
        return False
    for end in range(len(parts), 0, -1):
        try:
            found: Any = import_module(".".join(parts[:end]))
        except ModuleNotFoundError:
            continue
        for part in parts[end:]:
            if part in getattr(found, "__annotations__", {}):
                return part == parts[-1]
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False


def _resolve(app: Any, env: Any, node: Any, content: Any) -> Any:
    """Show an existing name as it is (Sphinx event ``missing-reference``)."""
    known = node.get("refdomain") == "py" and exists(node["reftarget"])
    return content if known else None


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("missing-reference", _resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
