"""The examples in docstrings, which the reference shows, do what they say."""

import ast
import doctest
import importlib
import inspect
import re
from pathlib import Path

import pytest

from thesis_lib.book.names import find

ROOT = Path(__file__).parents[1]
MODULES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for path in (ROOT / "thesis_lib").rglob("*.py")
    if ">>> " in path.read_text(encoding="utf-8")
)

MOST_USED = (
    *("mdp.TabularMDP", "mdp.solve", "mdp.start_value", "mdp.learn"),
    *("domains.continuing_cliff", "domains.triangle.triangle", "domains.stock.stock"),
    *("potentials.q_star", "potentials.q_tilde"),
    *("relevance.Solutions.from_domain", "relevance.k_relevance", "relevance.domain_relevance"),
    *("selection.FSTEK", "selection.JackknifeF", "selection.LeaveOneTaskOut"),
    *("policies.make_policy", "locomotion.make_task", "locomotion.BatchTask"),
    *("training.train.train", "robustness.score", "stats.mean_ci", "stats.holm"),
)
"""What people import first."""


@pytest.mark.parametrize("name", MODULES)
def test_examples_of_a_module(name: str) -> None:
    result = doctest.testmod(importlib.import_module(name))
    assert result.attempted > 0
    assert result.failed == 0


@pytest.mark.parametrize("name", MOST_USED)
def test_what_is_used_most_has_an_example(name: str) -> None:
    assert ">>> " in (inspect.getdoc(find(f"thesis_lib.{name}")) or "")


@pytest.mark.parametrize("name", MODULES)
def test_examples_are_no_part_of_the_section_before(name: str) -> None:
    """The reference would print them as parameters."""
    text = inspect.getsource(importlib.import_module(name))
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Module):
            before, mark, _ = (ast.get_docstring(node) or "").partition(">>> ")
            sections = re.findall(r"^(\w+)\n-{3,}$", before, flags=re.MULTILINE)
            assert not mark or sections[-1:] in ([], ["Examples"]), getattr(node, "name", name)
