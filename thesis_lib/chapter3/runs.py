"""What the results of chapter 3 share: domains, named potentials, runs of a learner, their look."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any, Literal

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from thesis_lib import potentials
from thesis_lib.arrays import FloatArray
from thesis_lib.checks import one_of
from thesis_lib.domains import Domain, continuing_cliff, episodic_cliff, stock, triangle
from thesis_lib.edition.criteria import Pair, summary
from thesis_lib.edition.experiment import Context, Returns, returns
from thesis_lib.edition.plots import COLOURS, band, legend_of
from thesis_lib.mdp.batched import TaskBatch
from thesis_lib.mdp.learning import Method
from thesis_lib.mdp.sampling import loop_array
from thesis_lib.potentials import Weighting
from thesis_lib.potentials.cross_task_policy import GeneticAlgorithm, gradient_ascent
from thesis_lib.potentials.cross_task_problem import CrossTaskProblem

Potential = Literal["none", "Q_star", "Q_tilde", "Q_mu", "constant"]
POTENTIALS: tuple[Potential, ...] = ("none", "Q_star", "Q_tilde", "Q_mu", "constant")

SHAPED = ("Q_star", "Q_tilde", "Q_mu")
"""The potentials of the thesis."""

SYMBOLS: Mapping[str, str] = {
    "none": "no shaping",
    "Q_star": r"$Q^*_d$",
    "Q_tilde": r"$\tilde Q_d$",
    "Q_tilde_sarsa": r"$\tilde Q_d$ by Sarsa",
    "Q_mu": r"$Q^\mu_d$",
    "constant": "constant",
}
"""How figures and tables name the potentials."""

NAMES: Mapping[str, str] = {
    **{"none": "no shaping", "Q_star": "Q*", "Q_tilde": "Q~", "Q_tilde_sarsa": "Q~ by Sarsa"},
    **{"Q_mu": "Q^μ", "constant": "a constant potential"},
}
"""How sentences name them."""

LEARNERS: Mapping[str, str] = {
    "q_learning": "Q-learning",
    "sarsa": "Sarsa",
    "expected_sarsa": "Expected Sarsa",
    "double_q_learning": "Double Q-learning",
}

COLOUR: Mapping[str, str] = {
    **{"none": "#7f7f7f", "Q_star": COLOURS[0], "Q_tilde": COLOURS[1]},
    **{"Q_tilde_sarsa": COLOURS[4], "Q_mu": COLOURS[2], "constant": COLOURS[3]},
}
DASH: Mapping[str, str] = {"none": ":", "constant": "--"}


@dataclass(frozen=True)
class MuSearch:
    """How the cross-task policy of Q_mu is found and its values averaged."""

    method: Literal["gradient", "ga"] = "gradient"
    """Exact gradients with restarts, or the genetic algorithm of footnote 2."""
    restarts: int = 10
    """Starting points of ``gradient_ascent``."""
    ga: GeneticAlgorithm = field(default_factory=GeneticAlgorithm)
    """Settings of ``ga``."""
    objective: Literal["start", "stationary"] = "stationary"
    """Equation 3.9 with start-state weights, or equation 3.11."""
    weights: Weighting = "stationary"
    """p(x|m) of Q_mu; the stationary distribution "was found to work best in most cases"."""

    def policy(self, domain: Domain, seed: int) -> FloatArray:
        """The cross-task policy, shape ``(O, A)``; kept for the next result that wants it."""
        key = domain.digest, replace(self, weights="stationary"), seed
        if key not in _POLICIES:
            problem = CrossTaskProblem(domain, self.objective)
            rng = np.random.default_rng(seed)
            if self.method == "ga":
                found = self.ga.search(problem, rng).policy
            else:
                found = gradient_ascent(problem, rng, restarts=self.restarts).policy
            found.flags.writeable = False
            _POLICIES[key] = found
        return _POLICIES[key]

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


_POLICIES: dict[tuple[str, MuSearch, int], FloatArray] = {}


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
    return {name: make[one_of("potential", name, make)]() for name in names}


@dataclass(frozen=True)
class TabularLearner:
    """A learner with its settings and budget; exactly one of episodes and steps."""

    method: Method
    alpha: float
    epsilon: float
    episodes: int | None = None
    steps: int | None = None

    @property
    def settings(self) -> dict[str, Any]:
        """What :func:`~thesis_lib.mdp.learning.learn` takes beside the task and the method."""
        return {k: getattr(self, k) for k in ("alpha", "epsilon", "episodes", "steps")}


def total_rewards(
    context: Context,
    domain: Domain,
    cells: Sequence[tuple[TabularLearner, FloatArray]],
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
    rows = [loop_array(index, np.int64) for index in domain.observation_index]

    def one(job: tuple[int, tuple[TabularLearner, FloatArray]]) -> FloatArray:
        i, (learner, phi) = job
        seeds = context.seeds(len(domain) * repeats, i)
        batch = TaskBatch(domain.tasks, rows, learner.method, **learner.settings)
        return np.stack(
            [
                batch.total_rewards(phi, [np.random.default_rng(s) for s in seeds[r::repeats]])
                for r in range(repeats)
            ],
            axis=1,
        )

    return np.array(context.map(one, list(enumerate(cells)), label))


@dataclass(frozen=True)
class Setting:
    """A domain with the learners its figure or table uses.

    Attributes
    ----------
    domain
        Builds the domain.
    learners
        TabularLearner settings: those printed, or the best found in the figure's sweep.
    """

    domain: Callable[[], Domain]
    learners: tuple[TabularLearner, ...]


SETTINGS: Mapping[str, Setting] = {
    "episodic cliff": Setting(
        lambda: episodic_cliff(False),
        (
            TabularLearner("q_learning", 1.0, 0.1, episodes=600),
            TabularLearner("sarsa", 0.4, 0.1, episodes=600),
        ),
    ),
    "episodic cliff with sensor": Setting(
        lambda: episodic_cliff(True),
        (
            TabularLearner("q_learning", 1.0, 0.1, episodes=600),
            TabularLearner("sarsa", 0.4, 0.1, episodes=600),
        ),
    ),
    "continuing cliff": Setting(
        lambda: continuing_cliff(0.95),
        (
            TabularLearner("q_learning", 0.1, 0.01, steps=20_000),
            TabularLearner("sarsa", 0.1, 0.01, steps=20_000),
        ),
    ),
    "triangle": Setting(triangle, (TabularLearner("q_learning", 0.5, 0.01, episodes=10),)),
    "stock": Setting(
        lambda: stock(1, 2, 2, discount=0.9), (TabularLearner("q_learning", 0.2, 0.1, steps=300),)
    ),
}
"""The domains of chapter 3 by name."""


@dataclass(frozen=True)
class SweepReturn(Returns):
    """Return of a learner at one learning and one exploration rate."""

    algorithm: str
    """The learner."""
    epsilon: float
    """Exploration rate."""
    potential: str
    """none, Q_star, Q_tilde, Q_mu, constant."""
    alpha: float
    """Learning rate."""


def sweep(
    context: Context,
    domain: Domain,
    *,
    names: Sequence[str],
    alphas: Sequence[float],
    epsilons: Sequence[float],
    mu: MuSearch,
    repeats: int,
    episodes: int | None = None,
    steps: int | None = None,
) -> list[dict[str, Any]]:
    """Fields of a :class:`SweepReturn` of Q-learning for every exploration rate, potential, alpha.

    Parameters
    ----------
    context, domain, repeats
        As for :func:`total_rewards`.
    names, mu
        As for :func:`named_potentials`.
    alphas, epsilons
        Learning and exploration rates.
    episodes, steps
        Budget of a run, exactly one of them.
    """
    keys = list(product(epsilons, names, alphas))
    phi = {
        epsilon: named_potentials(domain, names, epsilon=epsilon, mu=mu, seed=context.seed)
        for epsilon in epsilons
    }
    cells = [
        (
            TabularLearner("q_learning", alpha, epsilon, episodes=episodes, steps=steps),
            phi[epsilon][name],
        )
        for epsilon, name, alpha in keys
    ]
    totals = total_rewards(context, domain, cells, repeats, domain.name)
    return [
        {
            **{"algorithm": "q_learning", "epsilon": epsilon, "potential": name, "alpha": alpha},
            **returns(total),
        }
        for (epsilon, name, alpha), total in zip(keys, totals, strict=True)
    ]


def log_grid(low: float, high: float, n: int) -> tuple[float, ...]:
    """Learning rates, n of them, from low to high, evenly spaced in the logarithm."""
    return tuple(float(f"{v:.3g}") for v in np.geomspace(low, high, n))


def compared(table: pd.DataFrame, first: str, second: str, where: str = "") -> Pair:
    """Two potentials of a table with one row a potential, as a criterion takes them."""
    by = table.set_index("potential")
    names = (NAMES[first], NAMES[second])
    return Pair(summary(by.loc[first]), summary(by.loc[second]), names, where)


def at_best(table: pd.DataFrame) -> pd.DataFrame:
    """The best row of each potential over all else in a table, such as the learning rate."""
    return table.loc[table.groupby("potential", sort=False).mean_return.idxmax()]


def over_alpha(ax: Axes, table: pd.DataFrame, *, log: bool = False) -> None:
    """Mean return over the learning rate with 95% bands, one line a potential."""
    curves(ax, table, "alpha", marker="o", ms=3)
    if log:
        ax.set_xscale("log")
    ax.set_xlabel(r"learning rate $\alpha$")


def curves(ax: Axes, table: pd.DataFrame, x: str, **look: Any) -> None:
    """Mean return with 95% bands over a column, one line a potential."""
    for name, own in table.groupby("potential", sort=False):
        band(
            ax,
            own.sort_values(x),
            x,
            label=SYMBOLS[name],
            color=COLOUR[name],
            ls=DASH.get(name, "-"),
            **look,
        )


def learning_rate_figure(
    table: pd.DataFrame, panels: Mapping[str, pd.Series], ylabel: str, *, log: bool = False
) -> Figure:
    """Return over the learning rate, one panel each choice of rows."""
    fig, axes = plt.subplots(1, len(panels), figsize=(7.2, 3.4), sharey=not log, squeeze=False)
    for ax, (title, rows) in zip(axes[0], panels.items(), strict=True):
        over_alpha(ax, table[rows], log=log)
        ax.set_title(title)
    axes[0, 0].set_ylabel(ylabel)
    legend_of(axes[0, 0], 5, fontsize=8)
    return fig
