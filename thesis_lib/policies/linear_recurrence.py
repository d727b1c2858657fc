r"""The linear recurrence that a recurrent network is near its parameters, and its transpose.

At every time, :math:`F` functions :math:`f_i` of a unit follow each other; the last ones are the
parts of the new state and those before are the later stages of an integrator, whose values go
through the recurrent weights too:

.. math::
    df_i = e_i + \sum_j s_{ij} \circ dr_j + \sum_p s'_{ip} \circ dx_p,
    \qquad dr_1 = K\,dx_1, \quad dr_{j+1} = K\,df_j

with x the old state.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from thesis_lib.arrays import IntArray
from thesis_lib.compiled import njit

Rows = NDArray[np.floating]

Slopes = Sequence[tuple[int, Rows]]
"""Slopes of one function of a unit in one argument: (channel, ``(R, N)``), none where 0."""


class LinearRecurrence:
    r"""A network's linear recurrence over a batch of episodes.

    Parameters
    ----------
    weight
        K, shape ``(gates * N, N)``.
    recurrent
        :math:`s_{ij}`: for each function and stage, its :data:`Slopes` in the channels
        (gates) of :math:`r_j`.
    state
        :math:`s'_{ip}`: for each function, its :data:`Slopes` in the parts of the old
        state.
    sizes
        Number of rows of each time, falling.

    Notes
    -----
    The loops are compiled: at each time a batch has few rows, so that array operations would
    mostly cost their calls.
    """

    def __init__(
        self,
        weight: Rows,
        recurrent: Sequence[Sequence[Slopes]],
        state: Sequence[Slopes],
        sizes: Sequence[int],
    ) -> None:
        self.weight = np.ascontiguousarray(weight)
        self.n_stages = len(recurrent[0])
        self.n_parts = len(recurrent) - (self.n_stages - 1)
        self.bounds: IntArray = np.concatenate(([0], np.cumsum(sizes, dtype=np.int64)))
        shape = int(self.bounds[-1]), weight.shape[1]
        through = [
            (i, j, channel, slope)
            for i, row in enumerate(recurrent)
            for j, term in enumerate(row)
            for channel, slope in term
        ]
        past = [(i, part, slope) for i, row in enumerate(state) for part, slope in row]
        self.through = np.array([key for *key, _ in through], dtype=np.int64).reshape(-1, 3)
        self.past = np.array([key for *key, _ in past], dtype=np.int64).reshape(-1, 2)
        self.slopes, self.past_slopes = (
            np.array([slope for *_, slope in terms], dtype=weight.dtype).reshape(-1, *shape)
            for terms in (through, past)
        )

    def forward(self, changes: Rows, start: Rows) -> None:
        """Run forward in time.

        Parameters
        ----------
        changes
            Sources :math:`e_i`, shape ``(F, R, N)``; become :math:`df_i`.
        start
            Change of the initial state, ``(P, B, N)``.
        """
        weight = np.ascontiguousarray(self.weight.T)
        results = np.empty((self.n_stages, start.shape[1], weight.shape[1]), dtype=weight.dtype)
        terms = (self.through, self.slopes, self.past, self.past_slopes)
        _forward(weight, self.bounds, *terms, changes, start, results)

    def backward(self, errors: Rows) -> tuple[Rows, Rows]:
        """Run the transpose, backward in time.

        Parameters
        ----------
        errors
            Shape ``(F, R, N)``.  Those of the state's parts hold what reaches them from
            outside and become the whole error; those of later stages are filled.

        Returns
        -------
        results, start
            Error at the results of the recurrent weights, ``(stages, R, gates * N)``, and at
            the initial state, ``(P, B, N)``.
        """
        rows, units = errors.shape[1:]
        results = np.zeros((self.n_stages, rows, len(self.weight)), dtype=self.weight.dtype)
        start = np.zeros((self.n_parts, int(self.bounds[1]), units), dtype=self.weight.dtype)
        terms = (self.through, self.slopes, self.past, self.past_slopes)
        _backward(self.weight, self.bounds, *terms, errors, results, start)
        return results, start


@njit(error_model="numpy")
def _forward(  # type: ignore[no-untyped-def]
    weight, bounds, through, slopes, past, past_slopes, changes, start, results
):
    n_functions, _, units = changes.shape
    n_stages = results.shape[0]
    for t in range(len(bounds) - 1):
        low, high = bounds[t], bounds[t + 1]
        n = high - low
        before = bounds[t - 1] if t > 0 else 0
        for i in range(n_functions):
            if i > 0 and i < n_stages:
                np.dot(changes[i - 1, low:high], weight, results[i, :n])
            elif i == 0 and t == 0:
                np.dot(start[0, :n], weight, results[0, :n])
            elif i == 0:
                np.dot(changes[n_stages - 1, before : before + n], weight, results[0, :n])
            for k in range(len(through)):
                if through[k, 0] == i:
                    stage, first = through[k, 1], through[k, 2] * units
                    for row in range(n):
                        for u in range(units):
                            changes[i, low + row, u] += (
                                slopes[k, low + row, u] * results[stage, row, first + u]
                            )
            for k in range(len(past)):
                if past[k, 0] == i:
                    part = past[k, 1]
                    for row in range(n):
                        for u in range(units):
                            old = (
                                start[part, row, u]
                                if t == 0
                                else changes[n_stages - 1 + part, before + row, u]
                            )
                            changes[i, low + row, u] += past_slopes[k, low + row, u] * old


@njit(error_model="numpy")
def _backward(  # type: ignore[no-untyped-def]
    weight, bounds, through, slopes, past, past_slopes, errors, results, carry
):
    units = errors.shape[2]
    n_stages, n_parts = results.shape[0], carry.shape[0]
    n_after = 0
    for t in range(len(bounds) - 2, -1, -1):
        low, high = bounds[t], bounds[t + 1]
        n = high - low
        for part in range(n_parts):
            for row in range(n_after):
                for u in range(units):
                    errors[n_stages - 1 + part, low + row, u] += carry[part, row, u]
            carry[part, :n] = 0.0
        for stage in range(n_stages - 1, -1, -1):
            for k in range(len(through)):
                if through[k, 1] == stage:
                    i, first = through[k, 0], through[k, 2] * units
                    for row in range(low, high):
                        for u in range(units):
                            results[stage, row, first + u] += slopes[k, row, u] * errors[i, row, u]
            if stage > 0:
                np.dot(results[stage, low:high], weight, errors[stage - 1, low:high])
            else:
                np.dot(results[0, low:high], weight, carry[0, :n])
        for k in range(len(past)):
            i, part = past[k, 0], past[k, 1]
            for row in range(n):
                for u in range(units):
                    carry[part, row, u] += past_slopes[k, low + row, u] * errors[i, low + row, u]
        n_after = n
