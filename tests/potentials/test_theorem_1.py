"""Theorem 1: initialising value iteration (section 3.3.1)."""

import numpy as np
import pytest

from thesis_lib import potentials
from thesis_lib.domains import Domain, continuing_cliff, episodic_cliff, stock, triangle
from thesis_lib.mdp.model import TabularMDP
from thesis_lib.potentials import theorem_1

DOMAINS = {
    "episodic cliff": episodic_cliff(discount=0.95),
    "continuing cliff": continuing_cliff(discount=0.9),
    "triangle": triangle(discount=0.9),
    "stock": stock(1, 2, 1, discount=0.9),
}


def bandit(rewards, discount=0.5):
    """One state, continuing: Q*(a) = r(a) + gamma max r / (1 - gamma)."""
    return TabularMDP(np.ones((1, len(rewards), 1)), [rewards], [1.0], discount=discount)


def corrected_objective(distribution, delta, tolerance):
    """G = sum of D(m) log max(delta_m, epsilon), which the truncated minimiser lowers."""
    return float(np.dot(distribution, np.log(np.maximum(delta, tolerance))))


@pytest.fixture
def bandits():
    """Q* = (2, 1) and (3, 6)."""
    return Domain("bandits", (bandit([1.0, 0.0]), bandit([0.0, 3.0])))


def test_distances_and_objective_by_hand(bandits):
    tables = potentials.optimal_solutions(bandits)
    assert [t.tolist() for t in tables] == [[[2.0, 1.0]], [[3.0, 6.0]]]
    delta = theorem_1.distances(bandits, tables, [[2.0, 2.0]])
    assert delta.tolist() == [1.0, 4.0]
    value = theorem_1.log_geometric_mean(bandits.distribution, delta)
    assert value == pytest.approx(0.5 * np.log(4.0))
    assert theorem_1.sufficient_sweeps(delta, 1.0, 0.5).tolist() == [0.0, 2.0]


def test_the_objective_is_degenerate(bandits):
    """At one task's own Q* the product of distances is 0, whatever the other tasks are."""
    tables = potentials.optimal_solutions(bandits)
    own = theorem_1.single_task(bandits, tables, 0, np.zeros(bandits.shape))
    delta = theorem_1.distances(bandits, tables, own)
    assert theorem_1.log_geometric_mean(bandits.distribution, delta) == -np.inf


def test_the_bound_is_an_affine_function_of_the_corrected_objective(bandits):
    """Sufficient sweeps, task by task, against G: the same minimisers for every tolerance."""
    rng = np.random.default_rng(1)
    delta = rng.exponential(size=(50, 2))
    for tolerance in (1e-6, 0.1, 5.0):
        for row in delta:
            bound = bandits.distribution @ theorem_1.sufficient_sweeps(row, tolerance, 0.5)
            objective = corrected_objective(bandits.distribution, row, tolerance)
            assert bound == pytest.approx((objective - np.log(tolerance)) / np.log(2))


def test_minimisers_run_from_one_task_to_the_midrange(bandits):
    """Q* = (2, 1) and (3, 6), 5 apart: one task for a small tolerance, both from 2.5 on.

    In between, at distance d of one and 5 - d of the other, G = log max(d, e) max(5 - d, e) / 2
    is concave in d above e, so that it is least at an end: d = e.
    """
    tables = potentials.optimal_solutions(bandits)
    for tolerance, least in ((1e-3, 1e-3 * (5 - 1e-3)), (1.0, 4.0), (2.5, 6.25)):
        found = theorem_1.truncated_minimiser(bandits, tables, tolerance)
        delta = theorem_1.distances(bandits, tables, found)
        value = corrected_objective(bandits.distribution, delta, tolerance)
        assert value == pytest.approx(np.log(least) / 2, abs=1e-5)
    middle = theorem_1.distances(bandits, tables, theorem_1.midrange(bandits, tables))
    assert middle.max() == 2.5


def test_the_heavier_of_two_sets_that_agree_wins():
    """Tasks 0 and 1 agree, task 2 has more weight than either and less than both."""
    domain = Domain(
        "bandits",
        (bandit([1.0, 0.0]), bandit([1.0, 0.0]), bandit([0.0, 3.0])),
        distribution=np.array([0.3, 0.3, 0.4]),
    )
    tables = potentials.optimal_solutions(domain)
    delta = theorem_1.distances(domain, tables, theorem_1.truncated_minimiser(domain, tables, 1e-4))
    assert (delta[:2] < 2e-4).all()
    assert delta[2] > 1


def test_truncated_minimiser_beats_a_search(bandits):
    tables = potentials.optimal_solutions(bandits)
    found = theorem_1.distances(
        bandits, tables, theorem_1.truncated_minimiser(bandits, tables, 0.3)
    )
    lowest = corrected_objective(bandits.distribution, found, 0.3)
    for x in np.linspace(1, 4, 31):
        for y in np.linspace(0, 7, 71):
            delta = theorem_1.distances(bandits, tables, [[x, y]])
            assert corrected_objective(bandits.distribution, delta, 0.3) > lowest - 1e-5


def test_midrange_and_mean_distance_by_hand(bandits):
    tables = potentials.optimal_solutions(bandits)
    assert theorem_1.midrange(bandits, tables).tolist() == [[2.5, 3.5]]
    # |1 - y| and |6 - y| add up to at least 5: the mean distance is at least 2.5.
    best = theorem_1.mean_distance_minimiser(bandits, tables)
    assert theorem_1.distances(bandits, tables, best).mean() == pytest.approx(2.5)


@pytest.mark.parametrize("name", DOMAINS)
def test_bound_on_every_domain(name):
    """Measured sweeps never exceed the smallest integer the bound allows."""
    domain = DOMAINS[name]
    tables = potentials.optimal_solutions(domain)
    rng = np.random.default_rng(0)
    scale = max(np.abs(t).max() for t in tables)
    for q0 in (
        np.zeros(domain.shape),
        potentials.cross_task_values(domain, tables),
        theorem_1.midrange(domain, tables),
        scale * rng.normal(size=domain.shape),
    ):
        # States outside S_m (a cliff cell) start at their own values: they are never visited.
        starts = [
            np.where((i >= 0)[:, None], domain.scatter(q0, m), tables[m])
            for m, i in enumerate(domain.observation_index)
        ]
        delta = theorem_1.distances(domain, tables, q0)
        enough = np.ceil(theorem_1.sufficient_sweeps(delta, 1e-3, domain.discount) - 1e-9)
        for task, table, start, most in zip(domain.tasks, tables, starts, enough, strict=True):
            assert theorem_1.measured_sweeps(task, table, start, 1e-3) <= most


@pytest.mark.parametrize("tolerance", [0.1, 0.001])
def test_minimiser_is_no_worse_than_what_it_starts_from(tolerance):
    domain = DOMAINS["triangle"]
    tables = potentials.optimal_solutions(domain)
    mean = potentials.cross_task_values(domain, tables)

    def objective(q0):
        delta = theorem_1.distances(domain, tables, q0)
        return corrected_objective(domain.distribution, delta, tolerance)

    found = objective(theorem_1.truncated_minimiser(domain, tables, tolerance, starts=(mean,)))
    alone = [theorem_1.single_task(domain, tables, m, mean) for m in range(len(domain))]
    for other in (mean, theorem_1.midrange(domain, tables), *alone):
        assert found <= objective(other) + 1e-5


def test_midrange_minimises_the_largest_distance():
    domain = DOMAINS["triangle"]
    tables = potentials.optimal_solutions(domain)
    middle = theorem_1.distances(domain, tables, theorem_1.midrange(domain, tables)).max()
    rng = np.random.default_rng(0)
    for _ in range(200):
        other = theorem_1.midrange(domain, tables) + rng.normal(scale=0.3, size=domain.shape)
        assert theorem_1.distances(domain, tables, other).max() >= middle - 1e-12


def test_bad_input(bandits):
    tables = potentials.optimal_solutions(bandits)
    with pytest.raises(ValueError, match="tolerance is 0"):
        theorem_1.truncated_minimiser(bandits, tables, 0.0)
    with pytest.raises(ValueError, match="strictly between 0 and 1"):
        theorem_1.sufficient_sweeps([1.0], 0.1, 1.0)
    with pytest.raises(ValueError, match="tolerance is 0"):
        theorem_1.sufficient_sweeps([1.0], 0, 0.5)
