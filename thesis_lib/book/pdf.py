"""The built book as one PDF: each page printed by headless Chromium, joined with bookmarks.

``python -m thesis_lib.book.pdf`` prints ``_build/html`` to ``_build/book.pdf``.  Links between
pages lead to pages of the PDF; a film is its still and a chart its picture.
"""

from __future__ import annotations

import io
import re
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from thesis_lib.book.paths import Paths
from thesis_lib.files import replacing

READY = """async () => {
  const folded = 'details.sd-dropdown, table.ledger details, table.cards details';
  document.querySelectorAll(folded).forEach((e) => { e.open = true; });
  document.querySelectorAll('img[loading=lazy]').forEach((e) => { e.loading = 'eager'; });
  const loaded = (e) => e.complete || new Promise((done) => { e.onload = e.onerror = done; });
  await Promise.all([...document.images].map(loaded));
  if (window.MathJax?.startup?.promise) await window.MathJax.startup.promise;
  await Promise.all([...document.fonts].map((font) => font.load().catch(() => {})));
}"""
"""What to wait for before a page is printed."""


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
    writer, first = PdfWriter(), dict[str, int]()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=["--no-sandbox"])
        page = browser.new_page(color_scheme="light", reduced_motion="reduce")
        for name in names:
            # On a slow machine the network can be idle before the page is read to its end.
            page.goto((html / f"{name}.html").resolve().as_uri(), wait_until="load")
            page.wait_for_load_state("networkidle")
            page.evaluate(READY)
            margin: PdfMargins = {"top": "15mm", "bottom": "15mm", "left": "15mm", "right": "15mm"}
            sheets = PdfReader(io.BytesIO(page.pdf(format="A4", scale=0.8, margin=margin)))
            first[name] = len(writer.pages)
            writer.append(sheets, outline_item=page.title().partition(" — ")[0])
        browser.close()
    _link(writer, html.resolve().as_uri(), first)
    writer.compress_identical_objects()
    with replacing(target) as temporary, temporary.open("wb") as file:
        writer.write(file)
    return len(writer.pages)


def _link(writer: Any, root: str, first: dict[str, int]) -> None:
    """Turn links to files of the book into links to its sheets."""
    from pypdf.generic import ArrayObject, DictionaryObject, NameObject

    for sheet in writer.pages:
        for reference in sheet.get("/Annots", ()):
            action = reference.get_object().get("/A", {})
            address = str(action.get("/URI", ""))
            name = address.removeprefix(f"{root}/").partition("#")[0].removesuffix(".html")
            if address.startswith(root) and name in first:
                place = writer.pages[first[name]].indirect_reference
                reference.get_object()[NameObject("/A")] = DictionaryObject(
                    {
                        NameObject("/S"): NameObject("/GoTo"),
                        NameObject("/D"): ArrayObject([place, NameObject("/Fit")]),
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
