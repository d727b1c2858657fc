"""Which notebooks the build runs again, and what it keeps of a run."""

import json
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

from tests.surroundings import python
from thesis_lib.book.build import _listed, build, collect_tables
from thesis_lib.book.execution import Run, execute, expected_seconds, finished, plan
from thesis_lib.book.paths import Paths
from thesis_lib.book.staging import stage, sync
from thesis_lib.chapter3 import figure_3_3, mu_star

PARAMETERS = 'budget: str = "book"  # which\nseed: int = 0\nworkers: int = 2'


def write(root: Path, name: str, *cells: str, prose: str = "# Title") -> None:
    notebook = new_notebook(
        cells=[
            new_markdown_cell(prose, id="title"),
            new_code_cell(PARAMETERS, id="parameters", metadata={"tags": ["parameters"]}),
            *(new_code_cell(cell, id=f"cell-{i}") for i, cell in enumerate(cells)),
        ],
        metadata={"kernelspec": {"name": "python3", "display_name": "", "language": "python"}},
    )
    nbformat.write(notebook, root / "notebooks" / f"{name}.ipynb")


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A checkout with a small package.

    ``one`` uses ``a`` and the data, ``two`` uses ``b`` and the committed results.
    """
    for name, text in {
        "_config.yml": "title: t\nexecute: {execute_notebooks: cache}\n",
        "_toc.yml": "format: jb-book\nroot: book/intro\n",
        "book/intro.md": "# Intro\n",
        "constraints.txt": "numpy==1\n",
        "thesis_lib/__init__.py": "",
        "thesis_lib/a.py": "x = 1\n",
        "thesis_lib/b.py": "x = 1\n",
        "thesis_lib/published/__init__.py": "",
        "thesis_lib/published/t.csv": "x\n1\n",
        "thesis_lib/edition/__init__.py": "",
        "thesis_lib/edition/saved.py": "",
        "results/learning/curves.csv": "x\n1\n",
    }.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (tmp_path / "notebooks").mkdir()
    write(tmp_path, "one", "import thesis_lib.a, thesis_lib.published")
    write(tmp_path, "two", "import thesis_lib.b, thesis_lib.edition.saved")
    return tmp_path


def digests(root: Path, budget: str = "smoke", seed: int = 0) -> dict[str, str]:
    return {task.name: task.digest for task in plan(Paths.of(budget, root), seed, ["one", "two"])}


def changed(root: Path, before: dict[str, str], **options: Any) -> set[str]:
    return {name for name, digest in digests(root, **options).items() if digest != before[name]}


@pytest.mark.parametrize(
    ("file", "stale"),
    [
        ("thesis_lib/a.py", {"one"}),
        ("thesis_lib/b.py", {"two"}),
        ("thesis_lib/published/t.csv", {"one"}),
        ("results/learning/curves.csv", {"two"}),
        ("thesis_lib/__init__.py", {"one", "two"}),
        ("constraints.txt", {"one", "two"}),
        ("book/intro.md", set()),
        ("_config.yml", set()),
    ],
)
def test_a_changed_file_makes_exactly_its_dependents_stale(
    root: Path, file: str, stale: set[str]
) -> None:
    before = digests(root)
    (root / file).write_text((root / file).read_text() + "\n# changed\n")
    assert changed(root, before) == stale


def test_code_counts_and_prose_does_not(root: Path) -> None:
    before = digests(root)
    write(root, "one", "import thesis_lib.a, thesis_lib.published", prose="# Another title")
    assert changed(root, before) == set()
    write(root, "one", "import thesis_lib.a, thesis_lib.published  # more")
    assert changed(root, before) == {"one"}


def test_parameters_count(root: Path) -> None:
    before = digests(root)
    assert changed(root, before, seed=1) == {"one", "two"}
    assert changed(root, before, budget="book") == {"one", "two"}


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        ([new_code_cell("x = 1", id="x")], "tagged 'parameters'"),
        (
            [new_code_cell("budget = 1", id="p", metadata={"tags": ["parameters"]})],
            "unknown parameter 'seed', 'workers'; this notebook takes budget",
        ),
    ],
)
def test_a_notebook_that_cannot_take_the_parameters_is_refused(
    root: Path, cells: list[Any], message: str
) -> None:
    nbformat.write(new_notebook(cells=cells), root / "notebooks" / "bad.ipynb")
    with pytest.raises(ValueError, match=message):
        plan(Paths.of("smoke", root), 0, ["bad"])


@pytest.mark.parametrize("text", ["", "{}", "not JSON", '{"cells": 3}', "\x00\x05"])
def test_a_listed_file_that_is_no_notebook_is_named(root: Path, text: str) -> None:
    (root / "notebooks" / "one.ipynb").write_text(text)
    with pytest.raises(ValueError, match=r"^one\.ipynb (is not a notebook|must have one cell)"):
        plan(Paths.of("smoke", root), 0, ["one"])


def test_what_editors_and_file_managers_leave_does_not_matter(root: Path) -> None:
    said: list[str] = []
    before = digests(root)
    for name in ("Untitled.ipynb", "._one.ipynb", ".ipynb_checkpoints/one-checkpoint.ipynb"):
        (root / "notebooks" / name).parent.mkdir(exist_ok=True)
        (root / "notebooks" / name).write_text("")
    for name in ("results/.DS_Store", "thesis_lib/published/._t.csv", "book/.intro.md.swp"):
        (root / name).write_text("")
    (root / "_toc.yml").write_text(
        "format: jb-book\nroot: book/intro\nchapters:\n- file: notebooks/one\n"
    )
    assert changed(root, before) == set()
    assert _listed((), Paths.of("smoke", root), said.append) == ["one"]
    assert said == [
        f"notebooks/{name}.ipynb is not in _toc.yml, so it gets no page."
        for name in ("Untitled", "two")
    ]
    stage(Paths.of("smoke", root), {}, {}, {})
    staged = Paths.of("smoke", root).source
    assert [f.name for f in (staged / "book").iterdir()] == ["intro.md"]


def test_a_redirected_build_has_no_colour_codes(tmp_path: Path) -> None:
    (tmp_path / "_config.yml").write_text("title: t\nexecute: {execute_notebooks: 'off'}\n")
    (tmp_path / "_toc.yml").write_text("format: jb-book\nroot: intro\n")
    (tmp_path / "intro.md").write_text("# Intro\n\n{ref}`nowhere`\n")
    folders = [str(tmp_path), str(tmp_path / "html"), str(tmp_path / "doctrees")]
    done = python("-m", "thesis_lib.book.render", *folders, "--strict")
    assert done.returncode == 1
    assert "undefined label: 'nowhere'" in done.stderr
    assert "\x1b" not in done.stderr + done.stdout


def test_a_folder_without_a_book_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="there is no book in"):
        Paths.of("smoke", tmp_path)


def test_build_refuses_what_does_not_exist(root: Path) -> None:
    with pytest.raises(ValueError, match="smoke, book, thesis"):
        build("fast", root=root)
    with pytest.raises(ValueError, match="no notebook 'three': choose among one, two"):
        build("smoke", only=["three"], root=root)
    with pytest.raises(ValueError, match="seed is -1"):
        build("smoke", seed=-1, root=root)


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Three small notebooks run with real kernels: one good, one failing, one sly."""
    root = tmp_path_factory.mktemp("checkout")
    package = Path(__file__).resolve().parents[2] / "thesis_lib"
    (root / "thesis_lib").symlink_to(package)
    (root / "notebooks").mkdir()
    (root / "book").mkdir()
    (root / "_config.yml").write_text("title: t\nexecute: {execute_notebooks: cache}\n")
    (root / "_toc.yml").write_text("format: jb-book\nroot: book/intro\n")
    (root / "constraints.txt").write_text("")
    store = (
        "import os, pathlib\n"
        "folder = pathlib.Path(os.environ['THESIS_RESULTS'])\n"
        "(folder / 'table-0.csv').write_text(f'{budget},{seed}')\n"
        "(folder / 'table-0.json').write_text('{}')"
    )
    write(root, "good", store, "print(budget, seed)")
    write(root, "failing", "1 / 0")
    write(root, "sly", "import importlib\nimportlib.import_module('thesis_lib.stats')")
    paths = Paths.of("smoke", root)
    tasks = plan(paths, 3, ["failing", "good", "sly"])
    said: list[str] = []
    return paths, {task.name: task for task in tasks}, execute(tasks, paths, said.append), said


def test_a_notebook_outside_the_table_of_contents_is_named_and_left_out(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    monkeypatch.setattr("thesis_lib.book.build.generated", lambda *_, **__: {})
    (root / "_toc.yml").write_text("format: jb-book\nroot: book/intro\n")
    build("smoke", root=root, say=said.append)
    assert said[:3] == [
        "notebooks/one.ipynb is not in _toc.yml, so it gets no page.",
        "notebooks/two.ipynb is not in _toc.yml, so it gets no page.",
        "0 notebooks at the smoke budget: 0 unchanged, 0 to execute.",
    ]


def test_the_longest_goes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By its last run, or by what its experiments state: those it names, not all it imports."""
    (tmp_path / "thesis_lib").symlink_to(Path(__file__).resolve().parents[2] / "thesis_lib")
    (tmp_path / "notebooks").mkdir()
    (tmp_path / "constraints.txt").write_text("")
    (tmp_path / "_config.yml").write_text("title: t\n")
    both = "from thesis_lib.chapter3 import figure_3_3, mu_star"
    write(tmp_path, "again", "1")
    write(tmp_path, "long", both, "page.run(mu_star.searches)")
    write(tmp_path, "none", "1")
    write(tmp_path, "short", both, "page.run(figure_3_3.by_alpha)")
    paths = Paths.of("smoke", tmp_path)
    (paths.executed / "again").mkdir(parents=True)
    (paths.executed / "again" / "manifest.json").write_text('{"seconds": 1e4}')
    tasks = plan(paths, 0, ["again", "long", "none", "short"])
    assert {task.name: expected_seconds(task, paths) for task in tasks} == {
        "again": 1e4,
        "long": mu_star.searches.seconds,
        "none": 0.0,
        "short": figure_3_3.by_alpha.seconds,
    }
    ran: list[str] = []
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    monkeypatch.setattr(
        "thesis_lib.book.execution._execute", lambda task, *_: ran.append(task.name)
    )
    execute(tasks, paths, lambda _: None)
    assert ran == ["again", "long", "short", "none"]


class TestRunning:
    def test_only_the_good_one_is_kept(self, outcome: Any) -> None:
        paths, tasks, errors, _ = outcome
        assert set(errors) == {"failing", "sly"}
        assert finished(tasks["good"], paths)
        assert not finished(tasks["failing"], paths)
        assert [f.name for f in paths.executed.iterdir()] == ["good"]

    def test_failure_says_where_and_why(self, outcome: Any) -> None:
        paths, _, errors, said = outcome
        assert "ZeroDivisionError" in str(errors["failing"])
        assert "\x1b" not in str(errors["failing"])
        assert "\x1b" not in (paths.reports / "failing.log").read_text()
        assert (paths.reports / "failing.ipynb").exists()
        assert any("failing: FAILED" in line for line in said)

    def test_a_hidden_import_is_refused(self, outcome: Any) -> None:
        error = str(outcome[2]["sly"])
        named = error.removeprefix("sly loaded ").partition(" without an import")[0].split(", ")
        assert {"thesis_lib", "thesis_lib.stats"} <= set(named)

    def test_manifest(self, outcome: Any) -> None:
        paths, tasks, *_ = outcome
        manifest = json.loads((paths.executed / "good" / "manifest.json").read_text())
        assert manifest["parameters"] == {"budget": "smoke", "seed": 3}
        assert manifest["digest"] == tasks["good"].digest
        assert manifest["tables"] == ["table-0"]
        assert {"seconds", "started", "versions", "commit"} <= set(manifest)

    def test_the_page_shows_the_parameters_it_ran_with(self, outcome: Any) -> None:
        paths, tasks, *_ = outcome
        run = finished(tasks["good"], paths)
        stage(paths, {"good": tasks["good"]}, {"good": run}, {"status.md": "text"})
        page = nbformat.read(paths.source / "notebooks" / "good.ipynb", as_version=4)
        assert page.cells[1].source.splitlines()[:2] == [
            "budget: str = 'smoke'  # which",
            "seed: int = 3",
        ]
        assert page.cells[-1].outputs[0].text == "smoke 3\n"
        assert len(page.cells) == 4  # neither papermill's cell nor the build's is left
        assert (paths.source / "book" / "_generated" / "status.md").read_text() == "text"
        assert "execute_notebooks: 'off'" in (paths.source / "_config.yml").read_text()

    def test_prose_is_merged_without_running(self, outcome: Any) -> None:
        paths, tasks, *_ = outcome
        write(
            paths.root, "good", *[c.source for c in tasks["good"].source.cells[2:]], prose="# New"
        )
        task = plan(paths, 3, ["good"])[0]
        run = finished(task, paths)
        assert run
        stage(paths, {"good": task}, {"good": run}, {})
        page = nbformat.read(paths.source / "notebooks" / "good.ipynb", as_version=4)
        assert page.cells[0].source == "# New"
        assert page.cells[-1].outputs[0].text == "smoke 3\n"

    def test_tables_reach_the_ledger(self, outcome: Any) -> None:
        paths, tasks, *_ = outcome
        run = finished(tasks["good"], paths)
        collect_tables({"good": run}, paths.results)
        assert (paths.results / "table-0.csv").read_text() == "smoke,3"


def test_tables_that_no_notebook_makes_any_longer_go(tmp_path: Path) -> None:
    results, folder = tmp_path / "results", tmp_path / "run"
    (folder / "results").mkdir(parents=True)
    for name in ("table-1.csv", "table-2.csv"):
        (folder / "results" / name).write_text("1")
    results.mkdir()
    (results / "by-hand.csv").write_text("2")
    (results / "table-1.csv").write_text("an older run")
    run = Run(folder, {})
    collect_tables({"n": run}, results)
    assert (results / "table-1.csv").read_text() == "1"
    (folder / "results" / "table-2.csv").unlink()
    collect_tables({"n": run}, results)
    assert {f.name for f in results.glob("*.csv")} == {"by-hand.csv", "table-1.csv"}


def test_sync_leaves_equal_files_alone_and_removes_others(tmp_path: Path) -> None:
    sync({Path("a/x"): b"1", Path("y"): b"2"}, tmp_path)
    before = (tmp_path / "a/x").stat().st_mtime_ns
    sync({Path("a/x"): b"1"}, tmp_path)
    assert (tmp_path / "a/x").stat().st_mtime_ns == before
    assert not (tmp_path / "y").exists()
    sync({Path("z"): b"3"}, tmp_path)
    assert [f.name for f in tmp_path.iterdir()] == ["z"]
