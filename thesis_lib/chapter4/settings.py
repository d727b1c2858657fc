"""Settings of the selectors that section 4.3 tried: levels on stock, features kept for good."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
import pandas as pd
from scipy.stats import norm

from thesis_lib.chapter3.runs import SETTINGS
from thesis_lib.chapter4.figure_4_6 import by_factors
from thesis_lib.chapter4.looks import SYMBOLS
from thesis_lib.chapter4.runs import Rated, Run, place, run_selectors, solve_domain
from thesis_lib.domains import Domain, stock, triangle
from thesis_lib.edition.criteria import LEVEL, graded, judged, positive
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.words import plus_minus, several
from thesis_lib.selection import (
    FSTEK,
    IBKR,
    FixedFeatures,
    NoSelection,
    RandomSelection,
    Selector,
    triangle_alpha,
)
from thesis_lib.stats import least_power, mean_ci

BESIDE: Mapping[str, str] = {
    "fs-tek": "fs-tek, tested again",
    "fs-tek at 1e-4": "fs-tek",
    "ibkr, varying level": "ibkr, level .01",
}
"""What each method is compared with; those not named, with FS-TEK at 1e-4."""

MARGIN = 0.05
"""Difference of returns that counts as none, as a share of the return."""

SPREAD = 0.15
"""Difference of rates that counts as none."""


@dataclass(frozen=True)
class Config:
    """Where the settings are tried."""

    global_factors: tuple[int, ...] = (4, 5)
    """G of stock, where the thesis changed its levels."""
    tasks_seen: tuple[int, ...] = (4, 6, 8, 12)
    """Numbers of observed tasks."""
    runs: int = 60
    """Sequences of tasks."""
    tests: int = 10
    """Tasks learned with each potential."""


@dataclass(frozen=True)
class Tried(Rated):
    """One setting after one number of observed tasks on one domain."""

    domain: str
    """triangle, or stock with its G."""
    method: str
    """Which selector, with its setting."""
    beside: str
    """Which one it is compared with."""
    ahead: float
    """Return less that one's, paired by run, mean."""
    ahead_ci95: float
    """Half-width of its 95% t interval."""
    fpr_ci95: float
    """Half-width of the normal 95% interval of the false positive rate over runs."""
    tpr_ci95: float
    """The same of the true positive rate."""
    tests: float
    """Features tested in a selection, over all its rounds, mean; 0 without tests."""
    saved: float
    """Tests of the one compared with less these, paired by run, mean."""
    saved_ci95: float
    """Half-width of its 95% t interval."""


@experiment(
    "ch4-settings",
    item="Section 4.3 (settings)",
    smoke=Config((4,), (4,), 2, 1),
    book=Config(),
    thesis=Config(runs=500),
    seconds=14,
)
def tried(config: Config, context: Context) -> list[Tried]:
    """Return with features kept for good or tested again, and with several levels on stock."""
    domains = {"triangle": triangle()} | {
        f"stock G = {g}": stock(1, 2, g, discount=0.9) for g in config.global_factors
    }
    return [
        row
        for i, (name, domain) in enumerate(domains.items())
        for row in _on(i, name, domain, config, context)
    ]


def _on(i: int, name: str, domain: Domain, config: Config, context: Context) -> list[Tried]:
    learner = SETTINGS["triangle" if name == "triangle" else "stock"].learners[0]
    solved = solve_domain(domain, learner, context)
    flat = "unsure" if name == "triangle" else "limit"

    def methods(rng: np.random.Generator) -> dict[str, Selector]:
        found: dict[str, Selector] = {
            "fs-tek": FSTEK(triangle_alpha, flat=flat),  # type: ignore[arg-type]
            "fs-tek, tested again": FSTEK(triangle_alpha, flat=flat, keep_for_good="never"),  # type: ignore[arg-type]
        }
        if name == "triangle":
            return found
        return found | {
            "fs-tek at 1e-4": FSTEK(1e-4),
            "ibkr, level .01": IBKR(1e-2, "bootstrap"),
            "ibkr, varying level": IBKR(triangle_alpha, "bootstrap"),
            "no selection": NoSelection(),
            "random features": RandomSelection(random_state=rng),
            "fixed features": FixedFeatures(solved.relevant),
        }

    names = list(methods(np.random.default_rng()))

    def one(seed: np.random.SeedSequence) -> tuple[Run, list[list[int]]]:
        rng, picks = (np.random.default_rng(s) for s in seed.spawn(2))
        sizes = (learner, config.tasks_seen, config.tests)
        used: list[list[Selector]] = []

        def fresh() -> list[Selector]:
            used.append(list(methods(picks).values()))
            return used[-1]

        run = run_selectors(solved, *sizes, rng, fresh)
        return run, [[_tests(selector) for selector in row] for row in used]

    found = context.map(one, context.seeds(config.runs, 43, i), name)
    runs, tests = Run.stack([run for run, _ in found]), np.array([counts for _, counts in found])
    rows = []
    for (k, method), (j, n) in product(enumerate(names), enumerate(config.tasks_seen)):
        beside = BESIDE.get(method, names[min(2, len(names) - 1)])
        ahead = runs.ahead_of(j, k, names.index(beside))
        saved = mean_ci(tests[:, j, names.index(beside)] - tests[:, j, k])
        placed = place(runs.support[:, j, k], solved.truth)
        rows.append(
            Tried(
                domain=name,
                tasks_seen=n,
                method=method,
                beside=beside,
                ahead=ahead.mean,
                ahead_ci95=ahead.half_width,
                fpr_ci95=placed["fpr_ci95"],
                tpr_ci95=placed["tpr_ci95"],
                tests=float(tests[:, j, k].mean()),
                saved=saved.mean,
                saved_ci95=saved.half_width,
                **runs.rated(j, k, solved.truth),
            )
        )
    return rows


def _tests(selector: Selector) -> int:
    """How many features a selector that was fitted has tested, over all rounds."""
    return sum(len(round_.checks) for round_ in getattr(selector, "history_", ()))


def _places(own: pd.DataFrame) -> str:
    return "; ".join(
        f"{r.domain} {plus_minus(r.ahead, r.ahead_ci95)} of {r.mean_return:.0f}"
        for r in own.itertuples()
    )


def _pooled(table: pd.DataFrame, method: str) -> pd.DataFrame:
    """Mean over the numbers of tasks of what a method is ahead by and saves, a row a domain.

    The numbers of tasks share a run's tasks, so that half-widths are averaged and not divided.
    """
    own = table[table.method == method]
    gaps = ["ahead", "ahead_ci95", "saved", "saved_ci95"]
    return own.groupby("domain", as_index=False)[[*gaps, "mean_return", "tests"]].mean()


@criterion("4.3-kept-for-good", tried)
def kept_for_good(table: pd.DataFrame) -> Finding:
    """Return and number of tests with features kept for good, beside testing them again."""
    own = _pooled(table, "fs-tek")
    again = _pooled(table, "fs-tek, tested again")
    equal = (own.ahead - own.ahead_ci95 > -MARGIN * own.mean_return.abs()).all()
    surely = own.saved - own.saved_ci95
    verdict = graded(
        equal and (surely > again.tests / 3).all(),
        direction=equal and (surely > 0).all(),
        denied=(own.ahead + own.ahead_ci95 < 0).any(),
        otherwise=Verdict.NOT_REPRODUCED if equal else Verdict.INCONCLUSIVE,
    )
    share = dict(zip(own.domain, own.tests / again.tests, strict=True))
    counted = "; ".join(
        f"{r.domain} {r.tests:.1f} of {r.tests + r.saved:.1f}, {plus_minus(r.saved, r.saved_ci95)} "
        "fewer"
        for r in own.itertuples()
    )
    return Finding(
        verdict,
        f"Return with features kept for good less that with all tested in every round, mean over "
        f"the numbers of tasks: {_places(own)}; without any difference each would be shown to be "
        f"at most {MARGIN:.0%} below in at least "
        f"{least_power(MARGIN * own.mean_return.abs(), own.ahead_ci95, sides=1):.0%} of samples. "
        f"Features tested in a selection: {counted}.",
        {where: float(by) for where, by in share.items()},
    )


@criterion("4.3-stock-roc", tried, by_factors)
def similar_rates(tried: pd.DataFrame, by_factors: pd.DataFrame) -> Finding:
    """FS-TEK's rates at 1e-4 with four and five factors beside those with fewer.

    Means over the factors, whose runs are independent, and over the numbers of tasks, which share
    runs, so that their errors are averaged.  Runs of figure 4.6 have at most the variance of a
    share, as if the features of a run went together.
    """
    high = tried[tried.method == "fs-tek at 1e-4"]
    low = by_factors[(by_factors.method == "fs-tek") & (by_factors.global_factors < 4)]
    low = low[low.tasks_seen.isin(high.tasks_seen)]
    high = high[high.tasks_seen.isin(low.tasks_seen)]
    gaps, halves, apart = {}, {}, False
    for rate in ("fpr", "tpr"):
        p = low[rate]
        below = low.assign(variance=3.84 * p * (1 - p) / low.n_runs)
        above = high.assign(variance=high[f"{rate}_ci95"] ** 2)
        first, second = (t.groupby("tasks_seen") for t in (above, below))
        # The variance of a mean of independent numbers.
        own, other = (g["variance"].mean() / g.size() for g in (first, second))
        gap = first[rate].mean() - second[rate].mean()
        gaps[rate], halves[rate] = float(gap.mean()), float((own + other).pow(0.5).mean())
        single = above[rate] - above.tasks_seen.map(second[rate].mean())
        error = (above["variance"] + above.tasks_seen.map(other)).pow(0.5) / 1.96
        wider = norm.isf(LEVEL / 2 / (2 * len(above)))
        apart |= bool((single.abs() - wider * error > SPREAD).any())
    far = any(abs(gaps[rate]) - halves[rate] > SPREAD for rate in gaps)
    near = all(abs(gaps[rate]) + halves[rate] < SPREAD for rate in gaps)
    told = several(
        f"{name} positive rate {plus_minus(gaps[rate], halves[rate])}"
        for name, rate in (("false", "fpr"), ("true", "tpr"))
    )
    factors = several(f"{g:g}" for g in sorted(low.global_factors.unique()))
    return judged(
        near and not apart,
        f"At 1e-4, mean over {several(f'{n:g}' for n in sorted(high.tasks_seen.unique()))} tasks "
        f"on {several(high.domain.unique())} less that on stock G = {factors}: {told}; "
        f"{'some' if apart else 'no'} single one is off by significantly more than {SPREAD} "
        "(Bonferroni).",
        {**gaps, **{f"{rate}_error": half for rate, half in halves.items()}},
        otherwise=Verdict.REFUTED if far or apart else Verdict.INCONCLUSIVE,
    )


@criterion("4.3-stock-ibkr-level", tried)
def ibkr_level(table: pd.DataFrame) -> Finding:
    """IBKR's return with a level that rises with the number of tasks, beside a constant one."""
    own = _pooled(table, "ibkr, varying level")
    margin = MARGIN * own.mean_return.abs()
    alike = ((own.ahead.abs() + own.ahead_ci95) < margin).all()
    apart = ((own.ahead.abs() - own.ahead_ci95) > margin).any()
    verdict = Verdict.REPRODUCED if alike else Verdict.INCONCLUSIVE
    return Finding(
        Verdict.REFUTED if apart else verdict,
        f"Return of the varying level less that of the constant one: {_places(own)}; without any "
        f"difference each interval would lie within {MARGIN:.0%} of the return in at least "
        f"{least_power(margin, own.ahead_ci95):.0%} of samples.",
        dict(zip(own.domain, own.ahead, strict=True)),
    )


@criterion("4.3-stock-level-worst", tried)
def strict_level_is_worst(table: pd.DataFrame) -> Finding:
    """How far every other method is ahead of FS-TEK at a constant 1e-4, G of 4 and more."""
    own = table[table.domain.str.startswith("stock") & (table.beside == "fs-tek at 1e-4")]
    worse = _pooled(table, "fs-tek at 1e-4").set_index("domain")
    others = {m: _pooled(own, m).set_index("domain") for m in own.method.unique()}
    contrasts = {
        f"{SYMBOLS.get(method, method.replace('ibkr', 'IBKR'))}, {domain}": (
            float(r.ahead),
            float(r.ahead_ci95) / 1.96,
        )
        for method, by in others.items()
        for domain, r in by.iterrows()
    } | {
        f"FS-TEK, {domain}": (-float(r.ahead), float(r.ahead_ci95) / 1.96)
        for domain, r in worse.iterrows()
    }
    return positive(contrasts, "Return less that of FS-TEK at 1e-4")
