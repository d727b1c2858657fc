r"""A neural baseline, for comparison with the linear one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.checks import positive_number
from thesis_lib.policies.initial import empty_linear, random_source


def set_gradient(layers: Sequence[nn.Linear], x: Tensor, target: Tensor) -> None:
    r"""Set the gradient of :math:`\langle (R_t - b(s_t))^2 \rangle` by backpropagation.

    On minibatches of this size automatic differentiation spends more time on keeping books
    than on arithmetic.

    Parameters
    ----------
    layers
        Affine layers with tanh between them, the last with one output; each parameter has a
        ``grad`` to write to.
    x
        Observations, shape ``(R, D)``.
    target
        :math:`R_t`, shape ``(R,)``.
    """
    parts = [(p.weight.detach(), p.bias.detach(), p.weight.grad, p.bias.grad) for p in layers]
    outputs = [x]
    for weight, bias, _, _ in parts[:-1]:
        outputs.append(functional.linear(outputs[-1], weight, bias).tanh_())
    values = functional.linear(outputs[-1], *parts[-1][:2])
    error = (values - target[:, None]) * (2 / len(x))
    for k in reversed(range(len(parts))):
        weight, _, weight_gradient, bias_gradient = parts[k]
        torch.mm(error.T, outputs[k], out=weight_gradient)
        torch.sum(error, 0, out=bias_gradient)
        if k > 0:  # the derivative of tanh is 1 - tanh^2
            error = torch.mm(error, weight).mul_(1 - outputs[k].square())


class ValueNetwork:
    r"""A network of tanh layers as baseline :math:`b(s_t)`, fitted by Adam from where it was.

    It sees the observation alone and not the time, so that it estimates the value of a
    state; use it with ``Learner(bootstrap=True)`` where a time limit cuts episodes.

    Parameters
    ----------
    hidden
        Units of each hidden layer.
    learning_rate
        Adam's.
    epochs
        Passes over the batch in each fit.
    minibatch
        Steps of a gradient.
    seed
        Of the initial weights (orthogonal) and of the order of the steps.
    dtype
        Number type of the network.

    Raises
    ------
    ValueError
        When a setting is not positive.

    Notes
    -----
    Not in the thesis, whose baseline is :class:`~thesis_lib.optimisation.LinearBaseline`;
    libraries such as Stable-Baselines3 have one like this.  It predicts 0 before its
    first fit.
    """

    def __init__(
        self,
        hidden: Sequence[int] = (100, 50, 25),
        *,
        learning_rate: float = 1e-3,
        epochs: int = 10,
        minibatch: int = 128,
        seed: int = 0,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        for name, value in (
            ("learning_rate", learning_rate),
            ("epochs", epochs),
            ("minibatch", minibatch),
            ("the smallest layer of hidden", min(hidden, default=1)),
        ):
            positive_number(name, value)
        self.hidden = tuple(hidden)
        self.learning_rate = learning_rate
        self.epochs = epochs
        self.minibatch = minibatch
        self.dtype = dtype
        self._generator = random_source(seed)
        self._net: nn.Sequential | None = None
        self._adam: torch.optim.Adam | None = None

    def _build(self, n_inputs: int) -> tuple[nn.Sequential, torch.optim.Adam]:
        widths = [n_inputs, *self.hidden, 1]
        layers: list[nn.Module] = []
        for k, (before, after) in enumerate(pairwise(widths)):
            layer = empty_linear(before, after, dtype=self.dtype)
            gain = 1.0 if k == len(widths) - 2 else math.sqrt(2)
            nn.init.orthogonal_(layer.weight, gain, self._generator)
            layers += [layer, nn.Tanh()]
        net = nn.Sequential(*layers[:-1])
        for p in net.parameters():
            p.grad = torch.zeros_like(p)
        adam = torch.optim.Adam(net.parameters(), lr=self.learning_rate, fused=True)
        self._net, self._adam = net, adam
        return net, adam

    def fit(self, observations: FloatArray, time: IntArray, returns: FloatArray) -> None:
        r"""Lower the mean of :math:`(R_t - b(s_t))^2` over minibatches of steps.

        Parameters
        ----------
        observations
            What the policy sees, shape ``(R, D)``.
        time
            Not used.
        returns
            What to predict, shape ``(R,)``.
        """
        x = torch.as_tensor(observations, dtype=self.dtype)
        target = torch.as_tensor(returns, dtype=self.dtype)
        if self._net is None or self._adam is None:
            net, adam = self._build(x.shape[1])
        else:
            net, adam = self._net, self._adam
        layers = [layer for layer in net if isinstance(layer, nn.Linear)]
        for _ in range(self.epochs):
            order = torch.randperm(len(x), generator=self._generator)
            parts = (t[order].split(self.minibatch) for t in (x, target))
            for rows, wanted in zip(*parts, strict=True):
                set_gradient(layers, rows, wanted)
                adam.step()

    def predict(self, observations: FloatArray, time: IntArray) -> FloatArray:
        """Baseline of every step, shape ``(R,)``; ``time`` is not used."""
        if self._net is None:
            return np.zeros(len(observations))
        with torch.no_grad():
            values = self._net(torch.as_tensor(observations, dtype=self.dtype))[:, 0]
        return np.asarray(values.numpy(), dtype=np.float64)

    def state_dict(self) -> dict[str, Any]:
        """Everything an interrupted run needs to go on as if it had not been."""
        return {
            "generator": self._generator.get_state(),
            "net": None if self._net is None else self._net.state_dict(),
            "adam": None if self._adam is None else self._adam.state_dict(),
        }

    def __getstate__(self) -> dict[str, Any]:
        # Copied parameters would lose the gradients that :func:`set_gradient` writes into.
        return {**self.__dict__, "_net": None, "_adam": None, "learned": self.state_dict()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        learned = state.pop("learned")
        self.__dict__.update(state)
        self.load_state_dict(learned)

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take up the state of an interrupted run; ValueError when its number type is another."""
        if state["net"] is not None:
            first = state["net"]["0.weight"]
            if first.dtype != self.dtype:
                raise ValueError(
                    f"the state of a baseline is of type {first.dtype}, but this one has "
                    f"{self.dtype}: make one of that type."
                )
            net, adam = self._build(first.shape[1])
            net.load_state_dict(state["net"])
            adam.load_state_dict(state["adam"])
        self._generator.set_state(state["generator"])
