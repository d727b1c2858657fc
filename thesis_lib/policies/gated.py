"""The gated recurrent nets: LSTM (section 5.2.3) and GRU (section 5.2.4)."""

from __future__ import annotations

from typing import Unpack

import torch
from torch import Tensor

from thesis_lib.checks import one_of
from thesis_lib.policies.initial import glorot_, orthogonal_, random_source
from thesis_lib.policies.recurrent import Recur, RecurrentOptions, RecurrentPolicy

INITIALISATIONS = ("glorot", "orthogonal")
"""Glorot-uniform everywhere, or recurrent gates orthogonal with gain 1.1."""

CANDIDATES = ("tanh", "logistic")
"""Transfer function of the LSTM's candidate: the author's code, and the text."""

ORTHOGONAL_GAIN = 1.1


class _Gated(RecurrentPolicy):
    """Initialisation shared by the gated nets."""

    def _initialise(self, initialisation: str, seed: int) -> None:
        generator = random_source(seed)
        glorot_(self.input.weight, generator, blocks=self.gates)
        if initialisation == "orthogonal":
            orthogonal_(self.recurrent.weight, ORTHOGONAL_GAIN, generator, blocks=self.gates)
        else:
            glorot_(self.recurrent.weight, generator, blocks=self.gates)
        glorot_(self.head.weight, generator)


class GRU(_Gated):
    r"""Gated recurrent unit (section 5.2.4).

    .. math::
        g^{reset}, g^{update} &= \sigma(K h_{n-1} + W x_n + b) \\
        \tilde h_n &= \tanh(g^{reset} \circ K h_{n-1} + W x_n + b) \\
        h_n &= g^{update} \circ h_{n-1} + (1 - g^{update}) \circ \tilde h_n

    Gates are stacked in the order reset, update, candidate.

    Parameters
    ----------
    observation_size, action_size, units
        Sizes.
    initialisation
        ``"glorot"`` (the author's Theano net) or ``"orthogonal"`` (the TensorFlow one).
    seed
        Source of the initial weights; biases are 0.
    **options
        See :class:`~thesis_lib.policies.recurrent.RecurrentPolicy`.
    """

    architecture = "gru"

    def __init__(
        self,
        observation_size: int,
        action_size: int,
        *,
        units: int,
        seed: int = 0,
        initialisation: str = "glorot",
        **options: Unpack[RecurrentOptions],
    ) -> None:
        one_of("initialisation", initialisation, INITIALISATIONS)
        super().__init__(observation_size, action_size, units, gates=3, **options)
        self._initialise(initialisation, seed)

    def cell(self, drive: Tensor, state: Tensor, recur: Recur, *coefficients: Tensor) -> Tensor:
        """The equations above."""
        n = self.units
        r = recur(state)
        gates = torch.sigmoid(drive[..., : 2 * n] + r[..., : 2 * n])
        reset, update = gates[..., :n], gates[..., n:]
        candidate = torch.tanh(torch.addcmul(drive[..., 2 * n :], reset, r[..., 2 * n :]))
        return torch.lerp(candidate, state, update)


class LSTM(_Gated):
    r"""Long short-term memory without peepholes (section 5.2.3, equation 5.3).

    .. math::
        g^i &= f^i(K^i h_{n-1} + W^i x_n + b^i) \\
        c_n &= g^{forget} \circ c_{n-1} + g^{input} \circ g^{cell} \\
        h_n &= \tanh(c_n) \circ g^{output}

    Gates are stacked in the order input, forget, output, cell; the state is h, then c.

    Parameters
    ----------
    observation_size, action_size, units
        Sizes.
    candidate
        Transfer function of :math:`g^{cell}`: ``"tanh"`` (the author's code) or
        ``"logistic"`` (the text).
    forget_bias
        Constant added inside the forget gate; not learned.
    initialisation
        ``"orthogonal"`` (the author's code) or ``"glorot"``.
    seed
        Source of the initial weights; biases are 0.
    **options
        See :class:`~thesis_lib.policies.recurrent.RecurrentPolicy`.
    """

    architecture = "lstm"

    def __init__(
        self,
        observation_size: int,
        action_size: int,
        *,
        units: int,
        seed: int = 0,
        candidate: str = "tanh",
        forget_bias: float = 1.0,
        initialisation: str = "orthogonal",
        **options: Unpack[RecurrentOptions],
    ) -> None:
        one_of("initialisation", initialisation, INITIALISATIONS)
        one_of("candidate", candidate, CANDIDATES)
        super().__init__(observation_size, action_size, units, gates=4, parts=2, **options)
        self.candidate = torch.tanh if candidate == "tanh" else torch.sigmoid
        shift = torch.zeros(3 * units, dtype=self.dtype)
        shift[units : 2 * units] = forget_bias
        self.register_buffer("gate_shift", shift, persistent=False)
        self.gate_shift: Tensor
        self._initialise(initialisation, seed)

    def cell(self, drive: Tensor, state: Tensor, recur: Recur, *coefficients: Tensor) -> Tensor:
        """The equations above."""
        n = self.units
        h, c = state[..., :n], state[..., n:]
        z = drive + recur(h)
        gates = torch.sigmoid(z[..., : 3 * n] + self.gate_shift)
        new = self.candidate(z[..., 3 * n :])
        c = torch.addcmul(gates[..., n : 2 * n] * c, gates[..., :n], new)
        return torch.cat([torch.tanh(c) * gates[..., 2 * n :], c], -1)
