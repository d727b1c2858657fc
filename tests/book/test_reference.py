"""The reference has every public module, once."""

import ast
import json
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from sphinx.ext.napoleon import Config
from sphinx.ext.napoleon.docstring import NumpyDocstring

from thesis_lib.book.names import exists, find, keep_first_words, tell_attributes_apart

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


def test_an_attribute_s_words_before_a_colon_are_no_type() -> None:
    keep_first_words()
    text = "flat, or hill: one map, drawn from the seed.\n\n:meta hide-value:"
    read = NumpyDocstring(text, Config(), what="attribute", name="x", obj=object).lines()
    assert "\n".join(read).strip() == text


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


def prose() -> Iterator[tuple[str, str]]:
    """Pages that are read, without their code; the page Notation has a test of its own."""
    for page in sorted((ROOT / "book").rglob("*.md")):
        if page.name != "notation.md" and "_generated" not in page.parts:
            text = page.read_text(encoding="utf-8")
            yield page.name, re.sub(r"^```(?!{).*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    for notebook in sorted((ROOT / "notebooks").glob("*.ipynb")):
        for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"]:
            if cell["cell_type"] == "markdown":
                yield f"{notebook.name}, {cell['id']}", "".join(cell["source"])


def public() -> set[str]:
    """Functions and classes that the reference describes."""
    names = set()
    for module in described():
        path = ROOT / "thesis_lib" / module.replace(".", "/")
        file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        for node in ast.parse(file.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name[0] != "_":
                names.add(node.name)
    return names


def test_what_prose_names_of_the_package_is_linked() -> None:
    known = public()
    assert {"FSTEK", "soft_policy_iteration"} <= known
    for where, text in prose():
        for span in re.findall(r"(?<![}`\w])`([A-Za-z_][\w.]*)`(?!`)", text):
            last = span.rpartition(".")[2]
            # A plain word such as `fit` may be an argument of something else.
            assert last not in known or last.isalpha() & last.islower(), f"{where}: link {span}"
            if span.count(".") > 1 and "chapter" not in span:
                assert not exists(span), f"{where}: link {span}"


ROLES = re.compile(r"{(?:func|class|mod|meth|data|attr)}`~?(?:[^`<]*<)?([\w.]+)>?`")


def test_each_notebook_leads_to_the_reference_and_each_recipe_is_led_to() -> None:
    told = [(where.partition(".ipynb")[0], text) for where, text in prose() if ".ipynb" in where]
    assert {name for name, text in told if ROLES.search(text)} == {
        notebook.stem for notebook in (ROOT / "notebooks").glob("*.ipynb")
    }
    linked = {name for _, text in told for name in re.findall(r"recipes/(\w+)\.md\)", text)}
    assert linked == {recipe.stem for recipe in (ROOT / "book" / "recipes").glob("*.md")}


def test_links_of_prose_lead_to_the_reference() -> None:
    linked = [(where, name) for where, text in prose() for name in ROLES.findall(text)]
    assert len(linked) > 20
    modules = {f"thesis_lib.{name}" for name in described()}
    for where, name in linked:
        home = name if name in modules else getattr(find(name), "__module__", name)
        assert home in modules, f"{where}: {name}"
