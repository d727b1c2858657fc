"""The book as one PDF."""

from pathlib import Path

import pytest
from pypdf import PdfReader

from thesis_lib.book.pdf import chromium, contents, linked, make_pdf

PAGE = """<!DOCTYPE html><html lang="en"><head><title>{0} — The book</title></head>
<body><h1>{0}</h1><a href="{1}.html#there">{1}</a><a href="https://example.org">out</a>
<a href="{1}.html">whole</a><a href="#there">here</a>
<p style="break-before: page; padding-top: 3cm"><span id="there">Place</span></p></body></html>
"""


def test_contents_in_order() -> None:
    toc = "root: book/intro\nparts:\n  - chapters:\n      - file: book/one\n        sections:\n"
    assert contents(toc + "          - file: book/two\n") == ["book/intro", "book/one", "book/two"]


@pytest.mark.browser
@pytest.mark.skipif(not chromium(), reason="there is no chromium on this machine")
def test_pages_are_joined_with_bookmarks_and_links_between_them(tmp_path: Path) -> None:
    for name, other in (("one", "two"), ("two", "one")):
        (tmp_path / f"{name}.html").write_text(PAGE.format(name, other))
    assert linked(tmp_path, ["one", "two"]) == {"one": {"there"}, "two": {"there"}}
    assert make_pdf(tmp_path, ["one", "two"], tmp_path / "book.pdf") == 4
    book = PdfReader(tmp_path / "book.pdf")
    assert [sheet.extract_text().split()[0] for sheet in book.pages[::2]] == ["one", "two"]
    assert [mark.title for mark in book.outline] == ["one", "two"]
    assert [book.get_destination_page_number(mark) for mark in book.outline] == [0, 2]
    inner, outer, whole, here = (note.get_object()["/A"] for note in book.pages[0]["/Annots"][:4])
    # Both pages call a place "there", and each link leads to its own.
    assert inner["/D"][0].get_object() == book.pages[3]
    assert here["/D"][0].get_object() == book.pages[1]
    assert 600 < inner["/D"][3] < 750  # of 842, below margin and padding
    assert outer["/URI"] == "https://example.org/"
    assert whole["/D"][0].get_object() == book.pages[2]
    assert whole["/D"][1] == "/Fit"


def test_a_book_that_was_not_built_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="has no page one: build the book first"):
        make_pdf(tmp_path, ["one"], tmp_path / "book.pdf")
