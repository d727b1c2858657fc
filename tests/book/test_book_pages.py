"""Pages written from data."""

from pathlib import Path
from typing import Any

from thesis_lib.book.execution import Run
from thesis_lib.book.pages import status_markdown


def run(name: str, seconds: float, numpy: str = "2.0", **changes: Any) -> Run:
    manifest = {
        "name": name,
        "parameters": {"budget": "book", "seed": 3},
        "seconds": seconds,
        "started": "2026-11-22T10:11:12Z",
        "commit": "0123456789ab+",
        "digest": "fedcba9876543210",
        "machine": "x86_64, 2 cores",
        "python": "3.11.7",
        "versions": {"numpy": numpy},
    }
    return Run(Path(), manifest | changes)


def test_status_has_a_row_a_notebook() -> None:
    text = status_markdown([run("ch02_background", 59.4), run("ch03_potentials", 185)])
    assert (
        "| {doc}`chapter 2 <../notebooks/ch02_background>` | book | 3 | 59 s "
        "| 2026-11-22 | 01234567+ | fedcba98 |"
    ) in text
    assert "| 3:05 min |" in text
    assert "{doc}`appendix A <" in status_markdown([run("appendix_a", 1)])


def test_status_shows_versions_that_differ() -> None:
    text = status_markdown([run("a", 1), run("b", 1, numpy="2.1")])
    assert "| numpy | 2.0, 2.1 |" in text
    assert "| Python | 3.11.7 |" in text


def test_status_of_nothing() -> None:
    assert status_markdown([]) == "No notebook was executed for this build.\n"
