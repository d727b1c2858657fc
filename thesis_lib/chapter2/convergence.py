"""Where Q-learning and Sarsa converge to on the cliff while they explore (section 2.3.3)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from thesis_lib.arrays import FloatArray
from thesis_lib.chapter2.one_cliff import LEARNERS, Algorithm, layout, task
from thesis_lib.domains.cliff import members
from thesis_lib.edition.criteria import EXACT
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.words import number, plus_minus, several
from thesis_lib.mdp.learning import Learned, learn
from thesis_lib.mdp.model import TabularMDP
from thesis_lib.mdp.planning import soft_policy_iteration, solve
from thesis_lib.stats import mean_ci


@dataclass(frozen=True)
class Config:
    """How long, how exploratory, and how rates fade."""

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


@dataclass(frozen=True)
class Distance:
    """Where the values of a run stand after some steps."""

    algorithm: str
    """q_learning or sarsa."""
    exploration: str
    """constant or fading."""
    epsilon: float
    """Probability of a random action; the first one where it fades."""
    run: int
    """Number of the run."""
    step: int
    """Steps taken."""
    start_value: float
    """Largest learned value in the start state."""
    start_optimal: float
    """The same of Q*, exact."""
    start_soft: float
    """The same of the best policy that explores with epsilon, exact."""
    error_optimal: float
    """Root mean square of Q - Q* over the task's state-action pairs."""
    error_soft: float
    """The same for the values of the best policy that explores with epsilon."""
    gap: float
    """The same for the difference of the two exact value functions."""


@experiment(
    "ch2-convergence",
    item="Section 2.3.3",
    smoke=Config(runs=2, steps=2_000, checkpoints=4),
    book=Config(),
    seconds=8,
)
def distances(config: Config, context: Context) -> list[Distance]:
    """Where Q-learning and Sarsa converge to on the cliff while they explore."""
    mdp, pairs = task(), members(layout())
    start = int(mdp.start.argmax())
    optimal = solve(mdp).q
    settings: list[tuple[Algorithm, str, float]] = [
        *(("q_learning", "constant", e) for e in config.epsilons_q_learning),
        *(("sarsa", "constant", e) for e in config.epsilons_sarsa),
        ("sarsa", "fading", config.epsilon_fading),
    ]
    records = []
    for i, (algorithm, schedule, epsilon) in enumerate(settings):
        soft = soft_policy_iteration(mdp, epsilon).q
        explore = config.rate(epsilon) if schedule == "fading" else epsilon
        run = partial(_converge, config=config, mdp=mdp, algorithm=algorithm, epsilon=explore)
        label = f"{algorithm}, epsilon {epsilon:g} {schedule}"
        results = context.map(run, context.seeds(config.runs, i), label)
        for which, learned in enumerate(results):
            assert learned.checkpoint_q is not None
            records += [
                Distance(
                    *(algorithm, schedule, epsilon, which, int(step)),
                    start_value=q[start].max(),
                    start_optimal=optimal[start].max(),
                    start_soft=soft[start].max(),
                    error_optimal=_rms((q - optimal)[pairs]),
                    error_soft=_rms((q - soft)[pairs]),
                    gap=_rms((soft - optimal)[pairs]),
                )
                for step, q in zip(learned.checkpoint_steps, learned.checkpoint_q, strict=True)
            ]
    return records


def _converge(
    seed: np.random.SeedSequence,
    *,
    config: Config,
    mdp: TabularMDP,
    algorithm: Algorithm,
    epsilon: float | FloatArray,
) -> Learned:
    """One long run with fading learning rates."""
    return learn(
        mdp,
        algorithm,
        alpha=config.rate(config.alpha),
        epsilon=epsilon,
        steps=config.steps,
        checkpoint_every=config.steps // config.checkpoints,
        record=["q"],
        rng=np.random.default_rng(seed),
    )


def _rms(x: FloatArray) -> float:
    return float(np.sqrt((x**2).mean()))


def last(table: pd.DataFrame, algorithm: str, exploration: str = "constant") -> pd.DataFrame:
    """The runs of a learner at their end."""
    own = table[(table.algorithm == algorithm) & (table.exploration == exploration)]
    return own[own.step == own.step.max()]


@criterion("2.3.3-q-learning-converges", distances)
def q_learning_converges(table: pd.DataFrame) -> Finding:
    """Largest distance of any run from the optimal values, by exploration."""
    end = last(table, "q_learning")
    worst = end.groupby("epsilon").error_optimal.max()
    told = several(f"{error:.2g} at ε = {epsilon:g}" for epsilon, error in worst.items())
    return Finding(
        Verdict.REPRODUCED if (worst < 1).all() else Verdict.NOT_REPRODUCED,
        f"Largest distance of any run from Q* at the end: {told}; the best soft values lie "
        f"{number(end.gap.min())} or more away from Q*.",
        {f"epsilon {epsilon:g}": float(error) for epsilon, error in worst.items()},
    )


@criterion("2.3.3-sarsa-cannot-converge", distances)
def sarsa_cannot_converge(table: pd.DataFrame) -> Finding:
    """Whether the learned value of the start is nearer to the best soft one than to Q*'s."""
    end = last(table, "sarsa")
    off = (end.start_value - end.start_optimal).abs()
    nearer = (end.start_value - end.start_soft).abs() < off
    told = []
    for epsilon, own in end.groupby("epsilon"):
        learned = mean_ci(own.start_value)
        told.append(
            f"at ε = {epsilon:g} the start is worth {plus_minus(learned.mean, learned.half_width)} "
            f"as learned (n = {learned.n}), {number(own.start_soft.iloc[0])} under the best soft "
            f"policy and {number(own.start_optimal.iloc[0])} under the optimal one"
        )
    holds = bool((end.gap > EXACT).all() and nearer.all())
    return Finding(
        Verdict.REPRODUCED if holds else Verdict.NOT_REPRODUCED,
        f"The learned value is nearer to the soft one in {nearer.mean():.0%} of runs: "
        f"{'; '.join(told)}.",
        {"nearer": float(nearer.mean())},
    )


def figure(table: pd.DataFrame, epsilon: float = 0.1) -> Figure:
    """Learned value of the start at one epsilon, and distance from the optimal values.

    On the right Sarsa explores with epsilon .3.

    Parameters
    ----------
    table
        Of :func:`distances`.
    epsilon
        Exploration on the left.
    """
    fig, (left, right) = plt.subplots(1, 2, figsize=(7.2, 3.8))
    _starts(left, table[table.epsilon == epsilon])
    steady = table[table.exploration == "constant"]
    styles = iter(["C0-", "C0--", "C0:", "C1--"])
    for (algorithm, rate), own in steady.groupby(["algorithm", "epsilon"]):
        if algorithm == "q_learning" or rate == 0.3:
            distance = own.groupby("step").error_optimal.mean()
            right.loglog(distance, next(styles), label=f"{LEARNERS[algorithm]}, {rate:g}")
    left.set(xlabel="step", ylabel="learned value of the start", xscale="log", ylim=(-17, -4))
    right.set(xlabel="step", ylabel="distance from $Q^*$")
    left.legend(loc="lower right")
    right.legend(loc="center right")
    return fig


def _starts(ax: Axes, table: pd.DataFrame) -> None:
    """Mean and 95% range of the learned value of the start, beside the exact values."""
    for (algorithm, how), own in table.groupby(["algorithm", "exploration"]):
        fades = ", fading" if how == "fading" else ""
        by_step = own.groupby("step").start_value
        (line,) = ax.plot(by_step.mean(), label=LEARNERS[algorithm] + fades)
        low, high = by_step.quantile(0.025), by_step.quantile(0.975)
        ax.fill_between(low.index, low, high, alpha=0.25, lw=0, color=line.get_color())
    for column, text in (("start_optimal", "$Q^*$"), ("start_soft", r"$\tilde Q$")):
        value = table[column].iloc[0]
        ax.axhline(value, color="k", ls=":", lw=1)
        ax.text(table.step.min(), value - 0.1, text, va="top")
