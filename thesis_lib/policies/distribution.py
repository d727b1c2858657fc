"""The diagonal Gaussian every policy of chapter 5 ends in (section 5.2).

The mean is a function of the state; the logarithm of the standard deviation is one free
vector.  All functions work row by row on tensors of shape ``(R, A)``; ``log_std`` has
shape ``(A,)``.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor


def log_likelihood(actions: Tensor, mean: Tensor, log_std: Tensor) -> Tensor:
    r"""Log density of each action, :math:`\log \pi_\theta(a|s)`.

    Parameters
    ----------
    actions, mean
        Shape ``(R, A)``.
    log_std
        Shape ``(A,)``.

    Returns
    -------
    Tensor
        Shape ``(R,)``, in nats.
    """
    z = (actions - mean) * torch.exp(-log_std)
    constant = log_std.sum() + 0.5 * math.log(2 * math.pi) * actions.shape[-1]
    return -0.5 * z.square().sum(-1) - constant


def kl_divergence(mean: Tensor, log_std: Tensor, mean_q: Tensor, log_std_q: Tensor) -> Tensor:
    r""":math:`D_{KL}(p\|q) = \int p \log (p/q)` of two diagonal Gaussians (section 2.3.5).

    Parameters
    ----------
    mean, log_std
        Of p, shapes ``(R, A)`` and ``(A,)``.
    mean_q, log_std_q
        Of q, likewise.

    Returns
    -------
    Tensor
        Shape ``(R,)``, in nats.
    """
    precision = torch.exp(-2 * log_std_q)
    spread = torch.exp(2 * (log_std - log_std_q)) - 1 - 2 * (log_std - log_std_q)
    return 0.5 * ((mean - mean_q).square() * precision + spread).sum(-1)


def entropy(log_std: Tensor) -> Tensor:
    """Differential entropy of the policy, a scalar in nats; it does not depend on the state."""
    return (log_std + 0.5 * math.log(2 * math.pi * math.e)).sum()
