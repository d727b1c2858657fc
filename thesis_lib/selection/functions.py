r"""Selection for cross-task functions that are no tables: linear ones, and neural networks.

Section 4.5 asks how FS-TEK extends to other function approximators.  The exact law does not
need a table: it needs a relevance that is bilinear in the tasks' functions.  Both selectors
here make one n x n matrix for the increment of every candidate and test it as
:class:`~thesis_lib.selection.jackknife.JackknifeF` does.
"""

from __future__ import annotations

import abc
from collections.abc import Callable, Sequence

import numpy as np

from thesis_lib.arrays import BoolArray, FloatArray
from thesis_lib.checks import generator, positive_integer
from thesis_lib.relevance.linear import Interactions, estimate_from, feature_basis, linear_class
from thesis_lib.relevance.network import fit_networks
from thesis_lib.relevance.solutions import Solutions
from thesis_lib.selection.base import ZERO, Round, Selector
from thesis_lib.selection.fitting import Alpha, check_alpha
from thesis_lib.selection.jackknife import f_threshold, judge

Explained = Callable[[BoolArray], FloatArray]
"""Inner products of what kept features explain of the tasks' functions, ``(F,)`` to ``(n, n)``."""


class FunctionSelector(Selector):
    """Backward elimination by the F-ratio of increments, for any bilinear relevance.

    Attributes
    ----------
    relevance_
        Estimated domain relevance of each feature's increment when it was last tested,
        shape ``(F,)``; NaN if never.
    history_
        The rounds.
    unsure_
        Empty: the test always decides.
    """

    min_tasks = 3
    alpha: Alpha
    relevance_: FloatArray
    history_: list[Round]
    unsure_: tuple[str, ...] = ()

    @abc.abstractmethod
    def _explained(self, solutions: Solutions) -> Explained:
        """What any set of kept features explains."""

    def _select(self, solutions: Solutions) -> list[int]:
        n = solutions.n_tasks
        threshold = f_threshold(n, check_alpha(self.alpha, n))
        explained = self._explained(solutions)
        kept = np.ones(solutions.n_features, dtype=bool)
        current = explained(kept)
        nothing = explained(np.zeros_like(kept))
        scale = float(np.diag(current - nothing).mean())
        if not scale > 0:
            raise ValueError(
                f"every function of the {n} tasks is constant, so no feature can be told from "
                "another; check that the tasks were learned."
            )
        self.relevance_ = np.full(solutions.n_features, np.nan)
        self.history_ = []
        removed: list[int] = []
        while True:
            checks, left = [], {}
            for feature in np.flatnonzero(kept).tolist():
                without = kept.copy()
                without[feature] = False
                left[feature] = explained(without)
                result = estimate_from(current - left[feature])
                checks.append(judge(feature, result, threshold, ZERO * scale))
                self.relevance_[feature] = result.domain
            marked = [check for check in checks if check.verdict == "remove"]
            choice = min(marked, key=lambda check: check.statistic).feature if marked else None
            self.history_.append(Round(tuple(removed), tuple(checks), choice))
            if choice is None:
                return removed
            removed.append(choice)
            kept[choice] = False
            current = left[choice]


class LinearF(FunctionSelector):
    r"""Jackknife F-test for a linear cross-task function.

    The increment of removing a feature is the rise of the mean squared error of the weighted
    least-squares fit to the tasks' solutions, which obeys the law of k-relevance exactly
    (:mod:`thesis_lib.relevance.linear`).  No two pairs need share a cell, so the pairs may be
    a sample of a space too large for a table.

    Parameters
    ----------
    alpha
        Level of the test.
    interactions
        Products among the columns; see :func:`~thesis_lib.relevance.linear.feature_basis`.
    numeric
        Features that enter as numbers.
    """

    def __init__(
        self,
        alpha: Alpha = 0.05,
        interactions: Interactions = "action",
        numeric: Sequence[str] = (),
    ) -> None:
        self.alpha = alpha
        self.interactions = interactions
        self.numeric = numeric

    def _explained(self, solutions: Solutions) -> Explained:
        basis = feature_basis(solutions, self.interactions, self.numeric)
        fitted = linear_class(solutions, basis)
        return lambda kept: fitted.products(basis.within(kept))


class NetworkF(FunctionSelector):
    r"""Jackknife F-test for a cross-task function that is the mean of networks, one a task.

    With f the network of a task, removing the features R loses
    :math:`\mathbb{E}\,\mathrm{Var}(f(x) \mid x_{-R}) = \frac12 \mathbb{E} (f(x) - f(x'))^2`,
    where :math:`x'` has the features R of another pair: Sobol's total index of R, unscaled,
    by Jansen's formula.  It is bilinear in f, so that the law of k-relevance is exact for the
    mean of networks, whatever they are.

    Parameters
    ----------
    alpha
        Level of the test.
    hidden
        Hidden units of a network.
    numeric
        Features that enter as numbers.
    partners
        Pairs from which each pair's removed features are taken, one after another.
    random_state
        Seed or generator of the networks' start and of the partners.

    Notes
    -----
    Features must be independent under p(x), as on a full table with equal weights or a
    uniform sample of one; the networks are fitted with the weights p(x|m), which tasks share.
    """

    def __init__(
        self,
        alpha: Alpha = 0.05,
        hidden: int = 6,
        numeric: Sequence[str] = (),
        partners: int = 8,
        random_state: np.random.Generator | int = 0,
    ) -> None:
        self.alpha = alpha
        self.hidden = hidden
        self.numeric = numeric
        self.partners = partners
        self.random_state = random_state

    def _explained(self, solutions: Solutions) -> Explained:
        if not solutions.shared:
            raise ValueError(
                "the tasks have different p(x|m), but networks of all tasks are compared on the "
                "same pairs; give all tasks the same p, or select on tables."
            )
        rng = generator(self.random_state)
        count = positive_integer("partners", self.partners)
        basis = feature_basis(solutions, "none", self.numeric)
        reads = basis.uses.any(axis=1)
        inputs, uses = basis.columns[:, reads], basis.uses[reads]
        p = solutions.p[0]
        networks = fit_networks(inputs, solutions.q, self.hidden, rng, p=p)
        donors = rng.choice(len(p), size=(count, len(p)), p=p)
        values = networks(inputs)
        centred = values - (values @ p)[:, None]
        root = np.sqrt(p / (2 * count))
        whole = (centred * p) @ centred.T
        # Differences need no double precision, and most of the time goes into them.
        short, networks = inputs.astype(np.float32), networks.single()
        sums, values = networks.sums(short), networks(short)

        def explained(kept: BoolArray) -> FloatArray:
            lost = np.zeros_like(whole)
            gone = ~kept @ uses.T
            own = short[:, gone]
            for partner in donors:
                mixed = sums + networks.sums(own[partner] - own, gone)
                difference = root * (values - networks.outputs(mixed))
                lost += difference @ difference.T
            return whole - lost

        return explained
