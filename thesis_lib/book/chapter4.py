"""Figures of chapter 4, from the tidy tables of its experiments."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator, NullLocator

from thesis_lib.edition.plots import COLOURS, PRINTED
from thesis_lib.experiments.chapter4.functions import SYMBOLS as FUNCTIONS
from thesis_lib.experiments.chapter4.protocol import SYMBOLS
from thesis_lib.experiments.chapter4.task_relevance import SYMBOLS as TABLES

COLOUR = {
    "fs-tek": COLOURS[0],
    "fs-tek schedule": COLOURS[5],
    "ibkr": COLOURS[1],
    "jackknife": COLOURS[2],
    "jackknife box": COLOURS[4],
    "fixed": COLOURS[7],
    "random": COLOURS[4],
    "none": "#7f7f7f",
    "constant": COLOURS[3],
}
PM = "\u00a0± "
"""Between a number and its half-width: a narrow cell breaks after the sign, not before."""

DASH = {"none": ":", "constant": "--", "fixed": "-.", "random": ":"}
MARKER = {"fs-tek": "o", "ibkr": "s", "jackknife": "^", "fs-tek schedule": "v"}
FEATURES = {
    "a": "action $a$",
    "x1": "state $x_1$",
    "x2": "distance $x_2$",
    "x3": "colour $x_3$",
}
KINDS = {
    "shared": "shared p(x|m)",
    "subsets": "uniform on subsets",
    "weights": "any weights",
}


def figure_4_1(table: pd.DataFrame) -> Figure:
    """k-relevance of single features, forward and backward, with the law through k = 1."""
    fig, axes = plt.subplots(1, 2, figsize=(7.2, 3.4))
    for ax, direction in zip(axes, ("forward", "backward"), strict=True):
        own = table[table.direction == direction]
        for i, (feature, curve) in enumerate(own.groupby("feature")):
            ax.plot(
                curve.k,
                curve.relevance,
                marker="o",
                ms=3,
                color=COLOURS[i],
                label=FEATURES.get(str(feature), str(feature)),
            )
        ax.set(xlabel="sequence length k", title=direction, ylim=(-0.2, None))
    axes[0].set_ylabel("k-relevance [squared reward]")
    fig.legend(*axes[0].get_legend_handles_labels(), ncols=4, loc="outside lower center")
    return fig


def figure_4_2(table: pd.DataFrame, bold: Sequence[str]) -> Figure:
    """Areas of the sequences for each k, and the covariance matrices of some of them."""
    lengths = sorted(table.k.unique())
    fig, axes = plt.subplots(1, len(lengths) + 1, figsize=(7.2, 3.2))
    limit = float(table.covariance.abs().max())
    colours = plt.get_cmap("RdBu_r")
    for ax, k in zip(axes, lengths, strict=False):
        own = table[table.k == k].drop_duplicates("sequence").set_index("sequence")
        _areas(ax, own.probability.to_dict(), own.relevance.to_dict(), limit, bold)
        ax.set_title(f"k = {k}", fontsize=10)
    _matrices(axes[-1], table, [c for c in bold if c in set(table.sequence)], limit)
    shade = plt.cm.ScalarMappable(plt.Normalize(-limit, limit), colours)
    fig.colorbar(shade, ax=axes, shrink=0.7, label="covariance, relevance").ax.tick_params(
        labelsize=7
    )
    return fig


def _areas(
    ax: Axes,
    probability: dict[str, float],
    relevance: dict[str, float],
    limit: float,
    bold: Sequence[str],
) -> None:
    colours = plt.get_cmap("RdBu_r")
    share = {c: p for c, p in probability.items() if len(c) == len(next(iter(probability)))}

    def split(prefix: str, x: float, y: float, w: float, h: float) -> None:
        if prefix in share:
            value = 0.5 + 0.5 * relevance[prefix] / limit
            edge = 2.0 if prefix in bold else 0.4
            ax.add_patch(Rectangle((x, y), w, h, fc=colours(value), ec="k", lw=edge))
            if len(prefix) < 3:
                ink = "w" if abs(value - 0.5) > 0.3 else "k"
                ax.text(
                    x + w / 2, y + h / 2, prefix, ha="center", va="center", fontsize=6, color=ink
                )
            return
        mass = {m: sum(p for c, p in share.items() if c.startswith(prefix + m)) for m in "123"}
        total = sum(mass.values())
        at = x if len(prefix) % 2 == 0 else y
        for m, part in mass.items():
            size = part / total
            if len(prefix) % 2 == 0:
                split(prefix + m, at, y, w * size, h)
                at += w * size
            else:
                split(prefix + m, x, at, w, h * size)
                at += h * size

    split("", 0.0, 0.0, 1.0, 1.0)
    ax.set(xlim=(0, 1), ylim=(1, 0), xticks=[], yticks=[], aspect="equal")
    ax.grid(False)
    for side in ax.spines.values():
        side.set_visible(True)


def _matrices(ax: Axes, table: pd.DataFrame, sequences: Sequence[str], limit: float) -> None:
    colours = plt.get_cmap("RdBu_r")
    y = 0.0
    for c in sequences:
        own = table[table.sequence == c]
        for row in own.itertuples():
            value = 0.5 + 0.5 * row.covariance / limit
            ax.add_patch(
                Rectangle((row.j - 1, y + row.i - 1), 1, 1, fc=colours(value), ec="k", lw=0.4)
            )
        ax.text(len(c) + 0.2, y + len(c) / 2, f"({', '.join(c)})", va="center", fontsize=7)
        y += len(c) + 0.6
    ax.set(xlim=(0, 5.5), ylim=(max(y, 1.0), 0), xticks=[], yticks=[], aspect="equal")
    ax.set_title("matrices", fontsize=10)
    ax.grid(False)
    for side in ax.spines.values():
        side.set_visible(False)


def ratio_of_steps(table: pd.DataFrame) -> Figure:
    """Distance from the limit over k, and what is left of it after the 1/k term."""
    fig, axes = plt.subplots(1, 2, figsize=(7.2, 3.2), sharex=True)
    for i, (kind, own) in enumerate(table.groupby("kind", sort=False)):
        axes[0].loglog(
            own.k, own.mean_distance, "o-", ms=3, color=COLOURS[i], label=KINDS[str(kind)]
        )
        axes[1].loglog(own.k, own.mean_rest.clip(lower=1e-17), "o-", ms=3, color=COLOURS[i])
    axes[0].set(xlabel="k", ylabel=r"mean $|\rho_k - \rho_\infty|$")
    axes[1].set(xlabel="k", ylabel=r"mean $|\rho_k - \rho_\infty - c/k|$")
    fig.legend(loc="outside lower center", ncols=3, fontsize=8)
    return fig


def exponential_misfit(
    curve: Sequence[float], fitted: Sequence[float], k: Sequence[float]
) -> Figure:
    """The curve 1/k at the numbers of tasks, and the exponential fitted to it, far beyond."""
    fig, ax = plt.subplots(figsize=(7.2, 3.0))
    ax.plot(np.arange(1, len(curve) + 1), curve, "o", color=COLOURS[0], label="D(k) = 1/k")
    ax.plot(k, fitted, color=COLOURS[1], label="fitted exponential")
    ax.plot(k, 1 / np.asarray(k), ":", color=COLOURS[0], label="the law")
    ax.axhline(0, color=PRINTED, lw=1, label="true limit")
    ax.set(xlabel="k", ylabel="relevance / (b - U)", xlim=(0.5, max(k)))
    ax.legend(fontsize=8)
    return fig


def threshold(table: pd.DataFrame) -> Figure:
    """FS-TEK's threshold on the F-ratio over the number of tasks, by level."""
    fig, ax = plt.subplots(figsize=(7.2, 3.4))
    for i, (alpha, own) in enumerate(table.groupby("alpha")):
        ax.plot(
            own.tasks_seen, own.threshold, "o-", ms=3, color=COLOURS[i], label=rf"FS-TEK, {alpha:g}"
        )
    one = table.drop_duplicates("tasks_seen")
    ax.plot(one.tasks_seen, one.calibrated, "--", color=PRINTED, label="jackknife F, 5%")
    ax.axhline(0, color="#7f7f7f", lw=1)
    ax.axhline(1, color="#7f7f7f", lw=1, ls=":")
    ax.set(
        xlabel="observed tasks n",
        ylabel="largest F-ratio removed",
        yscale="symlog",
        ylim=(-1, 200),
    )
    ax.legend(fontsize=8, ncols=2)
    return fig


def returns(ax: Axes, table: pd.DataFrame, methods: Iterable[str] | None = None) -> None:
    """Mean return over tasks seen with 95% bands, one line a method."""
    for method in methods or dict.fromkeys(table.method):
        own = table[table.method == method].sort_values("tasks_seen")
        colour = COLOUR[method]
        ax.plot(
            own.tasks_seen,
            own.mean_return,
            color=colour,
            ls=DASH.get(method, "-"),
            label=SYMBOLS[method],
            lw=1.6,
        )
        ax.fill_between(
            own.tasks_seen,
            own.mean_return - own.ci95,
            own.mean_return + own.ci95,
            color=colour,
            alpha=0.15,
            lw=0,
        )
    ax.set_xlabel("tasks seen")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))


def roc(
    ax: Axes,
    table: pd.DataFrame,
    methods: Iterable[str] = ("fs-tek", "ibkr", "jackknife"),
    printed: tuple[float, float] | None = None,
    near: float = 0.06,
) -> None:
    """Points in ROC space, joined in the order of tasks seen, with the numbers beside them."""
    for method in methods:
        own = table[table.method == method].sort_values("tasks_seen")
        ax.plot(
            own.fpr,
            own.tpr,
            marker=MARKER.get(method, "d"),
            ms=4,
            lw=0.8,
            color=COLOUR[method],
            label=SYMBOLS[method],
        )
        _number(ax, own, COLOUR[method], BELOW if method in ("ibkr", "jackknife") else ABOVE, near)
    if printed is not None:
        ax.plot(*printed, "D", color=PRINTED, ms=6, label="thesis, 5 tasks", ls="none")
    ax.set(
        xlabel="false positive rate",
        ylabel="true positive rate",
        xlim=(-0.04, 1.06),
        ylim=(-0.04, 1.08),
    )


ABOVE, BELOW = (1.0, 3.5), (1.0, -8.5)
"""Where numbers stand beside a marker, in points."""


def _number(
    ax: Axes, own: pd.DataFrame, colour: str, offset: tuple[float, float], near: float
) -> None:
    """Write the tasks seen beside the points; runs of points in one place get one label."""
    points = list(zip(own.fpr, own.tpr, own.tasks_seen, strict=True))
    while points:
        x, y, first = points[0]
        same = [n for u, v, n in points if abs(u - x) < near and abs(v - y) < near]
        # Points that follow one another only: a path that comes back is told again.
        count = next(
            (i for i, (*_, n) in enumerate(points) if i >= len(same) or n != same[i]), len(points)
        )
        last = points[count - 1][2]
        text = str(first) if count == 1 else f"{first}–{last}"
        ax.annotate(
            text, (x, y), xytext=offset, textcoords="offset points", fontsize=6, color=colour
        )
        points = points[count:]


def selection(
    table: pd.DataFrame, *, unit: float = 1.0, printed: tuple[float, float] | None = None
) -> Figure:
    """A figure as 4.3 to 4.5: returns on the left, ROC space on the right."""
    fig, axes = plt.subplots(1, 2, figsize=(7.2, 3.8))
    scaled = table.assign(mean_return=table.mean_return / unit, ci95=table.ci95 / unit)
    returns(axes[0], scaled)
    axes[0].set_ylabel("mean return" + (f" / {unit:g}" if unit != 1 else ""))
    roc(axes[1], table, printed=printed)
    handles, labels = axes[0].get_legend_handles_labels()
    if printed is not None:
        extra = axes[1].get_legend_handles_labels()
        handles, labels = [*handles, extra[0][-1]], [*labels, extra[1][-1]]
    fig.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8)
    return fig


def figure_4_6(table: pd.DataFrame) -> Figure:
    """Returns and ROC space on stock, one row a number of global factors."""
    sizes = sorted(table.global_factors.unique())
    fig, axes = plt.subplots(
        len(sizes), 2, figsize=(7.2, 0.8 + 1.9 * len(sizes)), sharex="col", squeeze=False
    )
    for i, (row, g) in enumerate(zip(axes, sizes, strict=True)):
        own = table[table.global_factors == g]
        returns(row[0], own)
        roc(row[1], own, near=0.12)
        row[0].set_ylabel(f"return, G = {g}", fontsize=9)
        row[1].set_ylabel("TPR", fontsize=9)
        for ax in row:
            ax.tick_params(labelsize=8)
            if i < len(sizes) - 1:
                ax.set_xlabel("")
    fig.legend(
        *axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8
    )
    return fig


def calibration(table: pd.DataFrame, alpha: float) -> Figure:
    """Size of the test on irrelevant features, and its power, over the number of tasks."""
    at = table[table.alpha == alpha]
    fig, axes = plt.subplots(1, 2, figsize=(7.2, 3.6))
    effect = at.effect.max()
    null = at[(at.feature == "irrelevant") & (at.effect == effect)]
    styles = {"t2": "-", "box": "--"}
    for j, ((law, shared, levels), own) in enumerate(null.groupby(["null", "shared", "levels"])):
        i = 2 * int(levels == null.levels.max()) + int(shared)
        axes[0].errorbar(
            # Beside one another, so that the intervals can be told apart.
            own.tasks_seen + 0.12 * (j - 3.5),
            own.kept,
            yerr=[own.kept - own.low, own.high - own.kept],
            color=COLOURS[i],
            ls=styles[str(law)],
            marker="o",
            ms=3,
            capsize=2,
            lw=1,
            label=f"{law}, {levels} values, {'shared' if shared else 'own'} p",
        )
    axes[0].axhline(alpha, color=PRINTED, lw=1)
    axes[0].set(xlabel="observed tasks n", ylabel="irrelevant feature kept", ylim=(0, None))
    power = at[(at.feature == "relevant") & at.shared & (at.null == "t2")]
    power = power[power.levels == power.levels.min()]
    for i, (size, own) in enumerate(power.groupby("effect")):
        axes[1].errorbar(
            own.tasks_seen,
            own.kept,
            yerr=[own.kept - own.low, own.high - own.kept],
            color=COLOURS[i],
            marker="o",
            ms=3,
            capsize=2,
            label=f"effect {size:g} sd",
        )
    axes[1].set(xlabel="observed tasks n", ylabel="relevant feature kept", ylim=(0, 1.05))
    axes[1].legend(fontsize=8)
    fig.legend(
        *axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=7
    )
    return fig


def roc_of_domains(table: pd.DataFrame) -> Figure:
    """ROC space of every domain, one panel each."""
    domains = list(dict.fromkeys(table.domain))
    columns = min(4, len(domains))
    n_rows = -(-len(domains) // columns)
    fig, axes = plt.subplots(
        n_rows,
        columns,
        figsize=(7.2, 0.8 + 2.0 * n_rows),
        sharex=True,
        sharey=True,
        squeeze=False,
    )
    methods = ("fs-tek", "fs-tek schedule", "ibkr", "jackknife")
    for ax, domain in zip(axes.flat, domains, strict=False):
        own = table[table.domain == domain]
        roc(ax, own, methods, near=0.15)
        ax.set_title(domain + (" (new)" if own.new.any() else ""), fontsize=8)
        ax.tick_params(labelsize=7)
        ax.set_xlabel("")
        ax.set_ylabel("")
    for ax in axes.flat[len(domains) :]:
        ax.axis("off")
    for ax in axes[-1]:
        ax.set_xlabel("false positive rate", fontsize=8)
    for row in axes:
        row[0].set_ylabel("true positive rate", fontsize=8)
    fig.legend(
        *axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8
    )
    return fig


def cost(table: pd.DataFrame, scale: pd.DataFrame) -> Figure:
    """Time of relevance over pairs, tasks, features and sequences, and of whole selections."""
    fig, axes = plt.subplots(2, 3, figsize=(7.2, 5.0))
    labels = {
        "pairs": "pairs N",
        "tasks": "tasks n",
        "features": "features P",
        "max_seqs": "max_seqs M",
    }
    for ax, (what, label) in zip(axes.flat, labels.items(), strict=False):
        own = table[table.varied == what]
        # The pairs double with every feature, so there the time is told for one.
        share = own.features if what == "pairs" else 1
        own = own.assign(seconds=own.cpu_seconds / share)
        for i, (method, curve) in enumerate(own.groupby("method")):
            ax.loglog(curve[what], curve.seconds, "o-", ms=4, color=COLOURS[i], label=str(method))
        _linear(ax, own[own.method == "algorithm 8"], what)
        if what in ("tasks", "features"):
            ax.set_xticks(sorted(own[what].unique()), sorted(own[what].unique()))
            ax.xaxis.set_minor_locator(NullLocator())
        ax.set_xlabel(label)
        ax.set_ylabel("seconds a feature" if what == "pairs" else "seconds", fontsize=9)
    ax = axes.flat[4]
    for i, (method, curve) in enumerate(scale.groupby("method")):
        ax.loglog(
            curve.pairs,
            curve.cpu_seconds,
            "s-",
            ms=4,
            color=COLOURS[2 + i],
            label=f"select: {SYMBOLS[str(method)]}",
        )
    _linear(ax, scale.assign(seconds=scale.cpu_seconds)[scale.method == "jackknife"], "pairs")
    ax.set_xlabel(f"pairs N, {int(scale.tasks.max())} tasks")
    ax.set_ylabel("seconds a selection", fontsize=9)
    axes.flat[5].axis("off")
    handles = {}
    for ax in axes.flat[:5]:
        handles.update(dict(zip(*ax.get_legend_handles_labels()[::-1], strict=True)))
        ax.tick_params(labelsize=8)
    axes.flat[5].legend(handles.values(), handles, loc="center", fontsize=8)
    return fig


def _linear(ax: Axes, curve: pd.DataFrame, what: str) -> None:
    """A line of slope 1 through the last point."""
    last = curve.sort_values(what).iloc[-1]
    x = curve[what].to_numpy(dtype=float)
    ax.loglog(x, last.seconds * x / last[what], ":", color=PRINTED, lw=1, label="slope 1")


def task_relevance(table: pd.DataFrame, tasks_seen: int) -> Figure:
    """Learning curves of new tasks after some observed ones, for the first two domains."""
    domains = list(dict.fromkeys(table.domain))[:2]
    fig, axes = plt.subplots(1, len(domains), figsize=(7.2, 3.8), squeeze=False)
    styles = ("-", "-", ":", "--", "-.")
    for ax, domain in zip(axes[0], domains, strict=True):
        at = table[(table.domain == domain) & (table.tasks_seen == tasks_seen)]
        for i, (method, own) in enumerate(at.groupby("method", sort=False)):
            colour = "#7f7f7f" if method == "full" else COLOURS[i]
            name = TABLES.get(str(method), str(method))
            ax.plot(own.step / 1000, own.reward, ls=styles[i], color=colour, lw=1.5, label=name)
            ax.fill_between(
                own.step / 1000,
                own.reward - own.ci95,
                own.reward + own.ci95,
                color=colour,
                alpha=0.15,
                lw=0,
            )
        ax.set(xlabel="steps in the new task [1000]", title=f"{domain}, n = {tasks_seen}")
    axes[0, 0].set_ylabel("reward a step")
    fig.legend(
        *axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=8
    )
    return fig


def function_law(table: pd.DataFrame, feature: str) -> Figure:
    """k-relevance of networks over 1/k, and how far every function is from the law."""
    fig, axes = plt.subplots(1, 2, figsize=(7.2, 3.6))
    nets = table[table.function == "network"]
    at = nets[(nets.feature == feature) & (nets.seed == nets.seed.min())]
    exact = table[(table.function == "table") & (table.feature == feature)]
    axes[0].plot(1 / exact.k, exact.value, "k--", lw=1, label="table, linear", zorder=4)
    for i, (hidden, own) in enumerate(at.groupby("hidden")):
        name = f"{hidden} hidden unit{'s' if hidden > 1 else ''}"
        axes[0].plot(1 / own.k, own.value, "o", ms=5, color=COLOURS[i], label=name)
        axes[0].plot(1 / own.k, own.fitted, "-", lw=1, color=COLOURS[i])
    axes[0].set(xlabel="1/k", ylabel=f"k-relevance of {feature} [squared reward]", ylim=(0, None))
    axes[0].legend(fontsize=8)
    worst = table[table.function.isin(["table", "linear", "network"])]
    worst = worst.groupby(["function", "hidden", "feature", "seed"]).misfit.max().reset_index()
    groups = [("table", 0), ("linear", 0)] + [("network", h) for h in sorted(at.hidden.unique())]
    markers = dict(zip(dict.fromkeys(worst.feature), "o^sD", strict=False))
    for x, (function, hidden) in enumerate(groups):
        for name, own in worst[(worst.function == function) & (worst.hidden == hidden)].groupby(
            "feature"
        ):
            axes[1].semilogy(
                np.full(len(own), x) + (0.12 if name == feature else -0.12),
                own.misfit.clip(lower=1e-17),
                markers[name],
                ms=5,
                color=COLOURS[list(markers).index(str(name))],
                label=f"without {name}" if x == 0 else None,
            )
    labels = [f if not h else f"network,\n{h}" for f, h in groups]
    axes[1].set_xticks(range(len(groups)), labels, fontsize=8)
    axes[1].set(ylabel=r"largest misfit of $a + b/k$ / $\rho_1$")
    axes[1].legend(fontsize=8)
    return fig


def function_roc(table: pd.DataFrame) -> Figure:
    """ROC space of selectors that see different functions, one panel a domain."""
    domains = list(dict.fromkeys(table.domain))
    fig, axes = plt.subplots(
        1, len(domains), figsize=(7.2, 3.4), sharex=True, sharey=True, squeeze=False
    )
    handles = {}
    for ax, domain in zip(axes[0], domains, strict=True):
        for i, method in enumerate(("table", "linear", "network", "linear, more pairs")):
            own = table[(table.domain == domain) & (table.method == method)]
            own = own.sort_values("tasks_seen")
            (line,) = ax.plot(
                own.fpr, own.tpr, marker="os^v"[i], ms=5, lw=0.8, color=COLOURS[i], alpha=0.85
            )
            handles[FUNCTIONS[method]] = line
            for row in own.itertuples():
                ax.annotate(
                    str(row.tasks_seen),
                    (row.fpr, row.tpr),
                    xytext=(4 if i % 2 else -4, -9 if i < 2 else 4),
                    textcoords="offset points",
                    ha="left" if i % 2 else "right",
                    fontsize=7,
                    color=COLOURS[i],
                )
        ax.set(xlabel="false positive rate", xlim=(-0.06, 0.3), ylim=(-0.04, 1.08))
        ax.set_title(domain, fontsize=9)
        ax.xaxis.set_major_locator(MaxNLocator(3))
    axes[0, 0].set_ylabel("true positive rate")
    fig.legend(handles.values(), handles, loc="outside lower center", ncols=4, fontsize=8)
    return fig


def task_table(table: pd.DataFrame) -> pd.DataFrame:
    """What the task-relevant table saves and costs, one row a domain and number of tasks."""
    once = table.drop_duplicates(["domain", "tasks_seen", "method"])
    out = []
    for domain, n in dict.fromkeys(zip(table.domain, table.tasks_seen, strict=True)):
        own = once[(once.domain == domain) & (once.tasks_seen == n)].set_index("method")
        small = own.loc["table"]
        out.append(
            {
                "domain": domain,
                "n": n,
                "entries": f"{small.pairs:.0f} of {own.pairs['full']:.0f}",
                "faster by": _factor(small),
                "with potential": _factor(own.loc["both"]),
                "lacking": f"{small.hidden:.0%}",
                "cost there": "–"
                if np.isnan(small.hidden_gap)
                else f"{small.hidden_gap:+.2f}{PM}{small.hidden_gap_ci95:.2f}",
            }
        )
    return pd.DataFrame(out)


def _factor(row: pd.Series) -> str:
    return f"{row.factor:.1f} ({row.factor_low:.1f}–{row.factor_high:.1f})"


def function_table(table: pd.DataFrame) -> pd.DataFrame:
    """Rates and time of every selector after the most tasks, and its gain after fewest and most."""
    few, many = table.tasks_seen.min(), table.tasks_seen.max()
    gain = table.gain.map("{:+.1f}".format) + PM + table.gain_ci95.map("{:.1f}".format)
    told = table.assign(told=gain).set_index(["domain", "method", "tasks_seen"]).told
    own = table[(table.tasks_seen == many) & (table.method != "none")]
    at = list(zip(own.domain, own.method, strict=True))
    return pd.DataFrame(
        {
            "domain": own.domain,
            "selector": own.method.map(FUNCTIONS),
            "FPR/TPR": own.fpr.map("{:.2f}".format) + "/" + own.tpr.map("{:.2f}".format),
            f"gain, n = {few}": [told[domain, method, few] for domain, method in at],
            f"gain, n = {many}": [told[domain, method, many] for domain, method in at],
            "time [ms]": (1000 * own.cpu_seconds).map("{:.1f}".format),
        }
    )
