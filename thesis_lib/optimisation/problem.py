r"""The constrained problem a policy update solves (equations 2.13 to 2.15)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.checks import one_of
from thesis_lib.optimisation.rollouts import Rollouts
from thesis_lib.policies import (
    GaussianPolicy,
    Packing,
    Sequences,
    entropy,
    kl_divergence,
    log_likelihood,
)

KL_DIRECTIONS = ("old_new", "new_old")
"""Which divergence is bounded: the author's code and the TRPO paper, and equation 2.14."""


@dataclass(frozen=True, eq=False)
class Batch:
    r"""What a policy update learns from.

    Attributes
    ----------
    sequences
        Inputs of the policy at every step.
    actions
        :math:`a_t`, shape ``(R, A)``, in the number type of the policy.
    advantages
        :math:`\hat A_t`, shape ``(R,)``, likewise.
    """

    sequences: Sequences
    actions: Tensor
    advantages: Tensor

    @property
    def packing(self) -> Packing:
        """Layout of the rows."""
        return self.sequences.packing

    def episodes(self, chosen: IntArray) -> Batch:
        """The part of the batch that consists of some of its episodes."""
        packing = Packing(self.packing.lengths[chosen])
        place = np.empty(self.packing.n_episodes, dtype=np.int64)
        place[self.packing.order] = np.arange(self.packing.n_episodes)
        rows = self.packing.offsets[packing.time] + place[chosen[packing.episode]]
        index = torch.as_tensor(rows)
        hidden = self.sequences.hidden
        sequences = Sequences(
            self.sequences.inputs[index], packing, None if hidden is None else hidden[index]
        )
        return Batch(sequences, self.actions[index], self.advantages[index])


def make_batch(policy: GaussianPolicy, rollouts: Rollouts, advantages: FloatArray) -> Batch:
    """Put rollouts and their advantages into the number type of the policy.

    Parameters
    ----------
    policy
        The policy that will be updated.
    rollouts
        Whole episodes.
    advantages
        Shape ``(R,)``.
    """
    sequences = policy.sequences(
        rollouts.observations, rollouts.actions, rollouts.packing, rollouts.hidden
    )
    return Batch(
        sequences,
        torch.as_tensor(rollouts.actions, dtype=policy.dtype),
        torch.as_tensor(advantages, dtype=policy.dtype),
    )


@dataclass(frozen=True)
class Value:
    r"""Where a candidate stands.

    Attributes
    ----------
    surrogate
        :math:`L_{\theta_{k-1}}(\theta)` of equation 2.14, a mean over steps.
    kl
        Mean divergence over steps, in nats.
    """

    surrogate: float
    kl: float


class LocalProblem:
    r"""Equation 2.14 around the current parameters :math:`\theta_{k-1}`.

    Averages are over steps, as in the author's code; equation 2.14 sums over the steps of
    a trajectory and averages over trajectories, which scales L and leaves the solution
    alone.

    Parameters
    ----------
    policy
        At :math:`\theta_{k-1}`; methods may move it.
    batch
        Collected with these parameters.
    kl_direction
        ``"old_new"`` for :math:`D_{KL}(\pi_{\theta_{k-1}} \| \pi_\theta)`, or
        ``"new_old"``.  The two agree to second order.

    Attributes
    ----------
    theta
        :math:`\theta_{k-1}`, shape ``(P,)``.
    """

    def __init__(self, policy: GaussianPolicy, batch: Batch, kl_direction: str = "old_new") -> None:
        one_of("kl_direction", kl_direction, KL_DIRECTIONS)
        self.policy = policy
        self.batch = batch
        self.kl_direction = kl_direction
        self.theta = policy.parameter_vector()
        self.linearised = policy.linearise(batch.sequences)
        self.mean = self.linearised.mean
        self.log_std = policy.deviation().detach().clone()
        self.old_log_likelihood = log_likelihood(batch.actions, self.mean, self.log_std)
        # Below its floor the deviation does not move with the parameter.
        self._moves = torch.ones_like(self.log_std)
        if policy.min_log_std is not None:
            self._moves = (policy.log_std.detach() >= policy.min_log_std).to(policy.dtype)

    def value(self) -> Value:
        """Surrogate and divergence of the policy as it is now."""
        with torch.no_grad():
            return self._value(self.policy.means(self.batch.sequences), self.policy.deviation())

    def start(self) -> Value:
        """Surrogate and divergence at the parameters the problem was made with."""
        return self._value(self.mean, self.log_std)

    def _value(self, mean: Tensor, log_std: Tensor) -> Value:
        new = log_likelihood(self.batch.actions, mean, log_std)
        ratio = torch.exp(new - self.old_log_likelihood)
        surrogate = (ratio * self.batch.advantages).double().mean()
        old = (self.mean, self.log_std)
        pair = (*old, mean, log_std) if self.kl_direction == "old_new" else (mean, log_std, *old)
        return Value(float(surrogate), float(kl_divergence(*pair).double().mean()))

    def gradient(self) -> Tensor:
        r"""Gradient of the surrogate, which is that of equation 2.13 averaged over steps.

        Both are :math:`\langle \hat A_t \nabla_\theta \log\pi_\theta(a_t|s_t) \rangle` at
        :math:`\theta_{k-1}`.

        Returns
        -------
        Tensor
            Shape ``(P,)``, float64.

        Raises
        ------
        FloatingPointError
            When an entry is not finite, naming the parameter.
        """
        n_steps = len(self.mean)
        z = (self.batch.actions - self.mean) * torch.exp(-self.log_std)
        weight = self.batch.advantages[:, None] / n_steps
        gradient = self.linearised.vjp(weight * z * torch.exp(-self.log_std))
        deviation = (weight * (z.square() - 1)).sum(0) * self._moves
        gradient = (gradient + self.policy.join({"log_std": deviation})).double()
        if not torch.isfinite(gradient).all():
            for name, part in self.policy.split(gradient).items():
                if not torch.isfinite(part).all():
                    raise FloatingPointError(
                        f"the gradient of parameter {name!r} holds a value that is not finite."
                    )
        return gradient

    def fisher_product(self, v: Tensor) -> Tensor:
        r"""The product :math:`F v` with the Fisher information matrix, exactly.

        .. math::
            F = \frac1R \sum_t J_t^\top \Sigma^{-1} J_t
                + \begin{pmatrix} 0 & 0 \\ 0 & 2I \end{pmatrix}

        with :math:`J_t` the Jacobian of the mean at step t and the second block that of
        :math:`\log\sigma`.  It is the matrix of second derivatives of the mean divergence,
        :math:`D_{KL} \approx \tfrac12 \Delta\theta^\top F \Delta\theta`.

        Parameters
        ----------
        v
            Shape ``(P,)``.

        Returns
        -------
        Tensor
            Shape ``(P,)``, float64.

        Notes
        -----
        Source: section 2.3.5.  The matrix of the text is the same per trajectory, that is,
        times the number of steps of one.
        """
        direction = v.to(self.policy.dtype)
        precision = torch.exp(-2 * self.log_std) / len(self.mean)
        product = self.linearised.vjp(self.linearised.jvp(direction) * precision)
        deviation = 2 * self.policy.split(direction)["log_std"] * self._moves
        return (product + self.policy.join({"log_std": deviation})).double()

    def move(self, step: Tensor) -> Value:
        r"""Move the policy to :math:`\theta_{k-1} + \Delta\theta`, projected; where it then stands.

        Parameters
        ----------
        step
            :math:`\Delta\theta`, shape ``(P,)``.
        """
        self.policy.set_parameter_vector((self.theta.double() + step).to(self.theta.dtype))
        return self.value()

    def restore(self) -> None:
        r"""Put the policy back to :math:`\theta_{k-1}`."""
        self.policy.set_parameter_vector(self.theta)


@dataclass(frozen=True)
class UpdateReport:
    r"""What an update did to the policy.

    Attributes
    ----------
    surrogate
        Gain in the surrogate, :math:`L(\theta_k) - L(\theta_{k-1})`.
    kl
        Mean divergence between the old and the new policy, in nats.
    entropy
        Entropy of the new policy, in nats.
    step_norm
        :math:`\|\theta_k - \theta_{k-1}\|`.
    accepted
        Whether the policy moved.
    backtracks
        How often the line search shortened the step.
    residual
        Relative residual of conjugate gradient; 0 where it is not used.
    """

    surrogate: float
    kl: float
    entropy: float
    step_norm: float
    accepted: bool
    backtracks: int
    residual: float


class Algorithm(Protocol):
    """A rule that updates a policy from a batch."""

    def update(self, policy: GaussianPolicy, batch: Batch) -> UpdateReport:
        """Change the policy's parameters and say how."""
        ...


def report(
    problem: LocalProblem,
    value: Value,
    *,
    accepted: bool = True,
    backtracks: int = 0,
    residual: float = 0.0,
) -> UpdateReport:
    """Describe an update that has ended at ``value``; checks the policy for bad numbers."""
    problem.policy.check_finite()
    moved = problem.policy.parameter_vector().double() - problem.theta.double()
    return UpdateReport(
        surrogate=value.surrogate - problem.start().surrogate,
        kl=value.kl,
        entropy=float(entropy(problem.policy.deviation().detach().double())),
        step_norm=float(moved.norm()),
        accepted=accepted,
        backtracks=backtracks,
        residual=residual,
    )
