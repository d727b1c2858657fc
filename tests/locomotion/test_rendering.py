"""Pictures: what is drawn, what is left alone, and what is said where OpenGL is missing."""

from __future__ import annotations

import os
import subprocess
import sys

import mujoco
import numpy as np
import pytest

from tests.surroundings import python
from thesis_lib.locomotion import rendering
from thesis_lib.locomotion.rendering import NoGL, Renderer, View, dress, film, portrait
from thesis_lib.locomotion.robots import build_model, get_robot
from thesis_lib.locomotion.terrain import hills

ROBOTS = ("Swimmer", "Hopper", "HalfCheetah", "Walker2d", "Ant")


def robot_pixels(image: np.ndarray) -> np.ndarray:
    """Where the robot's warm colours are: the ground is grey-green, the sky white."""
    red, blue = image[..., 0].astype(int), image[..., 2].astype(int)
    return red - blue > 25


@pytest.mark.parametrize("robot", ROBOTS)
def test_portrait_shows_the_whole_robot(robot):
    image = portrait(robot, width=300, height=250)
    assert image.shape == (250, 300, 3)
    assert image.dtype == np.uint8
    seen = robot_pixels(image)
    assert 0.005 < seen.mean() < 0.3
    border = np.concatenate([seen[0], seen[-1], seen[:, 0], seen[:, -1]])
    assert not border.any()


def test_hills_are_drawn():
    flat = portrait("Ant", width=200, height=160)
    hilly = portrait("Ant", hills(0.5, 0, extent=((-10.0, 10.0),) * 2), width=200, height=160)
    assert (flat != hilly).mean() > 0.2


def test_film_follows_the_robot():
    """A robot 7 m further on stands in the same place of its picture."""
    start = np.array(get_robot("Hopper").init_qpos)
    moved = start.copy()
    moved[0] += 7.0
    first, second = film("Hopper", [start, moved], width=200, height=160)
    centres = [np.argwhere(robot_pixels(image)).mean(axis=0) for image in (first, second)]
    np.testing.assert_allclose(*centres, atol=1)


def test_running_forward_is_to_the_right():
    """Two robots in one picture: the one further along x is on the right at azimuth 90."""
    model = build_model("Hopper", edits=[dress])
    here, there = mujoco.MjData(model), mujoco.MjData(model)
    there.qpos[0] = 1.5
    for data in (here, there):
        mujoco.mj_forward(model, data)
    with Renderer(model, 320, 200, View(6.0)) as renderer:
        alone = np.argwhere(robot_pixels(renderer.frame(here)))
        both = np.argwhere(robot_pixels(renderer.frame(here, others=[there])))
    assert len(both) > 1.7 * len(alone)
    assert both[:, 1].mean() > alone[:, 1].mean() + 10


def test_dressing_changes_nothing_but_the_look():
    """The motion of a dressed robot on hills is bit for bit that of a plain one."""
    ground = hills(0.5, 1, robot="Walker2d")
    paths = []
    for edits in ([], [dress]):
        model = build_model("Walker2d", ground, edits)
        data = mujoco.MjData(model)
        data.ctrl[:] = 0.3
        for _ in range(400):
            mujoco.mj_step(model, data)
        paths.append(data.qpos.copy())
    np.testing.assert_array_equal(*paths)


def test_renderer_leaves_the_model_alone_and_can_be_closed_twice():
    model = build_model("Ant")
    size = model.vis.global_.offwidth, model.vis.global_.offheight
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    renderer = Renderer(model, 1000, 700)
    assert renderer.frame(data).shape == (700, 1000, 3)
    assert (model.vis.global_.offwidth, model.vis.global_.offheight) == size
    renderer.close()
    renderer.close()
    with pytest.raises(ValueError, match="closed"):
        renderer.frame(data)


def test_two_renderers_side_by_side():
    """Each draws into its own context, in whatever order they are used."""
    models = [build_model(name, edits=[dress]) for name in ("Ant", "Hopper")]
    states = [mujoco.MjData(model) for model in models]
    for model, state in zip(models, states, strict=True):
        mujoco.mj_forward(model, state)
    renderers = [Renderer(model, 120, 90) for model in models]
    first = [r.frame(s) for r, s in zip(renderers, states, strict=True)]
    again = [r.frame(s) for r, s in zip(renderers[::-1], states[::-1], strict=True)][::-1]
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a, b)
    for renderer in renderers:
        renderer.close()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"width": 0}, "at least 1 x 1"),
        ({"camera": "above"}, "no camera 'above'; there are track"),
    ],
)
def test_bad_renderers_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Renderer(build_model("Ant"), **arguments)


def test_states_of_another_robot_are_refused():
    with pytest.raises(ValueError, match="the Ant needs"):
        film("Ant", np.zeros((2, 6)))


# ---------------------------------------------------------------------------------- without GL


def test_an_unknown_backend_is_refused(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "off")
    with pytest.raises(NoGL, match="MUJOCO_GL is 'off', which names no backend"):
        rendering.choose_backend()


def test_no_library_at_all(monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(sys, "platform", "linux")

    def missing(name):
        raise OSError(name)

    monkeypatch.setattr(rendering.ctypes, "CDLL", missing)
    with pytest.raises(NoGL, match="neither libEGL nor libOSMesa"):
        rendering.choose_backend()


def test_where_the_driver_is_missing_one_sentence_says_what_to_do():
    """A real failure of EGL, in a process of its own: no vendor library can be found."""
    code = (
        "from thesis_lib.locomotion.rendering import NoGL, portrait\n"
        "try:\n    portrait('Ant')\nexcept NoGL as error:\n    print(error)\n"
    )
    environment = {**os.environ, "MUJOCO_GL": "egl", "__EGL_VENDOR_LIBRARY_DIRS": "/nonexistent"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert len(done.stdout.strip().splitlines()) == 1
    assert "egl did not start" in done.stdout
    assert "apt-get install libegl1 libopengl0 libgl1-mesa-dri" in done.stdout


@pytest.mark.parametrize("backend", ["nonsense", "osmesa", "egl", "glfw", "disable", "1"])
def test_what_mujoco_gl_names_matters_to_drawing_only(backend: str) -> None:
    code = (
        "import os\nfrom thesis_lib.locomotion import make_task\nimport mujoco\n"
        "make_task('Hopper'); print(mujoco.__name__, os.environ['MUJOCO_GL'])"
    )
    done = python("-c", code, env={"MUJOCO_GL": backend})
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["mujoco", backend]
