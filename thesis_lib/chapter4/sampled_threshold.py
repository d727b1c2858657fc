"""What sampling of combinations, and another interval, leave of FS-TEK's threshold on F.

The threshold of :func:`~thesis_lib.selection.fitting.fstek_threshold` needs two things beside
shared p(x|m): *every* combination of k tasks is listed, so that D(k) = U + (b - U)/k exactly,
and the interval is that of the asymptote.  Algorithm 8 samples ``max_seqs`` of them; the curve
that is fitted then has sampling noise, which the threshold does not know of.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
import pandas as pd

from thesis_lib.chapter4.random_solutions import noise_to_signal
from thesis_lib.chapter4.threshold import EVERY
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.relevance import estimate, remove
from thesis_lib.selection import FSTEK, fstek_threshold

Interval = Literal["curve", "observation"]


@dataclass(frozen=True)
class Config:
    """Where decisions are compared."""

    tasks_seen: tuple[int, ...] = (5, 7, 9)
    """Numbers of observed tasks."""
    max_seqs: tuple[int, ...] = (3, 5, 10, 20, 50, EVERY)
    """Most combinations sampled for each k."""
    intervals: tuple[Interval, ...] = ("curve", "observation")
    """Of the asymptote, or of a further observation."""
    alpha: float = 0.1
    """Level of FS-TEK."""
    domains: int = 40
    """Random domains of three features with shared p(x|m), from noise to a common signal."""


@dataclass(frozen=True)
class Agreement:
    """Decisions of FS-TEK that the threshold on F predicts."""

    interval: str
    """curve: of the asymptote; observation: of a further data point."""
    max_seqs: int
    """Most combinations sampled for each k; a million is all of them."""
    tasks_seen: int
    """Number of observed tasks."""
    agree: int
    """Decisions that are the threshold's."""
    unsure: int
    """Decisions that algorithm 7 does not make for want of a fit; the feature stays."""
    n_decisions: int
    """Decisions compared."""


@experiment(
    "ch4-sampled-threshold",
    item="FS-TEK explained (sampling)",
    smoke=Config(tasks_seen=(5,), max_seqs=(5, EVERY), domains=5),
    book=Config(),
    seconds=4,
)
def agreement(config: Config, context: Context) -> list[Agreement]:
    """Decisions of algorithm 7 that its threshold on F predicts, by sample of combinations."""

    def one(job: tuple[Interval, int, int]) -> Agreement:
        interval, most, n = job
        agree = unsure = total = 0
        for index, seed in enumerate(context.seeds(config.domains, 22, n)):
            solutions = noise_to_signal(np.random.default_rng(seed), n, index)
            selector = FSTEK(config.alpha, most, interval=interval, random_state=index)
            for check in selector.fit(solutions).history_[0].checks:
                ratio = estimate(solutions, remove(solutions, [check.feature])).f_ratio
                goes = ratio <= fstek_threshold(n, config.alpha)
                agree += goes == (check.verdict == "remove")
                unsure += check.verdict == "unsure"
                total += 1
        return Agreement(interval, most, n, agree, unsure, total)

    jobs = list(product(config.intervals, config.max_seqs, config.tasks_seen))
    return context.map(one, jobs, "sampled threshold")


@criterion("4.2-threshold-conditions", agreement)
def both_conditions_are_needed(table: pd.DataFrame) -> Finding:
    """Whether the threshold predicts all decisions with both conditions, and not without one."""
    own = table.assign(full=table.max_seqs == table.max_seqs.max())
    share = own.groupby(["interval", "full"])[["agree", "n_decisions"]].sum()
    of = (share.agree / share.n_decisions).to_dict()
    few = table[(table.interval == "curve") & (table.max_seqs <= 5)]
    least = float((few.agree / few.n_decisions).min())
    needed = of["curve", False] < 1 and of["observation", True] < 1
    holds = of["curve", True] == 1
    verdict = Verdict.REFUTED if not holds else Verdict.DIRECTION
    return Finding(
        Verdict.REPRODUCED if holds and needed else verdict,
        f"With every combination and the interval of the asymptote the threshold predicts "
        f"{of['curve', True]:.0%} of the decisions, with a sample {of['curve', False]:.0%} (five "
        f"or fewer: down to {least:.0%}), with the other interval {of['observation', True]:.0%}.",
        {"all": of["curve", True], "sampled": of["curve", False], "few": least},
    )
