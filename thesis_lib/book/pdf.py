"""The built book as one PDF: each page printed by headless Chromium, joined with bookmarks.

``python -m thesis_lib.book.pdf`` prints ``_build/html`` to ``_build/book.pdf``.  Links between
pages lead to their places in the PDF; a film is its still and a chart its picture.  Bookmarks lead
to the pages, those of a section below its chapter's, and to their headings.
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

LIMIT = 30
"""What the file may weigh, in MB, so that it can be sent by mail."""

SHEET = 850
"""Width of what a sheet holds, in pixels of the page: A4 less two margins, at the scale of 0.8."""


def contents(toc: str) -> list[str]:
    """Names of the pages in the order of ``_toc.yml``."""
    return re.findall(r"^\s*(?:- )?(?:root|file): (\S+)", toc, flags=re.MULTILINE)


def chapters(toc: str) -> dict[str, str]:
    """The chapter of each page that ``_toc.yml`` lists below one."""
    above: list[tuple[int, str]] = []
    below = dict[str, str]()
    for space, name in re.findall(r"^( *)- file: (\S+)", toc, flags=re.MULTILINE):
        above = [entry for entry in above if entry[0] < len(space)]
        if above:
            below[name] = above[-1][1]
        above.append((len(space), name))
    return below


def chromium() -> str | None:
    """Where this machine has a Chromium, if it has one."""
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "chrome"))), None)


def make_pdf(
    html: Path, names: Sequence[str], target: Path, below: Mapping[str, str] | None = None
) -> int:
    """Print pages into one file; returns how many sheets it has.

    Parameters
    ----------
    html
        The built book.
    names
        Its pages, such as ``book/intro``, in order.
    target
        The file.
    below
        The chapters of those pages whose bookmarks stand below another's.

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
    titles, headings = dict[str, str](), dict[str, list[tuple[str, str]]]()
    root, wanted = html.resolve().as_uri(), linked(html, names)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": SHEET, "height": 1200})
        page.emulate_media(media="print", color_scheme="light", reduced_motion="reduce")
        page.add_init_script(path=Path(__file__).with_suffix(".js"))
        page.set_default_timeout(300_000)  # ms; a busy machine takes more than the usual 30 s
        for name in names:
            # On a slow machine the network can be idle before the page is read to its end.
            page.goto((html / f"{name}.html").resolve().as_uri(), wait_until="load")
            page.wait_for_load_state("networkidle")
            titles[name] = page.title().partition(" — ")[0]
            headings[name] = page.evaluate("(at) => prepareForPrint(at)", sorted(wanted[name]))
            margin: PdfMargins = {"top": "15mm", "bottom": "15mm", "left": "15mm", "right": "15mm"}
            sheets = PdfReader(io.BytesIO(page.pdf(format="A4", scale=0.8, margin=margin)))
            _by_address(sheets, f"{root}/{name}.html")
            start = len(writer.pages)
            places[name] = {"": (start, None)}
            for place, at in sheets.named_destinations.items():
                number = start + (sheets.get_destination_page_number(at) or 0)
                places[name][place.removeprefix("/")] = number, float(at.top or 0)
            writer.append(sheets, import_outline=False)
        browser.close()
    _link(writer, root, places)
    _bookmarks(writer, titles, headings, places, below or {})
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
    """Turn links to files of the book into links to its sheets, at the place they name.

    Those to other files, such as pictures, would lead nowhere on another machine.
    """
    from pypdf.generic import ArrayObject, DictionaryObject, FloatObject, NameObject, NullObject

    for sheet in writer.pages:
        kept = ArrayObject()
        for reference in sheet.get("/Annots", ()):
            address = str(reference.get_object().get("/A", {}).get("/URI", ""))
            name, _, place = address.removeprefix(f"{root}/").partition("#")
            name = name.removesuffix(".html")
            if name in places:
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
            if name in places or not address.startswith("file:"):
                kept.append(reference)
        sheet[NameObject("/Annots")] = kept


def _bookmarks(
    writer: Any,
    titles: Mapping[str, str],
    headings: Mapping[str, Sequence[tuple[str, str]]],
    places: Mapping[str, Mapping[str, Place]],
    below: Mapping[str, str],
) -> None:
    """Bookmarks of pages and their headings; a reader shows them when the file opens."""
    from pypdf.generic import Fit

    marks = dict[str, Any]()
    for name, title in titles.items():
        above = marks.get(below.get(name, ""))
        marks[name] = writer.add_outline_item(
            title=title, page_number=places[name][""][0], parent=above, is_open=False
        )
        for place, words in headings[name]:
            number, top = places[name].get(place, places[name][""])
            fit = Fit.fit() if top is None else Fit.xyz(top=top)
            writer.add_outline_item(title=words, page_number=number, parent=marks[name], fit=fit)
    writer.page_mode = "/UseOutlines"
    writer.add_metadata({"/Title": next(iter(titles.values()))})


def told(out: Path, sheets: int) -> str:
    """What was made, in a sentence.

    Raises
    ------
    ValueError
        If it weighs more than `LIMIT`.
    """
    size = out.stat().st_size / 1e6
    if size > LIMIT:
        raise ValueError(
            f"{out} weighs {size:.1f} MB, more than the {LIMIT} MB it may: make its heaviest "
            "figures smaller (`pdfimages -list` tells which), or raise the limit in pdf.py."
        )
    return f"{out}: {sheets} sheets, {size:.1f} MB"


if __name__ == "__main__":
    paths = Paths.of("book")
    out = paths.build / "book.pdf"
    toc = (paths.root / "_toc.yml").read_text(encoding="utf-8")
    try:
        print(told(out, make_pdf(paths.html, contents(toc), out, chapters(toc))))
    except (FileNotFoundError, ValueError) as error:
        sys.exit(str(error))
