"""Figures of appendix A, from its domains and the tidy tables of its experiments."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from thesis_lib.arrays import FloatArray
from thesis_lib.book.drawings import FOUR, THREE, TWO, action_legend, draw_chain
from thesis_lib.domains import Domain, figure_a1, figure_a2, figure_a3
from thesis_lib.edition.plots import COLOURS, PRINTED
from thesis_lib.mdp.model import TabularMDP

POLICIES = (0.0, 0.25, 0.5, 0.95, 1.0)
"""p(B) of the five policies in our figure A.3c."""

#: Lines of the states differ in dash as well as in colour.
LINES: dict[int, dict[str, Any]] = {
    state: {"color": colour, "linestyle": dash, "label": f"state {state}"}
    for state, colour, dash in zip(
        (1, 2, 3, 4), COLOURS, ("-", "--", "-.", (0, (1, 1))), strict=False
    )
}
MARKERS = "oDs^v"

CHANCE = r"$p(\mathrm{B})$"
STATEMENTS = ["first_step", "state_4_rises", "state_3_falls", "state_2_turns"]


def _tasks(domain: Domain) -> list[TabularMDP]:
    return [task for task in domain.tasks if isinstance(task, TabularMDP)]


def domain_1() -> Figure:
    """Figure A.1: the two tasks of fact 1, with R = 1."""
    figure, axes = plt.subplots(1, 2, figsize=(7.2, 2.4))
    for m, (ax, task) in enumerate(zip(axes, _tasks(figure_a1()), strict=True), start=1):
        draw_chain(task, TWO, title=f"task {m}", ax=ax)
        action_legend(ax)
    return figure


def domain_2() -> Figure:
    """Figure A.2: task 1 and the three variations of task 2, with x = 1."""
    figure, axes = plt.subplots(2, 2, figsize=(7.2, 6.4))
    draw_chain(_tasks(figure_a2())[0], THREE, title="task 1", ax=axes[0, 0])
    places = {"a": THREE[:2], "b": THREE, "c": THREE}
    for ax, (second, at) in zip(axes.flat[1:], places.items(), strict=True):
        task = _tasks(figure_a2(second))[1]  # type: ignore[arg-type]
        draw_chain(task, at, title=f"task 2{second}", ax=ax)
    for ax in axes[1]:
        action_legend(ax)
    return figure


def domain_3() -> Figure:
    """Figures A.3a and A.3b: the two tasks of fact 2, case 4."""
    figure, axes = plt.subplots(1, 2, figsize=(7.2, 4.0))
    for m, (ax, task) in enumerate(zip(axes, _tasks(figure_a3()), strict=True), start=1):
        draw_chain(task, FOUR, title=f"task {m}", ax=ax)
        action_legend(ax)
    return figure


def fact_1(table: pd.DataFrame, discount: float) -> Figure:
    """Value of state 1 over p(B) at one discount (left), and the ratio over discounts."""
    figure, (left, right) = plt.subplots(1, 2)
    at = table[np.isclose(table.discount, discount)]
    left.plot(at.p_b, at.task_1, color=COLOURS[0], ls="--", label="task 1")
    left.plot(at.p_b, at.task_2, color=COLOURS[1], ls="-.", label="task 2")
    left.plot(at.p_b, at.value, color="k", lw=2.4, label="domain")
    coin = at[np.isclose(at.p_b, 0.5)]
    left.plot(coin.p_b, coin.value, "o", color="k", ms=7)
    left.set(xlabel=CHANCE, ylabel="value of state 1 [reward]", title=f"$\\gamma$ = {discount:g}")
    left.legend(loc="lower center")
    values = table.set_index(["discount", "p_b"]).value.unstack()
    gamma = values.index.to_numpy()
    solved = values[[0.0, 1.0]].max(axis=1) / values.max(axis=1)
    line = 1 - np.geomspace(1 - gamma.min(), 1 - gamma.max(), 50)
    right.loglog(1 - line, (2 - line) / (2 - 2 * line), color="0.5", label="formula")
    right.loglog(1 - gamma, solved, "o", color="k", label="solved")
    right.set(xlabel=r"$1 - \gamma$", ylabel="cost of the best deterministic\npolicy / of the coin")
    right.invert_xaxis()
    right.legend()
    return figure


def fact_2(table: pd.DataFrame, discount: float) -> Figure:
    """Values over p(B) in the three domains of figure A.2, with uniform p(s|m)."""
    at = table[np.isclose(table.discount, discount) & (table.weighting == "uniform")]
    figure, axes = plt.subplots(1, 3, sharey=True, figsize=(7.2, 3.2))
    for ax, (second, group) in zip(axes, at.groupby("second"), strict=True):
        _over_policies(ax, group, "value")
        ax.set(title=f"tasks 1 and 2{second}", xlabel=CHANCE, xticks=[0, 0.5, 1])
        ax.axhline(0, color="0.4", lw=0.8)
    axes[0].set_ylabel("domain value [reward]")
    axes[2].legend()
    return figure


def _over_policies(ax: Axes, table: pd.DataFrame, column: str) -> None:
    """A line for each state over p(B)."""
    for state, rows in table.groupby("state"):
        ax.plot(rows.p_b, rows[column], **LINES[int(str(state))])


def values(table: pd.DataFrame) -> Figure:
    """Figure A.3c: five policies state by state, and every policy."""
    figure, (left, right) = plt.subplots(1, 2, sharey=True, figsize=(7.2, 3.8))
    chances = np.unique(table.p_b)
    for p, colour, marker in zip(POLICIES, COLOURS, MARKERS, strict=False):
        near = chances[abs(chances - p).argmin()]
        rows = table[table.p_b == near]
        left.plot(rows.state, rows.value, marker=marker, color=colour, label=f"{near:g}")
    left.set(xlabel="state", ylabel="domain value [reward]", xticks=[1, 2, 3, 4])
    left.legend(title=CHANCE, ncols=3, loc="upper left")
    left.set_ylim(top=1.9 * table.value.max())  # room for the legend above the lines
    _over_policies(right, table, "value")
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
        _over_policies(ax, table, column)
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


def other_numbers(table: pd.DataFrame, discount: float) -> Figure:
    """Where V(2) turns positive for other gains and detours; crosses where a statement fails."""
    at = table[np.isclose(table.discount, discount)]
    every = at[STATEMENTS].all(axis=1)
    crossing = at.assign(crossing=at.crossing.where(every))
    grid = crossing.pivot(index="detour", columns="gain", values="crossing")
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


def steps(table: pd.DataFrame) -> pd.DataFrame:
    """How each state's value moves with p(B) in figure A.3, and the best p(B)."""
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
