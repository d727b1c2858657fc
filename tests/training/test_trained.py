"""Trained policies come back from the file of a sweep as they were."""

import errno
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

from thesis_lib import cli
from thesis_lib.cli_training import _read
from thesis_lib.edition.experiment import load
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.curves import write
from thesis_lib.training.evaluation import EvaluateConfig, evaluate
from thesis_lib.training.grid import Grid, run_name
from thesis_lib.training.run import Training
from thesis_lib.training.train import train
from thesis_lib.training.trained import TrainedPolicies

BASE = TrainConfig(batch_steps=100, horizon=20, iterations=2)
NETS = ("ctrnn", "esn", "lstm")


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three runs, one of them with units of its own, and what a sweep writes of them."""
    folder = tmp_path_factory.mktemp("swept")
    configs = Grid(("swimmer",), architectures=NETS, variants=("units=7",)).runs(BASE)
    for config in configs[1:]:  # the first has not begun
        train(config, folder / "runs" / run_name(config))
    write(configs, folder / "runs", folder, command="thesis sweep")
    return folder


def test_policies_are_those_of_the_checkpoints(swept: Path) -> None:
    found = TrainedPolicies(swept / "policies.pt")
    assert len(found.names) == 5
    assert "swimmer-flat-esn-0-float32-units-7" in found.names
    for name in found.names:
        kept, run = found.load(name), Training.load(swept / "runs" / name)
        assert (kept.config, kept.iteration) == (run.config, 2)
        for (key, have), want in zip(
            kept.policy.state_dict().items(), run.policy.state_dict().values(), strict=True
        ):
            assert torch.equal(have, want), (name, key)
        untrained = Training(run.config).policy.parameter_vector()
        assert not torch.equal(kept.policy.parameter_vector(), untrained)


def test_the_command_tests_one_of_them(swept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name = "swimmer-flat-lstm-0-float32"
    command = ["evaluate", str(swept / "policies.pt"), "--run", name, "--runs", "2"]
    assert cli.main([*command, "--steps", "15"]) == 0
    expected = evaluate(swept / "runs" / name, EvaluateConfig(runs=2, steps=15))
    assert f"{np.mean(expected['return']):.5g}" in capsys.readouterr().out


def test_settings_by_their_former_names(swept: Path, tmp_path: Path) -> None:
    """A file from before lambda and the number of worlds had the field's names."""
    content = torch.load(swept / "policies.pt", weights_only=True)
    for kept in content["policies"].values():
        kept["config"]["trace"] = 0.9
        kept["config"]["worlds"] = 3
        del kept["config"]["gae_lambda"], kept["config"]["num_envs"]
    torch.save(content, tmp_path / "policies.pt")
    found = TrainedPolicies(tmp_path / "policies.pt")
    config = found.load(found.names[0]).config
    assert (config.gae_lambda, config.num_envs) == (0.9, 3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["policies.pt"],
            "holds the policies of a sweep, 5 of them, such as swimmer-flat-ctrnn-0-",
        ),
        (["policies.pt", "--run", "ant"], "which has 5: did you mean"),
        (["nothing.pt", "--run", "ant"], "there is no file of policies at"),
        (["curves.csv", "--run", "ant"], "is not a file of policies of `thesis sweep`"),
    ],
)
def test_bad_input_is_one_sentence(
    arguments: list[str], message: str, swept: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["evaluate", str(swept / arguments[0]), *arguments[1:]]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_of_many_runs_the_nearest_are_told(swept: Path, tmp_path: Path) -> None:
    content = torch.load(swept / "policies.pt", weights_only=True)
    kept = content["policies"]["swimmer-flat-lstm-0-float32"]
    names = [f"{task}-flat-gru-{seed}-float32" for task in ("ant", "hopper") for seed in range(9)]
    content["policies"] = dict.fromkeys(names, kept)
    torch.save(content, path := tmp_path / "policies.pt")
    with pytest.raises(ValueError, match=r"such as ant-flat-gru-0-float32, .* and ant-flat-gru-4-"):
        _read(path, None)
    with pytest.raises(ValueError, match=r"has 18: did you mean hopper-flat-gru-8-float32 or") as e:
        _read(path, "hoper-flat-gru-8")
    assert sum(name in str(e.value) for name in names) == 5


def test_other_versions_are_refused(swept: Path, tmp_path: Path) -> None:
    content = torch.load(swept / "policies.pt", weights_only=True)
    path = tmp_path / "policies.pt"
    torch.save(content | {"format": 0}, path)
    with pytest.raises(ValueError, match="has format 0, but this version"):
        TrainedPolicies(path)
    kept = content["policies"]["swimmer-flat-lstm-0-float32"]
    for broken in (
        {"config": kept["config"] | {"wings": 2}},
        {"config": kept["config"] | {"units": 3}},
        {"config": kept["config"] | {"task": 3}},
        {"config": None},
        {"parameters": None},
        {"parameters": torch.full_like(kept["parameters"], float("nan"))},
        {"iteration": None},
    ):
        torch.save({"format": 1, "policies": {"bird": kept | broken}}, path)
        with pytest.raises(ValueError, match=r"'bird' .* does not fit this version"):
            TrainedPolicies(path).load("bird")


@pytest.mark.parametrize("missing", ["config", "iteration", "parameters"])
def test_a_run_with_a_hole(swept: Path, tmp_path: Path, missing: str) -> None:
    content = torch.load(swept / "policies.pt", weights_only=True)
    del content["policies"]["swimmer-flat-lstm-0-float32"][missing]
    torch.save(content, tmp_path / "policies.pt")
    with pytest.raises(ValueError, match=f"does not fit .* \\(it has no '{missing}'\\): sweep"):
        TrainedPolicies(tmp_path / "policies.pt").load("swimmer-flat-lstm-0-float32")


@pytest.mark.parametrize("content", [{"format": 1}, {"format": 1, "policies": ["a", "b"]}, [1]])
def test_a_file_of_something_else(content: object, tmp_path: Path) -> None:
    torch.save(content, tmp_path / "policies.pt")
    with pytest.raises(ValueError, match="is not a file of policies of `thesis sweep`"):
        TrainedPolicies(tmp_path / "policies.pt")


def test_a_broken_checkpoint_leaves_the_others_alone(swept: Path, tmp_path: Path) -> None:
    configs = Grid(("swimmer",), architectures=("esn", "lstm")).runs(BASE)
    for config in configs:
        shutil.copytree(swept / "runs" / run_name(config), tmp_path / run_name(config))
    (tmp_path / run_name(configs[0]) / "checkpoint.pt").write_text("rain")
    write(configs, tmp_path, tmp_path, command="thesis sweep")
    assert TrainedPolicies(tmp_path / "policies.pt").names == ("swimmer-flat-lstm-0-float32",)
    curves, record = load("curves", tmp_path)
    assert len(curves) == 4  # both learning curves are whole
    errors = [run.get("error") for run in record["runs"]]
    assert errors[1] is None
    assert "is not a checkpoint of `thesis train`" in errors[0]


def test_a_full_disk_is_one_sentence(
    swept: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def full(self: Path, data: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device", str(self))

    monkeypatch.setattr(Path, "write_bytes", full)
    command = ["sweep", "--tasks", "swimmer", "--architectures", "esn", "--iterations", "2"]
    sizes = ["--batch-steps", "100", "--horizon", "20", "--runs-in", str(swept / "runs")]
    assert cli.main([*command, *sizes, "--out", str(tmp_path)]) == 1
    error = capsys.readouterr().err
    assert "(No space left on device): make room and give the command again" in error
    assert not list(tmp_path.glob("*policies*"))
