"""Errors of the CTRNN's integrators (section 5.2.2)."""

from __future__ import annotations

from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import torch
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

from thesis_lib.arrays import FloatArray
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import effect_of
from thesis_lib.edition.plots import COLOURS, legend_of
from thesis_lib.policies import CTRNN, make_policy


@dataclass(frozen=True)
class Config:
    """Which networks are integrated, and with which steps."""

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

    def flow(self, integrator: str, dt: float, seed: int) -> CTRNN:
        """The same continuous network for every integrator and step."""
        net = make_policy(
            "ctrnn",
            4,
            2,
            dt=min(dt, self.time_constant),
            seed=seed,
            integrator=integrator,
            time_constant=self.time_constant,
            previous_action=False,
            dtype=torch.float64,
        )
        assert isinstance(net, CTRNN)
        with torch.no_grad():
            net.recurrent.weight.mul_(self.weight_scale)
        return net


@dataclass(frozen=True)
class Deviation:
    """How far one integrator is off with one step."""

    integrator: str
    """euler, midpoint, or heun (the author's midpoint)."""
    seed: int
    """Of weights and inputs."""
    ratio: float
    """Step over time constant."""
    error: float
    """Largest error of a unit over the largest activation."""


@experiment(
    "ch5-integrators",
    item="Section 5.2.2",
    smoke=Config(seeds=1, ratios=(0.1, 1.0)),
    book=Config(),
    seconds=0.9,
)
def errors(config: Config, context: Context) -> list[Deviation]:
    """Error of the CTRNN's integrators against an adaptive solver."""
    records = []
    for seed in range(config.seeds):
        inputs = np.random.default_rng(context.seeds(1, seed)[0]).standard_normal(
            (round(config.duration / config.hold), 4)
        )
        exact = _adaptive(config.flow("heun", config.hold, seed), inputs, config.hold)
        scale = np.abs(exact).max()
        for ratio in config.ratios:
            dt = ratio * config.time_constant
            repeats = round(config.hold / dt)
            for integrator in ("euler", "midpoint", "heun"):
                net = config.flow(integrator, dt, seed)
                held = torch.as_tensor(np.repeat(inputs, repeats, axis=0))[:, None]
                actions = torch.zeros((len(held), 1, net.action_size), dtype=torch.float64)
                with torch.no_grad():
                    drive = net.inputs(held, actions).flatten(0, 1)
                    _, states = net.run(drive, [1] * len(held), net.initial_state(1))
                error = np.abs(states[repeats - 1 :: repeats].numpy() - exact).max() / scale
                records.append(Deviation(integrator, seed, ratio, error))
    return records


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


def mean_errors(table: pd.DataFrame) -> pd.DataFrame:
    """Mean error over networks, integrators by ratios."""
    return table.groupby(["integrator", "ratio"]).error.mean().unstack()


def orders(table: pd.DataFrame) -> pd.Series:
    """Order of each integrator, by its errors at the two smallest steps."""
    error = mean_errors(table)
    low, high = error.columns[:2]
    return np.log(error[high] / error[low]) / np.log(high / low)


@effect_of("5.2.2-midpoint", errors)
def heun(table: pd.DataFrame) -> str:
    """Errors of the three methods at the smallest and the largest step."""
    error = mean_errors(table)
    small, large = error.columns.min(), error.columns.max()
    return (
        f"At a step of {small:g} time constants the errors are {error.loc['euler', small]:.1%} "
        f"(Euler), {error.loc['heun', small]:.2%} (Heun) and {error.loc['midpoint', small]:.2%} "
        f"(midpoint), at {large:g} they are {error.loc['euler', large]:.0%}, "
        f"{error.loc['heun', large]:.0%} and {error.loc['midpoint', large]:.0%}."
    )


def figure(table: pd.DataFrame, gradients: pd.DataFrame) -> Figure:
    """Errors of the integrators, and of gradients integrated apart, over the step."""
    fig, (left, right) = plt.subplots(1, 2, figsize=(7.2, 3.8))
    names = {"euler": "Euler", "heun": 'Heun (the author\'s "midpoint")', "midpoint": "midpoint"}
    for (name, text), colour in zip(names.items(), COLOURS, strict=False):
        by = table[table.integrator == name].groupby("ratio").error
        left.loglog(by.mean().index, by.mean(), "o-", ms=3.5, color=colour, label=text)
        left.fill_between(by.min().index, by.min(), by.max(), color=colour, alpha=0.2, lw=0)
        own = gradients[gradients.integrator == name]
        for places, style in (("nodes", "-"), ("stages", "--")):
            chosen = own[own.places == places].groupby("ratio").difference
            if not len(chosen):
                continue
            right.loglog(chosen.mean().index, chosen.mean(), style, marker="o", ms=3, color=colour)
    for order, start in ((1, 0.5), (2, 0.08)):
        x = np.array([table.ratio.min(), 1.0])
        left.loglog(x, start * x**order, color="0.4", lw=0.9, ls=":")
        left.annotate(f"order {order}", (x[0], start * x[0] ** order), (2, 4), color="0.3",
                      textcoords="offset points", fontsize=8.5)  # fmt: skip
    left.set(xlabel=r"step / time constant", ylabel="largest error of a unit")
    right.set(xlabel=r"step / time constant", ylabel="relative difference of gradients")
    right.plot([], color="0.3", label="states at the ends of steps")
    right.plot([], color="0.3", ls="--", label="states of the stages")
    right.legend(fontsize=8.5, loc="center right")
    legend_of(left, 3, fontsize=9)
    return fig
