"""A Sphinx extension that keeps pages light, and from asking the network for anything.

MathJax is shipped with the book: the ``sphinx-mathjax-offline`` package holds all of it
(24 MB), of which the parts in :data:`_PARTS` and the fonts are copied into the static folder,
and loaded by pages with mathematics only.  Of the icons' fonts only the icons in use are kept,
and the theme's script that would draw the same icons is emptied.  Pictures load when they come
into sight, into the space that is kept for them.  The script that moves the charts
(:mod:`thesis_lib.book.charts`) is bundled by ``vl-convert``, and a page that has none does not
load it.  The scripts of thebe, which Jupyter Book puts on
every page whether it is used or not and which would load code from a content network on a
click, are left out.
"""

from __future__ import annotations

import importlib.util
import logging
import re
import shutil
from pathlib import Path
from typing import Any

from docutils import nodes

_SCRIPT = "startup.js"
_PARTS = (
    *("core", "input/tex", "input/tex/extensions/boldsymbol"),
    *("output/chtml", "output/chtml/fonts/tex", "a11y/assistive-mml"),
)
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
    fonts = [_FONTS / font.name for font in (source / _FONTS).iterdir()]
    for file in [Path(_SCRIPT), *(Path(f"{part}.js") for part in _PARTS), *fonts]:
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


def _keep_icons_in_use(app: Any, exception: Exception | None) -> None:
    """Cut the icons' fonts down, and empty the script that would replace them by pictures."""
    if exception is not None or app.builder.format != "html":
        return
    from fontTools import subset

    # Sphinx hands what others log on to the terminal, and this tells of every table it cuts.
    logging.getLogger(subset.__name__).setLevel(logging.WARNING)
    static = Path(app.outdir, "_static")
    pages = "".join(page.read_text(encoding="utf-8") for page in Path(app.outdir).rglob("*.html"))
    used = set(re.findall(r"\bfa-[a-z0-9-]+", pages))
    sheet = static / "styles" / "pydata-sphinx-theme.css"
    codes: dict[str, str] = {}

    def in_use(rule: re.Match[str]) -> str:
        names = set(re.findall(r"fa-[a-z0-9-]+", rule[1]))
        codes.update(dict.fromkeys(names & used, rule[2]))
        return rule[0] if names & used else ""

    style = sheet.read_text(encoding="utf-8")
    rules = r"((?:\.fa-[a-z0-9-]+:before,?)+)\{content:\"\\([0-9a-f]+)\"\}"
    sheet.write_text(re.sub(rules, in_use, style), encoding="utf-8")
    for font in (static / "vendor" / "fontawesome" / "webfonts").iterdir():
        if font.suffix != ".woff2":
            font.unlink()  # what browsers of ten years ago would fall back to
            continue
        options = subset.Options(flavor="woff2")
        cut = subset.load_font(font, options)
        cutter = subset.Subsetter(options)
        cutter.populate(unicodes=[int(code, 16) for code in codes.values()])
        cutter.subset(cut)
        subset.save_font(cut, font, options)
    (static / "scripts" / "fontawesome.js").write_bytes(b"")


def _lighten(
    app: Any, pagename: str, templatename: str, context: dict[str, Any], doctree: Any
) -> None:
    """Leave out of a page what it has no use for (Sphinx event ``html-page-context``).

    These are thebe's scripts, and MathJax where there is no mathematics.
    """
    idle = ["thebe"]
    if doctree is None or not any(doctree.findall(_is_mathematics)):
        idle.append("mathjax")
    context["script_files"] = [
        script
        for script in context["script_files"]
        if not any(
            name in f"{script} {getattr(script, 'attributes', {}).get('body', '')}".lower()
            for name in idle
        )
    ]


def _is_mathematics(node: nodes.Node) -> bool:
    return isinstance(node, nodes.math | nodes.math_block)


def _load_lazily(app: Any, exception: Exception | None) -> None:
    """Have pictures loaded when they come into sight, and say how large they are."""
    if exception is not None or app.builder.format != "html":
        return
    from PIL import Image

    def sized(found: re.Match[str]) -> str:
        with Image.open(Path(app.outdir, "_images", found[2])) as picture:
            width, height = picture.size
        return f'<img loading="lazy" width="{width}" height="{height}" {found[1]}'

    for page in Path(app.outdir).rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        lazy = re.sub(r'<img ((?:[^>]*? )?src="[^"]*_images/([^"/]+\.png)")', sized, text)
        if lazy != text:
            page.write_text(lazy, encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.config.mathjax_path = f"mathjax/{_SCRIPT}"
    app.connect("build-finished", _copy_mathjax)
    app.connect("build-finished", _bundle_charts)
    app.connect("build-finished", _drop_maps, priority=900)
    app.connect("build-finished", _keep_icons_in_use, priority=900)
    app.connect("build-finished", _load_lazily)
    app.connect("html-page-context", _lighten, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
