"""Training runs: what they start from, that they can be resumed, and how they stop."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch

from thesis_lib.experiments import training
from thesis_lib.experiments.training import (
    CURVE_COLUMNS,
    TIMING_COLUMNS,
    TerminalReport,
    TrainConfig,
    Training,
    TrainingStopped,
    make_batch_task,
    make_run_policy,
    step_size,
    train,
)
from thesis_lib.locomotion import BatchTask, Step
from thesis_lib.optimisation import TRPO
from thesis_lib.policies import ARCHITECTURES, CTRNN, ESN

torch.set_num_threads(1)
SMALL = {"batch_steps": 200, "horizon": 40, "iterations": 3}


def numbers(run: Training) -> pd.DataFrame:
    return run.curve.drop(columns=list(TIMING_COLUMNS))


def same(one: Training, two: Training) -> None:
    pd.testing.assert_frame_equal(numbers(one), numbers(two), check_exact=True)
    assert torch.equal(one.policy.parameter_vector(), two.policy.parameter_vector())
    observations = np.random.default_rng(0).normal(size=(5, one.policy.feature_size))
    time = np.arange(5)
    np.testing.assert_array_equal(
        one.learner.baseline.predict(observations, time),
        two.learner.baseline.predict(observations, time),
    )


# ----------------------------------------------------------------------------- reproducibility
@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_same_seed_same_run(architecture: str) -> None:
    config = TrainConfig(architecture=architecture, **SMALL)
    one, two = train(config), train(dataclasses.replace(config, threads=2))
    same(one, two)
    assert one.iteration == len(one.curve) == 3
    assert list(one.curve.columns) == list(CURVE_COLUMNS)
    other = train(dataclasses.replace(config, seed=1, iterations=1))
    assert other.curve.mean_return[0] != one.curve.mean_return[0]


@pytest.mark.parametrize(
    "options",
    [
        {"task": "Hopper", "architecture": "ctrnn"},
        {"task": "HalfCheetah", "architecture": "lstm"},
        {"task": "Swimmer", "architecture": "dffwd", "terrain": "hill"},
        {"task": "Ant", "architecture": "gru", "units": 4},
        {"task": "Walker2d", "architecture": "dtrnn", "algorithm": "ppo"},
        {"task": "Hopper", "architecture": "esn", "precision": "float64"},
        {"task": "Hopper", "architecture": "ffwd", "baseline": "network", "bootstrap": True},
    ],
    ids=lambda o: f"{o['task']}-{o['architecture']}",
)
def test_a_killed_run_goes_on_to_the_same_result(tmp_path: Path, options: dict) -> None:
    config = TrainConfig(**{**SMALL, **options, "iterations": 4, "checkpoint_every": 2})
    whole = train(config)

    class KilledError(Exception):
        pass

    def kill(run: Training) -> None:
        if run.iteration == 3:  # one iteration after the checkpoint is lost
            raise KilledError

    with pytest.raises(KilledError):
        train(config, tmp_path, report=kill)
    resumed = train(config, tmp_path)
    same(resumed, whole)
    saved = pd.read_csv(tmp_path / "curve.csv")
    np.testing.assert_array_equal(saved.mean_return, whole.curve.mean_return)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["checkpoint.pt", "curve.csv", "run.json"]


def test_a_finished_run_can_be_made_longer(tmp_path: Path) -> None:
    config = TrainConfig(**SMALL)
    train(config, tmp_path)
    longer = dataclasses.replace(config, iterations=5)
    same(train(longer, tmp_path), train(longer))


def test_a_loaded_run_is_the_run(tmp_path: Path) -> None:
    run = train(TrainConfig(**SMALL), tmp_path)
    same(Training.load(tmp_path), run)
    record = json.loads((tmp_path / "run.json").read_text())
    assert record["delta_kl"] == 0.35
    assert record["parameters"] == run.policy.n_trainable
    assert record["iteration"] == 3


# ------------------------------------------------------------------------------------- defaults
@pytest.mark.parametrize(
    ("task", "architecture", "delta"),
    [
        ("ant", "ctrnn", 0.3),
        ("half-cheetah", "dtrnn", 0.1),
        ("hopper", "gru", 0.07),
        ("Swimmer", "esn", 0.02),
        ("walker", "ctrnn", 0.5),
        ("walker", "lstm", 0.05),  # "as Duan et al.": ours
        ("swimmer", "dffwd", 0.1),  # stated in Duan et al.'s discussion of TRPO
        ("swimmer", "ctrnn", 0.1),
        ("ant", "dffwd", 0.05),
        ("ant", "ffwd-400", 0.05),
    ],
)
def test_step_sizes_of_table_5_1(task: str, architecture: str, delta: float) -> None:
    config = TrainConfig(task=task, architecture=architecture)
    assert step_size(config) == delta
    asked = dataclasses.replace(config, delta_kl=0.123)
    assert isinstance(training.make_algorithm(asked), TRPO)
    assert step_size(asked) == 0.123


@pytest.mark.parametrize(
    ("task", "architecture", "seen"),
    [
        ("hopper", "dtrnn", 11),
        ("hopper", "dffwd", 20),
        ("swimmer", "lstm", 5),
        ("swimmer", "ffwd-400", 20),
        ("walker", "gru", 21),
    ],
)
def test_feature_subsets(task: str, architecture: str, seen: int) -> None:
    config = TrainConfig(task=task, architecture=architecture, worlds=1)
    policy = make_run_policy(config, make_batch_task(config))
    assert policy.feature_size == seen
    full = dataclasses.replace(config, features="full")
    assert make_run_policy(full, make_batch_task(full)).feature_size == policy.observation_size


def test_every_run_has_a_directory_of_its_own() -> None:
    config = TrainConfig(task="walker", terrain="hill", architecture="gru", seed=3)
    assert training.default_directory(config).parts[-3:] == (
        "_build",
        "runs",
        "walker2d-hill-gru-3",
    )


def test_settings_reach_the_policy() -> None:
    config = TrainConfig(
        task="walker", architecture="ctrnn", integrator="euler", time_constant=0.05, worlds=1
    )
    policy = make_run_policy(config, make_batch_task(config))
    assert isinstance(policy, CTRNN)
    assert (policy.dt, policy.integrator) == (0.005, "euler")
    assert policy.time_constants().tolist()[0] == pytest.approx(0.05)
    config = TrainConfig(task="hopper", architecture="esn", density=0.5, worlds=1)
    reservoir = make_run_policy(config, make_batch_task(config))
    assert isinstance(reservoir, ESN)
    assert (reservoir.spectral_radius, reservoir.density, reservoir.leak) == (1.1, 0.5, 0.5)
    assert training.table_5_1("Ant", "esn", "spectral_radius") == 1.5
    assert training.table_5_1("Ant", "esn", "weight_density") == 0.7


def test_worlds_for_a_batch() -> None:
    assert make_batch_task(TrainConfig()).n_worlds == 100
    assert make_batch_task(TrainConfig(batch_steps=10_000)).n_worlds == 20
    assert make_batch_task(TrainConfig(batch_steps=100)).n_worlds == 1


def test_a_hill_run_has_its_own_map() -> None:
    config = TrainConfig(terrain="hill", **SMALL)
    heights = [make_batch_task(c).model.hfield_data for c in (config, config)]
    np.testing.assert_array_equal(heights[0], heights[1])
    other = make_batch_task(dataclasses.replace(config, seed=1)).model.hfield_data
    assert not np.array_equal(other, heights[0])
    many = make_batch_task(dataclasses.replace(config, maps=2))
    assert [many.ground_id(i) for i in range(4)] == [0, 1, 0, 1]


# ------------------------------------------------------------------------------------ accidents
def test_a_bad_parameter_stops_the_run_and_spares_the_checkpoint(tmp_path: Path) -> None:
    config = TrainConfig(**{**SMALL, "iterations": 6, "checkpoint_every": 2})

    def poison(run: Training) -> None:
        if run.iteration == 3:
            with torch.no_grad():
                run.policy.head.bias[0] = float("nan")

    with pytest.raises(
        TrainingStopped, match=r"in iteration 4: the action in world 0 .* of iteration 2, is in"
    ):
        train(config, tmp_path, report=poison)
    good = Training.load(tmp_path)
    assert good.iteration == 2
    good.policy.check_finite()


def test_a_bad_reward_stops_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    step = BatchTask.step

    def spoilt(task: BatchTask, actions: np.ndarray) -> Step:
        outcome = step(task, actions)
        if task.steps.max() == 3:
            outcome.reward[0] = np.nan
        return outcome

    monkeypatch.setattr(BatchTask, "step", spoilt)
    with pytest.raises(TrainingStopped, match="iteration 1: the reward in world 0 at step 2 "):
        train(TrainConfig(**SMALL))


def test_another_run_in_the_directory(tmp_path: Path) -> None:
    config = TrainConfig(**{**SMALL, "iterations": 1})
    train(config, tmp_path)
    with pytest.raises(ValueError, match="was trained with architecture 'dtrnn', not 'gru'"):
        train(dataclasses.replace(config, architecture="gru"), tmp_path)
    with pytest.raises(ValueError, match="already holds a run"):
        train(config, tmp_path, resume=False)


def test_another_default(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = TrainConfig(**{**SMALL, "iterations": 1, "architecture": "ffwd"})
    train(config, tmp_path)
    monkeypatch.setattr(training, "OUR_DELTA", 0.2)
    with pytest.raises(ValueError, match=r"was trained with delta_kl 0\.05, not 0\.2"):
        train(config, tmp_path)
    # nor does a checkpoint that does not say its step size pass for one with today's
    file = tmp_path / "checkpoint.pt"
    content = torch.load(file, weights_only=True)
    del content["delta_kl"]
    torch.save(content, file)
    with pytest.raises(ValueError, match=r"was trained with delta_kl None, not 0\.2"):
        train(config, tmp_path)


def test_another_version(tmp_path: Path) -> None:
    train(TrainConfig(**{**SMALL, "iterations": 1}), tmp_path)
    file = tmp_path / "checkpoint.pt"
    content = torch.load(file, weights_only=True)
    torch.save(content | {"format": 99}, file)
    with pytest.raises(ValueError, match="has checkpoint format 99, but this version"):
        Training.load(file)
    file.write_text("something else")
    with pytest.raises(ValueError, match="is not a checkpoint of `thesis train`"):
        Training.load(file)
    with pytest.raises(FileNotFoundError, match="make one with `thesis train`"):
        Training.load(tmp_path / "elsewhere.pt")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"task": "humanoid"}, "task 'humanoid' does not exist: choose one of Swimmer"),
        ({"architecture": "transformer"}, "architecture 'transformer' does not exist"),
        ({"terrain": "stairs"}, "choose one of flat, hill"),
        ({"algorithm": "sac"}, "choose one of trpo, vpg, natural, ppo"),
        ({"delta_kl": 0.0}, r"delta_kl is 0\.0, but it must be positive"),
        ({"delta_kl": -0.1}, r"delta_kl is -0\.1"),
        ({"iterations": 0}, "iterations is 0"),
        ({"batch_steps": 0}, "batch_steps is 0"),
        ({"worlds": 0}, "worlds is 0"),
        ({"seed": -1}, "seed is -1"),
        ({"precision": "float16"}, "choose one of float32, float64"),
        ({"features": "some"}, "choose one of thesis, full"),
    ],
)
def test_bad_arguments(options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        TrainConfig(**options)


def test_the_terminal_shows_progress_and_a_pipe_does_not(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    config = TrainConfig(**SMALL)
    train(config, report=TerminalReport(3))
    assert capsys.readouterr().err == ""
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    train(config, report=TerminalReport(3))
    shown = capsys.readouterr().err
    assert "iteration 3/3" in shown
    for word in ("return", "KL", "entropy", "steps/s", "left"):
        assert word in shown
