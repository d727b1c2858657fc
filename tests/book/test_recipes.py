"""The recipes do what they say."""

import doctest
import re
from pathlib import Path

import pytest

RECIPES = sorted((Path(__file__).parents[2] / "book" / "recipes").glob("*.md"))


@pytest.mark.parametrize("recipe", RECIPES, ids=lambda path: path.stem)
def test_recipe(recipe: Path) -> None:
    result = doctest.testfile(str(recipe), module_relative=False)
    assert result.attempted > 0
    assert result.failed == 0


@pytest.mark.parametrize("recipe", RECIPES, ids=lambda path: path.stem)
def test_code_fits_a_tablet(recipe: Path) -> None:
    code = re.findall(r"^```\w+\n(.*?)^```", recipe.read_text(), flags=re.DOTALL | re.MULTILINE)
    assert code
    assert max(len(line) for block in code for line in block.splitlines()) <= 82
