r"""FS-TEK as printed: every joint reading, against all that section 4.3 prints of the triangle.

The text leaves open which schedule of the level is meant (the formula's, .0601 at five tasks, or
the words', 1e-4 "up to k = 5"), how many combinations algorithm 8 samples, and of what the
interval is; and k-relevance is defined on sequences, in which tasks may be repeated, where
algorithm 8 takes combinations.  Choices interact, so they are searched together.  Of the triangle
is printed: about .45/1 after five tasks; a mean return significantly above shaping without
selection and above IBKR, which keeps everything; and that FS-TEK is the first to match fixed
features.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial
from itertools import product
from typing import Literal

import numpy as np
import pandas as pd
from scipy.stats import norm

from thesis_lib.arrays import FloatArray
from thesis_lib.chapter3.runs import SETTINGS
from thesis_lib.chapter4.figure_4_3 import MATCH, PRINTED
from thesis_lib.chapter4.runs import Rated, Run, run_selectors, solve_domain
from thesis_lib.domains import triangle
from thesis_lib.edition.criteria import LEVEL, graded
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.words import several
from thesis_lib.relevance.cells import Cells, FeatureCells, keep
from thesis_lib.relevance.exact import explained_sequences, k_relevance
from thesis_lib.relevance.sequences import count_tasks
from thesis_lib.selection import FSTEK, FixedFeatures, NoSelection, Selector, triangle_alpha
from thesis_lib.selection.base import Call
from thesis_lib.selection.fstek import Curves
from thesis_lib.stats import mean_ci

Schedule = Literal["formula", "words"]
Interval = Literal["curve", "observation"]
Sampling = Literal["combinations", "sequences"]

NEAR = (0.07, 0.03)
"""How far a rate may be from what is printed of it."""

FIRST = {"formula": 4, "words": 5}
"""The number of tasks up to which the level is 1e-4."""


@dataclass(frozen=True)
class Config:
    """The readings and how often each is run."""

    schedules: tuple[Schedule, ...] = ("formula", "words")
    """Of the level."""
    max_seqs: tuple[int, ...] = (3, 4, 5, 6, 8, 0)
    """Most combinations or sequences sampled for each k; 0 for all of them."""
    intervals: tuple[Interval, ...] = ("curve", "observation")
    """Of the asymptote, or of a further observation."""
    samplings: tuple[Sampling, ...] = ("combinations", "sequences")
    """Different tasks, as in algorithm 8, or with repeats, as in definition 5."""
    tasks_seen: tuple[int, ...] = (5, 6, 8)
    """Numbers of observed tasks."""
    runs: int = 100
    """Sequences of tasks."""
    tests: int = 10
    """Tasks learned with each potential."""


@dataclass(frozen=True)
class Reading(Rated):
    """One joint reading of FS-TEK after one number of tasks."""

    schedule: str
    """Of the level: formula or words; none for the two methods without one."""
    max_seqs: int
    """Most combinations or sequences sampled for each k; 0 for all of them."""
    interval: str
    """curve, observation; or the method: none (all features kept) or fixed."""
    sampling: str
    """combinations of different tasks, or sequences with repeats."""
    rate_error: float
    """Half-width of the 95% interval of the false positive rate over runs."""
    over_none: float
    """Return less that without selection, paired by run, mean."""
    over_none_ci95: float
    """Half-width of its 95% t interval."""
    over_fixed: float
    """Return less that of fixed features, paired by run, mean."""
    over_fixed_ci95: float
    """Half-width of its 95% t interval."""


@experiment(
    "ch4-joint-search",
    item="FS-TEK as printed (triangle)",
    smoke=Config(max_seqs=(5, 0), intervals=("curve",), tasks_seen=(5,), runs=2, tests=2),
    book=Config(runs=60),
    thesis=Config(runs=500),
    seconds=20,
)
def readings(config: Config, context: Context) -> list[Reading]:
    """Rates and returns on the triangle by schedule, sample of tasks and interval."""
    learner = SETTINGS["triangle"].learners[0]
    solved = solve_domain(triangle(), learner, context)
    keys: list[tuple[str, int, str, str]] = [
        *product(config.schedules, config.max_seqs, config.intervals, config.samplings),
        *(("none", 0, method, "none") for method in ("none", "fixed")),
    ]

    def make(key: tuple[str, int, str, str], seed: int) -> Selector:
        schedule, most, interval, sampling = key
        if interval == "none":
            return NoSelection()
        if interval == "fixed":
            return FixedFeatures(solved.relevant)
        kind = FSTEK if sampling == "combinations" else WithRepeats
        return kind(
            alpha=partial(triangle_alpha, first=FIRST[schedule]),
            max_seqs=most or None,
            interval=interval,  # type: ignore[arg-type]
            flat="unsure",
            random_state=seed,
        )

    def one(seed: np.random.SeedSequence) -> Run:
        rng = np.random.default_rng(seed)

        @cache
        def own() -> int:
            """Drawn once, after the observed tasks."""
            return int(rng.integers(2**31))

        sizes = (learner, config.tasks_seen, config.tests)
        return run_selectors(solved, *sizes, rng, lambda: [make(key, own()) for key in keys])

    runs = Run.stack(context.map(one, context.seeds(config.runs, 23), "joint search"))
    records = []
    for (i, key), (j, n) in product(enumerate(keys), enumerate(config.tasks_seen)):
        none, fixed = (runs.ahead_of(j, i, len(keys) + other) for other in (-2, -1))
        false = mean_ci(runs.support[:, j, i][:, ~solved.truth].mean(axis=1))
        records.append(
            Reading(
                schedule=key[0],
                max_seqs=key[1],
                interval=key[2],
                sampling=key[3],
                tasks_seen=n,
                rate_error=false.half_width,
                over_none=none.mean,
                over_none_ci95=none.half_width,
                over_fixed=fixed.mean,
                over_fixed_ci95=fixed.half_width,
                **runs.rated(j, i, solved.truth),
            )
        )
    return records


class WithRepeats(FSTEK):
    """FS-TEK on sequences that may repeat a task: ``max_seqs`` drawn for each k, or all."""

    def _curves(self, call: Call) -> Curves:
        n, rng = call.solutions.n_tasks, np.random.default_rng(self.random_state)
        k, most = np.arange(1, n + 1), self.max_seqs
        if most is None:

            def exact(cells: FeatureCells, feature: int) -> FloatArray:
                kept = keep(call.solutions, [i for i in cells.features if i != feature])
                return k_relevance(call.solutions, kept, k)

            return exact
        drawn = [count_tasks(rng.integers(n, size=(most, i)), n) for i in k]

        def explained(cells: Cells) -> FloatArray:
            return np.array([explained_sequences(cells, counts).mean() for counts in drawn])

        whole = explained(call.ground)
        return lambda cells, feature: whole - explained(cells.drop(feature))


def fits(table: pd.DataFrame) -> pd.DataFrame:
    """For each reading, what section 4.3 prints that it meets.

    Parameters
    ----------
    table
        Of :data:`readings`.

    Returns
    -------
    pandas.DataFrame
        One row a reading: ``rates`` (.45/1 after five tasks, within :data:`NEAR`), ``gain``
        (significantly over no selection after five), ``matches`` (after some number of tasks its
        paired interval is at most 2% below fixed features), ``may_match`` (its
        interval reaches so far), ``denied`` (the interval of its false positive rate or of its
        gain after five tasks, or all its intervals beside fixed features, lie on the wrong side
        of what is printed), ``rises`` (how much the false positive rate changes from five
        tasks to the most) and ``rises_error`` (half-width of its interval, of independent rates).
        Intervals are 95% of all that is looked at, readings and numbers of tasks (Bonferroni).
    """
    own = table[~table.interval.isin(("none", "fixed"))]
    fixed = table[table.interval == "fixed"].drop_duplicates("tasks_seen").set_index("tasks_seen")
    margin = MATCH * fixed.mean_return.abs()
    rows = []
    open_points = ["schedule", "max_seqs", "interval", "sampling"]
    groups = own.groupby(open_points, sort=False)
    one, wide = (_wider(groups.ngroups * looks) for looks in (1, own.tasks_seen.nunique()))
    for key, group in groups:
        by = group.set_index("tasks_seen")
        half = wide * by.over_fixed_ci95
        five, last = by.loc[5], by.loc[by.index.max()]
        may_match = (by.over_fixed + half >= -margin[by.index]).any()
        rows.append(
            {
                **dict(zip(open_points, key, strict=True)),
                "fpr": five.fpr,
                "tpr": five.tpr,
                "rates": bool(
                    abs(five.fpr - PRINTED[0]) <= NEAR[0] and five.tpr >= PRINTED[1] - NEAR[1]
                ),
                "gain": bool(five.over_none > one * five.over_none_ci95),
                "matches": bool((by.over_fixed - half >= -margin[by.index]).any()),
                "may_match": bool(may_match),
                "denied": bool(
                    not may_match
                    or five.over_none < -one * five.over_none_ci95
                    or abs(five.fpr - PRINTED[0]) > NEAR[0] + one * five.rate_error
                ),
                "rises": float(last.fpr - five.fpr),
                "rises_error": one * float(np.hypot(last.rate_error, five.rate_error)),
            }
        )
    return pd.DataFrame(rows)


def _wider(looks: int) -> float:
    """By how much a 95% interval widens that is one of so many (Bonferroni, normal)."""
    return float(norm.isf(LEVEL / 2 / looks) / norm.isf(LEVEL / 2))


@criterion("4.3-triangle-joint", readings)
def some_reading_fits(table: pd.DataFrame) -> Finding:
    """Whether some joint reading meets everything printed of the triangle."""
    found = fits(table)
    some = found[found.rates & found.gain & found.may_match]
    every = some[some.matches]
    near = found.assign(far=np.hypot(found.fpr - PRINTED[0], found.tpr - PRINTED[1]))
    best = near.loc[near.far.idxmin()]
    verdict = Verdict.NOT_REPRODUCED if found.denied.all() else Verdict.INCONCLUSIVE
    if len(every):
        verdict = Verdict.REPRODUCED
    elif len(some):
        verdict = Verdict.INCONCLUSIVE
    elif (found.gain & found.may_match).any():
        verdict = Verdict.DIRECTION
    sampled = f"{best.max_seqs or 'all'} {best.sampling} a k"
    rates, gain, match, may, against, whole, part = (
        int(n) or "none"
        for n in (
            *(found[c].sum() for c in ("rates", "gain", "matches", "may_match", "denied")),
            *(len(every), len(some)),
        )
    )
    return Finding(
        verdict,
        f"Of {len(found)} joint readings {rates} give the rates printed for five tasks, {gain} a "
        f"significant gain there; {match} are shown to come within {MATCH:.0%} of fixed features, "
        f"{may} may; {whole} are shown to do all, {part} may; of {against} an interval denies one "
        f"of them (Bonferroni). Nearest: the level of the {best.schedule} with {sampled} and the "
        f"interval of the {best.interval}, with an FPR/TPR of {best.fpr:.2f}/{best.tpr:.2f}.",
        {"all": len(every), "fpr": float(best.fpr), "tpr": float(best.tpr)},
    )


@criterion("4.3-triangle-rise", readings)
def false_positives_rise(table: pd.DataFrame) -> Finding:
    """Whether FS-TEK's false positive rate rises with the number of tasks, in every reading."""
    found = fits(table)
    kinds = {
        "all combinations": (found.sampling == "combinations") & (found.max_seqs == 0),
        "up to eight combinations": (found.sampling == "combinations") & (found.max_seqs > 0),
        "sequences with repeats": found.sampling == "sequences",
    }
    listed = several(
        f"{own.min():+.2f} to {own.max():+.2f} by {name}"
        for name, own in ((name, found.rises[where]) for name, where in kinds.items())
        if len(own)
    )
    up, down = (int((sign * found.rises > found.rises_error).sum()) for sign in (1, -1))
    return Finding(
        graded(up == len(found), denied=down, otherwise=Verdict.INCONCLUSIVE),
        f"From five tasks to {table.tasks_seen.max()} the false positive rate changes by "
        f"{listed} a k. Of {len(found)} readings it rises significantly in {up or 'none'} and "
        f"falls significantly in {down or 'none'} (95% intervals, Bonferroni over the readings).",
        {"least": float(found.rises.min()), "most": float(found.rises.max())},
    )
