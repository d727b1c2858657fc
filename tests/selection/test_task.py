"""Task relevance: which features the value function of a task needs."""

from itertools import product

import numpy as np
import pytest

from tests.relevance.worlds import world
from tests.selection.examples import solved
from thesis_lib.domains import stock, triangle
from thesis_lib.domains.planted import meadow
from thesis_lib.relevance import Solutions, ground, k_relevance, relevance, remove
from thesis_lib.selection import ExactRelevance, TaskRelevance, task_explained, unseen_share

FEATURES = np.array(list(product(range(2), range(2))))


def two_features(*effects: tuple[float, float]) -> Solutions:
    """One task for each pair of effects of f and g; a third feature, the action, adds +-1."""
    features = np.array(list(product(range(2), range(2), range(2))))
    f, g, a = 2.0 * features.T - 1
    q = np.array([one * f + two * g + a for one, two in effects])
    return Solutions(q, np.full(q.shape, 1 / 8), features, ("f", "g", "a"))


def test_a_feature_irrelevant_in_every_task_goes_and_no_other() -> None:
    solutions = two_features((1.0, 0.0), (0.0, 0.0))
    assert TaskRelevance().fit(solutions).get_feature_names_out().tolist() == ["f", "a"]
    assert TaskRelevance().fit(solutions.take([1])).get_feature_names_out().tolist() == ["a"]


def test_mean_and_maximum_part_ways_above_zero() -> None:
    # g matters in one task of four; the tasks' variances are 2, 1, 1, 1.
    solutions = two_features((0.0, 1.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))
    # Mean loss 1/4 of mean variance 5/4 is a share of 1/5; in its task it is 1/2.
    assert TaskRelevance(0.21).fit(solutions).removed_ == ("f", "g")
    assert TaskRelevance(0.19).fit(solutions).removed_ == ("f",)
    assert TaskRelevance(0.21, "every").fit(solutions).removed_ == ("f",)
    assert set(TaskRelevance(0.5, "every").fit(solutions).removed_) == {"f", "g"}


def test_the_action_stays_unless_asked_otherwise() -> None:
    solutions = two_features((1.0, 2.0))
    flat = Solutions(
        np.repeat([[0.0, 0.0, 1.0, 1.0]], 2, 0), np.full((2, 4), 0.25), FEATURES, ("f", "a")
    )
    assert TaskRelevance().fit(flat).removed_ == ()
    assert TaskRelevance(always=()).fit(flat).removed_ == ("a",)
    with pytest.raises(ValueError, match="there is no feature 'b'"):
        TaskRelevance(always=("b",)).fit(solutions)


@pytest.mark.parametrize("kind", ["shared", "subsets", "weights"])
def test_the_estimate_is_the_mean_relevance_of_the_tasks(kind: str) -> None:
    solutions = world(5, kind, 4)
    selector = TaskRelevance(always=()).fit(solutions)
    checks = selector.history_[0].checks
    for check in checks:
        labels = remove(solutions, [check.feature])
        own = [
            relevance(labels, np.nan_to_num(q), p)
            for q, p in zip(solutions.q, solutions.p, strict=True)
        ]
        assert check.relevance == pytest.approx(np.mean(own), abs=1e-12)
        assert check.relevance == pytest.approx(float(k_relevance(solutions, labels, 1)), abs=1e-10)


def test_task_explained_by_hand() -> None:
    # Values 0, 2, 4, 6 about the mean 3 of the first task: squares 9, 1, 1, 9, mean 5.
    solutions = Solutions(np.array([[0.0, 2, 4, 6]]), np.full((1, 4), 0.25), FEATURES, ("f", "g"))
    cells = ground(solutions)
    assert task_explained(cells).tolist() == [5.0]
    # The first feature has the means 1 and 5: squares 4 and 4.
    assert task_explained(cells.keep([0])).tolist() == [4.0]


def test_thesis_domains() -> None:
    # "Only position, which has the Markov property, is needed" on the triangle.
    assert TaskRelevance().fit(solved(triangle)).get_feature_names_out().tolist() == ["x1", "a"]
    assert TaskRelevance().fit(solved(stock, 1, 2, 2)).removed_ == ("s1",)
    found = TaskRelevance().fit(solved(meadow))
    assert found.get_feature_names_out().tolist() == ["x", "y", "w1", "w2", "a"]


def test_it_agrees_with_exact_one_relevance() -> None:
    for make, size in ((triangle, ()), (stock, (1, 2, 1))):
        solutions = solved(make, *size)
        exact = ExactRelevance(k=1).fit(solutions).support_
        ours = TaskRelevance(always=()).fit(solutions).support_
        assert ours.tolist() == exact.tolist()


def test_bad_parameters_are_refused() -> None:
    solutions = two_features((1.0, 2.0))
    with pytest.raises(ValueError, match=r"tolerance is 2"):
        TaskRelevance(2.0).fit(solutions)
    with pytest.raises(ValueError, match="rule 'most' does not exist"):
        TaskRelevance(rule="most").fit(solutions)  # type: ignore[arg-type]
    constant = Solutions(np.ones((2, 4)), np.full((2, 4), 0.25), FEATURES, ("f", "a"))
    with pytest.raises(ValueError, match="constant"):
        TaskRelevance().fit(constant)


def test_unseen_share() -> None:
    # At 95%: 1 - .05^(1/n); after one task 95% of the tasks may still need the feature.
    assert unseen_share(1) == pytest.approx(0.95)
    assert (1 - unseen_share(10)) ** 10 == pytest.approx(0.05)
    # "Rule of three": about 3/n for many.
    assert unseen_share(1000) == pytest.approx(3 / 1000, rel=0.01)
    with pytest.raises(ValueError, match="confidence is 1"):
        unseen_share(3, 1.0)
    with pytest.raises(ValueError, match="n_tasks"):
        unseen_share(0)
