"""Batches to update policies with."""

import numpy as np
import torch

from tests.policies.networks import block
from thesis_lib.optimisation import Batch
from thesis_lib.policies import GaussianPolicy


def batch_for(
    policy: GaussianPolicy, lengths: tuple[int, ...] = (3, 7, 1, 7, 5), seed: int = 0
) -> Batch:
    """Random episodes of unequal length, with random advantages."""
    sequences, actions = block(policy, lengths, seed)
    rng = np.random.default_rng(seed + 100)
    advantages = torch.as_tensor(rng.normal(size=len(actions)), dtype=policy.dtype)
    return Batch(sequences, actions.to(policy.dtype), advantages)
