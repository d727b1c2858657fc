"""A ground as a height field: a piecewise linear surface over a rectangle."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import BoolArray, FloatArray

Interval = tuple[float, float]
Extent = tuple[Interval, Interval]


@dataclass(frozen=True, eq=False)
class HeightField:
    """A piecewise linear ground over a rectangle, with or without a plane running through it.

    Attributes
    ----------
    heights
        Shape ``(rows, cols)``, metres above ``z_offset``, none negative.  Row 0 is the edge
        of least y and column 0 that of least x; the nodes include both edges.
    half_size
        Half the extent along x and y, metres.
    z_offset
        World z of height 0, metres.
    centre
        World x and y of the rectangle's middle, metres.
    floor
        World z of an endless plane that is the ground wherever it is the higher, or None
        for no plane.

    Raises
    ------
    ValueError
        If the array has fewer than 2 x 2 nodes or holds a negative or non-finite height, or
        a half size is not positive.

    Notes
    -----
    Between the nodes the ground is the pair of triangles MuJoCo collides with: each cell is
    cut along the diagonal from its corner of least x and y to that of greatest x and y.
    """

    heights: FloatArray
    half_size: tuple[float, float]
    z_offset: float = 0.0
    centre: tuple[float, float] = (0.0, 0.0)
    floor: float | None = None

    def __post_init__(self) -> None:
        heights = np.array(self.heights, dtype=np.float64)
        if heights.ndim != 2 or min(heights.shape) < 2:
            raise ValueError(
                f"heights has shape {heights.shape}, but a height field needs at least 2 x 2 nodes."
            )
        if not np.isfinite(heights).all() or heights.min() < 0:
            raise ValueError(
                f"heights range from {heights.min()} to {heights.max()}, but they must be finite "
                "and not negative; put the lowest ground at 0 and move it with z_offset."
            )
        if not min(self.half_size) > 0:
            raise ValueError(f"half_size is {self.half_size}, but both must be positive (metres).")
        heights.flags.writeable = False
        object.__setattr__(self, "heights", heights)

    @property
    def extent(self) -> Extent:
        """World intervals ``((x0, x1), (y0, y1))`` the field covers, metres."""
        (cx, cy), (hx, hy) = self.centre, self.half_size
        return (cx - hx, cx + hx), (cy - hy, cy + hy)

    @cached_property
    def x(self) -> FloatArray:
        """World x of the columns, metres, shape ``(cols,)``."""
        return np.linspace(*self.extent[0], self.heights.shape[1])

    @cached_property
    def y(self) -> FloatArray:
        """World y of the rows, metres, shape ``(rows,)``."""
        return np.linspace(*self.extent[1], self.heights.shape[0])

    @property
    def resolution(self) -> tuple[float, float]:
        """Distance between neighbouring nodes along x and y, metres."""
        rows, cols = self.heights.shape
        return 2 * self.half_size[0] / (cols - 1), 2 * self.half_size[1] / (rows - 1)

    @cached_property
    def surface(self) -> FloatArray:
        """World z of the ground at the nodes, plane included, shape ``(rows, cols)``, metres."""
        field = self.z_offset + self.heights
        return field if self.floor is None else np.maximum(field, self.floor)

    def contains(self, x: ArrayLike, y: ArrayLike) -> BoolArray:
        """Whether points lie on the map, edges included.

        Parameters
        ----------
        x, y
            World coordinates in metres, any broadcastable shapes.

        Returns
        -------
        BoolArray
            The broadcast shape.
        """
        (x0, x1), (y0, y1) = self.extent
        x, y = np.asarray(x, np.float64), np.asarray(y, np.float64)
        return np.asarray((x >= x0) & (x <= x1) & (y >= y0) & (y <= y1))

    def height_at(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Height of the field above ``z_offset``, whether or not a plane covers it.

        Parameters
        ----------
        x, y
            World coordinates in metres, any broadcastable shapes.

        Returns
        -------
        FloatArray
            Metres, in the broadcast shape.

        Raises
        ------
        ValueError
            If a point lies off the map.
        """
        return self._triangle(self.heights, x, y)[0]

    def ground_z(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """World z of the ground, metres; arguments and errors as in :meth:`height_at`."""
        field = self.z_offset + self.height_at(x, y)
        return field if self.floor is None else np.maximum(field, self.floor)

    def slope(self, x: ArrayLike | None = None, y: ArrayLike | None = None) -> FloatArray:
        """Magnitude of the gradient (rise over run) of :attr:`surface`.

        Parameters
        ----------
        x, y
            World coordinates in metres; both None for every triangle of the map.

        Returns
        -------
        FloatArray
            Dimensionless, in the broadcast shape, or ``(2, rows - 1, cols - 1)``: the
            triangle on each cell's +x side, then that on its +y side.

        Raises
        ------
        ValueError
            If a point lies off the map, or only one of x and y is given.
        """
        if x is None and y is None:
            dx, dy = self.resolution
            along_x = np.diff(self.surface, axis=1) / dx
            along_y = np.diff(self.surface, axis=0) / dy
            return np.stack(
                [
                    np.hypot(along_x[:-1], along_y[:, 1:]),
                    np.hypot(along_x[1:], along_y[:, :-1]),
                ]
            )
        if x is None or y is None:
            raise ValueError("slope needs both x and y, or neither for the whole map.")
        return self._triangle(self.surface, x, y)[1]

    def _triangle(self, h: FloatArray, x: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Value and slope of the nodes' ``h`` on the triangle over each point."""
        x, y = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
        inside = self.contains(x, y)
        if not inside.all():
            bad = int(np.argmin(inside.ravel()))
            (x0, x1), (y0, y1) = self.extent
            raise ValueError(
                f"the point ({x.ravel()[bad]:.6g}, {y.ravel()[bad]:.6g}) m is off the map, which "
                f"covers x in [{x0:g}, {x1:g}] and y in [{y0:g}, {y1:g}] m."
            )
        rows, cols = self.heights.shape
        dx, dy = self.resolution
        u, v = (x - self.extent[0][0]) / dx, (y - self.extent[1][0]) / dy
        c = np.minimum(u.astype(np.int64), cols - 2)
        r = np.minimum(v.astype(np.int64), rows - 2)
        u, v = u - c, v - r
        h00, h01, h10, h11 = h[r, c], h[r, c + 1], h[r + 1, c], h[r + 1, c + 1]
        east = u >= v
        rise_x = np.where(east, h01 - h00, h11 - h10)
        rise_y = np.where(east, h11 - h01, h10 - h00)
        height = h00 + u * rise_x + v * rise_y
        return np.asarray(height), np.asarray(np.hypot(rise_x / dx, rise_y / dy))
