"""Tests of trained policies."""

from pathlib import Path

import av
import gymnasium
import numpy as np
import pandas as pd
import pytest
import torch
from PIL import Image

from thesis_lib import cli
from thesis_lib.locomotion.perturbations import (
    ActionDelay,
    ActuatorFailure,
    FrictionChange,
    MassChange,
    Push,
    SensorFailure,
    TerrainSwitch,
    WhiteNoise,
)
from thesis_lib.locomotion.rendering import NoGL, choose_backend
from thesis_lib.optimisation import run_episodes
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.disturbances import Disturbances, parse_perturbation
from thesis_lib.training.evaluation import (
    SUMMARY_COLUMNS,
    EvaluateConfig,
    evaluate,
    idle_settings,
    summarised,
    task_for,
)
from thesis_lib.training.film import check_film, film, positions
from thesis_lib.training.run import Training
from thesis_lib.training.train import train

torch.set_num_threads(1)
SHORT = EvaluateConfig(runs=3, steps=60)


@pytest.fixture(scope="module")
def cheetah(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cheetah")
    config = TrainConfig(
        task="HalfCheetah", architecture="gru", iterations=2, batch_steps=400, horizon=100
    )
    train(config, folder)
    return folder


def test_a_row_for_every_run(cheetah: Path) -> None:
    table = evaluate(cheetah, SHORT)
    assert list(table.columns) == ["run", "return", "length", "terminated"]
    assert table.length.tolist() == [60, 60, 60]
    assert not table.terminated.any()
    assert table["return"].nunique() == 3
    again = evaluate(Training.load(cheetah), SHORT)
    pd.testing.assert_frame_equal(again, table)


def test_returns_are_those_of_the_greedy_policy(cheetah: Path) -> None:
    run = Training.load(cheetah)
    task = task_for(run, SHORT)
    observation = task.reset()
    state, action = run.policy.initial_state(3), torch.zeros(3, 6)
    total = np.zeros(3)
    for _ in range(60):
        with torch.no_grad():
            action, state = run.policy.step(torch.from_numpy(observation), action, state)
        step = task.step(action.double().numpy())
        observation, total = step.observation, total + step.reward
    np.testing.assert_allclose(evaluate(run, SHORT)["return"], total, rtol=1e-9)


def test_perturbations_change_the_return(cheetah: Path) -> None:
    base = evaluate(cheetah, SHORT)["return"]
    late = EvaluateConfig(runs=3, steps=60, perturbations=("WhiteNoise(onset=60)",))
    assert evaluate(cheetah, late)["return"].equals(base)
    for text in ("WhiteNoise(onset=20)", "MassChange(factor=2.0, onset=0)"):
        config = EvaluateConfig(runs=3, steps=60, perturbations=(text,))
        assert (evaluate(cheetah, config)["return"] != base).all()
    hills = evaluate(cheetah, EvaluateConfig(runs=3, steps=60, terrain="hill"))
    assert len(hills) == 3


def test_a_stochastic_policy_can_be_tested_too(cheetah: Path) -> None:
    noisy = EvaluateConfig(runs=3, steps=60, greedy=False)
    assert (evaluate(cheetah, noisy)["return"] != evaluate(cheetah, SHORT)["return"]).all()
    assert evaluate(cheetah, noisy).equals(evaluate(cheetah, noisy))


def test_text_becomes_a_perturbation() -> None:
    assert parse_perturbation("WhiteNoise") == WhiteNoise()
    assert parse_perturbation(" WhiteNoise(sigma=0.5, onset=7) ") == WhiteNoise(0.5, 7)
    assert parse_perturbation("TerrainSwitch(difficulty=0.5)") == TerrainSwitch(0.5)
    assert parse_perturbation("MassChange(factor=1.5)") == MassChange(1.5)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("Earthquake", "perturbation 'Earthquake' does not exist: choose one of WhiteNoise"),
        ("WhiteNoise(0.5)", "write a name with its fields as keywords"),
        ("WhiteNoise(sigma=)", "write a name with its fields as keywords"),
        ("WhiteNoise(sigma=open('x'))", "write a name with its fields as keywords"),
        ("WhiteNoise(power=2)", "WhiteNoise has no field 'power': its fields are"),
        ("ActionDelay(steps=-1)", "steps is -1"),
        ("ActuatorFailure", "is incomplete"),
    ],
)
def test_text_that_is_no_perturbation(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        parse_perturbation(text)


def test_a_film(cheetah: Path, tmp_path: Path) -> None:
    config = EvaluateConfig(runs=2, steps=20)
    try:
        choose_backend()
    except NoGL:  # a machine that cannot draw must say so
        with pytest.raises(NoGL, match="apt-get install"):
            film(cheetah, tmp_path / "run.webp", config)
        return
    path = film(cheetah, tmp_path / "run.webp", config, run=1, width=96, height=64)
    with Image.open(path) as picture:
        # 20 steps of 0.01 s, of which every 4th is shown
        assert (picture.n_frames, picture.size) == (5, (96, 64))
    for suffix in (".mp4", ".webm"):
        path = film(cheetah, tmp_path / f"run{suffix}", config, width=96, height=64)
        with av.open(str(path)) as video:
            (stream,) = video.streams
            assert isinstance(stream, av.VideoStream)
            assert (stream.width, stream.height, stream.average_rate) == (96, 64, 25)
            assert sum(1 for _ in video.decode(stream)) == 5


def test_a_video_without_its_package_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("thesis_lib.training.film.find_spec", lambda name: None)
    with pytest.raises(
        ValueError, match=r"pip install 'thesis_lib\[film\]', or choose one of \.webp"
    ):
        check_film(tmp_path / "run.mp4", EvaluateConfig())


def test_a_film_shows_the_run_that_was_tested(cheetah: Path) -> None:
    run = Training.load(cheetah)
    config = EvaluateConfig(runs=2, steps=30, greedy=False, seed=4)
    seen = positions(task_for(run, config), run.policy, 1, np.random.default_rng(4))
    task = task_for(run, config)
    rollouts = run_episodes(task, run.policy, np.random.default_rng(4))
    # what the policy sees of the pose: all of it but the place
    poses = rollouts.padded("observations")[:, 1, :8]
    np.testing.assert_allclose(seen[:, 1:], poses, rtol=1e-12)
    assert rollouts.episode_returns[1] == evaluate(run, config)["return"][1]


def test_disturbances_in_short(cheetah: Path) -> None:
    assert Disturbances().perturbations() == ()
    everything = Disturbances(
        noise=0.5,
        dead_sensors=("pitch",),
        switch_at="3.5",
        dead_actuators=("bshin",),
        delay=2,
        mass=1.5,
        friction=0.7,
        push=(0.0, 1.0, 0.0),
        onset=9,
    )
    assert everything.perturbations(difficulty=0.3, seed=8) == (
        TerrainSwitch(0.3, 3.5, seed=8),
        MassChange(1.5, onset=9),
        FrictionChange(0.7, onset=9),
        ActuatorFailure(("bshin",), onset=9),
        ActionDelay(2, onset=9),
        Push((0.0, 1.0, 0.0), onset=9),
        WhiteNoise(0.5, 9),
        SensorFailure(("pitch",), onset=9),
    )
    config = EvaluateConfig(runs=3, steps=60, difficulty=0.3, seed=8).disturbed(everything)
    assert tuple(map(parse_perturbation, config.perturbations)) == everything.perturbations(0.3, 8)
    assert len(evaluate(cheetah, config)) == 3


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"noise": -1.0}, "sigma is -1.0"),
        ({"switch_at": "soon"}, "switch_at is 'soon', but it must be metres, or task"),
        ({"delay": 0}, "steps is 0"),
        ({"mass": 0.0}, "factor is 0.0"),
        ({"friction": -1.0}, "factor is -1.0"),
        ({"push": (0.0, 1.0)}, "push has 2 entries, .* must have 3"),
        ({"noise": 1.0, "onset": -3}, "onset is -3"),
    ],
)
def test_disturbances_that_cannot_be(given: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Disturbances(**given).perturbations()


@pytest.mark.parametrize(
    ("config", "given", "idle"),
    [
        ({}, {}, []),
        ({"difficulty": 0.3}, {}, ["difficulty"]),
        ({"difficulty": 0.3}, {"noise": 1.0}, ["difficulty"]),
        ({"difficulty": 0.3, "terrain": "hill"}, {}, []),
        ({"difficulty": 0.3}, {"switch_at": "task"}, []),
        ({}, {"onset": 3}, ["onset"]),
        ({}, {"onset": 3, "switch_at": "2"}, ["onset"]),
        ({"perturbations": ("WhiteNoise",)}, {"onset": 3}, ["onset"]),
        ({"difficulty": 0.3}, {"onset": 3}, ["difficulty", "onset"]),
        ({}, {"onset": 3, "noise": 0.0}, []),
        ({}, {"onset": 3, "dead_sensors": ("pitch",)}, []),
        ({}, {"onset": 3, "push": (0.0, 1.0, 0.0)}, []),
    ],
)
def test_settings_without_effect(config: dict, given: dict, idle: list[str]) -> None:
    assert list(idle_settings(EvaluateConfig(**config), Disturbances(**given))) == idle


def test_hills_come_once() -> None:
    with pytest.raises(ValueError, match="a switch starts on flat ground"):
        EvaluateConfig(terrain="hill").disturbed(Disturbances(switch_at="task"))


def test_summary_by_hand() -> None:
    table = pd.DataFrame(
        {
            "run": [0, 1, 2, 3],
            "return": [1.0, 2.0, 3.0, 6.0],
            "length": [10, 20, 20, 30],
            "terminated": [True, False, False, False],
        }
    )
    (row,) = summarised(table).to_dict("records")
    assert list(row) == list(SUMMARY_COLUMNS)
    assert (row["n"], row["mean_return"], row["min"], row["max"]) == (4, 3, 1, 6)
    assert row["sd"] == pytest.approx(np.sqrt(14 / 3))
    # Student's t with 3 degrees of freedom: 3.182446 at 97.5%
    half = 3.182446305 * np.sqrt(14 / 3) / 2
    assert (row["low"], row["high"]) == pytest.approx((3 - half, 3 + half))
    assert (row["mean_length"], row["terminated"]) == (20, 0.25)
    assert np.isnan(summarised(table[:1]).low[0])


def test_positions_are_those_before_every_step(cheetah: Path) -> None:
    run = Training.load(cheetah)
    states = positions(task_for(run, SHORT), run.policy, world=2)
    task = task_for(run, SHORT)
    task.reset()
    assert states.shape == (60, 9)
    np.testing.assert_array_equal(states[0], task.qpos[2])


def test_bad_arguments(cheetah: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="runs is 0"):
        EvaluateConfig(runs=0)
    with pytest.raises(ValueError, match="choose one of flat, hill"):
        EvaluateConfig(terrain="stairs")
    with pytest.raises(ValueError, match="choose one of train, test, never"):
        EvaluateConfig(termination="sometimes")
    with pytest.raises(ValueError, match=r"cannot be written as '\.mov'"):
        film(cheetah, tmp_path / "run.mov")
    with pytest.raises(ValueError, match="the runs are 0 to 2"):
        film(cheetah, tmp_path / "run.gif", SHORT, run=3)


# ------------------------------------------------------------- an environment of Gymnasium's
@pytest.fixture(scope="module")
def pendulum() -> Training:
    return train(TrainConfig("Pendulum-v1", architecture="gru", batch_steps=40, horizon=20,
                             iterations=1))  # fmt: skip


def test_returns_on_an_environment_are_those_of_the_greedy_policy(pendulum: Training) -> None:
    table = evaluate(pendulum, EvaluateConfig(runs=2, steps=30, seed=4))
    assert table.length.tolist() == [30, 30]
    assert not table.terminated.any()
    for i, seed in enumerate(np.random.SeedSequence(4).generate_state(2)):
        env = gymnasium.make("Pendulum-v1")
        seen, _ = env.reset(seed=int(seed))
        state, action, total = pendulum.policy.initial_state(1), torch.zeros(1, 1), 0.0
        for _ in range(30):
            with torch.no_grad():
                action, state = pendulum.policy.step(torch.from_numpy(seen[None]), action, state)
            seen, reward, *_ = env.step(2 * action[0].clamp(-1, 1).numpy())  # bounds in Nm
            total += float(reward)
        assert table["return"][i] == pytest.approx(total, rel=1e-5)


@pytest.mark.parametrize(
    "given", [{"terrain": "hill"}, {"perturbations": ("WhiteNoise()",)}, {"termination": "never"}]
)
def test_what_only_a_robot_has_is_refused_elsewhere(pendulum: Training, given: dict) -> None:
    with pytest.raises(
        ValueError, match=f"Pendulum-v1 is no robot's name.*: leave {next(iter(given))}"
    ):
        evaluate(pendulum, EvaluateConfig(**given))


def test_no_film_is_made_of_what_is_no_robot(pendulum: Training, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"Pendulum-v1 is no robot's name.*: leave film out"):
        film(pendulum, tmp_path / "run.gif", SHORT)
    pendulum.save(tmp_path / "run")
    command = ["evaluate", str(tmp_path / "run"), "--film", str(tmp_path / "run.gif")]
    assert cli.main(command) == 2
    assert not (tmp_path / "run.gif").exists()
