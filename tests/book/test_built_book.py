"""The book as built at the smoke budget: every notebook run, every page looked at."""

import functools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from bs4 import BeautifulSoup

from tests.book.browsing import HEIGHT, TALLEST, Tab, served
from thesis_lib.book.build import PAGE_BYTES, build
from thesis_lib.book.execution import last_run
from thesis_lib.book.paths import Paths
from thesis_lib.edition.chapters import differences

pytestmark = pytest.mark.timeout(1500)  # the first test builds the book

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(re.findall(r"(?:root|file): (\S+)", (ROOT / "_toc.yml").read_text()))
OF_A_KIND = [p for p in PAGES if not p.startswith("book/api/") or p.endswith(("/index", "/small"))]
"""Pages less those of the reference that look like another one and are very long."""
OF_EACH_KIND = ["book/intro", "book/scoreboard", "book/bibliography", "book/play", "book/api/small"]
OF_EACH_KIND += ["book/api/potentials", "prf-prf"]
OF_EACH_KIND += ["notebooks/appendix_a", "notebooks/ch03_evaluation"]
OURS = ["notebooks/ch04_predicting"]
"""Pages of a chapter without a section of the thesis, and so without a number."""
NOTEBOOKS = [page.partition("/")[2] for page in PAGES if page.startswith("notebooks/")]


@pytest.fixture(scope="module")
def html() -> Path:
    """The built book; building it fails on any warning and any failing notebook."""
    if build("smoke") != 0:
        pytest.fail("the book does not build at the smoke budget: see `make smoke`", pytrace=False)
    return Paths.of("smoke").html


@functools.cache
def soup(file: Path) -> BeautifulSoup:
    return BeautifulSoup(file.read_text(encoding="utf-8"), "html.parser")


def page(html: Path, name: str) -> BeautifulSoup:
    return soup(html / f"{name}.html")


def test_every_notebook_ran_at_smoke(html: Path) -> None:
    for name in NOTEBOOKS:
        run = last_run(name, Paths.of("smoke"))
        assert run
        assert run.manifest["parameters"] == {"budget": "smoke", "seed": 0}


def test_a_second_build_executes_nothing_and_rebuilds_nothing(html: Path) -> None:
    said: list[str] = []
    assert build("smoke", say=said.append) == 0
    assert any(line.endswith(f"{len(NOTEBOOKS)} unchanged, 0 to execute.") for line in said)
    assert "No page changed." in said


def test_opens_at_the_front_page(html: Path) -> None:
    target = soup(html / "index.html").find("meta", {"http-equiv": "refresh"})
    assert target
    assert (html / str(target["content"]).partition("url=")[2]).is_file()


@pytest.mark.parametrize("name", PAGES)
class TestPage:
    def test_shows_no_error_and_no_object(self, html: Path, name: str) -> None:
        text = (html / f"{name}.html").read_text(encoding="utf-8")
        assert "object&gt;" not in text
        assert "&lt;IPython" not in text
        assert not page(html, name).select(".output.traceback, .output.stderr")

    def test_nothing_is_fetched_from_elsewhere(self, html: Path, name: str) -> None:
        for tag in page(html, name).select("script[src], link[href], img[src], iframe, video"):
            address = str(tag.get("src") or tag.get("href") or "")
            if tag.name == "link" and "canonical" in (tag.get("rel") or []):
                continue
            assert not re.match(r"(https?:)?//", address), address
        assert "unpkg.com" not in str(page(html, name))

    def test_links_within_the_book_lead_somewhere(self, html: Path, name: str) -> None:
        here = (html / f"{name}.html").resolve()
        for link in page(html, name).select("main a[href], nav a[href]"):
            address, _, anchor = str(link["href"]).partition("#")
            if re.match(r"[a-z]+:", address):
                continue
            target = (here.parent / address).resolve() if address else here
            assert target.is_file(), f"{name} links to {address}"
            if anchor and target.suffix == ".html":
                assert soup(target).find(id=anchor), f"{name} links to {address}#{anchor}"

    def test_has_language_title_and_one_heading(self, html: Path, name: str) -> None:
        parsed = page(html, name)
        assert parsed.html
        assert parsed.html["lang"] == "en"
        assert parsed.title
        assert parsed.title.get_text().strip()
        assert len(parsed.select("article h1")) == 1

    def test_every_image_has_alternative_text(self, html: Path, name: str) -> None:
        for image in page(html, name).select("article img"):
            alt = str(image.get("alt", ""))
            assert alt.strip(), image["src"]
            assert not alt.startswith(("../", "_images")), alt

    def test_is_small(self, html: Path, name: str) -> None:
        assert (html / f"{name}.html").stat().st_size <= PAGE_BYTES


@pytest.mark.parametrize("name", [page for page in PAGES if page.startswith("book/api/")])
def test_reference_tells_what_an_attribute_means_as_text(html: Path, name: str) -> None:
    entries = ", ".join(f"dl.py.{kind} > dd dl.field-list dt" for kind in ("attribute", "data"))
    assert [field.get_text() for field in page(html, name).select(entries)] == []


@pytest.mark.parametrize("name", [f"notebooks/{name}" for name in NOTEBOOKS])
def test_chapter_says_that_its_values_mean_nothing(html: Path, name: str) -> None:
    assert "shapes, not values" in page(html, name).get_text()


@pytest.mark.parametrize("name", PAGES)
def test_chapter_has_the_number_of_the_thesis(html: Path, name: str) -> None:
    heading = page(html, name).select_one("article h1")
    assert heading
    number = re.search(r"/(?:ch0?(\d+)|appendix_([a-z]))(?:_|$)", name)
    shown = re.match(r"(\w+)\.[\d.]* ", heading.get_text())  # a chapter's, or that of its section
    expected = (number[1] or number[2].upper()) if number else None
    assert (shown[1] if shown else None) == (None if name in OURS else expected)


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_chapter_can_be_launched(html: Path, name: str) -> None:
    launchers = [str(a["href"]) for a in page(html, f"notebooks/{name}").select("a[href]")]
    for service in ("mybinder.org", "colab.research.google.com"):
        assert any(service in link and f"notebooks/{name}.ipynb" in link for link in launchers)


def test_prose_quotes_the_ledger_with_links_to_its_rows(html: Path) -> None:
    links = [str(a["href"]) for a in page(html, "book/intro").select("article a[href]")]
    assert any(link.startswith("scoreboard.html#claim-") for link in links)


def test_differences_are_linked_from_the_sections_they_concern(html: Path) -> None:
    told = {
        link
        for name in NOTEBOOKS
        for a in page(html, f"notebooks/{name}").select("p.differences a[href]")
        if (link := str(a["href"])).startswith("../book/differences.html#difference-")
    }
    assert len(told) == sum(bool(row.at) for row in differences())


def test_names_in_prose_lead_to_the_reference(html: Path) -> None:
    links = [str(a["href"]) for a in page(html, "book/parts").select("article a[href]")]
    assert "api/policies.html#thesis_lib.policies.portable.to_onnx" in links


def test_items_have_the_numbers_of_the_thesis(html: Path) -> None:
    figure = page(html, "notebooks/ch03_evaluation").find(id="fig-ch3-figure-3-1")
    assert figure
    assert figure.select_one(".caption-number").get_text().strip() == "Fig. 3.1"
    equation = page(html, "notebooks/ch03_potentials").find(id="equation-eq-ch3-q-star")
    assert equation
    assert "(3.6)" in equation.get_text()


def test_the_book_is_small(html: Path) -> None:
    files = [file for file in html.rglob("*") if file.is_file() and "films" not in file.parts]
    assert sum(file.stat().st_size for file in files) < 25e6
    assert not [file for file in files if file.suffix == ".map"]


def test_films_are_small(html: Path) -> None:
    films = list((html / "_static" / "films").iterdir())
    assert films
    assert sum(film.stat().st_size for film in films) < 15e6


def test_status_lists_every_notebook(html: Path) -> None:
    rows = {str(link["href"]) for link in page(html, "book/status").select("article td a")}
    assert rows == {f"../notebooks/{name}.html" for name in NOTEBOOKS}


@pytest.fixture(scope="module")
def site(html: Path) -> Iterator[str]:
    """The built book on a local web server."""
    with served(html) as address:
        yield address


@pytest.fixture
def tab(browser: Any, site: str, request: pytest.FixtureRequest) -> Iterator[Tab]:
    opened = Tab(browser, site, **getattr(request, "param", {}))
    yield opened
    opened.close()


PHONE = {"viewport": {"width": 390, "height": 844}}
DARK = {"color_scheme": "dark"}

CONTRAST = """
() => {
  const rgb = c => (c.match(/[\\d.]+/g) || []).map(Number);
  const light = ([r, g, b]) => [r, g, b].map(v => v / 255)
    .map(v => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const behind = element => {
    for (let e = element; e; e = e.parentElement) {
      const c = rgb(getComputedStyle(e).backgroundColor);
      if (c.length === 3 || c[3] > 0.99) return c;
    }
    return [255, 255, 255];
  };
  const poor = [];
  for (const e of document.querySelectorAll(
      'article p, article li, article h1, article h2, article h3, article td, article th,'
      + ' article .caption-text, article a, .bd-sidebar-primary a, .bd-sidebar-secondary a')) {
    if (!e.innerText || !e.innerText.trim() || !e.offsetParent) continue;
    const style = getComputedStyle(e);
    const [a, b] = [light(rgb(style.color)), light(behind(e))];
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    const large = parseFloat(style.fontSize) >= 24;
    if (ratio < (large ? 3 : 4.5)) poor.push(ratio.toFixed(2) + ' ' + e.innerText.slice(0, 40));
  }
  return poor;
}
"""

UNNAMED = """
() => [...document.querySelectorAll('a[href], button, input:not([type=hidden])')]
  .filter(e => e.offsetParent)
  .filter(e => !e.textContent.trim() && !e.getAttribute('aria-label') && !e.title
    && !e.labels?.length && !e.placeholder && !e.querySelector('img[alt]:not([alt=""])'))
  .map(e => e.outerHTML.slice(0, 120))
"""


@pytest.mark.browser
class TestInTheBrowser:
    @pytest.mark.parametrize("name", PAGES)
    def test_page_opens_offline_light_and_without_script_errors(
        self, tab: Tab, html: Path, name: str
    ) -> None:
        opened = tab.open(f"{name}.html", until="networkidle")
        assert tab.errors == []
        outside = [url for url in tab.asked if not url.startswith((tab.site, "data:", "blob:"))]
        assert outside == []
        assert opened.locator("mjx-merror, .MathJax_Error").count() == 0
        if opened.locator("span.math, div.math").count():
            assert opened.locator("mjx-container").count() > 0
        if name.startswith("notebooks/"):  # a page a subject
            assert opened.evaluate(HEIGHT) < TALLEST
        opened.evaluate("document.fonts.ready")
        files = {url.partition("?")[0].removeprefix(f"{tab.site}/") for url in tab.asked}
        sizes = {file: (html / file).stat().st_size for file in files if (html / file).is_file()}
        assert sum(sizes.values()) < 1.5e6  # a first visit, before a server packs it
        assert sum(n for file, n in sizes.items() if "_static" not in file) < 300e3  # a later one

    @pytest.mark.parametrize("tab", [PHONE], indirect=True)
    @pytest.mark.parametrize("name", PAGES)
    def test_page_fits_a_phone_and_its_figures_can_be_enlarged(self, tab: Tab, name: str) -> None:
        opened = tab.open(f"{name}.html")
        wide = opened.evaluate("document.documentElement.scrollWidth")
        assert wide <= 390, f"{name} is {wide} pixels wide"
        assert opened.locator("article img:not(a img)").count() == 0

    @pytest.mark.parametrize("tab", [PHONE], indirect=True)
    def test_the_scoreboard_is_ten_screens_of_a_phone_and_every_row_can_be_linked(
        self, tab: Tab
    ) -> None:
        opened = tab.open("book/scoreboard.html")
        assert opened.evaluate("document.documentElement.scrollHeight") < 10 * 844
        boxes = opened.locator(".pst-scrollable-table-container").all()
        assert all(box.evaluate("e => e.scrollWidth <= e.clientWidth") for box in boxes)
        left_out = opened.locator("table.ledger tbody tr[hidden] [id^=claim-]").last
        claim = left_out.get_attribute("id")
        assert not left_out.is_visible()
        opened.evaluate("claim => { location.hash = claim }", claim)
        opened.locator(f"#{claim}").locator("xpath=ancestor::tr").wait_for(state="visible")

    @pytest.mark.parametrize("tab", [{}, DARK], ids=["light", "dark"], indirect=True)
    @pytest.mark.parametrize("name", OF_A_KIND)
    def test_text_can_be_read(self, tab: Tab, name: str) -> None:
        assert tab.open(f"{name}.html").evaluate(CONTRAST) == []

    @pytest.mark.parametrize("tab", [DARK], indirect=True)
    def test_dark_mode_is_dark(self, tab: Tab) -> None:
        opened = tab.open("book/intro.html")
        assert opened.evaluate("document.documentElement.dataset.theme") == "dark"
        colour = opened.evaluate("getComputedStyle(document.body).backgroundColor")
        assert max(map(int, re.findall(r"\d+", colour)[:3])) < 60

    @pytest.mark.parametrize("name", ["book/intro", PAGES[-1]])
    def test_everything_one_can_press_has_a_name(self, tab: Tab, name: str) -> None:
        assert tab.open(f"{name}.html").evaluate(UNNAMED) == []

    @pytest.mark.parametrize("tab", [{}, PHONE, DARK], ids=["wide", "phone", "dark"], indirect=True)
    @pytest.mark.parametrize("name", OF_EACH_KIND)
    def test_axe_finds_nothing_serious(self, tab: Tab, name: str) -> None:
        opened = tab.open(f"{name}.html", until="networkidle")
        opened.mouse.wheel(0, 3000)  # shows the way back to the top
        found = Axe().run(opened, options={"resultTypes": ["violations"]}).response["violations"]
        grave = [v for v in found if v["impact"] in ("serious", "critical")]
        assert [(v["id"], v["nodes"][0]["html"][:100]) for v in grave] == []

    def test_keyboard_reaches_the_text(self, tab: Tab) -> None:
        opened = tab.open("book/intro.html")
        opened.keyboard.press("Tab")
        assert "Skip to main content" in opened.evaluate("document.activeElement.innerText")
        opened.keyboard.press("Enter")
        reached = False
        for _ in range(30):
            opened.keyboard.press("Tab")
            reached |= opened.evaluate("!!document.activeElement.closest('article')")
        assert reached

    def test_formulas_are_no_tab_stops_unless_they_are_too_wide(self, tab: Tab) -> None:
        opened = tab.open("notebooks/ch02_background.html")
        opened.wait_for_function("document.querySelectorAll('mjx-container').length > 100")
        opened.wait_for_function("document.querySelectorAll('mjx-container[tabindex]').length < 20")

    def test_the_scoreboard_can_be_filtered(self, tab: Tab) -> None:
        opened = tab.open("book/scoreboard.html")
        rows = opened.locator("table.ledger tbody tr")
        everything = rows.count()
        shown = opened.locator("table.ledger tbody tr:visible")
        assert shown.count() == everything > 100
        opened.get_by_label("Chapter").select_option("3")
        some = shown.count()
        assert 0 < some < everything
        assert all(
            re.search(r"\b3(\.\d|$)", where)
            for where in opened.locator(
                "table.ledger tbody tr:visible td:last-child p"
            ).all_inner_texts()
        )
        opened.get_by_label("Words in the row").fill("no claim has these words")
        assert shown.count() == 0
        opened.get_by_label("Words in the row").fill("")
        assert shown.count() == some

    @pytest.mark.parametrize("tab", [{"java_script_enabled": False}], indirect=True)
    def test_without_scripts_the_ledger_is_a_table_and_a_chart_a_picture(self, tab: Tab) -> None:
        opened = tab.page
        opened.goto(f"{tab.site}/book/scoreboard.html")
        assert opened.locator("table.ledger tbody tr:visible").count() > 100
        assert opened.locator(".ledger-filter").count() == 0
        opened.goto(f"{tab.site}/book/play.html")
        assert opened.locator("div.chart img:visible").count() == 5

    def test_a_slider_moves_its_chart(self, tab: Tab) -> None:
        opened = tab.open("book/play.html")
        opened.wait_for_selector("div.chart .moving-chart svg", timeout=20_000)
        chart = opened.locator("div.chart").first
        assert chart.locator("img:visible").count() == 0
        for box in opened.locator(".moving-chart").all():  # none sticks out of its frame
            assert box.evaluate("e => e.scrollWidth <= e.clientWidth")
        before = chart.locator("svg").inner_html()
        slider = chart.locator("input[type=range]").first
        slider.focus()
        slider.press("ArrowLeft")
        opened.wait_for_function(
            "before => document.querySelector('div.chart svg').innerHTML !== before", arg=before
        )
        opened.evaluate("document.querySelector('article').style.maxWidth = '300px'")
        opened.wait_for_function(  # a chart goes with its column
            "document.querySelector('.moving-chart svg').getBoundingClientRect().width <= 300"
        )

    def test_films_play_and_stand_still_where_motion_is_unwelcome(self, tab: Tab) -> None:
        opened = tab.open("book/intro.html")
        still = "document.querySelector('figure.moving video').paused"
        assert opened.evaluate(still)  # the tab asks for reduced motion
        opened = tab.open("book/films.html")
        opened.evaluate("document.querySelector('video').play()")
        opened.wait_for_function("document.querySelector('video').currentTime > 0.1")

    @pytest.mark.parametrize("tab", [{"reduced_motion": "no-preference"}], indirect=True)
    def test_the_film_of_the_front_page_moves_by_itself(self, tab: Tab) -> None:
        opened = tab.open("book/intro.html")
        opened.wait_for_function(
            "document.querySelector('figure.moving video').currentTime > 0.1", timeout=30_000
        )

    def test_search_finds_bellman(self, tab: Tab) -> None:
        opened = tab.open("search.html?q=Bellman")
        opened.wait_for_selector("#search-results li a", timeout=20_000)
        found = opened.locator("#search-results li a").all_inner_texts()
        assert found
        opened.wait_for_selector("#search-results li p.context")
        assert not re.search(r"\\[a-z(]", "".join(opened.locator("p.context").all_inner_texts()))
