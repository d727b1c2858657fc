"""The list of a page's sections marks the one that is read."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from thesis_lib.book.pdf import chromium

SCRIPT = Path(__file__).parents[2] / "book" / "_static" / "book.js"
NAMES = ("one", "two", "three", "last")
LINKS = "".join(f'<li class="toc-entry"><a href="#{name}">{name}</a></li>' for name in NAMES)
SECTIONS = "".join(f'<section id="{name}"><h2>{name}</h2></section>' for name in NAMES)
PAGE = f"""<!DOCTYPE html><html lang="en"><head><title>Sections</title><style>
nav {{ position: fixed; }} section {{ height: 3000px; }} #last {{ height: 100px; }}</style>
<script src="{SCRIPT.as_uri()}"></script></head>
<body><nav id="pst-page-toc-nav"><ul>{LINKS}</ul></nav>{SECTIONS}</body></html>"""


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    (tmp_path / "page.html").write_text(PAGE)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 800, "height": 600})
        page.goto((tmp_path / "page.html").as_uri(), timeout=120_000)
        yield page
        browser.close()


@pytest.mark.browser
@pytest.mark.skipif(not chromium(), reason="there is no chromium on this machine")
def test_the_section_that_is_read_is_marked_after_leaps_and_upwards(opened: Any) -> None:
    # Into the middle of a section, where no heading comes into sight, down and up.
    for y, name in ((4500, "two"), (7500, "three"), (4500, "two"), (2900, "two"), (2700, "one")):
        opened.evaluate(f"scrollTo(0, {y})")
        opened.wait_for_selector(f"a[href='#{name}'].active", timeout=20_000)
        assert opened.locator("a.active, a[aria-current]").count() == 1
        assert opened.locator("li.toc-entry.active").inner_text() == name


@pytest.mark.browser
@pytest.mark.skipif(not chromium(), reason="there is no chromium on this machine")
def test_a_short_last_section_that_was_chosen_is_marked(opened: Any) -> None:
    opened.evaluate("location.hash = 'last'")
    opened.wait_for_selector("a[href='#last'].active", timeout=20_000)
    assert opened.locator("a.active").count() == 1
    opened.evaluate("scrollTo(0, 4500)")
    opened.wait_for_selector("a[href='#two'].active", timeout=20_000)
