"""The recipes do what they say."""

import doctest
from pathlib import Path

import pytest

RECIPES = sorted((Path(__file__).parents[2] / "book" / "recipes").glob("*.md"))


@pytest.mark.parametrize("recipe", RECIPES, ids=lambda path: path.stem)
def test_recipe(recipe: Path) -> None:
    result = doctest.testfile(str(recipe), module_relative=False)
    assert result.attempted > 0
    assert result.failed == 0
