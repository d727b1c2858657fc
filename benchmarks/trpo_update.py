"""One full TRPO update against plain double backpropagation, side by side in one run.

50,000 steps (100 episodes of 500), 27 inputs, 18 hidden units, 8 actions, 10
conjugate-gradient steps and 3 line-search evaluations, float32 and one thread unless asked
otherwise; processor seconds, medians of repeated runs.

    python benchmarks/trpo_update.py [--json] [--runs 3] [--architectures dtrnn gru] [--double]
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from thesis_lib.optimisation import Batch, LocalProblem, conjugate_gradient, full_step
from thesis_lib.policies import (
    GaussianPolicy,
    Packing,
    kl_divergence,
    log_likelihood,
    make_policy,
)

EPISODES, STEPS, INPUTS, UNITS, ACTIONS = 100, 500, 27, 18, 8
ITERATIONS, EVALUATIONS, DAMPING, DELTA = 10, 3, 1e-5, 0.01
TARGETS = {"dtrnn": 3.0, "ctrnn": 3.0, "gru": 1.8, "lstm": 1.6, "dffwd": 1.6}


class DoubleBackpropagation:
    """The same problem by torch's autograd alone: the gradient of (the gradient . v)."""

    def __init__(self, policy: GaussianPolicy, batch: Batch) -> None:
        self.policy, self.batch = policy, batch
        self.parameters = list(policy.trainable().values())
        mean = self.means()
        log_std = policy.deviation()
        likelihood = log_likelihood(batch.actions, mean, log_std)
        self.old = likelihood.detach()
        surrogate = (torch.exp(likelihood - self.old) * batch.advantages).mean()
        gradient = torch.autograd.grad(surrogate, self.parameters, retain_graph=True)
        self.flat = self.join(gradient)
        kl = kl_divergence(mean.detach(), log_std.detach(), mean, log_std).mean()
        self.first = self.join(torch.autograd.grad(kl, self.parameters, create_graph=True))
        self.theta = policy.parameter_vector()

    @staticmethod
    def join(tensors: tuple[Tensor, ...]) -> Tensor:
        """One vector."""
        return torch.cat([t.flatten() for t in tensors])

    def means(self) -> Tensor:
        """The network on the whole block at once, as one writes it in plain torch."""
        sequences = self.batch.sequences
        if self.policy.state_size == 0:
            return self.policy.head(self.policy.advance(sequences.inputs, torch.empty(0))[0])
        return self.policy.means(sequences)

    def gradient(self) -> Tensor:
        """Gradient of the surrogate, shape ``(P,)``."""
        return self.flat.double()

    def fisher_product(self, v: Tensor) -> Tensor:
        """Second derivatives of the divergence times v, shape ``(P,)``."""
        along = self.first @ v.to(self.first.dtype)
        return self.join(torch.autograd.grad(along, self.parameters, retain_graph=True)).double()

    def move(self, step: Tensor) -> None:
        """Evaluate a candidate."""
        self.policy.set_parameter_vector((self.theta.double() + step).to(self.theta.dtype))
        with torch.no_grad():
            mean = self.means()
            new = log_likelihood(self.batch.actions, mean, self.policy.deviation())
            float((torch.exp(new - self.old) * self.batch.advantages).double().mean())


def update(
    make: Callable[[GaussianPolicy, Batch], LocalProblem | DoubleBackpropagation],
    policy: GaussianPolicy,
    batch: Batch,
) -> Tensor:
    """A gradient, 10 Fisher-vector products and 3 evaluations; the full step."""
    theta = policy.parameter_vector()
    problem = make(policy, batch)

    def product(v: Tensor) -> Tensor:
        return problem.fisher_product(v) + DAMPING * v

    solution = conjugate_gradient(product, problem.gradient(), ITERATIONS, 0.0)
    step = full_step(solution, DELTA)
    for k in range(EVALUATIONS):
        problem.move(0.8**k * step)
    policy.set_parameter_vector(theta)
    return step


def compare(name: str, dtype: torch.dtype, runs: int) -> dict[str, object]:
    rng = np.random.default_rng(0)
    packing = Packing(np.full(EPISODES, STEPS))
    recurrent = name not in ("ffwd", "dffwd")
    observed = INPUTS - ACTIONS if recurrent else INPUTS
    options = {"units": UNITS} if recurrent else {}
    policy = make_policy(name, observed, ACTIONS, dt=0.02, dtype=dtype, **options)
    actions = rng.normal(size=(packing.n_steps, ACTIONS))
    sequences = policy.sequences(rng.normal(size=(packing.n_steps, observed)), actions, packing)
    batch = Batch(
        sequences,
        torch.as_tensor(actions, dtype=dtype),
        torch.as_tensor(rng.normal(size=packing.n_steps), dtype=dtype),
    )
    seconds: dict[str, list[float]] = {"ours": [], "peer": []}
    steps = {}
    for _ in range(runs):
        for side, make in (("ours", LocalProblem), ("peer", DoubleBackpropagation)):
            start = time.process_time()
            steps[side] = update(make, policy, batch)
            seconds[side].append(time.process_time() - start)
    ours, peer = (statistics.median(seconds[side]) for side in ("ours", "peer"))
    difference = float((steps["ours"] - steps["peer"]).norm() / steps["peer"].norm())
    return {
        "name": f"TRPO update, {name}",
        "ours": ours,
        "peer": peer,
        "ratio": peer / ours,
        "unit": "processor s",
        "target": TARGETS.get(name),
        "step_difference": difference,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--json", action="store_true", help="print rows as JSON")
    parser.add_argument("--runs", type=int, default=3, help="repetitions (default 3)")
    parser.add_argument("--architectures", nargs="*", default=list(TARGETS))
    parser.add_argument("--double", action="store_true", help="float64 instead of float32")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    dtype = torch.float64 if arguments.double else torch.float32
    rows = [compare(name, dtype, arguments.runs) for name in arguments.architectures]
    if arguments.json:
        print(json.dumps(rows, indent=1))
        return
    print(f"{'':24} {'ours':>8} {'double':>8} {'ratio':>7} {'target':>7}  step differs by")
    for row in rows:
        print(
            f"{row['name']:24} {row['ours']:7.2f}s {row['peer']:7.2f}s {row['ratio']:7.1f} "
            f"{row['target'] or '':>7}  {row['step_difference']:.1e}"
        )


if __name__ == "__main__":
    main()
