"""The import graph by which the build knows what a notebook depends on."""

from pathlib import Path

import pytest

from thesis_lib.imports import closure, data_files, imported


@pytest.fixture
def root(tmp_path: Path) -> Path:
    files = {
        "__init__.py": "",
        "a.py": "from thesis_lib.b import f\n",
        "b.py": "def f():\n    from .sub import deep\n    return deep\n",
        "sub/__init__.py": "",
        "sub/deep.py": "from ..c import g\nfrom . import side\n",
        "sub/side.py": "",
        "sub/data.csv": "x\n1\n",
        "c.py": "import numpy\n",
        "d.py": "from importlib import import_module\nimport_module('thesis_lib.c')\n",
    }
    for name, text in files.items():
        path = tmp_path / "thesis_lib" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path


def test_imported_names() -> None:
    assert imported("import thesis_lib.mdp.model as m\nimport numpy") == {
        "thesis_lib",
        "thesis_lib.mdp",
        "thesis_lib.mdp.model",
    }
    assert "thesis_lib.mdp.model.TabularMDP" in imported(
        "from thesis_lib.mdp.model import TabularMDP"
    )
    assert imported("from thesis_library import x") == set()


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("from . import y", "thesis_lib.p.y"),
        ("from .q import y", "thesis_lib.p.q"),
        ("from .. import z", "thesis_lib.z"),
        ("from ..r import z", "thesis_lib.r"),
    ],
)
def test_relative_imports_are_resolved(source: str, expected: str) -> None:
    assert expected in imported(source, "thesis_lib.p")


def test_closure_follows_functions_relative_imports_and_packages(root: Path) -> None:
    assert list(closure(["from thesis_lib.a import f"], root)) == [
        "thesis_lib",
        "thesis_lib.a",
        "thesis_lib.b",
        "thesis_lib.c",
        "thesis_lib.sub",
        "thesis_lib.sub.deep",
        "thesis_lib.sub.side",
    ]


def test_import_inside_a_function_of_a_cell_counts(root: Path) -> None:
    assert "thesis_lib.c" in closure(["def f():\n    import thesis_lib.c"], root)


def test_import_by_name_is_not_followed(root: Path) -> None:
    assert list(closure(["import thesis_lib.d"], root)) == ["thesis_lib", "thesis_lib.d"]


def test_data_of_a_package_belongs_to_it(root: Path) -> None:
    assert [f.name for f in data_files(closure(["import thesis_lib.sub"], root))] == ["data.csv"]
    assert data_files(closure(["import thesis_lib.c"], root)) == []
