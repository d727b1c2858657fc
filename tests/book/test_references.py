"""The bibliography: complete entries, and one for every work that a page cites."""

import json
import re
from pathlib import Path

import pytest
from pybtex.database import BibliographyData, Entry, parse_file

ROOT = Path(__file__).resolve().parents[2]
BIBLIOGRAPHY = ROOT / "book" / "references.bib"
REQUIRED = {
    "article": {"title", "journal", "volume", "pages", "year"},
    "inproceedings": {"title", "booktitle", "year"},
    "book": {"title", "publisher", "year"},
    "phdthesis": {"title", "school", "year"},
    "techreport": {"title", "institution", "year"},
    "misc": {"title", "year", "note"},
}
CITATION = re.compile(r"\{cite:\w+\}`([^`]+)`")


@pytest.fixture(scope="module")
def bibliography() -> BibliographyData:
    return parse_file(BIBLIOGRAPHY)  # raises on a key given twice


def _authors(entry: Entry) -> list[str]:
    return [" ".join(p.last_names) for p in entry.persons.get("author", [])]


def test_entries_are_complete(bibliography: BibliographyData) -> None:
    for key, entry in bibliography.entries.items():
        missing = REQUIRED[entry.type] - set(entry.fields)
        assert not missing, f"{key} lacks {missing}"
        assert _authors(entry), f"{key} has no author"
        assert re.fullmatch(r"(19|20)\d\d", entry.fields["year"]), key
        assert key[-4:].isdigit() or re.search(r"\d{4}[a-z]+$", key), key
        assert entry.fields["year"] in key, f"{key} does not name its year"
        pages = entry.fields.get("pages")
        assert pages is None or re.fullmatch(r"[\d:]+--[\d:]+", pages), f"{key}: {pages}"


def test_no_work_stands_twice(bibliography: BibliographyData) -> None:
    titles = [
        (re.sub(r"\W", "", e.fields["title"]).lower(), e.fields["year"], e.fields.get("edition"))
        for e in bibliography.entries.values()
    ]
    assert len(set(titles)) == len(titles)


def test_every_citation_has_an_entry(bibliography: BibliographyData) -> None:
    cited: dict[str, str] = {}
    for page in [*(ROOT / "book").glob("**/*.md"), *(ROOT / "notebooks").glob("*.ipynb")]:
        text = page.read_text(encoding="utf-8")
        if page.suffix == ".ipynb":
            cells = json.loads(text)["cells"]
            text = "\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "markdown")
        for keys in CITATION.findall(text):
            cited.update(dict.fromkeys(map(str.strip, keys.split(",")), page.name))
    unknown = {key: page for key, page in cited.items() if key not in bibliography.entries}
    assert not unknown


# Addresses of these could not be confirmed by a second source, so they have none.
UNCONFIRMED = {"snel2010", "snel2011cpg", "laud2003", "tanaka2003"}


def test_works_can_be_reached(bibliography: BibliographyData) -> None:
    reached = {
        key for key, entry in bibliography.entries.items() if {"doi", "url"} & {*entry.fields}
    }
    assert set(bibliography.entries) - reached == UNCONFIRMED
    for key, entry in bibliography.entries.items():
        assert re.fullmatch(r"10\.\d{4,5}/\S+", entry.fields.get("doi", "10.1000/1")), key
        assert re.fullmatch(r"https?://\S+", entry.fields.get("url", "https://a")), key
