"""Fact 2, cases 1 to 3: no policy maximises all states at once on the domains of figure A.2."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.appendix_a.pictures import CHANCE, curves, over_policies, tabular
from thesis_lib.arrays import FloatArray
from thesis_lib.domains.appendix_a import SecondTask, Weighting, figure_a2, policy, state_values
from thesis_lib.edition.criteria import EXACT, exact
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, criterion, effect_of
from thesis_lib.mdp.model import TabularMDP


@dataclass(frozen=True)
class Config:
    """Which domains, weightings and policies are evaluated."""

    second: tuple[SecondTask, ...] = ("a", "b", "c")
    """Variations of task 2."""
    weightings: tuple[Weighting, ...] = ("uniform", "occupancy")
    """p(s|m)."""
    discounts: tuple[float, ...] = (0.5, 0.9, 0.99)
    """gamma."""
    policies: int = 21
    """Number of evenly spaced p(B) from 0 to 1."""


def communicating(transition: FloatArray) -> bool:
    """Whether every state can be reached from every other, given a chain ``(S, S)``."""
    reached = np.eye(len(transition)) + (transition > 0)
    return bool((np.linalg.matrix_power(reached, len(transition)) > 0).all())


def _ergodic(task: TabularMDP) -> bool:
    """Whether the chains of both deterministic choices in state 1 communicate."""
    return all(communicating(task.transition[:, a]) for a in range(2))


@dataclass(frozen=True)
class Value:
    """One state under one policy."""

    second: str
    """Variation of task 2: a (no state 3), b (state 3 cut off) or c (ergodic)."""
    weighting: str
    """p(s|m): uniform over the states of a task, or the policy's occupancy."""
    discount: float
    """gamma."""
    p_b: float
    """Probability of B in state 1."""
    state: int
    """1, 2 or 3."""
    task_1: float
    """Value in task 1 [reward]."""
    task_2: float
    """Value in task 2 [reward], empty where the task lacks the state."""
    weight_1: float
    """d(m1|s)."""
    weight_2: float
    """d(m2|s)."""
    value: float
    """Domain value of the state [reward]."""
    same_states: bool
    """Whether both tasks have the same states."""
    ergodic_1: bool
    """Whether task 1 is ergodic: all its states communicate under every policy."""
    ergodic_2: bool
    """The same of task 2."""


@experiment(
    "figure-a.2",
    item="Figure A.2",
    smoke=Config(discounts=(0.9,), policies=5),
    book=Config(),
    seconds=0.1,
)
def by_policy(config: Config, context: Context) -> list[Value]:
    """Values of all states over p(B) on the three domains of cases 1 to 3, exact."""
    records = []
    for second, weighting, gamma in product(config.second, config.weightings, config.discounts):
        domain = figure_a2(second, discount=gamma)
        same = bool(domain.present.all())
        ergodic_1, ergodic_2 = map(_ergodic, tabular(domain))
        for p_b in np.linspace(0, 1, config.policies):
            found = state_values(domain, policy(domain, p_b), weighting)
            for s in range(domain.n_observations):
                (task_1, task_2), (weight_1, weight_2) = found.task[:, s], found.weight[:, s]
                records.append(
                    Value(
                        *(second, weighting, gamma, p_b, s + 1),
                        *(task_1, task_2, weight_1, weight_2, found.domain[s]),
                        *(same, ergodic_1, ergodic_2),
                    )
                )
    return records


def _opposed(table: pd.DataFrame, second: str, setting: bool) -> Finding:
    """Whether B helps state 1 and harms state 3, at every discount, with uniform p(s|m)."""
    holds, parts = [], []
    chosen = table[(table.second == second) & (table.weighting == "uniform")]
    for gamma, group in chosen.groupby("discount"):
        _, value = curves(group)
        holds.append((np.diff(value[:, 0]) > 0).all() and (np.diff(value[:, 2]) < 0).all())
        parts.append(
            f"at gamma {gamma:g} from 0 to {value[-1, 0]:.3g} and from 0 to {value[-1, 2]:.3g}"
        )
    return exact(
        all(holds) and setting,
        "As p(B) goes from 0 to 1, V(1) and V(3) go "
        f"{'strictly monotonically ' if all(holds) else ''}{'; '.join(parts)}.",
    )


@criterion("A.2-case-1", by_policy)
def different_states(table: pd.DataFrame) -> Finding:
    """With task 2a, which lacks state 3."""
    return _opposed(table, "a", not table[table.second == "a"].same_states.any())


@criterion("A.2-case-2", by_policy)
def not_ergodic(table: pd.DataFrame) -> Finding:
    """With task 2b, of which state 3 is cut off."""
    own = table[table.second == "b"]
    return _opposed(table, "b", own.same_states.all() and not own.ergodic_2.any())


@criterion("A.2-case-3", by_policy)
def uniform_weights(table: pd.DataFrame) -> Finding:
    """With task 2c, which is ergodic."""
    own = table[table.second == "c"]
    return _opposed(table, "c", own.same_states.all() and own.ergodic_2.all())


@effect_of("A.2-weights", by_policy)
def other_weights(table: pd.DataFrame) -> str:
    """Whether the conflicts survive occupancy weights."""
    last = table[table.p_b == 1].set_index(["second", "discount", "state", "weighting"]).value
    wide = last.unstack(["weighting", "state"])
    both = (wide["occupancy", 1] > 0) & (wide["occupancy", 3] < 0)
    gap = (wide["occupancy"] - wide["uniform"]).abs().groupby("second").max().max(axis=1)
    return (
        f"With the stationary distribution as p(s|m) the conflict remains in {both.sum()} of "
        f"{len(both)} combinations of domain and discount; values change by at most "
        + ", ".join(f"{g if g > EXACT else 0:.2g} with task 2{s}" for s, g in gap.items())
        + "."
    )


def conflicts(table: pd.DataFrame, weighting: Weighting) -> str:
    """In how many of the domains and discounts every step of p(B) helps 1 and harms 3."""
    wide = table[table.weighting == weighting].pivot(
        index=["second", "discount"], columns=["state", "p_b"], values="value"
    )
    up, down = (wide[s].diff(axis=1).iloc[:, 1:] for s in (1, 3))
    held = (up > 0).all(axis=1) & (down < 0).all(axis=1)
    return f"{held.sum()} of {len(held)}"


def figure(table: pd.DataFrame, discount: float) -> Figure:
    """Values over p(B) in the three domains, with uniform p(s|m)."""
    at = table[np.isclose(table.discount, discount) & (table.weighting == "uniform")]
    figure, axes = plt.subplots(1, 3, sharey=True, figsize=(7.2, 3.2))
    for ax, (second, group) in zip(axes, at.groupby("second"), strict=True):
        over_policies(ax, group, "value")
        ax.set(title=f"tasks 1 and 2{second}", xlabel=CHANCE, xticks=[0, 0.5, 1])
        ax.axhline(0, color="0.4", lw=0.8)
    axes[0].set_ylabel("domain value [reward]")
    axes[2].legend()
    return figure


def slopes(
    table: pd.DataFrame, discount: float, by_hand: Callable[[str, float], FloatArray]
) -> pd.DataFrame:
    """Values of the policy that always takes B, by hand and solved, a row for each task 2.

    Parameters
    ----------
    table
        Of ``figure-a.2``.
    discount
        gamma, one of the table's.
    by_hand
        Maps a variation of task 2 and gamma to the three values.
    """
    at = table[np.isclose(table.discount, discount) & (table.weighting == "uniform")]
    records = []
    for second, group in at[at.p_b == 1].groupby("second"):
        record: dict[str, object] = {"task 2": f"2{second}"}
        for s, solved, hand in zip(
            group.state, group.value, by_hand(str(second), discount), strict=True
        ):
            record |= {f"$k({s})$": hand, f"solved {s}": solved}
        records.append(record)
    return pd.DataFrame(records)
