"""Compiled loops are never those of an older state of their sources."""

import ast
from pathlib import Path

import pytest

from tests.surroundings import ROOT, python, read_only, small_copy

INNER = "from thesis_lib.compiled import njit\n\n@njit()\ndef inner(x):\n    return x + {}\n"
OUTER = (
    "from thesis_lib.compiled import njit\nfrom thesis_lib.inner import inner\n\n"
    "@njit()\ndef outer(x):\n    return inner(x)\n"
)
CALL = "from thesis_lib.outer import outer; print(outer(0))"


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A checkout in which one compiled function calls that of another file."""
    return small_copy(tmp_path / "copy", inner=INNER.format(1), outer=OUTER)


def change(copy: Path, constant: int) -> None:
    (copy / "thesis_lib" / "inner.py").write_text(INNER.format(constant))


def result(copy: Path, code: str = CALL, **env: str | None) -> str:
    done = python("-c", code, root=copy, env=env)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_a_change_in_another_file_is_seen(copy: Path) -> None:
    assert result(copy) == "1"
    change(copy, 2)
    assert result(copy) == "2"
    change(copy, 1)
    assert result(copy) == "1"


@pytest.mark.parametrize("locators", [None, "InTreeCacheLocator"])
def test_so_it_is_with_a_cache_that_the_user_chose(
    copy: Path, tmp_path: Path, locators: str | None
) -> None:
    chosen = {"NUMBA_CACHE_DIR": str(tmp_path / "mine"), "NUMBA_CACHE_LOCATOR_CLASSES": locators}
    assert result(copy, **chosen) == "1"
    change(copy, 2)
    assert result(copy, **chosen) == "2"
    assert list((tmp_path / "mine" / "thesis_lib").rglob("*.nbc"))
    assert not (copy / "_build").exists()


def test_a_file_that_changes_under_a_running_process_spoils_nothing(copy: Path) -> None:
    """A session that has loaded the old file compiles it into what another loads later."""
    session = (
        "import thesis_lib.inner, pathlib, time\n"
        "time.sleep(0.1)\n"  # the clock of files is coarser than that of the process
        "file = pathlib.Path(thesis_lib.inner.__file__)\n"
        "file.write_text(file.read_text().replace('x + 1', 'x + 2'))\n" + CALL
    )
    assert result(copy, session) == "1"
    assert result(copy) == "2"


def test_the_second_process_compiles_nothing(copy: Path) -> None:
    hits = "; print(sum(outer.stats.cache_hits.values()))"
    assert result(copy, CALL + hits).split() == ["1", "0"]
    assert result(copy, CALL + hits).split() == ["1", "1"]


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
@pytest.mark.parametrize("keep", [0, 40])
def test_a_damaged_cache_is_made_anew(copy: Path, kind: str, keep: int) -> None:
    """What a power cut leaves: numba alone stops at it in every run (numba/numba#9348)."""
    assert result(copy) == "1"
    files = list((copy / "_build" / "numba").rglob(f"*.{kind}"))
    assert files
    for file in files:
        file.write_bytes(file.read_bytes()[:keep])
    assert result(copy) == "1"
    assert all(file.stat().st_size > keep for file in files)


def test_a_users_own_functions_are_cached_where_they_were(copy: Path, tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(
        "import thesis_lib.outer, numba\n@numba.njit(cache=True)\ndef f(x):\n    return x\nf(1)\n"
    )
    done = python(str(tmp_path / "own.py"), root=copy, env={"NUMBA_CACHE_DIR": None})
    assert done.returncode == 0, done.stderr
    assert list((tmp_path / "__pycache__").glob("own.f-*.nbc"))


def test_where_nothing_can_be_written_to(copy: Path, tmp_path: Path) -> None:
    space = tmp_path / "tmp"
    space.mkdir()
    nowhere = dict.fromkeys(("HOME", "XDG_CACHE_HOME"), str(copy))
    with read_only(copy) as bound:
        env = {**nowhere, "TMPDIR": str(space), "NUMBA_CACHE_DIR": None}
        done = python("-c", CALL, root=copy, env=env, **bound)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "1\n"
    assert list(space.iterdir()) == []  # what it compiled went with it


def test_no_module_goes_past_it() -> None:
    for file in (ROOT / "thesis_lib").rglob("*.py"):
        if file.name != "compiled.py":
            for node in ast.walk(ast.parse(file.read_text())):
                named = [a.name for a in node.names] if isinstance(node, ast.Import) else []
                if isinstance(node, ast.ImportFrom):
                    named = [node.module or ""]
                assert not any(name.split(".")[0] == "numba" for name in named), file
