r"""One iteration of algorithms 5 and 6 from a batch of rollouts."""

from __future__ import annotations

from dataclasses import dataclass, field

from thesis_lib.checks import one_of, probability
from thesis_lib.optimisation.baseline import Baseline, LinearBaseline
from thesis_lib.optimisation.problem import Algorithm, UpdateReport, make_batch
from thesis_lib.optimisation.returns import (
    advantages,
    discounted_returns,
    standardised,
)
from thesis_lib.optimisation.rollouts import Rollouts
from thesis_lib.policies import GaussianPolicy

TARGETS = ("returns", "lambda")
"""What a baseline may be fitted to."""


@dataclass
class Learner:
    r"""A policy, its baseline and the rule that improves them.

    Parameters
    ----------
    policy
        :math:`\pi_\theta`.
    algorithm
        :class:`~thesis_lib.optimisation.VPG`, :class:`~thesis_lib.optimisation.NaturalPG`,
        :class:`~thesis_lib.optimisation.TRPO` or :class:`~thesis_lib.optimisation.PPO`.
    discount
        :math:`\gamma`.
    gae_lambda
        :math:`\lambda` of the advantage estimate; 1 is equation 2.12.
    standardise
        Whether advantages are shifted and scaled to mean 0 and deviation 1.
    bootstrap
        Whether an episode cut by a limit is credited with the baseline of the state it
        was cut in.
    baseline
        :math:`b`.
    targets
        What the baseline is fitted to: ``"returns"``, the R_t of line 7, or ``"lambda"``,
        the advantage estimate added to the old baseline, which is R_t again if lambda is 1 and
        no cut episode is credited with the baseline (``bootstrap``).

    Raises
    ------
    ValueError
        When the discount or lambda is not in [0, 1], or there are no such targets.
    """

    policy: GaussianPolicy
    algorithm: Algorithm
    discount: float = 0.99
    gae_lambda: float = 1.0
    standardise: bool = True
    bootstrap: bool = False
    baseline: Baseline = field(default_factory=LinearBaseline)
    targets: str = "returns"

    def __post_init__(self) -> None:
        probability("discount", self.discount)
        probability("gae_lambda", self.gae_lambda)
        one_of("targets", self.targets, TARGETS)

    def improve(self, rollouts: Rollouts) -> UpdateReport:
        """Lines 4 to 8 of algorithm 5, or 4 to 9 of algorithm 6.

        The advantages use the baseline fitted to earlier rollouts, so that it does not
        depend on the actions it is subtracted from.

        Parameters
        ----------
        rollouts
            Collected with the current policy.
        """
        packing = rollouts.packing
        seen = self.policy.select(rollouts.observations)
        # line 5: R_t
        returns = discounted_returns(rollouts.rewards, packing, self.discount)
        # line 6: A_t = R_t - b(s_t)
        values = self.baseline.predict(seen, packing.time)
        last = None
        if self.bootstrap:
            final = self.policy.select(rollouts.final_observations)
            last = self.baseline.predict(final, packing.lengths) * ~rollouts.terminated
        estimate = advantages(
            rollouts.rewards, values, packing, self.discount, self.gae_lambda, last
        )
        # line 7: fit b to R_t
        target = returns if self.targets == "returns" else values + estimate
        self.baseline.fit(seen, packing.time, target)
        # line 8, and line 9 of algorithm 6
        if self.standardise:
            estimate = standardised(estimate)
        return self.algorithm.update(self.policy, make_batch(self.policy, rollouts, estimate))
