"""A Sphinx extension that keeps pages light, and from asking the network for anything.

MathJax is shipped with the book: the ``sphinx-mathjax-offline`` package holds all of it
(24 MB), of which the parts in :data:`_PARTS` and the fonts are copied into the static folder,
and loaded by pages with mathematics only.  Of the style sheets the rules in use are kept, of the
icons' fonts the icons in use, and the theme's script that would draw the same icons is emptied.
Pictures load when they come into sight, into the space that is kept for them.  The script that
moves the charts (:mod:`thesis_lib.book.charts`) is bundled by ``vl-convert``, and a page that has
none does not load it.  The scripts of thebe, which Jupyter Book puts on every page whether it is
used or not and which would load code from a content network on a click, are left out.
"""

from __future__ import annotations

import importlib.util
import logging
import re
import shutil
from collections.abc import Set
from concurrent.futures import ThreadPoolExecutor
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


def styles_in_use(sheet: str, names: Set[str]) -> str:
    """A style sheet less the rules whose classes or identifiers are not among ``names``.

    What a selector says in brackets, such as ``:not(.open)``, is not asked about.
    """
    named = re.compile(r"[.#](-?[A-Za-z_][\w-]*)")
    brackets = re.compile(r"\([^()]*\)")

    def rule(found: re.Match[str]) -> str:
        if found[1].lstrip().startswith("@"):  # a font, say
            return found[0]
        kept = [
            selector
            for selector in re.split(r",(?![^(]*\))", found[1])
            if set(named.findall(brackets.sub("", brackets.sub("", selector)))) <= names
        ]
        return f"{','.join(kept)}{{{found[2]}}}" if kept else ""

    sheet = re.sub(r"/\*.*?\*/", "", sheet, flags=re.DOTALL)
    sheet = re.sub(r"([^{};]+)\{([^{}]*)\}", rule, sheet)
    return re.sub(r"@(?:media|supports)[^{};]*\{\s*\}", "", sheet)


def _keep_styles_in_use(app: Any, exception: Exception | None) -> None:
    """Cut style sheets and the icons' fonts down to what pages or scripts name.

    The script that would replace the icons by pictures is emptied.
    """
    if exception is not None or app.builder.format != "html":
        return
    from fontTools import subset

    # Sphinx hands what others log on to the terminal, and this tells of every table it cuts.
    logging.getLogger(subset.__name__).setLevel(logging.WARNING)
    static = Path(app.outdir, "_static")
    (static / "scripts" / "fontawesome.js").write_bytes(b"")
    naming = [*Path(app.outdir).rglob("*.html"), *static.rglob("*.js")]
    names = {
        "bs-tooltip-auto",  # which a script puts together of parts
        *(
            name
            for file in naming
            for name in re.findall(r"[\w-]+", file.read_text(encoding="utf-8"))
        ),
    }
    codes = set[int]()
    for file in static.rglob("*.css"):
        sheet = styles_in_use(file.read_text(encoding="utf-8"), names)
        file.write_text(sheet, encoding="utf-8")
        codes |= {int(code, 16) for code in re.findall(r'"\\([ef][0-9a-f]{3})"', sheet)}
        codes |= {ord(icon) for icon in re.findall("[\ue000-\uf8ff]", sheet)}
    for font in (static / "vendor" / "fontawesome" / "webfonts").iterdir():
        if font.suffix != ".woff2":
            font.unlink()  # what browsers of ten years ago would fall back to
            continue
        options = subset.Options(flavor="woff2")
        cut = subset.load_font(font, options)
        cutter = subset.Subsetter(options)
        cutter.populate(unicodes=codes)
        cutter.subset(cut)
        subset.save_font(cut, font, options)


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


_FOLDED = re.compile(
    r'<summary aria-label="Toggle hidden content">(.*?)</summary>',
    re.DOTALL,
)
"""What unfolds the code of a cell."""


def named_code(page: str) -> str:
    """A page whose folded code is told apart by the figure or table it makes, if any.

    A cell that names its button itself keeps that name.
    """

    def named(found: re.Match[str]) -> str:
        own = re.split('<summary|<section|<div class="cell ', page[found.end() :], maxsplit=1)[0]
        caption = re.search(r'<span class="caption-number">([^<]*?)\s*<', own)
        what = f"the code of {caption[1]}" if caption else "the code"
        return f"<summary>{found[1].replace('code cell source', what)}</summary>"

    return _FOLDED.sub(named, page)


_LEDGER = re.compile(r'<table class="[^"]*\b(?:ledger|cards)\b.*?</table>', re.DOTALL)
"""A table of the ledger, which has hundreds of rows."""

_LONE = re.compile(r"(<td[^>]*>)<p>((?:(?!</?p>|</td>).)*)</p>\s*(?=</td>)", re.DOTALL)
"""A cell with one paragraph and nothing else."""

_ENDS = re.compile(r"\s*</p>\s*(?=<p\b|</?details>|</td>)|\s*</t[dr]>\s*|(?<=</details>)\s+")
"""Ends that HTML leaves out, since what follows tells them, and space between the parts."""

_QUOTES = re.compile(r'(?<= )(id|href|class)="([^\s"\'=<>`]+)"(?=[ >])')
"""What needs no quotation marks."""

_COLOURED = ("reproduced", "direction-only", "not-reproduced", "refuted")
"""The verdicts that have a colour of their own in ``book.css``."""


def fewer_tags(table: str) -> str:
    """A table of the ledger with fewer tags, and no other look.

    Commands look as code does without a class, and so do verdicts without a colour of their own;
    the only paragraph of a cell needs no tags.
    """

    def verdict(found: re.Match[str]) -> str:
        return found[0] if found[1] in _COLOURED else 'class="verdict"'

    table = re.sub(r'class="verdict ([\w-]+)"', verdict, table.replace(' class="literal"', ""))
    return _QUOTES.sub(r"\1=\2", _ENDS.sub("", _LONE.sub(r"\1\2", table)))


def _shorten(app: Any, exception: Exception | None) -> None:
    """Have pictures loaded when they come into sight, and say how large they are.

    Figures become WebP, a third of PNG and the same to the pixel, and folded code says what it
    makes.  Spans around each word of code, a quarter of a page of the reference, others without a
    look, and classes that no style or script asks for are left out.
    """
    if exception is not None or app.builder.format != "html":
        return
    from PIL import Image

    def lighter(file: Path) -> None:
        with Image.open(file) as figure:
            figure.save(file.with_suffix(".webp"), lossless=True)
        file.unlink()

    images = Path(app.outdir, "_images")
    with ThreadPoolExecutor() as pool:  # the encoder lets go of the interpreter's lock
        list(pool.map(lighter, images.glob("*.png")))
    sizes: dict[str, tuple[str, str]] = {}
    for file in images.glob("*.*"):
        if file.suffix == ".webp":
            with Image.open(file) as figure:
                sizes[file.name] = (str(figure.width), str(figure.height))
        elif file.suffix == ".svg":
            head = re.search(
                r'width="([\d.]+)" height="([\d.]+)"', file.read_text(encoding="utf-8")
            )
            sizes |= {file.name: (head[1], head[2])} if head else {}

    def sized(found: re.Match[str]) -> str:
        if found[2] not in sizes:
            return found[0]
        width, height = sizes[found[2]]
        return f'<img loading="lazy" width="{width}" height="{height}" {found[1]}'

    for page in Path(app.outdir).rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        short = re.sub(r"(_images/[^\"/]+)\.png\b", r"\1.webp", named_code(text))
        short = re.sub(r'<img ((?:[^>]*? )?src="[^"]*_images/([^"/]+)")', sized, short)
        short = re.sub(r'<span class="(?:pre|std std-\w+)">([^<]*)</span>', r"\1", short)
        short = short.replace('class="docutils literal notranslate"', 'class="literal"')
        short = re.sub(r' class="(?:row-(?:even|odd)|reference internal)"', "", short)
        short = _LEDGER.sub(lambda table: fewer_tags(table[0]), short)
        if short != text:
            page.write_text(short, encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.config.mathjax_path = f"mathjax/{_SCRIPT}"
    app.connect("build-finished", _copy_mathjax)
    app.connect("build-finished", _bundle_charts)
    app.connect("build-finished", _drop_maps, priority=900)
    app.connect("build-finished", _keep_styles_in_use, priority=900)
    app.connect("build-finished", _shorten)
    app.connect("html-page-context", _lighten, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
