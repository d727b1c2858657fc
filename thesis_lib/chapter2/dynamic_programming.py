"""How fast policy and value iteration converge on the cliff (section 2.3.2)."""

from __future__ import annotations

from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.chapter2.one_cliff import layout
from thesis_lib.domains.cliff import cliff_task
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.mdp.model import TabularMDP
from thesis_lib.mdp.planning import policy_iteration, solve, value_iteration


@dataclass(frozen=True)
class Config:
    """When to stop, and with which discount."""

    tolerance: float = 1e-6
    """Sweeps go on until no value is further than this from the optimum."""
    discount: float = 0.9
    """gamma below 1; the episodic task is solved with 1 as well."""


def tasks(config: Config) -> list[tuple[str, TabularMDP]]:
    """The forms of the cliff that are solved: episodic with gamma = 1 and below, continuing."""
    forms = ((False, 1.0), (False, config.discount), (True, config.discount))
    return [
        (
            "continuing" if continuing else "episodic",
            cliff_task(layout(), continuing=continuing, sensor=False, discount=discount),
        )
        for continuing, discount in forms
    ]


@dataclass(frozen=True)
class Error:
    """Distance from the optimal values after a sweep through the states."""

    task: str
    """episodic (section 3.4.1) or continuing (section 3.4.2)."""
    discount: float
    """gamma."""
    algorithm: str
    """value iteration (in place, algorithm 2), synchronous, or policy iteration."""
    sweep: int
    """Number of sweeps; policy iteration: at the end of each round of evaluation."""
    error: float
    """Largest distance of a value from the optimal one."""
    bound: float
    """gamma to the power of the sweep, times the first error; none for gamma = 1."""


@experiment(
    "ch2-dynamic-programming",
    item="Section 2.3.2",
    smoke=Config(),
    book=Config(),
    seconds=0.02,
)
def errors(config: Config, context: Context) -> list[Error]:
    """Sweeps of policy and value iteration on the cliff until the values are optimal."""
    records = []
    for name, mdp in tasks(config):
        optimum = solve(mdp)
        curves: dict[str, list[tuple[int, float]]] = {}
        for algorithm, synchronous in (("value iteration", False), ("synchronous", True)):
            run = value_iteration(
                mdp, optimum=optimum.q, tolerance=config.tolerance, synchronous=synchronous
            )
            assert run.errors is not None
            curves[algorithm] = list(enumerate(run.errors.tolist()))
        rounds = policy_iteration(mdp, theta=config.tolerance)
        ends = np.cumsum(rounds.sweeps)
        distance = np.abs(rounds.values - optimum.v).max(axis=1)
        curves["policy iteration"] = list(zip(ends.tolist(), distance.tolist(), strict=True))
        for algorithm, curve in curves.items():
            contracts = mdp.discount < 1 and algorithm != "policy iteration"
            for sweep, error in curve:
                bound = curve[0][1] * mdp.discount**sweep if contracts else np.nan
                records.append(Error(name, mdp.discount, algorithm, sweep, error, bound))
    return records


def in_place(table: pd.DataFrame) -> pd.DataFrame:
    """Value iteration in place on the continuing task, a row a sweep."""
    return table.query("algorithm == 'value iteration' & task == 'continuing'")


def figure(table: pd.DataFrame) -> Figure:
    """Error by sweep: the continuing task with its bound, and the episodic one."""
    fig, axes = plt.subplots(1, 2)
    first = in_place(table)
    forms = ("continuing", first.discount.iloc[0]), ("episodic", 1.0)
    for ax, (task, gamma) in zip(axes, forms, strict=True):
        own = table[(table.task == task) & (table.discount == gamma)]
        for algorithm, style in (("value iteration", "-"), ("policy iteration", "s:")):
            rows = own[own.algorithm == algorithm]
            ax.plot(rows.sweep, rows.error, style, lw=1.5, ms=4, label=algorithm)
        ax.set(title=f"{task}, $\\gamma$ = {gamma:g}", xlabel="sweep")
    axes[0].plot(first.sweep, first.bound, "k--", lw=1, label="bound")
    axes[0].set(ylabel="largest error [reward]", yscale="log")
    axes[0].legend()
    return fig
