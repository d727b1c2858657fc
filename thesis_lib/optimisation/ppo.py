r"""Proximal policy optimisation, which section 2.3.5 names as TRPO's successor."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from thesis_lib.checks import positive_number
from thesis_lib.optimisation.problem import (
    Batch,
    LocalProblem,
    UpdateReport,
    report,
)
from thesis_lib.policies import GaussianPolicy, log_likelihood


class PPO:
    r"""Ascent on the clipped surrogate by Adam, in mini-batches of whole episodes.

    .. math::
        \left\langle \min\left( r_t(\theta) \hat A_t,\;
        \mathrm{clip}(r_t(\theta), 1 - \epsilon, 1 + \epsilon) \hat A_t \right)\right\rangle,
        \qquad r_t(\theta) = \frac{\pi_\theta(a_t|s_t)}{\pi_{\theta_{k-1}}(a_t|s_t)}

    Parameters
    ----------
    clip
        :math:`\epsilon`.
    learning_rate
        Of Adam.
    epochs
        Passes over the batch.
    minibatches
        Parts, each of whole episodes, that a pass is cut into.
    seed
        Source of the order of the episodes.

    Notes
    -----
    Adam's moments live on from update to update.  Recurrent networks are trained by
    full-length backpropagation through time.
    """

    def __init__(
        self,
        clip: float = 0.2,
        learning_rate: float = 3e-4,
        epochs: int = 10,
        minibatches: int = 4,
        seed: int = 0,
    ) -> None:
        for name, value in (
            ("clip", clip),
            ("learning_rate", learning_rate),
            ("epochs", epochs),
            ("minibatches", minibatches),
        ):
            positive_number(name, value)
        self.clip = clip
        self.learning_rate = learning_rate
        self.epochs = epochs
        self.minibatches = minibatches
        self._generator = np.random.default_rng(seed)
        self._adam: torch.optim.Adam | None = None
        self._policy: GaussianPolicy | None = None
        self._restored: dict[str, Any] | None = None

    def update(self, policy: GaussianPolicy, batch: Batch) -> UpdateReport:
        """Pass ``epochs`` times over the batch."""
        if self._adam is None or self._policy is not policy:
            self._adam = torch.optim.Adam(policy.trainable().values(), lr=self.learning_rate)
            self._policy = policy
            if self._restored is not None:
                self._adam.load_state_dict(self._restored)
                self._restored = None
        problem = LocalProblem(policy, batch)
        old = problem.old_log_likelihood
        parts = min(self.minibatches, batch.packing.n_episodes)
        # Row numbers ride along as advantages do, to find each part's old likelihoods.
        rows = torch.arange(batch.packing.n_steps, dtype=torch.float64)
        numbered = Batch(batch.sequences, batch.actions, rows)
        for _ in range(self.epochs):
            order = self._generator.permutation(batch.packing.n_episodes)
            for chosen in np.array_split(order, parts):
                part = numbered.episodes(chosen)
                index = part.advantages.long()
                self._adam.zero_grad()
                new = log_likelihood(part.actions, policy.means(part.sequences), policy.deviation())
                ratio = torch.exp(new - old[index])
                clipped = ratio.clamp(1 - self.clip, 1 + self.clip)
                advantage = batch.advantages[index]
                loss = -torch.minimum(ratio * advantage, clipped * advantage).mean()
                loss.backward()
                self._adam.step()
                policy.project_()
        policy.zero_grad()
        return report(problem, problem.value())

    def state_dict(self) -> dict[str, Any]:
        """Everything an interrupted run needs to go on as if it had not been."""
        adam = self._restored if self._adam is None else self._adam.state_dict()
        return {"generator": self._generator.bit_generator.state, "adam": adam}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take up the state of an interrupted run."""
        self._generator.bit_generator.state = state["generator"]
        self._adam = None
        self._restored = state["adam"]
