"""What the experiments of chapter 3 share: named potentials, and runs of a learner."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from thesis_lib import potentials
from thesis_lib.arrays import FloatArray
from thesis_lib.domains import Domain
from thesis_lib.edition.experiment import Context
from thesis_lib.mdp.learning import Method, learn
from thesis_lib.potentials import Weighting
from thesis_lib.potentials.cross_task_policy import CrossTaskProblem, GeneticAlgorithm, climb

Potential = Literal["none", "Q_star", "Q_tilde", "Q_mu", "constant"]
POTENTIALS: tuple[Potential, ...] = ("none", "Q_star", "Q_tilde", "Q_mu", "constant")

SYMBOLS: Mapping[str, str] = {
    "none": "no shaping",
    "Q_star": r"$Q^*_d$",
    "Q_tilde": r"$\tilde Q_d$",
    "Q_tilde_sarsa": r"$\tilde Q_d$ by Sarsa",
    "Q_mu": r"$Q^\mu_d$",
    "constant": "constant",
}
"""How figures name the potentials."""


@dataclass(frozen=True)
class MuSearch:
    """How the cross-task policy of Q_mu is found and its values averaged."""

    method: Literal["climb", "ga"] = "climb"
    """Exact gradients with restarts, or the genetic algorithm of footnote 2."""
    restarts: int = 10
    """Starting points of ``climb``."""
    ga: GeneticAlgorithm = field(default_factory=GeneticAlgorithm)
    """Settings of ``ga``."""
    objective: Literal["start", "stationary"] = "stationary"
    """Equation 3.9 with start-state weights, or equation 3.11."""
    weights: Weighting = "stationary"
    """p(x|m) of Q_mu; the stationary distribution "was found to work best in most cases"."""

    def policy(self, domain: Domain, seed: int) -> FloatArray:
        """The cross-task policy, shape ``(O, A)``."""
        problem = CrossTaskProblem(domain, self.objective)
        rng = np.random.default_rng(seed)
        if self.method == "ga":
            return self.ga.search(problem, rng).policy
        return climb(problem, rng, restarts=self.restarts).policy

    def potential(self, domain: Domain, seed: int) -> FloatArray:
        r"""The potential :math:`Q^\mu_d`, shape ``(O, A)``."""
        mu = self.policy(domain, seed)
        if self.weights == "stationary":
            weights = potentials.pair_weights(
                domain, "stationary", potentials.task_policies(domain, mu)
            )
        else:
            weights = potentials.pair_weights(domain, self.weights)
        return potentials.q_mu(domain, mu, weights)


def named_potentials(
    domain: Domain,
    names: Iterable[str],
    *,
    epsilon: float,
    mu: MuSearch,
    seed: int,
) -> dict[str, FloatArray]:
    """Potentials by name, each ``(O, A)``.

    ``constant`` is the mean of Q_star over all pairs, at every pair: the control that
    carries the level of the values and nothing else.
    """
    make = {
        "none": lambda: potentials.constant_potential(domain, 0.0),
        "Q_star": lambda: potentials.q_star(domain),
        "Q_tilde": lambda: potentials.q_tilde(domain, epsilon),
        "Q_mu": lambda: mu.potential(domain, seed),
        "constant": lambda: potentials.constant_potential(
            domain, float(np.mean(potentials.q_star(domain)))
        ),
    }
    unknown = [name for name in names if name not in make]
    if unknown:
        raise ValueError(f"potential {unknown[0]!r} does not exist: choose from {', '.join(make)}.")
    return {name: make[name]() for name in names}


@dataclass(frozen=True)
class Learner:
    """A learner with its settings and budget; exactly one of episodes and steps."""

    method: Method
    alpha: float
    epsilon: float
    episodes: int | None = None
    steps: int | None = None


def total_rewards(
    context: Context,
    domain: Domain,
    cells: Sequence[tuple[Learner, FloatArray]],
    repeats: int,
    label: str = "",
) -> FloatArray:
    """Total reward of each learner with each potential, on every task.

    Parameters
    ----------
    context
        Seed and workers.  Every cell has seeds of its own: independent samples.
    domain
        Each task is learned ``repeats`` times.
    cells
        Learner and potential ``(O, A)`` of each cell.
    repeats
        Runs a task.
    label
        Of the progress bar.

    Returns
    -------
    FloatArray
        Shape ``(cells, M, repeats)``.
    """

    def one(job: tuple[int, tuple[Learner, FloatArray]]) -> FloatArray:
        i, (learner, phi) = job
        seeds = context.seeds(len(domain) * repeats, i)
        rewards = np.empty((len(domain), repeats))
        for m, task in enumerate(domain.tasks):
            initial = domain.scatter(phi, m)
            for r in range(repeats):
                rewards[m, r] = learn(
                    task,
                    learner.method,
                    alpha=learner.alpha,
                    epsilon=learner.epsilon,
                    episodes=learner.episodes,
                    steps=learner.steps,
                    initial_q=initial,
                    rng=np.random.default_rng(seeds[m * repeats + r]),
                ).total_reward
        return rewards

    return np.array(context.map(one, list(enumerate(cells)), label))


def log_grid(low: float, high: float, n: int) -> tuple[float, ...]:
    """Learning rates, n of them, from low to high, evenly spaced in the logarithm."""
    return tuple(float(f"{v:.3g}") for v in np.geomspace(low, high, n))
