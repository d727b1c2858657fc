"""Sweeps brought together: the tables of one sweep of all, and each run's own provenance."""

import dataclasses
import json
from pathlib import Path

import pytest
import torch

from thesis_lib import cli
from thesis_lib.training import curves
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.grid import Grid, run_name
from thesis_lib.training.merge import merge
from thesis_lib.training.train import train
from thesis_lib.training.trained import TrainedPolicies

SMALL = TrainConfig(batch_steps=100, horizon=20, iterations=2, checkpoint_every=1)
CONFIGS = Grid(("hopper",), ("flat",), ("dffwd", "ffwd"), (0, 1)).runs(SMALL)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    for config in CONFIGS:
        train(config, folder / run_name(config))
    return folder


def written(configs: list[TrainConfig], runs: Path, out: Path, **options: object) -> Path:
    curves.write(configs, runs, out, command="thesis sweep", **options)  # type: ignore[arg-type]
    return out


def test_two_halves_are_the_whole(runs: Path, tmp_path: Path) -> None:
    whole = written(CONFIGS, runs, tmp_path / "whole")
    # Each half has one run of either net.
    halves = [written(CONFIGS[i::2], runs, tmp_path / f"half-{i}") for i in range(2)]
    merge(halves, tmp_path / "merged", command="thesis merge")
    for name in ("curves.csv", "curves.seconds.csv"):
        assert (tmp_path / "merged" / name).read_bytes() == (whole / name).read_bytes(), name
    here, there = (TrainedPolicies(tmp_path / f / "policies.pt") for f in ("whole", "merged"))
    assert here.names == there.names == tuple(sorted(here.names))
    for name in here.names:
        ours, theirs = here.load(name), there.load(name)
        assert (ours.config, ours.iteration) == (theirs.config, theirs.iteration)
        assert torch.equal(ours.policy.parameter_vector(), theirs.policy.parameter_vector())
    one, two = (json.loads((tmp_path / f / "curves.json").read_text()) for f in ("whole", "merged"))
    different = {"command", "written", "written_by", "wall_seconds", "processor_seconds"}
    assert {k: v for k, v in one.items() if k not in different} == {
        k: v for k, v in two.items() if k not in different
    }
    assert two["processor_seconds"] == pytest.approx(one["processor_seconds"], abs=0.11)


def test_finished_runs_are_added_to_a_store_each_with_what_made_it(
    runs: Path, tmp_path: Path
) -> None:
    store = written(CONFIGS[:2], runs, tmp_path / "store")
    record = json.loads((store / "curves.json").read_text())
    record["made_by"] = [{"commit": "0123456789ab"}]
    (store / "curves.json").write_text(json.dumps(record))
    broken = {run_name(CONFIGS[3]): "it rained."}
    more = written(CONFIGS[1:], runs, tmp_path / "more", errors=broken)
    merge([store, more], store, command="thesis merge")
    found = json.loads((store / "curves.json").read_text())
    by = {run["run"]: found["made_by"][run["made_by"]]["commit"] for run in found["runs"]}
    assert list(by) == sorted(run_name(c) for c in CONFIGS[:3])  # without the one that failed
    assert [commit == "0123456789ab" for commit in by.values()] == [True, True, False]
    assert found["rows"] == 6


def test_a_store_that_a_killed_merge_left_is_refused(
    runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed between the tables of curves and of seconds, their rows belong to other runs."""
    store = written(CONFIGS[1:2], runs, tmp_path / "store")
    more = written(CONFIGS[:1], runs, tmp_path / "more")
    replacing = curves.replacing

    def killed(path: Path) -> object:
        if path.name == "curves.seconds.csv":
            raise KeyboardInterrupt
        return replacing(path)

    with monkeypatch.context() as patched:
        patched.setattr(curves, "replacing", killed)
        with pytest.raises(KeyboardInterrupt):
            merge([store, more], store, command="thesis merge")
    left = [file.read_bytes() for file in sorted(store.iterdir())]
    with pytest.raises(ValueError, match=r"4 rows in curves.csv, 2 in curves.seconds.csv.*git"):
        merge([store, more], store, command="thesis merge")
    assert [file.read_bytes() for file in sorted(store.iterdir())] == left


def test_sweeps_of_two_budgets_stay_apart(runs: Path, tmp_path: Path) -> None:
    longer = dataclasses.replace(CONFIGS[0], batch_steps=120)
    train(longer, tmp_path / "runs" / run_name(longer))
    folders = [
        written(CONFIGS[1:2], runs, tmp_path / "a"),
        written([longer], tmp_path / "runs", tmp_path / "b"),
    ]
    with pytest.raises(ValueError, match=r"batch_steps is 100 in '.*a' but 120 in '.*b': merge"):
        merge(folders, tmp_path / "c", command="thesis merge")
    assert not (tmp_path / "c").exists()


def test_the_command(runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = [str(written(CONFIGS[:1], runs, tmp_path / "a")), "--out", str(tmp_path / "b")]
    assert cli.main(["merge", *out]) == 0
    assert "1 finished runs of 1 sweeps" in capsys.readouterr().out
    assert cli.main(["merge", str(tmp_path / "nothing"), *out]) == 2
    assert "there is no curves.json in " in capsys.readouterr().err


def test_a_sweep_does_not_write_over_runs_it_has_not(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = written(CONFIGS[:2], runs, tmp_path / "store")
    before = (store / "curves.csv").read_bytes()
    arguments = ["--tasks", "hopper", "--architectures", "dffwd", "--iterations", "2"]
    arguments += ["--batch-steps", "100", "--horizon", "20", "--checkpoint-every", "1"]
    place = ["--out", str(store), "--runs-in", str(tmp_path / "elsewhere")]
    assert cli.main(["sweep", *arguments, *place, "--workers", "1"]) == 2
    error = capsys.readouterr().err
    assert "hopper-flat-dffwd-0-float32, and would lose 2 of them: choose another --out" in error
    assert (store / "curves.csv").read_bytes() == before
