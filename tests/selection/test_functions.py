"""Selection with linear functions and with networks."""

from itertools import product

import numpy as np
import pytest
from scipy.stats import binomtest

from tests.selection.examples import planted, solved
from thesis_lib.domains import stock
from thesis_lib.relevance import Solutions
from thesis_lib.selection import JackknifeF, LinearF, NetworkF

BITS = np.array(list(product(range(2), repeat=3)))


def parity(n: int, seed: int) -> Solutions:
    """f and g matter together only, the action by itself, all with some scatter."""
    rng = np.random.default_rng(seed)
    f, g, a = 2.0 * BITS.T - 1
    q = (3 + rng.normal(size=(n, 1))) * f * g + (3 + rng.normal(size=(n, 1))) * a
    return Solutions(q, np.full((n, 8), 1 / 8), BITS, ("f", "g", "a"))


def named(selector: LinearF | NetworkF | JackknifeF, solutions: Solutions) -> list[str]:
    return list(selector.fit(solutions).get_feature_names_out())


def test_with_columns_enough_for_every_pair_it_is_the_selection_on_tables() -> None:
    # Two binary features: constant, f, a and f a span the table.
    for seed in range(30):
        rng = np.random.default_rng(seed)
        base = planted(rng, 6, effect=1.0)
        solutions = Solutions(base.q, base.p, base.features, ("f", "a"))
        table, linear = JackknifeF().fit(solutions), LinearF().fit(solutions)
        assert linear.removed_ == table.removed_
        for one, two in zip(linear.history_, table.history_, strict=True):
            for x, y in zip(one.checks, two.checks, strict=True):
                assert x.statistic == pytest.approx(y.statistic, rel=1e-8)
                assert x.threshold == y.threshold


def test_stock_is_linear_enough() -> None:
    rng = np.random.default_rng(0)
    solutions = solved(stock, 1, 2, 2)
    observed = solutions.take(rng.integers(solutions.n_tasks, size=16))
    assert named(LinearF(), observed) == ["s1e1", "s1e2", "a"]
    assert named(NetworkF(), observed) == ["s1e1", "s1e2", "a"]


def test_what_matters_in_combination_needs_a_product_or_a_network() -> None:
    solutions = parity(8, 0)
    assert named(LinearF(), solutions) == ["a"]
    assert named(LinearF(interactions="pairs"), solutions) == ["f", "g", "a"]
    assert named(NetworkF(), solutions) == ["f", "g", "a"]


def test_pairs_that_share_no_cell() -> None:
    # A sample of a large space: removing one feature merges no two pairs, and a table sees
    # nothing; the linear function sees the one relevant feature and the action.
    rng = np.random.default_rng(5)
    features = np.unique(rng.integers(2, size=(300, 31)), axis=0)
    signs = 2.0 * features - 1
    scatter = rng.normal(size=(10, 31))
    scatter[:, 0] += 4
    scatter[:, -1] += 4
    q = scatter @ signs.T
    names = (*(f"f{i}" for i in range(30)), "a")
    p = np.broadcast_to(np.full(len(features), 1 / len(features)), q.shape)
    solutions = Solutions(q, p, features, names)
    assert {"f0", "a"} <= set(named(LinearF(interactions="none"), solutions))
    assert len(named(LinearF(interactions="none"), solutions)) <= 6
    checks = JackknifeF().fit(solutions).history_[0].checks
    assert all(check.reason == "nothing is lost" for check in checks)


@pytest.mark.parametrize("make", [LinearF, NetworkF], ids=["linear", "network"])
def test_the_level_is_held_on_an_irrelevant_feature(make) -> None:
    runs, n, kept = 200, 6, 0
    rng = np.random.default_rng(20261123)
    for _ in range(runs):
        base = planted(rng, n, effect=8.0)
        kept += make().fit(Solutions(base.q, base.p, base.features, ("a", "g"))).support_[1]
    # 5% of 200, within an exact 99.99% interval.
    assert binomtest(int(kept), runs).proportion_ci(0.9999, method="exact").low <= 0.05


def test_networks_are_the_same_for_the_same_seed() -> None:
    solutions = parity(5, 1)
    one, two, other = (
        NetworkF(random_state=s).fit(solutions).history_[0].checks for s in (3, 3, 4)
    )
    assert [c.statistic for c in one] == [c.statistic for c in two]
    assert [c.statistic for c in one] != [c.statistic for c in other]


def test_sobol_index_by_hand() -> None:
    # f = 2 f g: removing f loses all of its variance 4, and so does removing both.
    f, g, _ = 2.0 * BITS.T - 1
    rng = np.random.default_rng(0)
    scale = 2 + 0.2 * rng.normal(size=6)
    solutions = Solutions(scale[:, None] * f * g, np.full((6, 8), 1 / 8), BITS, ("f", "g", "a"))
    selector = NetworkF(partners=2000).fit(solutions)
    by = {c.feature: c for c in selector.history_[0].checks}
    exact = np.mean(scale) ** 2
    assert by[0].relevance == pytest.approx(exact, rel=0.1)
    assert by[1].relevance == pytest.approx(exact, rel=0.1)
    assert selector.removed_ == ("a",)


@pytest.mark.parametrize("make", [LinearF, NetworkF], ids=["linear", "network"])
def test_bad_input_is_refused(make) -> None:
    names = ("f", "a")
    base = planted(np.random.default_rng(0), 5)
    good = Solutions(base.q, base.p, base.features, names)
    with pytest.raises(ValueError, match="needs at least 3"):
        make().fit(good.take([0, 1]))
    with pytest.raises(ValueError, match="alpha is 2"):
        make(alpha=2.0).fit(good)
    flat = Solutions(np.ones_like(base.q), base.p, base.features, names)
    with pytest.raises(ValueError, match="constant"):
        make().fit(flat)
    with pytest.raises(ValueError, match="different p"):
        make().fit(
            Solutions(
                base.q, np.random.default_rng(0).dirichlet(np.ones(4), 5), base.features, names
            )
        )
    with pytest.raises(ValueError, match="Invalid parameter 'level'"):
        make().set_params(level=1)
    assert make().get_params()["alpha"] == 0.05
