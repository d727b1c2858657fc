"""Committed results are read whole or not at all."""

import json
from pathlib import Path

import pytest

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
