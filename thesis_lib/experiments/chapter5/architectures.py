r"""The architectures of section 5.2 as systems: filters, reservoirs and integrators.

Everything here is about networks before training, with the sizes of section 5.4 for one
task; :func:`gains_of` and :func:`responses_of` take a trained one just as well.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import torch
from scipy.integrate import solve_ivp

from thesis_lib.arrays import FloatArray
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.locomotion.tasks import make_task
from thesis_lib.policies import CTRNN, ESN, GaussianPolicy, make_policy
from thesis_lib.policies.response import measured_gain, respond, small_signal_gain

NETS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "FFWD": ("ffwd", {}),
    "DFFWD": ("dffwd", {}),
    "DTRNN": ("dtrnn", {}),
    "CTRNN, 1 s": ("ctrnn", {"time_constant": 1.0}),
    "CTRNN, 0.1 s": ("ctrnn", {"time_constant": 0.1}),
    "GRU": ("gru", {}),
    "LSTM": ("lstm", {}),
    "ESN": ("esn", {}),
}
"""Networks compared; the CTRNN with the author's initial time constant and a shorter one."""


SLOW, GAIT, FAST = 0.5, 2.0, 10.0
"""Frequencies that count as slow (below), as those of a gait (about) and as noise (above) [Hz].

A gait's is a convention: section-5.5.2-gaits finds from 0.5 Hz (swimmer) to about 5 Hz
(half-cheetah), of which 2 Hz is near the middle, and none for the hopper and the walker.
"""


def gait_band(frequency: pd.Series, gait: float = GAIT) -> pd.Series:
    """Whether frequencies [Hz] are within a fifth of a gait's."""
    return frequency.between(gait / 1.2, gait * 1.2)


def untrained_net(name: str, task: str, seed: int) -> GaussianPolicy:
    """A network of :data:`NETS` for a task, with its initial weights."""
    architecture, options = NETS[name]
    made = make_task(task)
    return make_policy(
        architecture,
        made.observation_size,
        made.action_size,
        dt=ROBOTS[task].control_dt,
        seed=seed,
        **options,
    )


def random_direction(size: int, seed: np.random.SeedSequence) -> FloatArray:
    """A random unit vector, shape ``(size,)``."""
    draw = np.random.default_rng(seed).standard_normal(size)
    return np.asarray(draw / np.linalg.norm(draw))


def _rms(values: FloatArray) -> FloatArray:
    """Root mean square over the actions."""
    return np.asarray(np.sqrt(np.mean(np.square(values), axis=-1)))


# ----------------------------------------------------------------------------------------- gain
@dataclass(frozen=True)
class GainConfig:
    """Settings of section-5.2-gain."""

    task: str = "Hopper"
    """Whose sizes and control step are used."""
    seeds: int = 5
    """Networks of each kind."""
    amplitude: float = 1.0
    """Standard deviation of the noise: the perturbation of section 5.4."""
    steps: int = 2**15
    """Length of the noise."""
    segment: int = 512
    """Steps of a segment of the spectrum."""


def gains_of(
    policy: GaussianPolicy,
    dt: float,
    direction: FloatArray,
    generator: np.random.Generator,
    config: GainConfig,
) -> pd.DataFrame:
    """Gain of one network over frequency: ``frequency``, ``gain``, ``small_signal_gain``."""
    frequency, gain = measured_gain(
        policy,
        dt,
        direction,
        amplitude=config.amplitude,
        generator=generator,
        steps=config.steps,
        segment=config.segment,
    )
    # The mean was taken out of every segment, and with it the lowest frequency.
    frequency, gain = frequency[1:], gain[1:]
    try:
        small = _rms(small_signal_gain(policy, dt, direction, frequency))
    except ValueError:  # never at rest, or unstable there
        small = np.full(len(frequency), np.nan)
    return pd.DataFrame({"frequency": frequency, "gain": _rms(gain), "small_signal_gain": small})


def gains(config: GainConfig, context: Context) -> pd.DataFrame:
    """Gain over frequency of every network."""
    dt = ROBOTS[config.task].control_dt

    def measure(job: tuple[str, int]) -> pd.DataFrame:
        name, seed = job
        policy = untrained_net(name, config.task, seed)
        along, noise = context.seeds(2, seed)
        direction = random_direction(policy.observation_size, along)
        generator = np.random.default_rng(noise)
        table = gains_of(policy, dt, direction, generator, config)
        return table.assign(net=name, seed=seed)

    jobs = [(name, seed) for name in NETS for seed in range(config.seeds)]
    return pd.concat(context.map(measure, jobs, "networks"), ignore_index=True)


SECTION_5_2_GAIN = Experiment(
    id="section-5.2-gain",
    item="Section 5.2",
    title="Gain of every architecture over frequency, before training",
    function=gains,
    budgets={
        "smoke": GainConfig(seeds=1, steps=2048, segment=256),
        "book": GainConfig(),
        "thesis": GainConfig(),
    },
    columns={
        "net": "a key of NETS",
        "seed": "seed of the initial weights and of the direction of the input",
        "frequency": "Hz",
        "gain": "measured with white noise, root mean square over the actions",
        "small_signal_gain": "of the network linearised at rest; empty if it is unstable there",
    },
    seconds={"smoke": 3, "book": 60, "thesis": 60},
)


# ------------------------------------------------------------------------------------ responses
@dataclass(frozen=True)
class ResponsesConfig:
    """Settings of section-5.2-responses."""

    task: str = "Hopper"
    """Whose sizes and control step are used."""
    seeds: int = 5
    """Networks of each kind."""
    size: float = 1.0
    """Height of impulse and step."""
    onset: int = 10
    """Control step at which they come."""
    steps: int = 200
    """Control steps shown."""


def responses_of(
    policy: GaussianPolicy, dt: float, direction: FloatArray, config: ResponsesConfig
) -> pd.DataFrame:
    """What an impulse and a step change: ``signal``, ``time`` and ``response``.

    The response is the distance of the mean action from what it would be without the
    signal, root mean square over the actions.
    """
    time = np.arange(config.steps)
    shapes = {"impulse": time == config.onset, "step": time >= config.onset}
    quiet = respond(policy, np.zeros(config.steps), direction)
    tables = []
    for name, shape in shapes.items():
        moved = respond(policy, config.size * shape, direction) - quiet
        seconds = (time - config.onset) * dt
        tables.append(pd.DataFrame({"signal": name, "time": seconds, "response": _rms(moved)}))
    return pd.concat(tables, ignore_index=True)


def responses(config: ResponsesConfig, context: Context) -> pd.DataFrame:
    """Response of every network to an impulse and to a step."""
    dt = ROBOTS[config.task].control_dt
    tables = []
    for name in NETS:
        for seed in range(config.seeds):
            policy = untrained_net(name, config.task, seed)
            direction = random_direction(policy.observation_size, context.seeds(1, seed)[0])
            table = responses_of(policy, dt, direction, config)
            tables.append(table.assign(net=name, seed=seed))
    return pd.concat(tables, ignore_index=True)


SECTION_5_2_RESPONSES = Experiment(
    id="section-5.2-responses",
    item="Section 5.2",
    title="Response of every architecture to an impulse and a step, before training",
    function=responses,
    budgets={
        "smoke": ResponsesConfig(seeds=1, steps=40),
        "book": ResponsesConfig(),
        "thesis": ResponsesConfig(),
    },
    columns={
        "net": "a key of NETS",
        "seed": "seed of the initial weights and of the direction of the input",
        "signal": "impulse or step",
        "time": "since the signal came [s]",
        "response": "root mean square over the actions of what the signal changes",
    },
    seconds={"smoke": 1, "book": 5, "thesis": 5},
)


# ----------------------------------------------------------------------------------- reservoirs
@dataclass(frozen=True)
class EigenvaluesConfig:
    """Settings of section-5.2.5-eigenvalues."""

    seed: int = 0
    """Of the weights."""
    ant_units: int = 800
    """Units of the Ant's reservoir here; its 3256 take minutes and look the same."""


def eigenvalues(config: EigenvaluesConfig, context: Context) -> pd.DataFrame:
    """Eigenvalues of the recurrent weights of reservoirs, and of the DTRNN beside them."""
    records = []

    def add(net: str, radius: float, density: float, weight: FloatArray) -> None:
        for value in np.linalg.eigvals(weight):
            records.append(
                {
                    "net": net,
                    "spectral_radius": radius,
                    "density": density,
                    "real": value.real,
                    "imaginary": value.imag,
                }
            )

    for task, radius, density, units in (
        ("Hopper", 1.1, 1.0, None),
        ("Ant", 1.5, 0.7, config.ant_units),
    ):
        made = make_task(task)
        net = make_policy(
            "esn",
            made.observation_size,
            made.action_size,
            dt=ROBOTS[task].control_dt,
            seed=config.seed,
            units=units,
            spectral_radius=radius,
            density=density,
        )
        assert isinstance(net, ESN)
        add(f"ESN, {task}", radius, density, net.recurrent.weight.double().numpy())
    vanilla = untrained_net("DTRNN", "Ant", config.seed)
    weight = vanilla.get_parameter("recurrent.weight").detach().double().numpy()
    add("DTRNN, Ant", np.nan, 1.0, weight)
    return rows(records)


SECTION_5_2_5_EIGENVALUES = Experiment(
    id="section-5.2.5-eigenvalues",
    item="Section 5.2.5",
    title="Eigenvalues of echo state networks, and of a vanilla net before training",
    function=eigenvalues,
    budgets={
        "smoke": EigenvaluesConfig(ant_units=50),
        "book": EigenvaluesConfig(),
        "thesis": EigenvaluesConfig(),
    },
    columns={
        "net": "architecture and task",
        "spectral_radius": "asked for; empty for the vanilla net",
        "density": "share of weights that are not 0",
        "real": "real part of an eigenvalue",
        "imaginary": "its imaginary part",
    },
    seconds={"smoke": 0.2, "book": 3, "thesis": 3},
)


# ---------------------------------------------------------------------------------- integrators
@dataclass(frozen=True)
class IntegratorsConfig:
    """Settings of section-5.2.2-integrators."""

    time_constant: float = 0.2
    """tau of every unit [s]."""
    ratios: tuple[float, ...] = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
    """Steps of the integrator over tau; 1 is where the author's clamp holds it."""
    duration: float = 2.0
    """Time simulated [s]."""
    hold: float = 0.2
    """Time for which an input stays the same [s]."""
    seeds: int = 5
    """Networks, with random inputs."""
    weight_scale: float = 3.0
    """What the recurrent weights are multiplied with, to make the flow less tame."""


def integrators(config: IntegratorsConfig, context: Context) -> pd.DataFrame:
    """Error of each integrator against an adaptive solver of high order."""
    records = []
    for seed in range(config.seeds):
        inputs = np.random.default_rng(context.seeds(1, seed)[0]).standard_normal(
            (round(config.duration / config.hold), 4)
        )
        exact = _adaptive(_flow(config, "heun", config.hold, seed), inputs, config.hold)
        scale = np.abs(exact).max()
        for ratio in config.ratios:
            dt = ratio * config.time_constant
            repeats = round(config.hold / dt)
            for integrator in ("euler", "midpoint", "heun"):
                net = _flow(config, integrator, dt, seed)
                held = torch.as_tensor(np.repeat(inputs, repeats, axis=0))[:, None]
                nothing = torch.zeros((len(held), 1, net.action_size), dtype=torch.float64)
                with torch.no_grad():
                    drive = net.inputs(held, nothing).flatten(0, 1)
                    _, states = net.run(drive, [1] * len(held), net.initial_state(1))
                found = states[repeats - 1 :: repeats].numpy()
                records.append(
                    {
                        "integrator": integrator,
                        "seed": seed,
                        "ratio": ratio,
                        "error": np.abs(found - exact).max() / scale,
                    }
                )
    return rows(records)


def _flow(config: IntegratorsConfig, integrator: str, dt: float, seed: int) -> CTRNN:
    """The same continuous network for every integrator and step."""
    net = make_policy(
        "ctrnn",
        4,
        2,
        dt=min(dt, config.time_constant),
        seed=seed,
        integrator=integrator,
        time_constant=config.time_constant,
        previous_action=False,
        dtype=torch.float64,
    )
    assert isinstance(net, CTRNN)
    with torch.no_grad():
        net.recurrent.weight.mul_(config.weight_scale)
    return net


def _adaptive(net: CTRNN, inputs: FloatArray, hold: float) -> FloatArray:
    """States at the end of every input, by an eighth-order method with step control."""
    K = net.recurrent.weight.detach().numpy()
    W, b = net.input.weight.detach().numpy(), net.input.bias.detach().numpy()
    tau = net.time_constants().detach().numpy()
    h, states = np.zeros(net.units), []
    for x in inputs:
        drive = W @ x + b

        def flow(_: float, h: FloatArray, drive: FloatArray = drive) -> FloatArray:
            return np.asarray((-h + np.tanh(K @ h + drive)) / tau)

        h = solve_ivp(flow, (0, hold), h, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
        states.append(h)
    return np.array(states)


SECTION_5_2_2_INTEGRATORS = Experiment(
    id="section-5.2.2-integrators",
    item="Section 5.2.2",
    title="Error of the CTRNN's integrators against an adaptive solver",
    function=integrators,
    budgets={
        "smoke": IntegratorsConfig(seeds=1, ratios=(0.1, 1.0)),
        "book": IntegratorsConfig(),
        "thesis": IntegratorsConfig(),
    },
    columns={
        "integrator": "euler, midpoint, or heun (the author's midpoint)",
        "seed": "of weights and inputs",
        "ratio": "step over time constant",
        "error": "largest error of a unit over the largest activation",
    },
    seconds={"smoke": 0.2, "book": 3, "thesis": 3},
)

EXPERIMENTS: tuple[Experiment[Any], ...] = (
    SECTION_5_2_GAIN,
    SECTION_5_2_RESPONSES,
    SECTION_5_2_5_EIGENVALUES,
    SECTION_5_2_2_INTEGRATORS,
)
"""To be listed with chapter 5."""
