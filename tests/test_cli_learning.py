"""The commands `thesis train` and `thesis evaluate`."""

import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from PIL import Image

from thesis_lib import cli, cli_training
from thesis_lib.edition.experiment import load
from thesis_lib.locomotion.rendering import NoGL, choose_backend
from thesis_lib.policies.portable import loads
from thesis_lib.training.checkpoint import FILES, read_checkpoint
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.evaluation import EvaluateConfig, evaluate
from thesis_lib.training.run import TIMING_COLUMNS, Training
from thesis_lib.training.trained import Trained, read_trained

SMALL = ["--task", "half-cheetah", "--batch-steps", "100", "--horizon", "50"]


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("gru")
    arguments = ["--architecture", "gru", "--iterations", "2", "--out", str(folder)]
    assert cli.main(["train", *SMALL, *arguments]) == 0
    return folder


Started = Callable[..., subprocess.Popen]


def attentive() -> None:
    """Heed Ctrl-C, which a shell that starts tests in the background has them ignore."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.fixture
def started() -> Iterator[Started]:
    """Begin a training in a process of its own, and go on some iterations later."""
    running: list[subprocess.Popen] = []

    def start(
        folder: Path, *arguments: str, setting: Callable[[], None] = attentive
    ) -> subprocess.Popen:
        command = [sys.executable, "-m", "thesis_lib.cli", "train", *SMALL, *arguments]
        process = subprocess.Popen(
            [*command, "--out", str(folder)],
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            preexec_fn=setting,
        )
        running.append(process)
        record, deadline = folder / "run.json", time.monotonic() + 300
        while time.monotonic() < deadline and process.poll() is None:
            if record.exists() and json.loads(record.read_text())["iteration"] >= 4:
                return process
            time.sleep(0.01)
        raise AssertionError("the training did not come to its fourth iteration")

    yield start
    for process in running:
        process.kill()
        process.wait()


# ----------------------------------------------------------------------------------- training
def test_train_says_what_it_did(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["train", *SMALL, "--seed", "3", "--iterations", "2", "--out", str(tmp_path)]
    assert cli.main(arguments) == 0
    printed = capsys.readouterr()
    assert printed.err == ""  # progress is for terminals
    run = Training.load(tmp_path)
    assert "dtrnn on HalfCheetah (flat), seed 3: 2 iterations, 200 steps" in printed.out
    assert f"{run.curve.mean_return[0]:.1f} in the first iteration" in printed.out
    assert str(tmp_path / "curve.csv") in printed.out
    assert str(tmp_path / "checkpoint.pt") in printed.out
    # the same command again has nothing to do, and a larger number of iterations goes on
    assert cli.main(arguments) == 0
    pd.testing.assert_frame_equal(Training.load(tmp_path).curve, run.curve)
    arguments[arguments.index("--iterations") + 1] = "3"
    assert cli.main(arguments) == 0
    assert Training.load(tmp_path).iteration == 3
    arguments[arguments.index("--iterations") + 1] = "1"
    assert cli.main(arguments) == 2
    assert "has 3 iterations already, more than the 1 asked for" in capsys.readouterr().err
    assert cli.main([*arguments, "--no-resume"]) == 2
    assert "already holds a run" in capsys.readouterr().err


def test_a_run_killed_outright_goes_on_to_the_same_bits(tmp_path: Path, started: Started) -> None:
    common = ["--architecture", "ctrnn", "--iterations", "400", "--checkpoint-every", "3"]
    process = started(tmp_path / "killed", *common)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    # what a run leaves that is killed while it writes
    (tmp_path / "killed" / ".checkpoint.pt.x1y2").write_bytes(b"half a")
    kept = read_checkpoint(tmp_path / "killed")["iteration"]
    assert 4 <= kept < 400
    iterations = str(kept + 5)
    for folder in ("killed", "whole"):
        out = ["--out", str(tmp_path / folder), "--iterations", iterations]
        assert cli.main(["train", *SMALL, *common, *out]) == 0
    one, two = (read_checkpoint(tmp_path / d) for d in ("killed", "whole"))
    assert one["iteration"] == two["iteration"] == kept + 5
    for name, value in two["policy"].items():
        assert torch.equal(one["policy"][name], value)
    assert torch.equal(one["baseline"]["weights"], two["baseline"]["weights"])
    curves = [
        pd.read_csv(tmp_path / d / "curve.csv").drop(columns=list(TIMING_COLUMNS))
        for d in ("killed", "whole")
    ]
    pd.testing.assert_frame_equal(*curves, check_exact=True)
    assert {p.name for p in (tmp_path / "killed").iterdir()} == set(FILES)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interruption_saves_and_says_where(
    tmp_path: Path, started: Started, number: signal.Signals
) -> None:
    # As a shell has it in the background: whoever starts a process has to heed Ctrl-C itself.
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        process = started(tmp_path, "--iterations", "100000", "--checkpoint-every", "4")
    finally:
        signal.signal(signal.SIGINT, before)
    process.send_signal(number)
    _, error = process.communicate(timeout=300)
    assert process.returncode == 128 + number
    kept = read_checkpoint(tmp_path)["iteration"]
    assert f"the last checkpoint, of iteration {kept}, is in {tmp_path}" in error
    assert "give the same command again" in error
    assert "Traceback" not in error


def test_interruption_before_the_first_checkpoint(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(run: Training, config: TrainConfig) -> None:
        raise KeyboardInterrupt(signal.SIGTERM)

    monkeypatch.setattr(Training, "__init__", stopped)
    arguments = ["train", *SMALL, "--iterations", "1", "--out", str(tmp_path)]
    assert cli.main(arguments) == 128 + signal.SIGTERM
    assert capsys.readouterr().err == "thesis: interrupted; no file was left half written.\n"
    assert list(tmp_path.iterdir()) == []


def test_a_run_under_nohup_ends_in_good_order(tmp_path: Path, started: Started) -> None:
    """Ctrl-C and the end of the terminal are ignored there; SIGTERM is not."""

    def nohup() -> None:
        for number in (signal.SIGINT, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)

    process = started(tmp_path, "--iterations", "100000", setting=nohup)
    process.send_signal(signal.SIGHUP)
    process.send_signal(signal.SIGTERM)
    _, error = process.communicate(timeout=300)
    assert process.returncode == 128 + signal.SIGTERM
    assert f"iteration {read_checkpoint(tmp_path)['iteration']}, is in {tmp_path}" in error


def test_two_processes_do_not_train_into_one_directory(
    tmp_path: Path, started: Started, capsys: pytest.CaptureFixture[str]
) -> None:
    process = started(tmp_path, "--iterations", "100000", "--checkpoint-every", "4")
    try:
        same = ["--iterations", "100000", "--checkpoint-every", "4", "--out", str(tmp_path)]
        assert cli.main(["train", *SMALL, *same]) == 2
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
    assert "another process is training in" in capsys.readouterr().err


def test_a_number_that_is_not_finite_stops_the_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    step = Training.step

    def spoilt(run: Training) -> dict:
        if run.iteration == 2:
            with torch.no_grad():
                run.policy.log_std[0] = float("inf")
        return step(run)

    monkeypatch.setattr(Training, "step", spoilt)
    arguments = ["--iterations", "5", "--checkpoint-every", "1", "--out", str(tmp_path)]
    assert cli.main(["train", *SMALL, *arguments]) == 1
    error = capsys.readouterr().err
    assert "training stopped in iteration 3: " in error
    assert "not finite" in error
    assert "The last good checkpoint, of iteration 2, is in" in error
    Training.load(tmp_path).policy.check_finite()


def test_a_full_disk_is_one_line(tmp_path: Path) -> None:
    arguments = ["train", *SMALL, "--iterations", "2", "--out", str(tmp_path)]
    assert cli.main(arguments) == 0
    arguments[arguments.index("2")] = "4"

    def no_room() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (2048, 2048))

    done = subprocess.run(
        [sys.executable, "-m", "thesis_lib.cli", *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=no_room,
    )
    assert done.returncode == 1
    assert "which could not be saved (File too large): make room" in done.stderr
    assert f"of iteration 2, is in {str(tmp_path)!r}." in done.stderr
    assert done.stderr.count("\n") == 1
    assert cli.main(arguments) == 0
    assert Training.load(tmp_path).iteration == 4


def test_a_test_that_comes_to_no_number_is_one_sentence(
    checkpoint: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def spoilt(path: Path) -> Trained:
        run = read_trained(path)
        with torch.no_grad():
            run.policy.head.bias[0] = float("nan")
        return run

    monkeypatch.setattr(cli_training, "read_trained", spoilt)
    assert cli.main(["evaluate", str(checkpoint), "--runs", "1", "--steps", "5"]) == 1
    error = capsys.readouterr().err
    assert error.startswith("thesis: the action in world 0 at step 0")
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--architecture", "mlp"], "architecture 'mlp' does not exist: choose one of ffwd"),
        (["--task", "humanoid"], "task 'humanoid' does not exist: choose one of Swimmer"),
        (["--delta-kl", "0"], "delta_kl is 0.0, but it must be positive"),
        (["--seed", "-1"], "seed is -1"),
        (["--architecture", "ctrnn", "--time-constant", "0.001"], "time_constant is 0.001 s"),
        (["--architecture", "ctrnn", "--integrator", "rk4"], "integrator 'rk4' does not exist"),
        (["--kl-direction", "both"], "choose one of old_new, new_old"),
        (["--damping", "-1"], "damping is -1.0"),
        (["--discount", "2"], "discount is 2.0"),
        (["--gae-lambda", "-1"], "gae_lambda is -1.0"),
        (["--reading", "novel"], "reading"),
        (["--leak", "0.9"], "--leak has no effect here, only with architecture esn"),
        (["--maps", "3"], "--maps has no effect here, only with terrain hill"),
        (["--architecture", "dffwd", "--units", "5"], "--units has no effect here, only with"),
        (["--initial-log-std", "nan"], "initial_log_std is nan, but it must be a finite number"),
        (["--initial-log-std", "400"], "but it must be between -10 and 10"),
        (["--architecture", "ctrnn", "--time-constant", "inf"], "time_constant is inf, but it"),
        (["--velocity", "3"], "'--velocity' is not known: see `thesis train --help`"),
    ],
)
def test_bad_input_to_train_is_one_sentence(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["--out", str(tmp_path), "--iterations", "1", "--batch-steps", "50"]
    assert cli.main(["train", *out, *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_another_net_in_the_directory(checkpoint: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = ["--architecture", "lstm", "--iterations", "2", "--out", str(checkpoint)]
    assert cli.main(["train", *SMALL, *other]) == 2
    assert "was trained with architecture 'gru', not 'lstm'" in capsys.readouterr().err


# ------------------------------------------------------------------------------------ testing
def test_evaluate_prints_and_writes_the_test(
    checkpoint: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--runs", "3", "--steps", "40", "--noise", "0.5", "--onset", "10"]
    command = ["evaluate", str(checkpoint), *arguments, "--out", str(tmp_path)]
    assert cli.main(command) == 0
    printed = capsys.readouterr().out
    config = EvaluateConfig(runs=3, steps=40, perturbations=("WhiteNoise(sigma=0.5, onset=10)",))
    expected = evaluate(checkpoint, config)
    table, record = load("evaluation", tmp_path)
    pd.testing.assert_frame_equal(table, expected)
    assert list(record["columns"]) == list(table.columns)
    assert record["summary"]["mean_return"] == pytest.approx(expected["return"].mean())
    assert record["trained"]["architecture"] == "gru"
    assert record["iteration"] == 2
    assert record["config"]["perturbations"] == list(config.perturbations)
    assert record["command"].startswith("thesis evaluate ")
    assert "WhiteNoise(sigma=0.5, onset=10)" in printed
    assert "gru on HalfCheetah, trained on flat ground for 2 iterations" in printed
    assert "mean_return" in printed
    assert f"{expected['return'].mean():.5g}" in printed


def test_all_flags_together(checkpoint: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flags = [
        *("--dead-sensors", "pitch", "--dead-actuators", "bfoot", "bshin", "--delay", "1"),
        *("--mass", "1.2", "--friction", "0.8", "--push", "0.5", "0", "0", "--switch-at", "2"),
        *("--difficulty", "0.2", "--no-greedy", "--termination", "never"),
        *("--perturbations", "WhiteNoise(sigma=0.1, onset=3)"),
    ]
    command = ["evaluate", str(checkpoint), "--runs", "2", "--steps", "20", *flags]
    assert cli.main(command) == 0
    printed = capsys.readouterr().out
    for name in ("SensorFailure", "ActuatorFailure", "ActionDelay", "MassChange", "Push"):
        assert f"{name}(" in printed
    assert "TerrainSwitch(difficulty=0.2, switch_at=2.0" in printed


def test_a_film_on_demand(checkpoint: Path, tmp_path: Path) -> None:
    try:
        choose_backend()
    except NoGL:
        return  # what is said then is tested below
    film = tmp_path / "run.gif"
    command = ["evaluate", str(checkpoint), "--runs", "1", "--steps", "12", "--film", str(film)]
    assert cli.main(command) == 0
    with Image.open(film) as picture:
        assert picture.n_frames == 3  # every fourth of 12 steps of 0.01 s
        assert np.asarray(picture.convert("L")).std() > 0


def test_a_film_without_gl_is_one_sentence_before_the_test(
    checkpoint: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "disable")
    film = ["--film", str(tmp_path / "run.gif")]
    assert cli.main(["evaluate", str(checkpoint), "--runs", "2", "--steps", "5", *film]) == 1
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("thesis: No picture can be drawn because")
    assert printed.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--task", "ant"], "was trained with task 'HalfCheetah', not 'Ant'"),
        (["--task", "robot"], "task 'robot' does not exist"),
        (["--architecture", "esn"], "was trained with architecture 'gru', not 'esn'"),
        (["--runs", "0"], "runs is 0"),
        (["--noise", "-2"], "sigma is -2.0"),
        (["--dead-sensors", "nose"], "there is no sensor 'nose'"),
        (["--dead-actuators", "tail"], "there is no actuator 'tail'"),
        (["--perturbations", "Earthquake"], "perturbation 'Earthquake' does not exist"),
        (["--terrain", "sea"], "terrain 'sea' does not exist"),
        (["--terrain", "hill", "--difficulty", "-1"], "difficulty is -1"),
        (["--terrain", "hill", "--switch-at", "3"], "a switch starts on flat ground"),
        (["--difficulty", "0.3"], "--difficulty has no effect here, only with terrain hill or"),
        (["--onset", "3"], "--onset has no effect here, only with dead-actuators or dead-sensors"),
        (["--film-run", "3"], "--film-run has no effect here, only with film"),
        (["--film", "run.mov"], "cannot be written as '.mov'"),
        (["--film", "run.gif", "--film-run", "20"], "the runs are 0 to 19"),
    ],
)
def test_bad_input_to_evaluate_is_one_sentence(
    arguments: list[str], message: str, checkpoint: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["evaluate", str(checkpoint), *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("config", [{"wings": 2}, {"task": 3}, {"iterations": "many"}])
def test_a_checkpoint_with_a_setting_that_there_is_not(
    config: dict, checkpoint: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = torch.load(checkpoint / "checkpoint.pt", weights_only=True)
    torch.save(content | {"config": content["config"] | config}, tmp_path / "checkpoint.pt")
    assert cli.main(["evaluate", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert "has a setting this version does not have" in error
    assert error.count("\n") == 1


def test_export_writes_the_policy_with_its_card(checkpoint: Path, tmp_path: Path) -> None:
    out = tmp_path / "gru.npz"
    assert cli.main(["export", str(checkpoint), str(out)]) == 0
    policy = loads(out.read_bytes())
    assert policy.architecture == "gru"
    trained = read_trained(checkpoint).policy
    np.testing.assert_array_equal(policy.parameter_vector(), trained.parameter_vector())


def test_export_names_the_forms_there_are(
    checkpoint: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["export", str(checkpoint), str(tmp_path / "gru.h5")]) == 2
    assert "'gru.h5': choose .npz or .onnx." in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
