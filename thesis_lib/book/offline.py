"""A Sphinx extension that keeps every page from asking the network for anything.

MathJax is shipped with the book: the ``sphinx-mathjax-offline`` package holds all of it
(24 MB), of which a page needs one script and its fonts (3 MB), copied into the static folder.
The script that moves the charts (:mod:`thesis_lib.book.charts`) is bundled by ``vl-convert``,
and a page that has none does not load it.  The scripts of thebe, which Jupyter Book puts on
every page whether it is used or not and which would load code from a content network on a
click, are left out.
"""

from __future__ import annotations

import importlib.util
import shutil
from pathlib import Path
from typing import Any

_SCRIPT = "tex-chtml-full.js"
_FONTS = Path("output", "chtml", "fonts", "woff-v2")


def mathjax_source() -> Path:
    """Folder of the installed MathJax.

    Raises
    ------
    ValueError
        If the package ``sphinx-mathjax-offline`` is not installed.
    """
    spec = importlib.util.find_spec("sphinx-mathjax-offline")
    if spec is None or spec.origin is None:
        raise ValueError(
            "the package sphinx-mathjax-offline is missing, so the book's mathematics would come "
            "from the network; run `make setup` to install it."
        )
    return Path(spec.origin).parent / "static" / "mathjax"


def _copy_mathjax(app: Any, exception: Exception | None) -> None:
    """Copy script and fonts into the built book (Sphinx event ``build-finished``)."""
    if exception is not None or app.builder.format != "html":
        return
    source, target = mathjax_source(), Path(app.outdir, "_static", "mathjax")
    for file in [Path(_SCRIPT), *(_FONTS / font.name for font in (source / _FONTS).iterdir())]:
        copy = target / file
        if not copy.exists():
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source / file, copy)


def _bundle_charts(app: Any, exception: Exception | None) -> None:
    """Write Vega, Vega-Lite and vega-embed as one script (Sphinx event ``build-finished``)."""
    target = Path(app.outdir, "_static", "charts.js")
    if exception is None and app.builder.format == "html" and not target.exists():
        import vl_convert

        # In a function of its own, since its names are those of Sphinx's scripts too.
        bundle = vl_convert.javascript_bundle(None)  # type: ignore[arg-type]
        target.write_text(f"(() => {{\n{bundle}\n}})();\n", encoding="utf-8")


def _drop_maps(app: Any, exception: Exception | None) -> None:
    """Leave out what only debuggers of the theme's scripts read, 3 MB of it."""
    for file in Path(app.outdir, "_static").rglob("*.map"):
        file.unlink()


def _drop_thebe(
    app: Any, pagename: str, templatename: str, context: dict[str, Any], doctree: Any
) -> None:
    """Leave thebe's scripts out of a page (Sphinx event ``html-page-context``)."""
    context["script_files"] = [
        script
        for script in context["script_files"]
        if "thebe" not in f"{script} {getattr(script, 'attributes', {}).get('body', '')}".lower()
    ]


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.config.mathjax_path = f"mathjax/{_SCRIPT}"
    app.connect("build-finished", _copy_mathjax)
    app.connect("build-finished", _bundle_charts)
    app.connect("build-finished", _drop_maps, priority=900)
    app.connect("html-page-context", _drop_thebe, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
