"""Sweeps: every run as if it were alone, whatever happens to the others."""

import contextlib
import dataclasses
import errno
import fcntl
import json
import math
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
from distributed import Client
from distributed.client import ClosedClientError
from distributed.comm import CommClosedError
from scipy import stats

from thesis_lib import cli
from thesis_lib.edition.experiment import load
from thesis_lib.training import cluster
from thesis_lib.training.checkpoint import code_digest
from thesis_lib.training.cluster import KEEP_MEMORY, SchedulerLost, connected
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
from thesis_lib.training.plan import STEP_COST, cost, makespan, memory, not_measured, plan
from thesis_lib.training.store import Store
from thesis_lib.training.sweep import Outcome, _Line, in_order, sweep
from thesis_lib.training.train import train
from thesis_lib.training.trained import TrainedPolicies

SMALL = TrainConfig(batch_steps=100, horizon=20, iterations=3, checkpoint_every=1)
TIMES = ["sampling_seconds", "update_seconds", "wall_seconds"]


def test_a_terminal_shows_how_far_all_runs_are_by_what_they_cost(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    long = dataclasses.replace(SMALL, seed=1, iterations=9)  # 9 of the 12 iterations
    for terminal, shown in ((False, []), (True, ["0%", "8%", "25%", "25%", "100%"])):
        monkeypatch.setattr("sys.stderr.isatty", lambda terminal=terminal: terminal)
        line = _Line([SMALL, long], {run_name(SMALL): 0, run_name(long): 0})
        line.iteration(run_name(SMALL), 1)
        line.ended(Outcome(SMALL))
        line.iteration(run_name(long), 0)
        line.ended(Outcome(long, "broke"))
        text = capsys.readouterr().err
        assert re.findall(r"\d+%", text) == shown
    told = re.findall(r"(\d) of 2 runs done, (\d) running(, 1 failed)?", text)
    assert ["".join(of) for of in told] == ["01", "10", "11", "10, 1 failed"]


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    """Two workers in this process."""
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": "127.0.0.1:0"}
    with Client(processes=False, **options) as found:
        yield found


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


def test_runs_are_those_of_train_and_a_failure_leaves_the_others_alone(
    tmp_path: Path, client: Client
) -> None:
    configs = Grid(("hopper",), ("flat",), ("dtrnn", "gru", "ffwd")).runs(SMALL)
    # In the place of the second run there is another one already.
    other = dataclasses.replace(configs[1], batch_steps=40, iterations=1)
    train(other, tmp_path / run_name(configs[1]))
    # The third run was begun before.
    train(dataclasses.replace(configs[2], iterations=1), tmp_path / run_name(configs[2]))
    assert [progress(c, tmp_path) for c in configs] == [0, 0, 1]
    seen: list[tuple[Outcome, int]] = []
    outcomes = sweep(configs, tmp_path, scheduler=client, report=lambda o, n: seen.append((o, n)))
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
    sweep(configs, tmp_path, scheduler=client)
    assert (tmp_path / run_name(configs[0]) / "checkpoint.pt").stat().st_mtime_ns == before


def test_what_is_written(tmp_path: Path) -> None:
    configs = Grid(("hopper",), ("flat",), ("ffwd",), (0, 1)).runs(SMALL)
    train(configs[0], tmp_path / "runs" / run_name(configs[0]))
    errors = {run_name(configs[1]): "it rained."}
    write(configs, tmp_path / "runs", tmp_path / "out", command="thesis sweep", errors=errors)
    curves, record = load("curves", tmp_path / "out")
    numbers = [name for name in CURVES_COLUMNS if name not in TIMES]
    assert list(curves.columns) == list(record["columns"]) == numbers
    seconds = pd.read_csv(tmp_path / "out" / "curves.seconds.csv")
    assert list(seconds.columns) == list(record["seconds_columns"]) == TIMES
    assert len(seconds) == 3
    assert len(curves) == record["rows"] == 3
    assert (record["config"]["batch_steps"], record["grid"]["seed"]) == (100, [0, 1])
    assert [r["iteration"] for r in record["runs"]] == [3, 0]
    assert [r.get("error") for r in record["runs"]] == [None, "it rained."]
    assert record["runs"][0]["delta_kl"] == 0.05
    assert [r.get("made_by") for r in record["runs"]] == [0, None]
    (maker,) = record["made_by"]
    assert maker["versions"]["torch"]
    assert (maker["code"], maker["commit"]) == (code_digest(), record["written_by"]["commit"])
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        "curves.csv",
        "curves.json",
        "curves.seconds.csv",
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


def test_no_policy_of_another_run_is_kept(tmp_path: Path) -> None:
    (config,) = Grid(("hopper",), ("flat",), ("ffwd",)).runs(SMALL)
    other = dataclasses.replace(config, batch_steps=40, iterations=1)
    train(other, tmp_path / "runs" / run_name(config))
    for asked, names in ((config, ()), (other, (run_name(other),))):
        curves = write([asked], tmp_path / "runs", tmp_path / "out", command="")
        assert len(curves) == len(names)
        assert TrainedPolicies(tmp_path / "out" / "policies.pt").names == names
    (tmp_path / "runs" / run_name(other) / "checkpoint.pt").unlink()
    write([other], tmp_path / "runs", tmp_path / "out", command="")
    assert TrainedPolicies(tmp_path / "out" / "policies.pt").names == ()
    _, record = load("curves", tmp_path / "out")
    assert "there is no checkpoint" in record["runs"][0]["error"]


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
        for variant, mean in (("default", 5.0), ("gae_lambda=0.9", 7.0), ("damping=0.1", 5.1)):
            own = noise * len(variant)  # differs between variants
            runs[(seed, "float32", variant)] = [mean + own, mean + own]
    table = compared(made_up(runs), "variant")
    assert table.changed.tolist() == ["gae_lambda=0.9", "damping=0.1"]
    assert set(table.reference) == {"default"}
    plain, adjusted = table.p_difference, table.p_holm
    assert adjusted.min() == pytest.approx(min(1, 2 * plain.min()))
    assert (adjusted >= plain).all()
    gaps = [7 - 5 + noise * (len("gae_lambda=0.9") - len("default")) for noise in (0.0, 0.3, -0.2)]
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
        TrainConfig(time_constant=0.2, gae_lambda=0.5)
    )
    assert key(gru)["variant"] == "gae_lambda=0.5"
    assert key(ctrnn)["variant"] == "gae_lambda=0.5, time_constant=0.2"


def test_a_variant_that_is_the_default_is_no_other_run() -> None:
    """Table 5.1 prints .35 for the DTRNN on the hopper; the FFWD's output starts at a tenth."""
    variants = ("delta_kl=0.35", "head_scale=0.1")
    grid = Grid(("Hopper",), ("flat",), ("dtrnn", "ffwd"), variants=variants)
    assert [(c.architecture, key(c)["variant"]) for c in grid.runs()] == [
        ("dtrnn", "default"),
        ("dtrnn", "head_scale=0.1"),
        ("ffwd", "default"),
        ("ffwd", "delta_kl=0.35"),
    ]


@pytest.mark.parametrize("text", ["bootstrap", "wings=2", "iterations=3", "seed=1", ""])
def test_variants_that_cannot_be(text: str) -> None:
    with pytest.raises(ValueError, match="does not name a setting and its value"):
        parse_variant(text)


def test_provenance_is_by_run(tmp_path: Path) -> None:
    configs = Grid(("hopper",), ("flat",), ("ffwd",), (0, 1, 2)).runs(SMALL)
    for config in configs:
        train(config, tmp_path / run_name(config))
    record = tmp_path / run_name(configs[1]) / "run.json"
    record.write_text(json.dumps(json.loads(record.read_text()) | {"commit": "0123456789ab"}))
    write(configs, tmp_path, tmp_path / "out", command="thesis sweep")
    _, found = load("curves", tmp_path / "out")
    makers = [found["made_by"][run["made_by"]]["commit"] for run in found["runs"]]
    assert makers[1] == "0123456789ab"
    assert makers[0] == makers[2] == found["written_by"]["commit"]
    assert len(found["made_by"]) == 2
    assert "commit" not in found  # no one commit for a table of many


def test_long_runs_come_first_and_seeds_outermost() -> None:
    nets = ("ffwd", "esn")
    grid = Grid(tasks=("HalfCheetah", "Ant"), architectures=nets, seeds=(0, 1))
    order = [(c.seed, c.task, c.architecture) for c in in_order(grid.runs())]
    pairs = [("Ant", "esn"), ("Ant", "ffwd"), ("HalfCheetah", "esn"), ("HalfCheetah", "ffwd")]
    assert order == [(seed, *pair) for seed in (0, 1) for pair in pairs]


def test_what_runs_cost() -> None:
    # The review's table: 12 and 21 microseconds a step of HalfCheetah's DTRNN.
    run = TrainConfig(task="HalfCheetah", iterations=500)
    assert cost(run) == pytest.approx(500 * 50_000 * 12e-6)
    small = dataclasses.replace(run, batch_steps=10_000)
    assert cost(small) == pytest.approx(500 * 10_000 * 21e-6)
    # One that was not measured counts as the median of 11, 12, 17, 20, 22, 22, 32.
    other = dataclasses.replace(run, architecture="dffwd-softplus")
    assert cost(other) == pytest.approx(500 * 50_000 * 20e-6)
    assert memory(run) == 1.0
    assert memory(TrainConfig(task="Ant", architecture="esn")) == pytest.approx(1.6)
    assert all(len(nets) == 7 for nets in STEP_COST.values())
    elsewhere = TrainConfig("Pendulum-v1", architecture="gru")
    guessed = ["Pendulum-v1 (flat)", "dffwd-softplus"]
    assert not_measured([run, elsewhere, other, elsewhere]) == guessed

    table = plan([run, run, dataclasses.replace(run, terrain="hill")])
    assert table.runs.tolist() == [2, 1]
    assert table.core_hours.tolist() == pytest.approx([2 * 300 / 3600, 475 / 3600])


def test_time_on_many_cores_by_hand() -> None:
    assert makespan([3.0, 3.0, 2.0, 2.0, 2.0], 1) == 12
    # 3, 2, 2 on one core and 3, 2 on the other
    assert makespan([3.0, 3.0, 2.0, 2.0, 2.0], 2) == 7
    assert makespan([3.0, 3.0, 2.0, 2.0, 2.0], 64) == 3


def test_numpy_numbers_make_the_same_grid() -> None:
    plain = Grid(("hopper",), seeds=(0, 1))
    assert Grid(np.array(["hopper"]), seeds=np.arange(2)) == plain
    assert Grid(["hopper"], seeds=range(2)) == plain
    with pytest.raises(ValueError, match="tasks is 'hopper', but it must be several values"):
        Grid("hopper")
    with pytest.raises(ValueError, match=r"seeds is 0\.5, but it must be a whole number"):
        Grid(seeds=np.array([0.5]))


def test_a_store_that_is_elsewhere(tmp_path: Path, client: Client) -> None:
    configs = Grid(("hopper",), ("flat",), ("ffwd", "gru")).runs(SMALL)
    url = f"memory://{tmp_path.name}"
    train(dataclasses.replace(configs[1], iterations=1), tmp_path / run_name(configs[1]))
    store = Store(url)
    for file in (tmp_path / run_name(configs[1])).iterdir():
        store._files.pipe_file(
            f"{store._root}/{run_name(configs[1])}/{file.name}", file.read_bytes()
        )
    outcomes = sweep(configs, url, scheduler=client)
    assert [o.error for o in outcomes] == [None, None]
    names = {path.rpartition(tmp_path.name)[2] for path in store._files.find(store._root)}
    files = ("checkpoint.pt", "curve.csv", "run.json")
    assert names == {f"/{run_name(c)}/{file}" for c in configs for file in files}
    for config in configs:
        there = store._files.cat_file(f"{store._root}/{run_name(config)}/curve.csv")
        assert there == (store.folder / run_name(config) / "curve.csv").read_bytes()
        assert progress(config, store.folder) == 3
    with pytest.raises(ValueError, match=r"the store 'nowhere://x' cannot be used .*: name a"):
        Store("nowhere://x")


def test_a_full_disk_fails_one_run_and_spares_the_others(
    tmp_path: Path, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    save = torch.save

    def full(content: dict[str, Any], *rest: Any) -> None:
        if content["config"]["architecture"] == "gru" and content["iteration"] == 2:
            raise OSError(errno.ENOSPC, "No space left on device")
        save(content, *rest)

    configs = Grid(("hopper",), ("flat",), ("gru", "ffwd")).runs(SMALL)
    with monkeypatch.context() as patch:
        patch.setattr(torch, "save", full)
        gru, ffwd = sweep(configs, tmp_path, scheduler=client)
    assert ffwd.error is None
    assert "after iteration 2, which could not be saved (No space left on device)" in str(gru.error)
    assert "last good checkpoint, of iteration 1" in str(gru.error)
    assert [o.error for o in sweep(configs, tmp_path, scheduler=client)] == [None, None]
    write(configs, tmp_path, tmp_path / "full", command="thesis sweep")
    for config in configs:
        train(config, tmp_path / "whole" / run_name(config))
    write(configs, tmp_path / "whole", tmp_path / "undisturbed", command="thesis sweep")
    same_tables(tmp_path / "full", tmp_path / "undisturbed")


def test_a_run_waits_for_the_process_that_is_still_in_its_directory(
    tmp_path: Path, client: Client
) -> None:
    (config,) = Grid(("hopper",), ("flat",), ("ffwd",)).runs(SMALL)
    folder = tmp_path / run_name(config)
    folder.mkdir()
    handle = os.open(folder, os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    threading.Timer(1, os.close, [handle]).start()
    with pytest.raises(ValueError, match="another process is training in"):
        train(config, folder)
    (outcome,) = sweep([config], tmp_path, scheduler=client)
    assert outcome.error is None


def same_tables(one: Path, two: Path) -> None:
    for name in ("curves.csv", "policies.pt"):
        assert (one / name).read_bytes() == (two / name).read_bytes(), name


def test_workers(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="workers is 0, but it must be an integer"):
        sweep([SMALL], tmp_path, workers=0)
    with pytest.raises(ValueError, match="two runs of the sweep are called 'hopper-flat"):
        sweep([SMALL, SMALL], tmp_path)


# ----------------------------------------------------------------------------- the command
ARGUMENTS = [
    *("--tasks", "hopper", "--architectures", "ffwd", "gru", "--iterations", "6"),
    *("--batch-steps", "100", "--horizon", "20", "--checkpoint-every", "2"),
]


@pytest.fixture
def started(tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen]]:
    """Begin a sweep in a process of its own, up to the first checkpoint of its first run."""
    running: list[subprocess.Popen] = []

    def start(*arguments: str) -> subprocess.Popen:
        process = subprocess.Popen(
            [sys.executable, "-m", "thesis_lib.cli", "sweep", *arguments],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            # A shell that starts the tests in the background has them ignore it.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )
        running.append(process)
        wait_for((tmp_path / "runs" / "hopper-flat-ffwd-0-float32" / "checkpoint.pt").exists)
        return process

    yield start
    for process in running:
        process.kill()
        process.wait()


def wait_for(what: Callable[[], object], seconds: float = 500) -> None:
    deadline = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interruption_ends_the_runs_and_says_how_to_go_on(
    tmp_path: Path, started: Callable[..., subprocess.Popen], number: signal.Signals
) -> None:
    arguments = [*ARGUMENTS, "--iterations", "100000", "--checkpoint-every", "100000"]
    places = ["--out", str(tmp_path / "out"), "--runs-in", str(tmp_path / "runs")]
    process = started(*arguments, *places)
    time.sleep(3)  # some iterations
    if number == signal.SIGINT:
        os.killpg(process.pid, number)  # as a terminal does
    else:
        process.send_signal(number)
    _, error = process.communicate(timeout=300)  # returns when the run's process has ended too
    assert process.returncode == 128 + number
    assert f"interrupted; the runs are kept in {tmp_path / 'runs'}" in error
    assert "Traceback" not in error
    # It saved what it had, though no checkpoint was due.
    records = [json.loads(p.read_text()) for p in (tmp_path / "runs").glob("*/run.json")]
    assert max(record["iteration"] for record in records) > 0


def test_a_killed_sweep_goes_on_to_the_same_curves(
    tmp_path: Path, started: Callable[..., subprocess.Popen]
) -> None:
    places = ["--out", str(tmp_path / "killed"), "--runs-in", str(tmp_path / "runs")]
    process = started(*ARGUMENTS, *places)
    os.kill(process.pid, signal.SIGKILL)  # its workers have to notice by themselves
    process.communicate()
    assert cli.main(["sweep", *ARGUMENTS, *places]) == 0
    whole = ["--out", str(tmp_path / "whole"), "--runs-in", str(tmp_path / "others")]
    assert cli.main(["sweep", *ARGUMENTS, *whole, "--workers", "2"]) == 0
    same_tables(tmp_path / "killed", tmp_path / "whole")
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


# --------------------------------------------------------------------- a scheduler of its own
@pytest.fixture
def dask_processes(tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen]]:
    """Start ``dask scheduler`` and ``dask worker`` on the loopback interface."""
    running: list[subprocess.Popen] = []

    def start(what: str, *arguments: str) -> subprocess.Popen:
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", *arguments]
        log = (tmp_path / f"{what}.log").open("a")
        running.append(subprocess.Popen(command, stdout=log, stderr=log, cwd=tmp_path))
        return running[-1]

    yield start
    for process in running:
        process.kill()
        process.wait()


def test_a_worker_and_the_scheduler_are_killed_and_nothing_is_lost(
    tmp_path: Path, dask_processes: Callable[..., subprocess.Popen]
) -> None:
    runs, arguments = tmp_path / "runs", [*ARGUMENTS, "--iterations", "60", "--seeds", "0", "1"]
    places = ["--out", str(tmp_path / "out"), "--runs-in", str(runs)]

    def started(
        name: str, n_workers: int
    ) -> tuple[list[str], subprocess.Popen, list[subprocess.Popen]]:
        file = tmp_path / name
        options = ["--port", "0", "--host", "127.0.0.1", "--no-dashboard"]
        scheduler = dask_processes("scheduler", *options, "--scheduler-file", str(file))
        wait_for(file.exists)
        address = json.loads(file.read_text())["address"]
        options = [address, "--nthreads", "1", "--no-nanny", "--no-dashboard"]
        return (
            ["--scheduler", address],
            scheduler,
            [dask_processes("worker", *options) for _ in range(n_workers)],
        )

    def begun(n: int) -> bool:
        return len(list(runs.glob("*/checkpoint.pt"))) >= n

    where, scheduler, workers = started("first.json", 2)
    command = [sys.executable, "-m", "thesis_lib.cli", "sweep", *arguments, *places, *where]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    wait_for(lambda: begun(2))
    workers[0].kill()
    wait_for(lambda: begun(3))  # the other goes on
    scheduler.kill()
    _, error = process.communicate(timeout=300)
    assert process.returncode == 1
    assert "the scheduler ended; the runs are kept in" in error
    assert "Traceback" not in error

    where, _, _ = started("second.json", 1)
    assert cli.main(["sweep", *arguments, *places, *where]) == 0
    whole = ["--out", str(tmp_path / "whole"), "--runs-in", str(tmp_path / "others")]
    assert cli.main(["sweep", *arguments, *whole, *where]) == 0
    same_tables(tmp_path / "out", tmp_path / "whole")


@pytest.mark.parametrize("error", [CommClosedError("x"), ClosedClientError("x"), TimeoutError()])
def test_a_scheduler_that_is_gone_is_one_sentence_wherever_the_client_finds_out(
    error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone(*_: object) -> None:
        raise error

    monkeypatch.setattr(Client, "unsubscribe_topic", gone)
    with pytest.raises(SchedulerLost, match="the scheduler ended; the runs are kept in"):
        sweep([SMALL], tmp_path, workers=1)


def test_work_whose_future_is_lost_with_its_scheduler_is_one_sentence() -> None:
    def work() -> None:
        with connected(1, 1, None) as client:
            future = client.submit(time.sleep, 60)
            client.cancel([future])  # as a client does whose scheduler is gone
            future.result()

    with pytest.raises(SchedulerLost, match="the scheduler ended"):
        work()


def test_workers_keep_memory_unless_the_environment_says_otherwise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("MALLOC_TOP_PAD_", "131072")
    monkeypatch.delenv("MALLOC_TRIM_THRESHOLD_", raising=False)
    with connected(1, 1, None) as client:
        trim, pad = (
            client.submit(os.environ.get, name).result()
            for name in ("MALLOC_TRIM_THRESHOLD_", "MALLOC_TOP_PAD_")
        )
    assert int(trim) == KEEP_MEMORY["MALLOC_TRIM_THRESHOLD_"] > 2**33
    assert pad == "131072"


def test_no_scheduler_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"no Dask scheduler at 'nonsense://': start one with"):
        sweep([SMALL], tmp_path, scheduler="nonsense://")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_a_cluster_starts_waits_until_it_can_be_closed(
    number: signal.Signals, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Dask closes a cluster that has not started with a traceback only (its issue 1321)."""
    state = []

    class Cluster(contextlib.AbstractContextManager):
        def __init__(self, **options: object) -> None:
            os.kill(os.getpid(), number)
            time.sleep(0.05)
            state.append("started")

        def __exit__(self, *error: object) -> None:
            state.append("closed")

    monkeypatch.setattr(cluster, "LocalCluster", Cluster)
    before = signal.signal(number, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt), connected(1, 1, None):
            pass
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        signal.signal(number, before)
    assert state == ["started", "closed"]


def test_a_script_without_a_guard_says_what_it_lacks(tmp_path: Path) -> None:
    """Each worker imports the script that starts it, which would start workers again."""
    script = tmp_path / "mine.py"
    script.write_text(
        "from thesis_lib.training.config import TrainConfig\n"
        "from thesis_lib.training.sweep import sweep\n"
        f"sweep([TrainConfig(iterations=1, batch_steps=500)], {str(tmp_path / 'runs')!r},"
        " workers=1)\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=300)
    assert done.returncode == 1
    assert "ValueError: the processes that are to work could not be started" in done.stderr
    assert 'under `if __name__ == "__main__":`' in done.stderr.splitlines()[-1]


def test_a_plan_shows_the_jobs_of_slurm(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """By dask-jobqueue itself: a job a run, on one core, with the memory that runs need."""
    asked = ["sweep", "--tasks", "half-cheetah", "--architectures", "ffwd", "gru", "--seeds", "0"]
    asked += ["--out", str(tmp_path), "--runs-in", str(tmp_path / "runs"), "--plan"]
    assert cli.main([*asked, "--scheduler", "slurm"]) == 0
    shown = capsys.readouterr().out
    runs = [TrainConfig("HalfCheetah", architecture=net) for net in ("ffwd", "gru")]
    megabytes = math.ceil(math.ceil(max(map(memory, runs))) * 1e9 / 2**20)
    assert "#SBATCH --cpus-per-task=1" in shown
    assert f"#SBATCH --mem={megabytes}M" in shown
    assert "--nthreads 1 " in shown
    assert not (tmp_path / "runs").exists() or not list((tmp_path / "runs").iterdir())
    monkeypatch.setitem(sys.modules, "dask_jobqueue", None)  # as where it is not installed
    assert cli.main([*asked, "--scheduler", "slurm"]) == 2
    assert "pip install 'thesis_lib[slurm]'" in capsys.readouterr().err
