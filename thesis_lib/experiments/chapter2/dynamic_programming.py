"""How fast policy and value iteration converge on the cliff (section 2.3.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from thesis_lib.domains.cliff import cliff_task, layouts
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.mdp.model import TabularMDP
from thesis_lib.mdp.planning import policy_iteration, solve, value_iteration


@dataclass(frozen=True)
class SweepsConfig:
    """Settings of section-2.3.2."""

    tolerance: float = 1e-6
    """Sweeps go on until no value is further than this from the optimum."""
    discount: float = 0.9
    """gamma below 1; the episodic task is solved with 1 as well."""


def tasks(config: SweepsConfig) -> list[tuple[str, TabularMDP]]:
    """The forms of the cliff that are solved: episodic with gamma = 1 and below, continuing."""
    where = layouts()[0]
    forms = ((False, 1.0), (False, config.discount), (True, config.discount))
    return [
        (
            "continuing" if continuing else "episodic",
            cliff_task(where, continuing=continuing, sensor=False, discount=discount),
        )
        for continuing, discount in forms
    ]


def sweeps(config: SweepsConfig, context: Context) -> pd.DataFrame:
    """Distance from the optimal values after each sweep through the states."""
    records = []
    for name, mdp in tasks(config):
        optimum = solve(mdp)
        curves: dict[str, list[tuple[int, float]]] = {}
        for method, synchronous in (("value iteration", False), ("synchronous", True)):
            run = value_iteration(
                mdp, optimum=optimum.q, tolerance=config.tolerance, synchronous=synchronous
            )
            assert run.errors is not None
            curves[method] = list(enumerate(run.errors.tolist()))
        rounds = policy_iteration(mdp, theta=config.tolerance)
        ends = np.cumsum(rounds.sweeps)
        distance = np.abs(rounds.values - optimum.v).max(axis=1)
        curves["policy iteration"] = list(zip(ends.tolist(), distance.tolist(), strict=True))
        for method, curve in curves.items():
            first = curve[0][1]
            for sweep, error in curve:
                contracts = mdp.discount < 1 and method != "policy iteration"
                records.append(
                    {
                        "task": name,
                        "discount": mdp.discount,
                        "method": method,
                        "sweep": sweep,
                        "error": error,
                        "bound": first * mdp.discount**sweep if contracts else np.nan,
                    }
                )
    return rows(records)


SECTION_2_3_2 = Experiment(
    id="section-2.3.2",
    item="Section 2.3.2",
    title="Sweeps of policy and value iteration on the cliff until the values are optimal",
    function=sweeps,
    budgets={"smoke": SweepsConfig(), "book": SweepsConfig(), "thesis": SweepsConfig()},
    columns={
        "task": "episodic (section 3.4.1) or continuing (section 3.4.2)",
        "discount": "gamma",
        "method": "value iteration (in place, algorithm 2), synchronous, or policy iteration",
        "sweep": "number of sweeps; policy iteration: at the end of each round of evaluation",
        "error": "largest distance of a value from the optimal one",
        "bound": "gamma to the power of the sweep, times the first error; none for gamma = 1",
    },
    seconds={"smoke": 0.1, "book": 0.1, "thesis": 0.1},
)
