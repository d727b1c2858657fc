"""Tile coding: a continuous state as a few active binary features (section 4.3, heat domain)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import BoolArray, FloatArray, IntArray
from thesis_lib.compiled import njit


@dataclass(frozen=True)
class TileCoding:
    """Overlapping grids over a box, displaced against one another.

    Each tiling cuts every variable into tiles of the same width and is displaced by its
    own fraction of a tile, the same for all variables: (t + 1/2)/T for tiling t of T.  A
    variable of n intervals therefore meets n + 1 tiles, unless it is periodic, when the
    last tile is the first.  A value outside the range falls into the outermost tile.

    Parameters
    ----------
    names
        Names of the variables, D of them.
    low, high
        Their ranges.
    intervals
        Tile widths as fractions of the range: (high - low) / intervals.
    periodic
        Which variables are angles.
    tilings
        Number of tilings T.

    Raises
    ------
    ValueError
        When lengths disagree, a range is empty or an interval count is below 1.
    """

    names: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    intervals: tuple[int, ...]
    periodic: tuple[bool, ...]
    tilings: int = 4

    def __post_init__(self) -> None:
        lengths = [len(v) for v in (self.names, self.low, self.high, self.intervals, self.periodic)]
        if len(set(lengths)) != 1:
            raise ValueError(
                "names, low, high, intervals and periodic have lengths "
                f"{', '.join(map(str, lengths))}, but each needs one entry a variable."
            )
        for name, low, high, n in zip(self.names, self.low, self.high, self.intervals, strict=True):
            if not low < high:
                raise ValueError(
                    f"variable {name!r} has range [{low}, {high}], but low must be below high."
                )
            if n < 1 or n != int(n):
                raise ValueError(
                    f"variable {name!r} has {n} intervals, but it needs an integer of at least 1."
                )
        if self.tilings < 1 or self.tilings != int(self.tilings):
            raise ValueError(f"tilings is {self.tilings}, but it must be an integer of at least 1.")

    @property
    def tiles(self) -> tuple[int, ...]:
        """Number of tiles of each variable in one tiling."""
        return tuple(
            n if wraps else n + 1 for n, wraps in zip(self.intervals, self.periodic, strict=True)
        )

    @property
    def n_features(self) -> int:
        """Number of binary features: tilings times tiles."""
        return self.tilings * int(np.prod(self.tiles))

    @cached_property
    def offsets(self) -> FloatArray:
        """Displacement of each tiling as a fraction of a tile, shape ``(T,)``."""
        return (np.arange(self.tilings) + 0.5) / self.tilings

    @cached_property
    def arrays(self) -> tuple[FloatArray, FloatArray, IntArray, BoolArray, FloatArray]:
        """Lows, tile widths, tiles, periodicity and offsets, as compiled code takes them."""
        low, high = np.array(self.low), np.array(self.high)
        width = (high - low) / np.array(self.intervals)
        return low, width, np.array(self.tiles), np.array(self.periodic), self.offsets

    def active(self, points: ArrayLike) -> IntArray:
        """The active feature of each tiling.

        Parameters
        ----------
        points
            One state, shape ``(D,)``, or several, shape ``(N, D)``.

        Returns
        -------
        IntArray
            Shape ``(T,)`` or ``(N, T)``.
        """
        given = np.asarray(points, dtype=np.float64)
        rows = np.ascontiguousarray(np.atleast_2d(given))
        if rows.ndim != 2 or rows.shape[1] != len(self.names):
            raise ValueError(
                f"points have shape {given.shape}, but one number for each of "
                f"{', '.join(self.names)} is needed."
            )
        out = np.empty((len(rows), self.tilings), dtype=np.int64)
        for i, row in enumerate(rows):
            active_tiles(row, *self.arrays, out[i])
        return out[0] if given.ndim == 1 else out

    @cached_property
    def places(self) -> IntArray:
        """Tiling and tile of each feature, shape ``(n_features, 1 + D)``."""
        return np.stack(
            np.unravel_index(np.arange(self.n_features), (self.tilings, *self.tiles)), axis=1
        )

    def clusters(self, keep: Sequence[str]) -> IntArray:
        """An abstraction in feature space: the features that agree on the kept variables.

        Two features of one tiling are the same abstract feature when their tiles agree in
        every variable of ``keep``; this is the tiling of the remaining variables alone.

        Parameters
        ----------
        keep
            Names of the variables that are kept; none gives one cluster a tiling.

        Returns
        -------
        IntArray
            Cluster of each feature, shape ``(n_features,)``, numbered from 0.
        """
        unknown = [name for name in keep if name not in self.names]
        if unknown:
            raise ValueError(
                f"keep names {unknown[0]!r}, but the variables are {', '.join(self.names)}."
            )
        shape, at = [self.tilings], [self.places[:, 0]]
        for d, name in enumerate(self.names):
            if name in keep:
                shape.append(self.tiles[d])
                at.append(self.places[:, 1 + d])
        return np.ravel_multi_index(at, shape).astype(np.int64)


@njit(error_model="numpy")
def active_tiles(point, low, width, tiles, periodic, offsets, out):  # type: ignore[no-untyped-def]
    """Write the active feature of each tiling into ``out``, shape ``(T,)``."""
    for t in range(offsets.shape[0]):
        index = t
        for d in range(point.shape[0]):
            n = tiles[d]
            tile = int(np.floor((point[d] - low[d]) / width[d] + offsets[t]))
            if periodic[d]:
                tile %= n
            elif tile < 0:
                tile = 0
            elif tile >= n:
                tile = n - 1
            index = index * n + tile
        out[t] = index
