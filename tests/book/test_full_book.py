"""The book that `make book` left in ``_build/html``, if it did: no page is too large.

At the book budget tables are longer and evidence has more words than in the book that the tests
build at the smoke budget.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

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
