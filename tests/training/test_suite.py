"""Tests of all policies of a store: each as if it were tested alone, and which of them counts."""

import dataclasses
import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import torch
from distributed import Client
from distributed.scheduler import KilledWorker
from scipy import stats

from thesis_lib import cli
from thesis_lib.checks import ForeseenError
from thesis_lib.training import suite
from thesis_lib.training.checkpoint import code_digest
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.curves import LAST, write
from thesis_lib.training.evaluation import EvaluateConfig, acting, evaluate
from thesis_lib.training.grid import Grid, run_name
from thesis_lib.training.suite import (
    BEST_COLUMNS,
    COLUMNS,
    SuiteConfig,
    best,
    evaluate_all,
    policies_in,
)
from thesis_lib.training.train import train
from thesis_lib.training.trained import read_trained

SMALL = TrainConfig(batch_steps=60, horizon=20, iterations=2)
FEW = SuiteConfig(runs=3, steps=130)
"""Long enough for the noise, which begins at step 100, though robots may fall before."""
CONFIGS = Grid(("half-cheetah",), ("flat",), ("ffwd", "gru"), (0, 1)).runs(SMALL)


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": "127.0.0.1:0"}
    with Client(processes=False, **options) as found:
        yield found


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("store")
    for config in CONFIGS:
        train(config, folder / "runs" / run_name(config))
    write(CONFIGS, folder / "runs", folder / "out", command="thesis sweep")
    return folder


def test_every_policy_is_tested_as_if_alone(store: Path, client: Client) -> None:
    table = evaluate_all(store / "runs", FEW, scheduler=client)
    assert list(table.columns) == list(COLUMNS)
    assert len(table) == len(CONFIGS) * 3 * 3
    conditions = {
        "base": (),
        "noise": ("WhiteNoise(sigma=1.0, onset=100)",),
        "switch": ("TerrainSwitch(difficulty=1.0)",),
    }
    for config in CONFIGS:
        mine = table[(table.architecture == config.architecture) & (table.seed == config.seed)]
        curve = pd.read_csv(store / "runs" / run_name(config) / "curve.csv")
        assert set(mine.run) == {run_name(config)}
        assert set(mine.last_return) == {curve.mean_return.tail(LAST).mean()}
        for condition, perturbations in conditions.items():
            test = EvaluateConfig(
                runs=3, steps=130, termination="train", perturbations=perturbations
            )
            alone = evaluate(store / "runs" / run_name(config), test)
            assert mine[mine.condition == condition]["return"].tolist() == alone["return"].tolist()
    # A file of policies holds the same ones.
    again = evaluate_all(store / "out" / "policies.pt", FEW, scheduler=client)
    order = ["run", "condition", "test"]
    pd.testing.assert_frame_equal(
        table.sort_values(order, ignore_index=True), again.sort_values(order, ignore_index=True)
    )


def test_the_policy_of_the_best_batch(store: Path, client: Client) -> None:
    name = run_name(CONFIGS[0])
    config = dataclasses.replace(FEW, policy="best", conditions=("base",))
    table = evaluate_all(store / "runs", config, names=[name], scheduler=client)
    trained = read_trained(store / "runs" / name)
    assert trained.best is not None
    trained.policy.set_parameter_vector(trained.best.parameters)
    alone = evaluate(trained, FEW.test("base"))
    assert table["return"].tolist() == alone["return"].tolist()
    # The batch of iteration k was collected by what k - 1 iterations had learned.
    assert set(table.iteration) == {trained.best.iteration - 1}


def made_up() -> pd.DataFrame:
    """Two seeds of a net with three runs each."""
    rows = [
        {"seed": seed, "last_return": last, "test": i, "return": value}
        for seed, last, values in ((0, 5.0, (1.0, 2.0, 6.0)), (1, 4.0, (7.0, 8.0, 9.0)))
        for i, value in enumerate(values)
    ]
    keys = {"task": "Hopper", "terrain": "flat", "architecture": "gru"}
    return pd.DataFrame(rows).assign(
        **keys, precision="float32", variant="default", condition="base"
    )


def test_rules_by_hand() -> None:
    (row,) = best(made_up()).to_dict("records")
    assert list(row) == list(BEST_COLUMNS)
    # seed 0 ended training best, though its tests are worse
    assert (row["seeds"], row["seed"], row["mean_return"]) == (1, 0, 3.0)
    assert row["se_runs"] == pytest.approx(stats.sem([1.0, 2.0, 6.0]))
    (row,) = best(made_up(), "all").to_dict("records")
    assert (row["seeds"], row["mean_return"]) == (2, 5.5)
    assert row["se_seeds"] == pytest.approx(stats.sem([3.0, 8.0]))
    with pytest.raises(ValueError, match="rule 'worst' does not exist: choose one of seed, all"):
        best(made_up(), "worst")
    with pytest.raises(ValueError, match="needs the returns training ended with"):
        best(made_up().assign(last_return=np.nan))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"conditions": ("rain",)}, "conditions 'rain' does not exist: choose one of base"),
        ({"conditions": ()}, "but they must be some of base"),
        ({"policy": "first"}, "policy 'first' does not exist: choose one of last, best"),
        ({"noise": -1.0}, "sigma is -1.0"),
        ({"correlation_time": -1.0}, "correlation_time is -1.0"),
        ({"termination": "sometimes"}, "termination 'sometimes' does not exist"),
        ({"input_filter": -0.1}, r"input_filter is -0\.1, but a time constant is at least 0 s"),
        ({"switch_at": "here"}, "switch_at is 'here', but it must be metres, or task"),
    ],
)
def test_suites_that_cannot_be(options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        SuiteConfig(**options)


def test_memory_and_previous_action_can_be_taken_away(store: Path) -> None:
    policy = read_trained(store / "runs" / run_name(CONFIGS[2])).policy  # a GRU
    observation = torch.randn(3, policy.observation_size, dtype=torch.float64)
    before = torch.randn(3, policy.action_size, dtype=torch.float64)
    start = policy.initial_state(3)
    with torch.no_grad():
        _, state = policy.step(observation, before, start)
        assert not torch.equal(state, start)
        zero = torch.zeros_like(before)
        for memory in (True, False):
            for previous in (True, False):
                config = EvaluateConfig(memory=memory, previous_action=previous)
                mean, after = acting(policy, config, 0.01).step(observation, before, state)
                expected = policy.step(
                    observation, before if previous else zero, state if memory else start
                )
                assert torch.equal(mean, expected[0])
                assert torch.equal(after, expected[1])


@pytest.mark.parametrize("index", [0, 2])
def test_a_filter_between_sensors_and_net(store: Path, index: int) -> None:
    """Its output starts at the first reading and closes a share 1 - exp(-dt/tau) of the gap."""
    policy = read_trained(store / "runs" / run_name(CONFIGS[index])).policy
    first, second = torch.randn(2, 3, policy.observation_size, dtype=torch.float64)
    before = torch.randn(3, policy.action_size, dtype=torch.float64)
    config = EvaluateConfig(input_filter=0.02)
    actor = acting(policy, config, 0.01)
    with torch.no_grad():
        state, expected = actor.initial_state(3), policy.initial_state(3)
        seen = first + (1 - 0.6065306597126334) * (second - first)  # exp(-1/2)
        for observation, filtered in ((first, first), (second, seen)):
            mean, state = actor.step(observation, before, state)
            wanted, expected = policy.step(filtered, before, expected)
            assert torch.allclose(mean, wanted, rtol=0, atol=1e-6)


def test_tests_say_what_was_done_to_the_net(store: Path) -> None:
    config = SuiteConfig(
        conditions=("base", "noise"),
        **{"runs": 1, "steps": 20, "correlation_time": 3.0, "memory": False, "input_filter": 0.1},
    )
    table = evaluate_all(store / "runs", config, names=[run_name(CONFIGS[2])], workers=1)
    assert list(table.condition) == ["base", "noise"]
    assert list(table.correlation) == [0, 3]
    assert set(table.intervention) == {"no memory, input filter"}


def test_a_worker_that_dies_again_and_again_is_one_sentence(
    store: Path, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    def died(*arguments: object) -> None:
        raise KilledWorker("test", SimpleNamespace(address="a worker"), 3)

    monkeypatch.setattr(suite, "_test", died)
    name = run_name(CONFIGS[0])
    with pytest.raises(ForeseenError, match=f"while it tested '{name}', as for want of memory"):
        evaluate_all(store / "runs", FEW, names=[name], scheduler=client)


def test_a_file_of_policies_that_is_written_anew_is_read_anew(store: Path, tmp_path: Path) -> None:
    for configs in (CONFIGS[:1], CONFIGS[:2]):
        write(configs, store / "runs", tmp_path, command="thesis sweep")
        assert policies_in(tmp_path / "policies.pt") == [run_name(c) for c in configs]


def test_the_command(store: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--runs", "2", "--steps", "20", "--conditions", "base", "hill"]
    out = ["--out", str(tmp_path / "out"), "--workers", "1"]
    assert cli.main(["test-policies", str(store / "runs"), *arguments, *out]) == 0
    table = pd.read_parquet(tmp_path / "out" / "tests.parquet")
    assert len(table) == len(CONFIGS) * 2 * 2
    record = json.loads((tmp_path / "out" / "tests.json").read_text())
    assert record["policies"] is None  # a folder of runs is no file
    assert record["code"] not in ("", code_digest())  # that of a test holds more than a run's
    assert "HalfCheetah" in capsys.readouterr().out
    file = store / "out" / "policies.pt"
    assert cli.main(["test-policies", str(file), *arguments, *out]) == 0
    record = json.loads((tmp_path / "out" / "tests.json").read_text())
    assert record["policies"] == hashlib.sha256(file.read_bytes()).hexdigest()
    capsys.readouterr()
    some = ["test-policies", str(store / "runs"), *arguments]
    some += ["--names", "*-ffwd-*", run_name(CONFIGS[2])]
    assert cli.main([*some, *out]) == 2
    error = capsys.readouterr().err
    assert f"of other policies, such as {run_name(CONFIGS[3])}, and would lose 1 of them" in error
    assert len(pd.read_parquet(tmp_path / "out" / "tests.parquet")) == len(table)
    for _ in range(2):  # the tests of the same policies may be replaced
        assert cli.main([*some, "--out", str(tmp_path / "some"), "--workers", "1"]) == 0
    found = set(pd.read_parquet(tmp_path / "some" / "tests.parquet").run)
    assert found == {run_name(CONFIGS[i]) for i in (0, 1, 2)}
    capsys.readouterr()
    assert cli.main(["test-policies", str(store / "runs"), "--names", "swimmer-*"]) == 2
    assert "no policy is named 'swimmer-*'" in capsys.readouterr().err
    assert cli.main(["test-policies", str(tmp_path / "nothing")]) == 2
    assert "there are no policies in" in capsys.readouterr().err
