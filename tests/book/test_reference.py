"""The reference has every public module, once."""

import re
from collections import Counter
from pathlib import Path

import pytest
from sphinx.ext.napoleon import Config
from sphinx.ext.napoleon.docstring import NumpyDocstring

from thesis_lib.book.names import tell_attributes_apart

ROOT = Path(__file__).resolve().parents[2]
PAGES = ROOT / "book" / "api"
PACKAGES = (
    *("mdp", "domains", "potentials", "relevance", "selection", "locomotion", "policies"),
    *("optimisation", "training", "edition"),
)


def described() -> Counter[str]:
    text = "\n".join(page.read_text() for page in PAGES.glob("*.md"))
    return Counter(re.findall(r"automodule:: thesis_lib\.(\S+)", text))


def test_attributes_that_share_a_line_are_told_apart() -> None:
    tell_attributes_apart()
    text = "Attributes\n----------\nlow, high : float\n    Bounds.\nn : int\n    How many.\n"
    read = str(NumpyDocstring(text, Config(napoleon_use_ivar=True)))
    for line in (":ivar low: Bounds.", ":ivar high: Bounds.", ":vartype high: float", ":ivar n: "):
        assert line in read


@pytest.mark.parametrize("package", PACKAGES)
def test_every_module_of_a_package_is_described(package: str) -> None:
    files = (ROOT / "thesis_lib" / package).glob("*.py")
    modules = {f"{package}.{f.stem}" for f in files if f.stem[0] != "_" and f.stem != "checks"}
    assert modules <= set(described())


def test_no_module_is_described_twice_and_none_that_is_gone() -> None:
    for name, times in described().items():
        path = ROOT / "thesis_lib" / name.replace(".", "/")
        assert path.with_suffix(".py").exists() or (path / "__init__.py").exists(), name
        assert times == 1, name
