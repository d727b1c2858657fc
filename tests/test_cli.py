"""The command `thesis`."""

import json
import subprocess
import sys

import pandas as pd
import pytest

from thesis_lib import cli
from thesis_lib.edition.chapters import experiments


def test_list_names_every_experiment(capsys):
    assert cli.main(["list"]) == 0
    out = capsys.readouterr().out
    for identifier in experiments():
        assert identifier in out


def test_run_writes_table_and_provenance_and_prints(tmp_path, capsys):
    assert (
        cli.main(["run", "figure-3.3", "--budget", "smoke", "--seed", "3", "--out", str(tmp_path)])
        == 0
    )
    printed = capsys.readouterr().out
    table = pd.read_csv(tmp_path / "figure-3.3.csv")
    record = json.loads((tmp_path / "figure-3.3.json").read_text())
    assert record["seed"] == 3
    assert record["budget"] == "smoke"
    assert record["rows"] == len(table)
    assert "Q_star" in printed


def test_run_takes_fields_of_the_config(tmp_path):
    assert (
        cli.main(
            ["run", "figure-3.3", "--budget", "smoke", "--out", str(tmp_path), "--repeats", "3"]
        )
        == 0
    )
    record = json.loads((tmp_path / "figure-3.3.json").read_text())
    assert record["config"]["repeats"] == 3
    assert record["budget"] == "custom"


def test_workers_do_not_change_the_table(tmp_path):
    for workers in ("1", "2"):
        cli.main(
            [
                "run",
                "table-3.1",
                "--budget",
                "smoke",
                "--workers",
                workers,
                "--out",
                str(tmp_path / workers),
            ]
        )
    one, two = (pd.read_csv(tmp_path / w / "table-3.1.csv") for w in ("1", "2"))
    pd.testing.assert_frame_equal(one, two)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "tabel-3.1"], "did you mean table-3.1"),
        (["run", "table-3.1", "--budget", "quick"], "choose one of smoke, book, thesis"),
        (["run", "table-3.1", "--budget", "smoke", "--seed", "-1"], "at least 0"),
        (["run", "table-3.1", "--budget", "smoke", "--workers", "0"], "at least 1 worker"),
        (["book", "--budget", "quick"], "choose one of smoke, book, thesis"),
    ],
)
def test_bad_input_is_one_sentence_and_status_2(arguments, message, capsys, tmp_path):
    extra = ["--out", str(tmp_path)] if arguments[0] == "run" else []
    assert cli.main([*arguments, *extra]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_out_that_is_a_file(tmp_path, capsys):
    target = tmp_path / "file"
    target.write_text("")
    assert cli.main(["run", "figure-3.3", "--budget", "smoke", "--out", str(target)]) == 2
    assert "cannot be written to" in capsys.readouterr().err


def test_interruption_leaves_no_file(tmp_path, capsys, monkeypatch):
    def stopped(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("thesis_lib.edition.experiment.Experiment.run", stopped)
    assert cli.main(["run", "figure-3.3", "--budget", "smoke", "--out", str(tmp_path)]) == 130
    assert "interrupted" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_claims_without_their_tables_name_the_command(tmp_path, capsys):
    assert cli.main(["claims", "3.4.3-caption", "--results", str(tmp_path)]) == 2
    assert "make it with `thesis run figure-3.3" in capsys.readouterr().err


def test_claims_prints_the_ledger(tmp_path, capsys):
    cli.main(["run", "figure-3.3", "--budget", "smoke", "--out", str(tmp_path)])
    assert cli.main(["claims", "3.4.3-caption", "--results", str(tmp_path)]) == 0
    assert "3.4.3-caption  [Figure 3.3]  INCONCLUSIVE AT THIS BUDGET" in capsys.readouterr().out


def test_installed_command_helps():
    done = subprocess.run(
        [sys.executable, "-m", "thesis_lib.cli", "--help"], capture_output=True, text=True
    )
    assert done.returncode == 0
    assert {"list", "run", "claims", "book"} <= set(done.stdout.replace("•", " ").split())
