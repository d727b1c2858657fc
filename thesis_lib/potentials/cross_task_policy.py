r"""The best single policy for all tasks of a domain, :math:`\mu^*` (section 3.3.5).

A cross-task policy :math:`\mu(s, a)` is the same in every task: stationary, stochastic
and memoryless, the task being hidden from it.  The thesis searches it with a genetic
algorithm (footnote 2).  Here stand that search and ours, which follows the exact gradient, so
that one can tell whether a search missed the optimum; what they maximise is in
:mod:`thesis_lib.potentials.cross_task_problem`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import optimize

from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.checks import one_of, positive_integer
from thesis_lib.potentials.cross_task_problem import CrossTaskProblem, softmax_policy


@dataclass(frozen=True)
class SearchResult:
    """A policy found by a search, and how the search went.

    Attributes
    ----------
    policy
        Shape ``(O, A)``.
    value
        Its objective.
    history
        Best objective so far: one a generation, or one a restart.
    """

    policy: FloatArray
    value: float
    history: FloatArray


@dataclass(frozen=True)
class GeneticAlgorithm:
    """The genetic algorithm of footnote 2, with what it leaves unsaid as options.

    Stated: population 100, no crossover, each gene mutated with probability .5 by a
    uniform draw from [-0.05, 0.05], policies by a softmax over the chromosome.

    Attributes
    ----------
    population, mutation_probability, mutation_size
        As stated.
    generations
        Not stated.
    selection
        Not stated.  ``"truncation"``: the best half each have two children.
        ``"tournament"``: each parent is the better of two drawn at random.
        ``"roulette"``: parents are drawn in proportion to their rank.
    elite
        Not stated: how many of the best survive unchanged.
    initial
        Not stated: chromosomes start uniform in [-initial, initial].
    """

    population: int = 100
    mutation_probability: float = 0.5
    mutation_size: float = 0.05
    generations: int = 1000
    selection: Literal["truncation", "tournament", "roulette"] = "truncation"
    elite: int = 1
    initial: float = 1.0

    def __post_init__(self) -> None:
        one_of("selection", self.selection, ("truncation", "tournament", "roulette"))
        if self.population < 2 or not 0 <= self.elite < self.population or self.generations < 1:
            raise ValueError(
                f"population {self.population}, elite {self.elite}, generations "
                f"{self.generations}: the population needs at least 2, the elite fewer than the "
                "population, and at least 1 generation."
            )

    def search(self, problem: CrossTaskProblem, rng: np.random.Generator) -> SearchResult:
        """Search for the best cross-task policy.

        Parameters
        ----------
        problem
            The objective.
        rng
            Source of all randomness.

        Returns
        -------
        SearchResult
            The best of all policies seen; ``history`` has one entry a generation.
        """
        shape = (self.population, *problem.domain.shape)
        genes = rng.uniform(-self.initial, self.initial, shape)
        history = np.empty(self.generations)
        best, best_value = genes[0], -np.inf
        for generation in range(self.generations):
            fitness = problem.value(softmax_policy(genes))
            order = np.argsort(-fitness, kind="stable")
            if fitness[order[0]] > best_value:
                best, best_value = genes[order[0]].copy(), float(fitness[order[0]])
            history[generation] = best_value
            parents = genes[self._parents(order, rng)]
            mutate = rng.random(shape) < self.mutation_probability
            step = rng.uniform(-self.mutation_size, self.mutation_size, shape)
            children = parents + np.where(mutate, step, 0.0)
            children[: self.elite] = genes[order[: self.elite]]
            genes = children
        return SearchResult(softmax_policy(best), best_value, history)

    def _parents(self, order: IntArray, rng: np.random.Generator) -> IntArray:
        n = self.population
        if self.selection == "truncation":
            best = order[: max(1, n // 2)]
            return np.resize(best, n)
        if self.selection == "tournament":
            # Ranks: the smaller of two random ranks wins.
            return order[rng.integers(n, size=(n, 2)).min(axis=1)]
        weight = np.arange(n, 0, -1, dtype=float)
        return rng.choice(order, size=n, p=weight / weight.sum())


def gradient_ascent(
    problem: CrossTaskProblem,
    rng: np.random.Generator,
    *,
    restarts: int = 20,
    spread: float = 2.0,
    bound: float = 8.0,
    max_iterations: int = 500,
) -> SearchResult:
    """Search for the best cross-task policy by exact gradients (L-BFGS-B) and restarts.

    Parameters
    ----------
    problem
        The objective.
    rng
        Source of the starting points.
    restarts
        How many starting points; the first is the uniform policy.
    spread
        Standard deviation of the starting preferences.
    bound
        Preferences stay within plus and minus this: a deterministic policy is approached to
        within exp(-2 bound), but with a discount of 1 no policy loops for ever.
    max_iterations
        For each restart.

    Returns
    -------
    SearchResult
        The best policy of all restarts; ``history`` has the value each restart reached.
    """
    positive_integer("restarts", restarts)
    shape = problem.domain.shape
    reached = np.empty(restarts)
    best, best_value = np.zeros(shape), -np.inf

    def negative(flat: FloatArray) -> tuple[float, FloatArray]:
        value, gradient = problem.gradient(flat.reshape(shape))
        return -value / scale, -gradient.ravel() / scale

    # A value of order one keeps the optimiser's tolerances meaningful.
    scale = max(1.0, abs(float(problem.value(np.full(shape, 1.0 / shape[1])))))
    for i in range(restarts):
        first = np.zeros(shape) if i == 0 else rng.normal(0.0, spread, shape)
        found = optimize.minimize(
            negative,
            np.clip(first, -bound, bound).ravel(),
            jac=True,
            method="L-BFGS-B",
            bounds=[(-bound, bound)] * first.size,
            options={"maxiter": max_iterations, "ftol": 1e-14, "gtol": 1e-10},
        )
        reached[i] = problem.value(softmax_policy(found.x.reshape(shape)))
        if reached[i] > best_value:
            best, best_value = found.x.reshape(shape), float(reached[i])
    return SearchResult(softmax_policy(best), best_value, reached)
