"""FS-TEK as a threshold on an F-ratio: the threshold, and whether it makes the same decisions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.experiments.chapter4.families import random_solutions
from thesis_lib.relevance import estimate, remove
from thesis_lib.selection import FSTEK, f_threshold, fit_inverse, fstek_threshold

EVERY = 10**6
"""More combinations than there are: algorithm 8 lists them all, and the curve is fitted as is."""


@dataclass(frozen=True)
class ThresholdConfig:
    """Settings of the threshold curves."""

    tasks_seen: tuple[int, ...] = (*range(4, 21), 25, 30, 31, 32, 35, 40, 50)
    """Numbers of observed tasks."""
    alphas: tuple[float, ...] = (1e-4, 1e-3, 1e-2, 0.1, 0.3)
    """Levels of FS-TEK."""
    checked: tuple[int, ...] = (4, 5, 6, 7, 8, 9, 10)
    """Numbers of tasks at which decisions are compared; all combinations are listed there."""
    domains: int = 100
    """Random domains of three features at each."""


def run_threshold(config: ThresholdConfig, context: Context) -> pd.DataFrame:
    """Compute the thresholds; columns are documented in :data:`THRESHOLD`."""

    def one(n: int) -> list[dict[str, float | int]]:
        agree = np.zeros(len(config.alphas), dtype=int)
        removed = np.zeros(len(config.alphas), dtype=int)
        checked = np.zeros(len(config.alphas), dtype=int)
        domains = config.domains if n in config.checked else 0
        for index, seed in enumerate(context.seeds(domains, 9, n)):
            rng = np.random.default_rng(seed)
            solutions = random_solutions(rng, "shared", n, (2, 2, 2))
            # From pure noise to a common signal, so that decisions go both ways.
            common = rng.normal(size=solutions.n_pairs) * (index % 5) / 2
            q = solutions.q + common
            solutions = type(solutions)(q, solutions.p, solutions.features, ("f", "g", "h"))
            ratios = [estimate(solutions, remove(solutions, [i])).f_ratio for i in range(3)]
            for j, alpha in enumerate(config.alphas):
                first = FSTEK(alpha, max_seqs=EVERY).fit(solutions).history_[0]
                for check in first.checks:
                    goes = ratios[check.feature] <= fstek_threshold(n, alpha)
                    agree[j] += goes == (check.verdict == "remove")
                    removed[j] += check.verdict == "remove"
                    checked[j] += 1
        fit = fit_inverse(n)
        return [
            {
                "tasks_seen": n,
                "alpha": alpha,
                "threshold": fstek_threshold(n, alpha),
                "calibrated": f_threshold(n, 0.05),
                "asymptote": fit.asymptote,
                "standard_error": fit.standard_error,
                "agree": int(agree[j]),
                "removed": int(removed[j]),
                "n_decisions": int(checked[j]),
            }
            for j, alpha in enumerate(config.alphas)
        ]

    return rows([r for part in context.map(one, config.tasks_seen, "threshold") for r in part])


THRESHOLD: Experiment[ThresholdConfig] = Experiment(
    id="fs-tek-threshold",
    item="FS-TEK explained",
    title="The F-ratio up to which FS-TEK removes a feature, and its decisions beside the rule's.",
    function=run_threshold,
    budgets={
        "smoke": ThresholdConfig(tasks_seen=(4, 5, 20), alphas=(1e-3,), checked=(4,), domains=3),
        "book": ThresholdConfig(),
        "thesis": ThresholdConfig(domains=300),
    },
    columns={
        "tasks_seen": "number of observed tasks n",
        "alpha": "level of FS-TEK",
        "threshold": "F-ratio up to which it removes a feature",
        "calibrated": "F-ratio up to which the jackknife F-test removes one, at 5%",
        "asymptote": "h(n) of the fit to 1/k",
        "standard_error": "sigma(n) of the fit to 1/k",
        "agree": "decisions of algorithm 7, fitted to sequences listed by algorithm 8, that the "
        "threshold predicts",
        "removed": "decisions to remove among them",
        "n_decisions": "decisions compared",
    },
    seconds={"smoke": 1, "book": 6, "thesis": 15},
)
