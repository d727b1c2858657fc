"""The recipes do what they say."""

import doctest
import re
from pathlib import Path

import gymnasium
import pytest

import thesis_lib  # noqa: F401  (registers the environments)

RECIPES = sorted((Path(__file__).parents[2] / "book" / "recipes").glob("*.md"))


@pytest.mark.parametrize("recipe", RECIPES, ids=lambda path: path.stem)
def test_recipe(recipe: Path) -> None:
    result = doctest.testfile(str(recipe), module_relative=False)
    assert result.attempted > 0
    assert result.failed == 0


def test_every_id_is_listed() -> None:
    text = (RECIPES[0].parent / "join_in.md").read_text()
    for env_id in gymnasium.registry:
        if env_id.startswith("thesis/"):
            name = re.sub(r"Hill$", "", env_id.removeprefix("thesis/").removesuffix("-v0"))
            assert f"`{name}`" in text or re.match(r"AppendixA2", name)
