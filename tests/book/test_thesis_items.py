"""The map of the thesis, and the numbers that items have in the book."""

import re
from pathlib import Path
from types import SimpleNamespace

import nbformat
import pytest

from thesis_lib.book import thesis_numbers
from thesis_lib.book.thesis_items import ITEMS, Item, items_markdown, read_items
from thesis_lib.book.thesis_numbers import _number_items, letter, printed_numbers
from thesis_lib.edition import chapters
from thesis_lib.edition.ledger import Claim, Finding, Judgement, Verdict

ROOT = Path(__file__).resolve().parents[2]

LISTED = Path(__file__).with_name("thesis_items.txt")
"""Every number that the text of the thesis prints at an equation, an algorithm, a caption, a
definition, a theorem or a footnote (whose chapter is put before it)."""


@pytest.fixture(scope="module")
def items() -> list[Item]:
    return read_items(ROOT / ITEMS)


def test_every_item_of_the_thesis_has_one_row(items: list[Item]) -> None:
    rows = [f"{item.kind} {item.number}" for item in items]
    assert sorted(rows) == sorted(LISTED.read_text().splitlines())


def test_every_row_says_where_and_what_was_done(items: list[Item]) -> None:
    experiments = chapters.experiments()
    claims = {claim.id for claim in chapters.claims()}
    for item in items:
        assert item.about, item
        assert item.labels, item
        assert item.experiment or item.claim or item.state, item
        assert not item.experiment or item.experiment in experiments, item
        assert not item.claim or item.claim in claims, item


def test_every_place_exists(items: list[Item]) -> None:
    pages = [file.read_text(encoding="utf-8") for file in (ROOT / "book").glob("*.md")]
    for file in (ROOT / "notebooks").glob("*.ipynb"):
        cells = nbformat.read(file, as_version=4).cells
        pages += [cell.source + str(cell.metadata.get("mystnb", "")) for cell in cells]
    text = "\n".join(pages)
    places = set(
        re.findall(r"""(?<![\w`-])((?:sec|ch|eq|fig|tbl|alg|def|thm|lem|prop)-[\w-]+)""", text)
    )
    missing = {label for item in items for label in item.labels} - places
    assert not missing


def test_numbers_are_those_of_the_thesis_and_ours_are_letters() -> None:
    items = [
        Item("figure", "3.2", "", ("fig-a", "fig-b"), "", "", ""),
        Item("equation", "3.9", "", ("eq-v",), "", "", ""),
        Item("equation", "3.10", "", ("eq-v",), "", "", ""),
        Item("fact", "1", "", ("prop-one",), "", "", ""),
        Item("footnote", "3.1", "", ("eq-w",), "", "", ""),
    ]
    env = SimpleNamespace(
        toc_fignumbers={
            "notebooks/ch03_x": {
                "figure": {"fig-a": (3, 1), "fig-own": (3, 2), "fig-b": (3, 3)},
                "displaymath": {"equation-eq-v": (3, 1), "equation-eq-w": (3, 2)},
                "proposition": {"prop-one": (3, 1)},
                "exercise": {"ex-one": (3, 1)},
            },
            "notebooks/ch03_y": {"figure": {"fig-more": (3, 1)}},
            "book/how_to": {"table": {"tbl-x": (1,), "tbl-y": (2,)}},
            "book/status": {"table": {"tbl-z": (3,)}},
        }
    )
    _number_items(env, printed_numbers(items))
    assert env.toc_fignumbers == {
        "notebooks/ch03_x": {
            "figure": {"fig-a": ("3.2a",), "fig-own": (3, "a"), "fig-b": ("3.2b",)},
            "displaymath": {"equation-eq-v": ("3.9, 3.10",), "equation-eq-w": (3, "a")},
            "proposition": {"prop-one": ("1",)},
            "exercise": {"ex-one": (3, 1)},
        },
        "notebooks/ch03_y": {"figure": {"fig-more": (3, "b")}},
        "book/how_to": {"table": {"tbl-x": ("a",), "tbl-y": ("b",)}},
        "book/status": {"table": {"tbl-z": ("c",)}},
    }
    assert [letter(n) for n in (1, 26, 27, 52, 53)] == ["a", "z", "aa", "az", "ba"]


def test_map_tells_run_and_verdict() -> None:
    claim = Claim("3.3.1-bound", "3.3.1", "It holds.", (), "It holds.", lambda _: None)
    judged = [Judgement(claim, Finding(Verdict.REPRODUCED, ""), "book")]
    item = Item(
        "equation", "3.2", "sweeps", ("eq-ch3-bound", "sec-theorem-1"), *("theorem-1", claim.id, "")
    )
    page = items_markdown([item], judged)
    assert "## Equations" in page
    assert (
        "| equation 3.2 | sweeps | {eq}`eq-ch3-bound`, [](#sec-theorem-1) "
        "| run here, `thesis run theorem-1`; claim reproduced |"
    ) in page


@pytest.mark.parametrize(
    ("experiment", "made"),
    [
        ("table-5.2", "in part, from committed runs"),  # most robots have not been trained
        ("figure-4.4", "at the printed budget"),  # its table at the thesis's budget is committed
        ("ch3-mu-star", "with other numbers"),
        ("table-3.1", "with other numbers"),  # more runs than the thesis made
    ],
)
def test_map_tells_how_much_was_run(experiment: str, made: str) -> None:
    page = items_markdown([Item("table", "1", "it", (), experiment, "", "")], [])
    assert f"| re-run {made}, `thesis run {experiment}` |" in page


def test_a_page_is_read_once_for_all_its_numbers() -> None:
    class Environment:
        config = "the settings"
        read: list[str] = []  # noqa: RUF012

        def get_doctree(self, docname: str) -> str:
            self.read.append(docname)
            return docname.upper()

    once = thesis_numbers._ReadOnce(Environment())
    assert [once.get_doctree(name) for name in ("a", "b", "a")] == ["A", "B", "A"]
    assert Environment.read == ["a", "b"]
    assert once.config == "the settings"
