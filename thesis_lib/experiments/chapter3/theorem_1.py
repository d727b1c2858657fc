"""Theorem 1: how many sweeps value iteration takes from each initialisation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from thesis_lib import potentials
from thesis_lib.arrays import FloatArray
from thesis_lib.domains import Domain, continuing_cliff, episodic_cliff, stock, triangle
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.potentials import theorem_1

DOMAINS: Mapping[str, Callable[[float], Domain]] = {
    "episodic cliff": lambda discount: episodic_cliff(False, discount=discount),
    "episodic cliff with sensor": lambda discount: episodic_cliff(True, discount=discount),
    "continuing cliff": lambda discount: continuing_cliff(discount),
    "triangle": lambda discount: triangle(discount=discount),
    "stock": lambda discount: stock(1, 2, 2, discount=discount),
}


@dataclass(frozen=True)
class Theorem1Config:
    """Which domains and precisions theorem 1 is checked on."""

    domains: tuple[str, ...] = tuple(DOMAINS)
    """Domains, each with a discount below 1, as the theorem needs."""
    discount: float = 0.95
    """gamma."""
    tolerances: tuple[float, ...] = (1e-1, 1e-3, 1e-6)
    """epsilon, relative to the largest |Q*| of the domain."""
    smoothing: float = 0.1
    """tau of the smoothed objective, relative to the largest |Q*| of the domain."""
    n_random: int = 20
    """Random initialisations, uniform between the least and the largest Q*."""


def initialisations(
    domain: Domain, tables: list[FloatArray], config: Theorem1Config, rng: np.random.Generator
) -> dict[str, list[FloatArray]]:
    """The initialisations compared, by name; several where they are random or one a task."""
    stacked = domain.gather(tables)
    low, high = float(np.nanmin(stacked)), float(np.nanmax(stacked))
    scale = float(np.nanmax(np.abs(stacked)))
    mean = potentials.cross_task_values(domain, tables)
    middle = theorem_1.midrange(domain, tables)
    shape = domain.shape
    return {
        "Q_star": [mean],
        "geometric mean": [
            theorem_1.geometric_mean_minimiser(
                domain, tables, config.smoothing * scale, starts=(mean, middle)
            )
        ],
        "mean distance": [theorem_1.mean_distance_minimiser(domain, tables)],
        "midrange": [middle],
        "single task": [theorem_1.single_task(domain, tables, m, mean) for m in range(len(domain))],
        "zero": [np.zeros(shape)],
        "optimistic": [np.full(shape, high)],
        "constant": [np.full(shape, float(mean.mean()))],
        "random": [rng.uniform(low, high, shape) for _ in range(config.n_random)],
    }


def run(config: Theorem1Config, context: Context) -> pd.DataFrame:
    """Measured sweeps against the bound of (3.2); columns in :data:`THEOREM_1`."""

    def one(job: tuple[str, np.random.SeedSequence]) -> list[dict[str, object]]:
        name, seed = job
        domain = DOMAINS[name](config.discount)
        tables = potentials.optimal_solutions(domain)
        scale = float(np.nanmax(np.abs(domain.gather(tables))))
        found: list[dict[str, object]] = []
        for label, candidates in initialisations(
            domain, tables, config, np.random.default_rng(seed)
        ).items():
            for relative in config.tolerances:
                records = [_sweeps(domain, tables, q0, relative * scale) for q0 in candidates]
                held = (
                    [
                        _held_out(domain, tables, m, label, relative * scale, config, scale)
                        for m in range(len(domain))
                    ]
                    if label in HELD_OUT
                    else [np.nan]
                )
                found.append(
                    {
                        "domain": name,
                        "initialisation": label,
                        "tolerance": relative,
                        "sweeps": float(np.mean([r[0] for r in records])),
                        "bound": float(np.mean([r[1] for r in records])),
                        "excess": float(np.max([r[2] for r in records])),
                        "log_geometric_mean": float(np.mean([r[3] for r in records])),
                        "held_out_sweeps": float(np.mean(held)),
                        "n_initialisations": len(candidates),
                    }
                )
        return found

    jobs = list(zip(config.domains, context.seeds(len(config.domains), 1), strict=True))
    return rows([r for records in context.map(one, jobs, "theorem 1") for r in records])


HELD_OUT = ("Q_star", "geometric mean", "mean distance", "midrange")


def _sweeps(
    domain: Domain, tables: list[FloatArray], q0: FloatArray, tolerance: float
) -> tuple[float, float, float, float]:
    """Mean measured sweeps, mean bound, largest excess over the bound, and the objective."""
    delta = theorem_1.distances(domain, tables, q0)
    bound = theorem_1.sufficient_sweeps(delta, tolerance, domain.discount)
    measured = np.array([_measured(domain, tables, q0, m, tolerance) for m in range(len(domain))])
    # Rounding may put a distance a hair above the tolerance that the bound meets exactly.
    excess = measured - np.ceil(bound - 1e-6)
    return (
        float(domain.distribution @ measured),
        float(domain.distribution @ bound),
        float(excess.max()),
        theorem_1.log_geometric_mean(domain.distribution, delta),
    )


def _measured(
    domain: Domain, tables: list[FloatArray], q0: FloatArray, m: int, tolerance: float
) -> int:
    inside = (domain.observation_index[m] >= 0)[:, None]
    # A cell in which no action is taken starts at its own value: it is in no task's X_m.
    start = np.where(inside, domain.scatter(q0, m), tables[m])
    return theorem_1.measured_sweeps(domain.tasks[m], tables[m], start, tolerance)


def _held_out(
    domain: Domain,
    tables: list[FloatArray],
    m: int,
    label: str,
    tolerance: float,
    config: Theorem1Config,
    scale: float,
) -> float:
    """Sweeps on task m from an initialisation made of the other tasks."""
    others = [i for i in range(len(domain)) if i != m]
    weights = domain.distribution[others] / domain.distribution[others].sum()
    rest = Domain(
        f"{domain.name} without task {m}",
        [domain.tasks[i] for i in others],
        distribution=weights,
        members=[domain.observation_index[i] >= 0 for i in others],
    )
    own = [tables[i] for i in others]
    if label == "Q_star":
        small = potentials.cross_task_values(rest, own)
    elif label == "midrange":
        small = theorem_1.midrange(rest, own)
    elif label == "mean distance":
        small = theorem_1.mean_distance_minimiser(rest, own)
    else:
        mean = potentials.cross_task_values(rest, own)
        small = theorem_1.geometric_mean_minimiser(
            rest, own, config.smoothing * scale, starts=(mean,)
        )
    # Pairs that only the held-out task has get the mean of the others.
    q0 = np.full(domain.shape, float(small.mean()))
    place = {tuple(o): i for i, o in enumerate(domain.observations.tolist())}
    q0[[place[tuple(o)] for o in rest.observations.tolist()]] = small
    return float(_measured(domain, tables, q0, m, tolerance))


THEOREM_1: Experiment[Theorem1Config] = Experiment(
    id="theorem-1",
    item="Theorem 1",
    title="Sweeps of value iteration to within epsilon of Q*, by initialisation, and the bound.",
    function=run,
    budgets={
        "smoke": Theorem1Config(domains=("triangle",), tolerances=(1e-3,), n_random=2),
        "book": Theorem1Config(),
        "thesis": Theorem1Config(),
    },
    columns={
        "domain": "which domain",
        "initialisation": "what the sweeps start from",
        "tolerance": "epsilon over the largest |Q*| of the domain",
        "sweeps": "sweeps measured, mean over tasks (by D) and initialisations",
        "bound": "sweeps that (3.2) says are enough, the same mean",
        "excess": "largest number of sweeps beyond the bound rounded up; at most 0 if it holds",
        "log_geometric_mean": "the theorem's objective; minus infinity where it is degenerate",
        "held_out_sweeps": "sweeps on a task from the initialisation the other tasks give",
        "n_initialisations": "how many initialisations the means are over",
    },
    seconds={"smoke": 2, "book": 30, "thesis": 30},
)
