"""The wide market, and the experiments on functions that are no tables."""

import numpy as np
import pytest

from thesis_lib.chapter3.runs import TabularLearner
from thesis_lib.chapter4 import function_law, task_relevance
from thesis_lib.chapter4.runs import exact_solutions, solve_domain
from thesis_lib.chapter4.wide_market import WideMarket, WideTask
from thesis_lib.domains import stock
from thesis_lib.domains.planted import meadow
from thesis_lib.edition.experiment import Context
from thesis_lib.selection import ExactRelevance


@pytest.mark.parametrize(("E", "G"), [(2, 1), (3, 2)])
def test_wide_market_has_the_values_of_the_stock_domain(E, G):
    domain = stock(1, E, G)
    exact = exact_solutions(domain)
    market = WideMarket(E, G)
    assert market.feature_names == exact.feature_names
    for m in range(len(domain)):
        influence, helps = domain.tasks.parameters(m)
        ours = market.q(WideTask(influence[0], helps), exact.features)
        np.testing.assert_allclose(ours, exact.q[m], atol=1e-9)
    # Symmetry gives the truth labels.
    assert ExactRelevance().fit(exact).support_.tolist() == market.relevant.tolist()


def test_optimal_weights_earn_what_the_optimal_policy_earns():
    # One stock, no luck from factors: buy when the stock is likelier to rise than to fall.
    market = WideMarket(1, 1)
    task = WideTask(np.array([True]), np.array([True]))
    pairs = np.array([[s, e, g, a] for s in (0, 1) for e in (0, 1) for g in (0, 1) for a in (0, 1)])
    solutions = market.solutions([task], pairs)
    weights = market.weights(solutions, np.ones(4, dtype=bool))
    learner = TabularLearner("q_learning", 1e-9, 0.0, steps=4000)
    earned = np.mean(
        [market.learn(task, weights, np.random.default_rng(i), learner) for i in range(20)]
    )
    # Levels 0, 1, 3, 4 of 4 rise with .1, .3, .7, .9; buying pays .4 and .8 at the last two.
    # The factor is a coin; the stock after a helping factor rises with .7 or .9.
    up = np.array([[0.1, 0.7], [0.3, 0.9]])
    rising = up.mean(axis=1)
    stationary = rising[0] / (1 + rising[0] - rising[1])
    share = np.array([1 - stationary, stationary]) / 2
    expected = 4000 * (share[0] * 0.4 + share[1] * 0.8)
    assert earned == pytest.approx(expected, rel=0.03)


def test_the_law_is_exact_for_tables_and_linear_functions(smoke):
    table = smoke["ch4-function-law"]
    exact = table[table.function.isin(["table", "linear", "squared weight"])]
    assert exact.misfit.max() < 1e-12
    weight = table[(table.function == "weight") & (table.feature == "s1e1")]
    assert np.ptp(weight.value) < 1e-12


def test_multisets_are_all_sequences():
    tasks, chances = function_law.multisets(3, 4)
    assert len(tasks) == 15
    assert chances.sum() == pytest.approx(1)
    at = {tuple(t): c for t, c in zip(tasks.tolist(), chances, strict=True)}
    assert at[0, 0, 0, 0] == pytest.approx(1 / 81)
    assert at[0, 0, 1, 2] == pytest.approx(12 / 81)


def test_meadow_is_what_it_is_said_to_be():
    domain = meadow(3, 2, rare=0.5)
    assert len(domain) == 27
    assert domain.distribution.sum() == pytest.approx(1)
    solutions = exact_solutions(domain)
    at = [list(solutions.feature_names).index(w) for w in ("w1", "w2")]
    for m in range(27):
        q, seen = solutions.q[m], solutions.p[m] > 0
        for i, w in enumerate(at):
            values = {}
            for row, value in zip(solutions.features[seen], q[seen], strict=True):
                values.setdefault(tuple(np.delete(row, w)), []).append(value)
            gap = max(np.ptp(v) for v in values.values())
            assert (gap > 1e-6) == (m % 3 == i + 1)


def test_reached_by_hand():
    # Means of three: 1, 2, 3; the second is over windows 2 to 4, whose middle is at 2.5.
    curve = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    assert task_relevance.reached(curve, 2.0, 10) == 25.0
    assert task_relevance.reached(curve, 9.0, 10) == np.inf


def test_state_labels_merge_what_is_not_seen():
    config = task_relevance.DOMAINS["stock G=3"]
    found = solve_domain(config.make(), config.learner, Context())
    kept = ~found.solutions.mask(["s1"])
    labels = task_relevance.state_labels(found, kept, 0)
    assert labels.max() + 1 == 32
    assert labels[:32].tolist() == labels[32:].tolist()
