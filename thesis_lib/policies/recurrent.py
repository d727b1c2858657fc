r"""What the recurrent policies share: the loop over time and its linearisation.

A cell is written once, as a function of

- ``drive``, the input's affine map :math:`Wx + b`, computed for a whole block at once,
- ``state``, what the cell carries from step to step,
- ``recur``, a function that applies the recurrent weights, :math:`h \mapsto Kh`,
- coefficients of the units, such as :math:`\Delta t/\tau`,

and apart from ``recur`` it works on each unit alone.  This is true of all networks of
section 5.2.  It makes both products with the Jacobian cheap: see
:class:`~thesis_lib.policies.recurrence.RecurrentLinearised`.  A cell of your own that mixes
units in another way than through ``recur`` must override :meth:`RecurrentPolicy.linearise`
with :class:`~thesis_lib.policies.DualLinearised`.
"""

from __future__ import annotations

import abc
from collections.abc import Callable
from functools import partial
from typing import Unpack

import torch
from torch import Tensor, nn
from torch.nn import functional

from thesis_lib.policies.base import GaussianPolicy, Linearised, PolicyOptions, Sequences
from thesis_lib.policies.initial import empty_linear

Recur = Callable[[Tensor], Tensor]


class RecurrentOptions(PolicyOptions, total=False):
    """What every recurrent policy takes by these names; see :class:`RecurrentPolicy`."""

    previous_action: bool
    trainable_initial_state: bool


class RecurrentPolicy(GaussianPolicy):
    """A recurrent layer and a linear map from its output to the mean (section 5.2).

    Parameters
    ----------
    observation_size, action_size
        See :class:`~thesis_lib.policies.base.GaussianPolicy`.
    units
        Number N of hidden units.
    gates
        Number of affine maps of the input (and of the hidden layer) each unit needs.
    parts
        Number of values each unit carries; the state is ``parts`` vectors of length N
        side by side, the first of which is the layer's output h.
    bias
        Whether the affine map of the input has a bias.
    trainable_initial_state
        Whether the state before the first step is learned; it starts at 0 either way.
    previous_action, **options
        See :class:`~thesis_lib.policies.base.GaussianPolicy`.
    """

    def __init__(
        self,
        observation_size: int,
        action_size: int,
        units: int,
        *,
        gates: int = 1,
        parts: int = 1,
        bias: bool = True,
        trainable_initial_state: bool = False,
        previous_action: bool = True,
        **options: Unpack[PolicyOptions],
    ) -> None:
        super().__init__(
            observation_size, action_size, units, previous_action=previous_action, **options
        )
        self.units = units
        self.gates = gates
        self.parts = parts
        self.input = empty_linear(self.input_size, gates * units, bias=bias, dtype=self.dtype)
        self.recurrent = empty_linear(units, gates * units, bias=False, dtype=self.dtype)
        start = torch.zeros(parts * units, dtype=self.dtype)
        self.h0 = nn.Parameter(start, requires_grad=trainable_initial_state)

    @property
    def state_size(self) -> int:
        """``parts`` times the number of units."""
        return self.parts * self.units

    @abc.abstractmethod
    def cell(self, drive: Tensor, state: Tensor, recur: Recur, *coefficients: Tensor) -> Tensor:
        """One step of the network.

        Parameters
        ----------
        drive
            :math:`Wx + b`, shape ``(n, gates * N)``.
        state
            Shape ``(n, parts * N)``.
        recur
            Maps ``(n, N)`` to ``(n, gates * N)``; its first call is on h, the first part
            of the state.
        *coefficients
            From :meth:`coefficients`.

        Returns
        -------
        Tensor
            The new state, shape ``(n, parts * N)``.
        """

    def coefficients(self) -> tuple[Tensor, ...]:
        """Numbers of each unit, each of shape ``(N,)``.

        A unit's number may depend on the unit's own entries of parameters of length N.
        """
        return ()

    def initial_state(self, n: int) -> Tensor:
        """The same state for every world, shape ``(n, parts * N)``."""
        return self.h0.expand(n, -1)

    def advance(self, inputs: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """One step: the new h, and the new state."""
        recur = partial(functional.linear, weight=self.recurrent.weight)
        state = self.cell(self.input(inputs), state, recur, *self.coefficients())
        return state[:, : self.units], state

    def run(self, inputs: Tensor, sizes: list[int], state: Tensor) -> tuple[Tensor, Tensor]:
        """The loop over time; the input's affine map is one product for the whole block."""
        states = self.unroll(self.input(inputs), sizes, state)
        return states[:, : self.units], states

    def unroll(self, drive: Tensor, sizes: list[int], state: Tensor) -> Tensor:
        """States after every step, shape ``(R, parts * N)``, from the block of drives."""
        recur = partial(functional.linear, weight=self.recurrent.weight)
        coefficients = self.coefficients()
        states = []
        for x in torch.split(drive, sizes):
            if len(x) < len(state):
                state = state[: len(x)]
            state = self.cell(x, state, recur, *coefficients)
            states.append(state)
        return torch.cat(states)

    def linearise(self, sequences: Sequences) -> Linearised:
        """Keep each unit's slopes at every step; see :mod:`~thesis_lib.policies.recurrence`."""
        from thesis_lib.policies.recurrence import RecurrentLinearised

        return RecurrentLinearised(self, sequences)
