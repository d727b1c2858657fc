"""Imports run one way, from the mathematics to the experiments to the book."""

import ast
import gc
import re
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from thesis_lib.imports import READERS, expression, imported, parsed

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "thesis_lib"

LAYERS = (
    {
        "arrays",
        "checkout",
        "checks",
        "compiled",
        "files",
        "imports",
        "registration",
        "stats",
        "surroundings",
        "mdp",
        "domains",
        "locomotion",
        "policies",
        "published",
    },
    {
        *("potentials", "relevance", "selection", "optimisation", "robustness"),
    },
    {"training"},
    {"edition"},
    {"appendix_a", "chapter2", "chapter3", "chapter4", "chapter5", "chapter6"},
    {"book", "cli", "cli_parts", "cli_training"},
)
LEVEL = {unit: level for level, units in enumerate(LAYERS) for unit in units}
EXPERIMENTS = LEVEL["training"]

FILES = sorted(PACKAGE.rglob("*.py"))
UNITS = sorted({path.relative_to(PACKAGE).parts[0].removesuffix(".py") for path in FILES})


def unit_of(file: Path) -> str:
    return file.relative_to(PACKAGE).parts[0].removesuffix(".py")


def units_imported(file: Path) -> set[str]:
    name = ".".join(file.relative_to(ROOT).with_suffix("").parts)
    package = name.removesuffix(".__init__") if file.stem == "__init__" else name.rpartition(".")[0]
    names = imported(file.read_text(), package)
    return {parts[1] for n in names if len(parts := n.split(".")) > 1 and parts[1] in LEVEL}


def test_every_unit_has_a_layer() -> None:
    assert set(UNITS) - {"__init__"} <= set(LEVEL)


def test_the_picture_of_the_house_shows_every_unit_in_its_layer() -> None:
    picture = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("thesis_lib/\n")[2]
    rows = [line.split() for line in picture.partition("\nnotebooks/")[0].splitlines()]
    shown = [unit for row in rows for unit in row if unit in LEVEL]
    assert sorted(shown) == sorted(set(LEVEL))
    assert [LEVEL[unit] for unit in shown] == sorted(LEVEL.values())


def test_long_files_are_those_for_which_a_reason_is_given() -> None:
    told = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (reasons,) = re.findall(r"at most 450 lines(.*?)\n- ", told, re.DOTALL)
    long = {
        file.relative_to(PACKAGE).as_posix()
        for file in FILES
        if len(file.read_text(encoding="utf-8").splitlines()) > 450
    }
    assert set(re.findall(r"`([\w/]+\.py)`", reasons)) == long


def code_lines(text: str) -> int:
    """Lines of a module that are no import, docstring, comment or blank."""
    left_out = {
        line
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Import | ast.ImportFrom)
        or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant))
        for line in range(node.lineno, (node.end_lineno or node.lineno) + 1)
    }
    lines = ((at, line.strip()) for at, line in enumerate(text.splitlines(), 1))
    return sum(at not in left_out and line != "" and line[0] != "#" for at, line in lines)


def test_the_library_has_no_more_code_than_is_said() -> None:
    text = '"""Words\n\nof two lines."""\n\nfrom a import (\n    b,\n)\n\n# so\nc = b(\n    1\n)\n'
    assert code_lines(text) == 3
    told = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    most, goal = re.findall(r"at most ([\d,]+) lines of code.*goal is ([\d,]+)", told, re.DOTALL)[0]
    have = sum(code_lines(file.read_text(encoding="utf-8")) for file in FILES)
    assert have <= int(most.replace(",", "")), "shorten something, or say why it must be more"
    assert int(goal.replace(",", "")) <= int(most.replace(",", ""))


@pytest.mark.parametrize("unit", [unit for unit in UNITS if unit in LEVEL])
def test_imports_run_one_way(unit: str) -> None:
    for file in FILES:
        if unit_of(file) == unit:
            above = {u for u in units_imported(file) if LEVEL[u] > LEVEL[unit]}
            assert not above, f"{file.relative_to(ROOT)} imports {sorted(above)} from above"


def test_units_of_a_layer_do_not_import_each_other_in_a_circle() -> None:
    graph: dict[str, set[str]] = {unit: set() for unit in LEVEL}
    for file in FILES:
        if (unit := unit_of(file)) in LEVEL:
            graph[unit] |= units_imported(file) - {unit}
    while graph:
        leaves = {unit for unit, uses in graph.items() if not uses & set(graph)}
        assert leaves, f"a circle among {sorted(graph)}"
        graph = {unit: uses for unit, uses in graph.items() if unit not in leaves}


@pytest.mark.parametrize(
    "file",
    [f for f in FILES if LEVEL.get(unit_of(f), EXPERIMENTS) < EXPERIMENTS],
    ids=lambda f: str(f.relative_to(PACKAGE)),
)
def test_nothing_below_experiments_plots_or_knows_a_budget(file: Path) -> None:
    tree = ast.parse(file.read_text())
    modules = {
        name.split(".")[0]
        for node in ast.walk(tree)
        for name in (
            [alias.name for alias in node.names]
            if isinstance(node, ast.Import)
            else [node.module or ""]
            if isinstance(node, ast.ImportFrom)
            else []
        )
    }
    assert not modules & {"matplotlib", "IPython", "papermill", "tyro", "argparse"}
    texts = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    assert "smoke" not in texts


def test_the_build_knows_who_reads_committed_results() -> None:
    """Else a page stands as it was when new runs are committed."""
    named = re.compile(r'(?<!"_build" / )"results[/"]')
    readers = {
        ".".join(file.relative_to(ROOT).with_suffix("").parts)
        for file in FILES
        if EXPERIMENTS < LEVEL.get(unit_of(file), 0) < LEVEL["book"]
        and named.search(file.read_text(encoding="utf-8"))
    }
    assert readers == set(READERS)
    assert all((ROOT / folder).is_dir() for folder in READERS.values())


@pytest.fixture
def threads_switch_inside_the_parser() -> Iterator[None]:
    """The collector runs often, and Python code in it lets other threads go on."""
    usual = gc.get_threshold()
    gc.callbacks.append(_give_way)
    gc.set_threshold(200)
    yield
    gc.set_threshold(*usual)
    gc.callbacks.remove(_give_way)


def _give_way(*_: object) -> None:
    time.sleep(0.0005)


@pytest.mark.usefixtures("threads_switch_inside_the_parser")
def test_threads_can_parse_at_once() -> None:
    source = Path(ast.__file__).read_text()
    terms = " + ".join(f"f({i})" for i in range(100))

    def both(_: int) -> tuple[int, int]:
        return len(parsed(source).body), sum(
            isinstance(x, ast.Call) for x in ast.walk(expression(terms))
        )

    with ThreadPoolExecutor(2) as pool:
        assert set(pool.map(both, range(4))) == {(len(ast.parse(source).body), 100)}


@pytest.mark.parametrize("file", FILES, ids=lambda f: str(f.relative_to(PACKAGE)))
def test_every_module_parses_by_one_thread_at_a_time(file: Path) -> None:
    calls = {
        ast.unparse(n.func)
        for n in ast.walk(ast.parse(file.read_text()))
        if isinstance(n, ast.Call)
    }
    assert file.name == "imports.py" or not calls & {"ast.parse", "compile", "parse"}
