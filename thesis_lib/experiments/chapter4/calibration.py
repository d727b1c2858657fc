"""Whether the jackknife F-test holds its level, what power it has, and its place in ROC space."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.stats import binomtest

from thesis_lib.domains import Domain, continuing_cliff, stock, triangle
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.experiments.chapter4.curves import exact_solutions
from thesis_lib.experiments.chapter4.families import planted_solutions, random_domain, torus
from thesis_lib.experiments.chapter4.selection_figures import POSITION
from thesis_lib.selection import (
    FSTEK,
    IBKR,
    ExactRelevance,
    JackknifeF,
    Selector,
    rates,
    triangle_alpha,
)


@dataclass(frozen=True)
class CalibrationConfig:
    """Settings of the calibration."""

    runs: int = 1000
    """Samples of tasks at each point."""
    tasks_seen: tuple[int, ...] = (3, 4, 5, 6, 8, 12, 20)
    """Numbers of observed tasks."""
    alphas: tuple[float, ...] = (0.01, 0.05, 0.2)
    """Levels of the test."""
    effects: tuple[float, ...] = (0.5, 1.0, 2.0)
    """Mean effect of the relevant feature, in standard deviations between tasks."""
    levels: tuple[int, ...] = (2, 6)
    """Values of the irrelevant feature: its scatter has one direction less."""


def run_calibration(config: CalibrationConfig, context: Context) -> pd.DataFrame:
    """Compute the calibration; columns are documented in :data:`CALIBRATION`."""

    def one(job: tuple[int, float, int, bool, str]) -> list[dict[str, float | str | int | bool]]:
        n, effect, levels, shared, null = job
        key = (7, n, round(10 * effect), levels, int(shared))
        kept = np.zeros((len(config.alphas), 2), dtype=int)
        for seed in context.seeds(config.runs, *key):
            solutions = planted_solutions(
                np.random.default_rng(seed), n, effect, levels=levels, shared=shared
            )
            for i, alpha in enumerate(config.alphas):
                kept[i] += JackknifeF(alpha, null=null).fit(solutions).support_  # type: ignore[arg-type]
        records: list[dict[str, float | str | int | bool]] = []
        for alpha, counts in zip(config.alphas, kept, strict=True):
            for feature, count in zip(("relevant", "irrelevant"), counts, strict=True):
                interval = binomtest(int(count), config.runs).proportion_ci(0.95)
                records.append(
                    {
                        "null": null,
                        "shared": shared,
                        "levels": levels,
                        "effect": effect,
                        "alpha": alpha,
                        "tasks_seen": n,
                        "feature": feature,
                        "kept": count / config.runs,
                        "low": float(interval.low),
                        "high": float(interval.high),
                        "n_runs": config.runs,
                    }
                )
        return records

    jobs = [
        (n, effect, levels, shared, null)
        for null in ("t2", "box")
        for shared in (True, False)
        for levels in config.levels
        for effect in config.effects
        for n in config.tasks_seen
        # The second null law is shown where it differs, and power once.
        if (effect == config.effects[-1] or (shared and levels == 2 and null == "t2"))
    ]
    return rows([r for part in context.map(one, jobs, "calibration") for r in part])


CALIBRATION: Experiment[CalibrationConfig] = Experiment(
    id="selector-calibration",
    item="Jackknife F (calibration)",
    title="How often the jackknife F-test keeps an irrelevant and a relevant feature.",
    function=run_calibration,
    budgets={
        "smoke": CalibrationConfig(
            runs=5, tasks_seen=(4,), alphas=(0.05,), effects=(1.0,), levels=(2,)
        ),
        "book": CalibrationConfig(runs=400),
        "thesis": CalibrationConfig(runs=2000),
    },
    columns={
        "null": "null law: t2, the default, or box",
        "shared": "whether tasks share p(x|m)",
        "levels": "values of the irrelevant feature",
        "effect": "mean effect of the relevant feature, in standard deviations between tasks",
        "alpha": "level of the test",
        "tasks_seen": "number of observed tasks n",
        "feature": "relevant or irrelevant",
        "kept": "share of runs in which it is kept: power, or the size of the test",
        "low": "low end of the exact 95% binomial interval",
        "high": "its high end",
        "n_runs": "samples of n tasks",
    },
    seconds={"smoke": 1, "book": 45, "thesis": 210},
)


FAMILIES: Mapping[str, Callable[[], Domain]] = {
    "triangle": triangle,
    "cliff": continuing_cliff,
    "stock G=1": lambda: stock(1, 2, 1),
    "stock G=3": lambda: stock(1, 2, 3),
    "stock S=2": lambda: stock(2, 2, 1),
    "random MDP a": lambda: random_domain(101),
    "random MDP b": lambda: random_domain(202, relevant=3, irrelevant=2, signal=1.0),
    "torus": torus,
}
"""Domains of the thesis, and three families of ours: stock with two sectors, random MDPs with
planted features, and a gridworld with distractors."""

NEW = ("stock S=2", "random MDP a", "random MDP b", "torus")
"""Domains that neither the thesis nor our earlier work used."""

SELECTORS: Mapping[str, Callable[[], Selector]] = {
    "fs-tek": lambda: FSTEK(1e-4),
    "fs-tek schedule": lambda: FSTEK(triangle_alpha),
    "ibkr": lambda: IBKR(),
    "jackknife": lambda: JackknifeF(),
    "jackknife box": lambda: JackknifeF(null="box"),
}
"""Selectors compared in ROC space."""


@dataclass(frozen=True)
class RocConfig:
    """Settings of the comparison in ROC space."""

    runs: int = 200
    """Sequences of tasks a domain."""
    tasks_seen: tuple[int, ...] = (4, 6, 8, 12, 20)
    """Numbers of observed tasks."""
    domains: tuple[str, ...] = tuple(FAMILIES)
    """Domains."""


def run_roc(config: RocConfig, context: Context) -> pd.DataFrame:
    """Compare selectors in ROC space; columns are documented in :data:`ROC`."""

    def one(name: str) -> list[dict[str, float | str | int | bool]]:
        solutions = exact_solutions(FAMILIES[name]())
        truth = ExactRelevance().fit(solutions).support_
        if name == "cliff":
            truth = truth & ~solutions.mask(POSITION)
        support = np.empty(
            (len(SELECTORS), len(config.tasks_seen), config.runs, len(truth)), dtype=bool
        )
        # A stream of its own: no experiment that led to the selector has used it.
        seeds = context.seeds(config.runs, 8, tuple(FAMILIES).index(name))
        for r, seed in enumerate(seeds):
            tasks = np.random.default_rng(seed).integers(
                solutions.n_tasks, size=max(config.tasks_seen)
            )
            for j, n in enumerate(config.tasks_seen):
                seen = solutions.take(tasks[:n])
                for i, make in enumerate(SELECTORS.values()):
                    support[i, j, r] = make().fit(seen).support_
        records = []
        for i, method in enumerate(SELECTORS):
            for j, n in enumerate(config.tasks_seen):
                fpr, tpr = rates(support[i, j], truth)
                wrong = support[i, j][:, ~truth].mean(axis=1)
                right = support[i, j][:, truth].mean(axis=1)
                half = 1.96 / np.sqrt(config.runs)
                records.append(
                    {
                        "domain": name,
                        "new": name in NEW,
                        "method": method,
                        "tasks_seen": n,
                        "fpr": fpr,
                        "fpr_ci95": half * float(wrong.std(ddof=1)),
                        "tpr": tpr,
                        "tpr_ci95": half * float(right.std(ddof=1)),
                        "exact": float((support[i, j] == truth).all(axis=1).mean()),
                        "n_runs": config.runs,
                    }
                )
        return records

    return rows([r for part in context.map(one, config.domains, "roc") for r in part])


ROC: Experiment[RocConfig] = Experiment(
    id="selector-roc",
    item="Jackknife F (ROC)",
    title="False and true positive rates of FS-TEK, IBKR and the jackknife F on eight domains.",
    function=run_roc,
    budgets={
        "smoke": RocConfig(runs=2, tasks_seen=(4,), domains=("triangle", "random MDP a")),
        "book": RocConfig(),
        "thesis": RocConfig(runs=500),
    },
    columns={
        "domain": "name",
        "new": "whether neither the thesis nor the earlier notes used it",
        "method": "selector; fs-tek at 1e-4 or by the triangle's schedule",
        "tasks_seen": "number of observed tasks n",
        "fpr": "share of the domain-irrelevant features kept",
        "fpr_ci95": "half-width of its 95% interval over runs",
        "tpr": "share of the domain-relevant features kept",
        "tpr_ci95": "half-width of its 95% interval over runs",
        "exact": "share of runs with exactly the relevant features kept",
        "n_runs": "sequences of tasks",
    },
    seconds={"smoke": 1, "book": 80, "thesis": 190},
)
