r"""Selection of the features of a value function, by task relevance (equation 4.9).

A feature set is task relevant when its 1-relevance :math:`\rho_1 = \sum_m D(m)\,
\rho_\phi(Q_m)` is above 0.  A task's own relevance is never below 0, so the mean vanishes
exactly when it vanishes in every task of the domain; from n observed tasks,
:math:`b = \frac1n \sum_i \rho_\phi(Q_{s_i})` is an unbiased estimate of it, whatever the
weights p(x|m) and without a curve to extrapolate.  With a tolerance above 0 the mean and
the maximum part ways: the mean lets go of a feature that matters in few tasks.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal

import numpy as np

from thesis_lib.arrays import FloatArray
from thesis_lib.checks import one_of, positive_integer, probability
from thesis_lib.relevance.cells import Cells, FeatureCells
from thesis_lib.relevance.solutions import ACTION, Solutions
from thesis_lib.selection.base import ZERO, BackwardElimination, Call, Check, KeepForGood, Test

Rule = Literal["mean", "every"]


class TaskRelevance(BackwardElimination):
    r"""Keep the features that the value function of a task needs.

    Parameters
    ----------
    tolerance
        Largest relevance that counts as none, as a share of the variance of a task's
        Q-function.  0 keeps whatever is relevant beyond rounding.
    rule
        ``"mean"``: the share over all observed tasks together, the near-irrelevance of
        equation 4.9.  ``"every"``: in each observed task, so that a feature found relevant
        in any task is preserved, the alternative that the text mentions.
    always
        Features never removed: the action, without which a value function chooses nothing.

    Notes
    -----
    Source: section 4.1.1, equation 4.9 and the text after it.
    """

    keep_for_good: KeepForGood = "call"

    def __init__(
        self, tolerance: float = 0.0, rule: Rule = "mean", always: Sequence[str] = (ACTION,)
    ) -> None:
        self.tolerance = tolerance
        self.rule = rule
        self.always = always

    def _settled(self, solutions: Solutions) -> set[int]:
        return set(np.flatnonzero(solutions.mask(self.always)).tolist())

    def _test(self, call: Call) -> Test:
        share = max(probability("tolerance", self.tolerance), ZERO)
        rule = one_of("rule", self.rule, ("mean", "every"))
        ground = task_explained(call.ground)
        full = ground - task_explained(call.ground.keep(()))

        def test(cells: FeatureCells, candidates: list[int]) -> Iterable[Check]:
            for feature in candidates:
                lost = np.maximum(ground - task_explained(cells.drop(feature)), 0.0)
                mean = float(lost.mean())
                if rule == "mean":
                    statistic, threshold = mean, share * float(full.mean())
                else:
                    # The task in which most is lost, for what it has to lose.
                    worst = int(np.argmax(lost - share * full))
                    statistic, threshold = float(lost[worst]), float(share * full[worst])
                verdict: Literal["remove", "keep"] = "remove" if statistic <= threshold else "keep"
                reason = "irrelevant in the tasks seen" if verdict == "remove" else "task relevant"
                yield Check(feature, verdict, mean, statistic, threshold, reason)

        return test


def task_explained(cells: Cells) -> FloatArray:
    """Mean square that a partition explains of each task's Q-function, shape ``(M,)``.

    Parameters
    ----------
    cells
        Sums over the cells of the partition.
    """
    b = np.broadcast_to(cells.b, cells.a.shape)
    squares = cells.a * cells.a
    return np.divide(squares, b, out=np.zeros_like(squares), where=b > 0).sum(axis=1)


def unseen_share(n_tasks: int, confidence: float = 0.95) -> float:
    r"""Largest share of tasks in which a feature may matter that mattered in none of n.

    A feature, named beforehand, that matters in a share s of the tasks shows in none of n
    with probability :math:`(1-s)^n`; so :math:`s \le 1 - (1 - c)^{1/n}` at confidence c.

    Parameters
    ----------
    n_tasks
        Observed tasks n, drawn independently.
    confidence
        c, in (0, 1).
    """
    n = positive_integer("n_tasks", n_tasks)
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence is {confidence}, but it must be above 0 and below 1.")
    return float(1.0 - (1.0 - confidence) ** (1.0 / n))
