"""Task relevance put to use: features of the value function chosen before a task is entered."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd

from thesis_lib.arrays import BoolArray, FloatArray, IntArray
from thesis_lib.chapter3.runs import Learner
from thesis_lib.domains import Domain, stock
from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.experiments.chapter4.families import meadow
from thesis_lib.experiments.chapter4.worlds import World, world
from thesis_lib.mdp.aggregated import learn_aggregated
from thesis_lib.mdp.checks import one_of
from thesis_lib.relevance import ACTION, ground
from thesis_lib.selection import JackknifeF, NoSelection, TaskRelevance, task_explained
from thesis_lib.stats import Mean, bootstrap_ci, mean_ci

METHODS = ("full", "table", "potential", "both", "aliased")
SYMBOLS: Mapping[str, str] = {
    "full": "full table",
    "table": "task-relevant table",
    "potential": "full table, domain-relevant potential",
    "both": "task-relevant table and potential",
    "aliased": "a relevant feature missing",
}
"""How figures name the methods."""

SMOOTH = 3
"""Windows over which a learning curve is averaged before it is said to have reached a level."""


@dataclass(frozen=True)
class Setting:
    """A domain and how its tasks are learned."""

    make: Callable[[], Domain]
    """Builds the domain."""
    learner: Learner
    """Q-learning, with a budget of steps."""
    missing: str
    """A task-relevant feature, taken from the table of ``aliased``."""


DOMAINS: Mapping[str, Setting] = {
    "stock G=3": Setting(
        partial(stock, 1, 2, 3), Learner("q_learning", 0.2, 0.1, steps=6_000), "g1"
    ),
    "meadow": Setting(meadow, Learner("q_learning", 0.2, 0.1, steps=12_000), "x"),
    "mild meadow": Setting(
        partial(meadow, bog=4.0), Learner("q_learning", 0.2, 0.1, steps=12_000), "x"
    ),
    "small stock": Setting(
        partial(stock, 1, 2, 1), Learner("q_learning", 0.2, 0.1, steps=100), "g1"
    ),
    "small meadow": Setting(partial(meadow, 2, 2), Learner("q_learning", 0.2, 0.1, steps=100), "x"),
}
"""Stock trading, where ownership is task irrelevant, and a gridworld under weather that is; one
in which that matters less; and small ones of each, for trials."""


@dataclass(frozen=True)
class TaskRelevanceConfig:
    """Settings of the comparison."""

    runs: int = 200
    """Sequences of tasks."""
    tests: int = 4
    """New tasks learned after each number of observed tasks."""
    tasks_seen: tuple[int, ...] = (1, 3, 8, 20)
    """Numbers of observed tasks n."""
    windows: int = 120
    """Points of a learning curve."""
    level: float = 0.9
    """Return to be reached: this share of the way from the full table's first window to its
    last."""
    tolerance: float = 0.0
    """Largest task relevance that counts as none, as a share of the variance of Q."""
    resamples: int = 500
    """Bootstrap resamples of runs."""
    domains: tuple[str, ...] = ("stock G=3", "meadow", "mild meadow")
    """Names out of :data:`DOMAINS`."""


def run_task_relevance(config: TaskRelevanceConfig, context: Context) -> pd.DataFrame:
    """Compare the representations; columns are documented in :data:`TASK_RELEVANCE`."""
    tables = [_one_domain(config, context, i, name) for i, name in enumerate(config.domains)]
    return pd.concat(tables, ignore_index=True)


def state_labels(found: World, kept: BoolArray, task: int) -> IntArray:
    """Cell of each state of a task when only some features are seen, shape ``(S_m,)``.

    Parameters
    ----------
    found
        The domain.
    kept
        Which of the features are seen, the action among them, shape ``(F,)``.
    task
        Index of the task.
    """
    names = found.solutions.feature_names
    columns = [i for i, name in enumerate(names) if name != ACTION and kept[i]]
    seen = found.domain.observations[:, columns]
    cells = np.unique(seen, axis=0, return_inverse=True)[1].reshape(-1)
    index = found.domain.observation_index[task]
    # The value of a terminal state is 0 and never read, so it may carry any label.
    own = np.where(index >= 0, cells[index], cells[index[index >= 0][0]])
    return np.unique(own, return_inverse=True)[1].reshape(-1)


def _one_domain(config: TaskRelevanceConfig, context: Context, key: int, name: str) -> pd.DataFrame:
    setting = DOMAINS[one_of("domain", name, tuple(DOMAINS))]
    learner = setting.learner
    steps = learner.steps or 0
    every = steps // config.windows
    found = world(setting.make, learner, context)
    solutions = found.solutions
    relevant = TaskRelevance().fit(solutions).support_
    every_feature = np.ones_like(relevant)
    aliased = relevant & ~solutions.mask([setting.missing])
    cells = ground(solutions)
    known: dict[tuple[bytes, int], IntArray] = {}

    def labels(kept: BoolArray, task: int) -> IntArray:
        at = kept.tobytes(), task
        if at not in known:
            known[at] = state_labels(found, kept, task)
        return known[at]

    def one(seed: np.random.SeedSequence) -> tuple[FloatArray, ...]:
        rng = np.random.default_rng(seed)
        seen = found.domain.sample(max(config.tasks_seen), rng)
        shape = len(config.tasks_seen), len(METHODS)
        curves = np.zeros((*shape, config.windows))
        pairs, hidden, gaps = np.zeros(shape), np.zeros(shape), np.full(shape, np.nan)
        for j, n in enumerate(config.tasks_seen):
            observed = solutions.take(seen[:n])
            chosen = TaskRelevance(config.tolerance).fit(observed).support_
            shaping = JackknifeF() if n >= JackknifeF.min_tasks else NoSelection()
            phi = found.potential(seen[:n], shaping.fit(observed).support_)
            tests = found.domain.sample(config.tests, rng)
            draws = rng.integers(2**63, size=config.tests)
            for i, method in enumerate(METHODS):
                kept = {"table": chosen, "both": chosen, "aliased": aliased}.get(
                    method, every_feature
                )
                lost = task_explained(cells) - task_explained(cells.keep(np.flatnonzero(kept)))
                needed = lost[tests] > 1e-9 * task_explained(cells)[tests]
                hidden[j, i] = needed.mean()
                rewards = np.zeros((config.tests, config.windows))
                for t, (m, draw) in enumerate(zip(tests, draws, strict=True)):
                    z = labels(kept, int(m))
                    advice = found.domain.scatter(phi, int(m))
                    rewards[t] = learn_aggregated(
                        found.domain.tasks[m],
                        z,
                        alpha=learner.alpha,
                        epsilon=learner.epsilon,
                        steps=steps,
                        every=every,
                        rng=int(draw),
                        potential=advice if method in ("potential", "both") else None,
                    ).rewards[: config.windows]
                    pairs[j, i] += (z.max() + 1) * len(found.domain.actions)
                curves[j, i] = rewards.mean(axis=0) / every
                last = rewards[:, -config.windows // 4 :].mean(axis=1) / every
                if method == "full":
                    reference = last
                if needed.any():
                    gaps[j, i] = (last - reference)[needed].mean()
        return curves, pairs / config.tests, hidden, gaps

    found_runs = context.map(one, context.seeds(config.runs, 20, key), name)
    curves, pairs, hidden, gaps = (np.stack(part) for part in zip(*found_runs, strict=True))
    records = []
    for j, n in enumerate(config.tasks_seen):
        factors = _factors(curves[:, j], config, every, context, (21, key, j))
        for i, method in enumerate(METHODS):
            cost = gaps[:, j, i][np.isfinite(gaps[:, j, i])]
            loss = mean_ci(cost) if len(cost) > 1 else Mean(np.nan, np.nan, len(cost))
            for w in range(config.windows):
                own = mean_ci(curves[:, j, i, w])
                records.append(
                    {
                        "domain": name,
                        "tasks_seen": n,
                        "method": method,
                        "step": (w + 1) * every,
                        "reward": own.mean,
                        "ci95": own.half_width,
                        "pairs": float(pairs[:, j, i].mean()),
                        "hidden": float(hidden[:, j, i].mean()),
                        "hidden_gap": loss.mean,
                        "hidden_gap_ci95": loss.half_width,
                        **factors[method],
                        "n_runs": own.n,
                    }
                )
    return rows(records)


def reached(curve: FloatArray, level: float, every: int) -> float:
    """Steps after which a smoothed learning curve first reaches a level; infinite if never.

    Parameters
    ----------
    curve
        Mean reward of each window.
    level
        To be reached.
    every
        Steps of a window.
    """
    smooth = np.convolve(curve, np.full(SMOOTH, 1 / SMOOTH), "valid")
    at = np.flatnonzero(smooth >= level)
    # The middle of the windows that are averaged.
    return float((at[0] + SMOOTH / 2) * every) if len(at) else np.inf


def _factors(
    curves: FloatArray,
    config: TaskRelevanceConfig,
    every: int,
    context: Context,
    key: tuple[int, ...],
) -> dict[str, dict[str, float]]:
    """How many times fewer steps than the full table each method takes to the level."""
    full = METHODS.index("full")

    def both(sample: FloatArray, i: int) -> tuple[float, float]:
        mean = sample.mean(axis=0)
        start, end = mean[full, 0], mean[full, -SMOOTH:].mean()
        level = start + config.level * (end - start)
        return reached(mean[full], level, every), reached(mean[i], level, every)

    out = {}
    for i, method in enumerate(METHODS):
        slow, fast = both(curves, i)
        rng = np.random.default_rng(np.random.SeedSequence(context.seed, spawn_key=(*key, i)))

        def ratio(sample: FloatArray, i: int = i) -> float:
            a, b = both(sample, i)
            # Neither may reach the level of a resample; then nothing is gained.
            return a / b if np.isfinite(b) else 0.0

        low, high = bootstrap_ci(curves, ratio, rng=rng, n_resamples=config.resamples)
        out[method] = {
            "steps_to_level": fast,
            "factor": slow / fast if np.isfinite(fast) else 0.0,
            "factor_low": low,
            "factor_high": high,
        }
    return out


TASK_RELEVANCE: Experiment[TaskRelevanceConfig] = Experiment(
    id="task-relevance-learning",
    item="Equation 4.9 (learning)",
    title="Learning of new tasks on the table that past tasks say is needed, and on the full one.",
    function=run_task_relevance,
    budgets={
        "smoke": TaskRelevanceConfig(
            runs=2,
            tests=1,
            tasks_seen=(1, 3),
            windows=5,
            resamples=5,
            domains=("small stock", "small meadow"),
        ),
        "book": TaskRelevanceConfig(),
        "thesis": TaskRelevanceConfig(runs=500),
    },
    columns={
        "domain": "name",
        "tasks_seen": "number of observed tasks n",
        "method": "full: every feature; table: those that the observed tasks' values need; "
        "potential: every feature, with the domain-relevant potential of the observed tasks; both; "
        "aliased: the domain's task-relevant features but one",
        "step": "end of the window, in steps of the new task",
        "reward": "mean reward a step in the window, over runs",
        "ci95": "half-width of its 95% t interval over runs",
        "pairs": "entries of the new task's table, mean over runs",
        "hidden": "share of the new tasks in which a feature that the table lacks matters, exactly",
        "hidden_gap": "reward a step in the last quarter of those tasks, less the full table's",
        "hidden_gap_ci95": "half-width of its 95% t interval over runs with such tasks",
        "steps_to_level": "steps until the mean curve reaches the level",
        "factor": "steps of the full table over that; 0 if the level is never reached",
        "factor_low": "low end of its 95% bootstrap interval over runs",
        "factor_high": "high end of it",
        "n_runs": "sequences of tasks",
    },
    seconds={"smoke": 1, "book": 45, "thesis": 110},
)
