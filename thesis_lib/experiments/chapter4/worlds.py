"""What an experiment of chapter 4 knows of a domain: its solutions, its truth, its potentials."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from thesis_lib.arrays import BoolArray, FloatArray, IntArray
from thesis_lib.chapter3.runs import Learner
from thesis_lib.domains import Domain
from thesis_lib.edition.experiment import Context
from thesis_lib.mdp import planning
from thesis_lib.mdp.checks import one_of
from thesis_lib.mdp.learning import learn
from thesis_lib.mdp.sampling import loop_array
from thesis_lib.relevance import Solutions, keep
from thesis_lib.selection import ExactRelevance

Target = Literal["Q_star", "Q_tilde"]
Source = Literal["exact", "learned"]

LONGER = 20
"""A learned solution takes this many times the learner's own budget."""


@dataclass(frozen=True, eq=False)
class World:
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
    _labels: dict[bytes, tuple[IntArray, int]] = field(default_factory=dict)
    _rows: dict[int, IntArray] = field(default_factory=dict)

    @cached_property
    def truth(self) -> BoolArray:
        """Which features are domain relevant, shape ``(F,)``: exact, but for ``irrelevant``."""
        selector = ExactRelevance(distribution=self.domain.distribution).fit(self.solutions)
        return selector.support_ & ~self.solutions.mask(self.irrelevant)

    def rows(self, task: int) -> IntArray:
        """Row of a potential for each state of a task, -1 outside, in the loops' own form."""
        if task not in self._rows:
            self._rows[task] = loop_array(self.domain.observation_index[task], np.int64)
        return self._rows[task]

    @cached_property
    def _weighted(self) -> FloatArray:
        p = self.solutions.p
        return np.where(p > 0, p * self.solutions.q, 0.0)

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
            labels = keep(self.solutions, np.flatnonzero(support).tolist())
            self._labels[key] = labels, int(labels.max()) + 1
        labels, n = self._labels[key]
        a = np.bincount(labels, self._weighted[tasks].sum(axis=0), n)
        b = np.bincount(labels, self.solutions.p[tasks].sum(axis=0), n)
        values = np.divide(a, b, out=np.full(n, float(unseen)), where=b > 0)
        return values[labels].reshape(self.domain.shape)


def task_solutions(
    domain: Domain, target: Target, source: Source, learner: Learner, context: Context
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
            return [planning.solve(task).q for task in domain.tasks]
        return [planning.soft_policy_iteration(task, learner.epsilon).q for task in domain.tasks]
    seeds = context.seeds(len(domain), 1)
    out = []
    for task, seed in zip(domain.tasks, seeds, strict=True):
        found = learn(
            task,
            "q_learning",
            alpha=learner.alpha,
            epsilon=learner.epsilon,
            episodes=None if learner.episodes is None else LONGER * learner.episodes,
            steps=None if learner.steps is None else LONGER * learner.steps,
            rng=np.random.default_rng(seed),
            companion="expected_sarsa" if target == "Q_tilde" else None,
        )
        out.append(found.q if found.companion is None else found.companion)
    return out


def world(
    make: Callable[[], Domain],
    learner: Learner,
    context: Context,
    *,
    target: Target = "Q_star",
    source: Source = "exact",
    irrelevant: Iterable[str] = (),
) -> World:
    """Build a domain and solve its tasks; see :func:`task_solutions`."""
    domain = make()
    q = task_solutions(domain, target, source, learner, context)
    return World(domain, Solutions.from_domain(domain, q), tuple(irrelevant))
