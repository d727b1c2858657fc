r"""Level or order: what a potential does by how high it is, and what by which actions it prefers.

Section 3.6 doubts that optimism explains which potential is best, and thinks that "each potential
type recommends a different policy".  Adding a constant to a potential changes its level and
nothing else, so every potential is moved to the same levels, and a constant potential, which has a
level and no order, is swept beside them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy import stats

from thesis_lib.arrays import FloatArray
from thesis_lib.chapter3.runs import (
    COLOUR,
    LEARNERS,
    SETTINGS,
    SYMBOLS,
    MuSearch,
    Potential,
    Setting,
    TabularLearner,
    named_potentials,
    total_rewards,
)
from thesis_lib.domains import stock
from thesis_lib.edition.criteria import LEVEL, graded, summary
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.plots import band, legend_of, panels
from thesis_lib.edition.words import number, plus_minus, span
from thesis_lib.stats import holm, mean_ci, welch

DOMAINS = {
    **SETTINGS,
    "stock E = 3": Setting(
        lambda: stock(1, 3, 2, discount=0.9), (TabularLearner("q_learning", 0.2, 0.1, steps=300),)
    ),
}
"""The domains of chapter 3, and stock with the E = 3 that section 3.4.4 prints."""

OWN = "own"
"""The level a potential has by itself."""


@dataclass(frozen=True)
class Config:
    """Which potentials are moved to which levels."""

    domains: tuple[str, ...] = tuple(DOMAINS)
    """Names in :data:`DOMAINS`."""
    names: tuple[Potential, ...] = ("Q_star", "Q_tilde", "Q_mu", "constant")
    """Potentials."""
    levels: tuple[float, ...] = (-0.25, 0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0)
    """Mean of the moved potential: 0 is the least and 1 the largest value of Q*."""
    repeats: int = 10
    """Runs a task, at least 2: bests are chosen by half of them and measured by the rest."""
    mu: MuSearch = field(default_factory=lambda: MuSearch(restarts=3))
    """The search for the cross-task policy."""


@dataclass(frozen=True)
class Moved:
    """One learner with one potential moved to one level, on one domain."""

    domain: str
    """Which domain."""
    algorithm: str
    """The learner."""
    potential: str
    """Q_star, Q_tilde, Q_mu or constant; none is no shaping."""
    level: str
    """Where the potential's mean is between the least (0) and largest (1) value of Q*; or own."""
    mean: float
    """The mean itself, in units of value."""
    mean_return: float
    """Mean total reward of a run."""
    ci95: float
    """Half-width of its 95% t interval over runs."""
    sd: float
    """Standard deviation over runs."""
    n_runs: int
    """Runs, all tasks together."""
    half_mean: float
    """Mean over every other run of a task, from the first on: by it bests are chosen."""
    rest_mean: float
    """Mean over the rest of the runs: they measure what was chosen."""
    rest_sd: float
    """Standard deviation over these."""
    rest_runs: int
    """How many these are."""


@experiment(
    "ch3-level-or-order",
    item="Section 3.6, level or order",
    smoke=Config(
        domains=("triangle",), names=("Q_star", "constant"), levels=(0.0, 1.0), repeats=2,
        mu=MuSearch(restarts=1),
    ),
    book=Config(),
    thesis=Config(repeats=20),
    seconds=15,
)  # fmt: skip
def moved(config: Config, context: Context) -> list[Moved]:
    """Return of every potential moved to every level, beside a constant and no shaping."""
    if config.repeats < 2:
        raise ValueError(
            f"repeats is {config.repeats}, but bests are chosen by half of a task's runs and "
            "measured by the rest: give at least 2."
        )
    rows = []
    for name in config.domains:
        domain = DOMAINS[name].domain()
        for learner in DOMAINS[name].learners:
            phi = named_potentials(
                domain,
                ("none", *config.names),
                epsilon=learner.epsilon,
                mu=config.mu,
                seed=context.seed,
            )
            star = named_potentials(
                domain, ("Q_star",), epsilon=learner.epsilon, mu=config.mu, seed=context.seed
            )["Q_star"]
            low, high = float(star.min()), float(star.max())
            keys: list[tuple[str, str, FloatArray]] = [("none", OWN, phi["none"])]
            for potential in config.names:
                values = phi[potential]
                keys.append((potential, OWN, values))
                for level in config.levels:
                    shift = low + level * (high - low) - float(values.mean())
                    keys.append((potential, f"{level:g}", values + shift))
            cells = [(learner, values) for _, _, values in keys]
            totals = total_rewards(context, domain, cells, config.repeats, name)
            for (kind, level_name, values), total in zip(keys, totals, strict=True):
                found, rest = mean_ci(total), total[:, 1::2]
                rows.append(
                    Moved(
                        *(name, learner.method, kind, level_name, float(values.mean())),
                        *(found.mean, found.half_width, float(total.std(ddof=1)), found.n),
                        *(float(total[:, ::2].mean()), float(rest.mean())),
                        *(float(rest.std(ddof=1)), rest.size),
                    )
                )
    return rows


def _variance(row: pd.Series) -> float:
    """Of the mean return that measures."""
    return float(row.rest_sd**2 / row.rest_runs)


def parts(table: pd.DataFrame) -> pd.DataFrame:
    """What the best level earns over no shaping, and what the best order adds.

    Bests are chosen by half of the runs and measured by the rest, so that choosing is no gain.

    Parameters
    ----------
    table
        Of :data:`moved`.

    Returns
    -------
    pandas.DataFrame
        One row a domain and learner: ``level``, the best constant less no shaping, exactly 0 where
        no shaping is the better; ``order``, the best potential at its best level less the better
        of these two; ``best``, which one; ``excess``, order less level; and the standard errors
        ``level_error``, ``order_error`` and ``excess_error``.
    """
    rows = []
    for (domain, algorithm), own in table.groupby(["domain", "algorithm"], sort=False):
        none = own[own.potential == "none"].iloc[0]
        flat = own[own.potential.isin(("none", "constant"))]
        shaped = own.drop(flat.index)
        level, order = flat.loc[flat.half_mean.idxmax()], shaped.loc[shaped.half_mean.idxmax()]
        of_none, of_level, of_order = (_variance(row) for row in (none, level, order))
        raised = level.potential != "none"
        rows.append(
            {
                "domain": domain,
                "algorithm": algorithm,
                "level": level.rest_mean - none.rest_mean,
                "order": order.rest_mean - level.rest_mean,
                "best": order.potential,
                "excess": order.rest_mean - 2 * level.rest_mean + none.rest_mean,
                "level_error": float(np.sqrt(raised * (of_level + of_none))),
                "order_error": float(np.sqrt(of_order + of_level)),
                "excess_error": float(np.sqrt(of_order + raised * 4 * of_level + of_none)),
            }
        )
    return pd.DataFrame(rows)


@criterion("3.6-order-not-level", moved)
def order_earns_more(table: pd.DataFrame) -> Finding:
    """Whether the order of a potential earns more than its level, in every setting."""
    found = parts(table)
    p = holm(2 * stats.norm.sf((found.excess / found.excess_error).abs()))
    more, less = (int(((p < LEVEL) & (sign * found.excess > 0)).sum()) for sign in (1, -1))
    told = "; ".join(
        f"{r.domain}, {LEARNERS[r.algorithm]}: level {_told(r.level, r.level_error)}, order "
        f"{_told(r.order, r.order_error)}"
        for r in found.itertuples()
    )
    return Finding(
        graded(
            more == len(found),
            direction=more > len(found) / 2,
            denied=less,
            otherwise=Verdict.INCONCLUSIVE,
        ),
        f"The best order adds significantly more to the best level than that level earns over no "
        f"shaping in {more or 'none'} of {len(found)} settings, and significantly less in "
        f"{less or 'none'} (z, Holm; bests chosen by half of the runs and measured by the rest, "
        f"with 95% intervals): {told}.",
        {"more": more, "less": less},
    )


def _told(value: float, error: float) -> str:
    """A difference with its 95% interval; one of a mean and itself has none."""
    return plus_minus(value, 1.96 * error) if error else number(value)


@criterion("3.6-reversal-is-level", moved)
def reversal_is_level(table: pd.DataFrame) -> Finding:
    """Whether Q^mu's lead over Q* at E = 3 is gone when both have the same level."""
    own = table[(table.domain == "stock E = 3") & table.potential.isin(("Q_star", "Q_mu"))]
    if own.empty:
        return Finding(Verdict.INCONCLUSIVE, "E = 3 was not run.")
    by = {key: summary(row) for key, row in own.set_index(["level", "potential"]).iterrows()}
    levels = [level for level in dict.fromkeys(own.level) if level != OWN]
    lead = welch(by[OWN, "Q_mu"], by[OWN, "Q_star"])
    tests = [welch(by[level, "Q_mu"], by[level, "Q_star"]) for level in levels]
    p = holm([t.p_value for t in tests])
    ahead = [t for t, q in zip(tests, p, strict=True) if t.difference > 0 and q < 0.05]
    behind = [t for t, q in zip(tests, p, strict=True) if t.difference < 0 and q < 0.05]
    # Cells have seeds of their own, so that the mean over levels is of independent differences.
    mean = sum(t.difference for t in tests) / len(tests)
    half = sum(((t.high - t.low) / 2) ** 2 for t in tests) ** 0.5 / len(tests)
    verdict = Verdict.REFUTED if ahead else Verdict.INCONCLUSIVE
    if not ahead and lead.low > 0 and mean + half < lead.difference / 2:
        verdict = Verdict.REPRODUCED
    return Finding(
        verdict,
        f"At their own levels Q^mu earns {span(lead.low, lead.high)} more than Q* (95% interval). "
        f"Moved to {len(levels)} common levels it earns significantly more at "
        f"{len(ahead) or 'none'} and less at {len(behind) or 'none'} (Welch, Holm), and "
        f"{plus_minus(mean, half)} more in the mean over them.",
        {"own": lead.difference, "common": mean, "ahead": len(ahead), "behind": len(behind)},
    )


def figure(table: pd.DataFrame) -> Figure:
    """Return over the level, one panel a domain and learner, one line a potential."""
    groups = list(table.groupby(["domain", "algorithm"], sort=False))
    fig, axes = panels(len(groups), 3, 2.1)
    for ax, ((domain, learner), own) in zip(axes, groups, strict=True):
        swept = own[own.level != OWN].assign(level=lambda t: t.level.astype(float))
        for name, group in swept.groupby("potential", sort=False):
            band(ax, group, "level", color=COLOUR[name], label=SYMBOLS[name])
        plain = float(own[own.potential == "none"].mean_return.iloc[0])
        ax.axhline(plain, color=COLOUR["none"], ls=":", label=SYMBOLS["none"])
        ax.set_title(f"{domain}\n{learner.replace('_', '-').capitalize()}", fontsize=9)
        ax.tick_params(labelsize=8)
    fig.supxlabel("level (0: least, 1: largest value of $Q^*$)", fontsize=10)
    fig.supylabel("mean total reward", fontsize=10)
    legend_of(axes[0], 5, "upper center")
    return fig
