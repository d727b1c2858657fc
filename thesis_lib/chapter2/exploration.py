"""The exploration dilemma on the cliff (section 2.3.3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.chapter2.one_cliff import LEARNERS, Algorithm, greedy_path, task
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.mdp.learning import Learned, learn
from thesis_lib.mdp.planning import solve, start_value
from thesis_lib.stats import mean_ci


@dataclass(frozen=True)
class Config:
    """Which rates of exploration, and the learners' settings."""

    runs: int = 400
    """Runs of each setting."""
    episodes: int = 200
    """Episodes a run."""
    epsilons: tuple[float, ...] = (0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3)
    """Probabilities of a random action."""
    pessimistic: float = -1000.0
    """The low initial value of every pair; the high one is 0."""
    alpha_q_learning: float = 1.0
    """Learning rate of Q-learning."""
    alpha_sarsa: float = 0.4
    """Learning rate of Sarsa."""
    longest_episode: int = 10_000
    """An episode is cut off after so many steps."""


SETTINGS: tuple[tuple[Algorithm, str], ...] = (
    ("q_learning", "pessimistic"),
    ("q_learning", "optimistic"),
    ("sarsa", "optimistic"),
)
"""Learners, and the initial values they start from."""


@dataclass(frozen=True)
class Outcome:
    """What one setting earns while learning, and with what it has learned."""

    algorithm: str
    """q_learning or sarsa."""
    initial: str
    """Initial values: pessimistic (the reward of a fall) or optimistic (0)."""
    epsilon: float
    """Probability of a random action."""
    n_runs: int
    """Number of runs."""
    online: float
    """Mean return an episode while learning, over all episodes."""
    online_ci95: float
    """Half-width of its 95% t interval over runs."""
    greedy: float
    """Mean return of the greedy policy learned, cut off after 100 steps."""
    greedy_ci95: float
    """Half-width of its 95% t interval over runs."""
    optimal: float
    """Share of runs whose greedy policy is optimal from the start."""
    optimal_ci95: float
    """Half-width of its 95% t interval over runs."""


@experiment(
    "ch2-exploration",
    item="Section 2.3.3",
    smoke=Config(runs=4, episodes=20, epsilons=(0.0, 0.1)),
    book=Config(runs=200),
    thesis=Config(),
    seconds=3,
)
def by_epsilon(config: Config, context: Context) -> list[Outcome]:
    """The exploration dilemma on the cliff: return while learning and return learned."""
    mdp = task()
    best = start_value(mdp, solve(mdp).policy)
    records = []
    for i, (algorithm, initial) in enumerate(SETTINGS):
        q = np.full((mdp.n_states, mdp.n_actions), config.pessimistic)
        if initial == "optimistic":
            q[:] = 0.0
        q[mdp.terminal] = 0.0
        alpha = config.alpha_q_learning if algorithm == "q_learning" else config.alpha_sarsa
        settings: dict[str, Any] = {
            "alpha": alpha,
            "episodes": config.episodes,
            "max_episode_steps": config.longest_episode,
            "initial_q": q,
        }
        for j, epsilon in enumerate(config.epsilons):
            settings["epsilon"] = epsilon

            def run(
                seed: np.random.SeedSequence,
                algorithm: Algorithm = algorithm,
                settings: dict[str, Any] = settings,
            ) -> Learned:
                return learn(mdp, algorithm, rng=np.random.default_rng(seed), **settings)

            label = f"{algorithm}, epsilon {epsilon:g}"
            learned = context.map(run, context.seeds(config.runs, i, j), label)
            greedy = [greedy_path(mdp, one.q).earned for one in learned]
            means: dict[str, float] = {}
            for name, values in (
                ("online", [one.total_reward / config.episodes for one in learned]),
                ("greedy", greedy),
                ("optimal", [float(abs(g - best) < 1e-9) for g in greedy]),
            ):
                mean = mean_ci(values)
                means |= {name: mean.mean, f"{name}_ci95": mean.half_width}
            records.append(Outcome(algorithm, initial, epsilon, config.runs, **means))
    return records


def figure(table: pd.DataFrame) -> Figure:
    """Return while learning, and share of runs that learn the optimal policy, by epsilon."""
    fig, axes = plt.subplots(1, 2)
    panels = (
        ("online", "return an episode while learning"),
        ("optimal", "share of runs, optimal policy"),
    )
    for ax, (what, label) in zip(axes, panels, strict=True):
        for (algorithm, initial), own in table.groupby(["algorithm", "initial"]):
            place, name = np.arange(len(own)), f"{LEARNERS[algorithm]}, {initial}"
            half = own[f"{what}_ci95"]
            ax.errorbar(place, own[what], half, marker="o", ms=4, capsize=2, label=name)
        ax.set(xlabel=r"$\varepsilon$", ylabel=label)
        ax.set_xticks(place, [f"{e:g}" for e in own.epsilon])
    axes[0].legend()
    return fig
