"""The book that `make book` left in ``_build/html``, if it did: no page is too large.

At the book budget tables are longer and evidence has more words than in the book that the tests
build at the smoke budget.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from bs4 import BeautifulSoup, Tag

from tests.book.browsing import HEIGHT, TALLEST, Tab, served
from tests.surroundings import ROOT
from thesis_lib.book.build import heavy
from thesis_lib.book.paths import Paths

NOTEBOOKS = sorted(file.stem for file in (ROOT / "notebooks").glob("*.ipynb"))
WIDE = {"viewport": {"width": 1440, "height": 900}}

TOO_WIDE = """
() => [...document.querySelectorAll('article .pst-scrollable-table-container')]
  .filter(box => box.scrollWidth > box.clientWidth + 1)
  .map(box => box.querySelector('table').id)
"""


@pytest.fixture(scope="module")
def full() -> Path:
    """The book at the book budget, of the last `make book`."""
    folder = Paths.of("book").html
    if not (folder / "index.html").is_file():
        pytest.skip("there is no book in _build/html: `make book` builds it")
    return folder


@pytest.fixture(scope="module")
def site(full: Path) -> Iterator[str]:
    """The book on a local web server."""
    with served(full) as address:
        yield address


def test_no_page_is_too_heavy(full: Path) -> None:
    assert heavy(full) == {}


MINUTES = {"two": 2, "three": 3, "four": 4, "five": 5, "six": 6, "fifteen": 15}
FINDINGS = ("intro.html", "five-findings-that-are-news")
QUESTIONS = ("ch01_introduction.html", "the-questions")


def _section(full: Path, page: str, name: str) -> Tag:
    """A section by its label, or the whole of a page."""
    text = (full / "book" / page).read_text(encoding="utf-8")
    found = BeautifulSoup(text, "html.parser").select_one(f"[id='{name}']" if name else "article")
    assert found, f"{page} has no {name}"
    found = found if found.name in ("section", "article") else found.find_parent("section")
    assert found
    for idle in found.select("script, div.cell_input, details, a.headerlink"):
        idle.decompose()
    return found


def _words(part: Tag, until: str = "", only: str = "") -> int:
    """How many words a reader finds, up to a table and with it, or only in what is named."""
    if only:
        return sum(_words(piece) for piece in part.select(only))
    end = part.find(id=until) if until else None
    if not isinstance(end, Tag):
        return len(part.get_text(" ").split())
    before = [text for text in end.find_all_previous(string=True) if part in text.parents]
    return _words(end) + sum(len(text.split()) for text in before)


def test_the_hurried_reader_s_path_takes_the_minutes_it_names(full: Path) -> None:
    """By 230 words a minute; formulas, pictures and tables may take two more."""
    path = _section(full, "intro.html", "reading-path")
    named, read = [], []
    for item in path.select("ol > li"):
        told = re.search(r"\((\w+) minutes\)", item.get_text())
        assert told
        named.append(MINUTES[told[1]])
        links = [str(a["href"]).partition("#")[::2] for a in item.select("a")] or [FINDINGS]
        if "as far as" in item.get_text():
            (page, start), (_, end) = links
            read.append(_words(_section(full, page, start), until=end))
        elif "in bold" in item.get_text():
            read.append(_words(_section(full, *links[0]), only="ol, strong"))
        else:
            more = [QUESTIONS] * ("the six questions" in item.get_text())
            read.append(sum(_words(_section(full, *link)) for link in [*links, *more]))
    off = [minutes - words / 230 for minutes, words in zip(named, read, strict=True)]
    assert all(-0.5 <= late <= 2 for late in off), list(zip(named, read, strict=True))
    title = re.search(r"In (\w+) minutes", path.get_text())
    assert title
    assert sum(named) == MINUTES[title[1]]


@pytest.mark.browser
@pytest.mark.timeout(300)
@pytest.mark.parametrize("name", NOTEBOOKS)
def test_no_page_is_too_tall_and_no_table_too_wide(
    full: Path, browser: Any, site: str, name: str
) -> None:
    if not (full / "notebooks" / f"{name}.html").is_file():
        pytest.skip(f"the book in _build/html has no page of {name} yet: run `make book`")
    tab = Tab(browser, site, **WIDE)
    opened = tab.open(f"notebooks/{name}.html", until="networkidle")
    tall, wide = opened.evaluate(HEIGHT), opened.evaluate(TOO_WIDE)
    tab.close()
    assert tall < TALLEST, f"{name} is {tall} pixels tall: split it, or shorten it"
    assert wide == [], f"tables that need scrolling in {name}: shorten their heads or cells"


def test_a_heavy_page_is_told(tmp_path: Path) -> None:
    (tmp_path / "book").mkdir()
    (tmp_path / "book" / "light.html").write_bytes(b" " * 307_200)
    (tmp_path / "book" / "heavy.html").write_bytes(b" " * 307_201)
    assert heavy(tmp_path) == {"book/heavy.html": 307_201}
