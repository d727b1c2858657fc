"""Settings of the selectors that section 4.3 tried: levels on stock, features kept for good."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
import pandas as pd

from thesis_lib.chapter3.runs import SETTINGS
from thesis_lib.chapter4.runs import Rated, Run, run_selectors, solve_domain
from thesis_lib.domains import Domain, stock, triangle
from thesis_lib.edition.criteria import positive
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.words import plus_minus
from thesis_lib.selection import (
    FSTEK,
    IBKR,
    FixedFeatures,
    NoSelection,
    RandomSelection,
    Selector,
    triangle_alpha,
)

BESIDE: Mapping[str, str] = {
    "fs-tek": "fs-tek, tested again",
    "fs-tek at 1e-4": "fs-tek",
    "ibkr, varying level": "ibkr, level .01",
}
"""What each method is compared with; those not named, with FS-TEK at 1e-4."""

MARGIN = 0.05
"""Difference of returns that counts as none, as a share of the return."""


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
    cpu_seconds: float
    """Processor time of a selection, mean."""


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

    def one(seed: np.random.SeedSequence) -> Run:
        rng, picks = (np.random.default_rng(s) for s in seed.spawn(2))
        sizes = (learner, config.tasks_seen, config.tests)
        return run_selectors(solved, *sizes, rng, lambda: list(methods(picks).values()))

    runs = Run.stack(context.map(one, context.seeds(config.runs, 43, i), name))
    rows = []
    for (k, method), (j, n) in product(enumerate(names), enumerate(config.tasks_seen)):
        beside = BESIDE.get(method, names[min(2, len(names) - 1)])
        ahead = runs.ahead_of(j, k, names.index(beside))
        rows.append(
            Tried(
                domain=name,
                tasks_seen=n,
                method=method,
                beside=beside,
                ahead=ahead.mean,
                ahead_ci95=ahead.half_width,
                cpu_seconds=float(runs.seconds[:, j, k].mean()),
                **runs.rated(j, k, solved.truth),
            )
        )
    return rows


def _places(own: pd.DataFrame) -> str:
    return "; ".join(
        f"{r.domain} {plus_minus(r.ahead, r.ahead_ci95)} of {r.mean_return:.0f}"
        for r in own.itertuples()
    )


def _pooled(table: pd.DataFrame, method: str) -> pd.DataFrame:
    """Mean over the numbers of tasks of what a method is ahead by, a row a domain.

    The numbers of tasks share a run's tasks, so that half-widths are averaged and not divided.
    """
    own = table[table.method == method]
    return own.groupby("domain", as_index=False)[
        ["ahead", "ahead_ci95", "mean_return", "cpu_seconds"]
    ].mean()


@criterion("4.3-kept-for-good", tried)
def kept_for_good(table: pd.DataFrame) -> Finding:
    """Return and time with features kept for good, beside testing them again."""
    own = _pooled(table, "fs-tek")
    again = _pooled(table, "fs-tek, tested again")
    margin = MARGIN * own.mean_return.abs()
    equal = bool((own.ahead - own.ahead_ci95 > -margin).all())
    faster = own.cpu_seconds.sum() / again.cpu_seconds.sum()
    verdict = Verdict.REPRODUCED if equal and faster < 1 else Verdict.INCONCLUSIVE
    if (own.ahead + own.ahead_ci95 < 0).any():
        verdict = Verdict.REFUTED
    return Finding(
        verdict,
        f"Return with features kept for good less that with all tested in every round, mean over "
        f"the numbers of tasks: {_places(own)}. Selection takes {faster:.0%} of the time.",
        {"time": float(faster)},
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
        f"Return of the varying level less that of the constant one: {_places(own)}.",
        dict(zip(own.domain, own.ahead, strict=True)),
    )


@criterion("4.3-stock-level-worst", tried)
def strict_level_is_worst(table: pd.DataFrame) -> Finding:
    """How far every other method is ahead of FS-TEK at a constant 1e-4, G of 4 and more."""
    own = table[table.domain.str.startswith("stock") & (table.beside == "fs-tek at 1e-4")]
    worse = _pooled(table, "fs-tek at 1e-4").set_index("domain")
    others = {m: _pooled(own, m).set_index("domain") for m in own.method.unique()}
    contrasts = {
        f"{method}, {domain}": (float(r.ahead), float(r.ahead_ci95) / 1.96)
        for method, by in others.items()
        for domain, r in by.iterrows()
    } | {
        f"fs-tek, {domain}": (-float(r.ahead), float(r.ahead_ci95) / 1.96)
        for domain, r in worse.iterrows()
    }
    return positive(contrasts, "Return less that of FS-TEK at 1e-4")
