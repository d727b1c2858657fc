"""Sarsa and Q-learning on one cliff task: what they earn and what they learn (section 2.3.3).

The eight tasks of the cliff domain are mirror images of each other, so one of them, start
in the lower left corner and goal in the lower right one, stands for all.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
import pandas as pd

from thesis_lib.arrays import FloatArray
from thesis_lib.domains.cliff import CliffLayout, cliff_task, layouts, members
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.mdp.greedy import epsilon_greedy
from thesis_lib.mdp.learning import Learned, learn
from thesis_lib.mdp.model import TabularMDP
from thesis_lib.mdp.planning import soft_policy_iteration, solve, start_value
from thesis_lib.stats import mean_ci

Learner = Literal["q_learning", "sarsa"]
LEARNERS: tuple[Learner, ...] = ("q_learning", "sarsa")

LONGEST_PATH = 100
"""A greedy path that has not ended by then goes in circles."""


def layout() -> CliffLayout:
    """The task of this module: start (0, 0), goal (3, 0), cliff between."""
    return layouts()[0]


def task(discount: float = 1.0) -> TabularMDP:
    """Its MDP, without the sensor."""
    return cliff_task(layout(), sensor=False, discount=discount)


@dataclass(frozen=True)
class GreedyPath:
    """Where the greedy policy leads from the start of a deterministic task.

    Attributes
    ----------
    states
        Up to the terminal state, or up to the first state met again.
    earned
        Sum of rewards on the way; where the path goes in circles, of
        :data:`LONGEST_PATH` steps.
    ends
        Whether it reaches a terminal state.
    """

    states: tuple[int, ...]
    earned: float
    ends: bool


def greedy_path(mdp: TabularMDP, q: FloatArray) -> GreedyPath:
    """Follow the greedy policy of ``q`` from the start state; the first of tied actions.

    Parameters
    ----------
    mdp
        A task with one start state and deterministic transitions.
    q
        State-action values, shape ``(S, A)``.
    """
    greedy = q.argmax(axis=1)
    s = int(mdp.start.argmax())
    states, earned = [s], 0.0
    for _ in range(LONGEST_PATH):
        a = greedy[s]
        earned += mdp.reward[s, a]
        s = int(mdp.transition[s, a].argmax())
        states.append(s)
        if mdp.terminal[s]:
            return GreedyPath(tuple(states), float(earned), True)
    first = {s: states.index(s) for s in states}
    again = next(i for i, s in enumerate(states) if first[s] < i)
    return GreedyPath(tuple(states[: again + 1]), float(earned), False)


def cells_at_edge(path: GreedyPath, where: CliffLayout) -> int:
    """How many cells of the path, start and goal apart, have the cliff next to them."""
    cells = {where.cell(s) for s in path.states} - {where.start, where.goal}
    return sum(where.sensor(cell) > 0 for cell in cells)


@dataclass(frozen=True)
class OnlineConfig:
    """Settings of section-2.3.3: those of Table 3.1, on one task."""

    runs: int = 400
    """Runs of each learner."""
    episodes: int = 600
    """Episodes a run; see Table 3.1 for why not the 500 of the text."""
    epsilon: float = 0.1
    """Probability of a random action."""
    alpha_q_learning: float = 1.0
    """Learning rate of Q-learning (section 3.4.1)."""
    alpha_sarsa: float = 0.4
    """Learning rate of Sarsa (section 3.4.1)."""
    late: int = 100
    """How many of the last episodes count as late."""

    def __post_init__(self) -> None:
        if not 1 <= self.late <= self.episodes:
            raise ValueError(
                f"late is {self.late}, but it must be between 1 and episodes = {self.episodes}."
            )

    def alpha(self, learner: Learner) -> float:
        """Learning rate of a learner."""
        return self.alpha_q_learning if learner == "q_learning" else self.alpha_sarsa


def _learn(config: OnlineConfig, context: Context, learner: Learner) -> list[Learned]:
    """Run a learner ``config.runs`` times."""
    mdp = task()

    def run(seed: np.random.SeedSequence) -> Learned:
        return learn(
            mdp,
            learner,
            alpha=config.alpha(learner),
            epsilon=config.epsilon,
            episodes=config.episodes,
            rng=np.random.default_rng(seed),
            record=["rewards"],
        )

    return context.map(run, context.seeds(config.runs, LEARNERS.index(learner)), learner)


def online(config: OnlineConfig, context: Context) -> pd.DataFrame:
    """What each run of each learner earns, and where its greedy policy leads."""
    mdp, where = task(), layout()
    start = int(mdp.start.argmax())
    records = []
    for learner in LEARNERS:
        for run, learned in enumerate(_learn(config, context, learner)):
            assert learned.rewards is not None
            path = greedy_path(mdp, learned.q)
            behaviour = epsilon_greedy(learned.q[[start]], config.epsilon)[0]
            records.append(
                {
                    "method": learner,
                    "run": run,
                    "total_reward": learned.total_reward,
                    "late_return": learned.episode_returns[-config.late :].mean(),
                    "falls": int((learned.rewards <= mdp.reward.min()).sum()),
                    "estimate": float(behaviour @ learned.q[start]),
                    "greedy_return": path.earned,
                    "reaches_goal": path.ends,
                    "cells_at_edge": cells_at_edge(path, where),
                    "path": " ".join("{},{}".format(*where.cell(s)) for s in path.states),
                }
            )
    return rows(records)


SECTION_2_3_3 = Experiment(
    id="section-2.3.3",
    item="Section 2.3.3",
    title="Sarsa and Q-learning on the cliff: online return and the path learned",
    function=online,
    budgets={
        "smoke": OnlineConfig(runs=5, episodes=40, late=10),
        "book": OnlineConfig(),
        "thesis": OnlineConfig(),
    },
    columns={
        "method": "q_learning or sarsa",
        "run": "number of the run",
        "total_reward": "sum of rewards over all episodes",
        "late_return": "mean return of the last episodes (`late` of the config)",
        "falls": "number of falls down the cliff",
        "estimate": "what the learned values promise the epsilon-greedy agent in the start state",
        "greedy_return": "return of the greedy policy at the end, cut off after 100 steps",
        "reaches_goal": "whether the greedy policy reaches the goal",
        "cells_at_edge": "cells of the greedy path next to the cliff, start apart",
        "path": "cells x,y of the greedy path, up to the goal or the first cell met again",
    },
    seconds={"smoke": 0.1, "book": 1.5, "thesis": 1.5},
)


@dataclass(frozen=True)
class CurveConfig(OnlineConfig):
    """Settings of section-2.3.3-curve: the runs of section-2.3.3, averaged over blocks."""

    block: int = 20
    """Episodes a block; must divide ``episodes``."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.block < 1 or self.episodes % self.block:
            raise ValueError(
                f"block is {self.block}, but it must divide episodes = {self.episodes}."
            )


def curve(config: CurveConfig, context: Context) -> pd.DataFrame:
    """Return by episode, averaged over blocks of episodes and over runs."""
    records = []
    for learner in LEARNERS:
        earned = np.array([r.episode_returns for r in _learn(config, context, learner)])
        blocks = earned.reshape(config.runs, -1, config.block).mean(axis=2)
        for i, block in enumerate(blocks.T):
            estimate = mean_ci(block)
            records.append(
                {
                    "method": learner,
                    "episode": (i + 0.5) * config.block + 0.5,
                    "mean": estimate.mean,
                    "ci95": estimate.half_width,
                    "n_runs": estimate.n,
                }
            )
    return rows(records)


SECTION_2_3_3_CURVE = Experiment(
    id="section-2.3.3-curve",
    item="Section 2.3.3",
    title="Sarsa and Q-learning on the cliff: return by episode while learning",
    function=curve,
    budgets={
        "smoke": CurveConfig(runs=5, episodes=40, late=10),
        "book": CurveConfig(),
        "thesis": CurveConfig(),
    },
    columns={
        "method": "q_learning or sarsa",
        "episode": "middle of the block of episodes, counted from 1",
        "mean": "mean return of an episode of the block",
        "ci95": "half-width of its 95% t interval over runs",
        "n_runs": "number of runs",
    },
    seconds={"smoke": 0.1, "book": 1.5, "thesis": 1.5},
)


@dataclass(frozen=True)
class ExplorationConfig:
    """Settings of section-2.3.3-exploration."""

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


SETTINGS: tuple[tuple[Learner, str], ...] = (
    ("q_learning", "pessimistic"),
    ("q_learning", "optimistic"),
    ("sarsa", "optimistic"),
)


def exploration(config: ExplorationConfig, context: Context) -> pd.DataFrame:
    """Return while learning against return of the policy learned, by epsilon."""
    mdp = task()
    best = start_value(mdp, solve(mdp).policy)
    records = []
    for i, (learner, initial) in enumerate(SETTINGS):
        q = np.full((mdp.n_states, mdp.n_actions), config.pessimistic)
        if initial == "optimistic":
            q[:] = 0.0
        q[mdp.terminal] = 0.0
        alpha = config.alpha_q_learning if learner == "q_learning" else config.alpha_sarsa
        for j, epsilon in enumerate(config.epsilons):
            run = partial(
                _explore, config=config, mdp=mdp, learner=learner, q=q, alpha=alpha, epsilon=epsilon
            )
            label = f"{learner}, epsilon {epsilon:g}"
            results = context.map(run, context.seeds(config.runs, i, j), label)
            earned = [r.total_reward / config.episodes for r in results]
            greedy = [greedy_path(mdp, r.q).earned for r in results]
            optimal = [float(abs(g - best) < 1e-9) for g in greedy]
            record: dict[str, object] = {
                "method": learner,
                "initial": initial,
                "epsilon": epsilon,
                "n_runs": config.runs,
            }
            for name, values in (("online", earned), ("greedy", greedy), ("optimal", optimal)):
                estimate = mean_ci(values)
                record[name] = estimate.mean
                record[f"{name}_ci95"] = estimate.half_width
            records.append(record)
    return rows(records)


def _explore(
    seed: np.random.SeedSequence,
    *,
    config: ExplorationConfig,
    mdp: TabularMDP,
    learner: Learner,
    q: FloatArray,
    alpha: float,
    epsilon: float,
) -> Learned:
    """One run of the epsilon sweep, from the initial values ``q``."""
    return learn(
        mdp,
        learner,
        alpha=alpha,
        epsilon=epsilon,
        episodes=config.episodes,
        max_episode_steps=config.longest_episode,
        initial_q=q,
        rng=np.random.default_rng(seed),
    )


SECTION_2_3_3_EXPLORATION = Experiment(
    id="section-2.3.3-exploration",
    item="Section 2.3.3",
    title="The exploration dilemma on the cliff: return while learning and return learned",
    function=exploration,
    budgets={
        "smoke": ExplorationConfig(runs=4, episodes=20, epsilons=(0.0, 0.1)),
        "book": ExplorationConfig(),
        "thesis": ExplorationConfig(),
    },
    columns={
        "method": "q_learning or sarsa",
        "initial": "initial values: pessimistic (below every return) or optimistic (0)",
        "epsilon": "probability of a random action",
        "n_runs": "number of runs",
        "online": "mean return an episode while learning, over all episodes",
        "online_ci95": "half-width of its 95% t interval over runs",
        "greedy": "mean return of the greedy policy learned, cut off after 100 steps",
        "greedy_ci95": "half-width of its 95% t interval over runs",
        "optimal": "share of runs whose greedy policy is optimal from the start",
        "optimal_ci95": "half-width of its 95% t interval over runs",
    },
    seconds={"smoke": 0.1, "book": 2, "thesis": 2},
)


@dataclass(frozen=True)
class ConvergenceConfig:
    """Settings of section-2.3.3-convergence."""

    runs: int = 30
    """Runs of each setting."""
    steps: int = 1_000_000
    """Steps a run."""
    checkpoints: int = 50
    """How often the values are compared with the exact ones; divides ``steps``."""
    epsilons_q_learning: tuple[float, ...] = (0.1, 0.3, 1.0)
    """Constant exploration of Q-learning."""
    epsilons_sarsa: tuple[float, ...] = (0.1, 0.3)
    """Constant exploration of Sarsa."""
    epsilon_fading: float = 0.1
    """First exploration of the Sarsa whose exploration fades."""
    alpha: float = 0.1
    """First learning rate."""
    fade: float = 10_000.0
    """Rates fade as (1 + step / fade) to the power ``-power``."""
    power: float = 0.7
    """Between 1/2 and 1: the sum of the rates diverges, that of their squares does not."""

    def __post_init__(self) -> None:
        if self.checkpoints < 1 or self.steps % self.checkpoints:
            raise ValueError(
                f"checkpoints is {self.checkpoints}, but it must divide steps = {self.steps}."
            )
        if not 0.5 < self.power <= 1.0:
            raise ValueError(
                f"power is {self.power}, but it must be above 1/2 and at most 1 for the learning "
                "rates to fade neither too fast nor too slowly."
            )

    def rate(self, first: float) -> FloatArray:
        """A rate that fades, one number a step, shape ``(steps,)``."""
        return first * (1 + np.arange(self.steps) / self.fade) ** -self.power


def convergence(config: ConvergenceConfig, context: Context) -> pd.DataFrame:
    """Distance of the learned values from the optimal and from the best soft ones."""
    mdp, pairs = task(), members(layout())
    start = int(mdp.start.argmax())
    optimal = solve(mdp).q
    settings: list[tuple[Learner, str, float]] = [
        *(("q_learning", "constant", e) for e in config.epsilons_q_learning),
        *(("sarsa", "constant", e) for e in config.epsilons_sarsa),
        ("sarsa", "fading", config.epsilon_fading),
    ]
    records = []
    for i, (learner, schedule, epsilon) in enumerate(settings):
        soft = soft_policy_iteration(mdp, epsilon).q
        explore = config.rate(epsilon) if schedule == "fading" else epsilon
        run = partial(_converge, config=config, mdp=mdp, learner=learner, epsilon=explore)
        label = f"{learner}, epsilon {epsilon:g} {schedule}"
        results = context.map(run, context.seeds(config.runs, i), label)
        for number, learned in enumerate(results):
            assert learned.checkpoint_q is not None
            for step, q in zip(learned.checkpoint_steps, learned.checkpoint_q, strict=True):
                records.append(
                    {
                        "method": learner,
                        "exploration": schedule,
                        "epsilon": epsilon,
                        "run": number,
                        "step": int(step),
                        "start_value": q[start].max(),
                        "start_optimal": optimal[start].max(),
                        "start_soft": soft[start].max(),
                        "error_optimal": _rms((q - optimal)[pairs]),
                        "error_soft": _rms((q - soft)[pairs]),
                        "gap": _rms((soft - optimal)[pairs]),
                    }
                )
    return rows(records)


def _converge(
    seed: np.random.SeedSequence,
    *,
    config: ConvergenceConfig,
    mdp: TabularMDP,
    learner: Learner,
    epsilon: float | FloatArray,
) -> Learned:
    """One long run with fading learning rates."""
    return learn(
        mdp,
        learner,
        alpha=config.rate(config.alpha),
        epsilon=epsilon,
        steps=config.steps,
        checkpoint_every=config.steps // config.checkpoints,
        record=["q"],
        rng=np.random.default_rng(seed),
    )


def _rms(x: FloatArray) -> float:
    return float(np.sqrt((x**2).mean()))


SECTION_2_3_3_CONVERGENCE = Experiment(
    id="section-2.3.3-convergence",
    item="Section 2.3.3",
    title="Where Q-learning and Sarsa converge to on the cliff while they explore",
    function=convergence,
    budgets={
        "smoke": ConvergenceConfig(runs=2, steps=2_000, checkpoints=4),
        "book": ConvergenceConfig(),
        "thesis": ConvergenceConfig(),
    },
    columns={
        "method": "q_learning or sarsa",
        "exploration": "constant or fading",
        "epsilon": "probability of a random action; the first one where it fades",
        "run": "number of the run",
        "step": "steps taken",
        "start_value": "largest learned value in the start state",
        "start_optimal": "the same of Q*, exact",
        "start_soft": "the same of the best policy that explores with epsilon, exact",
        "error_optimal": "root mean square of Q - Q* over the task's state-action pairs",
        "error_soft": "the same for the values of the best policy that explores with epsilon",
        "gap": "the same for the difference of the two exact value functions",
    },
    seconds={"smoke": 0.1, "book": 8, "thesis": 8},
)
