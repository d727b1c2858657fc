"""Beyond the thesis: two value functions learned at once (the suggestion of section 3.6)."""

from __future__ import annotations

from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy import stats

from thesis_lib import potentials
from thesis_lib.arrays import FloatArray
from thesis_lib.chapter3.runs import SETTINGS, TabularLearner, total_rewards
from thesis_lib.domains import Domain
from thesis_lib.edition.criteria import EXACT, Pair, equivalent, no_greater
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, criterion
from thesis_lib.edition.plots import COLOURS, PRINTED
from thesis_lib.mdp.learning import learn
from thesis_lib.stats import Summary, mean_ci


@dataclass(frozen=True)
class Config:
    """How two value functions are learned at once (the suggestion of section 3.6)."""

    domains: tuple[str, ...] = tuple(SETTINGS)
    """Domains of chapter 3."""
    steps: tuple[int, ...] = (1_000, 10_000, 100_000, 1_000_000)
    """Learning steps on each source task."""
    alpha: float = 0.1
    """Learning rate of both value functions."""
    repeats: int = 10
    """Runs on each target task with the potential so obtained."""
    n_sources: int = 5
    """Independent sets of source solutions."""


@dataclass(frozen=True)
class Return:
    """What a potential that was learned is worth, against the exact one."""

    domain: str
    """Which domain."""
    potential: str
    """Q_star from the learner's own values, Q_tilde from those on the side."""
    steps: int
    """Learning steps on each source task."""
    relative_error: float
    """Mean |learned - exact| over the largest deviation of the exact Q~."""
    error_sd: float
    """Its standard deviation over sets of source solutions."""
    n_sources: int
    """Number of sets of source solutions."""
    mean_return: float
    """Mean total reward of a Q-learner with the learned potential."""
    ci95: float
    """Half-width of its 95% t interval over runs."""
    n_runs: int
    """Number of runs."""
    exact_mean: float
    """The same with the exact potential."""
    exact_ci95: float
    """Half-width of its 95% t interval."""
    exact_n_runs: int
    """Number of runs with the exact potential."""


@experiment(
    "ch3-two-values",
    item="Section 3.6, two value functions at once",
    smoke=Config(domains=("triangle",), steps=(100,), repeats=2, n_sources=2),
    book=Config(repeats=5),
    thesis=Config(),
    seconds=19,
)
def learned_on_the_side(config: Config, context: Context) -> list[Return]:
    """A Q-learner that learns the soft values on the side, against the exact potential."""
    records = []
    for d, name in enumerate(config.domains):
        domain = SETTINGS[name].domain()
        target = next(x for x in SETTINGS[name].learners if x.method == "q_learning")
        # The source learner explores as the target learner will: the soft values are its own.
        exact = potentials.q_tilde(domain, target.epsilon)
        star = potentials.q_star(domain)
        spread = float(np.abs(exact - exact.mean()).max())
        for steps in config.steps:

            def source(
                seed: np.random.SeedSequence,
                steps: int = steps,
                domain: Domain = domain,
                target: TabularLearner = target,
            ) -> tuple[FloatArray, FloatArray]:
                rng = np.random.default_rng(seed)
                own, side = [], []
                for task in domain.tasks:
                    learned = learn(
                        task,
                        "q_learning",
                        alpha=config.alpha,
                        epsilon=target.epsilon,
                        steps=steps,
                        companion="expected_sarsa",
                        rng=rng,
                    )
                    assert learned.companion is not None
                    own.append(learned.q)
                    side.append(learned.companion)
                return (
                    potentials.cross_task_values(domain, own),
                    potentials.cross_task_values(domain, side),
                )

            pairs = context.map(source, context.seeds(config.n_sources, 36, d, steps), name)
            for potential, learned, truth in (
                ("Q_star", [p[0] for p in pairs], star),
                ("Q_tilde", [p[1] for p in pairs], exact),
            ):
                # As many runs with the exact potential as with the learned ones.
                cells = [(target, phi) for phi in (*learned, *[truth] * len(learned))]
                totals = total_rewards(context, domain, cells, config.repeats, name)
                reached, best = mean_ci(totals[: len(learned)]), mean_ci(totals[len(learned) :])
                errors = [float(np.abs(phi - truth).mean()) / spread for phi in learned]
                records.append(
                    Return(
                        domain=name,
                        potential=potential,
                        steps=steps,
                        relative_error=float(np.mean(errors)),
                        error_sd=float(np.std(errors, ddof=1)),
                        n_sources=len(errors),
                        mean_return=reached.mean,
                        ci95=reached.half_width,
                        n_runs=reached.n,
                        exact_mean=best.mean,
                        exact_ci95=best.half_width,
                        exact_n_runs=best.n,
                    )
                )
    return records


@criterion("3.6-two-values", learned_on_the_side)
def side_values_are_as_good(table: pd.DataFrame) -> Finding:
    """Error of Q~ learned on the side for longest, against that of Q* from the same runs."""
    at = table[table.steps == table.steps.max()]
    by = at.set_index(["domain", "potential"])
    pairs = [
        Pair(
            _error(by.loc[domain, "Q_tilde"]),
            _error(by.loc[domain, "Q_star"]),
            ("Q~", "Q*"),
            domain,
        )
        for domain in dict.fromkeys(at.domain)
        if by.relative_error[domain].max() > EXACT
    ]
    found = no_greater(pairs, 0.05, "mean error as a share of the spread of Q~", tolerant=True)
    returns = equivalent(_returns(at[at.potential == "Q_tilde"]), 0.05)
    return Finding(
        found.verdict,
        f"After {at.steps.iloc[0]:,} steps a task, where either errs: {found.evidence} As a "
        f"potential, return beside that of the exact Q~: {returns.evidence}",
        {**found.numbers, **returns.numbers},
    )


def _error(row: pd.Series) -> Summary:
    """Error over sets of source solutions."""
    return Summary(float(row.relative_error), float(row.error_sd), int(row.n_sources))


def _returns(side: pd.DataFrame) -> list[Pair]:
    """Return with what was learned on the side and with the exact potential, by domain."""
    pairs = []
    for r in side.itertuples():
        one, other = (
            Summary(mean, half * n**0.5 / float(stats.t.ppf(0.975, n - 1)), n)
            for mean, half, n in (
                (r.mean_return, r.ci95, r.n_runs),
                (r.exact_mean, r.exact_ci95, r.exact_n_runs),
            )
        )
        pairs.append(Pair(one, other, ("learned on the side", "exact"), r.domain))
    return pairs


def worth(table: pd.DataFrame) -> pd.DataFrame:
    """What Q~ learned on the side earns, relative to the exact one, after the longest training.

    Returns
    -------
    pandas.DataFrame
        A row a domain: ``domain``, ``gain`` as a share of the exact one's return, ``low`` and
        ``high`` of its 95% interval, and ``told`` in words.
    """
    side = table[(table.potential == "Q_tilde") & (table.steps == table.steps.max())]
    gain = (side.mean_return - side.exact_mean) / side.exact_mean.abs()
    half = np.hypot(side.ci95, side.exact_ci95) / side.exact_mean.abs()
    ends = zip(side.domain, gain, gain - half, gain + half, strict=True)
    told = [f"{name} ({g:+.0%}, 95% interval {a:+.0%} to {b:+.0%})" for name, g, a, b in ends]
    told = [words.replace("-", "\N{MINUS SIGN}") for words in told]
    return pd.DataFrame(
        {"domain": side.domain, "gain": gain, "low": gain - half, "high": gain + half, "told": told}
    )


def figure(table: pd.DataFrame) -> Figure:
    """Error of the potentials learned on the side, and the return they give."""
    domains = list(dict.fromkeys(table.domain))
    fig, axes = plt.subplots(1, 2, figsize=(7.2, 3.4))
    for i, domain in enumerate(domains):
        for name, style in (("Q_star", ":"), ("Q_tilde", "-")):
            own = table[(table.domain == domain) & (table.potential == name)]
            axes[0].loglog(
                own.steps,
                own.relative_error,
                style,
                marker="o",
                ms=3,
                color=COLOURS[i],
                label=domain if name == "Q_tilde" else None,
            )
            if name == "Q_tilde":
                gain = (own.mean_return - own.exact_mean) / own.exact_mean.abs()
                error = np.hypot(own.ci95, own.exact_ci95) / own.exact_mean.abs()
                axes[1].errorbar(
                    own.steps, gain, yerr=error, marker="o", ms=3, capsize=2, color=COLOURS[i]
                )
    axes[0].set(xlabel="steps a source task", ylabel="mean error / spread of $\\tilde Q_d$")
    axes[1].set(
        xscale="log", xlabel="steps a source task", ylabel="relative return, learned − exact"
    )
    axes[1].axhline(0, color=PRINTED, lw=1)
    fig.legend(loc="outside lower center", ncols=3, fontsize=8)
    return fig
