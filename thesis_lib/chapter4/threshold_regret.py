r"""What a rule on the F-ratio errs on the next task, by how relevant a feature is.

Tasks share p(x|m), and the contributions of n tasks to a feature's increment are Gaussian,
:math:`Z_i \sim N(\mu, \sigma^2 I)` in d directions.  A rule predicts :math:`w \bar Z` with a weight
w(F): 1 where it keeps the feature, 0 where it removes it.  Its expected squared error beyond that
of :math:`\mu` is 1 for keeping, in units of :math:`\mathrm{tr}\,\Sigma/n`, and
:math:`e^2 = n|\mu|^2/\mathrm{tr}\,\Sigma` for removing.  Regret is the error less the smaller of
the two, which hindsight would choose.

Let :math:`x = \sqrt n \bar Z/\sigma` have the coordinate :math:`\theta + u` along :math:`\mu`,
:math:`\theta = e\sqrt d`, and others of squared length r, so that u is standard normal and r has
the law :math:`\chi^2_{d-1}`.  Independent of both is :math:`T = \mathrm{tr}\,S/\sigma^2`, with
:math:`(n-1)T \sim \chi^2_{(n-1)d}`.  With :math:`X = |x|^2 = (\theta+u)^2 + r`, F is X/T.  Given X
the chance that a feature stays at a threshold, and the first two moments of the weight
:math:`(1 - T/X)_+`, are values of chi-squared distribution functions.  What is left is an integral
over u and r; nothing is drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.special import chdtr, roots_genlaguerre

from thesis_lib.arrays import FloatArray
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.plots import COLOURS, legend_of
from thesis_lib.selection import f_threshold, fstek_threshold, triangle_alpha

THRESHOLDS: Mapping[str, Callable[[int], float]] = {
    "all features": lambda n: 0.0,
    "fs-tek schedule": lambda n: fstek_threshold(n, triangle_alpha(n)),
    "jackknife": lambda n: f_threshold(n, 0.05),
    "cross-validation": lambda n: 1 + n / (n - 1),
}
"""F-ratio of n tasks up to which a feature is removed, by rule."""

RULES = (*THRESHOLDS, "shrinkage")


@dataclass(frozen=True)
class Config:
    """Numbers of tasks, and how the scatter and the effect vary."""

    tasks_seen: tuple[int, ...] = (4, 5, 6, 8, 12, 20)
    """Numbers of observed tasks."""
    directions: tuple[int, ...] = (1, 10)
    """In how many directions solutions scatter equally."""
    most: float = 6.0
    """Largest effect, in standard errors."""
    steps: int = 60
    """Steps from 0 to it."""


@dataclass(frozen=True)
class Risk:
    """What one rule errs at one effect."""

    rule: str
    """What becomes of a feature: it stays, goes up to a threshold on F, or is shrunk."""
    tasks_seen: int
    """Number of observed tasks n."""
    directions: int
    """Directions of scatter d."""
    effect: float
    """Root of n times the feature's relevance over the trace of the scatter."""
    excess: float
    """Expected squared error beyond that of the truth, in units of the trace over n."""
    regret: float
    """That less what the better of keeping and removing errs."""


@experiment(
    "ch4-threshold-regret",
    item="Selection as prediction (thresholds)",
    smoke=Config(tasks_seen=(4,), directions=(1,), steps=6),
    book=Config(),
    thesis=Config(),
    seconds=4,
)
def risks(config: Config, context: Context) -> list[Risk]:
    """Expected excess error and regret of rules on F, exact up to quadrature."""
    effects = np.linspace(0, config.most, config.steps + 1)
    rows = []
    for rule, n, d in product(RULES, config.tasks_seen, config.directions):
        for effect in effects.tolist():
            excess = risk(rule, n, d, effect)
            regret = excess - min(1.0, effect**2)
            rows.append(Risk(rule, n, d, effect, excess, regret))
    return rows


def risk(rule: str, n: int, directions: int, effect: float) -> float:
    """Expected squared error of a rule beyond that of the truth, in units of the trace over n.

    Parameters
    ----------
    rule
        One of :data:`RULES`.
    n
        Number of tasks, at least 4.
    directions
        d.
    effect
        e, at least 0.
    """
    theta = effect * np.sqrt(directions)
    u, r, weight = _nodes(directions)
    X = (theta + u) ** 2 + r
    if rule == "shrinkage":
        # Moments of T up to X: E T^k [T < X] by the chi-squared law of 2k more degrees.
        freedom = (n - 1) * directions
        m0, m1, m2 = (chdtr(freedom + 2 * k, (n - 1) * X) for k in range(3))
        m1, m2 = m1 * directions, m2 * freedom * (freedom + 2) / (n - 1) ** 2
        error = m0 * X - 2 * m1 + m2 / X - 2 * (m0 - m1 / X) * theta * (theta + u) + theta**2
    else:
        threshold = THRESHOLDS[rule](n)
        stays = np.ones_like(X)
        if threshold > 0:
            stays = chdtr((n - 1) * directions, (n - 1) * X / threshold)
        error = stays * (u**2 + r) + (1 - stays) * theta**2
    return float((weight * error).sum()) / directions


def _nodes(directions: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Nodes of u and r and their weights, shape ``(601, 1)``, ``(R,)`` and ``(601, R)``."""
    u = np.linspace(-9, 9, 601)[:, None] + 1e-9  # not on X = 0
    normal = np.exp(-(u**2) / 2)
    if directions == 1:
        return u, np.zeros(1), normal / normal.sum()
    r, chi = roots_genlaguerre(24, (directions - 3) / 2)
    return u, 2 * r, normal / normal.sum() * (chi / chi.sum())


def largest(table: pd.DataFrame) -> pd.DataFrame:
    """Largest regret over the effects, by directions and rule, one column a number of tasks."""
    wide = table.pivot_table("regret", ["directions", "rule"], "tasks_seen", aggfunc="max")
    rules = [rule for rule in RULES if rule in wide.index.unique("rule")]
    return wide.reindex(rules, level="rule").add_prefix("n = ").reset_index()


def figure(table: pd.DataFrame, n: int) -> Figure:
    """Regret over the effect, one panel a number of directions, one line a rule."""
    at = table[table.tasks_seen == n]
    panels = list(at.groupby("directions"))
    fig, axes = plt.subplots(1, len(panels), figsize=(7.2, 3.0), sharey=True, squeeze=False)
    for ax, (d, own) in zip(axes.flat, panels, strict=True):
        for i, (rule, line) in enumerate(own.groupby("rule", sort=False)):
            ax.plot(line.effect, line.regret, color=COLOURS[i], label=str(rule))
        ax.set_title(f"{d} direction{'s' * (d > 1)}", fontsize=9)
        ax.set_xlabel("effect [standard errors]")
    axes[0, 0].set_ylabel("regret [trace / n]")
    legend_of(axes[0, 0], 5, "upper center")
    return fig
