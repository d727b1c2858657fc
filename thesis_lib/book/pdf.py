"""The built book as one PDF: each page printed by headless Chromium, joined with bookmarks.

``python -m thesis_lib.book.pdf`` prints ``_build/html`` to ``_build/book.pdf``.  Links between
pages lead to their places in the PDF; a film is its still and a chart its picture.
"""

from __future__ import annotations

import io
import posixpath
import re
import shutil
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias
from urllib.parse import unquote

from thesis_lib.book.paths import Paths
from thesis_lib.files import replacing

Place: TypeAlias = tuple[int, float | None]
"""A sheet, and how high on it in points; None for the whole of it."""

READY, TARGETS = (
    Path(__file__).with_name(f"{name}.js").read_text(encoding="utf-8")
    for name in ("ready", "targets")
)
"""Functions that Chromium calls before a page is printed; each says what it is for."""


def contents(toc: str) -> list[str]:
    """Names of the pages in the order of ``_toc.yml``."""
    return re.findall(r"^\s*(?:- )?(?:root|file): (\S+)", toc, flags=re.MULTILINE)


def chromium() -> str | None:
    """Where this machine has a Chromium, if it has one."""
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "chrome"))), None)


def make_pdf(html: Path, names: Sequence[str], target: Path) -> int:
    """Print pages into one file; returns how many sheets it has.

    Parameters
    ----------
    html
        The built book.
    names
        Its pages, such as ``book/intro``, in order.
    target
        The file.

    Raises
    ------
    FileNotFoundError
        If the book was not built, or there is no Chromium.
    """
    from playwright.sync_api import PdfMargins, sync_playwright
    from pypdf import PdfReader, PdfWriter

    missing = [name for name in names if not (html / f"{name}.html").is_file()]
    if missing:
        raise FileNotFoundError(
            f"{html} has no page {missing[0]}: build the book first, `make book`."
        )
    if (found := chromium()) is None:
        raise FileNotFoundError("there is no chromium: install it (Debian: apt install chromium).")
    writer, places = PdfWriter(), dict[str, dict[str, Place]]()
    root, wanted = html.resolve().as_uri(), linked(html, names)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=["--no-sandbox"])
        page = browser.new_page(color_scheme="light", reduced_motion="reduce")
        for name in names:
            # On a slow machine the network can be idle before the page is read to its end.
            page.goto((html / f"{name}.html").resolve().as_uri(), wait_until="load")
            page.wait_for_load_state("networkidle")
            page.evaluate(READY)
            page.evaluate(TARGETS, sorted(wanted[name]))
            margin: PdfMargins = {"top": "15mm", "bottom": "15mm", "left": "15mm", "right": "15mm"}
            sheets = PdfReader(io.BytesIO(page.pdf(format="A4", scale=0.8, margin=margin)))
            _by_address(sheets, f"{root}/{name}.html")
            start = len(writer.pages)
            places[name] = {"": (start, None)}
            for place, at in sheets.named_destinations.items():
                number = start + (sheets.get_destination_page_number(at) or 0)
                places[name][place.removeprefix("/")] = number, float(at.top or 0)
            writer.append(sheets, outline_item=page.title().partition(" — ")[0])
        browser.close()
    _link(writer, root, places)
    writer.compress_identical_objects()
    with replacing(target) as temporary, temporary.open("wb") as file:
        writer.write(file)
    return len(writer.pages)


def linked(html: Path, names: Sequence[str]) -> dict[str, set[str]]:
    """The places of each page that other pages link to, by their ids."""
    wanted: dict[str, set[str]] = {name: set() for name in names}
    for name in names:
        text = (html / f"{name}.html").read_text(encoding="utf-8")
        for file, place in re.findall(r'href="([^"#:]+)\.html#([^"]+)"', text):
            other = posixpath.normpath(posixpath.join(posixpath.dirname(name), file))
            wanted.get(other, set()).add(unquote(place))
    return wanted


def _by_address(sheets: Any, address: str) -> None:
    """Turn links within a page into links by its address: pages share names, such as ``id1``."""
    from pypdf.generic import DictionaryObject, NameObject, TextStringObject

    for sheet in sheets.pages:
        for reference in sheet.get("/Annots", ()):
            link = reference.get_object()
            if isinstance(link.get("/Dest"), str):
                place = str(link.pop("/Dest")).removeprefix("/")
                link[NameObject("/A")] = DictionaryObject(
                    {
                        NameObject("/S"): NameObject("/URI"),
                        NameObject("/URI"): TextStringObject(f"{address}#{place}"),
                    }
                )


def _link(writer: Any, root: str, places: Mapping[str, Mapping[str, Place]]) -> None:
    """Turn links to files of the book into links to its sheets, at the place they name."""
    from pypdf.generic import ArrayObject, DictionaryObject, FloatObject, NameObject, NullObject

    for sheet in writer.pages:
        for reference in sheet.get("/Annots", ()):
            action = reference.get_object().get("/A", {})
            address = str(action.get("/URI", ""))
            name, _, place = address.removeprefix(f"{root}/").partition("#")
            name = name.removesuffix(".html")
            if not address.startswith(root) or name not in places:
                continue
            number, top = places[name].get(unquote(place), places[name][""])
            at = writer.pages[number].indirect_reference
            where = (
                [NameObject("/Fit")]
                if top is None
                else [NameObject("/XYZ"), NullObject(), FloatObject(top), NullObject()]
            )
            reference.get_object()[NameObject("/A")] = DictionaryObject(
                {
                    NameObject("/S"): NameObject("/GoTo"),
                    NameObject("/D"): ArrayObject([at, *where]),
                }
            )


if __name__ == "__main__":
    paths = Paths.of("book")
    out = paths.build / "book.pdf"
    toc = (paths.root / "_toc.yml").read_text(encoding="utf-8")
    try:
        sheets = make_pdf(paths.html, contents(toc), out)
    except FileNotFoundError as error:
        sys.exit(str(error))
    print(f"{out}: {sheets} sheets, {out.stat().st_size / 1e6:.1f} MB")
