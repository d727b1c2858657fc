"""Committed results are read whole or not at all."""

import json
import re
import subprocess
from pathlib import Path

import pytest

from thesis_lib.checkout import repository_root
from thesis_lib.edition.saved import saved


def test_a_table_comes_with_its_provenance(tmp_path: Path) -> None:
    folder = tmp_path / "results" / "learning"
    folder.mkdir(parents=True)
    (folder / "curves.csv").write_text("task,kl\nHopper,0.5\n")
    (folder / "curves.json").write_text(json.dumps({"commit": "abc"}))
    found = saved("learning/curves", tmp_path)
    assert found.table.task.tolist() == ["Hopper"]
    assert found.table.kl.tolist() == [0.5]
    assert found.provenance["commit"] == "abc"


@pytest.mark.parametrize("missing", ["csv", "json"])
def test_what_is_missing_is_named_in_one_sentence(tmp_path: Path, missing: str) -> None:
    folder = tmp_path / "results"
    folder.mkdir()
    for suffix in {"csv", "json"} - {missing}:
        (folder / f"curves.{suffix}").write_text("{}")
    with pytest.raises(FileNotFoundError, match=f"curves.{missing} is missing") as error:
        saved("curves", tmp_path)
    assert str(error.value).count(".") <= 3  # two file names and the end of the sentence
    assert "\n" not in str(error.value)


RECORDS = sorted((repository_root() / "results").rglob("*.json"))


@pytest.mark.parametrize("file", RECORDS, ids=lambda f: "-".join(f.parts[-3:]))
def test_a_record_names_no_folder_of_the_machine_that_wrote_it(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    assert not re.search(r"""["' =](/\w[\w.-]*/|~/)""", text)


def test_every_commit_in_the_records_is_in_the_history() -> None:
    git = ["git", "-C", str(repository_root()), "rev-list", "HEAD"]
    try:
        history = subprocess.run(git, capture_output=True, text=True, check=True).stdout.split()
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("this is no checkout of git")
    if len(history) < 100:
        pytest.skip("this checkout has not the whole history")
    known = {commit[:12] for commit in history}
    named = {
        commit
        for file in RECORDS
        for commit in re.findall(r'"commit": "([0-9a-f]{12})\+?"', file.read_text("utf-8"))
    }
    assert named
    assert named <= known
