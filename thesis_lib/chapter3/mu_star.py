"""Section 3.3.5: what the thesis's genetic algorithm and exact gradients find."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from itertools import product
from typing import Literal

import numpy as np
import pandas as pd

from thesis_lib.chapter3.runs import SETTINGS
from thesis_lib.edition.criteria import judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.words import number
from thesis_lib.potentials.cross_task_policy import GeneticAlgorithm, gradient_ascent
from thesis_lib.potentials.cross_task_problem import CrossTaskProblem


@dataclass(frozen=True)
class Config:
    """How hard each search for the cross-task policy tries."""

    domains: tuple[str, ...] = tuple(SETTINGS)
    """Domains of chapter 3."""
    objectives: tuple[Literal["start", "stationary"], ...] = ("start", "stationary")
    """Equation 3.9 with start-state weights, and equation 3.11."""
    ga: GeneticAlgorithm = field(default_factory=GeneticAlgorithm)
    """The genetic algorithm of footnote 2."""
    ga_runs: int = 2
    """Runs of the genetic algorithm."""
    restarts: int = 20
    """Starting points of the exact gradient search."""


@dataclass(frozen=True)
class Search:
    """What one search for the cross-task policy reaches."""

    domain: str
    """Which domain."""
    objective: str
    """start (3.9 with start-state weights) or stationary (3.11)."""
    method: str
    """uniform policy, ga (footnote 2) or gradient (exact, with restarts)."""
    value: float
    """Best objective reached."""
    worst: float
    """Worst objective over runs or restarts."""
    n: int
    """Runs or restarts."""
    cpu_seconds: float
    """Processor time of them all."""


@experiment(
    "ch3-mu-star",
    item="Section 3.3.5, the cross-task policy",
    smoke=Config(domains=("triangle",), ga=GeneticAlgorithm(generations=5), ga_runs=1, restarts=2),
    book=Config(ga_runs=1, restarts=10),
    thesis=Config(),
    seconds=55,
    claims_read={"domains": ("episodic cliff",)},
)
def searches(config: Config, context: Context) -> list[Search]:
    """Value of the best cross-task policy found by the thesis's GA and by exact gradients."""

    def one(job: tuple[str, Literal["start", "stationary"]]) -> list[Search]:
        name, objective = job
        domain = SETTINGS[name].domain()
        problem = CrossTaskProblem(domain, objective)
        uniform = float(problem.value(np.full(domain.shape, 1 / domain.shape[1])))
        seeds = context.seeds(config.ga_runs + 1, list(SETTINGS).index(name))
        clock = time.thread_time()
        genetic = [config.ga.search(problem, np.random.default_rng(s)).value for s in seeds[1:]]
        spent = time.thread_time() - clock
        clock = time.thread_time()
        best = gradient_ascent(problem, np.random.default_rng(seeds[0]), restarts=config.restarts)
        reached = best.history
        found = (
            ("uniform", uniform, uniform, 1, 0.0),
            ("ga", max(genetic), min(genetic), len(genetic), round(spent, 2)),
            ("gradient", best.value, float(reached.min()), len(reached),
             round(time.thread_time() - clock, 2)),
        )  # fmt: skip
        return [Search(name, objective, *each) for each in found]

    jobs = list(product(config.domains, config.objectives))
    return [r for records in context.map(one, jobs, "mu*") for r in records]


@criterion("3.3.5-ga-missed-mu-star", searches)
def ga_misses_mu_star(table: pd.DataFrame) -> Finding:
    """Whether every run of the GA stays below exact gradients that search, on the cliff."""
    by = table[table.domain == "episodic cliff"].set_index(["objective", "method"])
    missed = {}
    for objective in dict.fromkeys(by.index.get_level_values("objective")):
        values = (float(by.value[objective, m]) for m in ("uniform", "ga", "gradient"))
        uniform, ga, gradient = values
        told = (
            f"{number(ga)}, {number(gradient)} and {number(uniform)} by the objective with "
            f"{objective} weights"
        )
        missed[told] = gradient > uniform and (gradient - ga) / abs(gradient) > 0.01
    held = sum(missed.values())
    every = "either objective" if held == len(missed) else f"{held or 'none'} of the objectives"
    return judged(
        held == len(missed),
        "On the episodic cliff the GA's best run stays more than 1% below exact gradients, which "
        f"find better than the uniform policy, by {every}: {'; '.join(missed)}.",
        {"held": held, "of": len(missed)},
        direction=held,
        # That no better policy was found does not say that there is none.
        otherwise=Verdict.INCONCLUSIVE,
    )


POOR = -1000.0
"""What earns less an episode on the cliff earns little."""


@criterion("3.3.5-mu-star-is-poor", searches)
def mu_star_is_poor_itself(table: pd.DataFrame) -> Finding:
    """Whether even the best policy found, by a search that finds something, earns little."""
    at = table[(table.domain == "episodic cliff") & (table.objective == "start")]
    uniform = float(at[at.method == "uniform"].value.iloc[0])
    best = float(at[at.method != "uniform"].value.max())
    searched = Verdict.NOT_REPRODUCED if best > uniform else Verdict.INCONCLUSIVE
    return Finding(
        Verdict.REPRODUCED if uniform < best < POOR else searched,
        f"The best cross-task policy found earns {number(round(best))} an episode, the uniform one "
        f"{number(round(uniform))}.",
        {"best": best, "uniform": uniform},
    )


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """What each search reaches, one row a domain and objective."""
    wide = table.pivot(index=["domain", "objective"], columns="method", values="value")
    wide = wide.reindex(columns=["uniform", "ga", "gradient"])
    gap = (wide["gradient"] - wide["ga"]) / wide["gradient"].abs()
    text = wide.map(lambda v: number(v) if abs(v) > 1e-9 else "0")
    text["gap"] = gap.map("{:.1%}".format)
    search = table[table.method == "gradient"].set_index(["domain", "objective"])
    text["worst"] = search.worst.map(number)
    starts = f"worst of {search.n.max()} starts"
    text.columns = ["uniform", "GA (footnote 2)", "exact gradients", "GA below by", starts]
    order = dict.fromkeys(zip(table.domain, table.objective, strict=True))
    return text.reindex(list(order)).reset_index()
