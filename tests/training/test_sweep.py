"""Sweeps: every run as if it were alone, whatever happens to the others."""

import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from thesis_lib import cli
from thesis_lib.edition.experiment import load
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.curves import (
    CURVES_COLUMNS,
    LAST,
    MARGIN,
    PAIRED_COLUMNS,
    SUMMARY_COLUMNS,
    compared,
    merged,
    progress,
    summary,
    write,
)
from thesis_lib.training.grid import GRID_COLUMNS, Grid, key, parse_variant, run_name
from thesis_lib.training.sweep import Outcome, sweep
from thesis_lib.training.train import train, use_one_thread

SMALL = TrainConfig(batch_steps=100, horizon=20, iterations=3, checkpoint_every=1)
TIMES = ["sampling_seconds", "update_seconds", "wall_seconds"]


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    use_one_thread()


def test_a_grid_is_every_combination() -> None:
    grid = Grid(tasks=("hopper", "ant"), architectures=("gru", "esn"), seeds=(3, 4))
    names = [run_name(c) for c in grid.runs(SMALL)]
    assert names[:3] == [f"hopper-flat-{n}-float32" for n in ("gru-3", "gru-4", "esn-3")]
    assert len(names) == len(set(names)) == 8
    assert all(c.batch_steps == 100 for c in grid.runs(SMALL))
    assert len(Grid().runs()) == 9 * 5


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tasks": ()}, "tasks is empty"),
        ({"seeds": (1, 1)}, "seeds names 1 twice"),
        ({"architectures": ("mlp",)}, "architecture 'mlp' does not exist: choose one of ffwd"),
    ],
)
def test_a_grid_that_cannot_be(options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Grid(**options).runs()


def test_runs_are_those_of_train_and_a_failure_leaves_the_others_alone(tmp_path: Path) -> None:
    configs = Grid(("hopper",), ("flat",), ("dtrnn", "gru", "ffwd")).runs(SMALL)
    # In the place of the second run there is another one already.
    other = dataclasses.replace(configs[1], batch_steps=40, iterations=1)
    train(other, tmp_path / run_name(configs[1]))
    # The third run was begun before.
    train(dataclasses.replace(configs[2], iterations=1), tmp_path / run_name(configs[2]))
    assert [progress(c, tmp_path) for c in configs] == [0, 0, 1]
    seen: list[tuple[Outcome, int]] = []
    outcomes = sweep(configs, tmp_path, workers=2, report=lambda o, n: seen.append((o, n)))
    assert [o.config for o in outcomes] == configs
    assert [n for _, n in seen] == [1, 2, 3]
    assert outcomes[0].error is None
    assert outcomes[2].error is None
    assert "was trained with batch_steps 40, not 100" in str(outcomes[1].error)

    curves = merged(configs, tmp_path)
    assert list(curves.columns) == list(CURVES_COLUMNS)
    assert curves.architecture.tolist() == ["dtrnn"] * 3 + ["ffwd"] * 3
    for config in (configs[0], configs[2]):
        alone = train(config).curve
        mine = curves[curves.architecture == config.architecture].reset_index(drop=True)
        shared = [c for c in CURVES_COLUMNS if c not in GRID_COLUMNS and c not in TIMES]
        pd.testing.assert_frame_equal(mine[shared], alone[shared], check_exact=True)

    # A second time there is nothing to do but the one that fails.
    before = (tmp_path / run_name(configs[0]) / "checkpoint.pt").stat().st_mtime_ns
    sweep(configs, tmp_path)
    assert (tmp_path / run_name(configs[0]) / "checkpoint.pt").stat().st_mtime_ns == before


def test_what_is_written(tmp_path: Path) -> None:
    configs = Grid(("hopper",), ("flat",), ("ffwd",), (0, 1)).runs(SMALL)
    train(configs[0], tmp_path / "runs" / run_name(configs[0]))
    errors = {run_name(configs[1]): "it rained."}
    write(configs, tmp_path / "runs", tmp_path / "out", command="thesis sweep", errors=errors)
    curves, record = load("curves", tmp_path / "out")
    assert list(curves.columns) == list(record["columns"]) == list(CURVES_COLUMNS)
    assert len(curves) == record["rows"] == 3
    assert (record["config"]["batch_steps"], record["grid"]["seed"]) == (100, [0, 1])
    assert [r["iteration"] for r in record["runs"]] == [3, 0]
    assert [r.get("error") for r in record["runs"]] == [None, "it rained."]
    assert record["runs"][0]["delta_kl"] == 0.05
    assert record["commit"]
    assert record["versions"]["torch"]
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        "curves.csv",
        "curves.json",
        "policies.pt",
    ]


def made_up(returns: dict[tuple[int, str, str], list[float]]) -> pd.DataFrame:
    """Curves of one net with the given mean returns, by seed, number type and variant."""
    parts = []
    for (seed, precision, variant), values in returns.items():
        n = len(values)
        part = pd.DataFrame(
            {"iteration": np.arange(1, n + 1), "steps": 10 * np.arange(1, n + 1)}
        ).assign(mean_return=values, accepted=[True] * (n - 1) + [False])
        keys = {"task": "Hopper", "terrain": "flat", "architecture": "gru"}
        part = part.assign(**keys, seed=seed, precision=precision, variant=variant)
        parts.append(part.assign(sampling_seconds=1.0, update_seconds=0.25, wall_seconds=2.0))
    return pd.concat(parts, ignore_index=True)


def test_summary_by_hand() -> None:
    curves = made_up({(0, "float32", "default"): [1.0, 2.0, 3.0, 4.0, 5.0, 9.0, 4.0]})
    (row,) = summary(curves).to_dict("records")
    assert list(row) == list(SUMMARY_COLUMNS)
    assert LAST == 5
    assert (row["iterations"], row["steps"], row["rejected"]) == (7, 70, 1)
    assert (row["first_return"], row["best_return"]) == (1.0, 9.0)
    assert row["last_return"] == pytest.approx((3 + 4 + 5 + 9 + 4) / 5)
    assert row["average_return"] == pytest.approx(28 / 7)
    assert row["steps_per_second"] == pytest.approx(70 / (7 * 1.25))
    assert row["wall_seconds"] == 14


def test_precisions_are_compared_seed_by_seed() -> None:
    a, b = [10.0, 12.0, 11.0, 13.0], [10.5, 11.5, 11.2, 13.4]
    pairs = {}
    for seed, (x, y) in enumerate(zip(a, b, strict=True)):
        pairs |= {(seed, "float32", "default"): [x - 1, x + 1]}
        pairs |= {(seed, "float64", "default"): [y - 2, y + 2]}
    pairs[(9, "float32", "default")] = [100.0, 100.0]  # it has no partner
    (row,) = compared(made_up(pairs), "precision").to_dict("records")
    assert list(row) == list(PAIRED_COLUMNS)
    test = stats.ttest_rel(a, b)
    interval = test.confidence_interval()
    assert (row["changed"], row["reference"], row["n"]) == ("float32", "float64", 4)
    assert (row["mean_changed"], row["mean_reference"]) == (np.mean(a), np.mean(b))
    assert row["difference"] == pytest.approx(np.mean(a) - np.mean(b))
    assert (row["low"], row["high"]) == pytest.approx((interval.low, interval.high))
    assert row["p_difference"] == row["p_holm"] == pytest.approx(test.pvalue)
    margin = MARGIN * np.mean(b)
    above = stats.ttest_rel(np.add(a, margin), b, alternative="greater").pvalue
    below = stats.ttest_rel(np.subtract(a, margin), b, alternative="less").pvalue
    assert row["p_equivalence"] == pytest.approx(max(above, below))


def test_equal_curves_differ_by_nothing() -> None:
    types = ("float32", "float64")
    same = {(s, p, "default"): [1.0, float(s)] for s in (0, 1) for p in types}
    (row,) = compared(made_up(same), "precision").to_dict("records")
    assert (row["difference"], row["p_difference"], row["p_equivalence"]) == (0, 1, 0)


def test_variants_are_compared_with_the_default() -> None:
    runs = {}
    for seed, noise in enumerate((0.0, 0.3, -0.2)):
        for variant, mean in (("default", 5.0), ("trace=0.9", 7.0), ("damping=0.1", 5.1)):
            own = noise * len(variant)  # differs between variants
            runs[(seed, "float32", variant)] = [mean + own, mean + own]
    table = compared(made_up(runs), "variant")
    assert table.changed.tolist() == ["trace=0.9", "damping=0.1"]
    assert set(table.reference) == {"default"}
    plain, adjusted = table.p_difference, table.p_holm
    assert adjusted.min() == pytest.approx(min(1, 2 * plain.min()))
    assert (adjusted >= plain).all()
    gaps = [7 - 5 + noise * (len("trace=0.9") - len("default")) for noise in (0.0, 0.3, -0.2)]
    assert table.difference[0] == pytest.approx(np.mean(gaps))


def test_variants_of_a_grid() -> None:
    grid = Grid(
        ("hopper",),
        architectures=("gru", "ctrnn"),
        variants=("integrator=euler,time_constant=0.2", "bootstrap=True"),
    )
    runs = grid.runs(SMALL)
    assert [(c.architecture, key(c)["variant"]) for c in runs] == [
        ("gru", "default"),
        ("gru", "bootstrap=True"),  # it has no integrator
        ("ctrnn", "default"),
        ("ctrnn", "integrator=euler, time_constant=0.2"),
        ("ctrnn", "bootstrap=True"),
    ]
    assert run_name(runs[3]) == "hopper-flat-ctrnn-0-float32-integrator-euler-time_constant-0.2"
    assert runs[3].integrator == "euler"
    # settings of all runs are told too, where they have an effect
    (gru, ctrnn) = Grid(("hopper",), architectures=("gru", "ctrnn")).runs(
        TrainConfig(time_constant=0.2, trace=0.5)
    )
    assert key(gru)["variant"] == "trace=0.5"
    assert key(ctrnn)["variant"] == "trace=0.5, time_constant=0.2"


@pytest.mark.parametrize("text", ["bootstrap", "wings=2", "iterations=3", "seed=1", ""])
def test_variants_that_cannot_be(text: str) -> None:
    with pytest.raises(ValueError, match="does not name a setting and its value"):
        parse_variant(text)


def test_long_runs_come_first_and_seeds_outermost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    grid = Grid(
        tasks=("HalfCheetah", "Ant"),
        terrains=("flat", "hill"),
        architectures=("esn",),
        seeds=(0, 1),
    )
    configs = grid.runs(TrainConfig(iterations=1, batch_steps=40, horizon=20, units=2))
    ended: list[tuple[int, str, str]] = []

    def report(outcome: Outcome, n: int) -> None:
        ended.append((outcome.config.seed, outcome.config.task, outcome.config.terrain))

    sweep(configs, tmp_path, report=report)
    order = [("Ant", "flat"), ("Ant", "hill"), ("HalfCheetah", "hill"), ("HalfCheetah", "flat")]
    assert ended == [(seed, *pair) for seed in (0, 1) for pair in order]


def test_workers() -> None:
    with pytest.raises(ValueError, match="workers is 0, but at least 1"):
        sweep([SMALL], ".", workers=0)
    with pytest.raises(ValueError, match="two runs of the sweep are called 'hopper-flat"):
        sweep([SMALL, SMALL], ".")


# ----------------------------------------------------------------------------- the command
ARGUMENTS = [
    *("--tasks", "hopper", "--architectures", "ffwd", "gru", "--iterations", "6"),
    *("--batch-steps", "100", "--horizon", "20", "--checkpoint-every", "2"),
]


def started(folder: Path, *arguments: str) -> subprocess.Popen:
    """A sweep in a process of its own, when its first run has begun."""
    command = [sys.executable, "-m", "thesis_lib.cli", "sweep", *arguments]
    process = subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    first = folder / "hopper-flat-ffwd-0-float32" / "checkpoint.pt"
    deadline = time.monotonic() + 120
    while not first.exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    assert first.exists()
    return process


def test_interruption_ends_the_runs_and_says_how_to_go_on(tmp_path: Path) -> None:
    arguments = [*ARGUMENTS, "--iterations", "100000"]
    places = ["--out", str(tmp_path / "out"), "--runs-in", str(tmp_path / "runs")]
    process = started(tmp_path / "runs", *arguments, *places)
    os.killpg(process.pid, signal.SIGINT)
    _, error = process.communicate(timeout=60)  # returns when the run's process has ended too
    assert process.returncode == 130
    assert f"interrupted; the runs are kept in {tmp_path / 'runs'}" in error
    assert "Traceback" not in error


def test_a_killed_sweep_goes_on_to_the_same_curves(tmp_path: Path) -> None:
    places = ["--out", str(tmp_path / "killed"), "--runs-in", str(tmp_path / "runs")]
    process = started(tmp_path / "runs", *ARGUMENTS, *places)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    assert cli.main(["sweep", *ARGUMENTS, *places]) == 0
    whole = ["--out", str(tmp_path / "whole"), "--runs-in", str(tmp_path / "others")]
    assert cli.main(["sweep", *ARGUMENTS, *whole, "--workers", "2"]) == 0
    one, two = (pd.read_csv(tmp_path / d / "curves.csv") for d in ("killed", "whole"))
    pd.testing.assert_frame_equal(one.drop(columns=TIMES), two.drop(columns=TIMES))
    record = json.loads((tmp_path / "whole" / "curves.json").read_text())
    # what decides the result, and no paths
    assert record["command"] == " ".join(["thesis sweep", *ARGUMENTS])
    assert record["config"]["checkpoint_every"] == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--architectures", "mlp"], "architecture 'mlp' does not exist"),
        (["--tasks", "humanoid"], "task 'humanoid' does not exist"),
        (["--task", "ant"], "'--task' is not known: see `thesis sweep --help`"),
        (["--seed", "1"], "'--seed' is not known"),
        (["--workers", "0"], "workers is 0"),
        (["--delta-kl", "-1"], "delta_kl is -1.0, but it must be positive"),
        (["--architectures", "gru", "dffwd", "--leak", "0.9"], "--leak has no effect here, only"),
    ],
)
def test_bad_input_is_one_sentence(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    places = ["--out", str(tmp_path / "out"), "--runs-in", str(tmp_path / "runs")]
    assert cli.main(["sweep", *arguments, *places]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_a_failed_run_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = dataclasses.replace(SMALL, architecture="ffwd", iterations=1)
    train(config, tmp_path / "runs" / run_name(config))
    places = ["--out", str(tmp_path / "out"), "--runs-in", str(tmp_path / "runs")]
    arguments = ["--tasks", "hopper", "--architectures", "ffwd", "--batch-steps", "60", *places]
    assert cli.main(["sweep", *arguments]) == 1
    printed = capsys.readouterr().out
    assert "hopper-flat-ffwd-0-float32: FAILED: the checkpoint in" in printed
    assert "0 of 1 runs" in printed
    assert "batch_steps 100, not 60" in (tmp_path / "out" / "curves.json").read_text()
