"""Environments by id, and what an installed package adds to the library by its entry points."""

import os
import subprocess
import sys
from importlib.resources import files
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from thesis_lib import cli, registration
from thesis_lib.domains import environments
from thesis_lib.locomotion import BatchTask, robots
from thesis_lib.locomotion.rendering import View, film, portrait
from thesis_lib.locomotion.terrain import hill_maps
from thesis_lib.policies import make_policy
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.disturbances import parse_perturbation
from thesis_lib.training.evaluation import EvaluateConfig, evaluation_task
from thesis_lib.training.grid import run_name
from thesis_lib.training.run import Training
from thesis_lib.training.train import default_directory

ROOT = Path(__file__).parents[1]
PACKAGE = """
from dataclasses import dataclass, replace
from thesis_lib.domains import Domain, triangle
from thesis_lib.locomotion.batch import Effect, Perturbation
from thesis_lib.locomotion.robots import ROBOTS, Limits
from thesis_lib.policies import FeedforwardPolicy

def two_triangles(discount=0.9):
    whole = triangle(discount=discount)
    return Domain("two triangles", tuple(whole.tasks[:2]))

def linear(observation_size, action_size, *, units, dt, **options):
    return FeedforwardPolicy(observation_size, action_size, hidden=(), **options)

@dataclass(frozen=True)
class Tailwind(Perturbation):
    newton: float = 1.0
    onset: int = 0
    def attach(self, context):
        return Blow(self.newton)

class Blow(Effect):
    def __init__(self, newton):
        self.newton = newton
    def on_force(self, t, xfrc_applied, worlds):
        xfrc_applied[worlds, 1, 0] += self.newton

POGO = replace(
    ROBOTS["Hopper"], name="Pogo", xml=XML, limits=Limits(low=0.9)
)
"""
ENTRY_POINTS = """
[thesis_lib.domains]
TwoTriangles = my_package:two_triangles
[thesis_lib.architectures]
linear = my_package:linear
ffwd = my_package:linear
broken = my_package:absent
[thesis_lib.perturbations]
Tailwind = my_package:Tailwind
[thesis_lib.robots]
Pogo = my_package:POGO
"""


def install(folder: Path, name: str, entry_points: str) -> None:
    """What an installer leaves behind that Python looks for."""
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(entry_points)


@pytest.fixture
def package(tmp_path, monkeypatch):
    xml = tmp_path / "pogo.xml"
    xml.write_text(files("gymnasium").joinpath("envs/mujoco/assets/hopper.xml").read_text())
    (tmp_path / "my_package.py").write_text(PACKAGE.replace("XML", repr(str(xml)), 1))
    install(tmp_path, "my_package", ENTRY_POINTS)
    monkeypatch.syspath_prepend(str(tmp_path))
    before = set(gymnasium.registry)
    registration.register()
    yield tmp_path
    for added in set(gymnasium.registry) - before:
        del gymnasium.registry[added]
    sys.modules.pop("my_package", None)


def test_the_names_are_those_of_the_library():
    assert tuple(environments.DOMAINS) == registration.DOMAINS
    assert tuple(robots.ROBOTS) == registration.ROBOTS


@pytest.mark.parametrize(
    "program",
    [
        "import gymnasium, thesis_lib; make = gymnasium.make; name = 'thesis/Hopper-v0'",
        "from gymnasium import make; name = 'thesis_lib:thesis/Hopper-v0'",
    ],
)
def test_import_of_the_package_is_enough(program):
    check = (
        "; import sys; assert 'mujoco' not in sys.modules; print(make(name).reset(seed=0)[0].shape)"
    )
    done = subprocess.run([sys.executable, "-c", program + check], capture_output=True, text=True)
    assert done.stdout.strip() == "(20,)", done.stderr


def test_every_id_makes_an_environment():
    ids = [name for name in gymnasium.registry if name.startswith("thesis/")]
    assert len(ids) == len(environments.DOMAINS) + 1 + 2 * len(robots.ROBOTS)
    for name in ids:
        env = gymnasium.make(name)
        observation, _ = env.reset(seed=0)
        assert env.observation_space.contains(observation)


def test_a_domain_of_ones_own(package):
    env = gymnasium.make("thesis/TwoTriangles-v0", task=1, discount=0.5)
    assert env.unwrapped.mdp.discount == 0.5
    with pytest.raises(ValueError, match="domain 'two triangles' has tasks 0 to 1"):
        gymnasium.make("thesis/TwoTriangles-v0", task=2)


def test_an_architecture_of_ones_own(package):
    policy = make_policy("linear", 4, 2, dt=0.1, seed=1)
    assert policy.architecture == "linear"
    assert policy.n_trainable == 4 * 2 + 2 + 2  # weights, biases, log deviations
    with pytest.raises(ValueError, match=r"architecture 'cubic' does not exist.*, linear"):
        make_policy("cubic", 4, 2, dt=0.1)


def test_what_is_built_in_keeps_its_name(package):
    assert make_policy("ffwd", 4, 2, dt=0.1).n_trainable == 4 * 6 + 6 + 6 * 2 + 2 + 2


CLASHES = """
[thesis_lib.domains]
Hopper = my_package:two_triangles
Heat = my_package:two_triangles
two words = my_package:two_triangles
TwoTriangles = my_package:others
[thesis_lib.robots]
AntHill = my_package:POGO
"""
TELL = """
import gymnasium, thesis_lib
for name in ("Hopper", "Heat", "AntHill", "TwoTriangles"):
    spec = gymnasium.spec(f"thesis/{name}-v0")
    print(spec.entry_point.rpartition(":")[2], *spec.kwargs.values())
"""


def test_no_package_takes_an_id_or_keeps_the_library_from_being_imported(package):
    install(package, "other", CLASHES)
    paths = {"PYTHONPATH": f"{package}{os.pathsep}{ROOT}"}
    done = subprocess.run(
        [sys.executable, "-c", TELL], capture_output=True, text=True, env={**os.environ, **paths}
    )
    told = ["LocomotionEnv Hopper", "HeatEnv", "LocomotionEnv Ant 0.5", "make TwoTriangles"]
    assert done.stdout.splitlines() == told, done.stderr
    assert "domain 'two words' gets no id in Gymnasium" in done.stderr
    with pytest.raises(ValueError, match=r"domain 'TwoTriangles' is offered as .* and as "):
        gymnasium.make("thesis/TwoTriangles-v0", task=1)


def test_a_perturbation_of_ones_own(package):
    wind = parse_perturbation("Tailwind(newton=30.0)")
    pushed, left = (BatchTask("Hopper", 1, perturbations=p) for p in ((wind,), ()))
    for task in (pushed, left):
        task.reset()
        for _ in range(5):
            task.step(np.zeros((1, 3)))
    # v = F t / m, while nothing else pushes along x
    gained = (pushed.com - left.com)[0, 0]
    mass, time = robots.total_mass(left.model), 5 * left.task.robot.control_dt
    assert gained == pytest.approx(0.5 * 30.0 / mass * time**2, rel=0.25)


def test_a_robot_of_ones_own(package):
    env = gymnasium.make("thesis/Pogo-v0")
    observation, _ = env.reset(seed=0)
    names = env.unwrapped.task.sensor_names
    assert observation.shape == (len(names),) == (6 + 6 + 3,)
    assert names[:3] == ("z", "x", "pitch")
    env.unwrapped.set_state([0.0, 0.85, 0.0, 0.0, 0.0, 0.0], np.zeros(6))
    assert env.step(np.zeros(3))[2]
    with pytest.raises(ValueError, match="robot"):
        gymnasium.make("thesis/Pogo-v0", difficulty=0.5)


def test_a_robot_without_a_view_of_its_own_is_seen_from_the_side(package):
    size = {"width": 60, "height": 40}
    hopper = portrait("Hopper", view=View(3.6), **size)
    np.testing.assert_array_equal(portrait("Pogo", **size), hopper)
    at_start = [robots.get_robot("Pogo").init_qpos]
    np.testing.assert_array_equal(film("Pogo", at_start, **size)[0], hopper)


def test_a_package_that_cannot_be_loaded_is_named(package, tmp_path, capsys):
    with pytest.raises(ImportError, match="architecture 'broken' is offered as my_package:absent"):
        make_policy("broken", 4, 2, dt=0.1)
    out = tmp_path / "run"
    assert cli.main(["train", "--architecture", "broken", "--out", str(out)]) == 1
    error = capsys.readouterr().err
    assert error.startswith("thesis: architecture 'broken' is offered as my_package:absent")
    assert error.count("\n") == 1


def test_two_packages_with_one_name_are_refused(package):
    install(package, "other", "[thesis_lib.architectures]\nlinear = other:linear\n")
    with pytest.raises(ValueError, match=r"'linear' is offered as (my_package|other):linear"):
        make_policy("linear", 4, 2, dt=0.1)


def test_a_package_s_robot_and_network_are_trained(package):
    config = TrainConfig("Pogo", architecture="linear", units=3, batch_steps=40, horizon=20)
    run = Training(config)
    # each of 3 motors: a weight for what is seen, a bias and a deviation
    assert run.policy.n_trainable == 3 * (run.task.observation_size + 2)
    assert np.isfinite(run.step()["mean_return"])
    with pytest.raises(
        ValueError, match="architecture 'square' does not exist: choose one of ffwd"
    ):
        TrainConfig("Pogo", architecture="square")


def test_a_package_s_robot_has_no_hills_and_may_be_lent_some(package, capsys):
    told = "there are no hills for robot 'Pogo', only for Swimmer, Hopper"
    assert cli.main(["train", "--task", "Pogo", "--terrain", "hill"]) == 2
    assert told in capsys.readouterr().err
    for way in ({"terrain": "hill"}, {"perturbations": ("TerrainSwitch()",)}):
        with pytest.raises(ValueError, match=told):
            evaluation_task("Pogo", EvaluateConfig(runs=2, **way))
    lent = BatchTask("Pogo", 2, terrain=hill_maps(2, 0.5, 0, robot="Hopper"))
    assert np.isfinite(lent.reset()).all()


MINE = """
import gymnasium
gymnasium.register("Mine-v0", entry_point="gymnasium.envs.classic_control:PendulumEnv")
"""


def test_an_environment_that_a_package_registers_is_trained(tmp_path, monkeypatch, capsys):
    (tmp_path / "my_envs.py").write_text(MINE)
    monkeypatch.syspath_prepend(str(tmp_path))
    short = ["--horizon", "20", "--batch-steps", "40", "--iterations", "1"]
    run = tmp_path / "run"
    train = ["train", "--task", "my_envs:Mine-v0", *short, "--out", str(run)]
    try:
        assert cli.main(train) == 0
        config = TrainConfig("my_envs:Mine-v0")
        assert default_directory(config).name == "my_envs-mine-v0-flat-dtrnn-0"
        assert run_name(config) == "my_envs-mine-v0-flat-dtrnn-0-float32"
        capsys.readouterr()
        assert cli.main(["evaluate", str(run), "--runs", "2", "--steps", "9"]) == 0
        told = capsys.readouterr().out
        assert told.startswith("dtrnn on my_envs:Mine-v0, trained for 1 iterations\n")
    finally:
        gymnasium.registry.pop("Mine-v0")
        sys.modules.pop("my_envs")
    for name, reason in (
        ("no_envs:Mine-v0", "is of 'no_envs', which can't be imported"),
        ("json:Mine-v0", "does not exist: choose one of"),
        (":Mine-v0", "is of '', which can't be imported"),
    ):
        with pytest.raises(ValueError, match=f"task '{name}' {reason}"):
            TrainConfig(name)
    assert TrainConfig("thesis_lib:thesis/Hopper-v0").task == "thesis_lib:thesis/Hopper-v0"
