r"""The gradient of an integrated network (section 5.2.2).

A CTRNN is :math:`\dot h = D(-h + f(Kh + u))` with :math:`D = \mathrm{diag}(1/\tau)` and an
input u that is held over a step.  The gradient of a number at its end obeys the adjoint
equations, backward in time,

.. math:: -\dot\lambda = -D\lambda + K^\top (f' \circ D\lambda), \qquad
          -\dot G = (f' \circ D\lambda)\, h^\top,

with :math:`\lambda` the gradient in the state and G that in K.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch

from thesis_lib.arrays import FloatArray
from thesis_lib.edition.criteria import EXACT, judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.policies import CTRNN


@dataclass(frozen=True)
class Config:
    """Which networks, and with which steps."""

    units: int = 8
    """Size of the network."""
    time_constant: float = 0.2
    """tau of every unit [s]."""
    ratios: tuple[float, ...] = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
    """Steps of the integrator over tau."""
    duration: float = 1.0
    """Time simulated [s]."""
    seeds: int = 5
    """Networks, with random inputs."""


@dataclass(frozen=True)
class Gap:
    """One gradient by backpropagation and by the adjoint equations."""

    integrator: str
    """euler, heun (the author's midpoint) or midpoint."""
    places: str
    """States the backward step uses: the forward step's stages, or only its ends (nodes)."""
    seed: int
    """Of weights and inputs."""
    ratio: float
    """Step over time constant."""
    difference: float
    """Relative, of the gradients in the initial state and in K together."""


@dataclass(frozen=True)
class Flow:
    """Weights, inverse time constants and step of a CTRNN."""

    K: FloatArray
    rate: FloatArray
    dt: float

    def slope(self, h: FloatArray, drive: FloatArray) -> FloatArray:
        """Time derivative of the state."""
        return self.rate * (np.tanh(self.K @ h + drive) - h)

    def adjoint(self, h: FloatArray, drive: FloatArray, lam: FloatArray) -> FloatArray:
        """Rates of lambda (first row) and of G, backward in time, shape ``(N + 1, N)``."""
        error = (1 - np.tanh(self.K @ h + drive) ** 2) * self.rate * lam
        return np.vstack([self.K.T @ error - self.rate * lam, np.outer(error, h)])

    def backward(
        self, integrator: str, places: str, states: FloatArray, drives: FloatArray, end: FloatArray
    ) -> FloatArray:
        """Integrate the adjoint equations along a trajectory, shape ``(N + 1, N)`` as above."""
        dt, both = self.dt, np.vstack([end, np.zeros((len(end), len(end)))])
        for n in reversed(range(len(drives))):
            h, after, drive = states[n], states[n + 1], drives[n]
            slope = self.slope(h, drive)
            if integrator == "euler":
                at = h if places == "stages" else after
                both = both + dt * self.adjoint(at, drive, both[0])
            elif integrator == "heun":
                # Where the forward step looked for its second slope, or where it ended.
                at = h + dt * slope if places == "stages" else after
                first = self.adjoint(at, drive, both[0])
                second = self.adjoint(h, drive, both[0] + dt * first[0])
                both = both + 0.5 * dt * (first + second)
            else:
                first = self.adjoint(after, drive, both[0])
                half = both[0] + 0.5 * dt * first[0]
                both = both + dt * self.adjoint(h + 0.5 * dt * slope, drive, half)
        return both


@experiment(
    "ch5-gradients",
    item="Section 5.2.2",
    smoke=Config(seeds=1, ratios=(0.1, 1.0)),
    book=Config(),
    seconds=1,
)
def gaps(config: Config, context: Context) -> list[Gap]:
    """Gradient of an integrated network against integrating the equations of the gradient."""
    records = []
    for seed in range(config.seeds):
        rng = np.random.default_rng(context.seeds(1, seed)[0])
        end = rng.standard_normal(config.units)
        phase, tempo = rng.uniform(0, 2 * np.pi, config.units), rng.uniform(1, 6, config.units)
        for ratio in config.ratios:
            dt = ratio * config.time_constant
            time = np.arange(round(config.duration / dt)) * dt
            drives = np.sin(tempo * time[:, None] + phase)
            for integrator in ("euler", "heun", "midpoint"):
                policy = CTRNN(
                    1,
                    1,
                    units=config.units,
                    dt=dt,
                    seed=seed,
                    integrator=integrator,
                    time_constant=config.time_constant,
                    dtype=torch.float64,
                )
                states, exact = _through(policy, drives, end)
                K = policy.recurrent.weight.detach().numpy()
                flow = Flow(K, 1 / policy.time_constants().detach().numpy(), dt)
                for places in ("stages", "nodes")[integrator == "midpoint" :]:
                    found = flow.backward(integrator, places, states, drives, end)
                    difference = np.linalg.norm(found - exact) / np.linalg.norm(exact)
                    records.append(Gap(integrator, places, seed, ratio, float(difference)))
    return records


def _through(policy: CTRNN, drives: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray]:
    """States of a trajectory, ``(T + 1, N)``, and its gradients by backpropagation."""
    start = torch.zeros((1, policy.units), dtype=torch.float64, requires_grad=True)
    states = policy.unroll(torch.as_tensor(drives), [1] * len(drives), start)
    (states[-1] @ torch.as_tensor(end)).backward()
    K = policy.recurrent.weight
    assert start.grad is not None
    assert K.grad is not None
    exact = np.vstack([start.grad.numpy(), K.grad.numpy()])
    return np.vstack([np.zeros(policy.units), states.detach().numpy()]), exact


@criterion("5.2.2-gradient", gaps)
def gradient_of_the_integrator(table: pd.DataFrame) -> Finding:
    """Backpropagation through an integrator against integrating the adjoint equations."""
    worst = table.groupby(["integrator", "places"]).difference.max()
    middle = table.groupby(["integrator", "places", "ratio"]).difference.median()
    ratio = min(table.ratio, key=lambda r: abs(r - 0.1))
    exact = {name: worst[name, "stages"] for name in ("euler", "heun")}
    evidence = (
        "If the backward step takes the states at which the forward step evaluated its slopes, "
        f"they agree to {exact['euler']:.0e} for Euler and {exact['heun']:.0e} for the author's "
        "midpoint. From the states at the steps' ends alone they differ, at a step of "
        f"{ratio:g} time constants, by {middle['euler', 'nodes', ratio]:.1%} and "
        f"{middle['heun', 'nodes', ratio]:.2%}; those of the true midpoint by "
        f"{middle['midpoint', 'nodes', ratio]:.2%}."
    )
    same = max(exact.values()) < EXACT
    close = max(middle[name, "stages", ratio] for name in exact) < 0.01
    return judged(same, evidence, direction=close, otherwise=Verdict.REFUTED)
