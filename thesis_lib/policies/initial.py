"""Initial weights of a network: the laws they are drawn from."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from thesis_lib.checks import check_seed


def empty_linear(
    n_in: int, n_out: int, *, bias: bool = True, dtype: torch.dtype = torch.float32
) -> nn.Linear:
    """A linear layer whose weights the caller fills, with a zero bias.

    The usual constructor would draw from torch's global generator.
    """
    layer = nn.utils.skip_init(nn.Linear, n_in, n_out, bias=bias, dtype=dtype)
    if bias:
        nn.init.zeros_(layer.bias)
    return layer


def uniform_(weight: Tensor, bound: float, generator: torch.Generator) -> None:
    """Fill a weight from U(-bound, bound).

    Numbers are drawn in float64, so that both number types start from the same network.
    """
    draw = torch.rand(weight.shape, generator=generator, dtype=torch.float64)
    with torch.no_grad():
        weight.copy_((2 * draw - 1) * bound)


def random_source(seed: int) -> torch.Generator:
    """Torch's generator of a seed; ValueError for what is no integer from 0 to below 2**64."""
    return torch.Generator().manual_seed(check_seed(seed))


def glorot_(weight: Tensor, generator: torch.Generator, blocks: int = 1) -> None:
    """Fill a weight ``(n_out, n_in)`` from Glorot's uniform distribution.

    Parameters
    ----------
    weight
        Filled in place.
    generator
        Source of randomness.
    blocks
        Number of gates stacked along the first axis, each initialised by itself.
    """
    for block in weight.data.chunk(blocks):
        n_out, n_in = block.shape
        uniform_(block, math.sqrt(6 / (n_in + n_out)), generator)


def orthogonal_(weight: Tensor, gain: float, generator: torch.Generator, blocks: int = 1) -> None:
    """Fill a weight of stacked square gates with random orthogonal matrices times ``gain``."""
    for block in weight.data.chunk(blocks):
        draw = torch.randn(block.shape, generator=generator, dtype=torch.float64)
        q, r = torch.linalg.qr(draw)
        with torch.no_grad():
            block.copy_(gain * q * torch.sign(torch.diagonal(r)))
