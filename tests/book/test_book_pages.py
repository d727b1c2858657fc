"""Pages written from data."""

import re
from pathlib import Path
from typing import Any

import gymnasium
import pandas as pd
import pytest

from thesis_lib.book.environments import environments_markdown
from thesis_lib.book.execution import Run
from thesis_lib.book.mutants import code_of_mutant, mutants_markdown
from thesis_lib.book.pages import (
    deepest_markdown,
    drills_markdown,
    status_markdown,
)
from thesis_lib.edition.chapters import find
from thesis_lib.edition.roots import code_of_table
from thesis_lib.edition.saved import saved

ROOT = Path(__file__).resolve().parents[2]


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
        "| {doc}`../notebooks/ch02_background` | book | 3 | 59 s "
        "| [2026-11-22]{.day} | 01234567+ | fedcba98 |"
    ) in text
    assert "| 3:05 min |" in text


def test_status_shows_versions_that_differ() -> None:
    text = status_markdown([run("a", 1), run("b", 1, numpy="2.1")])
    assert "| numpy | 2.0, 2.1 |" in text
    assert "| Python | 3.11.7 |" in text


def test_status_of_nothing() -> None:
    assert status_markdown([]) == "No notebook was executed for this build.\n"


def test_a_committed_table_says_whether_its_code_is_as_it_was() -> None:
    experiment = find("figure-4.4")
    code = code_of_table(experiment, experiment.config("thesis"))
    made = {"cpu_seconds": 61.1, "started": "2026-11-23T04:40:41Z", "commit": "e2bed4eb2d75"}
    record = {"id": "figure-4.4"} | made
    of_old = record | {"code": "other"}
    text = deepest_markdown([record | {"code": code}, of_old, record])
    rows = [row for row in text.splitlines() if row.startswith("| Figure 4.4 |")]
    assert rows[0] == ("| Figure 4.4 | 1:01 min | [2026-11-23]{.day} | e2bed4eb | as it was |")
    assert [row.split(" | ")[-1] for row in rows[1:]] == ["changed |", "not recorded |"]


def test_drills_have_a_row_each() -> None:
    row = {"command": "thesis run", "drill": "killed", "good": 19, "of": 20}
    text = drills_markdown(pd.DataFrame([row | {"commit": "0123456789ab", "day": "2026-11-29"}]))
    assert "\n| `thesis run` | killed | 19 of 20 | 01234567 | [2026-11-29]{.day} |\n" in text


def test_mutants_tell_what_noticed_them_or_why_no_claim_does() -> None:
    row = {"mutant": "a", "file": "b.py", "caught": True, "commit": "0123456789ab", "code": None}
    moved = row | {"verdicts": "3.1-x: reproduced -> refuted", "reason": float("nan")}
    text = mutants_markdown(pd.DataFrame([moved, row | {"verdicts": None, "reason": "ties"}]))
    assert "| a | `b.py` | yes | 3.1-x: reproduced → refuted | 01234567 | not recorded |" in text
    assert "| a | `b.py` | yes |  (none: ties) | 01234567 | not recorded |" in text
    stopped = row | {"verdicts": "x: reproduced -> error: a (b) that is cu; y: z", "reason": None}
    text = mutants_markdown(pd.DataFrame([stopped]))
    assert "| yes | x: reproduced → stops with an error; y: z | 01234567 |" in text


def test_mutants_say_whether_they_were_made_by_other_code() -> None:
    asked = ("mdp/greedy.py", "tests/mdp/test_greedy.py", ["A.1-values"], "book")
    row = {"mutant": "a", "caught": True, "commit": "unknown", "reason": None}
    row |= {"file": asked[0], "test": f"{asked[1]} -k 'x'", "budget": asked[3]}
    row |= {"verdicts": "A.1-values: reproduced -> error: a: b (c)"}
    codes = (code_of_mutant(*asked), "other")
    text = mutants_markdown(pd.DataFrame([row | {"code": code} for code in codes]))
    assert re.findall(r"not recorded \| (.*) \|", text) == ["as it was", "changed"]


def test_what_pages_include_has_a_stub_in_the_checkout() -> None:
    """So that a bare `jupyter-book build .` finds every file."""
    pages = [file.read_text(encoding="utf-8") for file in (ROOT / "book").glob("*.md")]
    included = set(re.findall(r"\{include\} _generated/(\S+)", "\n".join(pages)))
    assert "deepest.md" in included
    assert included <= {file.name for file in (ROOT / "book" / "_generated").iterdir()}


def test_the_drills_that_are_committed_are_all_there_and_none_failed() -> None:
    drills = saved("drills/drills").table
    assert (drills.good == drills.of).all()
    assert not drills.commit.str.endswith("+").any()
    done = drills.set_index(["command", "drill"]).of
    for command in ("run", "train"):
        own = done[f"thesis {command}"]
        assert own["killed, then given again"] >= 20
        assert own["twice at once in one directory"] >= 1
        assert own[own.index.str.startswith("disk full")].sum() >= 10
    assert done["thesis sweep", "killed again and again"] >= 20
    assert done["thesis book", "killed"] >= 20
    assert done["thesis sweep", "then brought to its end, equal bytes"] == 1
    assert done["thesis book", "then given again, equal bytes"] == 1
    assert done[:, "bad input"].sum() >= 40
    for command in ("run", "sweep"):
        assert done[f"thesis {command}", "1, 2 and 4 workers, equal bytes"] == 3


def test_every_environment_is_listed_with_its_spaces() -> None:
    text = environments_markdown()
    assert "| `thesis/Triangle-v0` | The triangle domain of section 3.4.3: 12 tasks" in text
    assert (
        "| `thesis/Hopper-v0` | Hopper of section 5.1, ground: flat | 20 reals | 3 reals in" in text
    )
    assert "reals in [\N{MINUS SIGN}1, 1] |" in text
    assert "| one of 4 | one of 3 |" in text  # three states and a goal; left, right and up
    # a place in the area of side 10, an angle, and heat
    assert re.search(
        r"thesis/Heat-v0` .* 4 reals in \[0, 10\], \[0, 10\], \[0, 2π\], \[0, 1\] ", text
    )
    assert "thesis/HopperHill-v0` | Hopper of section 5.1, ground: hills of difficulty 0.5" in text
    listed = re.findall(r"^\| `(\S+)`", text, flags=re.MULTILINE)
    own = [name for name in gymnasium.registry if name.startswith("thesis/")]
    assert sorted(listed) == sorted(own)


@pytest.mark.parametrize("page", sorted((ROOT / "book").rglob("[!_]*.md")), ids=lambda p: p.stem)
def test_no_heading_is_a_link_alone(page: Path) -> None:
    """The list of a page's sections leaves links out, so that such a one would have no name."""
    assert not re.search(r"^#+ +\[[^]]*\]\([^)]*\) *$", page.read_text(), flags=re.MULTILINE)
