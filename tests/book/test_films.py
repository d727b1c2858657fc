"""The book's films."""

import re
from pathlib import Path

import pandas as pd
import pytest

from thesis_lib.book.films import FOLDER, Film, film_markdown, films_markdown, listed, main

ROOT = Path(__file__).resolve().parents[2]


def test_every_film_is_there_with_its_still_and_no_other() -> None:
    films = listed(ROOT)
    assert films
    names = {f"{film.name}{suffix}" for film in films for suffix in (".mp4", ".jpg")}
    assert {file.name for file in (ROOT / FOLDER).iterdir()} == names


def test_a_film_can_be_stopped_is_silent_and_is_told_in_words() -> None:
    page = film_markdown(Film("run", "Walker", 'It "runs".', ("a",)))
    assert '<video controls muted loop playsinline preload="none"' in page
    assert 'poster="../_static/films/run.jpg"' in page
    assert 'aria-label="It &quot;runs&quot;."' in page
    assert "autoplay" not in page


def test_the_films_of_a_robot_stand_under_its_heading() -> None:
    page = films_markdown(listed(ROOT))
    assert re.findall(r"^## (.*)$", page, re.M) == ["Half-cheetah", "Walker", "Hopper", "Swimmer"]
    before, _, after = page.partition("## Walker")
    assert "films/switch.mp4" in before
    assert "films/walker.mp4" in after
    # The page says that there is no ant.
    trained = [pd.read_csv(file) for file in (ROOT / "results" / "study").glob("*/curves.csv")]
    assert trained
    assert "Ant" not in set(pd.concat(trained).task)


def test_a_film_that_there_is_not_is_named() -> None:
    with pytest.raises(SystemExit, match=r"there is no film 'nope': choose among \w+"):
        main(["nope"])
