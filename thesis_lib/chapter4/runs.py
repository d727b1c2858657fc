"""What the results of chapter 4 share: domains with their tasks solved, and tests of potentials."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import BoolArray, FloatArray, IntArray
from thesis_lib.chapter3.runs import TabularLearner
from thesis_lib.checks import one_of
from thesis_lib.domains import Domain
from thesis_lib.edition.experiment import Context, Returns, returns
from thesis_lib.mdp.batched import TaskBatch
from thesis_lib.mdp.learning import learn
from thesis_lib.mdp.sampling import loop_array
from thesis_lib.potentials import linear_cross_task_weights, optimal_solutions, soft_solutions
from thesis_lib.relevance import Solutions, keep
from thesis_lib.selection import ExactRelevance, NoSelection, Selector, rates
from thesis_lib.stats import Mean, mean_ci

Target = Literal["Q_star", "Q_tilde"]
Source = Literal["exact", "learned"]

LONGER = 20
"""A learned solution takes this many times the learner's own budget."""


def exact_solutions(domain: Domain) -> Solutions:
    """Optimal solutions of every task of a domain."""
    return Solutions.from_domain(domain, optimal_solutions(domain))


@dataclass(frozen=True, eq=False)
class SolvedDomain:
    """A domain with the solution of every task.

    Attributes
    ----------
    domain
        The tasks and their distribution.
    solutions
        Of every task, in the domain's order.
    irrelevant
        Features labelled irrelevant in ROC space although their exact relevance is
        positive, as the thesis does with the position on the cliff.
    """

    domain: Domain
    solutions: Solutions
    irrelevant: tuple[str, ...] = ()
    _labels: dict[bytes, IntArray] = field(default_factory=dict)
    _rows: dict[int, IntArray] = field(default_factory=dict)

    @cached_property
    def truth(self) -> BoolArray:
        """Which features are domain relevant, shape ``(F,)``: exact, but for ``irrelevant``."""
        selector = ExactRelevance(distribution=self.domain.distribution).fit(self.solutions)
        return selector.support_ & ~self.solutions.mask(self.irrelevant)

    @property
    def relevant(self) -> tuple[str, ...]:
        """Names of the features that :attr:`truth` marks."""
        names = zip(self.solutions.feature_names, self.truth, strict=True)
        return tuple(name for name, true in names if true)

    def rows(self, task: int) -> IntArray:
        """Row of a potential for each state of a task, -1 outside, in the loops' own form."""
        if task not in self._rows:
            self._rows[task] = loop_array(self.domain.observation_index[task], np.int64)
        return self._rows[task]

    def potential(self, tasks: IntArray, support: BoolArray, unseen: float = 0.0) -> FloatArray:
        r"""Abstract cross-task Q-function of observed tasks, shape ``(O, A)``.

        Parameters
        ----------
        tasks
            Observed tasks, repeats allowed.
        support
            Features kept, shape ``(F,)``.
        unseen
            Value where no observed task visits the abstract pair.

        Notes
        -----
        Source: equations 4.5 and 4.1, with :math:`p(x|c)` the mean of the tasks' weights.
        """
        key = support.tobytes()
        if key not in self._labels:
            self._labels[key] = keep(self.solutions, np.flatnonzero(support).tolist())
        values = linear_cross_task_weights(
            self.solutions.q[tasks], self.solutions.p[tasks], labels=self._labels[key], fill=unseen
        )
        return values.reshape(self.domain.shape)


def task_solutions(
    domain: Domain, target: Target, source: Source, learner: TabularLearner, context: Context
) -> list[FloatArray]:
    r"""Solution of every task of a domain, each ``(S_m, A)``.

    Parameters
    ----------
    domain
        The tasks.
    target
        :math:`Q^*_m`, or the values :math:`\tilde Q_m` of the best soft policy.
    source
        ``"exact"`` by policy iteration, or ``"learned"`` by the learner in 20 times its
        own budget.
    learner
        Gives epsilon of the soft policy, and learns.
    context
        Seed of the learning.
    """
    one_of("target", target, ("Q_star", "Q_tilde"))
    one_of("source", source, ("exact", "learned"))
    if source == "exact":
        if target == "Q_star":
            return optimal_solutions(domain)
        return soft_solutions(domain, learner.epsilon)
    episodes, steps = (n and LONGER * n for n in (learner.episodes, learner.steps))
    longer = replace(learner, episodes=episodes, steps=steps)
    solutions = []
    for task, seed in zip(domain.tasks, context.seeds(len(domain), 1), strict=True):
        found = learn(
            task,
            "q_learning",
            **longer.settings,
            rng=np.random.default_rng(seed),
            companion="expected_sarsa" if target == "Q_tilde" else None,
        )
        solutions.append(found.q if found.companion is None else found.companion)
    return solutions


def solve_domain(
    domain: Domain,
    learner: TabularLearner,
    context: Context,
    *,
    target: Target = "Q_star",
    source: Source = "exact",
    irrelevant: Iterable[str] = (),
) -> SolvedDomain:
    """Solve the tasks of a domain; see :func:`task_solutions`."""
    q = task_solutions(domain, target, source, learner, context)
    return SolvedDomain(domain, Solutions.from_domain(domain, q), tuple(irrelevant))


class Trial:
    """Tasks to be learned from one potential after another, with the same random numbers.

    Parameters
    ----------
    solved
        The domain.
    learner
        How tasks are learned.
    n
        How many tasks are drawn from it.
    rng
        Draws them, and a seed for each.
    """

    def __init__(
        self, solved: SolvedDomain, learner: TabularLearner, n: int, rng: np.random.Generator
    ) -> None:
        tasks = solved.domain.sample(n, rng)
        self._batch = TaskBatch(
            [solved.domain.tasks[m] for m in tasks],
            [solved.rows(int(m)) for m in tasks],
            learner.method,
            **learner.settings,
        )
        self._rngs = [np.random.default_rng(int(s)) for s in rng.integers(2**63, size=n)]
        self._starts = [rng.bit_generator.state for rng in self._rngs]

    def mean_return(self, phi: FloatArray) -> float:
        """Mean total reward of the tasks.

        Parameters
        ----------
        phi
            The potential, shape ``(O, A)``.
        """
        for rng, start in zip(self._rngs, self._starts, strict=True):
            rng.bit_generator.state = start
        rewards = self._batch.total_rewards(phi, self._rngs)
        return sum(rewards.tolist()) / self._batch.n_tasks


class Choice(NamedTuple):
    """What a selector makes of some observed tasks."""

    support: BoolArray
    """Features kept, shape ``(F,)``."""
    unsure: int
    """How many of them for want of a reliable estimate."""
    seconds: float
    """Processor time of the selection."""


def choose(selector: Selector, solutions: Solutions) -> Choice:
    """Let a selector choose; it keeps everything if it needs more tasks than there are."""
    if solutions.n_tasks < selector.min_tasks:
        selector = NoSelection()
    start = time.thread_time()
    support = selector.fit(solutions).support_
    seconds = time.thread_time() - start
    return Choice(support, len(getattr(selector, "unsure_", ())), seconds)


@dataclass(frozen=True)
class Run:
    """What several selectors do after each of some numbers n of observed tasks.

    Attributes
    ----------
    returns
        Mean return of the test tasks, shape ``(numbers, selectors)``, and any more axes.
    support
        Features kept, shape ``(numbers, selectors, F)``.
    unsure, seconds
        As in :class:`Choice`, shape ``(numbers, selectors)``.
    """

    returns: FloatArray
    support: BoolArray
    unsure: IntArray
    seconds: FloatArray

    @classmethod
    def of(cls, returns: ArrayLike, choices: Sequence[Sequence[Choice]]) -> Run:
        """From the choices of each selector for each number of tasks, and what they earned."""
        support, unsure, seconds = (
            np.array([[choice[part] for choice in row] for row in choices]) for part in range(3)
        )
        return cls(np.asarray(returns, dtype=float), support, unsure, seconds)

    @classmethod
    def stack(cls, runs: Sequence[Run]) -> Run:
        """Several runs as one, along a new first axis."""
        parts = zip(*((r.returns, r.support, r.unsure, r.seconds) for r in runs), strict=True)
        return cls(*map(np.stack, parts))

    def after(self, at: list[int]) -> Run:
        """Stacked runs, for some of the numbers of tasks only."""
        return Run(
            self.returns[:, at], self.support[:, at], self.unsure[:, at], self.seconds[:, at]
        )

    def rated(self, j: int, i: int, truth: BoolArray) -> dict[str, Any]:
        """Rates and returns of stacked runs, for the j-th number of tasks and selector i."""
        fpr, tpr = rates(self.support[:, j, i], truth)
        return {"fpr": fpr, "tpr": tpr, **returns(self.returns[:, j, i])}

    def ahead_of(self, j: int, i: int, other: int) -> Mean:
        """Return of selector i less that of another, paired by run."""
        return mean_ci(self.returns[:, j, i] - self.returns[:, j, other])


@dataclass(frozen=True)
class Kept:
    """Base of rows on what a selector keeps after some observed tasks."""

    tasks_seen: int
    """Number of observed tasks n."""
    fpr: float
    """Share of the domain-irrelevant features kept, over all runs."""
    tpr: float
    """Share of the domain-relevant features kept, over all runs."""


@dataclass(frozen=True)
class Rated(Kept, Returns):
    """Base of rows on what it earns too."""


@dataclass(frozen=True)
class Placed(Kept):
    """Base of rows on a place in ROC space."""

    fpr_ci95: float
    """Half-width of the normal 95% interval of the false positive rate over runs."""
    tpr_ci95: float
    """The same of the true positive rate."""
    n_runs: int
    """Number of runs."""


def place(support: BoolArray, truth: BoolArray) -> dict[str, Any]:
    """Fields of :class:`Placed` from the features kept in each run, shape ``(runs, F)``."""
    fpr, tpr = rates(support, truth)
    wrong, right = (support[:, some].mean(axis=1).std(ddof=1) for some in (~truth, truth))
    half = 1.96 / np.sqrt(len(support))
    return {
        **{"fpr": fpr, "fpr_ci95": float(half * wrong)},
        **{"tpr": tpr, "tpr_ci95": float(half * right), "n_runs": len(support)},
    }


def run_selectors(
    solved: SolvedDomain,
    learner: TabularLearner,
    grid: Sequence[int],
    tests: int,
    rng: np.random.Generator,
    selectors: Callable[[], Sequence[Selector]],
    unseen: float = 0.0,
) -> Run:
    """Let selectors choose features after each of some numbers of tasks, and test the potentials.

    All see the same tasks, test on the same tasks and draw the same random numbers, so that
    differences between them are paired.

    Parameters
    ----------
    solved
        The domain with its solutions.
    learner
        Learns the test tasks.
    grid
        Numbers of observed tasks.
    tests
        How many tasks are learned with each potential.
    rng
        Draws the tasks.
    selectors
        Called for each number of tasks; may draw from ``rng``.
    unseen
        Potential of pairs that no observed task visits.
    """
    seen = solved.domain.sample(max(grid), rng)
    earned, choices = [], []
    for n in grid:
        solutions = solved.solutions.take(seen[:n])
        choices.append([choose(selector, solutions) for selector in selectors()])
        trial = Trial(solved, learner, tests, rng)
        known: dict[bytes, float] = {}
        for kept, *_ in choices[-1]:
            if (code := kept.tobytes()) not in known:
                known[code] = trial.mean_return(solved.potential(seen[:n], kept, unseen))
        earned.append([known[choice.support.tobytes()] for choice in choices[-1]])
    return Run.of(earned, choices)
