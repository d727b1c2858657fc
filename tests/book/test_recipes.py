"""The recipes do what they say."""

import doctest
import re
from pathlib import Path

import pytest
import torch

from tests.policies.networks import block
from thesis_lib.policies import DualLinearised

RECIPES = sorted((Path(__file__).parents[2] / "book" / "recipes").glob("*.md"))


@pytest.mark.parametrize("recipe", RECIPES, ids=lambda path: path.stem)
def test_recipe(recipe: Path) -> None:
    result = doctest.testfile(str(recipe), module_relative=False)
    assert result.attempted > 0
    assert result.failed == 0


def test_the_recurrent_network_of_a_recipe_is_linearised_rightly() -> None:
    text = next(r for r in RECIPES if r.stem == "join_in").read_text(encoding="utf-8")
    written = doctest.DocTestParser().get_doctest(text, {}, "join_in", None, None)
    doctest.DocTestRunner().run(written, clear_globs=False)
    policy = written.globs["MGU"](4, 2, units=3, dt=0.1, seed=1, dtype=torch.float64)
    sequences, _ = block(policy)
    fast, slow = policy.linearise(sequences), DualLinearised(policy, sequences)
    draw = torch.Generator().manual_seed(0)
    v = torch.randn(policy.n_trainable, generator=draw, dtype=torch.float64)
    torch.testing.assert_close(fast.jvp(v), slow.jvp(v), rtol=1e-12, atol=1e-12)
    u = torch.randn(fast.mean.shape, generator=draw, dtype=torch.float64)
    torch.testing.assert_close(fast.vjp(u), slow.vjp(u), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("recipe", RECIPES, ids=lambda path: path.stem)
def test_code_fits_a_tablet(recipe: Path) -> None:
    code = re.findall(r"^```\w+\n(.*?)^```", recipe.read_text(), flags=re.DOTALL | re.MULTILINE)
    assert code
    assert max(len(line) for block in code for line in block.splitlines()) <= 82
