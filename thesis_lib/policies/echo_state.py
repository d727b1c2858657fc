"""Echo state network: a fixed random reservoir with a learned linear readout (section 5.2.5)."""

from __future__ import annotations

from typing import Unpack

import numpy as np
import torch
from scipy.sparse.linalg import ArpackNoConvergence, eigs
from torch import Tensor

from thesis_lib.checks import positive_number
from thesis_lib.policies.base import Linearised, Sequences
from thesis_lib.policies.initial import glorot_, random_source, uniform_
from thesis_lib.policies.recurrence import RecurrentLinearised
from thesis_lib.policies.recurrent import Recur, RecurrentOptions, RecurrentPolicy

WEIGHT_BOUND = 0.5
"""Fixed weights are drawn from U(-0.5, 0.5)."""

DENSE_EIGENVALUES = 1000
"""Reservoirs up to this size get their spectral radius from all eigenvalues."""


def spectral_radius(weight: np.ndarray) -> float:
    r"""Largest absolute eigenvalue of a square matrix, :math:`|\lambda_{max}|`.

    Parameters
    ----------
    weight
        Shape ``(N, N)``.

    Notes
    -----
    Large matrices go through Arnoldi iteration from a fixed start, so that the result is
    the same in every run.  The radius is good to about ten digits then.
    """
    n = len(weight)
    if n > DENSE_EIGENVALUES:
        try:
            values = eigs(weight, k=4, ncv=160, tol=1e-8, v0=np.ones(n), return_eigenvectors=False)
            return float(np.abs(values).max())
        except ArpackNoConvergence:
            pass
    return float(np.abs(np.linalg.eigvals(weight)).max())


class ESN(RecurrentPolicy):
    r"""Leaky reservoir :math:`h_n = (1 - l) h_{n-1} + l \tanh(K h_{n-1} + W x_n)` (section 5.2.5).

    W and K are fixed; only the readout and the standard deviations are learned.

    Parameters
    ----------
    observation_size, action_size, units
        Sizes.
    spectral_radius
        K is scaled to :math:`K r/|\lambda_{max}|`; 1.1 in table 5.1, 1.5 for the Ant.
    density
        Share of the entries of K that are not 0; 1.0 in table 5.1, 0.7 for the Ant.
    leak
        l in (0, 1]; 0.5 in the author's code, 1 in the text.
    seed
        Source of the reservoir and of the readout's initial weights.
    **options
        See :class:`~thesis_lib.policies.recurrent.RecurrentPolicy`.  The author also learned the
        state before the first step (``trainable_initial_state``).  This needs backpropagation
        through the reservoir, hundreds of times the cost, for something the reservoir forgets.

    Raises
    ------
    ValueError
        When the radius is not positive, or density or leak is outside (0, 1].
    """

    architecture = "esn"

    def __init__(
        self,
        observation_size: int,
        action_size: int,
        *,
        units: int,
        seed: int = 0,
        spectral_radius: float = 1.1,
        density: float = 1.0,
        leak: float = 0.5,
        **options: Unpack[RecurrentOptions],
    ) -> None:
        positive_number("spectral_radius", spectral_radius)
        for name, value in (("density", density), ("leak", leak)):
            if not 0 < value <= 1:
                raise ValueError(f"{name} is {value}, but it must be above 0 and at most 1.")
        super().__init__(observation_size, action_size, units, bias=False, **options)
        self.spectral_radius = float(spectral_radius)
        self.density = float(density)
        self.leak = float(leak)
        generator = random_source(seed)
        uniform_(self.input.weight, WEIGHT_BOUND, generator)
        self._fill_reservoir(generator)
        glorot_(self.head.weight, generator)
        self.input.requires_grad_(False)
        self.recurrent.requires_grad_(False)

    def _fill_reservoir(self, generator: torch.Generator) -> None:
        """Draw K, cut it to the density and scale it to the spectral radius."""
        weight = torch.empty((self.units, self.units), dtype=torch.float64)
        uniform_(weight, WEIGHT_BOUND, generator)
        n_cut = int((1 - self.density) * weight.numel())
        if n_cut:
            cut = torch.randperm(weight.numel(), generator=generator)[:n_cut]
            weight.view(-1)[cut] = 0.0
        largest = spectral_radius(weight.numpy())
        if largest == 0:
            raise ValueError(
                f"density {self.density} leaves {self.units} units without a cycle, so that the "
                "spectral radius is 0 and cannot be scaled; raise the density."
            )
        with torch.no_grad():
            self.recurrent.weight.copy_(weight * (self.spectral_radius / largest))

    @property
    def keeps_hidden(self) -> bool:
        """True unless the initial state is learned."""
        return not self.h0.requires_grad

    def eigenvalues(self) -> np.ndarray:
        """Eigenvalues of the recurrent weights, complex, shape ``(N,)``."""
        return np.linalg.eigvals(self.recurrent.weight.double().numpy())

    def cell(self, drive: Tensor, state: Tensor, recur: Recur, *coefficients: Tensor) -> Tensor:
        """The equation above; ``lerp(h, f, l)`` is :math:`(1 - l)h + lf`."""
        return torch.lerp(state, torch.tanh(drive + recur(state)), self.leak)

    def linearise(self, sequences: Sequences) -> Linearised:
        """A linear map of the kept reservoir states, unless the initial state is learned."""
        if self.keeps_hidden:
            return ReadoutLinearised(self, sequences)
        return RecurrentLinearised(self, sequences)


class ReadoutLinearised(Linearised):
    """A linear readout of fixed features: its mean is linear in the parameters already.

    Parameters
    ----------
    policy
        A policy that keeps its last hidden layer.
    sequences
        With ``hidden`` set.
    """

    def __init__(self, policy: ESN, sequences: Sequences) -> None:
        if sequences.hidden is None:
            raise ValueError(
                "the sequences hold no reservoir states; make them with policy.sequences."
            )
        self.policy = policy
        self.hidden = sequences.hidden
        with torch.no_grad():
            self.mean = policy.head(self.hidden)

    def jvp(self, v: Tensor) -> Tensor:
        """The product :math:`Jv`; see :meth:`Linearised.jvp`."""
        d = self.policy.split(v)
        return torch.nn.functional.linear(self.hidden, d["head.weight"], d["head.bias"])

    def vjp(self, u: Tensor) -> Tensor:
        r"""The product :math:`J^\top u`; see :meth:`Linearised.vjp`."""
        return self.policy.join({"head.weight": u.T @ self.hidden, "head.bias": u.sum(0)})
