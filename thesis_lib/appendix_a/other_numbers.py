"""How much of case 4 hangs on the numbers of our domain of figure A.3."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.appendix_a.figure_a_3 import AROUND, crossing
from thesis_lib.appendix_a.pictures import CHANCE
from thesis_lib.arrays import FloatArray
from thesis_lib.domains.appendix_a import figure_a3, policy, state_values
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import effect_of
from thesis_lib.edition.plots import COLOURS

STATEMENTS = ("first_step", "state_4_rises", "state_3_falls", "state_2_turns")
"""What the proof says of how values move, by column."""


@dataclass(frozen=True)
class Config:
    """Which numbers are tried in place of those of the domain."""

    gains: tuple[float, ...] = tuple(np.arange(1.0, 12.01, 0.25))
    """What B earns in task 2, for each unit it costs in task 1."""
    detours: tuple[float, ...] = (0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.08, 0.1, 0.15, 0.2, 0.3)
    """Probability of going from 3 to 4 in task 1, and of leaving 4 in task 2."""
    discounts: tuple[float, ...] = (0.5, 0.8, 0.9, 0.95, 0.99)
    """gamma."""
    policies: int = 101
    """Number of evenly spaced p(B) from 0 to 1."""


@dataclass(frozen=True)
class Numbers:
    """What holds with one choice of numbers."""

    discount: float
    """gamma."""
    detour: float
    """Probability of going from 3 to 4 in task 1, and of leaving 4 in task 2."""
    gain: float
    """What B earns in task 2 for each unit it costs in task 1."""
    conflict: bool
    """Whether no policy is best in all states."""
    first_step: bool
    """Whether making B possible lowers states 1 to 3 and raises state 4."""
    state_4_rises: bool
    """Whether V(s4) rises throughout."""
    state_3_falls: bool
    """Whether V(s3) falls throughout."""
    state_2_turns: bool
    """Whether V(s2) ends above 0 after having been below."""
    crossing: float
    """p(B) from which V(s2) is above 0; empty when it never is."""


def what_holds(
    p_b: FloatArray, value: FloatArray, discount: float, detour: float, gain: float
) -> Numbers:
    """Which statements of the proof hold of curves of domain values.

    Parameters
    ----------
    p_b
        Probabilities of B, rising from 0 to 1, shape ``(P,)``.
    value
        Domain values, shape ``(P, 4)``.
    discount, detour, gain
        With which they were made.
    """
    step = np.diff(value, axis=0)
    highest = value.max(axis=0)
    best = np.isclose(value, highest, rtol=0, atol=1e-12 * max(1.0, np.abs(value).max()))
    turn = crossing(p_b, value[:, 1])
    return Numbers(
        discount,
        detour,
        gain,
        conflict=not best.all(axis=1).any(),
        first_step=bool((step[0, :3] < 0).all() and step[0, 3] > 0),
        state_4_rises=bool((step[:, 3] > 0).all()),
        state_3_falls=bool((step[:, 2] < 0).all()),
        state_2_turns=not np.isnan(turn),
        crossing=turn,
    )


@experiment(
    "app-a-numbers",
    item="Figure A.3, other numbers",
    smoke=Config(gains=(3.0, 6.0, 9.0), detours=(0.02, 0.05, 0.2), discounts=(0.9,), policies=21),
    book=Config(),
    seconds=2,
)
def by_numbers(config: Config, context: Context) -> list[Numbers]:
    """Which statements about figure A.3 hold for other rewards, probabilities and discounts."""
    p_b = np.linspace(0, 1, config.policies)
    records = []
    for gamma, detour in product(config.discounts, config.detours):
        # Task 2's values are proportional to the gain, so that one evaluation serves them all.
        domain = figure_a3(1.0, 1.0, gamma, detour)
        found = [state_values(domain, policy(domain, p), "occupancy") for p in p_b]
        loss, gain = (np.array([f.weight[m] * f.task[m] for f in found]) for m in range(2))
        records += [what_holds(p_b, loss + g * gain, gamma, detour, g) for g in config.gains]
    return records


def hold(table: pd.DataFrame) -> pd.Series:
    """Whether all of :data:`STATEMENTS` hold, a row of the table."""
    return table[list(STATEMENTS)].all(axis=1)


@effect_of("A.3-numbers", by_numbers)
def effect(table: pd.DataFrame) -> str:
    """How often the statements hold when the numbers of figure A.3 are others."""
    every = hold(table)
    near = every & (abs(table.crossing - 0.95) <= AROUND)
    return (
        f"Of {len(table)} other choices of gain, detour and discount, fact 2 holds in "
        f"{table.conflict.mean():.0%}, all the proof's statements on how values move in "
        f"{every.mean():.0%}, and the turn of state 2 lies within {AROUND:g} of .95 as well in "
        f"{near.mean():.0%}."
    )


def figure(table: pd.DataFrame, discount: float) -> Figure:
    """Where V(2) turns positive for other gains and detours; crosses where a statement fails."""
    at = table[np.isclose(table.discount, discount)]
    turns = at.assign(crossing=at.crossing.where(hold(at)))
    grid = turns.pivot(index="detour", columns="gain", values="crossing")
    figure, ax = plt.subplots(figsize=(7.2, 3.8))
    image = ax.imshow(grid, origin="lower", aspect="auto", vmin=0.5, vmax=1.0)
    figure.colorbar(image, label=f"turn of state 2 [{CHANCE}]")
    row, column = np.nonzero(grid.isna().to_numpy())
    ax.plot(column, row, "x", color="0.45", ms=4, ls="none")
    shown = np.arange(0, grid.shape[1], max(1, grid.shape[1] // 11))
    ax.set_xticks(shown, [f"{grid.columns[i]:g}" for i in shown])
    ax.set_yticks(range(len(grid)), [f"{d:g}" for d in grid.index])
    ours = grid.columns.get_indexer([6.0], "nearest"), grid.index.get_indexer([0.05], "nearest")
    ax.plot(*ours, "o", mfc="none", mec=COLOURS[1], mew=2, ms=12)
    ax.set(xlabel="gain of B in task 2 / loss in task 1", ylabel=r"detour $\delta$")
    ax.grid(visible=False)
    return figure
