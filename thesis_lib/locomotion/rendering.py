"""Pictures of robots and terrain without a screen (figure 5.1).

Drawing needs OpenGL, which a machine without a screen or a graphics card offers through
Mesa's software renderer: on Debian and Ubuntu ``apt-get install libegl1 libopengl0
libgl1-mesa-dri``.  The environment variable ``MUJOCO_GL`` chooses another way
(``osmesa``, or ``glfw`` where there is a screen).  Where none works, :class:`NoGL` says so
in one sentence, and nothing else of the library is affected.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib import import_module
from types import TracebackType
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from thesis_lib.checks import ForeseenError
from thesis_lib.locomotion.robots import FLOOR, HILLS, ROOT_BODY, Ground, build_model, get_robot

Image = NDArray[np.uint8]

_BACKENDS = ("egl", "osmesa", "glfw", "cgl")


class NoGL(ForeseenError):  # noqa: N818 - it names a state of the machine, as mujoco's errors do
    """OpenGL cannot be had here; the message says what to install or set."""


def choose_backend() -> str:
    """Name the way to OpenGL: ``MUJOCO_GL`` if set, else the first whose library is there.

    Returns
    -------
    str
        ``egl``, ``osmesa``, ``glfw`` or ``cgl``.

    Raises
    ------
    NoGL
        If there is none, or ``MUJOCO_GL`` names none.
    """
    asked = os.environ.get("MUJOCO_GL", "").strip().lower()
    if asked in _BACKENDS:
        return asked
    if asked:
        raise NoGL(_way_out(f"MUJOCO_GL is {asked!r}, which names no backend"))
    if sys.platform != "linux":
        return "cgl" if sys.platform == "darwin" else "glfw"
    for backend, library in (("egl", "libEGL.so.1"), ("osmesa", "libOSMesa.so.8")):
        try:
            ctypes.CDLL(library)
        except OSError:
            continue
        return backend
    raise NoGL(_way_out("neither libEGL nor libOSMesa is installed"))


def _way_out(reason: str) -> str:
    return (
        f"No picture can be drawn because {reason}: on Debian or Ubuntu run `apt-get install "
        "libegl1 libopengl0 libgl1-mesa-dri`, elsewhere set MUJOCO_GL to egl, osmesa or glfw."
    )


def _open_context(width: int, height: int) -> Any:
    """Open and activate an OpenGL context; NoGL if that fails in any way."""
    backend = choose_backend()
    try:
        context = import_module(f"mujoco.{backend}").GLContext(width, height)
        context.make_current()
    except Exception as error:  # every backend fails in its own way, from ImportError to OSError
        reason = str(error).strip().splitlines() or [type(error).__name__]
        raise NoGL(_way_out(f"{backend} did not start ({reason[0].rstrip('.')})")) from error
    return context


def check_gl() -> None:
    """Open a context and close it again; NoGL says what is missing, before work is lost on it."""
    _open_context(8, 8).free()


@dataclass(frozen=True)
class View:
    """Where the camera stands.

    Attributes
    ----------
    distance
        From the point it looks at, metres.
    azimuth
        Direction of looking in the ground plane, degrees: 90 looks along +y, so that a
        robot runs from left to right.
    elevation
        Degrees above the horizon; negative looks down.
    rise
        How far above the robot's root it looks, metres.
    """

    distance: float
    azimuth: float = 90.0
    elevation: float = -12.0
    rise: float = 0.0


PORTRAITS = {
    "Swimmer": View(3.6, azimuth=70, elevation=-35),
    "Hopper": View(3.6, azimuth=70, elevation=-10, rise=-0.45),
    "HalfCheetah": View(3.0, azimuth=70, elevation=-12, rise=-0.1),
    "Walker2d": View(3.6, azimuth=70, elevation=-10, rise=-0.45),
    "Ant": View(3.2, azimuth=60, elevation=-28),
}
"""The view of each robot in figure 5.1.

:meta hide-value:
"""

SIDE = View(3.6)
"""The view of a robot that is not the thesis's."""


class Renderer:
    """Draws states of one model into arrays.

    Parameters
    ----------
    model
        The model; it is not changed.
    width, height
        Of the picture, pixels.
    camera
        Name of a camera of the model, or a :class:`View` that follows the robot.

    Raises
    ------
    NoGL
        If OpenGL cannot be had.
    ValueError
        If the size is not positive or the model has no such camera.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        width: int = 640,
        height: int = 480,
        camera: str | View = "track",
    ) -> None:
        self._context: Any = None
        self._gpu: Any = None
        if width < 1 or height < 1:
            raise ValueError(f"the picture is {width} x {height}, but needs at least 1 x 1 pixels.")
        if isinstance(camera, str):
            names = [model.camera(i).name for i in range(model.ncam)]
            if camera not in names:
                raise ValueError(f"there is no camera {camera!r}; there are {', '.join(names)}.")
        self._model, self._default = model, camera
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._scene = mujoco.MjvScene(model, maxgeom=4000)
        self._options = mujoco.MjvOption()
        self._context = _open_context(width, height)
        visual = model.vis.global_
        size = visual.offwidth, visual.offheight
        # The off-screen buffer takes its size from the model; only then is the caller's restored.
        visual.offwidth, visual.offheight = width, height
        try:
            self._gpu = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        finally:
            visual.offwidth, visual.offheight = size
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._gpu)

    def frame(
        self,
        data: mujoco.MjData,
        camera: str | View | None = None,
        others: Iterable[mujoco.MjData] = (),
    ) -> Image:
        """Draw one state.

        Parameters
        ----------
        data
            The state, with positions up to date (``mj_forward`` done).
        camera
            Overrides the renderer's.
        others
            States of the same model whose robots are drawn into the same picture.

        Returns
        -------
        Image
            Shape ``(height, width, 3)``, 0 to 255, row 0 on top.
        """
        if self._context is None:
            raise ValueError("this renderer is closed; make a new one.")
        self._context.make_current()
        view = self._camera(data, self._default if camera is None else camera)
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        moving = mujoco.mjtCatBit.mjCAT_DYNAMIC.value
        perturb = mujoco.MjvPerturb()
        mujoco.mjv_updateScene(
            self._model, data, self._options, perturb, view, everything, self._scene
        )
        for other in others:
            mujoco.mjv_addGeoms(self._model, other, self._options, perturb, moving, self._scene)
        mujoco.mjr_render(self._rect, self._scene, self._gpu)
        image = np.empty((self._rect.height, self._rect.width, 3), np.uint8)
        mujoco.mjr_readPixels(image, None, self._rect, self._gpu)
        return image[::-1].copy()

    def _camera(self, data: mujoco.MjData, camera: str | View) -> mujoco.MjvCamera:
        made = mujoco.MjvCamera()
        if isinstance(camera, str):
            made.type = mujoco.mjtCamera.mjCAMERA_FIXED
            made.fixedcamid = self._model.camera(camera).id
        else:
            made.type = mujoco.mjtCamera.mjCAMERA_FREE
            made.lookat[:] = data.xpos[self._model.body(ROOT_BODY).id] + [0, 0, camera.rise]
            made.distance, made.azimuth = camera.distance, camera.azimuth
            made.elevation = camera.elevation
        return made

    def close(self) -> None:
        """Free the OpenGL resources; closing twice does no harm."""
        if self._context is not None:
            self._context.make_current()
            if self._gpu is not None:
                self._gpu.free()
            self._context.free()
        self._context = self._gpu = None

    def __enter__(self) -> Renderer:
        """Return the renderer itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the renderer."""
        self.close()

    def __del__(self) -> None:
        """Free what was not closed."""
        # At interpreter exit the libraries may be gone already.
        if not sys.is_finalizing():
            self.close()


def dress(spec: mujoco.MjSpec) -> None:
    """Make a model look well in print: white sky, a pale 1 m grid, light from one side.

    Only what is seen changes; the motion stays bit for bit the same.  Pass it to
    :func:`~thesis_lib.locomotion.robots.build_model` as an edit.
    """
    for texture in list(spec.textures):
        if texture.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX:
            spec.delete(texture)
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=[1, 1, 1],
        width=16,
        height=96,
    )
    spec.add_texture(
        name="grid",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.88, 0.9, 0.86],
        rgb2=[0.76, 0.8, 0.74],
        width=256,
        height=256,
    )
    grid = spec.add_material(name="grid", texuniform=True, texrepeat=[0.5, 0.5], reflectance=0)
    textures = [""] * int(mujoco.mjtTextureRole.mjNTEXROLE)
    textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = "grid"
    grid.textures = textures
    for geom in spec.geoms:
        if geom.name in (FLOOR, HILLS):
            geom.material, geom.rgba = "grid", [1, 1, 1, 1]
    for light in list(spec.lights):
        spec.delete(light)
    # The light goes with the robot, and shadows are computed within the extent around it.
    spec.stat.extent = 6
    spec.body(ROOT_BODY).add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        mode=mujoco.mjtCamLight.mjCAMLIGHT_TRACKCOM,
        pos=[-3.5, -2.5, 4],
        dir=[0.7, 0.5, -0.8],
        diffuse=[0.75, 0.75, 0.75],
        specular=[0.1, 0.1, 0.1],
        castshadow=True,
    )
    spec.visual.headlight.ambient = [0.35, 0.35, 0.35]
    spec.visual.headlight.diffuse = [0.15, 0.15, 0.15]
    spec.visual.headlight.specular = [0, 0, 0]
    spec.visual.quality.shadowsize = 4096


def portrait(
    robot: str,
    ground: Ground | None = None,
    *,
    width: int = 480,
    height: int = 400,
    view: View | None = None,
) -> Image:
    """Draw a robot in its starting pose, as in figure 5.1.

    Parameters
    ----------
    robot
        Its name.
    ground
        The terrain it stands on; None for the flat floor.
    width, height
        Pixels.
    view
        Default the robot's in :data:`PORTRAITS`, or from the side for one that has none there.

    Returns
    -------
    Image
        Shape ``(height, width, 3)``.

    Raises
    ------
    NoGL
        If OpenGL cannot be had.
    """
    start = get_robot(robot).init_qpos
    return film(robot, [start], ground, width=width, height=height, view=view)[0]


def film(
    robot: str,
    states: ArrayLike | Sequence[Sequence[float]],
    ground: Ground | None = None,
    *,
    width: int = 480,
    height: int = 320,
    view: View | None = None,
) -> list[Image]:
    """Draw states of one robot one by one, the camera beside it.

    Parameters
    ----------
    robot
        Its name.
    states
        Positions in the model's order, shape ``(n, nq)``.
    ground, width, height, view
        As in :func:`portrait`.

    Returns
    -------
    list of Image
        One picture of shape ``(height, width, 3)`` for each state.

    Raises
    ------
    NoGL
        If OpenGL cannot be had.
    ValueError
        If the states have another number of coordinates than the robot.
    """
    qpos = np.atleast_2d(np.asarray(states, np.float64))
    model = build_model(robot, ground, [dress])
    if qpos.ndim != 2 or qpos.shape[1] != model.nq:
        raise ValueError(
            f"states have shape {qpos.shape}, but the {robot} needs (n, {model.nq}) positions."
        )
    data = mujoco.MjData(model)
    pictures = []
    chosen = PORTRAITS.get(robot, SIDE) if view is None else view
    with Renderer(model, width, height, chosen) as renderer:
        for row in qpos:
            data.qpos[:] = row
            mujoco.mj_forward(model, data)
            pictures.append(renderer.frame(data))
    return pictures
