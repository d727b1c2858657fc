r"""Continuous-time networks and their steps (section 5.2.2): gradients and stability.

A CTRNN is :math:`\dot h = D(-h + f(Kh + u))` with :math:`D = \mathrm{diag}(1/\tau)` and an
input u that is held over a step.  The gradient of a number at its end obeys the adjoint
equations, backward in time,

.. math:: -\dot\lambda = -D\lambda + K^\top (f' \circ D\lambda), \qquad
          -\dot G = (f' \circ D\lambda)\, h^\top,

with :math:`\lambda` the gradient in the state and G that in K.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray

from thesis_lib.arrays import FloatArray
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.experiments.chapter5.architectures import untrained_net
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.policies import CTRNN, DTRNN, ESN


# ----------------------------------------------------------------------------------- gradients
@dataclass(frozen=True)
class GradientsConfig:
    """Settings of section-5.2.2-gradients."""

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
class _Net:
    """Weights, inverse time constants and step of a CTRNN."""

    K: FloatArray
    rate: FloatArray
    dt: float

    def flow(self, h: FloatArray, drive: FloatArray) -> FloatArray:
        """Time derivative of the state."""
        return self.rate * (np.tanh(self.K @ h + drive) - h)

    def adjoint(self, h: FloatArray, drive: FloatArray, lam: FloatArray) -> FloatArray:
        """Rates of lambda (first row) and of G, backward in time, shape ``(N + 1, N)``."""
        error = (1 - np.tanh(self.K @ h + drive) ** 2) * self.rate * lam
        return np.vstack([self.K.T @ error - self.rate * lam, np.outer(error, h)])


def _backward(
    net: _Net, integrator: str, places: str, states: FloatArray, drives: FloatArray, end: FloatArray
) -> FloatArray:
    """Integrate the adjoint equations along a trajectory, shape ``(N + 1, N)`` as above."""
    dt, both = net.dt, np.vstack([end, np.zeros((len(end), len(end)))])
    for n in reversed(range(len(drives))):
        h, after, drive = states[n], states[n + 1], drives[n]
        slope = net.flow(h, drive)
        if integrator == "euler":
            at = h if places == "stages" else after
            both = both + dt * net.adjoint(at, drive, both[0])
        elif integrator == "heun":
            # Where the forward step looked for its second slope, or where it ended.
            at = h + dt * slope if places == "stages" else after
            first = net.adjoint(at, drive, both[0])
            second = net.adjoint(h, drive, both[0] + dt * first[0])
            both = both + 0.5 * dt * (first + second)
        else:
            first = net.adjoint(after, drive, both[0])
            half = both[0] + 0.5 * dt * first[0]
            both = both + dt * net.adjoint(h + 0.5 * dt * slope, drive, half)
    return both


def gradients(config: GradientsConfig, context: Context) -> pd.DataFrame:
    """Backpropagation through each integrator, against integrating the adjoint equations."""
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
                net = _Net(K, 1 / policy.time_constants().detach().numpy(), dt)
                for places in ("stages", "nodes")[integrator == "midpoint" :]:
                    found = _backward(net, integrator, places, states, drives, end)
                    records.append(
                        {
                            "integrator": integrator,
                            "places": places,
                            "seed": seed,
                            "ratio": ratio,
                            "difference": np.linalg.norm(found - exact) / np.linalg.norm(exact),
                        }
                    )
    return rows(records)


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


SECTION_5_2_2_GRADIENTS = Experiment(
    id="section-5.2.2-gradients",
    item="Section 5.2.2",
    title="Gradient of an integrated network against integrating the equations of the gradient",
    function=gradients,
    budgets={
        "smoke": GradientsConfig(seeds=1, ratios=(0.1, 1.0)),
        "book": GradientsConfig(),
        "thesis": GradientsConfig(),
    },
    columns={
        "integrator": "euler, heun (the author's midpoint) or midpoint",
        "places": "states the backward step uses: the forward step's stages, or only its ends",
        "seed": "of weights and inputs",
        "ratio": "step over time constant",
        "difference": "relative, of the gradients in the initial state and in K together",
    },
    seconds={"smoke": 0.5, "book": 10, "thesis": 10},
)


# ----------------------------------------------------------------------------------- stability
@dataclass(frozen=True)
class StabilityConfig:
    """Settings of section-5.2.2-stability."""

    ratios: tuple[float, ...] = (0.3, 0.4, 0.45, 0.55, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5, 2.0)
    """Time constants over the step."""
    seeds: int = 100
    """Networks for each task."""


def growth(eigenvalues: NDArray[np.complex128], ratio: float, integrator: str) -> float:
    r"""Factor by which a step multiplies the worst mode that should decay.

    A mode of :math:`\dot h = (K - I)h/\tau` with eigenvalue :math:`\mu` of K decays if the
    real part of :math:`\mu` is below 1.  A step multiplies it by :math:`1 + z` (Euler) or
    :math:`1 + z + z^2/2` (Heun, midpoint), :math:`z = (\mu - 1)\Delta t/\tau`.

    Parameters
    ----------
    eigenvalues
        Of K, shape ``(N,)``.
    ratio
        :math:`\tau/\Delta t`.
    integrator
        ``euler``, ``heun`` or ``midpoint``.
    """
    z = (eigenvalues[eigenvalues.real < 1] - 1) / ratio
    factors = 1 + z if integrator == "euler" else 1 + z + z**2 / 2
    return float(np.abs(factors).max(initial=0.0))


def stability(config: StabilityConfig, context: Context) -> pd.DataFrame:
    """Growth of modes that should decay, about rest, for time constants about the step."""
    records = []
    for task in (None, *ROBOTS):
        for seed in range(config.seeds if task else 1):
            if task is None:
                eigenvalues = np.zeros(1, dtype=complex)
            else:
                net = untrained_net("CTRNN, 1 s", task, seed)
                K = net.get_parameter("recurrent.weight").detach().double().numpy()
                eigenvalues = np.linalg.eigvals(K).astype(complex)
            for ratio in config.ratios:
                for integrator in ("euler", "heun"):
                    records.append(
                        {
                            "net": task or "leak alone",
                            "seed": seed,
                            "integrator": integrator,
                            "ratio": ratio,
                            "growth": growth(eigenvalues, ratio, integrator),
                        }
                    )
    return rows(records)


SECTION_5_2_2_STABILITY = Experiment(
    id="section-5.2.2-stability",
    item="Section 5.2.2",
    title="Whether a continuous-time network is stable when its time constants are below the step",
    function=stability,
    budgets={
        "smoke": StabilityConfig(ratios=(0.45, 0.9, 1.0, 1.2), seeds=2),
        "book": StabilityConfig(),
        "thesis": StabilityConfig(),
    },
    columns={
        "net": "task whose sizes the untrained network has, or leak alone (K = 0)",
        "seed": "of the weights",
        "integrator": "euler, or heun; the true midpoint has the same factors as heun",
        "ratio": "time constant over step",
        "growth": "factor a step, of the worst mode that decays in continuous time; about rest",
    },
    seconds={"smoke": 0.2, "book": 3, "thesis": 3},
)


# ---------------------------------------------------------------------------------- identities
@dataclass(frozen=True)
class IdentitiesConfig:
    """Settings of section-5.2-identities."""

    steps: int = 200
    """Steps over which networks are compared, with random inputs."""
    seeds: int = 5
    """Networks."""


def identities(config: IdentitiesConfig, context: Context) -> pd.DataFrame:
    """Networks that the text calls the same, compared step by step."""
    records = []
    for seed in range(config.seeds):
        rng = np.random.default_rng(context.seeds(1, seed)[0])
        drives = torch.as_tensor(rng.standard_normal((config.steps, 6)))
        plain = DTRNN(3, 2, units=6, seed=seed, dtype=torch.float64)
        common: dict[str, Any] = {"units": 6, "seed": seed, "dtype": torch.float64}
        others = {
            "CTRNN by Euler steps of the time constant": CTRNN(
                3, 2, dt=0.02, time_constant=0.02, integrator="euler", **common
            ),
            "CTRNN by Heun steps of the time constant": CTRNN(
                3, 2, dt=0.02, time_constant=0.02, integrator="heun", **common
            ),
            "ESN without leak": ESN(3, 2, leak=1.0, **common),
            "ESN with the author's leak of 0.5": ESN(3, 2, leak=0.5, **common),
        }
        for name, net in others.items():
            with torch.no_grad():
                net.recurrent.weight.copy_(plain.recurrent.weight)
                start = torch.zeros((1, 6), dtype=torch.float64)
                sizes = [1] * config.steps
                gap = net.unroll(drives, sizes, start) - plain.unroll(drives, sizes, start)
            records.append({"net": name, "seed": seed, "difference": float(gap.abs().max())})
    return rows(records)


SECTION_5_2_IDENTITIES = Experiment(
    id="section-5.2-identities",
    item="Section 5.2",
    title="Networks that are discrete-time ones in disguise",
    function=identities,
    budgets={
        "smoke": IdentitiesConfig(steps=20, seeds=2),
        "book": IdentitiesConfig(),
        "thesis": IdentitiesConfig(),
    },
    columns={
        "net": "compared with the DTRNN of the same weights and inputs",
        "seed": "of weights and inputs",
        "difference": "largest difference of a unit in any step",
    },
    seconds={"smoke": 0.1, "book": 0.5, "thesis": 0.5},
)

EXPERIMENTS: tuple[Experiment[Any], ...] = (
    SECTION_5_2_IDENTITIES,
    SECTION_5_2_2_GRADIENTS,
    SECTION_5_2_2_STABILITY,
)
"""Those of this module."""
