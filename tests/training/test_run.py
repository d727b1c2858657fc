"""Training runs: what they start from, that they can be resumed, and how they stop."""

import dataclasses
import errno
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch

from thesis_lib import imports
from thesis_lib.locomotion import BatchTask, Step
from thesis_lib.optimisation import TRPO, Learner, Rollouts, ValueNetwork, collect
from thesis_lib.policies import ARCHITECTURES, CTRNN, ESN, FeedforwardPolicy
from thesis_lib.training import checkpoint, parts
from thesis_lib.training import config as settings
from thesis_lib.training import run as running
from thesis_lib.training.checkpoint import code_digest
from thesis_lib.training.config import TrainConfig, step_size
from thesis_lib.training.curves import made
from thesis_lib.training.parts import make_batch_task, make_run_policy
from thesis_lib.training.run import CURVE_COLUMNS, TIMING_COLUMNS, Training, TrainingStopped
from thesis_lib.training.train import TerminalReport, default_directory, train

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


def test_every_iteration_draws_anew_and_noise_is_not_the_task_s(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    starts, noises, seeds = [], [], []
    reseed = BatchTask.reseed

    def reseeded(task: BatchTask, seed: np.random.SeedSequence) -> None:
        seeds.append(seed)
        reseed(task, seed)

    def collected(task: BatchTask, policy: Any, n: int, generator: np.random.Generator) -> Rollouts:
        before = generator.bit_generator.state
        noises.append(generator.standard_normal(100))
        generator.bit_generator.state = before
        rollouts = collect(task, policy, n, generator)
        starts.append(rollouts.observations[: rollouts.n_episodes, 0])  # heights at time 0
        return rollouts

    run = Training(TrainConfig(**SMALL))
    monkeypatch.setattr(BatchTask, "reseed", reseeded)
    monkeypatch.setattr(running, "collect", collected)
    run.step()
    run.step()
    assert np.ptp(starts[0]) > 0
    assert len(np.intersect1d(*starts)) == 0
    assert len(np.intersect1d(*noises)) == 0
    streams = [np.random.default_rng(seed).standard_normal(100) for seed in seeds]
    for noise in noises:
        for stream in streams:
            assert len(np.intersect1d(noise, stream)) == 0


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
    assert isinstance(parts.make_algorithm(asked), TRPO)
    assert step_size(asked) == 0.123


@pytest.mark.parametrize(
    ("task", "architecture", "seen"),
    [
        ("hopper", "dtrnn", 17),
        ("hopper", "dffwd", 20),
        ("swimmer", "lstm", 5),
        ("swimmer", "ffwd-400", 20),
        ("walker", "gru", 21),
    ],
)
def test_feature_subsets(task: str, architecture: str, seen: int) -> None:
    config = TrainConfig(task=task, architecture=architecture, num_envs=1)
    policy = make_run_policy(config)
    assert policy.feature_size == seen
    full = dataclasses.replace(config, features="full")
    assert make_run_policy(full).feature_size == policy.observation_size


def test_every_run_has_a_directory_of_its_own() -> None:
    config = TrainConfig(task="walker", terrain="hill", architecture="gru", seed=3)
    assert default_directory(config).parts[-3:] == (
        "_build",
        "runs",
        "walker2d-hill-gru-3",
    )


def test_settings_reach_the_policy() -> None:
    config = TrainConfig(
        task="walker", architecture="ctrnn", integrator="euler", time_constant=0.05, num_envs=1
    )
    policy = make_run_policy(config)
    assert isinstance(policy, CTRNN)
    assert (policy.dt, policy.integrator) == (0.005, "euler")
    assert policy.time_constants().tolist()[0] == pytest.approx(0.05)
    config = TrainConfig(task="hopper", architecture="esn", density=0.5, num_envs=1)
    reservoir = make_run_policy(config)
    assert isinstance(reservoir, ESN)
    assert (reservoir.spectral_radius, reservoir.density, reservoir.leak) == (1.1, 0.5, 0.5)
    assert settings.table_5_1("Ant", "esn", "spectral_radius") == 1.5
    assert settings.table_5_1("Ant", "esn", "weight_density") == 0.7


def _net(run: Training, name: str) -> Any:
    return getattr(run.policy, name)


def _rule(run: Training, name: str) -> Any:
    return getattr(run.learner.algorithm, name)


def _gram(run: Training) -> bool:
    assert isinstance(run.policy, FeedforwardPolicy)
    w = run.policy.get_parameter("layers.0.weight").detach()
    return bool(torch.allclose(w @ w.T, 2 * torch.eye(len(w)), atol=1e-5))


def _head(run: Training) -> float:
    return float(run.policy.head.weight.detach().abs().max())


def _baseline_of(run: Training) -> tuple[str, str]:
    return type(run.learner.baseline).__name__, run.learner.targets


ESN_RUN, CTRNN_RUN = {"architecture": "esn"}, {"architecture": "ctrnn"}
LSTM_RUN = {"architecture": "lstm"}
NATURAL, HILL = {"algorithm": "natural"}, {"terrain": "hill"}


def _tau_ratio(run: Training) -> float:
    tau = _net(run, "tau_raw")
    return round((tau.max() / tau.min()).item(), 4)


def _gates_orthogonal(run: Training) -> bool:
    """Whether the first gate's recurrent weights are 1.1 times an orthogonal matrix."""
    n = _net(run, "units")
    first = run.policy.recurrent.weight[:n].detach()  # type: ignore[union-attr,index]
    return torch.allclose(first @ first.T, 1.21 * torch.eye(n), atol=1e-5)


# option, its value, other settings, what it shall have changed, and to what
REACHED: list[tuple[str, Any, dict, Callable[[Training], Any], Any]] = [
    ("task", "ant", {}, lambda run: run.task.task.robot.name, "Ant"),
    ("terrain", "hill", {}, lambda run: run.task.model.nhfield, 1),
    ("architecture", "gru", {}, lambda run: _net(run, "architecture"), "gru"),
    ("seed", 3, {}, lambda run: run._seed("task").entropy, 3),
    ("batch_steps", 300, {}, lambda run: run.step()["steps"] >= 300, True),
    ("horizon", 25, {}, lambda run: run.task.max_episode_steps, 25),
    ("algorithm", "ppo", {}, lambda run: type(run.learner.algorithm).__name__, "PPO"),
    ("delta_kl", 0.03, {}, lambda run: _rule(run, "delta"), 0.03),
    ("delta_kl", 0.03, NATURAL, lambda run: _rule(run, "delta"), 0.03),
    ("learning_rate", 0.07, {"algorithm": "vpg"}, lambda run: _rule(run, "learning_rate"), 0.07),
    ("learning_rate", 0.07, {"algorithm": "ppo"}, lambda run: _rule(run, "learning_rate"), 0.07),
    ("discount", 0.9, {}, lambda run: run.learner.discount, 0.9),
    ("gae_lambda", 0.8, {}, lambda run: run.learner.gae_lambda, 0.8),
    ("bootstrap", True, {}, lambda run: run.learner.bootstrap, True),
    ("baseline", "network", {}, _baseline_of, ("ValueNetwork", "lambda")),
    ("cg_iterations", 3, {}, lambda run: _rule(run, "cg_iterations"), 3),
    ("cg_iterations", 3, NATURAL, lambda run: _rule(run, "cg_iterations"), 3),
    ("damping", 0.2, {}, lambda run: _rule(run, "damping"), 0.2),
    ("damping", 0.2, NATURAL, lambda run: _rule(run, "damping"), 0.2),
    ("kl_direction", "new_old", {}, lambda run: _rule(run, "kl_direction"), "new_old"),
    ("features", "full", {}, lambda run: _net(run, "feature_size"), 20),
    ("features", "text", {}, lambda run: _net(run, "feature_size"), 11),
    ("features", "literal", {}, lambda run: _net(run, "feature_size"), 16),
    ("features", "code", {"task": "Swimmer"}, lambda run: _net(run, "feature_size"), 3),
    ("difficulty", 0.2, HILL, lambda run: round(run.task.model.hfield_size[0, 2], 1), 0.2),
    ("maps", 2, HILL, lambda run: run.task.ground_id(1), 1),
    ("reading", "duan", {}, lambda run: run.task.task.alive_bonus, 1.0),
    ("alive_bonus", 0.7, {}, lambda run: run.task.task.alive_bonus, 0.7),
    ("units", 5, {}, lambda run: _net(run, "hidden_size"), 5),
    ("previous_action", False, {}, lambda run: _net(run, "previous_action"), False),
    ("integrator", "midpoint", CTRNN_RUN, lambda run: _net(run, "integrator"), "midpoint"),
    ("time_constant", 0.25, CTRNN_RUN, lambda run: _net(run, "tau_raw").tolist()[0], 0.25),
    ("time_constant_spread", 4.0, CTRNN_RUN, _tau_ratio, 4.0),
    ("trainable_time_constant", False, CTRNN_RUN, lambda r: r.policy.tau_raw.requires_grad, False),
    ("forget_bias", 0.5, LSTM_RUN, lambda run: _net(run, "gate_shift").max().item(), 0.5),
    ("gate_initialisation", "glorot", LSTM_RUN, _gates_orthogonal, False),
    ("gate_initialisation", "orthogonal", {"architecture": "gru"}, _gates_orthogonal, True),
    ("constraint", "softplus", CTRNN_RUN, lambda run: _net(run, "constraint"), "softplus"),
    ("spectral_radius", 0.7, ESN_RUN, lambda run: _net(run, "spectral_radius"), 0.7),
    ("density", 0.4, ESN_RUN, lambda run: _net(run, "density"), 0.4),
    ("leak", 0.3, ESN_RUN, lambda run: _net(run, "leak"), 0.3),
    ("initial_log_std", -0.5, {}, lambda run: run.policy.log_std.tolist(), [-0.5] * 3),
    ("initialisation", "orthogonal", {"architecture": "ffwd"}, _gram, True),
    ("head_scale", 0.0, {}, _head, 0.0),
    ("num_envs", 3, {}, lambda run: run.task.num_envs, 3),
    ("precision", "float64", {}, lambda run: run.policy.dtype, torch.float64),
    ("threads", 2, {}, lambda run: run.task.threads, 2),
]


@pytest.mark.parametrize(
    ("option", "value", "others", "probe", "expected"),
    REACHED,
    ids=lambda v: str(v) if isinstance(v, str | int | float) else "",
)
def test_every_option_reaches_what_it_is_for(
    option: str, value: Any, others: dict, probe: Callable[[Training], Any], expected: Any
) -> None:
    config = TrainConfig(**{**SMALL, **others})
    assert probe(Training(config)) != expected
    assert probe(Training(dataclasses.replace(config, **{option: value}))) == expected


def test_no_option_is_left_out() -> None:
    tested = {option for option, *_ in REACHED}
    # Those two decide when a run ends and saves, which the tests of resuming see.
    assert tested == {f.name for f in dataclasses.fields(TrainConfig)} - {
        "iterations",
        "checkpoint_every",
    }


def test_the_number_type_is_that_of_a_neural_baseline_too() -> None:
    for precision, dtype in settings.PRECISIONS.items():
        baseline = Training(TrainConfig(precision=precision, baseline="network")).learner.baseline
        assert isinstance(baseline, ValueNetwork)
        assert baseline.dtype == dtype


@pytest.mark.parametrize(
    ("architecture", "option"),
    [("dffwd", {"units": 5}), ("gru", {"initialisation": "orthogonal"})],
)
def test_what_a_sweep_sets_for_all_is_left_out_where_it_is_idle(
    architecture: str, option: dict
) -> None:
    config = TrainConfig(architecture=architecture, num_envs=1)
    asked = dataclasses.replace(config, **option)
    assert list(settings.idle_settings(asked)) == list(option)
    one, two = (make_run_policy(c) for c in (config, asked))
    assert torch.equal(one.parameter_vector(), two.parameter_vector())


def test_worlds_for_a_batch() -> None:
    assert make_batch_task(TrainConfig()).num_envs == 100
    assert make_batch_task(TrainConfig(batch_steps=10_000)).num_envs == 20
    assert make_batch_task(TrainConfig(batch_steps=100)).num_envs == 1


@pytest.mark.parametrize("reading", ["text", "literal", "code"])
def test_a_subset_of_sensors_is_for_two_robots(reading: str) -> None:
    config = TrainConfig(task="HalfCheetah", features=reading, num_envs=1)
    assert _net(Training(config), "feature_size") == 20


def test_the_best_batch_s_policy_is_kept(tmp_path: Path) -> None:
    config = TrainConfig(**{**SMALL, "iterations": 5}, checkpoint_every=1)
    starts = [make_run_policy(config).parameter_vector()]
    run = train(config, tmp_path, report=lambda run: starts.append(run.policy.parameter_vector()))
    batch = int(run.curve.mean_return.argmax())
    best = Training.load(tmp_path).best
    assert best is not None
    assert (best.iteration, best.mean_return) == (batch + 1, run.curve.mean_return.max())
    # The policy that collected a batch is the one the iteration before left.
    assert torch.equal(best.parameters, starts[batch])


@pytest.mark.parametrize("what", ["code", "torch"])
def test_a_run_of_other_code_or_versions_is_not_gone_on_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    config = TrainConfig(**{**SMALL, "iterations": 2})
    train(dataclasses.replace(config, iterations=1), tmp_path)
    now = checkpoint.made_with()
    monkeypatch.setattr(checkpoint, "made_with", lambda: now | {what: "0.0"})
    with pytest.raises(ValueError, match=f"was made with {what} .*, not 0.0, .* --any-version"):
        train(config, tmp_path)
    assert Training.load(tmp_path).iteration == 1
    same(train(config, tmp_path, any_version=True), train(config))


def test_who_made_a_run_stays_known(tmp_path: Path) -> None:
    config = TrainConfig(**SMALL)
    train(config, tmp_path)

    def record() -> dict[str, Any]:
        found: dict[str, Any] = json.loads((tmp_path / "run.json").read_text())
        return found

    def of_another_commit(**changes: Any) -> None:
        content = torch.load(tmp_path / "checkpoint.pt", weights_only=True)
        content["made_by"]["commit"] = "0123456789ab"
        torch.save(content | changes, tmp_path / "checkpoint.pt")

    now = record()["commit"]
    of_another_commit()
    for iterations in (3, 4):  # nothing left to do, and one more by the same code
        train(dataclasses.replace(config, iterations=iterations), tmp_path)
        assert record()["commit"] == "0123456789ab"
    of_another_commit(made_with={"code": "other"})
    longer = dataclasses.replace(config, iterations=4)
    train(longer, tmp_path, any_version=True)
    assert record()["commit"] == "0123456789ab"
    with pytest.raises(ValueError, match="was made with code other"):
        train(longer, tmp_path)
    train(dataclasses.replace(config, iterations=5), tmp_path, any_version=True)
    assert record()["commit"] == now
    assert record()["continued_from"]["commit"] == "0123456789ab"
    assert made(record())["continued_from"] == record()["continued_from"]


def test_a_checkpoint_of_before_its_maker_was_kept_is_gone_on_with(tmp_path: Path) -> None:
    config = TrainConfig(**SMALL)
    train(config, tmp_path)
    content = torch.load(tmp_path / "checkpoint.pt", weights_only=True)
    del content["made_by"]
    torch.save(content, tmp_path / "checkpoint.pt")
    longer = dataclasses.replace(config, iterations=4)
    same(train(longer, tmp_path), train(longer))
    record = json.loads((tmp_path / "run.json").read_text())
    assert record["code"] == code_digest()
    assert "continued_from" not in record


def test_the_code_digest_sees_every_module_that_decides_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy = tmp_path / "thesis_lib"
    ignore = shutil.ignore_patterns("__pycache__")
    shutil.copytree(Path(imports.__file__).parent, copy, ignore=ignore)
    monkeypatch.setattr(checkpoint, "_LIBRARY", copy)
    digest = checkpoint.code_digest.__wrapped__
    before = digest()
    assert before == checkpoint.code_digest()
    for changed in (
        "locomotion/batch.py",
        "policies/vanilla.py",
        "optimisation/trpo.py",
        "training/config.py",
        "training/parts.py",
        "training/run.py",
        "published/table-5.1.csv",
    ):
        with (copy / changed).open("a") as file:
            file.write("# other\n")
        assert digest() != before, changed
        before = digest()
    for other in ("cli.py", "training/evaluation.py", "training/sweep.py"):
        (copy / other).write_text("")
        assert digest() == before, other


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


def test_an_update_to_infinity_is_not_saved(tmp_path: Path) -> None:
    config = TrainConfig(algorithm="vpg", learning_rate=1e300, **SMALL)
    config = dataclasses.replace(config, checkpoint_every=1)
    with pytest.raises(
        TrainingStopped, match=r"in iteration 1: parameter .* of iteration 0, is in"
    ):
        train(config, tmp_path)
    good = Training.load(tmp_path)
    assert good.iteration == 0
    good.policy.check_finite()


@pytest.mark.parametrize("full", ["torch.save", "pandas.DataFrame.to_csv"])
def test_a_full_disk_stops_the_run_and_spares_the_checkpoint(
    full: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = TrainConfig(**{**SMALL, "iterations": 6, "checkpoint_every": 2})

    def fill_up(run: Training) -> None:
        if run.iteration == 3:
            error = OSError(errno.ENOSPC, "No space left on device")

            def refuse(*arguments: Any, **options: Any) -> None:
                raise error

            monkeypatch.setattr(full, refuse)

    # the checkpoint comes first, so that without room for the curve it is the newer one
    kept = 2 if full == "torch.save" else 4
    with pytest.raises(TrainingStopped) as stopped:
        train(config, tmp_path, report=fill_up)
    assert str(stopped.value) == (
        "training stopped after iteration 4, which could not be saved (No space left on device): "
        f"make room, and give the same command again. The last good checkpoint, of iteration "
        f"{kept}, is in {str(tmp_path)!r}."
    )
    assert sorted(p.name for p in tmp_path.iterdir()) == ["checkpoint.pt", "curve.csv", "run.json"]
    monkeypatch.undo()
    assert Training.load(tmp_path).iteration == kept
    same(train(config, tmp_path), train(config))


def test_no_room_for_the_first_checkpoint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: Any, **options: Any) -> None:
        raise OSError(errno.EFBIG, "File too large")

    monkeypatch.setattr("torch.save", refuse)
    with pytest.raises(TrainingStopped, match=r"\(File too large\): .* There is no checkpoint in"):
        train(TrainConfig(**SMALL), tmp_path)
    assert list(tmp_path.iterdir()) == []


GONE, HELD = object(), ("config", "policy", "baseline", "rows", "iteration")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        *(({name: GONE}, f"has no {name}: train again") for name in HELD),
        ({"policy": None}, "has no policy"),
        ({"iteration": "three"}, "has no iteration"),
        ({"iteration": 2}, "has another curve than that of its 2 iterations"),
        ({"rows": [{}, {}, {}]}, "has another curve than that of its 3 iterations"),
        ({"rows": [1, 2, 3]}, "has another curve than that of its 3 iterations"),
        ({"baseline": {}}, "has a baseline that does not fit this run"),
        ({"baseline": {"weights": torch.ones(7)}}, "has a baseline that does not fit this run"),
        (
            {"baseline": {"weights": torch.full((38,), float("nan"))}},
            "has a baseline that does not fit this run",
        ),
        ({"policy": {}}, "has parameters that are not those of dtrnn"),
    ],
)
def test_a_checkpoint_with_a_hole(change: dict, message: str, tmp_path: Path) -> None:
    run = train(TrainConfig(**SMALL), tmp_path)
    assert run.policy.feature_size == 17  # so that a baseline has 2 * 17 + 4 = 38 weights
    file = tmp_path / "checkpoint.pt"
    content = torch.load(file, weights_only=True)
    torch.save({k: v for k, v in (content | change).items() if v is not GONE}, file)
    with pytest.raises(ValueError, match=message):
        Training.load(tmp_path)


def test_a_checkpoint_with_a_parameter_that_is_not_finite(tmp_path: Path) -> None:
    train(TrainConfig(**SMALL), tmp_path)
    file = tmp_path / "checkpoint.pt"
    content = torch.load(file, weights_only=True)
    content["policy"]["head.bias"][0] = float("nan")
    torch.save(content, file)
    with pytest.raises(ValueError, match="has a parameter that is not finite: train again"):
        Training.load(tmp_path)


def test_a_checkpoint_without_the_state_of_ppo(tmp_path: Path) -> None:
    train(TrainConfig(algorithm="ppo", **SMALL), tmp_path)
    file = tmp_path / "checkpoint.pt"
    content = torch.load(file, weights_only=True)
    for broken in (content | {"algorithm": None}, {k: content[k] for k in content if k[0] != "a"}):
        torch.save(broken, file)
        with pytest.raises(ValueError, match="has no state of ppo: train again"):
            Training.load(tmp_path)


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


def test_a_bad_observation_is_told_on_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    step = BatchTask.step

    def spoilt(task: BatchTask, actions: np.ndarray) -> Step:
        outcome = step(task, actions)
        outcome.observation[:] = -1.2345678e-200
        outcome.observation[0, 0] = np.nan
        return outcome

    monkeypatch.setattr(BatchTask, "step", spoilt)
    with pytest.raises(TrainingStopped, match="the observation in world 0 at step 0 ") as stopped:
        train(TrainConfig(task="Ant", architecture="ffwd", **SMALL))
    assert "\n" not in str(stopped.value)


def test_another_run_in_the_directory(tmp_path: Path) -> None:
    config = TrainConfig(**{**SMALL, "iterations": 1})
    train(config, tmp_path)
    with pytest.raises(ValueError, match="was trained with architecture 'dtrnn', not 'gru'"):
        train(dataclasses.replace(config, architecture="gru"), tmp_path)
    with pytest.raises(ValueError, match="already holds a run"):
        train(config, tmp_path, resume=False)


def test_a_setting_without_effect_does_not_part_runs(tmp_path: Path) -> None:
    config = TrainConfig(**{**SMALL, "iterations": 1}, architecture="ffwd", time_constant=1.0)
    train(config, tmp_path)
    again = train(dataclasses.replace(config, time_constant=0.2, iterations=2), tmp_path)
    assert again.iteration == 2


def test_another_default(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = TrainConfig(**{**SMALL, "iterations": 1, "architecture": "ffwd"})
    train(config, tmp_path)
    monkeypatch.setattr(settings, "OUR_DELTA", 0.2)
    with pytest.raises(ValueError, match=r"was trained with delta_kl 0\.05, not 0\.2"):
        train(config, tmp_path)
    # nor does a checkpoint that does not say its step size pass for one with today's
    file = tmp_path / "checkpoint.pt"
    content = torch.load(file, weights_only=True)
    del content["delta_kl"]
    torch.save(content, file)
    with pytest.raises(ValueError, match=r"was trained with delta_kl None, not 0\.2"):
        train(config, tmp_path)


@pytest.mark.parametrize(
    ("architecture", "scale"),
    [("ffwd", 0.1), ("gru", 0.1), ("lstm", 0.1), ("esn", 0.1), ("dffwd", 1.0)],
)
def test_where_the_output_layer_starts(architecture: str, scale: float) -> None:
    """Against the author's law, U(-a, a) with a = sqrt(6 / (inputs + outputs))."""
    config = TrainConfig(**SMALL, architecture=architecture)
    weight = Training(config).policy.head.weight
    whole = Training(dataclasses.replace(config, head_scale=1.0)).policy.head.weight
    outputs, inputs = whole.shape
    assert whole.abs().max() <= (6 / (inputs + outputs)) ** 0.5
    assert torch.allclose(weight, scale * whole)


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
        ({"num_envs": 0}, "num_envs is 0"),
        ({"seed": -1}, "seed is -1"),
        ({"precision": "float16"}, "choose one of float32, float64"),
        ({"features": "some"}, "choose one of thesis, text, literal"),
        ({"task": 3}, "task is 3, but it must be text"),
        ({"iterations": 2.5}, r"iterations is 2\.5, but it must be a whole number"),
        ({"iterations": None}, "iterations is None, but it must be a whole number"),
        ({"bootstrap": "yes"}, "bootstrap is 'yes', but it must be True or False"),
        *(
            ({name: value}, f"{name} is {value}, but it must be a finite number")
            for name in ("initial_log_std", "head_scale", "time_constant", "leak", "alive_bonus")
            for value in (float("nan"), float("inf"))
        ),
        ({"difficulty": float("nan")}, "difficulty is nan, but it must be a finite number"),
        ({"initial_log_std": 400.0}, r"initial_log_std is 400\.0, .* between -10 and 10: less"),
        ({"initial_log_std": -1000.0}, "initial_log_std is -1000"),
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
    assert " 3/3 [" in shown
    for word in ("return", "KL", "entropy", "steps/s"):
        assert word in shown


@pytest.mark.parametrize(
    "options",
    [
        {"algorithm": "ppo", "architecture": "gru"},
        {"baseline": "network", "architecture": "ctrnn"},
        {"architecture": "esn"},
    ],
)
@pytest.mark.parametrize("moment", ["sampled", "learned", "told"])
def test_an_interrupted_run_keeps_all_whole_iterations(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: dict, moment: str
) -> None:
    """Whether it comes while sampling, at the end of learning, or after it."""
    config = TrainConfig(**{**SMALL, "iterations": 4}, **options)
    calls = []

    def interrupted(function: Callable[..., Any]) -> Callable[..., Any]:
        def called(*arguments: Any, **keywords: Any) -> Any:
            result = function(*arguments, **keywords)
            calls.append(function)
            if len(calls) == 3:
                raise KeyboardInterrupt
            return result

        return called

    with monkeypatch.context() as patch:
        if moment == "sampled":
            patch.setattr(running, "collect", interrupted(collect))
        elif moment == "told":
            patch.setattr(Training, "_row", interrupted(Training._row))
        else:
            patch.setattr(Learner, "improve", interrupted(Learner.improve))
        with pytest.raises(KeyboardInterrupt):
            train(config, tmp_path)
    assert Training.load(tmp_path).iteration == 2
    same(train(config, tmp_path), train(config))


def test_numpy_numbers_are_plain_at_the_boundary(tmp_path: Path) -> None:
    delta, tau = np.geomspace(0.01, 0.1, 2)
    config = TrainConfig(
        delta_kl=delta,
        architecture=np.str_("ctrnn"),
        time_constant=np.array(tau),
        bootstrap=np.True_,
        seed=np.int64(3),
        batch_steps=np.int32(100),
        horizon=np.uint8(20),
        iterations=np.int64(2),
    )
    for name, value in vars(config).items():
        assert type(value) in (str, int, float, bool, type(None)), name
    run = train(config, tmp_path)
    same(Training.load(tmp_path), run)
    assert json.loads((tmp_path / "run.json").read_text())["config"] == vars(config)
    with pytest.raises(ValueError, match=r"iterations is 2\.0, but it must be a whole number"):
        TrainConfig(iterations=np.float64(2.0))
    with pytest.raises(ValueError, match=r"delta_kl is array.*, but it must be a fin") as raised:
        TrainConfig(delta_kl=np.ones((40, 3)))
    assert "\n" not in str(raised.value)


def test_a_damaged_checkpoint_says_what_to_do(tmp_path: Path) -> None:
    train(TrainConfig(**{**SMALL, "iterations": 1}), tmp_path)
    file = tmp_path / "checkpoint.pt"
    file.write_bytes(file.read_bytes()[:-1000])
    with pytest.raises(ValueError, match="or is damaged: name another, or remove it and train"):
        Training.load(tmp_path)
