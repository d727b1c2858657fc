"""Episodes of unequal length as rows without padding.

A batch of B episodes is stored time-major: first the first step of every episode, then
the second step of every episode that has one, and so on, with the episodes ordered by
falling length.  The rows of one time are then contiguous, the episodes still running at
time t are the first ``sizes[t]`` of the order, no row is wasted on padding and a mean
over steps is a plain mean over rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
import torch

from thesis_lib.arrays import BoolArray, FloatArray, IntArray

Rows = TypeVar("Rows", FloatArray, torch.Tensor)


@dataclass(frozen=True, eq=False)
class Packing:
    """The layout of a batch of episodes.

    Parameters
    ----------
    lengths
        Number of steps of each episode, shape ``(B,)``, each at least 1, in the order in
        which the episodes were given.

    Raises
    ------
    ValueError
        When there is no episode or one has no step.
    """

    lengths: IntArray

    def __post_init__(self) -> None:
        lengths = np.array(self.lengths, dtype=np.int64)
        if lengths.ndim != 1 or len(lengths) == 0 or lengths.min() < 1:
            raise ValueError(
                f"lengths is {np.asarray(self.lengths).tolist()}, but a batch needs at least one "
                "episode and every episode at least one step."
            )
        lengths.flags.writeable = False
        object.__setattr__(self, "lengths", lengths)

    @property
    def n_episodes(self) -> int:
        """Number of episodes B."""
        return len(self.lengths)

    @property
    def n_steps(self) -> int:
        """Number of steps of all episodes together: the number of rows R."""
        return int(self.lengths.sum())

    @property
    def horizon(self) -> int:
        """Length T of the longest episode."""
        return int(self.lengths.max())

    @cached_property
    def order(self) -> IntArray:
        """The episode at each place of the order of falling length, shape ``(B,)``."""
        return np.argsort(-self.lengths, kind="stable")

    @cached_property
    def sizes(self) -> list[int]:
        """Number of episodes that have a step t, for each t; T falling integers."""
        ended = np.bincount(self.lengths, minlength=self.horizon + 1)
        return [int(n) for n in self.n_episodes - np.cumsum(ended)[:-1]]

    @cached_property
    def offsets(self) -> IntArray:
        """First row of each time, shape ``(T + 1,)``; the last entry is R."""
        return np.concatenate(([0], np.cumsum(self.sizes)))

    @cached_property
    def time(self) -> IntArray:
        """Step within its episode of each row, shape ``(R,)``."""
        return np.repeat(np.arange(self.horizon), self.sizes)

    @cached_property
    def place(self) -> IntArray:
        """Place of each row's episode in the order of falling length, shape ``(R,)``."""
        return np.arange(self.n_steps) - self.offsets[self.time]

    @cached_property
    def episode(self) -> IntArray:
        """Episode of each row, numbered as given, shape ``(R,)``."""
        return self.order[self.place]

    @cached_property
    def previous(self) -> IntArray:
        """Row one step earlier in the same episode of each row from time 1 on.

        Shape ``(R - B,)``; rows of time 0 have none.
        """
        later = self.time[self.n_episodes :]
        return self.offsets[later - 1] + self.place[self.n_episodes :]

    @cached_property
    def last(self) -> IntArray:
        """Row of the last step of each episode, numbered as given, shape ``(B,)``."""
        place = np.empty(self.n_episodes, dtype=np.int64)
        place[self.order] = np.arange(self.n_episodes)
        return self.offsets[self.lengths - 1] + place

    def pack(self, padded: Rows) -> Rows:
        """Take the real steps of a padded array.

        Parameters
        ----------
        padded
            Shape ``(T', B, ...)`` with T' at least the horizon.

        Returns
        -------
        Rows
            Shape ``(R, ...)``.
        """
        if padded.shape[0] < self.horizon or padded.shape[1] != self.n_episodes:
            raise ValueError(
                f"the padded array has shape {tuple(padded.shape)}, but at least {self.horizon} "
                f"steps of exactly {self.n_episodes} episodes are needed."
            )
        return padded[self.time, self.episode]

    def unpack(self, rows: FloatArray) -> FloatArray:
        """Lay rows out as a padded array, the inverse of :meth:`pack`.

        Parameters
        ----------
        rows
            Shape ``(R, ...)``.

        Returns
        -------
        FloatArray
            Shape ``(T, B, ...)``, 0 in the padding.
        """
        padded = np.zeros((self.horizon, self.n_episodes, *rows.shape[1:]), dtype=rows.dtype)
        padded[self.time, self.episode] = rows
        return padded

    def mask(self) -> BoolArray:
        """True where a padded array holds a real step, shape ``(T, B)``."""
        return np.arange(self.horizon)[:, None] < self.lengths[None, :]

    def shift(self, rows: Rows) -> Rows:
        """Each row's value one step earlier; zero at the first step of an episode.

        Parameters
        ----------
        rows
            Shape ``(R, ...)``.

        Returns
        -------
        Rows
            Shape ``(R, ...)``.
        """
        shifted = torch.zeros_like(rows) if isinstance(rows, torch.Tensor) else np.zeros_like(rows)
        shifted[self.n_episodes :] = rows[self.previous]
        return shifted
