r"""Natural policy gradient (section 2.3.5, equation 2.15)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from torch import Tensor

from thesis_lib.checks import positive_number
from thesis_lib.optimisation.conjugate_gradient import Solution, conjugate_gradient
from thesis_lib.optimisation.problem import (
    Batch,
    LocalProblem,
    UpdateReport,
    report,
)
from thesis_lib.policies import GaussianPolicy

RESIDUAL_TOLERANCE = 1e-10
"""Conjugate gradient stops when the squared residual falls below this."""


def natural_direction(
    problem: LocalProblem, gradient: Tensor, iterations: int, damping: float
) -> Solution:
    r"""The direction :math:`\hat g_N = F^{-1} \hat g` (equation 2.15, line 8 of algorithm 6).

    Parameters
    ----------
    problem
        Gives products with F.
    gradient
        :math:`\hat g`, shape ``(P,)``.
    iterations
        Conjugate-gradient steps.
    damping
        A multiple of the identity added to F.
    """

    def product(v: Tensor) -> Tensor:
        return problem.fisher_product(v) + damping * v

    return conjugate_gradient(product, gradient, iterations, RESIDUAL_TOLERANCE)


def full_step(solution: Solution, delta: float) -> Tensor:
    r"""The step at which the quadratic approximation of the divergence reaches the bound.

    .. math:: \Delta\theta = \sqrt{\frac{2\delta_{KL}}{x^\top F x}}\; x

    Parameters
    ----------
    solution
        The direction x, and F x.
    delta
        :math:`\delta_{KL}`.
    """
    length = math.sqrt(2 * delta / (float(solution.x @ solution.product) + 1e-8))
    return length * solution.x


@dataclass(frozen=True)
class NaturalPG:
    r"""Ascent along the natural gradient, with a fixed rate or a fixed predicted divergence.

    Parameters
    ----------
    learning_rate
        :math:`\alpha` in :math:`\theta \leftarrow \theta + \alpha \hat g_N`: a fixed
        penalty on the divergence.  Give this or ``delta``.
    delta
        Step to where the quadratic approximation of the divergence is this; nothing
        checks where the step ends.
    cg_iterations, damping
        See :func:`natural_direction`.

    Raises
    ------
    ValueError
        When not exactly one of rate and delta is given, or a setting is not positive.
    """

    learning_rate: float | None = None
    delta: float | None = None
    cg_iterations: int = 10
    damping: float = 1e-5

    def __post_init__(self) -> None:
        if (self.learning_rate is None) == (self.delta is None):
            raise ValueError(
                f"learning_rate is {self.learning_rate} and delta is {self.delta}, but exactly one "
                "of them must be given."
            )
        for name in ("learning_rate", "delta", "cg_iterations", "damping"):
            if getattr(self, name) is not None:
                positive_number(name, getattr(self, name))

    def update(self, policy: GaussianPolicy, batch: Batch) -> UpdateReport:
        """Make one step."""
        problem = LocalProblem(policy, batch)
        # (2.15)  g_N = F^-1 g_V
        solution = natural_direction(problem, problem.gradient(), self.cg_iterations, self.damping)
        if self.learning_rate is not None:
            step = self.learning_rate * solution.x
        else:
            step = full_step(solution, self.delta or 0.0)
        return report(problem, problem.move(step), residual=solution.residual)
