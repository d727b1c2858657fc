r"""Table 3.1: potentials on the episodic cliff (section 3.4.1).

An entry is the mean over runs of what a learner that starts from :math:`Q_0 = \Phi` earns in all
E episodes, of returns :math:`R_e`, on a task drawn from the domain,

.. math:: \frac{1}{10^4} \, \mathbb{E} \sum_{e=1}^{E} R_e , \qquad
          \Phi(x) = \frac{\sum_m D(m)\, p(x|m)\, Q_m(x)}{\sum_m D(m)\, p(x|m)} ,

with :math:`Q^*_m`, :math:`\tilde Q_m` or :math:`Q^\mu_m` for :math:`Q_m` (equations 3.4 and 3.6 to
3.8: ``potentials.q_star``, ``q_tilde`` and ``q_mu``), or 0 without shaping.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy import stats

from thesis_lib import published
from thesis_lib.arrays import FloatArray
from thesis_lib.chapter3.runs import LEARNERS, NAMES, SYMBOLS, MuSearch, Potential, named_potentials
from thesis_lib.domains import Domain, episodic_cliff
from thesis_lib.edition.criteria import Pair, exact, near_printed, no_greater, ordered, summary
from thesis_lib.edition.experiment import Context, experiment, returns
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.plots import COLOURS, PRINTED
from thesis_lib.edition.words import number, several
from thesis_lib.mdp.greedy import Exploration
from thesis_lib.mdp.learning import Method, learn
from thesis_lib.mdp.model import MDP
from thesis_lib.potentials.cross_task_policy import GeneticAlgorithm
from thesis_lib.stats import welch

UNIT = 1e4
"""The thesis prints its numbers in units of 10^4."""


@dataclass(frozen=True)
class Cell:
    """One entry of the table."""

    potential: Potential
    algorithm: Method
    sensor: bool


@dataclass(frozen=True)
class Config:
    """Settings of Table 3.1; the defaults are the reading that fits its numbers."""

    n_runs: int = 100
    """Runs an entry, each on a task drawn from the domain."""
    episodes: int = 600
    """Episodes a run.  The text says 500; 600 fits what the table prints."""
    epsilon: float = 0.1
    """Exploration rate."""
    alpha_q_learning: float = 1.0
    """Learning rate of Q-learning and of Double Q-learning."""
    alpha_sarsa: float = 0.4
    """Learning rate of Sarsa and Expected Sarsa."""
    exploration: Exploration = "all"
    """What a random action is drawn from: all actions, or the others than the greedy one."""
    fall_reward: float = -1000.0
    """Reward of a fall."""
    fall_costs_step: bool = False
    """Whether a fall costs the step's -1 as well."""
    potentials: tuple[Potential, ...] = ("Q_mu", "none", "Q_star", "Q_tilde", "constant")
    """Rows.  ``constant`` is our control: the mean of Q_star at every pair."""
    algorithms: tuple[Method, ...] = ("q_learning", "sarsa")
    """Columns."""
    sensors: tuple[bool, ...] = (False, True)
    """Parts (a) and (b)."""
    mu: MuSearch = field(default_factory=lambda: MuSearch("ga"))
    """The search for the cross-task policy: the genetic algorithm of footnote 2."""

    def alpha(self, algorithm: Method) -> float:
        """Learning rate of an algorithm."""
        on_policy = algorithm in ("sarsa", "expected_sarsa")
        return self.alpha_sarsa if on_policy else self.alpha_q_learning

    def domain(self, sensor: bool) -> Domain:
        """The domain of part (a) or (b)."""
        return episodic_cliff(
            sensor, fall_reward=self.fall_reward, fall_costs_step=self.fall_costs_step
        )


def episode_returns(config: Config, cells: list[Cell], context: Context) -> FloatArray:
    """Return of every episode, shape ``(cells, runs, episodes)``, in units of 1.

    Every entry has seeds of its own, so that entries are independent samples.
    """
    domains = {sensor: config.domain(sensor) for sensor in {c.sensor for c in cells}}
    initial = {
        (name, sensor): domain.scatter_all(phi)
        for sensor, domain in domains.items()
        for name, phi in named_potentials(
            domain,
            {c.potential for c in cells if c.sensor == sensor},
            epsilon=config.epsilon,
            mu=config.mu,
            seed=context.seed,
        ).items()
    }

    def one(job: tuple[Cell, np.random.SeedSequence]) -> FloatArray:
        cell, seed = job
        rng = np.random.default_rng(seed)
        domain = domains[cell.sensor]
        task = int(domain.sample(1, rng)[0])
        learned = learn(
            domain.tasks[task],
            cell.algorithm,
            alpha=config.alpha(cell.algorithm),
            epsilon=config.epsilon,
            episodes=config.episodes,
            initial_q=initial[cell.potential, cell.sensor][task],
            exploration=config.exploration,
            rng=rng,
        )
        return learned.episode_returns

    jobs = [
        (cell, seed)
        for i, cell in enumerate(cells)
        for seed in context.seeds(config.n_runs, 3, 1, i)
    ]
    returns = np.array(context.map(one, jobs, "table 3.1"))
    return returns.reshape(len(cells), config.n_runs, config.episodes)


def printed() -> pd.DataFrame:
    """What the thesis prints, by potential, algorithm and sensor, in units of 10^4."""
    table = published.load("table-3.1").astype({"sensor": bool})
    table = table.rename(columns={"value": "printed_mean", "ci95": "printed_ci95"})
    return table[["potential", "algorithm", "sensor", "printed_mean", "printed_ci95"]]


def all_cells(config: Config) -> list[Cell]:
    """Every entry; the sensor part has no Q_mu row, as in the thesis."""
    return [
        Cell(p, a, s)
        for s, p, a in product(config.sensors, config.potentials, config.algorithms)
        if not (s and p == "Q_mu")
    ]


@dataclass(frozen=True)
class Entry:
    """One entry of the table; rewards in units of 10^4."""

    potential: str
    """none, Q_star, Q_tilde, Q_mu, or constant (our control)."""
    algorithm: str
    """q_learning or sarsa."""
    sensor: bool
    """Whether the agent has the cliff sensor."""
    mean_return: float
    """Mean total reward of a run, in 10^4."""
    ci95: float
    """Half-width of the 95% t interval of the mean, in 10^4."""
    sd: float
    """Standard deviation over runs, in 10^4."""
    n_runs: int
    """Number of runs."""
    printed_mean: float
    """What the thesis prints, in 10^4; empty where it prints nothing."""
    printed_ci95: float
    """The half-width it prints, in 10^4."""


@experiment(
    "table-3.1",
    item="Table 3.1",
    smoke=Config(n_runs=4, episodes=20, mu=MuSearch("ga", ga=GeneticAlgorithm(generations=5))),
    book=Config(n_runs=1000),
    thesis=Config(),
    seconds=15,
)
def entries(config: Config, context: Context) -> list[Entry]:
    """Total reward on the episodic cliff, by potential, learner and sensor."""
    cells = all_cells(config)
    totals = episode_returns(config, cells, context).sum(axis=2) / UNIT
    wanted = printed().set_index(["potential", "algorithm", "sensor"])
    wanted = wanted.reindex([(c.potential, c.algorithm, c.sensor) for c in cells])
    return [
        Entry(c.potential, c.algorithm, c.sensor, **returns(total), **target)
        for c, total, target in zip(cells, totals, wanted.to_dict("records"), strict=True)
    ]


UNITS = "total reward in 10⁴"


def _pair(table: pd.DataFrame, first: tuple[str, str, bool], second: tuple[str, str, bool]) -> Pair:
    """Two entries compared, named by what tells them apart."""
    by = table.set_index(["potential", "algorithm", "sensor"])
    words = [
        (NAMES[p], LEARNERS[a], "with sensor" if s else "without sensor")
        for p, a, s in (first, second)
    ]
    apart = next(i for i in range(3) if words[0][i] != words[1][i])
    where = [w for i, w in enumerate(words[0]) if i != apart]
    return Pair(
        summary(by.loc[first]),
        summary(by.loc[second]),
        (words[0][apart], words[1][apart]),
        ", ".join(where),
    )


@criterion("3.4.1-numbers", entries)
def printed_numbers(table: pd.DataFrame) -> Finding:
    """Whether all entries but those of Q^mu meet the printed ones; the episodes were fitted."""
    own = table[(table.potential != "Q_mu") & table.printed_mean.notna()]
    error = own.printed_ci95 / stats.norm.ppf(0.975)
    return near_printed(
        *(own.mean_return, own.sd / own.n_runs**0.5, own.printed_mean, error), fitted=1
    )


@criterion("3.4.1-sarsa-beats-q-learning", entries)
def sarsa_beats_q_learning(table: pd.DataFrame) -> Finding:
    """Unshaped Sarsa against unshaped Q-learning, with and without sensor."""
    parts = (False, True)
    pairs = [_pair(table, ("none", "sarsa", s), ("none", "q_learning", s)) for s in parts]
    return ordered(pairs, UNITS)


def _potentials_help(table: pd.DataFrame, algorithm: str, sensor: bool) -> Finding:
    """Q* and Q~ against no shaping, and Q~ against Q*."""
    better = (("Q_star", "none"), ("Q_tilde", "none"), ("Q_tilde", "Q_star"))
    pairs = [_pair(table, (a, algorithm, sensor), (b, algorithm, sensor)) for a, b in better]
    return ordered(pairs, UNITS)


@criterion("3.4.1-potentials-help-q-learning", entries)
def potentials_help_q_learning(table: pd.DataFrame) -> Finding:
    """For Q-learning without sensor."""
    return _potentials_help(table, "q_learning", False)


@criterion("3.4.1-sensor-helps-sarsa", entries)
def sensor_lets_potentials_help_sarsa(table: pd.DataFrame) -> Finding:
    """For Sarsa with the sensor."""
    return _potentials_help(table, "sarsa", True)


@criterion("3.4.1-q-learning-with-sensor", entries)
def potentials_help_q_learning_with_sensor(table: pd.DataFrame) -> Finding:
    """For Q-learning with the sensor: the same picture as without."""
    return _potentials_help(table, "q_learning", True)


@criterion("3.4.1-nothing-helps-sarsa", entries)
def nothing_helps_sarsa(table: pd.DataFrame) -> Finding:
    """Q* and Q~ for Sarsa without sensor: better than no shaping by at most 2%."""
    pairs = [_pair(table, (p, "sarsa", False), ("none", "sarsa", False))
             for p in ("Q_star", "Q_tilde")]  # fmt: skip
    return no_greater(pairs, 0.02, UNITS)


@criterion("3.4.1-sensor-within-a-task")
def sensor_does_not_matter_in_one_task() -> Finding:
    """Whether each task of the episodic cliff is one process with the sensor and without."""
    without, own = (episodic_cliff(sensor).tasks for sensor in (False, True))
    same = sum(_same_process(*pair) for pair in zip(without, own, strict=True))
    return exact(
        same == len(own),
        f"With the sensor and without, {same} of {len(own)} tasks have the same states, steps, "
        "rewards and start, and within a task every state has an observation of its own: where "
        "all do, a learner without potential draws from the same law.",
    )


def _same_process(task: MDP, other: MDP) -> bool:
    """Whether two tasks differ at most in the features of their states."""
    # What is expected of each state's indicator is how likely it comes next.
    steps, others = ([t.expectation(s) for s in np.eye(t.n_states)] for t in (task, other))
    return (
        task.discount == other.discount
        and np.array_equal(steps, others)
        and all(
            np.array_equal(getattr(task, part), getattr(other, part))
            for part in ("reward", "start", "terminal")
        )
    )


@criterion("3.4.1-q-mu-is-poor", entries)
def q_mu_is_poor(table: pd.DataFrame) -> Finding:
    """Q^mu against no shaping, for both learners, and against the size printed."""
    methods = ("q_learning", "sarsa")
    pairs = [_pair(table, ("none", a, False), ("Q_mu", a, False)) for a in methods]
    finding = ordered(pairs, UNITS)
    own = table[(table.potential == "Q_mu") & table.printed_mean.notna()]
    near = (abs(own.mean_return - own.printed_mean) <= own.ci95 + own.printed_ci95).all()
    prints = several(f"{LEARNERS[r.algorithm]} {r.printed_mean:g}" for r in own.itertuples())
    verdict = finding.verdict
    if verdict is Verdict.REPRODUCED and not near:
        verdict = Verdict.DIRECTION
    return Finding(
        verdict, f"{finding.evidence} With Q^μ the thesis prints {prints}.", finding.numbers
    )


def control(table: pd.DataFrame) -> str:
    """What a constant potential earns over no shaping, by learner and sensor."""
    tests = {}
    for s, a in product((False, True), ("q_learning", "sarsa")):
        pair = _pair(table, ("constant", a, s), ("none", a, s))
        where = f"{LEARNERS[a]} {'with' if s else 'without'} sensor"
        tests[where] = welch(pair.first, pair.second)
    return several(
        f"{number(t.difference, (t.high - t.low) / 2, sign=True)} ± "
        f"{number((t.high - t.low) / 2, (t.high - t.low) / 2)} ({where})"
        for where, t in tests.items()
    )


def figure(table: pd.DataFrame) -> Figure:
    """Ours less the printed mean of each entry, with both intervals."""
    own = table[(table.potential != "Q_mu") & table.printed_mean.notna()]
    fig, ax = plt.subplots(figsize=(7.2, 3.8))
    y = np.arange(len(own))[::-1]
    ours = own.mean_return - own.printed_mean
    for x, half, shift, marker, colour, label in (
        (0 * ours, own.printed_ci95, -0.15, "D", PRINTED, "thesis"),
        (ours, own.ci95, 0.15, "o", COLOURS[0], "ours"),
    ):
        ax.errorbar(x, y + shift, xerr=half, fmt=marker, color=colour, capsize=2, label=label)
    labels = [
        f"{LEARNERS[r.algorithm]}, {SYMBOLS[r.potential]}{', sensor' if r.sensor else ''}"
        for r in own.itertuples()
    ]
    ax.set_yticks(y, labels, fontsize=8)
    ax.set_xlabel(r"difference from the printed mean [$10^4$]")
    ax.legend()
    return fig


def shown(table: pd.DataFrame, *, sensor: bool) -> pd.DataFrame:
    """One part of the table as text: ours and, where it prints them, the thesis's."""
    own = table[table.sensor == sensor]
    records = []
    for name, row in own.groupby("potential", sort=False):
        record = {"potential": SYMBOLS[name]}
        for r in row.itertuples():
            learner = LEARNERS[r.algorithm]
            record[f"{learner}, ours"] = f"{r.mean_return:.2f} ± {r.ci95:.2f}"
            if "printed_mean" in own:
                theirs = (
                    "–" if np.isnan(r.printed_mean) else f"{r.printed_mean:g} ± {r.printed_ci95:g}"
                )
                record[f"{learner}, thesis"] = theirs
        records.append(record)
    return pd.DataFrame(records)
