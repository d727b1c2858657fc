"""Small networks of every kind, and plain double backpropagation to hold others against."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from thesis_lib.policies import (
    ARCHITECTURES,
    GaussianPolicy,
    Packing,
    Sequences,
    kl_divergence,
    make_policy,
)

torch.set_num_threads(1)

OBSERVED, ACTIONS, DT = 4, 2, 0.1
RECURRENT = ("dtrnn", "ctrnn", "gru", "lstm", "esn")

VARIANTS: dict[str, tuple[str, dict[str, Any]]] = {
    **{name: (name, {}) for name in ARCHITECTURES},
    "linear": ("ffwd", {"hidden": (), "bias": False}),
    "deep and small": ("dffwd", {"hidden": (5, 4, 3)}),
    "ffwd with previous action": ("ffwd", {"previous_action": True}),
    "dtrnn without bias": ("dtrnn", {"bias": False}),
    "dtrnn without previous action": ("dtrnn", {"previous_action": False}),
    "dtrnn on features": ("dtrnn", {"features": [3, 1]}),
    "ctrnn euler": ("ctrnn", {"integrator": "euler"}),
    "ctrnn midpoint": ("ctrnn", {"integrator": "midpoint"}),
    "ctrnn exponential": ("ctrnn", {"constraint": "exponential"}),
    "ctrnn softplus": ("ctrnn", {"constraint": "softplus"}),
    "ctrnn with fixed time constants": ("ctrnn", {"trainable_time_constant": False}),
    "gru orthogonal with learned start": (
        "gru",
        {"initialisation": "orthogonal", "trainable_initial_state": True},
    ),
    "lstm as in the text": ("lstm", {"candidate": "logistic", "initialisation": "glorot"}),
    "lstm with learned start": ("lstm", {"trainable_initial_state": True}),
    "esn with learned start": ("esn", {"trainable_initial_state": True}),
}


def network(variant: str, seed: int = 0) -> GaussianPolicy:
    """A small float64 network away from its special initial values."""
    architecture, options = VARIANTS[variant]
    policy = make_policy(
        architecture, OBSERVED, ACTIONS, dt=DT, seed=seed, dtype=torch.float64, **options
    )
    draw = torch.Generator().manual_seed(seed + 1)
    noise = torch.randn(policy.n_trainable, generator=draw, dtype=torch.float64)
    policy.set_parameter_vector(policy.parameter_vector() + 0.2 * noise)
    return policy


def block(
    policy: GaussianPolicy, lengths: tuple[int, ...] = (3, 7, 1, 7, 5), seed: int = 0
) -> tuple[Sequences, Tensor]:
    """Episodes of unequal length, and their actions."""
    rng = np.random.default_rng(seed)
    packing = Packing(np.array(lengths))
    observations = rng.normal(size=(packing.n_steps, policy.observation_size))
    actions = rng.normal(size=(packing.n_steps, policy.action_size))
    return policy.sequences(observations, actions, packing), torch.as_tensor(actions)


def double_backpropagation(policy: GaussianPolicy, sequences: Sequences, v: Tensor) -> Tensor:
    """Second derivatives of the mean divergence times v, by autograd alone."""
    mean, log_std = policy.means(sequences), policy.deviation()
    kl = kl_divergence(mean.detach(), log_std.detach(), mean, log_std).mean()
    parameters = list(policy.trainable().values())
    first = torch.autograd.grad(kl, parameters, create_graph=True)
    along = torch.cat([g.flatten() for g in first]) @ v
    second = torch.autograd.grad(along, parameters, allow_unused=True)
    pairs = zip(policy.trainable(), second, strict=True)
    return policy.join({name: g for name, g in pairs if g is not None})


def relative(a: Tensor, b: Tensor) -> float:
    """Norm of the difference over the norm of b."""
    return float((a - b).norm() / b.norm())
