r"""Selection by the exact law of k-relevance: a jackknife F-test on the increment.

Let R be the features removed so far and i a candidate.  Removing i as well loses the
increment :math:`\rho(R \cup i) - \rho(R)` of relevance, and i is domain irrelevant given
R when the increment's limit is 0.  On n observed tasks the increment is :math:`V_n`, and
with every task left out in turn :math:`\bar V_{n-1}` on average.

*Shared p(x|m).*  The increment of a function f is :math:`|P f|^2`, with P the projection
of f on what the finer abstraction explains and the coarser does not, in the norm weighted
by p.  With :math:`Z_i = P Q_{s_i}`, mean :math:`\bar Z` and covariance matrix S,

.. math:: V_n = |\bar Z|^2, \qquad n(n-1)(\bar V_{n-1} - V_n) = \mathrm{tr}\, S, \qquad
          F = \frac{n V_n}{\mathrm{tr}\, S} = \frac{V_n}{(n-1)(\bar V_{n-1} - V_n)}.

The limit of the increment is :math:`|\mathrm{E} Z|^2`, so irrelevance says E Z = 0, and
then :math:`\mathrm{E}\, n V_n = \mathrm{E}\, \mathrm{tr}\, S`: F is n times the mean, squared, over
the variance between tasks, near 1 under irrelevance and near
:math:`1 + n |\mathrm{E} Z|^2 / \mathrm{tr}\, S` otherwise.

*Different p(x|m).*  :math:`V_n` is a smooth function of means over tasks; under
irrelevance its first-order term vanishes and :math:`n V_n` tends to the same kind of
quadratic form, with the task's influence on the increment for :math:`Z_i`.  The second
expression for F stays as it is, with trace estimated by the jackknife.  A negative
estimate means that relevance grows with the number of tasks: the feature is kept, as by
line 15 of algorithm 7.

*Null law.*  For Gaussian :math:`Z_i`, :math:`n V_n \sim \sum_j \lambda_j \chi^2_1` and
:math:`(n-1)\,\mathrm{tr}\,S \sim \sum_j \lambda_j \chi^2_{n-1}`, independent, with
:math:`\lambda` the eigenvalues of the covariance of Z.  If Z varies in one direction, F
is the square of Student's t with n - 1 degrees of freedom.  More directions average the
noise, and far out the upper tail of F gets lighter: **beyond a threshold of n - 1 none is
heavier than that of a single direction**.  With :math:`s = n V_n / \sum_i |Z_i|^2`, F
is :math:`(n-1) s/(1-s)`, so that F > n - 1 says s > 1/2, and given the eigenvalues w of the
tasks' Gram matrix, scaled to sum to 1, :math:`s = \sum_j w_j u_j^2` with u uniform on the
sphere.  For c of at least 1/2 at most one eigenvalue, say the first, exceeds c; so
:math:`P(s > c) = P(\sum_j (w_j - c) g_j^2 > 0) = \mathrm{E}\,\psi(\sum_{j>1} (c - w_j)
g_j^2)` with standard normal g and the convex tail :math:`\psi` of :math:`(w_1 - c) g_1^2`.
That is Schur-convex in the :math:`c - w_j`, hence most when a single one of the other
eigenvalues, :math:`1 - w_1`, is not 0; and then :math:`(c - 1 + w_1)/(w_1 - c)` and
:math:`c/(w_1 - c)`, the weights of what :math:`g_1^2` has to exceed, fall with :math:`w_1`,
to be least where :math:`w_1 = 1`.  :math:`\square`

So ``null="t2"`` keeps an irrelevant feature of Gaussian scatter with a probability of at
most alpha, whatever the directions, where its threshold is at least n - 1: at 5% up to
n = 6.  For more tasks numerical inversion says the same of every spectrum tried with alpha
up to .1.  It is false at high levels: at .3 with equal eigenvalues the probability is above
the level from n = 6 on.
``null="box"`` replaces the mixtures by chi-squares with their first two moments: F with
:math:`\nu` and :math:`(n-1)\nu` degrees of freedom, with :math:`\nu = (\sum_j \lambda_j)^2
/ \sum_j \lambda_j^2` the effective number of directions.

Task solutions are not Gaussian.  If a feature's effect takes two opposite values with
equal chance, all n tasks show the same one with probability :math:`2^{1-n}`.  This looks
like a feature relevant in every task, so for n below 6 the 5% level cannot be held.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

import numpy as np
from scipy.stats import f as fisher

from thesis_lib.checks import one_of
from thesis_lib.relevance.cells import FeatureCells
from thesis_lib.relevance.estimators import (
    Estimate,
    compare_parts,
    inner_products,
    jackknife_parts,
)
from thesis_lib.selection.base import BackwardElimination, Call, Check, KeepForGood, Test
from thesis_lib.selection.fitting import Alpha, check_alpha, student_tail


class JackknifeF(BackwardElimination):
    r"""Backward elimination by a calibrated test of the increment of domain relevance.

    No sequence is sampled and no curve is fitted; a round costs one pass over the tasks'
    tables for each feature.

    Parameters
    ----------
    alpha
        Probability in (0, 1) that an irrelevant feature passes one test, or a function of
        the number of tasks.  It is held for Gaussian scatter where tasks share p(x|m).  An
        irrelevant feature passes more often where scatter has another law (claim
        ``4.5-jackknife-level``) or tasks do not share p(x|m), on some domains most of the time.
    null
        ``"t2"``: the threshold is the squared two-sided Student quantile, exact for
        Gaussian scatter in one direction and conservative in more.
        ``"box"``: the quantile of F with the effective number of directions estimated
        from the tasks; more powerful, and only approximately calibrated.
    target
        ``"increment"`` of relevance given the features already removed, or ``"total"``
        relevance of removing all of them, which FS-TEK tests.  The scatter of features
        removed before hides weak ones from the latter.
    choose
        Which of the marked features goes.  ``"statistic"``: the one furthest below its
        threshold, so that strong noise is averaged out before weak features are judged.
        ``"forward"``: the one with the weakest forward relevance, as in algorithm 7.
    keep_for_good
        As for :class:`~thesis_lib.selection.fstek.FSTEK`.  With ``"never"``, the default,
        every feature kept is significant given the final removed set.

    Notes
    -----
    This edition's method.  Derivation and limits: :mod:`thesis_lib.selection.jackknife`.

    Examples
    --------
    Eight tasks, whose values depend on fuel, and on colour in every other task the other way.

    >>> import numpy as np
    >>> from thesis_lib.relevance import Solutions, TaskTable
    >>> x = np.array([(fuel, colour, 0) for fuel in range(3) for colour in range(2)])
    >>> tables = [
    ...     TaskTable(("fuel", "colour", "a"), x, x[:, 0] + sign * (2 * x[:, 1] - 1))
    ...     for sign in [1.0, -1.0] * 4
    ... ]
    >>> solutions = Solutions.from_tables(tables)
    >>> JackknifeF(alpha=0.05).fit(solutions).get_feature_names_out().tolist()
    ['fuel']
    """

    min_tasks = 3

    def __init__(
        self,
        alpha: Alpha = 0.05,
        null: Literal["t2", "box"] = "t2",
        target: Literal["increment", "total"] = "increment",
        choose: Literal["statistic", "forward"] = "statistic",
        keep_for_good: KeepForGood = "never",
    ) -> None:
        self.alpha = alpha
        self.null = null
        self.target = target
        self.choose = choose
        self.keep_for_good = keep_for_good

    def _test(self, call: Call) -> Test:
        n = call.solutions.n_tasks
        level = check_alpha(self.alpha, n)
        one_of("null", self.null, ("t2", "box"))
        one_of("target", self.target, ("increment", "total"))
        one_of("choose", self.choose, ("statistic", "forward"))

        def test(cells: FeatureCells, candidates: list[int]) -> Iterable[Check]:
            finer = cells if self.target == "increment" else call.ground
            fine = jackknife_parts(finer)
            for feature in candidates:
                coarser = cells.drop(feature)
                result = compare_parts(n, fine, jackknife_parts(coarser))
                directions = effective_rank(finer, coarser) if self.null == "box" else 1.0
                threshold = f_threshold(n, level, directions)
                yield judge(feature, result, threshold, call.zero)

        return test

    def _choose(self, call: Call, removed: list[int], marked: list[Check]) -> int:
        if self.choose == "forward":
            return super()._choose(call, removed, marked)
        return min(marked, key=lambda check: check.statistic / check.threshold).feature


def judge(feature: int, result: Estimate, threshold: float, zero: float) -> Check:
    """Verdict on a feature from the estimate of its increment.

    Parameters
    ----------
    feature
        Index of the feature.
    result
        Estimate of the increment.
    threshold
        Largest F-ratio of an irrelevant feature.
    zero
        Relevance up to which is rounding error.
    """
    if result.observed <= zero:
        return Check(feature, "remove", result.domain, 0.0, threshold, "nothing is lost")
    statistic = result.f_ratio
    if np.isinf(statistic):
        reason = "relevance does not fall with the number of tasks"
        return Check(feature, "keep", result.domain, statistic, threshold, reason)
    if statistic <= threshold:
        reason = "the increment is within its noise"
        return Check(feature, "remove", result.domain, statistic, threshold, reason)
    return Check(
        feature, "keep", result.domain, statistic, threshold, "the increment exceeds its noise"
    )


def f_threshold(n: int, alpha: float, directions: float = 1.0) -> float:
    r"""Quantile of F with :math:`\nu` and :math:`(n-1)\nu` degrees of freedom.

    Parameters
    ----------
    n
        Number of tasks, at least 2.
    alpha
        Upper tail probability, in (0, 1).
    directions
        :math:`\nu`, at least 1; at 1 the quantile is that of the square of Student's t.

    Examples
    --------
    >>> round(f_threshold(8, 0.05), 3)  # of F with 1 and 7 degrees of freedom
    5.591
    """
    level = check_alpha(alpha, n)
    if directions == 1.0:
        return student_tail(level / 2, n - 1) ** 2
    return float(fisher.isf(level, directions, (n - 1) * directions))


def effective_rank(finer: FeatureCells, coarser: FeatureCells) -> float:
    r"""Effective number of directions in which the tasks' solutions scatter.

    With :math:`\Sigma` the covariance of the tasks' contributions to the increment it is
    :math:`\nu = (\mathrm{tr}\,\Sigma)^2 / \mathrm{tr}\,\Sigma^2`.  The plain ratio for the
    sample covariance S is at most n - 1, so both parts are estimated without bias: for
    Gaussian scatter :math:`\mathrm{E}\,
    \mathrm{tr}\,S^2 = \frac{n}{n-1} \mathrm{tr}\,\Sigma^2 + \frac{1}{n-1}
    (\mathrm{tr}\,\Sigma)^2` and :math:`\mathrm{E}\,(\mathrm{tr}\,S)^2 =
    (\mathrm{tr}\,\Sigma)^2 + \frac{2}{n-1} \mathrm{tr}\,\Sigma^2`.

    Parameters
    ----------
    finer, coarser
        Sums over the cells of two nested partitions, for n tasks, at least 3.

    Returns
    -------
    float
        From 1 to the number of cells that the coarser partition saves.
    """
    n = finer.n_tasks
    most = max(finer.n_cells - coarser.n_cells, 1)
    products = inner_products(finer, centred=True) - inner_products(coarser, centred=True)
    trace, square = np.trace(products) / (n - 1), (products**2).sum() / (n - 1) ** 2
    within = (n - 1) ** 2 / ((n - 2) * (n + 1)) * (square - trace**2 / (n - 1))
    total = trace**2 - 2 * within / (n - 1)
    if trace <= 0 or total <= 0:
        return 1.0
    return float(min(max(total / within, 1.0), most)) if within > 0 else float(most)
