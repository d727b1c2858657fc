"""Figures 4.1 and 4.2: k-relevance on the triangle, and what a sequence's relevance is made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import numpy as np
import pandas as pd

from thesis_lib.domains import Domain, stock, triangle
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.mdp import planning
from thesis_lib.relevance import (
    Solutions,
    k_relevance,
    keep,
    list_sequences,
    remove,
    sequence_covariance,
)
from thesis_lib.relevance.exact import Direction


def exact_solutions(domain: Domain) -> Solutions:
    """Optimal solutions of every task of a domain."""
    return Solutions.from_domain(domain, [planning.solve(task).q for task in domain.tasks])


@dataclass(frozen=True)
class CurveConfig:
    """Settings of figure 4.1."""

    longest: int = 20
    """Largest k."""


def run_figure_4_1(config: CurveConfig, context: Context) -> pd.DataFrame:
    """Compute figure 4.1; columns are documented in :data:`FIGURE_4_1`."""
    solutions = exact_solutions(triangle())
    k = np.arange(1, config.longest + 1)
    records = []
    for direction in get_args(Direction):
        # Alone, a feature explains (forward) or its removal loses (backward).
        abstraction = keep if direction == "forward" else remove
        for feature in solutions.feature_names:
            labels = abstraction(solutions, [feature])
            curve = k_relevance(solutions, labels, k, direction=direction)
            records += [
                {"feature": feature, "direction": direction, "k": int(i), "relevance": float(rho)}
                for i, rho in zip(k, curve, strict=True)
            ]
    return rows(records)


FIGURE_4_1: Experiment[CurveConfig] = Experiment(
    id="figure-4.1",
    item="Figure 4.1",
    title="k-relevance of single features of the triangle, exactly, in both directions.",
    function=run_figure_4_1,
    budgets={
        "smoke": CurveConfig(longest=12),
        "book": CurveConfig(),
        "thesis": CurveConfig(),
    },
    columns={
        "feature": "x1 state, x2 inverse squared distance, x3 colour, a action",
        "direction": "forward: variance the feature alone explains, which is what the figure "
        "shows; backward: error made by removing it",
        "k": "sequence length",
        "relevance": "k-relevance, squared reward",
    },
    seconds={"smoke": 1, "book": 1, "thesis": 1},
)


@dataclass(frozen=True)
class SequenceConfig:
    """Settings of figure 4.2."""

    tasks: tuple[int, int, int] = (0, 1, 4)
    """Three tasks of stock trading with G = 1 that make the domain; they share p(x|m)."""
    distribution: tuple[float, float, float] = (0.5, 0.25, 0.25)
    """D, as printed."""
    removed: str = "a"
    """The abstraction removes this feature."""
    longest: int = 3
    """Largest k."""


def run_figure_4_2(config: SequenceConfig, context: Context) -> pd.DataFrame:
    """Compute figure 4.2; columns are documented in :data:`FIGURE_4_2`."""
    solutions = exact_solutions(stock(1, 2, 1)).take(np.array(config.tasks))
    labels = remove(solutions, [config.removed])
    records = []
    for k in range(1, config.longest + 1):
        sequences, probability = list_sequences(3, k, config.distribution)
        for c, p in zip(sequences, probability, strict=True):
            matrix = sequence_covariance(solutions, labels, c)
            name = "".join(str(i + 1) for i in c)
            records += [
                {
                    "k": k,
                    "sequence": name,
                    "probability": float(p),
                    "i": i + 1,
                    "j": j + 1,
                    "covariance": float(matrix[i, j]),
                    "relevance": float(matrix.mean()),
                }
                for i in range(k)
                for j in range(k)
            ]
    return rows(records)


FIGURE_4_2: Experiment[SequenceConfig] = Experiment(
    id="figure-4.2",
    item="Figure 4.2",
    title="Sequences of three stock tasks: probabilities, covariance matrices, relevance.",
    function=run_figure_4_2,
    budgets={
        "smoke": SequenceConfig(longest=2),
        "book": SequenceConfig(),
        "thesis": SequenceConfig(),
    },
    columns={
        "k": "sequence length",
        "sequence": "tasks 1, 2, 3 in order",
        "probability": "of the sequence under D",
        "i": "row of the covariance matrix",
        "j": "column",
        "covariance": "element, squared reward; its weight is 1/k^2",
        "relevance": "of the sequence: the mean of its matrix",
    },
    seconds={"smoke": 1, "book": 1, "thesis": 1},
)
