"""The general way to products with the Jacobian of a policy's mean.

It serves any network written in torch.  The feedforward and recurrent policies know
faster ways, and the tests hold those against this one and against plain double
backpropagation.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.autograd import forward_ad
from torch.func import functional_call

from thesis_lib.policies.base import GaussianPolicy, Linearised, Sequences


class _Means(nn.Module):
    """The block of means as a module's forward, which ``functional_call`` asks for."""

    def __init__(self, policy: GaussianPolicy) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, sequences: Sequences) -> Tensor:
        return self.policy.means(sequences)


class DualLinearised(Linearised):
    r"""Products with J by dual numbers and by backpropagation through a kept graph.

    Parameters
    ----------
    policy
        Any policy.
    sequences
        R steps.

    Notes
    -----
    :math:`Jv` runs the network on numbers :math:`\theta + \epsilon v` with
    :math:`\epsilon^2 = 0`; :math:`J^\top u` runs backwards through a graph that is
    recorded once.
    """

    def __init__(self, policy: GaussianPolicy, sequences: Sequences) -> None:
        self.policy = policy
        self.sequences = sequences
        self._module = _Means(policy)
        copies = {name: p.detach().clone() for name, p in policy.trainable().items()}
        self._parameters = {name: p.requires_grad_() for name, p in copies.items()}
        with torch.enable_grad():
            named = {f"policy.{name}": p for name, p in self._parameters.items()}
            self._graph = functional_call(self._module, named, (sequences,))
        self.mean = self._graph.detach()

    def jvp(self, v: Tensor) -> Tensor:
        """The product :math:`Jv` by dual numbers; see :meth:`Linearised.jvp`."""
        with torch.no_grad(), forward_ad.dual_level():
            tangents = self.policy.split(v)
            duals = {
                f"policy.{name}": forward_ad.make_dual(p.detach(), tangents[name])
                for name, p in self._parameters.items()
            }
            mean = functional_call(self._module, duals, (self.sequences,))
            tangent = forward_ad.unpack_dual(mean).tangent
            return torch.zeros_like(self.mean) if tangent is None else tangent

    def vjp(self, u: Tensor) -> Tensor:
        r"""The product :math:`J^\top u` backwards; see :meth:`Linearised.vjp`."""
        parameters = self._parameters
        gradients = torch.autograd.grad(
            self._graph, list(parameters.values()), u, retain_graph=True, allow_unused=True
        )
        named = zip(parameters, gradients, strict=True)
        return self.policy.join({name: g for name, g in named if g is not None})
