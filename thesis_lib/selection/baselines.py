r"""What FS-TEK is compared to: random, fixed, no and exact selection (section 4.3)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import FloatArray
from thesis_lib.checks import generator, probability
from thesis_lib.relevance.cells import Cells, FeatureCells
from thesis_lib.relevance.exact import check_distribution, check_lengths, explained, limit
from thesis_lib.relevance.solutions import Solutions
from thesis_lib.selection.base import BackwardElimination, Call, Check, Selector, Test


class NoSelection(Selector):
    """Keep every feature."""

    def __init__(self) -> None:
        pass

    def _select(self, solutions: Solutions) -> list[int]:
        return []


class FixedFeatures(Selector):
    """Keep given features, such as the true domain-relevant ones.

    Parameters
    ----------
    features
        Names of the features to keep.  None at all gives a constant function.
    """

    def __init__(self, features: Sequence[str]) -> None:
        self.features = features

    def _select(self, solutions: Solutions) -> list[int]:
        return np.flatnonzero(~solutions.mask(self.features)).tolist()


class RandomSelection(Selector):
    """Keep each feature with a given probability.

    Parameters
    ----------
    probability
        Chance of a feature to be kept; at the default of one half all subsets of the
        features are equally likely.  The text does not say how its random features
        were drawn.
    random_state
        Seed or generator.  A generator goes on from call to call; a seed gives the same
        features in every call.
    """

    def __init__(
        self, probability: float = 0.5, random_state: np.random.Generator | int = 0
    ) -> None:
        self.probability = probability
        self.random_state = random_state

    def _select(self, solutions: Solutions) -> list[int]:
        chance = probability("probability", self.probability)
        draws = generator(self.random_state).random(solutions.n_features)
        return np.flatnonzero(draws >= chance).tolist()


class ExactRelevance(BackwardElimination):
    r"""Backward elimination by the exact k-relevance of a known domain.

    With k = 1 it keeps the task-relevant features (equation 4.9), the representation for
    a value function; with k infinite the domain-relevant ones (equation 4.7), the truth
    that ROC labels come from when ``fit`` is given every task of the domain.

    Parameters
    ----------
    k
        Sequence length, or infinity.
    tolerance
        Largest relevance that counts as none, as a share of the k-relevance of removing
        every feature.  Above rounding it gives approximately relevant representations.
    distribution
        D(m); default uniform over the tasks given.
    """

    def __init__(
        self,
        k: float = np.inf,
        tolerance: float = 1e-10,
        distribution: ArrayLike | None = None,
    ) -> None:
        self.k = k
        self.tolerance = tolerance
        self.distribution = distribution

    def _test(self, call: Call) -> Test:
        D = check_distribution(self.distribution, call.solutions.n_tasks)
        share = probability("tolerance", self.tolerance)
        if self.k != np.inf:
            check_lengths(self.k)
        total = self._explained(call.ground, D)
        full = total - self._explained(call.ground.keep(()), D)
        threshold = max(share * full, call.zero)

        def test(cells: FeatureCells, candidates: list[int]) -> Iterable[Check]:
            for feature in candidates:
                value = total - self._explained(cells.drop(feature), D)
                if value <= threshold:
                    yield Check(feature, "remove", value, value, threshold, "within tolerance")
                else:
                    yield Check(feature, "keep", value, value, threshold, "relevant")

        return test

    def _explained(self, cells: Cells, D: FloatArray) -> float:
        if np.isfinite(self.k):
            return float(explained(cells, np.array([int(self.k)]), D)[0])
        return float(limit(cells, D).sum())
