"""Beyond the thesis: potentials times a factor (the open question of section 3.6)."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.arrays import FloatArray
from thesis_lib.chapter3.runs import (
    LEARNERS,
    NAMES,
    SETTINGS,
    SHAPED,
    SYMBOLS,
    MuSearch,
    Potential,
    curves,
    named_potentials,
    total_rewards,
)
from thesis_lib.edition.criteria import LEVEL, Pair, best, graded, no_greater, summary
from thesis_lib.edition.experiment import Context, Returns, experiment, returns
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.plots import PRINTED, legend_of, panels
from thesis_lib.edition.words import number, plus_minus
from thesis_lib.stats import holm, mean_ci, welch

MARGIN = 0.05
"""Largest gain that counts as none, as a share of the return with factor 1."""


@dataclass(frozen=True)
class Config:
    """Which factors each potential is multiplied by (the open question of section 3.6)."""

    domains: tuple[str, ...] = tuple(SETTINGS)
    """Domains of chapter 3."""
    names: tuple[Potential, ...] = ("Q_star", "Q_tilde", "Q_mu", "constant")
    """Potentials."""
    factors: tuple[float, ...] = (0.0, 0.25, 0.5, 0.75, 0.9, 1.0, 1.1, 1.25, 1.5, 2.0, 4.0)
    """Scale factors; 0 is no shaping, 1 the potential itself."""
    repeats: int = 25
    """Runs a task."""
    mu: MuSearch = field(default_factory=MuSearch)
    """The search for the cross-task policy."""


@dataclass(frozen=True)
class Return(Returns):
    """Return with one potential times one factor."""

    domain: str
    """Which domain."""
    algorithm: str
    """The learner."""
    potential: str
    """What is scaled."""
    factor: float
    """0 is no shaping, 1 the potential itself."""
    derived_mean: float
    """Mean return on each task with the factor best on the other tasks: what an agent could
    know from its source tasks."""
    derived_ci95: float
    """Half-width of its 95% t interval."""


@experiment(
    "ch3-scaling",
    item="Section 3.6, scaling the potential",
    smoke=Config(domains=("triangle",), factors=(0.0, 1.0), repeats=1, mu=MuSearch(restarts=1)),
    book=Config(repeats=15),
    thesis=Config(),
    seconds=14,
)
def scaled(config: Config, context: Context) -> list[Return]:
    """Return over a factor the potential is multiplied by."""
    records = []
    for name in config.domains:
        domain = SETTINGS[name].domain()
        for learner in SETTINGS[name].learners:
            phi = named_potentials(
                domain, config.names, epsilon=learner.epsilon, mu=config.mu, seed=context.seed
            )
            keys = list(product(config.names, config.factors))
            cells = [(learner, factor * phi[potential]) for potential, factor in keys]
            totals = total_rewards(context, domain, cells, config.repeats, name)
            for i, potential in enumerate(config.names):
                own = totals[i * len(config.factors) : (i + 1) * len(config.factors)]
                derived = mean_ci(leave_one_out(own))
                records += [
                    Return(
                        domain=name,
                        algorithm=learner.method,
                        potential=potential,
                        factor=factor,
                        derived_mean=derived.mean,
                        derived_ci95=derived.half_width,
                        **returns(total),
                    )
                    for factor, total in zip(config.factors, own, strict=True)
                ]
    return records


def leave_one_out(totals: FloatArray) -> FloatArray:
    """Returns on each task with the factor that is best on the other tasks.

    Parameters
    ----------
    totals
        Return by factor, task and run, shape ``(F, M, R)``.

    Returns
    -------
    FloatArray
        Shape ``(M, R)``.
    """
    by_task = totals.mean(axis=2)
    n_tasks = by_task.shape[1]
    others = by_task.sum(axis=1, keepdims=True) - by_task
    best = np.argmax(others, axis=0)
    return np.stack([totals[best[m], m] for m in range(n_tasks)])


@criterion("3.6-scaling", scaled)
def scaling_helps(table: pd.DataFrame) -> Finding:
    """In how many settings another factor above 0 earns a potential significantly more than 1.

    Of the thesis's potentials: a constant is none of them, and factor 0 leaves nothing of one.
    """
    told, p, pairs = [], [], list[Pair]()
    table = table[table.potential.isin(SHAPED) & (table.factor > 0)]
    for (domain, algorithm, potential), own in table.groupby(
        ["domain", "algorithm", "potential"], sort=False
    ):
        at_one, others = own[own.factor == 1].iloc[0], own[own.factor != 1]
        pairs += [
            Pair(summary(other), summary(at_one), ("another factor", "1"))
            for _, other in others.iterrows()
        ]
        top = best(others)
        test = welch(summary(top), summary(at_one))
        # The best factor is chosen after looking: any of them might have been it.
        p.append(min(1.0, len(others) * test.p_value) if test.difference > 0 else 1.0)
        told.append(
            f"{NAMES[potential]} ({domain}, {LEARNERS[algorithm]}; factor {top.factor:g}, "
            f"{number(test.difference, (test.high - test.low) / 2, sign=True)})"
        )
    helped = [text for text, q in zip(told, holm(p), strict=True) if q < LEVEL]
    none = no_greater(pairs, MARGIN).verdict is Verdict.REPRODUCED
    otherwise = Verdict.NOT_REPRODUCED if none else Verdict.INCONCLUSIVE
    return Finding(
        graded(helped, otherwise=otherwise),
        f"Some factor above 0 earns significantly more than 1 (Welch, Holm, corrected for the "
        f"choice of the best) in {len(helped)} of {len(told)} cases{': ' if helped else ''}"
        f"{'; '.join(helped)}; that every one earns at most {MARGIN:.0%} more is "
        f"{'' if none else 'not '}shown.",
        {"helped": len(helped)},
    )


def figure(table: pd.DataFrame) -> Figure:
    """Return over the scale factor, one panel a domain and learner."""
    groups = list(table.groupby(["domain", "algorithm"], sort=False))
    fig, axes = panels(len(groups), 2, 1.9, 0.7, sharex=True)
    for ax, ((domain, method), own) in zip(axes, groups, strict=True):
        curves(ax, own, "factor", marker="o", ms=3)
        ax.axvline(1, color=PRINTED, ls=":", lw=1)
        ax.set_title(f"{domain}, {LEARNERS[method]}", fontsize=9)
        ax.tick_params(labelsize=8)
    for ax in axes[-2:]:
        ax.set_xlabel("factor", fontsize=9)
    fig.supylabel("total reward", fontsize=10)
    legend_of(axes[0], 4)
    return fig


def bests(table: pd.DataFrame) -> pd.DataFrame:
    """Best factor of each potential, with the return there, at 1, and with a derived factor.

    Returns
    -------
    pandas.DataFrame
        One row a ``domain``, ``learner`` and ``potential`` (symbol): the best ``factor`` and the
        returns ``at_best``, ``at_one`` and ``derived``, each with its half-width of 95%, as
        ``at_best_ci95``; that of the best does not count that it was chosen after looking.
    """
    keys = ["domain", "algorithm", "potential"]
    best = table.loc[table.groupby(keys, sort=False).mean_return.idxmax()].set_index(keys)
    one = table[table.factor == 1].set_index(keys).reindex(best.index)
    wide = best[["factor"]].assign(
        **{"at_best": best.mean_return, "at_best_ci95": best.ci95},
        **{"at_one": one.mean_return, "at_one_ci95": one.ci95},
        **{"derived": best.derived_mean, "derived_ci95": best.derived_ci95},
    )
    wide = wide.reset_index()
    wide.insert(1, "learner", wide.pop("algorithm").map(LEARNERS))
    return wide.assign(potential=wide.potential.map(SYMBOLS))


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """The rows of :func:`bests` as text, returns with their 95% intervals."""
    own = bests(table)
    columns = {"at_best": "return with it", "at_one": "with factor 1", "derived": "derived"}
    returns = {
        name: [plus_minus(*pair) for pair in zip(own[column], own[f"{column}_ci95"], strict=True)]
        for column, name in columns.items()
    }
    return pd.DataFrame(
        {
            "domain and learner": own.domain + ", " + own.learner,
            "potential": own.potential,
            "best factor": own.factor.map("{:g}".format),
            **returns,
        }
    )
