"""Figure 3.2: Sarsa on the continuing cliff while it learns."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import ArrayLike
from scipy import stats

from thesis_lib import potentials
from thesis_lib.arrays import FloatArray
from thesis_lib.chapter3.runs import (
    COLOUR,
    NAMES,
    SYMBOLS,
    MuSearch,
    compared,
    curves,
    named_potentials,
)
from thesis_lib.chapter3.sarsa_solution import sarsa_solutions
from thesis_lib.domains import continuing_cliff
from thesis_lib.edition.criteria import LEVEL, Pair, no_greater, ordered, positive
from thesis_lib.edition.experiment import Context, Returns, experiment, returns
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.plots import PRINTED, band
from thesis_lib.mdp.learning import learn
from thesis_lib.stats import Summary, equivalence, holm, mean_ci


@dataclass(frozen=True)
class Config:
    """Settings of figure 3.2."""

    discount: float = 0.95
    """gamma, which the thesis does not print."""
    epsilon: float = 0.01
    """Exploration rate."""
    alpha: float = 0.07
    """Learning rate; the thesis does not print the one of this figure."""
    steps: int = 100_000
    """Steps a run."""
    n_runs: int = 100
    """Runs the mean is over, each on a task drawn from the domain."""
    points: int = 200
    """Points of a curve."""
    names: tuple[str, ...] = ("none", "Q_star", "Q_tilde", "Q_tilde_sarsa")
    """Potentials."""
    sarsa_steps: int = 10_000_000
    """Steps of the Sarsa runs behind Q_tilde_sarsa."""
    learned: int = 10
    """Times Q_tilde_sarsa is learned anew, each for as many of the runs."""
    stasis: int = 10_000
    """A stretch of so many steps without reaching the goal counts as stasis."""

    def __post_init__(self) -> None:
        if self.n_runs % self.learned:
            raise ValueError(
                f"n_runs is {self.n_runs}, but it must be a multiple of learned ({self.learned}), "
                "so that each potential that was learned has as many runs."
            )


def shaping(config: Config, context: Context, learned: int) -> dict[str, list[FloatArray]]:
    """The potentials of figure 3.2 by name, of Q_tilde_sarsa as many as are to be learned."""
    domain = continuing_cliff(config.discount)
    names = [n for n in config.names if n != "Q_tilde_sarsa"]
    phi = named_potentials(domain, names, epsilon=config.epsilon, mu=MuSearch(), seed=context.seed)
    found = {name: [potential] for name, potential in phi.items()}
    if "Q_tilde_sarsa" in config.names:
        found["Q_tilde_sarsa"] = []
        for seed in context.seeds(learned, 34):
            own = replace(context, seed=int(seed.generate_state(1)[0]))
            solutions = sarsa_solutions(
                domain, own, alpha=0.07, epsilon=config.epsilon, steps=config.sarsa_steps
            )
            found["Q_tilde_sarsa"].append(potentials.cross_task_values(domain, solutions))
    return found


SMOKE = Config(n_runs=4, steps=1000, points=10, sarsa_steps=2000, learned=2, stasis=100)
BOOK = Config(learned=5)


@dataclass(frozen=True)
class Point(Returns):
    """A point of a mean curve: returns are cumulative rewards up to it.

    The runs on one learned potential count as one, their mean.
    """

    potential: str
    """none, Q_star, Q_tilde (exact), Q_tilde_sarsa (learned)."""
    step: int
    """Learning steps taken."""
    stasis_share: float
    """Share of the whole run in stretches without a goal, mean over runs."""
    stasis_ci95: float
    """Half-width of its 95% t interval."""


@experiment("figure-3.2", item="Figure 3.2", smoke=SMOKE, book=BOOK, thesis=Config(), seconds=22)
def mean_curves(config: Config, context: Context) -> list[Point]:
    """Cumulative reward of Sarsa on the continuing cliff while it learns, mean of runs."""
    domain = continuing_cliff(config.discount)
    every = config.steps // config.points
    seeds = context.seeds(config.n_runs, 32)
    records = []
    for name, found in shaping(config, context, config.learned).items():
        every_initial = [domain.scatter_all(potential) for potential in found]

        def one(
            run: int, every_initial: list[list[FloatArray]] = every_initial
        ) -> tuple[FloatArray, float]:
            rng = np.random.default_rng(seeds[run])
            m = int(domain.sample(1, rng)[0])
            initial = every_initial[run % len(every_initial)]
            learned = learn(
                domain.tasks[m],
                "sarsa",
                alpha=config.alpha,
                epsilon=config.epsilon,
                steps=config.steps,
                initial_q=initial[m],
                rng=rng,
                checkpoint_every=every,
                record={"rewards"},
            )
            assert learned.rewards is not None
            return learned.checkpoint_rewards, stasis_share(learned.rewards, config.stasis)

        results = context.map(one, range(config.n_runs), name)
        reached = independent([curve for curve, _ in results], len(found))
        share = mean_ci(independent([share for _, share in results], len(found)))
        records += [
            Point(
                potential=name,
                step=(i + 1) * every,
                stasis_share=share.mean,
                stasis_ci95=share.half_width,
                **returns(reached[:, i]),
            )
            for i in range(config.points)
        ]
    return records


def independent(runs: ArrayLike, potentials: int) -> FloatArray:
    """What counts as one observation: a run, or the mean of those that share a random potential.

    Parameters
    ----------
    runs
        Runs first; run i had potential ``i % potentials``.
    potentials
        How many there are; 1 is one that nothing drew.
    """
    values = np.asarray(runs, dtype=float)
    if potentials == 1:
        return values
    means: FloatArray = values.reshape(-1, potentials, *values.shape[1:]).mean(axis=0)
    return means


def stasis_share(rewards: FloatArray, length: int) -> float:
    """Share of a run spent in stretches of at least ``length`` steps without a goal."""
    goals = np.flatnonzero(rewards > 0)
    gaps = np.diff(np.concatenate([[-1], goals, [len(rewards)]])) - 1
    return float(gaps[gaps >= length].sum() / len(rewards))


@dataclass(frozen=True)
class Moment:
    """A point of a single run."""

    potential: str
    """As in figure-3.2."""
    step: int
    """Learning steps taken."""
    cumulative_reward: float
    """Up to the step."""
    td_error: float
    """Mean |TD error| since the point before."""
    largest_td_error: float
    """Largest |TD error| since the point before."""


@experiment(
    "figure-3.2-runs", item="Figure 3.2, single runs", smoke=SMOKE, book=Config(), seconds=2
)
def single_runs(config: Config, context: Context) -> list[Moment]:
    """Cumulative reward and TD error of single runs of Sarsa on the continuing cliff.

    The same task and seed for every potential: the domain's first task.
    """
    domain = continuing_cliff(config.discount)
    every = config.steps // config.points
    records = []
    for name, (potential,) in shaping(config, context, 1).items():
        learned = learn(
            domain.tasks[0],
            "sarsa",
            alpha=config.alpha,
            epsilon=config.epsilon,
            steps=config.steps,
            initial_q=domain.scatter(potential, 0),
            rng=np.random.default_rng(context.seeds(1, 33)[0]),
            record={"rewards", "td_errors"},
        )
        assert learned.rewards is not None
        assert learned.td_errors is not None
        cumulative = np.cumsum(learned.rewards)
        size = np.abs(learned.td_errors[: every * config.points]).reshape(config.points, every)
        for i in range(config.points):
            step = (i + 1) * every
            records.append(Moment(name, step, cumulative[step - 1], size[i].mean(), size[i].max()))
    return records


def _shaped(table: pd.DataFrame) -> list[str]:
    return [name for name in dict.fromkeys(table.potential) if name != "none"]


EARLY, LATE = 3_000, 30_000
"""Steps between which the boost of "up to around 10^4 steps" must end."""


def _at(table: pd.DataFrame, step: int) -> list[Pair]:
    """Each shaped Sarsa against the unshaped one at the point of the curve nearest to a step."""
    steps = table.step.unique()
    at = table[table.step == steps[abs(steps - step).argmin()]]
    return [compared(at, name, "none", f"step {at.step.iloc[0]:,}") for name in _shaped(table)]


@criterion("3.4.2-early-boost", mean_curves)
def early_boost(table: pd.DataFrame) -> Finding:
    """Shaped Sarsa ahead early, and shown to have lost that lead late."""
    pairs, later = _at(table, EARLY), _at(table, LATE)
    early, late = ordered(pairs), no_greater(later, 0.0)
    gone = _ended(pairs, later)
    ended = all(gone) and late.numbers["greater"] == 0
    verdict = early.verdict
    if not ended and verdict is Verdict.REPRODUCED:
        verdict = Verdict.DIRECTION
    told = (
        f"Of {len(gone)} leads {sum(gone) or 'none'} ended: significantly smaller late than early "
        "(t, Holm), or late equivalent to none within 5%."
    )
    return Finding(
        verdict,
        f"Early: {early.evidence} Late: {late.evidence} {told}",
        {**early.numbers, **late.numbers, "ended": sum(gone)},
    )


def _ended(early: list[Pair], late: list[Pair]) -> list[bool]:
    """Of each early lead whether it is shown to be gone or smaller at a later step.

    As if the points of a curve were independent; they share runs, so that the error of their
    difference is smaller than that.
    """
    p, alike = [], []
    for then, now in zip(early, late, strict=True):
        four = (then.first, then.second, now.first, now.second)
        error = float(np.sqrt(sum(s.sd**2 / s.n for s in four)))
        fall = (then.first.mean - then.second.mean) - (now.first.mean - now.second.mean)
        t = fall / error if error else np.inf * np.sign(fall)
        p.append(float(2 * stats.t.sf(t, min(s.n for s in four) - 1)) if fall > 0 else 1.0)
        margin = 0.05 * abs(now.second.mean)
        alike.append(margin > 0 and equivalence(now.first, now.second, margin).p_value < LEVEL)
    return [bool(q < LEVEL or same) for q, same in zip(holm(p), alike, strict=True)]


@criterion("3.4.2-net-loss", mean_curves)
def net_loss(table: pd.DataFrame) -> Finding:
    """Unshaped Sarsa against each shaped one at the end of the run."""
    last = table[table.step == table.step.max()]
    return ordered([compared(last, "none", name) for name in _shaped(table)], "cumulative reward")


@criterion("3.4.2-stasis", mean_curves)
def stasis(table: pd.DataFrame) -> Finding:
    """Share of the run in long stretches without a goal, shaped against unshaped."""
    by = table.groupby("potential").first()
    share = {
        name: Summary(row.stasis_share, row.stasis_ci95 * row.sd / row.ci95, int(row.n_runs))
        for name, row in by.iterrows()
    }
    pairs = [Pair(share[n], share["none"], (NAMES[n], NAMES["none"])) for n in _shaped(table)]
    return ordered(pairs, "share of the run in stasis")


AWAKE = (1_000, 10_000)
"""Steps between which unshaped Sarsa has learned and must not be in stasis yet."""


@criterion("3.4.2-unshaped-stasis", mean_curves)
def unshaped_stasis(table: pd.DataFrame) -> Finding:
    """Unshaped Sarsa's share of the run in stasis, and its reward a step early and later."""
    own = table[table.potential == "none"].set_index("step")
    steps = [min(own.index, key=lambda s: abs(s - at)) for at in AWAKE] + [own.index.max()]
    at = own.loc[steps]
    lengths = np.maximum(np.diff(steps), 1)
    early, late = np.diff(at.mean_return) / lengths
    # Points of a curve share runs, so that the errors of differences are added.
    error = (at.sd / at.n_runs**0.5).to_numpy()
    gap = float(((error[:-1] + error[1:]) / lengths).sum())
    share, half = own.stasis_share.iloc[0], own.stasis_ci95.iloc[0]
    spans = [f"{first:,} to {last:,}" for first, last in pairwise(steps)]
    return positive(
        {
            "share of the run in stasis less a half": (float(share) - 0.5, float(half) / 1.96),
            f"reward a step from {spans[0]} less that from {spans[1]}": (float(early - late), gap),
        },
        "Unshaped Sarsa",
    )


def figure(mean: pd.DataFrame, runs: pd.DataFrame) -> Figure:
    """Mean cumulative reward, and single runs with their TD errors below."""
    names = list(dict.fromkeys(mean.potential))
    fig, axes = plt.subplots(3, len(names), figsize=(7.2, 5.6), sharex=True, squeeze=False)
    for column, name in zip(axes.T, names, strict=True):
        single = runs[runs.potential == name]
        top, middle, bottom = column
        band(top, mean[mean.potential == name], "step", 1e3, color=COLOUR[name])
        top.set_title(SYMBOLS[name], fontsize=10)
        middle.plot(single.step, single.cumulative_reward / 1e3, color="k", lw=1)
        bottom.semilogy(single.step, single.largest_td_error.clip(lower=1e-3), color="k", lw=0.8)
        bottom.xaxis.set_major_formatter(lambda step, _: f"{step / 1000:g}")
        bottom.set_xlabel("step [1000]")
    labels = (
        "mean cumulative\nreward [$10^3$]",
        "one run: cumul.\nreward [$10^3$]",
        "one run: largest\n|TD error|",
    )
    for row, label in zip(axes, labels, strict=True):
        row[0].set_ylabel(label, fontsize=9)
        limits = [ax.get_ylim() for ax in row]
        for ax in row:
            ax.set_ylim(min(a for a, _ in limits), max(b for _, b in limits))
            ax.tick_params(labelsize=8)
    return fig


def boost_figure(mean: pd.DataFrame) -> Figure:
    """Mean cumulative reward of every potential in one picture, steps on a logarithmic axis."""
    fig, ax = plt.subplots()
    curves(ax, mean, "step")
    ax.set(xscale="log", xlabel="step", ylabel="mean cumulative reward")
    ax.axvline(1e4, color=PRINTED, ls=":", label="end of the boost, as printed")
    ax.legend(fontsize=8)
    return fig
