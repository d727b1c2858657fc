"""Figures and tables of chapter 3, from the tidy tables of its experiments."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import stats

from thesis_lib.arrays import FloatArray
from thesis_lib.domains import Domain
from thesis_lib.edition.plots import COLOURS, PRINTED
from thesis_lib.experiments.chapter3.common import SYMBOLS

LEARNERS = {
    "q_learning": "Q-learning",
    "sarsa": "Sarsa",
    "expected_sarsa": "Expected Sarsa",
    "double_q_learning": "Double Q-learning",
}
COLOUR = {
    "none": "#7f7f7f",
    "Q_star": COLOURS[0],
    "Q_tilde": COLOURS[1],
    "Q_tilde_sarsa": COLOURS[4],
    "Q_mu": COLOURS[2],
    "constant": COLOURS[3],
}
DASH = {"none": ":", "constant": "--"}


def theorem_1(table: pd.DataFrame, tolerance: float) -> Figure:
    """Sweeps measured (dots) and sufficient by the bound (bars' ends), by initialisation."""
    at = table[table.tolerance == tolerance]
    domains = list(dict.fromkeys(at.domain))
    names = list(dict.fromkeys(at.initialisation))
    fig, axes = plt.subplots(1, len(domains), sharey=True, figsize=(7.2, 3.6), squeeze=False)
    for ax, domain in zip(axes[0], domains, strict=True):
        own = at[at.domain == domain].set_index("initialisation")
        y = np.arange(len(names))[::-1]
        ax.barh(y, own.bound[names], color="#d9d9d9", height=0.6, label="bound")
        ax.plot(own.sweeps[names], y, "o", color=COLOURS[0], label="measured")
        ax.set_title(
            domain.replace(" with ", "\nwith ").replace("episodic ", "episodic\n"), fontsize=9
        )
        ax.set_yticks(y, [n.replace("Q_star", r"$Q^*_d$") for n in names])
        ax.tick_params(labelsize=8)
        ax.set_xlim(left=-0.5)
    fig.supxlabel("sweeps of value iteration", fontsize=10)
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper right", ncols=2)
    return fig


def value_maps(domain: Domain, potentials: Mapping[str, FloatArray]) -> Figure:
    """State values, the best action's, of potentials on the cliff's grid, one map each."""
    fig, axes = plt.subplots(1, len(potentials), figsize=(7.2, 2.4), squeeze=False)
    for ax, (name, phi) in zip(axes[0], potentials.items(), strict=True):
        grid = np.full((4, 4), np.nan)
        x, y = domain.observations[:, 0], domain.observations[:, 1]
        grid[y, x] = phi.max(axis=1)
        picture = ax.imshow(grid, origin="lower")
        ax.set(title=SYMBOLS[name], xticks=range(4), yticks=range(4), xlabel="x")
        ax.grid(False)
        fig.colorbar(picture, ax=ax, shrink=0.8).ax.tick_params(labelsize=7)
    axes[0, 0].set_ylabel("y")
    return fig


def fit_curves(table: pd.DataFrame, stated: int) -> Figure:
    """Chi-square of every reading over the number of episodes."""
    fig, ax = plt.subplots()
    for i, (name, group) in enumerate(table.groupby("reading", sort=False)):
        ax.semilogy(group.episodes, group.chi2, label=name, lw=2.4 if i == 0 else 1.2)
    dof = int(table.dof.iloc[0])
    ax.axhspan(*stats.chi2.ppf([0.025, 0.975], dof), color="#d9d9d9", label="95% if it is right")
    ax.axvline(stated, color=PRINTED, ls=":", label="as the text says")
    low = max(1.0, float(table.chi2.min()) / 2)
    ax.set(xlabel="episodes a run", ylabel=f"chi-square, {dof} entries", ylim=(low, None))
    fig.legend(fontsize=8, loc="outside lower center", ncols=2)
    return fig


def differences_from_printed(table: pd.DataFrame) -> Figure:
    """Ours less the printed mean of each entry, with both intervals."""
    rows = table.dropna(subset=["printed_mean"])
    rows = rows[rows.potential != "Q_mu"]
    fig, ax = plt.subplots(figsize=(7.2, 3.8))
    y = np.arange(len(rows))[::-1]
    ax.errorbar(
        np.zeros(len(rows)),
        y - 0.15,
        xerr=rows.printed_ci95,
        fmt="D",
        color=PRINTED,
        ms=4,
        capsize=2,
        label="thesis",
    )
    ax.errorbar(
        rows["mean"] - rows.printed_mean,
        y + 0.15,
        xerr=rows.ci95,
        fmt="o",
        color=COLOURS[0],
        ms=5,
        capsize=2,
        label="ours",
    )
    labels = [
        f"{LEARNERS[r.algorithm]}, {SYMBOLS[r.potential]}{', sensor' if r.sensor else ''}"
        for r in rows.itertuples()
    ]
    ax.set_yticks(y, labels, fontsize=8)
    ax.set_xlabel(r"difference from the printed mean [$10^4$]")
    ax.legend()
    return fig


def printed_beside_ours(table: pd.DataFrame, sensor: bool) -> pd.DataFrame:
    """One part of Table 3.1 as text: ours and the thesis's, mean ± half-width."""
    own = table[table.sensor == sensor]
    records = []
    for name in dict.fromkeys(own.potential):
        record: dict[str, str] = {"potential": SYMBOLS[name]}
        for row in own[own.potential == name].itertuples():
            learner = LEARNERS[row.algorithm]
            record[f"{learner}, ours"] = f"{row.mean_:.2f} ± {row.ci95:.2f}"
            if hasattr(row, "printed_mean"):
                record[f"{learner}, thesis"] = (
                    "–"
                    if np.isnan(row.printed_mean)
                    else f"{row.printed_mean:g} ± {row.printed_ci95:g}"
                )
        records.append(record)
    return pd.DataFrame(records)


def renamed(table: pd.DataFrame) -> pd.DataFrame:
    """The table with ``mean`` called ``mean_``, which rows of pandas can be asked for."""
    return table.rename(columns={"mean": "mean_"})


def over_alpha(
    ax: Axes, table: pd.DataFrame, *, log: bool = False, names: Iterable[str] | None = None
) -> None:
    """Mean return over the learning rate with 95% bands, one line a potential."""
    for name in names or dict.fromkeys(table.potential):
        own = table[table.potential == name].sort_values("alpha")
        if not len(own):
            continue
        ax.plot(
            own.alpha,
            own["mean"],
            marker="o",
            ms=3,
            label=SYMBOLS[name],
            color=COLOUR[name],
            ls=DASH.get(name, "-"),
        )
        ax.fill_between(
            own.alpha,
            own["mean"] - own.ci95,
            own["mean"] + own.ci95,
            color=COLOUR[name],
            alpha=0.2,
            lw=0,
        )
    if log:
        ax.set_xscale("log")
    ax.set_xlabel(r"learning rate $\alpha$")


def figure_3_1(table: pd.DataFrame) -> Figure:
    """Return over learning rate on the continuing cliff, a row a discount, a column a learner."""
    discounts = sorted(table.discount.unique())
    methods = list(dict.fromkeys(table.algorithm))
    fig, axes = plt.subplots(
        len(discounts),
        len(methods),
        figsize=(7.2, 0.8 + 2.1 * len(discounts)),
        sharex=True,
        sharey=True,
        squeeze=False,
    )
    for row, discount in zip(axes, discounts, strict=True):
        for ax, method in zip(row, methods, strict=True):
            own = table[(table.discount == discount) & (table.algorithm == method)]
            scaled = own.assign(**{"mean": own["mean"] / 1e4, "ci95": own.ci95 / 1e4})
            over_alpha(ax, scaled, log=True)
            ax.set_title(rf"{LEARNERS[method]}, $\gamma = {discount:g}$", fontsize=10)
            if ax not in axes[-1]:
                ax.set_xlabel("")
    for row in axes:
        row[0].set_ylabel(r"return [$10^4$]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=3)
    return fig


def figure_3_2(mean: pd.DataFrame, runs: pd.DataFrame) -> Figure:
    """Mean cumulative reward, and single runs with their TD errors below."""
    names = list(dict.fromkeys(mean.potential))
    fig, axes = plt.subplots(3, len(names), figsize=(7.2, 5.6), sharex=True, squeeze=False)
    for column, name in zip(axes.T, names, strict=True):
        curve, single = mean[mean.potential == name], runs[runs.potential == name]
        top, middle, bottom = column
        top.plot(curve.step, curve["mean"] / 1e3, color=COLOUR[name])
        low, high = curve["mean"] - curve.ci95, curve["mean"] + curve.ci95
        top.fill_between(curve.step, low / 1e3, high / 1e3, color=COLOUR[name], alpha=0.2, lw=0)
        top.set_title(SYMBOLS[name], fontsize=10)
        middle.plot(single.step, single.cumulative_reward / 1e3, color="k", lw=1)
        bottom.semilogy(single.step, single.largest_td_error.clip(lower=1e-3), color="k", lw=0.8)
        bottom.ticklabel_format(axis="x", style="sci", scilimits=(3, 3))
        bottom.set_xlabel("step")
    for row, label in zip(
        axes,
        (
            "mean cumulative\nreward [$10^3$]",
            "one run: cumul.\nreward [$10^3$]",
            "one run: largest\n|TD error|",
        ),
        strict=True,
    ):
        row[0].set_ylabel(label, fontsize=9)
        limits = [ax.get_ylim() for ax in row]
        for ax in row:
            ax.set_ylim(min(a for a, _ in limits), max(b for _, b in limits))
            ax.tick_params(labelsize=8)
    return fig


def early_boost(mean: pd.DataFrame) -> Figure:
    """Mean cumulative reward of every potential in one picture, steps on a logarithmic axis."""
    fig, ax = plt.subplots()
    for name in dict.fromkeys(mean.potential):
        own = mean[mean.potential == name]
        ax.plot(
            own.step, own["mean"], color=COLOUR[name], label=SYMBOLS[name], ls=DASH.get(name, "-")
        )
        ax.fill_between(
            own.step,
            own["mean"] - own.ci95,
            own["mean"] + own.ci95,
            color=COLOUR[name],
            alpha=0.2,
            lw=0,
        )
    ax.set(xscale="log", xlabel="step", ylabel="mean cumulative reward")
    ax.axvline(1e4, color=PRINTED, ls=":", label="end of the boost, as printed")
    ax.legend(fontsize=8)
    return fig


def scaling(table: pd.DataFrame) -> Figure:
    """Return over the scale factor, one panel a domain and learner."""
    keys = list(dict.fromkeys(zip(table.domain, table.algorithm, strict=True)))
    columns = min(2, len(keys))
    n_rows = -(-len(keys) // columns)
    fig, axes = plt.subplots(
        n_rows, columns, figsize=(7.2, 0.7 + 1.9 * n_rows), squeeze=False, sharex=True
    )
    for ax, (domain, method) in zip(axes.flat, keys, strict=False):
        for name in dict.fromkeys(table.potential):
            own = table[
                (table.domain == domain) & (table.algorithm == method) & (table.potential == name)
            ]
            ax.plot(
                own.factor,
                own["mean"],
                marker="o",
                ms=3,
                color=COLOUR[name],
                label=SYMBOLS[name],
                ls=DASH.get(name, "-"),
            )
            ax.fill_between(
                own.factor,
                own["mean"] - own.ci95,
                own["mean"] + own.ci95,
                color=COLOUR[name],
                alpha=0.2,
                lw=0,
            )
        ax.axvline(1, color=PRINTED, ls=":", lw=1)
        ax.set_title(f"{domain}, {LEARNERS[method]}", fontsize=9)
        ax.tick_params(labelsize=8)
    for ax in axes.flat[len(keys) :]:
        ax.axis("off")
    for ax in axes[-1]:
        ax.set_xlabel("factor", fontsize=9)
    fig.supylabel("total reward", fontsize=10)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=4)
    return fig


def best_factors(table: pd.DataFrame) -> pd.DataFrame:
    """Best factor of each potential, with the return there, at 1, and with a derived factor."""
    keys = ["domain", "algorithm", "potential"]
    best = table.loc[table.groupby(keys, sort=False)["mean"].idxmax()].set_index(keys)
    at_one = table[table.factor == 1].set_index(keys)["mean"].reindex(best.index)
    shown = best[["factor"]].assign(at_best=best["mean"], at_one=at_one, derived=best.derived_mean)
    shown = shown.reset_index()
    shown["learner"] = shown.pop("algorithm").map(LEARNERS)
    shown["potential"] = shown.potential.map(SYMBOLS)
    return shown[["domain", "learner", "potential", "factor", "at_best", "at_one", "derived"]]


def two_values(table: pd.DataFrame) -> Figure:
    """Error of the potentials learned on the side, and the return they give."""
    domains = list(dict.fromkeys(table.domain))
    fig, axes = plt.subplots(1, 2, figsize=(7.2, 3.4))
    for i, domain in enumerate(domains):
        for name, style in (("Q_star", ":"), ("Q_tilde", "-")):
            own = table[(table.domain == domain) & (table.potential == name)]
            axes[0].loglog(
                own.steps,
                own.relative_error,
                style,
                marker="o",
                ms=3,
                color=COLOURS[i],
                label=domain if name == "Q_tilde" else None,
            )
            if name == "Q_tilde":
                gain = (own["mean"] - own.exact_mean) / own.exact_mean.abs()
                error = np.hypot(own.ci95, own.exact_ci95) / own.exact_mean.abs()
                axes[1].errorbar(
                    own.steps, gain, yerr=error, marker="o", ms=3, capsize=2, color=COLOURS[i]
                )
    axes[0].set(xlabel="steps a source task", ylabel="mean error / spread of $\\tilde Q_d$")
    axes[1].set(
        xscale="log", xlabel="steps a source task", ylabel="relative return, learned − exact"
    )
    axes[1].axhline(0, color=PRINTED, lw=1)
    fig.legend(loc="outside lower center", ncols=3, fontsize=8)
    return fig


def interval(mean: float, half_width: float) -> str:
    """Mean ± half-width as text, with as many digits as the half-width is worth."""
    digits = max(0, 1 - int(np.floor(np.log10(half_width)))) if half_width > 0 else 2
    return f"{mean:,.{digits}f} ± {half_width:,.{digits}f}"


def mu_star(table: pd.DataFrame) -> pd.DataFrame:
    """What each search for the cross-task policy reaches, one row a domain and objective."""
    wide = table.pivot(index=["domain", "objective"], columns="method", values="value")
    wide = wide.reindex(columns=["uniform", "ga", "gradient"])
    order = dict.fromkeys(zip(table.domain, table.objective, strict=True))
    gap = (wide["gradient"] - wide["ga"]) / wide["gradient"].abs()
    shown = wide.map(
        lambda v: f"{v:,.0f}" if abs(v) >= 1000 else f"{v:.4g}" if abs(v) > 1e-9 else "0"
    )
    shown["gap"] = gap.map(lambda v: f"{v:.1%}")
    shown.columns = ["uniform", "GA (footnote 2)", "exact gradients", "GA below by"]
    return shown.reindex(list(order)).reset_index()
