r"""Trust region policy optimisation (section 2.3.5, algorithm 6)."""

from __future__ import annotations

from dataclasses import dataclass

from thesis_lib.checks import one_of, positive_number
from thesis_lib.optimisation.natural import full_step, natural_direction
from thesis_lib.optimisation.problem import (
    KL_DIRECTIONS,
    Batch,
    LocalProblem,
    UpdateReport,
    report,
)
from thesis_lib.policies import GaussianPolicy


@dataclass(frozen=True)
class TRPO:
    r"""Lines 8 and 9 of algorithm 6.

    Parameters
    ----------
    delta
        The bound :math:`\delta_{KL}` of equation 2.14, in nats; table 5.1.
    cg_iterations
        Conjugate-gradient steps.
    damping
        A multiple of the identity added to the Fisher matrix.
    backtrack_ratio
        What the line search multiplies the step with when it fails.
    max_backtracks
        Steps the line search tries; when all fail the policy stays as it is.
    kl_direction
        See :class:`~thesis_lib.optimisation.problem.LocalProblem`.

    Raises
    ------
    ValueError
        When a setting is not positive, the ratio is not below 1, or the direction does not
        exist.
    """

    delta: float = 0.01
    cg_iterations: int = 10
    damping: float = 1e-5
    backtrack_ratio: float = 0.8
    max_backtracks: int = 15
    kl_direction: str = KL_DIRECTIONS[0]

    def __post_init__(self) -> None:
        for name in ("delta", "cg_iterations", "damping", "backtrack_ratio", "max_backtracks"):
            positive_number(name, getattr(self, name))
        one_of("kl_direction", self.kl_direction, KL_DIRECTIONS)
        if self.backtrack_ratio >= 1:
            raise ValueError(
                f"backtrack_ratio is {self.backtrack_ratio}, but it must be below 1 for the line "
                "search to shorten the step."
            )

    def update(self, policy: GaussianPolicy, batch: Batch) -> UpdateReport:
        """Make one step, or none when the line search finds nothing."""
        problem = LocalProblem(policy, batch, self.kl_direction)
        start = problem.start()
        # line 8: g_N = F^-1 grad L, by conjugate gradient with products F v
        gradient = problem.gradient()
        solution = natural_direction(problem, gradient, self.cg_iterations, self.damping)
        # the longest step for which 1/2 dtheta^T F dtheta <= delta_KL
        step = full_step(solution, self.delta)
        # line 9: shorten the step until L grows and the divergence itself keeps the bound
        for k in range(self.max_backtracks):
            value = problem.move(self.backtrack_ratio**k * step)
            if value.surrogate > start.surrogate and value.kl <= self.delta:
                return report(problem, value, backtracks=k, residual=solution.residual)
        problem.restore()
        return report(
            problem,
            start,
            accepted=False,
            backtracks=self.max_backtracks,
            residual=solution.residual,
        )
