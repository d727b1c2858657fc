"""Solve a linear system by products with its matrix (line 8 of algorithm 6)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True, eq=False)
class Solution:
    """What conjugate gradient found.

    Attributes
    ----------
    x
        Approximate solution, shape ``(P,)``.
    product
        F x, which costs nothing more: it is b less the residual.
    iterations
        Products with the matrix that were made.
    residual
        Norm of b - F x over the norm of b.
    """

    x: Tensor
    product: Tensor
    iterations: int
    residual: float


def conjugate_gradient(
    product: Callable[[Tensor], Tensor],
    b: Tensor,
    iterations: int = 10,
    tolerance: float = 1e-10,
) -> Solution:
    r"""Approximate :math:`F^{-1} b` for a symmetric positive definite F.

    Parameters
    ----------
    product
        Maps v to F v, both of shape ``(P,)``.
    b
        Right-hand side, shape ``(P,)``.
    iterations
        Most products with F.
    tolerance
        Stop when the squared norm of the residual falls below this.

    Raises
    ------
    FloatingPointError
        When a product is not a number.

    Notes
    -----
    Source: line 8 of algorithm 6.  The vectors are short, so that they are kept in
    float64 whatever the number type of the network.  Where rounding in the products makes
    a curvature negative nothing more can be learned from them, and the iteration stops.
    """
    b = b.double()
    x = torch.zeros_like(b)
    residual = b.clone()
    direction = b.clone()
    squared = float(residual @ residual)
    made = 0
    while made < iterations and squared > tolerance:
        along = product(direction).double()
        made += 1
        curvature = float(direction @ along)
        if math.isnan(curvature):
            raise FloatingPointError("a product with the Fisher matrix is not a number.")
        if curvature <= 0:
            break
        length = squared / curvature
        x += length * direction
        residual -= length * along
        before, squared = squared, float(residual @ residual)
        direction = residual + (squared / before) * direction
    size = float(b.norm())
    return Solution(x, b - residual, made, squared**0.5 / size if size > 0 else 0.0)
