"""A result names the commit of this library or none, wherever a copy of it lies."""

import os
import subprocess
from pathlib import Path

import pytest

from tests.surroundings import python, small_copy

COMMIT = "from thesis_lib.checkout import commit; print(commit())"


def git(folder: Path, *arguments: str) -> str:
    alone = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    identity = ("-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false")
    command = ["git", "-C", str(folder), *identity, *arguments]
    return subprocess.run(
        command, env=alone, capture_output=True, text=True, check=True
    ).stdout.strip()


def repository(folder: Path) -> str:
    """Commit all that is in a folder; returns the commit."""
    folder.mkdir(exist_ok=True)
    (folder / "README").write_text(str(folder))
    git(folder, "init", "--quiet")
    git(folder, "add", "--all")
    git(folder, "commit", "--quiet", "--message", "all")
    return git(folder, "rev-parse", "--short=12", "HEAD")


def commit_of(copy: Path, code: str = COMMIT, **env: str) -> str:
    done = python("-c", code, root=copy, env={"PYTHONDONTWRITEBYTECODE": "1", **env})
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    return small_copy(tmp_path / "outer" / "copy")


def test_its_own_checkout(copy: Path) -> None:
    head = repository(copy)
    assert commit_of(copy) == head
    (copy / "README").write_text("changed")
    assert commit_of(copy) == head + "+"
    git(copy, "checkout", "--quiet", "README")
    (copy / "scratch.txt").write_text("of the user")
    assert commit_of(copy) == head
    (copy / "thesis_lib" / "new.py").write_text("")  # which what runs may well import
    assert commit_of(copy) == head + "+"


def test_a_copy_inside_another_repository(copy: Path) -> None:
    repository(copy.parent)
    assert commit_of(copy) == "unknown"


def test_an_installed_copy(copy: Path) -> None:
    (copy / "pyproject.toml").unlink()
    repository(copy.parent)
    assert commit_of(copy, f"import os; os.chdir({str(copy.parent)!r}); {COMMIT}") == "unknown"


def test_a_repository_that_does_not_hold_the_package(copy: Path) -> None:
    (copy / ".gitignore").write_text("thesis_lib\n")
    repository(copy)
    assert commit_of(copy) == "unknown"


def test_variables_of_git_that_name_another_repository(copy: Path, tmp_path: Path) -> None:
    head, other = repository(copy), tmp_path / "other"
    repository(other)
    foreign = {"GIT_DIR": str(other / ".git"), "GIT_WORK_TREE": str(other)}
    assert commit_of(copy, **foreign) == head
    assert commit_of(small_copy(tmp_path / "plain"), **foreign) == "unknown"


def test_without_git(copy: Path, tmp_path: Path) -> None:
    repository(copy)
    assert commit_of(copy, PATH=str(tmp_path)) == "unknown"


def test_a_commit_that_came_while_the_library_was_running(copy: Path) -> None:
    repository(copy)
    change = (
        "import pathlib, time, thesis_lib\n"
        "time.sleep(0.1)\n"  # the clock of files is coarser than that of the process
        "file = pathlib.Path(thesis_lib.__file__)\n"
        "file.write_text(file.read_text() + '\\n')\n"
    )
    assert commit_of(copy, change + COMMIT) == "unknown"
