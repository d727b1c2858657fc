r"""Products with the Jacobian of a recurrent policy, by full-length BPTT (section 2.4)."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from thesis_lib.policies.base import Linearised, Sequences
from thesis_lib.policies.recurrent import RecurrentPolicy

Rows = NDArray[np.floating]

Slopes = list[tuple[int, Rows]]
"""Slopes of one function of a unit in one argument: (channel, ``(R, N)``), none where 0."""


class LinearRecurrence:
    r"""The linear recurrence that a recurrent network is near its parameters.

    At every time, :math:`F` functions :math:`f_i` of a unit follow each other; the last
    ones are the parts of the new state and those before are the later stages of an
    integrator, whose values go through the recurrent weights too:

    .. math::
        df_i = e_i + \sum_j s_{ij} \circ dr_j + \sum_p s'_{ip} \circ dx_p,
        \qquad dr_1 = K\,dx_1, \quad dr_{j+1} = K\,df_j

    with x the old state.

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
    Both directions are loops of a few small operations on contiguous rows.  numpy does
    these with less overhead than torch, and nothing here needs a graph.
    """

    def __init__(
        self, weight: Rows, recurrent: list[list[Slopes]], state: list[Slopes], sizes: list[int]
    ) -> None:
        n_units = weight.shape[1]
        self.weight = weight
        self.sizes = sizes
        self.bounds = np.concatenate(([0], np.cumsum(sizes))).tolist()
        self.n_stages = len(recurrent[0])
        self.n_parts = len(recurrent) - (self.n_stages - 1)
        gates = weight.shape[0] // n_units
        self.channels = [slice(c * n_units, (c + 1) * n_units) for c in range(gates)]
        self.recurrent = [
            [[(self.channels[c], self.rows(d)) for c, d in term] for term in row]
            for row in recurrent
        ]
        self.state = [[(p, self.rows(d)) for p, d in row] for row in state]
        # The same by stage and channel, which the transpose needs.
        self.by_channel = [
            [
                (
                    channel,
                    [
                        (i, d)
                        for i, row in enumerate(self.recurrent)
                        for c, d in row[j]
                        if c == channel
                    ],
                )
                for channel in self.channels
            ]
            for j in range(self.n_stages)
        ]

    def rows(self, block: Rows) -> list[Rows]:
        """Views of the rows of each time."""
        return [block[a:b] for a, b in zip(self.bounds[:-1], self.bounds[1:], strict=True)]

    def forward(self, changes: list[Rows], start: list[Rows]) -> None:
        """Run forward in time.

        Parameters
        ----------
        changes
            Sources :math:`e_i`, ``(R, N)`` for each function; become :math:`df_i`.
        start
            Change of the initial state, ``(B, N)`` for each part.
        """
        n_later = self.n_stages - 1
        weight = np.ascontiguousarray(self.weight.T)
        in_time = [self.rows(c) for c in changes]
        old, scratch = start, np.empty_like(start[0])
        for t, n in enumerate(self.sizes):
            if n < len(scratch):
                old, scratch = [x[:n] for x in old], scratch[:n]
            results = [np.dot(old[0], weight)]
            for i, rows in enumerate(in_time):
                change = rows[t]
                for j, r in enumerate(results):
                    for channel, slope in self.recurrent[i][j]:
                        np.multiply(slope[t], r[:, channel], out=scratch)
                        change += scratch
                for p, slope in self.state[i]:
                    np.multiply(slope[t], old[p], out=scratch)
                    change += scratch
                if i < n_later:
                    results.append(np.dot(change, weight))
            old = [rows[t] for rows in in_time[n_later:]]

    def backward(self, errors: list[Rows]) -> tuple[list[Rows], list[Rows]]:
        """Run the transpose, backward in time.

        Parameters
        ----------
        errors
            ``(R, N)`` for each function.  Those of the state's parts hold what reaches
            them from outside and become the whole error; those of later stages are
            filled.

        Returns
        -------
        results, start
            Error at the results of the recurrent weights, ``(R, gates * N)`` for each
            stage, and at the initial state, ``(B, N)`` for each part.
        """
        n_later = self.n_stages - 1
        in_time = [self.rows(e) for e in errors]
        shape = (len(errors[0]), len(self.weight))
        results = [np.empty(shape, dtype=self.weight.dtype) for _ in range(self.n_stages)]
        for block, channels in zip(results, self.by_channel, strict=True):
            for channel, terms in channels:
                if not terms:
                    block[:, channel] = 0.0
        results_in_time = [self.rows(r) for r in results]
        carry: list[Rows | None] = [None] * self.n_parts
        for t in reversed(range(len(self.sizes))):
            for rows, back in zip(in_time[n_later:], carry, strict=True):
                if back is not None:
                    rows[t][: len(back)] += back
            carry = [None] * self.n_parts
            for j in reversed(range(self.n_stages)):
                result = results_in_time[j][t]
                for channel, terms in self.by_channel[j]:
                    target = result[:, channel]
                    for k, (i, slope) in enumerate(terms):
                        if k == 0:
                            np.multiply(slope[t], in_time[i][t], out=target)
                        else:
                            target += slope[t] * in_time[i][t]
                if j > 0:
                    np.dot(result, self.weight, out=in_time[j - 1][t])
                else:
                    carry[0] = np.dot(result, self.weight)
            for i, row in enumerate(self.state):
                for p, slope in row:
                    part = slope[t] * in_time[i][t]
                    before = carry[p]
                    carry[p] = part if before is None else np.add(before, part, out=before)
        zero = np.zeros((self.sizes[0], self.weight.shape[1]), dtype=self.weight.dtype)
        return results, [zero if c is None else c for c in carry]


class RecurrentLinearised(Linearised):
    r"""A recurrent policy near the current parameters, by full-length BPTT (section 2.4).

    Notes
    -----
    A cell alternates the recurrent weights :math:`r_j = K u_j` with functions of each
    unit alone: :math:`u_1 = h` and, for an integrator with several stages,
    :math:`u_2(x, h, r_1)` and so on, up to the new state.  The gradient of the *sum* over
    units of such a function is therefore its slope at every unit.  One backward pass for
    each function, over all steps of the batch together, gives all slopes; from then on
    the network is a linear recurrence,

    .. math:: du_j = e_j + \sum_k \frac{\partial u_j}{\partial r_k} \circ K\,du_k
              + \frac{\partial u_j}{\partial h} \circ dh,

    whose sources :math:`e` (the parameters' direct effects) are products over the whole
    block.  :math:`Jv` runs it forward in time and :math:`J^\top u` runs its transpose
    backward, with nothing recomputed and no graph.
    """

    def __init__(self, policy: RecurrentPolicy, sequences: Sequences) -> None:
        self.policy = policy
        self.head = policy.head.weight.detach().clone()
        self.inputs = sequences.inputs
        self.packing = sequences.packing
        self.sizes = sequences.packing.sizes
        with torch.no_grad():
            drive = policy.input(self.inputs)
            start = policy.initial_state(self.packing.n_episodes)
            states = policy.unroll(drive, self.sizes, start)
            before = torch.cat([start, states[torch.as_tensor(self.packing.previous)]])
            self.hidden = states[:, : policy.units].contiguous()
            self.mean = policy.head(self.hidden)
        with torch.enable_grad():
            coefficients = policy.coefficients()
            self._find_coefficient_slopes(coefficients)
            self._find_slopes(drive, before, coefficients)

    def _find_coefficient_slopes(self, coefficients: tuple[Tensor, ...]) -> None:
        """Slope of each coefficient in each parameter, unit by unit."""
        parameters = self.policy.trainable()
        self.coefficient_slopes: list[dict[str, Tensor]] = []
        for c in coefficients:
            if not c.requires_grad:
                self.coefficient_slopes.append({})
                continue
            slopes = torch.autograd.grad(c.sum(), list(parameters.values()), allow_unused=True)
            named = zip(parameters, slopes, strict=True)
            self.coefficient_slopes.append({name: s for name, s in named if s is not None})

    def _find_slopes(self, drive: Tensor, before: Tensor, values: tuple[Tensor, ...]) -> None:
        """Slopes of every function of the cell in every argument, at every step."""
        policy = self.policy
        n_units = policy.units
        drive = drive.detach().requires_grad_()
        state = before.detach().requires_grad_()
        coefficients = [c.detach().expand(len(drive), -1).requires_grad_() for c in values]
        arguments: list[Tensor] = []
        results: list[Tensor] = []

        def recur(u: Tensor) -> Tensor:
            with torch.no_grad():
                r = functional.linear(u, policy.recurrent.weight)
            arguments.append(u)
            results.append(r.requires_grad_())
            return r

        after = policy.cell(drive, state, recur, *coefficients)
        if not torch.equal(arguments[0], before[:, :n_units]):
            raise ValueError(
                f"the cell of {type(policy).__name__} first applies its recurrent weights to "
                "something other than h; the first call of recur must be on h."
            )
        self.arguments = [u.detach().contiguous() for u in arguments]
        functions = [*arguments[1:], *after.split(n_units, dim=1)]
        leaves = [drive, state, *results, *coefficients]
        slopes = [
            torch.autograd.grad(f.sum(), leaves, retain_graph=True, allow_unused=True)
            for f in functions
        ]
        self.n_stages = len(results)
        places = {
            "drive": [0],
            "state": [1],
            "recurrent": list(range(2, 2 + self.n_stages)),
            "coefficient": list(range(2 + self.n_stages, len(leaves))),
        }
        self.slopes = {
            kind: [[_channels(row[i], n_units) for i in where] for row in slopes]
            for kind, where in places.items()
        }
        self.recurrence = LinearRecurrence(
            policy.recurrent.weight.detach().numpy().copy(),
            [
                [[(c, d.numpy()) for c, d in term] for term in row]
                for row in self.slopes["recurrent"]
            ],
            [[(c, d.numpy()) for c, d in row[0]] for row in self.slopes["state"]],
            self.sizes,
        )

    # ------------------------------------------------------------------------- J v
    def jvp(self, v: Tensor) -> Tensor:
        """The product :math:`Jv`; see :meth:`Linearised.jvp`."""
        with torch.no_grad():
            d = self.policy.split(v)
            changes = self._sources(d)
            start = self._initial_change(d)
            self.recurrence.forward([c.numpy() for c in changes], [s.numpy() for s in start])
            hidden = changes[self.n_stages - 1]
            change = functional.linear(self.hidden, d["head.weight"], d["head.bias"])
            return change.addmm_(hidden, self.head.T)

    def _initial_change(self, d: dict[str, Tensor]) -> list[Tensor]:
        """Change of the initial state, one ``(B, N)`` for each part."""
        zero = torch.zeros_like(self.policy.h0)
        change = d.get("h0", zero).expand(self.packing.n_episodes, -1)
        return list(change.split(self.policy.units, dim=1))

    def _sources(self, d: dict[str, Tensor]) -> list[Tensor]:
        """Direct effect of the parameters on every function of the cell, ``(R, N)`` each."""
        n = self.policy.units
        direct: dict[str, list[Tensor]] = {"drive": [], "recurrent": [], "coefficient": []}
        if "input.weight" in d:
            drive = functional.linear(self.inputs, d["input.weight"], d.get("input.bias"))
            direct["drive"] = [drive]
        if "recurrent.weight" in d:
            weight = d["recurrent.weight"]
            direct["recurrent"] = [functional.linear(u, weight) for u in self.arguments]
        direct["coefficient"] = self._coefficient_change(d)
        sources = []
        for i in range(len(self.slopes["state"])):
            source: Tensor | None = None
            for kind, changes in direct.items():
                for term, change in zip(self.slopes[kind][i], changes, strict=bool(changes)):
                    for c, slope in term:
                        part = change[..., c * n : (c + 1) * n]
                        if source is None:
                            source = slope * part
                        else:
                            source.addcmul_(slope, part)
            sources.append(torch.zeros_like(self.hidden) if source is None else source)
        return sources

    def _coefficient_change(self, d: dict[str, Tensor]) -> list[Tensor]:
        """Change of each coefficient, shape ``(N,)``, by the chain rule."""
        zero = torch.zeros(self.policy.units, dtype=self.hidden.dtype)
        return [
            sum((slope * d[name] for name, slope in slopes.items()), zero)
            for slopes in self.coefficient_slopes
        ]

    # ----------------------------------------------------------------------- J^T u
    def vjp(self, u: Tensor) -> Tensor:
        r"""The product :math:`J^\top u`; see :meth:`Linearised.vjp`."""
        with torch.no_grad():
            gradient = {
                "head.weight": u.T @ self.hidden,
                "head.bias": u.sum(0),
            }
            errors = [torch.empty_like(self.hidden) for _ in range(self.n_stages - 1)]
            errors += [u @ self.head]
            errors += [torch.zeros_like(self.hidden) for _ in range(self.policy.parts - 1)]
            results, first = self.recurrence.backward([e.numpy() for e in errors])
            trainable = self.policy.trainable()
            if "recurrent.weight" in trainable:
                pairs = zip(results, self.arguments, strict=True)
                products = [torch.from_numpy(r).T @ a for r, a in pairs]
                gradient["recurrent.weight"] = torch.stack(products).sum(0)
            if "input.weight" in trainable:
                drive = self._drive_error(errors)
                gradient["input.weight"] = drive.T @ self.inputs
                if "input.bias" in trainable:
                    gradient["input.bias"] = drive.sum(0)
            if "h0" in trainable:
                gradient["h0"] = torch.cat([torch.from_numpy(s).sum(0) for s in first])
            self._add_coefficient_gradients(gradient, errors)
            return self.policy.join(gradient)

    def _drive_error(self, errors: list[Tensor]) -> Tensor:
        """Error at the input's affine map, shape ``(R, gates * N)``."""
        n = self.policy.units
        total = torch.zeros((len(self.inputs), self.policy.gates * n), dtype=self.inputs.dtype)
        for row, error in zip(self.slopes["drive"], errors, strict=True):
            for c, slope in row[0]:
                total[:, c * n : (c + 1) * n].addcmul_(slope, error)
        return total

    def _add_coefficient_gradients(self, gradient: dict[str, Tensor], errors: list[Tensor]) -> None:
        """Add what reaches the parameters through the coefficients of the units."""
        for i, slopes in enumerate(self.coefficient_slopes):
            if not slopes:
                continue
            total = torch.zeros(self.policy.units, dtype=self.hidden.dtype)
            for row, error in zip(self.slopes["coefficient"], errors, strict=True):
                for _, slope in row[i]:
                    total += (slope * error).sum(0)
            for name, slope in slopes.items():
                gradient[name] = gradient.get(name, 0) + slope * total


def _channels(slope: Tensor | None, n_units: int) -> list[tuple[int, Tensor]]:
    """Slopes channel by channel, without the channels that are 0 everywhere."""
    if slope is None:
        return []
    pieces = enumerate(slope.split(n_units, dim=1))
    return [(c, piece.contiguous()) for c, piece in pieces if bool(piece.any())]
