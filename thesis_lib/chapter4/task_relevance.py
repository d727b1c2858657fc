"""Task relevance put to use: features of the value function chosen before a task is entered."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.arrays import BoolArray, FloatArray, IntArray
from thesis_lib.chapter3.runs import TabularLearner
from thesis_lib.chapter4.looks import PM
from thesis_lib.chapter4.protocol import share_interval, wider
from thesis_lib.chapter4.runs import SolvedDomain, solve_domain
from thesis_lib.checks import one_of
from thesis_lib.domains import Domain, stock
from thesis_lib.domains.planted import meadow
from thesis_lib.edition.criteria import graded, judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.plots import COLOURS, legend_of
from thesis_lib.mdp.aggregated import learn_aggregated
from thesis_lib.relevance import ACTION, ground
from thesis_lib.selection import JackknifeF, NoSelection, TaskRelevance, task_explained
from thesis_lib.stats import Mean, bootstrap_ci, least_power, mean_ci

SYMBOLS: Mapping[str, str] = {
    "full": "full table",
    "table": "task-relevant table",
    "potential": "full table, domain-relevant potential",
    "both": "task-relevant table and potential",
    "aliased": "a relevant feature missing",
}
"""How figures name the methods."""

METHODS = tuple(SYMBOLS)

MARGIN = 0.05
"""Share of new tasks that counts as few, and of the reward that counts as negligible."""

SMOOTH = 3
"""Windows over which a learning curve is averaged before it is said to have reached a level."""


@dataclass(frozen=True)
class Setting:
    """A domain and how its tasks are learned."""

    make: Callable[[], Domain]
    """Builds the domain."""
    learner: TabularLearner
    """Q-learning, with a budget of steps."""
    missing: str
    """A task-relevant feature, taken from the table of ``aliased``."""


_SMALL = TabularLearner("q_learning", 0.2, 0.1, steps=100)
_MEADOW = TabularLearner("q_learning", 0.2, 0.1, steps=12_000)

DOMAINS: Mapping[str, Setting] = {
    "stock G=3": Setting(
        partial(stock, 1, 2, 3), TabularLearner("q_learning", 0.2, 0.1, steps=6_000), "g1"
    ),
    "meadow": Setting(meadow, _MEADOW, "x"),
    "mild meadow": Setting(partial(meadow, bog=4.0), _MEADOW, "x"),
    "small stock": Setting(partial(stock, 1, 2, 1), _SMALL, "g1"),
    "small meadow": Setting(partial(meadow, 2, 2), _SMALL, "x"),
}
"""Stock trading, where ownership is task irrelevant, and a gridworld under weather that is; one
in which that matters less; and small ones of each, for trials."""


@dataclass(frozen=True)
class Config:
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
    """Return to be reached: this share of the distance from the full table's first window to its
    last."""
    tolerance: float = 0.0
    """Largest task relevance that counts as none, as a share of the variance of Q."""
    resamples: int = 500
    """Bootstrap resamples of runs."""
    domains: tuple[str, ...] = ("stock G=3", "meadow", "mild meadow")
    """Names out of :data:`DOMAINS`."""


@dataclass(frozen=True)
class Window:
    """One window of the learning curve of one method on one domain."""

    domain: str
    """Name."""
    tasks_seen: int
    """Number of observed tasks n."""
    method: str
    """full: every feature; table: those that the observed tasks' values need; potential: every
    feature, with the domain-relevant potential of the observed tasks; both; aliased: the
    domain's task-relevant features but one."""
    step: int
    """End of the window, in steps of the new task."""
    reward: float
    """Mean reward a step in the window, over runs."""
    ci95: float
    """Half-width of its 95% t interval over runs."""
    pairs: float
    """Entries of the new task's table, mean over runs."""
    hidden: float
    """Share of the new tasks in which a feature that the table lacks matters, exactly."""
    hidden_gap: float
    """Reward a step in the last quarter of those tasks, less the full table's."""
    hidden_gap_ci95: float
    """Half-width of its 95% t interval over runs with such tasks."""
    steps_to_level: float
    """Steps until the mean curve reaches the level."""
    factor: float
    """Steps of the full table over that; 0 if the level is never reached."""
    factor_low: float
    """Low end of its 95% bootstrap interval over runs."""
    factor_high: float
    """High end of it."""
    n_runs: int
    """Sequences of tasks."""


@experiment(
    "ch4-task-relevance",
    item="Equation 4.9 (learning)",
    smoke=Config(
        runs=2,
        tests=1,
        tasks_seen=(1, 3),
        windows=5,
        resamples=5,
        domains=("small stock", "small meadow"),
    ),
    book=Config(runs=60, windows=60),
    thesis=Config(runs=500),
    seconds=24,
)
def windows(config: Config, context: Context) -> list[Window]:
    """Learning of new tasks on the table that past tasks say is needed, and on the full one."""
    return [
        window
        for i, name in enumerate(config.domains)
        for window in _one_domain(config, context, i, name)
    ]


def state_labels(solved: SolvedDomain, kept: BoolArray, task: int) -> IntArray:
    """Cell of each state of a task when only some features are seen, shape ``(S_m,)``.

    Parameters
    ----------
    solved
        The domain.
    kept
        Which of the features are seen, the action among them, shape ``(F,)``.
    task
        Index of the task.
    """
    names = solved.solutions.feature_names
    columns = [i for i, name in enumerate(names) if name != ACTION and kept[i]]
    seen = solved.domain.observations[:, columns]
    cells = np.unique(seen, axis=0, return_inverse=True)[1].reshape(-1)
    index = solved.domain.observation_index[task]
    # The value of a terminal state is 0 and never read, so it may carry any label.
    own = np.where(index >= 0, cells[index], cells[index[index >= 0][0]])
    return np.unique(own, return_inverse=True)[1].reshape(-1)


def _one_domain(config: Config, context: Context, key: int, name: str) -> list[Window]:
    setting = DOMAINS[one_of("domain", name, tuple(DOMAINS))]
    learner = setting.learner
    steps = learner.steps or 0
    every = steps // config.windows
    solved = solve_domain(setting.make(), learner, context)
    domain, solutions = solved.domain, solved.solutions
    relevant = TaskRelevance().fit(solutions).support_
    every_feature = np.ones_like(relevant)
    aliased = relevant & ~solutions.mask([setting.missing])
    cells = ground(solutions)
    known: dict[tuple[bytes, int], IntArray] = {}

    def labels(kept: BoolArray, task: int) -> IntArray:
        at = kept.tobytes(), task
        if at not in known:
            known[at] = state_labels(solved, kept, task)
        return known[at]

    def one(seed: np.random.SeedSequence) -> tuple[FloatArray, ...]:
        rng = np.random.default_rng(seed)
        seen = domain.sample(max(config.tasks_seen), rng)
        shape = len(config.tasks_seen), len(METHODS)
        curves = np.zeros((*shape, config.windows))
        pairs, hidden, gaps = np.zeros(shape), np.zeros(shape), np.full(shape, np.nan)
        for j, n in enumerate(config.tasks_seen):
            observed = solutions.take(seen[:n])
            chosen = TaskRelevance(config.tolerance).fit(observed).support_
            shaping = JackknifeF() if n >= JackknifeF.min_tasks else NoSelection()
            phi = solved.potential(seen[:n], shaping.fit(observed).support_)
            tests = domain.sample(config.tests, rng)
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
                    advice = domain.scatter(phi, int(m))
                    rewards[t] = learn_aggregated(
                        domain.tasks[m],
                        z,
                        alpha=learner.alpha,
                        epsilon=learner.epsilon,
                        steps=steps,
                        every=every,
                        rng=int(draw),
                        potential=advice if method in ("potential", "both") else None,
                    ).rewards[: config.windows]
                    pairs[j, i] += (z.max() + 1) * len(domain.actions)
                curves[j, i] = rewards.mean(axis=0) / every
                last = rewards[:, -config.windows // 4 :].mean(axis=1) / every
                if method == "full":
                    reference = last
                if needed.any():
                    gaps[j, i] = (last - reference)[needed].mean()
        return curves, pairs / config.tests, hidden, gaps

    runs = context.map(one, context.seeds(config.runs, 20, key), name)
    curves, pairs, hidden, gaps = (np.stack(part) for part in zip(*runs, strict=True))
    records = []
    for j, n in enumerate(config.tasks_seen):
        factors = _factors(curves[:, j], config, every, context, (21, key, j))
        for i, method in enumerate(METHODS):
            cost = gaps[:, j, i][np.isfinite(gaps[:, j, i])]
            loss = mean_ci(cost) if len(cost) > 1 else Mean(np.nan, np.nan, len(cost))
            for w in range(config.windows):
                own = mean_ci(curves[:, j, i, w])
                records.append(
                    Window(
                        domain=name,
                        tasks_seen=n,
                        method=method,
                        step=(w + 1) * every,
                        reward=own.mean,
                        ci95=own.half_width,
                        pairs=float(pairs[:, j, i].mean()),
                        hidden=float(hidden[:, j, i].mean()),
                        hidden_gap=loss.mean,
                        hidden_gap_ci95=loss.half_width,
                        **factors[method],
                        n_runs=own.n,
                    )
                )
    return records


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
    curves: FloatArray, config: Config, every: int, context: Context, key: tuple[int, ...]
) -> dict[str, dict[str, float]]:
    """How many times fewer steps than the full table each method takes to the level."""
    full = METHODS.index("full")

    def both(sample: FloatArray) -> tuple[float, float]:
        table, other = sample.mean(axis=0)
        start, end = table[0], table[-SMOOTH:].mean()
        level = start + config.level * (end - start)
        return reached(table, level, every), reached(other, level, every)

    def ratio(sample: FloatArray) -> float:
        slow, fast = both(sample)
        # Neither may reach the level of a resample; then nothing is gained.
        return slow / fast if np.isfinite(fast) else 0.0

    factors = {}
    for i, method in enumerate(METHODS):
        own = curves[:, [full, i]]
        fast = both(own)[1]
        rng = np.random.default_rng(np.random.SeedSequence(context.seed, spawn_key=(*key, i)))
        low, high = bootstrap_ci(own, ratio, rng=rng, n_resamples=config.resamples)
        factors[method] = {
            "steps_to_level": fast,
            "factor": ratio(own),
            "factor_low": low,
            "factor_high": high,
        }
    return factors


def _once(table: pd.DataFrame, method: str, n: int) -> pd.DataFrame:
    """What is said once of each domain's learning curve, by domain."""
    own = table[(table.method == method) & (table.tasks_seen == n)]
    return own.drop_duplicates("domain").set_index("domain")


@criterion("4-smaller-table", windows)
def smaller_table_is_faster(table: pd.DataFrame) -> Finding:
    """How many times fewer steps the task-relevant table takes than the full one."""
    n = sorted(table.tasks_seen.unique())[-2]
    own, full = _once(table, "table", n), _once(table, "full", n)
    listed = "; ".join(
        f"{r.Index}: {r.pairs:.0f} entries instead of {full.pairs[r.Index]:.0f} take "
        f"{r.factor:.1f} times fewer steps (95% interval {r.factor_low:.1f} to "
        f"{r.factor_high:.1f})"
        for r in own.itertuples()
    )
    # Corrected for the domains, of which any will do, on a logarithmic scale; no level is reached
    # where both factors are 0.
    more = (own.factor_high / own.factor).pow(wider(len(own)) - 1).fillna(1.0)
    slower = own.factor_high * more < 1
    return Finding(
        graded(
            (own.factor_low > 1).all(),
            direction=(own.factor > 1).all(),
            denied=(own.factor_high < 1).all(),
            otherwise=Verdict.NOT_REPRODUCED if slower.any() else Verdict.INCONCLUSIVE,
        ),
        f"To 90% of the full table's gain, after {n} tasks: {listed}; significantly more steps on "
        f"{slower.sum() or 'none'} of {len(own)} (corrected for their number).",
        dict(own.factor),
    )


@criterion("4.1.1-near-irrelevant", windows)
def error_is_negligible(table: pd.DataFrame) -> Finding:
    """Whether the table lacks what new tasks need, and what it earns in the end."""
    end = table[table.step > 0.75 * table.groupby("domain").step.transform("max")]
    most, fewest = table.tasks_seen.max(), table.tasks_seen.min()
    # Windows share runs, so their errors may be fully correlated: they are averaged.
    by = end[end.tasks_seen == most].groupby(["method", "domain"])[["reward", "ci95"]].mean()
    table_only, full = by.loc["table"], by.loc["full"]
    gap, half = table_only.reward - full.reward, np.hypot(table_only.ci95, full.ci95)
    margin = MARGIN * full.reward.abs()
    late, early = _once(table, "table", most), _once(table, "table", fewest).hidden
    own, runs = late.hidden, late.n_runs
    # The new tasks of a run meet one table: as many of them as there are runs count.
    share = share_interval(own, runs, len(own))
    listed = "; ".join(
        f"{d}: in {early[d]:.0%} of the new tasks after {fewest} and in {own[d]:.1%} "
        f"({share.low[d]:.1%} to {share.high[d]:.1%}) after {most}, when the last quarter earns "
        f"{gap[d]:+.3f} ± {half[d]:.3f} a step relative to the full table's {full.reward[d]:.3f}"
        for d in own.index
    )
    rare, often = (share.high <= MARGIN).all(), (share.low > MARGIN).any()
    worse = (gap + half < -margin).any()
    return judged(
        rare and (gap - half > -margin).all(),
        f"A feature that matters is missing (Wilson's 95% intervals over runs, corrected for the "
        f"number of domains), on {listed}. Without any difference of reward each would be shown to "
        f"be at most {MARGIN:.0%} below in at least {least_power(margin, half, sides=1):.0%} of "
        "samples.",
        {f"hidden, {d}": float(own[d]) for d in own.index},
        direction=(own <= early).all() and (own < early).any() and not worse,
        otherwise=Verdict.NOT_REPRODUCED if often or worse else Verdict.INCONCLUSIVE,
    )


def figure(table: pd.DataFrame, tasks_seen: int) -> Figure:
    """Learning curves of new tasks after some observed ones, for the first two domains."""
    domains = table.domain.unique()[:2]
    fig, axes = plt.subplots(1, len(domains), figsize=(7.2, 3.8), squeeze=False)
    styles = ("-", "-", ":", "--", "-.")
    for ax, domain in zip(axes[0], domains, strict=True):
        at = table[(table.domain == domain) & (table.tasks_seen == tasks_seen)]
        for i, method in enumerate(METHODS):
            own, colour = at[at.method == method], "#7f7f7f" if method == "full" else COLOURS[i]
            x = own.step / 1000
            look: dict[str, Any] = {"color": colour, "ls": styles[i], "lw": 1.5}
            ax.plot(x, own.reward, label=SYMBOLS[method], **look)
            low, high = own.reward - own.ci95, own.reward + own.ci95
            ax.fill_between(x, low, high, color=colour, alpha=0.15, lw=0)
        ax.set(xlabel="steps in the new task [1000]", title=f"{domain}, n = {tasks_seen}")
    axes[0, 0].set_ylabel("reward a step")
    legend_of(axes[0, 0], 2, fontsize=8)
    return fig


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """What the task-relevant table saves and costs, one row a domain and number of tasks."""
    once = table.drop_duplicates(["domain", "tasks_seen", "method"])
    records = []
    for (domain, n), rows in once.groupby(["domain", "tasks_seen"], sort=False):
        own = rows.set_index("method")
        small = own.loc["table"]
        gap = f"{small.hidden_gap:+.2f}{PM}{small.hidden_gap_ci95:.2f}"
        records.append(
            {
                "domain": domain,
                "n": n,
                "entries": f"{small.pairs:.0f} of {own.pairs['full']:.0f}",
                "faster by": _factor(small),
                "with potential": _factor(own.loc["both"]),
                "lacking": f"{small.hidden:.0%}",
                "more there": "–" if np.isnan(small.hidden_gap) else gap,
            }
        )
    return pd.DataFrame(records)


def _factor(row: pd.Series) -> str:
    return f"{row.factor:.1f} ({row.factor_low:.1f}–{row.factor_high:.1f})"
