r"""How often selectors keep an irrelevant feature when the tasks' scatter is not Gaussian.

The calibration of the jackknife F with Gaussian scatter is a theorem.  Here the effect of the
irrelevant feature has mean 0 and another law: lognormal; one task in eight with a large effect and
the rest a small opposite one; a random sign.  With the last two all n tasks can show the same
effect, by :math:`(7/8)^n` and :math:`2^{1-n}`, and then no test can tell it from relevance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
import pandas as pd
from scipy.stats import binomtest, norm

from thesis_lib.arrays import FloatArray
from thesis_lib.edition.criteria import LEVEL, graded
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.relevance import Solutions
from thesis_lib.selection import JackknifeF, LeaveOneTaskOut, SignFlips

LAWS: Mapping[str, Callable[[np.random.Generator, int], FloatArray]] = {
    "gaussian": lambda rng, n: rng.normal(size=n),
    "lognormal": lambda rng, n: rng.lognormal(size=n) - np.exp(0.5),
    "one in eight": lambda rng, n: np.where(rng.random(n) < 1 / 8, 7.0, -1.0),
    "sign": lambda rng, n: rng.choice([-1.0, 1.0], size=n),
}
"""Effects of an irrelevant feature, mean 0."""

MARGIN = 0.02
"""By how much more often a feature may be kept where the level counts as held."""


@dataclass(frozen=True)
class Config:
    """Which laws, numbers of tasks and weights are tried."""

    laws: tuple[str, ...] = tuple(LAWS)
    """Names in :data:`LAWS`."""
    tasks_seen: tuple[int, ...] = (4, 6, 8, 12, 20, 40)
    """Numbers of observed tasks."""
    runs: int = 400
    """Samples of tasks."""


@dataclass(frozen=True)
class Kept:
    """One selector on tasks whose only feature is irrelevant."""

    law: str
    """Of the feature's effect between tasks."""
    shared: bool
    """Whether tasks share p(x|m)."""
    tasks_seen: int
    """Number of observed tasks."""
    selector: str
    """The F-test or flipped signs at 5%, or cross-validation."""
    kept: float
    """Share of runs in which the feature is kept."""
    low: float
    """Low end of its exact 95% binomial interval."""
    high: float
    """High end."""


@experiment(
    "ch4-scatter",
    item="Jackknife F (scatter)",
    smoke=Config(laws=("gaussian", "sign"), tasks_seen=(4,), runs=10),
    book=Config(runs=200),
    thesis=Config(),
    seconds=12,
)
def kept(config: Config, context: Context) -> list[Kept]:
    """How often an irrelevant feature is kept, by the law of its effect."""
    # Every task visits both cells, so that no value beside theirs matters.
    selectors = {
        "jackknife": JackknifeF(LEVEL),
        "cross-validation": LeaveOneTaskOut(),
        "flipped signs": SignFlips(LEVEL),
    }
    features = np.array([[0], [1]])
    rows = []
    for (law, shared), n in product(product(config.laws, (True, False)), config.tasks_seen):
        counts = dict.fromkeys(selectors, 0)
        for seed in context.seeds(config.runs, 25, tuple(LAWS).index(law), int(shared), n):
            rng = np.random.default_rng(seed)
            effect = LAWS[law](rng, n)
            first = np.full(n, 0.5) if shared else rng.uniform(0.1, 0.9, n)
            q = np.stack([-effect, effect], axis=1)
            solutions = Solutions(q, np.stack([first, 1 - first], axis=1), features, ("f",))
            for name, selector in selectors.items():
                counts[name] += int(selector.fit(solutions).support_[0])
        for name, count in counts.items():
            ends = binomtest(count, config.runs).proportion_ci(0.95)
            share = count / config.runs
            rows.append(Kept(law, shared, n, name, share, float(ends.low), float(ends.high)))
    return rows


@criterion("4.5-jackknife-level", kept)
def level_is_held(table: pd.DataFrame) -> Finding:
    """Whether the F-test keeps an irrelevant feature no more often than its level says."""
    own = table[(table.selector == "jackknife") & (table.tasks_seen >= 6)]
    if own.empty:
        return Finding(Verdict.INCONCLUSIVE, "No number of tasks from 6 on was tried.")
    wider = norm.isf(LEVEL / 2 / len(own)) / norm.isf(LEVEL / 2)
    over = own[own.kept - wider * (own.kept - own.low) > LEVEL]
    held = own.high <= LEVEL + MARGIN
    worst = own.loc[own.kept.idxmax()]
    return Finding(
        graded(held.all(), denied=len(over), otherwise=Verdict.INCONCLUSIVE),
        f"From 6 tasks on it is kept significantly more often than {LEVEL:.0%} in {len(over)} of "
        f"{len(own)} cells ({', '.join(dict.fromkeys(over.law)) or 'none'}; Bonferroni), at most "
        f"{worst.kept:.0%} ({worst.law}, {worst.tasks_seen} tasks); in {held.sum()} it is shown to "
        f"be kept at most {LEVEL + MARGIN:.0%} of the time.",
        {"over": len(over), "worst": float(worst.kept)},
    )


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Shares of runs in which an irrelevant feature is kept, the selectors' parted by slashes.

    They have no leading zero, so that the table fits its page.
    """
    own = table.assign(
        kept=table.kept.map(lambda share: f"{share:.2f}".removeprefix("0")),
        p=table.shared.map({True: "shared", False: "own"}),
    )
    wide = own.groupby(["p", "law", "tasks_seen"], sort=False).kept.agg("/".join).unstack()
    rows = product(("shared", "own"), table.law.unique())
    return wide.loc[[row for row in rows if row in wide.index]].add_prefix("n = ").reset_index()
