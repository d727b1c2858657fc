"""The book as one PDF."""

from pathlib import Path

import pytest
from pypdf import PdfReader

from thesis_lib.book.pdf import LIMIT, chapters, chromium, contents, linked, make_pdf, told

STYLES = Path(__file__).parents[2] / "book/_static/book.css"

PRINTED = """<!DOCTYPE html><html lang="en"><head><title>One</title>
<link rel="stylesheet" href="{0}"><style>div.admonition {{ box-shadow: 0 0 9px #000 }}</style>
</head><body><main class="bd-main"><div class="bd-content"><article class="bd-article">
<section id="first"><h2>First<a class="headerlink" href="#first">#</a></h2>
<div class="admonition">In a box <a href="picture.svg">with a picture</a></div>
<div class="pst-scrollable-table-container"><table class="table"><tbody><tr>{1}</tr></tbody></table>
</div></section></article></div></main></body></html>
"""

PAGE = """<!DOCTYPE html><html lang="en"><head><title>{0} — The book</title></head>
<body><h1>{0}</h1><a href="{1}.html#there">{1}</a><a href="https://example.org">out</a>
<a href="{1}.html">whole</a><a href="#there">here</a>
<p style="break-before: page; padding-top: 3cm"><span id="there">Place</span></p></body></html>
"""


def test_contents_in_order() -> None:
    toc = "root: book/intro\nparts:\n  - chapters:\n      - file: book/one\n        sections:\n"
    assert contents(toc + "          - file: book/two\n") == ["book/intro", "book/one", "book/two"]


def test_pages_of_a_section_stand_below_their_chapter() -> None:
    toc = (
        "root: book/intro\nparts:\n  - chapters:\n      - file: book/one\n        sections:\n"
        "          - file: book/two\n          - file: book/three\n      - file: book/four\n"
    )
    assert chapters(toc) == {"book/two": "book/one", "book/three": "book/one"}


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


@pytest.mark.browser
@pytest.mark.skipif(not chromium(), reason="there is no chromium on this machine")
def test_a_wide_table_fits_a_shadow_is_no_picture_and_headings_are_bookmarks(
    tmp_path: Path,
) -> None:
    cells = "".join(f"<td>column-{i:02d}-as-long</td>".replace("-", "_") for i in range(14))
    for name in ("one", "two"):
        (tmp_path / f"{name}.html").write_text(PRINTED.format(STYLES.as_uri(), cells))
    assert make_pdf(tmp_path, ["one", "two"], tmp_path / "book.pdf", {"two": "one"}) == 2
    book = PdfReader(tmp_path / "book.pdf")
    at = dict[str, float]()

    def visit(text: str, cm: list[float], tm: list[float], *_: object) -> None:
        at[text.strip()] = cm[0] * tm[4] + cm[4]

    assert "column_13_as_long" in book.pages[0].extract_text(visitor_text=visit)
    # A sheet is 595 points wide, and its margins 42.5.
    last = next(x for text, x in at.items() if text.endswith("column_13_as_long"))
    assert last < 595 - 42.5 - 20
    assert not book.pages[0].images
    assert "file:" not in str([note.get_object() for note in book.pages[0]["/Annots"]])
    titles = [mark if isinstance(mark, list) else mark.title for mark in book.outline]
    one, (first, two, (last_one,)) = titles[0], titles[1]
    assert (one, first.title, two.title, last_one.title) == ("One", "First", "One", "First")
    assert book.get_destination_page_number(last_one) == 1
    assert book.page_mode == "/UseOutlines"


def test_a_heavy_file_is_one_sentence(tmp_path: Path) -> None:
    out = tmp_path / "book.pdf"
    out.write_bytes(b"0" * 1_200_000)
    assert told(out, 7) == f"{out}: 7 sheets, 1.2 MB"
    with out.open("ab") as file:
        file.truncate(LIMIT * 1_000_000 + 100_000)
    with pytest.raises(ValueError, match=r"weighs 30\.1 MB, more than the 30 MB"):
        told(out, 7)
