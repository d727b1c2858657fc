"""Fact 2, case 4: weights d(m|s) that depend on the policy, on the domain of figure A.3."""

from __future__ import annotations

from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.appendix_a.pictures import CHANCE, curves, over_policies
from thesis_lib.arrays import FloatArray
from thesis_lib.domains.appendix_a import figure_a3, policy, state_values
from thesis_lib.edition.criteria import EXACT, exact
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, criterion
from thesis_lib.edition.plots import COLOURS, PRINTED
from thesis_lib.edition.words import several
from thesis_lib.potentials.cross_task_problem import CrossTaskProblem

STATES = 4

MUCH = 5.0
"""What the proof's "much greater" is read as: at least this many times."""
AROUND = 0.02
"""What "around .95" is read as: no further from it than this."""

POLICIES = (0.0, 0.25, 0.5, 0.95, 1.0)
"""p(B) of the five policies in our figure A.3c."""


@dataclass(frozen=True)
class Config:
    """The numbers of the domain and the policies that are evaluated."""

    loss: float = 1.0
    """What B costs in task 1."""
    gain: float = 6.0
    """What B earns in task 2."""
    discount: float = 0.9
    """gamma."""
    detour: float = 0.05
    """Probability of going from 3 to 4 in task 1, and of leaving 4 in task 2."""
    policies: int = 501
    """Number of evenly spaced p(B) from 0 to 1."""


@dataclass(frozen=True)
class Value:
    """One state under one policy."""

    p_b: float
    """Probability of B in state 1."""
    state: int
    """1, 2, 3 or 4."""
    task_1: float
    """Value in task 1 [reward]."""
    task_2: float
    """Value in task 2 [reward]."""
    weight_1: float
    """d(m1|s, mu), from the stationary distribution."""
    weight_2: float
    """d(m2|s, mu)."""
    value: float
    """Domain value of the state [reward]."""
    start_value: float
    """One number a policy: expected value of the first state (3.9) [reward]."""
    average_reward: float
    """One number a policy: reward a step, what (3.11) ranks by [reward]."""


@experiment("figure-a.3", item="Figure A.3", smoke=Config(policies=41), book=Config(), seconds=0.6)
def by_policy(config: Config, context: Context) -> list[Value]:
    """Values of all states over p(B) with weights that depend on the policy, exact."""
    domain = figure_a3(config.loss, config.gain, config.discount, config.detour)
    start, average = (CrossTaskProblem(domain, of) for of in ("start", "stationary"))
    records = []
    for p_b in np.linspace(0, 1, config.policies):
        mu = policy(domain, p_b)
        found = state_values(domain, mu, "occupancy")
        at_start = float(start.value(mu))
        per_step = (1 - config.discount) * float(average.value(mu))
        for s in range(STATES):
            (task_1, task_2), (weight_1, weight_2) = found.task[:, s], found.weight[:, s]
            values = (task_1, task_2, weight_1, weight_2, found.domain[s])
            records.append(Value(p_b, s + 1, *values, at_start, per_step))
    return records


def crossing(p_b: FloatArray, value: FloatArray) -> float:
    """Where a curve that ends above 0 last turns positive, by linear interpolation.

    Parameters
    ----------
    p_b, value
        The curve, shape ``(n,)`` each.

    Returns
    -------
    float
        NaN when it ends at or below 0, or is nowhere below.
    """
    below = np.flatnonzero(value < 0)
    if value[-1] <= 0 or not len(below):
        return float("nan")
    i = below[-1]
    return float(p_b[i] - value[i] * (p_b[i + 1] - p_b[i]) / (value[i + 1] - value[i]))


@criterion("A.3-case-4", by_policy)
def no_common_best(table: pd.DataFrame) -> Finding:
    """Whether some policy is best in all states."""
    p_b, value = curves(table)
    best = value >= value.max(axis=0) - EXACT
    parts = several(f"{p_b[best[:, s]][0]:g} in state {s + 1}" for s in range(value.shape[1]))
    return exact(not best.all(axis=1).any(), f"The best p(B) is {parts}.")


@criterion("A.3-flat", by_policy)
def flat_for_a(table: pd.DataFrame) -> Finding:
    """Whether the policy that always takes A has value 0 everywhere."""
    _, value = curves(table)
    largest = float(abs(value[0]).max())
    return exact(largest < EXACT, f"The largest absolute value is {largest:.1g}.")


@criterion("A.3-state-4", by_policy)
def b_raises_state_4_alone(table: pd.DataFrame) -> Finding:
    """Whether a little B lowers states 1 to 3, and more B keeps raising state 4."""
    p_b, value = curves(table)
    step = np.diff(value, axis=0)
    first = (step[0, :3] < 0).all() and step[0, 3] > 0
    rises = (step[:, 3] > 0).all()
    lowest = float(p_b[value[:, 1].argmin()])
    return exact(
        first and rises,
        f"V(4) rises from 0 to {value[-1, 3]:.3g} throughout; V(1) and V(3) fall to "
        f"{value[-1, 0]:.3g} and {value[-1, 2]:.3g}; V(2) falls until p(B) = {lowest:.2f}, to "
        f"{value[:, 1].min():.3g}.",
    )


@criterion("A.3-because-of-state-1", by_policy)
def because_of_state_1(table: pd.DataFrame) -> Finding:
    """Whether in task 2 state 4 rises with state 1, and by less."""
    _, value = curves(table, "task_2")
    one, four = value[:, 0], value[:, 3]
    share = four[1:] / one[1:]
    rises = (np.diff(one) > 0).all() and (np.diff(four) > 0).all()
    proportional = np.ptp(share) < EXACT * share.mean()
    return exact(
        rises and proportional and share.mean() < 1,
        f"In task 2 V(1) rises to {one[-1]:.3g} and V(4) to {four[-1]:.3g}, which is "
        f"{share.mean():.3f} of it under every policy.",
    )


@criterion("A.3-weights", by_policy)
def weights_dominate(table: pd.DataFrame) -> Finding:
    """Whether task 2 dominates state 4 and task 1 dominates state 1, under every policy."""
    (_, one), (_, two) = curves(table, "weight_1"), curves(table, "weight_2")
    at_4 = float((two[:, 3] / one[:, 3]).min())
    at_1 = float((one[:, 0] / two[:, 0]).min())
    return exact(
        min(at_4, at_1) >= MUCH,
        f"Over all policies d(m2|4) is at least {at_4:.1f} times d(m1|4), and d(m1|1) at least "
        f"{at_1:.1f} times d(m2|1).",
    )


@criterion("A.3-state-2", by_policy)
def state_2_turns(table: pd.DataFrame) -> Finding:
    """Where V(2) turns positive, and whether d(m1|2) goes to 0."""
    p_b, value = curves(table)
    weight = curves(table, "weight_1")[1][:, 1]
    at = crossing(p_b, value[:, 1])
    vanishes = (np.diff(weight) < 0).all() and weight[-1] < EXACT
    return exact(
        abs(at - 0.95) <= AROUND and vanishes,
        f"V(2) turns positive at p(B) = {at:.3f} and ends at {value[-1, 1]:.3g}; d(m1|2) falls "
        f"from {weight[0]:.2f} to {weight[-1]:.0f}.",
    )


@criterion("A.3-state-3", by_policy)
def state_3_falls(table: pd.DataFrame) -> Finding:
    """Whether V(3) falls over the whole range, also where V(2) has turned."""
    _, value = curves(table)
    return exact(
        (np.diff(value[:, 2]) < 0).all(),
        f"V(3) falls from {value[0, 2]:.3g} to {value[-1, 2]:.3g}; its largest change between "
        f"neighbouring policies is {np.diff(value[:, 2]).max():.2g}.",
    )


def figure(table: pd.DataFrame) -> Figure:
    """Figure A.3c: five policies state by state, and every policy."""
    figure, (left, right) = plt.subplots(1, 2, sharey=True, figsize=(7.2, 3.8))
    chances = np.unique(table.p_b)
    for p, colour, marker in zip(POLICIES, COLOURS, "oDs^v", strict=False):
        near = chances[abs(chances - p).argmin()]
        rows = table[table.p_b == near]
        left.plot(rows.state, rows.value, marker=marker, color=colour, label=f"{near:g}")
    left.set(xlabel="state", ylabel="domain value [reward]", xticks=[1, 2, 3, 4])
    left.legend(title=CHANCE, ncols=3, loc="upper left")
    left.set_ylim(top=1.9 * table.value.max())  # room for the legend above the lines
    over_policies(right, table, "value")
    right.axvline(0.95, color=PRINTED, ls=":", lw=1.2)
    right.text(0.93, 0.25 * table.value.max(), "the text's .95", ha="right", fontsize=9)
    right.axhline(0, color="0.4", lw=0.8)
    right.set(xlabel=CHANCE)
    right.legend(loc="lower left")
    return figure


def reasons(table: pd.DataFrame) -> Figure:
    """Why: values in either task, and the weight of task 1, over p(B)."""
    figure, axes = plt.subplots(1, 3, figsize=(7.2, 3.4))
    columns = {"task_1": "value in task 1", "task_2": "value in task 2", "weight_1": "$d(m_1|s)$"}
    for ax, (column, title) in zip(axes, columns.items(), strict=True):
        over_policies(ax, table, column)
        ax.set(xlabel=CHANCE, title=title)
    axes[0].set_ylabel("value [reward]")
    axes[2].set_ylabel("weight")
    axes[1].legend()
    return figure


def one_number(table: pd.DataFrame) -> Figure:
    """Two scalar measures of a policy over p(B)."""
    at = table[table.state == 1]
    figure, axes = plt.subplots(1, 2, figsize=(7.2, 3.0))
    shown = (
        ("start_value", "value of the first state [reward]", "by the start"),
        ("average_reward", "reward a step [reward]", "by the time spent"),
    )
    for ax, (column, label, title) in zip(axes, shown, strict=True):
        ax.plot(at.p_b, at[column], color="k")
        best = at.loc[at[column].idxmax()]
        ax.plot(best.p_b, best[column], "o", color=COLOURS[1], ms=8, label="best")
        ax.set(xlabel=CHANCE, ylabel=label, title=title)
        ax.legend()
    return figure


def steps(table: pd.DataFrame) -> pd.DataFrame:
    """How each state's value moves with p(B), and the best p(B)."""
    curve = table.pivot(index="p_b", columns="state", values="value")
    rises = np.diff(curve, axis=0) > 0
    return pd.DataFrame(
        {
            "state": curve.columns,
            "with A": curve.iloc[0].to_numpy() + 0.0,  # turns -0 into 0
            "first step": np.where(rises[0], "up", "down"),
            "all steps": ["up" if up.all() else "both" if up.any() else "down" for up in rises.T],
            "with B": curve.iloc[-1].to_numpy(),
            "best $p(B)$": curve.idxmax().to_numpy(),
        }
    )
