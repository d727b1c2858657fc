"""Section 3.3.6: the choice of p(x|m)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import pandas as pd

from thesis_lib import potentials
from thesis_lib.arrays import FloatArray
from thesis_lib.chapter3.runs import (
    LEARNERS,
    NAMES,
    SETTINGS,
    SYMBOLS,
    MuSearch,
    TabularLearner,
    total_rewards,
)
from thesis_lib.domains import Domain
from thesis_lib.edition.criteria import LEVEL, Pair, equivalent, graded, share_at_least, summary
from thesis_lib.edition.experiment import Context, Returns, experiment, returns
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.words import plus_minus
from thesis_lib.mdp.greedy import epsilon_greedy
from thesis_lib.potentials import WEIGHTINGS
from thesis_lib.stats import holm, welch


@dataclass(frozen=True)
class Config:
    """Which p(x|m) are compared, and how often."""

    domains: tuple[str, ...] = tuple(SETTINGS)
    """Domains of chapter 3."""
    names: tuple[Literal["Q_star", "Q_tilde", "Q_mu"], ...] = ("Q_star", "Q_tilde", "Q_mu")
    """Potentials."""
    repeats: int = 50
    """Runs a task."""
    learning_steps: int = 20_000
    """T of the weighting that the learning process induces."""
    mu: MuSearch = field(default_factory=MuSearch)
    """The search for the cross-task policy; its ``weights`` are not used here."""


def potentials_by_weighting(
    domain: Domain, learner: TabularLearner, config: Config, seed: int
) -> dict[tuple[str, str], FloatArray]:
    """Each potential under each p(x|m) that applies to it (section 3.3.6)."""
    found: dict[tuple[str, str], FloatArray] = {}
    for name in config.names:
        if name == "Q_mu":
            mu = config.mu.policy(domain, seed)
            tables = potentials.policy_values(domain, mu)
            policies = potentials.task_policies(domain, mu)
        elif name == "Q_star":
            tables = potentials.optimal_solutions(domain)
            # Greedy but for a hair, so that the stationary distribution is unique.
            policies = [epsilon_greedy(q, 1e-6) for q in tables]
        else:
            tables = potentials.soft_solutions(domain, learner.epsilon)
            policies = [epsilon_greedy(q, learner.epsilon) for q in tables]
        for kind in WEIGHTINGS:
            if kind == "learning":
                if name == "Q_mu":  # "Clearly, this option does not apply"
                    continue
                weights = potentials.learning_weights(
                    domain,
                    learner.method,
                    alpha=learner.alpha,
                    epsilon=learner.epsilon,
                    steps=config.learning_steps,
                    rng=np.random.default_rng(seed),
                    snapshots=min(100, config.learning_steps),
                )
            else:
                weights = potentials.pair_weights(domain, kind, policies)  # type: ignore[arg-type]
            found[name, kind] = potentials.cross_task_values(domain, tables, weights)
    return found


@dataclass(frozen=True)
class Return(Returns):
    """Return with one potential under one p(x|m)."""

    domain: str
    """Which domain."""
    algorithm: str
    """The learner."""
    potential: str
    """Q_star, Q_tilde or Q_mu."""
    weighting: str
    """uniform, start, stationary or learning."""


@experiment(
    "ch3-weights",
    item="Section 3.3.6, the choice of p(x|m)",
    smoke=Config(domains=("triangle",), repeats=1, learning_steps=200, mu=MuSearch(restarts=1)),
    book=Config(repeats=30),
    thesis=Config(),
    seconds=11,
)
def compared(config: Config, context: Context) -> list[Return]:
    """Return of each potential under the four choices of p(x|m)."""
    records = []
    for name in config.domains:
        domain = SETTINGS[name].domain()
        for learner in SETTINGS[name].learners:
            phi = potentials_by_weighting(domain, learner, config, context.seed)
            cells = [(learner, p) for p in phi.values()]
            totals = total_rewards(context, domain, cells, config.repeats, name)
            for (potential, kind), total in zip(phi, totals, strict=True):
                own = {"potential": potential, "weighting": kind, **returns(total)}
                records.append(Return(domain=name, algorithm=learner.method, **own))
    return records


KEYS = ["domain", "algorithm", "potential"]


@criterion("3.3.6-weights", compared)
def weightings_do_not_matter(table: pd.DataFrame) -> Finding:
    """Q* and Q~ under the four p(x|m): equivalent within 5%, or significantly different."""
    pairs = []
    for (domain, algorithm, potential), group in table.groupby(KEYS):
        by = group.set_index("weighting")
        where = f"{domain}, {LEARNERS[algorithm]}, {NAMES[potential]}"
        if potential != "Q_mu":
            pairs += [
                Pair(summary(by.loc[kind]), summary(by.loc["uniform"]), (kind, "uniform"), where)
                for kind in ("start", "stationary", "learning")
            ]
    return equivalent(pairs, 0.05, "total reward")


@criterion("3.3.6-stationary-q-mu", compared)
def stationary_is_best_for_q_mu(table: pd.DataFrame) -> Finding:
    """In how many settings the stationary p(x|m) gives Q^mu its highest return, and how surely."""
    top, p, against = {}, [], []
    for (domain, algorithm), group in table[table.potential == "Q_mu"].groupby(KEYS[:2]):
        by = group.set_index("weighting").sort_values("mean_return")
        top[f"{domain}, {LEARNERS[algorithm]}"] = by.index[-1] == "stationary"
        others = by.drop(index="stationary")
        tests = [welch(summary(by.loc["stationary"]), summary(o)) for _, o in others.iterrows()]
        p.append(max(t.p_value if t.difference > 0 else 1.0 for t in tests))
        least = min(t.p_value if t.difference < 0 else 1.0 for t in tests)
        against.append(min(1.0, len(tests) * least))  # any of the others may be the better
    sure, beaten = (int((holm(q) < LEVEL).sum()) for q in (p, against))
    needed = len(top) // 2 + 1
    found = share_at_least(
        top, needed / len(top), "The stationary weights give Q^μ its highest mean return"
    )
    highest = found.verdict is Verdict.REPRODUCED
    too_many = len(top) - beaten < needed
    return Finding(
        graded(
            highest and sure,
            direction=highest,
            otherwise=Verdict.NOT_REPRODUCED if too_many else Verdict.INCONCLUSIVE,
        ),
        f"{found.evidence.removesuffix('.')}; significantly above every other (Welch, Holm) in "
        f"{sure or 'none'} of them. In {beaten or 'none'} another choice is significantly above "
        "the stationary one (Welch, corrected for the choice of the other, Holm).",
        {**found.numbers, "beaten": beaten},
    )


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Mean and interval by domain, learner and potential, a column each p(x|m)."""
    words = table.assign(
        learner=table.algorithm.map(LEARNERS),
        potential=table.potential.map(SYMBOLS),
        cell=[plus_minus(m, c) for m, c in zip(table.mean_return, table.ci95, strict=True)],
    )
    keys = ["domain", "learner", "potential"]
    wide = words.pivot(index=keys, columns="weighting", values="cell").reset_index()
    return wide.fillna("–")
