"""Rendered pictures of the robots, and what stands in their place without OpenGL."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from thesis_lib.edition.plots import panels
from thesis_lib.locomotion import rendering
from thesis_lib.locomotion.height_field import HeightField
from thesis_lib.locomotion.robots import ROBOTS


def gallery(make: Callable[[], Sequence[rendering.Image]], titles: Sequence[str]) -> Figure:
    """Pictures, three a row; where the machine has no OpenGL, what to do about it instead.

    Rows at the top in which every picture is white, as the sky is, are left out.

    Parameters
    ----------
    make
        Draws the pictures; may raise :class:`~thesis_lib.locomotion.rendering.NoGL`.
    titles
        One for each picture.
    """
    try:
        images = make()
    except rendering.NoGL as missing:
        fig, ax = plt.subplots(figsize=(7.2, 1.6))
        ax.axis("off")
        ax.text(0.5, 0.5, textwrap.fill(str(missing), 80), ha="center", va="center")
        return fig
    drawn = np.any(np.stack(images) < 255, axis=(0, 2, 3))
    images = [image[max(0, int(drawn.argmax()) - 8) :] for image in images]
    shape = images[0].shape
    fig, axes = panels(len(titles), 3, 7.2 / 3 * shape[0] / shape[1] + 0.28)
    for ax, image, title in zip(axes, images, titles, strict=True):
        ax.axis("off")
        ax.imshow(image)
        ax.set_title(title, fontsize=9)
    return fig


def on_hills(robot: str, field: HeightField, x: float, y: float) -> np.ndarray:
    """A robot's starting pose, moved to a place of a map.

    Parameters
    ----------
    robot
        Swimmer or Ant, which move freely in space.
    field
        The ground.
    x, y
        World coordinates of the root, m.

    Returns
    -------
    ndarray
        Positions, shape ``(nq,)``; the root is as high above the ground as at the start.
    """
    qpos = np.array(ROBOTS[robot].init_qpos)
    qpos[:3] += [x, y, field.ground_z(x, y)]
    return qpos
