r"""Vanilla policy gradient (section 2.3.4, algorithm 5)."""

from __future__ import annotations

from dataclasses import dataclass

from thesis_lib.checks import one_of, positive_number
from thesis_lib.optimisation.problem import (
    Batch,
    LocalProblem,
    UpdateReport,
    report,
)
from thesis_lib.policies import GaussianPolicy

AVERAGES = ("trajectories", "steps")
"""What the gradient is averaged over; the first is equation 2.13."""


@dataclass(frozen=True)
class VPG:
    r"""Gradient ascent on the estimate of equation 2.13 (line 8 of algorithm 5).

    Parameters
    ----------
    learning_rate
        :math:`\alpha` in :math:`\theta \leftarrow \theta + \alpha \hat g_V`.
    average
        ``"trajectories"`` sums over the steps of a trajectory, then averages over
        trajectories (equation 2.13); ``"steps"`` averages over all steps.

    Raises
    ------
    ValueError
        When the rate is not positive.
    """

    learning_rate: float = 0.01
    average: str = "trajectories"

    def __post_init__(self) -> None:
        positive_number("learning_rate", self.learning_rate)
        one_of("average", self.average, AVERAGES)

    def update(self, policy: GaussianPolicy, batch: Batch) -> UpdateReport:
        """Make one step."""
        problem = LocalProblem(policy, batch)
        # (2.13)  g_V = < grad sum_t log pi(a_t | s_t) A_t >
        gradient = problem.gradient() * gradient_scale(batch, self.average)
        # algorithm 5, line 8
        return report(problem, problem.move(self.learning_rate * gradient))


def gradient_scale(batch: Batch, average: str) -> float:
    """What turns a mean over steps into the asked-for average."""
    if average == "steps":
        return 1.0
    return batch.packing.n_steps / batch.packing.n_episodes
