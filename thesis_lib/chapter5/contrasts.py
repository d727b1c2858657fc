"""Every comparison of nets that the text of sections 5.5 to 5.7 makes, printed and ours.

Averages are over tasks.  Each difference has two kinds of evidence: over *runs* (test runs of the
thesis's one policy a cell, its five learning runs, or our seeds), which says whether these
policies differ on these tasks; and with *tasks* as the unit, which says whether nets do.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import ttest_1samp

from thesis_lib.arrays import FloatArray
from thesis_lib.chapter5 import cells
from thesis_lib.chapter5.cells import EXTRA_NETS, NETS, ROBOTS, Cells, shares, weights
from thesis_lib.chapter5.runs import Runs, read_runs
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.robustness import PERTURBATIONS, TRAINED_ON, quadrants
from thesis_lib.stats import friedman, two_sided


@dataclass(frozen=True)
class Config:
    """What is read, and how often it is resampled."""

    resamples: int = 4000
    """Bootstrap resamples."""
    store: str = ""
    """Folder of the results store; the checkout's own where empty."""
    tasks: str = ""
    """Robots of our runs, such as "Hopper Walker2d"; all where empty."""
    architectures: str = ""
    """Nets of our runs, such as "dtrnn gru"; all where empty."""
    seeds: str = ""
    """Seeds of our runs, such as "0 1 2"; all where empty."""

    def __post_init__(self) -> None:
        nets = tuple(net.lower() for net in (*NETS, *EXTRA_NETS))
        for name, words, allowed in (
            ("tasks", self.tasks, ROBOTS),
            ("architectures", self.architectures.lower(), nets),
        ):
            for word in words.split():
                if word not in allowed:
                    raise ValueError(
                        f"{name} has {word!r}, but it must name some of {', '.join(allowed)}, with "
                        "spaces between them, or be empty for all."
                    )
        for word in self.seeds.split():
            if not word.isdecimal():
                raise ValueError(
                    f"seeds has {word!r}, but it must be whole numbers of at least 0 with spaces "
                    "between them, or be empty for all."
                )

    def runs(self) -> Runs:
        """Our runs that are asked for."""
        return read_runs(self.store).only(
            self.tasks.split(),
            self.architectures.lower().split(),
            [int(seed) for seed in self.seeds.split()],
        )


SMOKE = Config(200)


def chosen(
    tasks: str | Sequence[str] = "",
    architectures: str | Sequence[str] = "",
    seeds: str | int | Sequence[int] = "",
    store: str = "",
) -> dict[str, str]:
    """Fields of :class:`Config` from the parameters of a notebook.

    Parameters
    ----------
    tasks, architectures, seeds
        Of our runs, as text with spaces or as a list; all where empty.
    store
        Folder of a results store; the checkout's own where empty.

    Raises
    ------
    ValueError
        For a name that does not exist, a seed that is none, or a folder that is not there.
    """
    if store and not Path(store).is_dir():
        raise ValueError(
            f"store is {store!r}, but there is no such folder: give one in which `thesis sweep` "
            "and `thesis test-policies` wrote layers (--out), or leave it empty."
        )
    words = {"tasks": tasks, "architectures": architectures, "seeds": seeds}
    fields: dict[str, Any] = {
        name: " ".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)
        for name, value in words.items()
    }
    Config(**fields)  # raises for what it does not know
    return {**fields, "store": store and str(Path(store).resolve())}


PAIRS = (
    *itertools.permutations(NETS, 2),
    ("FNNs", "RNNs"),
    ("vanilla RNNs", "gated RNNs"),
    ("simple nets", "gated RNNs"),
    ("FNNs and CTRNN", "other RNNs"),
)
"""First and second of each comparison, nets or :data:`~thesis_lib.chapter5.cells.GROUPS`."""


@dataclass(frozen=True)
class Contrast:
    """One difference between the mean scores of two nets, or groups of nets."""

    source: str
    """Printed or ours."""
    measure: str
    """Learning (share of the best mean return over learning on a task), test (share of the best
    return of the regular test) or robustness (equation 5.4)."""
    quadrant: str
    """Ground trained on, perturbation, both, or all."""
    first: str
    """Net or group whose mean over tasks and nets comes first."""
    second: str
    """What is subtracted."""
    value: float
    """Mean score of the first."""
    difference: float
    """First less second, mean over tasks."""
    low: float
    """Lower end of the 95% bootstrap interval over runs."""
    high: float
    """Upper end."""
    p_runs: float
    """Two-sided bootstrap p-value of the difference over runs."""
    p_tasks: float
    """Paired t-test with tasks as the unit."""
    p_friedman: float
    """Friedman's test over all seven nets, tasks as the unit."""
    tasks: int
    """Tasks on which all seven nets have been run."""
    units: int
    """Fewest runs behind a cell."""
    printed_budget: bool
    """Whether all cells learned for as many steps as the thesis's."""


@experiment("ch5-comparisons", item="Sections 5.5 to 5.7", smoke=SMOKE, book=Config(), seconds=2)
def comparisons(config: Config, context: Context) -> list[Contrast]:
    """Differences between nets in learning, at test and in robustness, printed and ours."""
    store = config.runs()
    rngs = iter([np.random.default_rng(s) for s in context.seeds(4)])
    n = config.resamples
    rows: list[Contrast] = []
    for made in (
        cells.printed(("table-5.2",), next(rngs), n),
        cells.from_learning(store, next(rngs), n),
    ):
        rows += _by_ground("learning", made, made.mean, made.draws)
    for made in (
        cells.printed(tuple(cells.TESTED.values()), next(rngs), n),
        cells.from_tests(store, next(rngs), n),
    ):
        rows += _by_ground("test", made, made.mean[:, :1], made.draws[:, :, :1])
        rows += _by_quadrant(made)
    return rows


def _by_ground(
    measure: str, made: Cells, mean: FloatArray, draws: FloatArray
) -> Iterator[Contrast]:
    """Contrasts of shares of returns for each ground trained on and both; C is 1."""
    mean, draws = shares(mean, mean), shares(draws, mean)
    for i, ground in enumerate(TRAINED_ON):
        yield from _contrasts(measure, ground, made, mean[i, 0], draws[:, i, 0], [i])
    yield from _contrasts(measure, "all", made, mean.mean((0, 1)), draws.mean((1, 2)), [0, 1])


def _by_quadrant(made: Cells) -> Iterator[Contrast]:
    """Contrasts of scores in each quadrant, each perturbation, and all four together."""
    mean, draws = quadrants(made.mean), quadrants(made.draws)
    for j, perturbation in enumerate(PERTURBATIONS):
        for i, ground in enumerate(TRAINED_ON):
            quadrant = f"{ground} {perturbation}"
            yield from _contrasts("robustness", quadrant, made, mean[i, j], draws[:, i, j], [i])
        both = mean[:, j].mean(0), draws[:, :, j].mean(1)
        yield from _contrasts("robustness", perturbation, made, *both, [0, 1])
    whole = mean.mean((0, 1)), draws.mean((1, 2))
    yield from _contrasts("robustness", "all", made, *whole, [0, 1])


def _contrasts(
    measure: str,
    quadrant: str,
    made: Cells,
    mean: FloatArray,
    draws: FloatArray,
    grounds: list[int],
) -> Iterator[Contrast]:
    """All :data:`PAIRS`, from scores by robot and net and their resamples."""
    there = np.isfinite(mean).all(axis=-1)
    if not there.any():
        return
    mean, draws = mean[there], draws[:, there]
    units = made.units[grounds][:, there]
    budget = bool(made.printed_budget[grounds][:, there].all())
    ranks = friedman(mean) if len(mean) > 1 else np.nan
    for first, second in PAIRS:
        apart = weights(first) - weights(second)
        by_task, over = mean @ apart, (draws @ apart).mean(axis=1)
        low, high = cells.interval(over, int(units.min()))
        yield Contrast(
            made.source,
            measure,
            quadrant,
            first,
            second,
            value=float((mean @ weights(first)).mean()),
            difference=float(by_task.mean()),
            low=low,
            high=high,
            p_runs=float(two_sided(over)),
            p_tasks=float(ttest_1samp(by_task, 0).pvalue) if len(by_task) > 1 else np.nan,
            p_friedman=ranks,
            tasks=len(by_task),
            units=int(units.min()),
            printed_budget=budget,
        )
