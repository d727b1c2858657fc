"""The command `thesis`."""

import ast
import ctypes
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time

import pandas as pd
import pytest

from tests.surroundings import ROOT, python, read_only
from thesis_lib import cli
from thesis_lib.checkout import repository_root
from thesis_lib.edition import roots
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
    made = experiments()["figure-3.3"]
    assert record["code"] == roots.code_of_table(made, made.config("smoke"))
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
        (["run", "table-3.1", "--budget", "smoke", "--seed", str(2**64)], "and below 2**64"),
        (["run", "figure-3.3", "--budget", "smoke", "--repeats", "-1"], "repeats is -1"),
        (
            ["run", "table-3.1", "--budget", "smoke", "--workers", "0"],
            "workers is 0, but it must be an integer",
        ),
        (["run", "figure-3.3", "--seed", "x"], "--seed is 'x', but takes INT: see `thesis run"),
        (["run", "figure-3.3", "--repeats", "1e3"], "figure-3.3 --help`"),
        (["run", "figure-3.3", "--alphas", ".1", "x"], "--alphas is ['.1', 'x'], but takes [FLOAT"),
        (["run", "figure-3.3", "--alphas"], "alphas is empty"),
        (["run", "figure-3.3", "--colour", "red"], "'--colour' is not known"),
        (["run"], "`thesis run` needs id: see `thesis run --help`"),
        (["book", "--budget", "quick"], "choose one of smoke, book, thesis"),
        (["book", "--seed"], "--seed has no value, but takes INT"),
        (["fly"], "there is no command 'fly': choose one of list, run, train"),
        ([], "a command is missing: choose one of list"),
    ],
)
def test_bad_input_is_one_sentence_and_status_2(arguments, message, capsys, tmp_path):
    extra = ["--out", str(tmp_path)] if arguments[:1] == ["run"] and arguments[1:] else []
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


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_in_a_callback_of_a_compiled_library_is_not_lost(
    number, tmp_path, capsys, monkeypatch
):
    @ctypes.CFUNCTYPE(None)
    def callback():
        os.kill(os.getpid(), number)
        time.sleep(0.01)  # here the signal arrives, and Python drops what it raises

    def stopped(*arguments, **options):
        callback()
        time.sleep(10)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    monkeypatch.setattr("thesis_lib.edition.experiment.Experiment.run", stopped)
    try:
        arguments = ["run", "figure-3.3", "--budget", "smoke", "--out", str(tmp_path)]
        assert cli.main(arguments) == 128 + number
    finally:
        signal.signal(signal.SIGINT, before)
    assert capsys.readouterr().err == "thesis: interrupted; no file was left half written.\n"


def test_claims_without_their_tables_name_the_command(tmp_path, capsys):
    assert cli.main(["claims", "3.4.3-caption", "--results", str(tmp_path)]) == 2
    assert "make it with `thesis run figure-3.3" in capsys.readouterr().err


def test_claims_without_a_book_tell_the_committed_verdicts(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("THESIS_RESULTS", str(tmp_path))
    rows = pd.read_csv(ROOT / "results" / "claims" / "verdicts.csv")
    verdict = rows[rows.claim == "3.4.3-caption"].verdict.mode()[0].upper()
    assert cli.main(["claims", "3.4.3-caption"]) == 0
    told = capsys.readouterr().out
    assert re.search(rf"3.4.3-caption  \[Figure 3.3\]  {verdict} \(.*, as committed\)", told)
    assert f"make it with `thesis run figure-3.3 --out {tmp_path}`" in told
    assert "1 claims, 1 of them without results in" in told


def test_claims_prints_the_ledger(tmp_path, capsys):
    cli.main(["run", "figure-3.3", "--budget", "smoke", "--out", str(tmp_path)])
    assert cli.main(["claims", "3.4.3-caption", "--results", str(tmp_path)]) == 0
    assert "3.4.3-caption  [Figure 3.3]  INCONCLUSIVE AT THIS BUDGET" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("--budget nonsense", "budget 'nonsense' does not exist: choose one of"),
        ("--budget smoke", "--budget is smoke, but it concerns evidence over seeds alone: give"),
        ("--workers -3", "--workers is -3, but it concerns evidence over seeds alone: give"),
        ("--out X", "--out is X, but it concerns evidence over seeds alone: give --seeds 10 or"),
    ],
)
def test_claims_on_saved_results_take_no_settings_of_seeds(given, told, capsys):
    assert cli.main(["claims", "3.4.3-caption", *given.split()]) == 2
    assert told in capsys.readouterr().err


def test_claims_over_seeds(tmp_path, capsys):
    asked = ["claims", "3.4.3-caption", "--seeds", "2", "--budget", "smoke"]
    asked += ["--results", str(tmp_path / "tables"), "--out", str(tmp_path)]
    assert cli.main(asked) == 0
    told = capsys.readouterr().out
    assert "figure-3.3, root 2: " in told
    assert "3.4.3-caption  [Figure 3.3]  INCONCLUSIVE AT THIS BUDGET (2 of 2)" in told
    assert len(pd.read_csv(tmp_path / "verdicts.csv")) == 2


def test_installed_command_helps():
    done = subprocess.run(
        [sys.executable, "-m", "thesis_lib.cli", "--help"], capture_output=True, text=True
    )
    assert done.returncode == 0
    assert {"list", "run", "claims", "book"} <= set(done.stdout.replace("•", " ").split())


def test_an_option_s_value_is_not_taken_for_the_experiment(capsys):
    for arguments, told in (
        (["figure-3.3", "--budget", "smoke"], "usage: thesis run figure-3.3 "),
        (["--budget", "smoke", "figure-3.3"], "usage: thesis run [-h] "),
    ):
        with pytest.raises(SystemExit) as end:
            cli.main(["run", *arguments, "--help"])
        assert end.value.code == 0
        assert told in capsys.readouterr().out


# ------------------------------------------------------------------------------ surroundings
SLOW = {"pandas", "scipy", "numba", "torch", "mujoco", "matplotlib"}


def test_help_and_a_second_list_import_nothing_slow(tmp_path):
    """They answer in less than 0.8 seconds of work, of which imports are nearly all."""
    kept = {"XDG_CACHE_HOME": str(tmp_path)}
    assert python("-m", "thesis_lib.cli", "list", env=kept).returncode == 0
    for arguments in (["--help"], ["run", "--help"], ["book", "--help"], ["list"]):
        code = (
            "import sys\nfrom thesis_lib import cli\n"
            f"try: status = cli.main({arguments})\nexcept SystemExit as end: status = end.code\n"
            f"assert not status and not {SLOW} & set(sys.modules), {SLOW} & set(sys.modules)"
        )
        done = python("-c", code, env=kept)
        assert done.returncode == 0, done.stderr
        assert done.stdout


def test_the_list_is_of_the_code_as_it_is(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(cli, "cache_folders", lambda: iter([tmp_path]))
    monkeypatch.setattr(cli, "__file__", str(tmp_path / "package" / "cli.py"))
    (tmp_path / "package").mkdir()
    for change in ("one", "two"):
        (tmp_path / "package" / "cli.py").write_text(change)
        monkeypatch.setattr(cli, "_listing", lambda change=change: f"list of {change}")
        for _ in range(2):
            assert cli.main(["list"]) == 0
            assert capsys.readouterr().out == f"list of {change}\n"
            monkeypatch.setattr(cli, "_listing", lambda: 1 / 0)
    assert len(list(tmp_path.glob("list-*.txt"))) == 1


def test_a_terminal_that_cannot_show_every_letter():
    code = (
        "from thesis_lib import cli\ncli.cache_folders = lambda: iter(())\n"
        "cli._listing = lambda: 'k-relevance \\u03c1, caf\\u00e9, end'\n"
        "raise SystemExit(cli.main(['list']))"
    )
    for encoding, shown in {"ascii": "?, caf?", "latin-1": "?, caf\u00e9"}.items():
        surroundings = {"PYTHONIOENCODING": encoding, "PYTHONUTF8": "0"}
        done = python("-c", code, env=surroundings, encoding=encoding)
        assert done.returncode == 0, done.stderr
        assert done.stdout == f"k-relevance {shown}, end\n"


def test_a_backend_of_matplotlibs_that_there_is_not(tmp_path):
    arguments = ["run", "figure-a.1", "--budget", "smoke", "--out", str(tmp_path)]
    done = python("-m", "thesis_lib.cli", *arguments, env={"MPLBACKEND": "nonsense"})
    assert done.returncode == 0, done.stderr


def test_every_file_is_read_and_written_as_utf_8():
    """A locale of another encoding would read formulas as something else."""
    for file in (ROOT / "thesis_lib").rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            name = getattr(node.func, "attr", "") if isinstance(node, ast.Call) else ""
            if name in ("read_text", "write_text"):
                given = {keyword.arg for keyword in node.keywords}
                assert "encoding" in given, f"{file}: line {node.lineno}"


@pytest.mark.parametrize("command", ["book", "list", "run"])
def test_a_checkout_that_cannot_be_written_to(command, tmp_path):
    copy = tmp_path / "copy"
    ignored = shutil.ignore_patterns("__pycache__")
    for name in ("thesis_lib", "notebooks", "book"):
        shutil.copytree(ROOT / name, copy / name, ignore=ignored)
    for name in ("pyproject.toml", "constraints.txt", "_config.yml", "_toc.yml"):
        shutil.copy(ROOT / name, copy)
    arguments = {
        "book": ["book", "--budget", "smoke"],
        "list": ["list"],
        "run": ["run", "ch5-tasks", "--budget", "smoke"],
    }[command]
    (tmp_path / "tmp").mkdir()
    nowhere = dict.fromkeys(("HOME", "XDG_CACHE_HOME", "MPLCONFIGDIR"), str(copy))
    with read_only(copy) as bound:
        env = {**nowhere, "TMPDIR": str(tmp_path / "tmp"), "PYTHONDONTWRITEBYTECODE": "1"}
        done = python("-m", "thesis_lib.cli", *arguments, root=copy, env=env, **bound)
    if command == "list":
        assert done.returncode == 0, done.stderr
        assert "table-3.1" in done.stdout
    else:
        assert done.returncode in (1, 2)
        said = done.stderr.splitlines()[-1]  # after matplotlib's own on its settings
        assert said.startswith("thesis: ")
        assert str(copy) in said
        assert ("--out" in said) == (command == "run")
        assert "Traceback" not in done.stderr


def test_a_recorded_command_names_no_folder_of_this_machine() -> None:
    within = str(repository_root() / "results" / "study")
    asked = ["merge", within, "/home/someone/runs/extra", "--maps=/tmp/maps", "a=0.1", "b/c"]
    assert cli.recorded(asked) == "thesis merge results/study extra --maps=maps a=0.1 b/c"
