"""Feedforward policies: FFWD, DFFWD and the two extra nets of figure 5.5."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Unpack

import torch
from torch import Tensor, nn
from torch.nn import functional

from thesis_lib.checks import one_of
from thesis_lib.policies.base import GaussianPolicy, Linearised, PolicyOptions, Sequences
from thesis_lib.policies.initial import empty_linear, glorot_, random_source

Activation = Callable[[Tensor], Tensor]

ACTIVATIONS: Mapping[str, Activation] = {"tanh": torch.tanh, "softplus": functional.softplus}
"""Transfer functions by name; tanh unless said otherwise (section 2.4).

:meta hide-value:
"""

INITIALISATIONS = ("glorot", "orthogonal")
"""Laws of the initial weights."""

MIN_LOG_STD = -13.815510557964274
"""Floor under the logarithm of the standard deviation, that of 1e-6, as in the author's code."""

CHUNK = 2000
"""Rows worked on at a time, so that a chunk's layers stay in the processor's cache."""


class FeedforwardPolicy(GaussianPolicy):
    r"""Layers :math:`h_l = f(W_l h_{l-1} + b_l)` and a linear map to the mean (section 2.4).

    Parameters
    ----------
    observation_size, action_size
        See :class:`~thesis_lib.policies.base.GaussianPolicy`.
    hidden
        Units of each hidden layer; empty for a policy that is linear in its input.
    activation
        ``"tanh"`` or ``"softplus"``, :math:`\log(1 + e^x)`, on every hidden layer.
    bias
        Whether layers have a bias.
    initialisation
        ``"glorot"``, Glorot-uniform weights as in the author's code, or ``"orthogonal"``:
        orthogonal ones with gain sqrt(2) in the hidden layers and 1 in the head, as many
        libraries have it.
    seed
        Of the weights; biases are 0.
    previous_action, **options
        See :class:`~thesis_lib.policies.base.GaussianPolicy`; the floor under the
        standard deviation is by default :data:`MIN_LOG_STD`.
    """

    architecture = "ffwd"

    def __init__(
        self,
        observation_size: int,
        action_size: int,
        *,
        hidden: Sequence[int],
        activation: str = "tanh",
        bias: bool = True,
        initialisation: str = "glorot",
        seed: int = 0,
        previous_action: bool = False,
        **options: Unpack[PolicyOptions],
    ) -> None:
        one_of("activation", activation, ACTIVATIONS)
        one_of("initialisation", initialisation, INITIALISATIONS)
        for size in hidden:
            if size < 1:
                raise ValueError(f"hidden has a layer of {size} units, but at least 1 is needed.")
        options.setdefault("min_log_std", MIN_LOG_STD)
        features = options.get("features")
        seen = observation_size if features is None else len(features)
        n_inputs = seen + (action_size if previous_action else 0)
        super().__init__(
            observation_size,
            action_size,
            [n_inputs, *hidden][-1],
            previous_action=previous_action,
            **options,
        )
        self.activation = ACTIVATIONS[activation]
        widths = [n_inputs, *hidden]
        self.layers = nn.ModuleList(
            empty_linear(i, o, bias=bias, dtype=self.dtype) for i, o in pairwise(widths)
        )
        if not bias:
            self.head = empty_linear(self.hidden_size, action_size, bias=False, dtype=self.dtype)
        generator = random_source(seed)
        for layer in [*self.layers, self.head]:
            if initialisation == "glorot":
                glorot_(layer.weight, generator)
            else:
                gain = 1.0 if layer is self.head else math.sqrt(2)
                nn.init.orthogonal_(layer.weight, gain, generator)

    def initial_state(self, n: int) -> Tensor:
        """A feedforward net carries nothing: shape ``(n, 0)``."""
        return torch.zeros((n, 0), dtype=self.dtype)

    def advance(self, inputs: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """The hidden layers; the state passes through."""
        h = inputs
        for layer in self.layers:
            h = self.activation(layer(h))
        return h, state

    def run(self, inputs: Tensor, sizes: list[int], state: Tensor) -> tuple[Tensor, Tensor]:
        """All rows at once, chunk by chunk."""
        hidden = [self.advance(rows, state)[0] for rows in torch.split(inputs, CHUNK)]
        return torch.cat(hidden), inputs.new_zeros((len(inputs), 0))

    def linearise(self, sequences: Sequences) -> Linearised:
        """Keep each layer's output and slope; see :class:`FeedforwardLinearised`."""
        return FeedforwardLinearised(self, sequences)


class FeedforwardLinearised(Linearised):
    r"""A feedforward policy near the current parameters.

    Every layer is an affine map followed by a function of each unit alone.  The slopes
    of the second are found once, by backpropagation through it; then

    - :math:`dh_l = f'(z_l) \circ (W_l\,dh_{l-1} + dW_l\,h_{l-1} + db_l)` gives :math:`Jv`,
    - backpropagation gives :math:`J^\top u`.

    Parameters
    ----------
    policy
        The network.
    sequences
        R steps.
    """

    def __init__(self, policy: FeedforwardPolicy, sequences: Sequences) -> None:
        self.policy = policy
        linear = [*policy.layers, policy.head]
        self.names = [*(f"layers.{i}" for i in range(len(policy.layers))), "head"]
        self.weights = [layer.get_parameter("weight").detach().clone() for layer in linear]
        self.chunks: list[tuple[list[Tensor], list[Tensor]]] = []
        means = []
        for rows in torch.split(sequences.inputs, CHUNK):
            outputs, slopes = [rows], []
            for layer in policy.layers:
                z = layer(outputs[-1]).detach().requires_grad_()
                with torch.enable_grad():
                    h = policy.activation(z)
                    (slope,) = torch.autograd.grad(h.sum(), z)
                outputs.append(h.detach())
                slopes.append(slope)
            means.append(policy.head(outputs[-1]).detach())
            self.chunks.append((outputs, slopes))
        self.mean = torch.cat(means)

    def jvp(self, v: Tensor) -> Tensor:
        """The product :math:`Jv`, layer by layer; see :meth:`Linearised.jvp`."""
        d = self.policy.split(v)
        with torch.no_grad():
            return torch.cat([self._jvp(d, *chunk) for chunk in self.chunks])

    def _jvp(self, d: dict[str, Tensor], outputs: list[Tensor], slopes: list[Tensor]) -> Tensor:
        tangent: Tensor | None = None
        for i, (name, weight) in enumerate(zip(self.names, self.weights, strict=True)):
            change = functional.linear(outputs[i], d[f"{name}.weight"], d.get(f"{name}.bias"))
            if tangent is not None:
                change.addmm_(tangent, weight.T)
            tangent = change if name == "head" else change.mul_(slopes[i])
        return change

    def vjp(self, u: Tensor) -> Tensor:
        r"""The product :math:`J^\top u` by backpropagation; see :meth:`Linearised.vjp`."""
        total = {key: torch.zeros_like(p) for key, p in self.policy.trainable().items()}
        with torch.no_grad():
            for rows, (outputs, slopes) in zip(torch.split(u, CHUNK), self.chunks, strict=True):
                error = rows
                for i in reversed(range(len(self.weights))):
                    total[f"{self.names[i]}.weight"].addmm_(error.T, outputs[i])
                    if f"{self.names[i]}.bias" in total:
                        total[f"{self.names[i]}.bias"].add_(error.sum(0))
                    if i > 0:
                        error = torch.mm(error, self.weights[i]).mul_(slopes[i - 1])
        return self.policy.join(total)
