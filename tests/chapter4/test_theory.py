"""Chapter 4 on tables: what can be checked by hand, exactly or against another chapter."""

from fractions import Fraction

import numpy as np
import pandas as pd
import pytest

from thesis_lib.chapter3.runs import TabularLearner
from thesis_lib.chapter4 import (
    estimators,
    figure_4_1,
    figure_4_2,
    figure_4_4,
    protocol,
    roc,
    theorem_2,
    threshold,
)
from thesis_lib.chapter4.random_solutions import random_solutions
from thesis_lib.chapter4.runs import Trial, exact_solutions, solve_domain, task_solutions
from thesis_lib.domains import continuing_cliff, stock, triangle
from thesis_lib.domains.planted import random_domain, torus
from thesis_lib.edition.experiment import Context
from thesis_lib.mdp import solve
from thesis_lib.potentials import q_star
from thesis_lib.relevance import domain_relevance, estimate, k_relevance, remove
from thesis_lib.selection import FSTEK, ExactRelevance

CONTEXT = Context(seed=3)
LEARNER = TabularLearner("q_learning", 0.5, 0.01, episodes=3)


# Figure 4.1.


def test_figure_4_1_forward_is_what_the_figure_shows():
    table = figure_4_1.curves.run("thesis").table
    last = table[table.k == table.k.max()].set_index(["feature", "direction"]).relevance
    first = table[table.k == 1].set_index(["feature", "direction"]).relevance
    # Forward: action and distance fall and stay, the position goes; backward: distance rises.
    assert first["a", "forward"] > last["a", "forward"] > 1
    assert first["x2", "forward"] > last["x2", "forward"] > 0.5
    assert last["x1", "forward"] < 0.1 * first["x1", "forward"]
    assert first["x2", "backward"] < last["x2", "backward"]


# Figure 4.2.


def test_figure_4_2_areas_and_matrices():
    table = figure_4_2.elements.run("thesis").table
    areas = table.drop_duplicates(["k", "sequence"]).set_index("sequence")
    for k in (1, 2, 3):
        assert areas.probability[areas.k == k].sum() == pytest.approx(1)
    assert areas.probability["12"] == pytest.approx(0.5 * 0.25)
    # "Relevance on a given sequence is the sum of all matrix elements", each weighing 1/k^2.
    mean = table.groupby("sequence").covariance.mean()
    assert np.allclose(mean, areas.relevance[mean.index])
    # Tasks share p(x|m): the matrix of (1, 2, 3) contains that of (1, 2).
    at = table.set_index(["sequence", "i", "j"]).covariance
    assert all(
        at["123", i, j] == pytest.approx(at["12", i, j], abs=1e-12) for i in (1, 2) for j in (1, 2)
    )
    assert len(set(np.round(at["123"].abs(), 6))) > 2


# Theorems.


def test_counterexamples_by_hand():
    table = theorem_2.counterexamples.run("thesis").table.set_index(["example", "k"])
    for k in range(1, 7):
        one_over_k = table.loc["ratio of steps tends to 1", :].relevance[k]
        assert one_over_k == pytest.approx(1 / k)
        assert table.loc["relevance rises", :].relevance[k] == pytest.approx(1 - 1 / k)
    grows = table.loc["a step grows from 0", :].fraction
    assert [grows[k] for k in (1, 2, 3)] == ["1/2", "1/2", str(Fraction(167, 336))]


def test_theorems_smoke_tables_hold_where_p_is_shared(smoke):
    two = smoke["theorem-2"].set_index("kind")
    assert two.steps_shrink["shared"] == 1
    assert two.law_error["shared"] < 1e-12
    assert two.law_error["weights"] > 1e-3
    assert (two.brute_force_error < 1e-12).all()
    three = smoke["theorem-3"].set_index("kind")
    assert three.increasing["shared"] == three.not_monotone["shared"] == 0


def test_u_is_unbiased_where_p_is_shared():
    config = estimators.Config(runs=400, tasks_seen=(3,))
    table = estimators.biases.run(config=config).table
    at = table[(table.domain == "stock") & (table.n == 3)]
    u = at[(at.drawn == "with") & (at.estimator == "U")]
    corrected = at[(at.drawn == "without") & (at.estimator == "finite")]
    # Four standard errors; V_n, in contrast, sees three times a third of the noise.
    assert (u.bias.abs() < 2 * u.bias_ci95 + 1e-12).all()
    assert (corrected.bias.abs() < 2 * corrected.bias_ci95 + 1e-12).all()
    v = at[(at.drawn == "with") & (at.estimator == "V_n") & (at.feature == "g1")]
    assert (v.bias > 2 * v.bias_ci95).all()


# Domain families.


@pytest.mark.parametrize(
    ("domain", "relevant"),
    [
        (random_domain(7), {"r1", "r2", "a"}),
        (random_domain(8, relevant=1, irrelevant=2, bases=2), {"r1", "a"}),
        (torus(), {"dx", "dy", "a"}),
    ],
    ids=["random", "small random", "torus"],
)
def test_planted_features_are_what_they_are_said_to_be(domain, relevant):
    solutions = exact_solutions(domain)
    names = np.array(solutions.feature_names)
    assert set(names[ExactRelevance().fit(solutions).support_]) == relevant
    total = domain_relevance(solutions, np.zeros(solutions.n_pairs, dtype=int))
    for name in names:
        lost = domain_relevance(solutions, remove(solutions, [name]))
        assert (lost > 1e-6 * total) == (name in relevant)


def test_irrelevant_features_of_the_families_matter_within_tasks():
    for domain, name in ((random_domain(7), "i1"), (torus(), "x")):
        solutions = exact_solutions(domain)
        assert k_relevance(solutions, remove(solutions, [name]), 3) > 1e-3


def test_images_of_a_random_task_have_mirrored_values():
    domain = random_domain(7, relevant=1, irrelevant=1, bases=1)
    one, other = (solve(task).q for task in domain.tasks)
    # States are (r1, i1) = 00, 01, 10, 11; the image swaps the values of i1.
    np.testing.assert_allclose(other, one[[1, 0, 3, 2]], atol=1e-9)


# Potentials.


def test_potential_with_all_features_and_tasks_is_that_of_chapter_3():
    found = solve_domain(triangle(), LEARNER, CONTEXT)
    every = np.arange(len(found.domain))
    phi = found.potential(every, np.ones(4, dtype=bool))
    np.testing.assert_allclose(phi, q_star(found.domain))


def test_optimal_values_draw_the_learner_to_what_is_good():
    found = solve_domain(triangle(), LEARNER, CONTEXT)
    trial = Trial(found, LEARNER, 40, np.random.default_rng(0))
    phi = q_star(found.domain)
    good, none, bad = (trial.mean_return(factor * phi) for factor in (1.0, 0.0, -1.0))
    assert good > none > bad


def test_constant_potential_is_the_mean_value():
    found = solve_domain(stock(1, 2, 1), LEARNER, CONTEXT)
    phi = found.potential(np.array([0, 1]), np.zeros(5, dtype=bool))
    assert np.ptp(phi) == 0
    assert phi[0, 0] == pytest.approx(found.solutions.q[:2].mean())


def test_pairs_that_no_task_visited_get_the_value_given():
    found = solve_domain(triangle(), LEARNER, CONTEXT)
    phi = found.potential(np.array([0]), np.ones(4, dtype=bool), unseen=7.0)
    assert (phi == 7.0).sum() == 36 - 9


def test_cliff_position_is_labelled_irrelevant_by_exception_only():
    config = figure_4_4.Config()
    found = solve_domain(
        continuing_cliff(), config.learner, CONTEXT, irrelevant=figure_4_4.POSITION
    )
    assert ExactRelevance().fit(found.solutions).support_.all()
    kept = dict(zip(found.solutions.feature_names, found.truth, strict=True))
    assert kept == {"x": False, "y": False, "cliff": True, "a": True}


def test_solutions_can_be_learned():
    learner = TabularLearner("q_learning", 0.5, 0.1, episodes=50)
    for target in ("Q_star", "Q_tilde"):
        exact = task_solutions(triangle(), target, "exact", learner, CONTEXT)
        learned = task_solutions(triangle(), target, "learned", learner, CONTEXT)
        gap = [np.abs(a - b)[:3].max() for a, b in zip(exact, learned, strict=True)]
        assert max(gap) < 3
    with pytest.raises(ValueError, match="target"):
        task_solutions(triangle(), "Q", "exact", learner, CONTEXT)


# Protocol.


def test_methods_that_select_the_same_earn_the_same(smoke):
    table = smoke["figure-4.3"].set_index(["method", "tasks_seen"])
    assert table.features_kept["none", 3] == 4
    assert table.fpr["fixed", 3] == table.fpr["constant", 3] == 0
    assert table.tpr["fixed", 3] == 1
    assert table.tpr["constant", 3] == 0
    # Three points have no residual: FS-TEK keeps what varies and is unsure about it.
    assert table.fpr["fs-tek", 3] == 1
    same = table.mean_return["fs-tek", 3] - table.fstek_minus["none", 3]
    assert same == pytest.approx(table.mean_return["none", 3])


def test_measure_counts_runs_and_pairs_methods():
    found = solve_domain(triangle(), LEARNER, CONTEXT)
    size = protocol.Protocol(runs=4, tests=2, tasks_seen=(2, 12), methods=("none", "fs-tek"))
    table = pd.DataFrame(protocol.measure(found, LEARNER, size, 1e-3, "unsure", CONTEXT, 0))
    assert set(table.n_runs) == {4}
    # Below three tasks FS-TEK selects nothing.
    at = table.set_index(["method", "tasks_seen"])
    assert at.none_minus["fs-tek", 2] == at.none_minus_ci95["fs-tek", 2] == 0


# Selector.


def test_roc_families_have_truth_and_new_ones_are_new():
    assert set(roc.NEW) < set(roc.FAMILIES)
    # Stock with two sectors, random MDPs, and a gridworld.
    assert len({name.split()[0] for name in roc.NEW}) == 3


def test_threshold_table_counts_agreement():
    config = threshold.Config(tasks_seen=(5, 31, 32), alphas=(1e-4, 1e-2), checked=(5,), domains=20)
    table = threshold.limits.run(config=config).table
    checked = table[table.n_decisions > 0]
    assert (checked.agree == checked.n_decisions).all()
    assert (checked.removed > 0).any()
    at = table.set_index(["tasks_seen", "alpha"]).threshold
    assert at[5, 1e-4] > at[31, 1e-4] > at[32, 1e-4]
    assert at[5, 1e-4] > at[5, 1e-2]


def test_a_threshold_decision_by_hand():
    # Four tasks that differ in sign only: mean 0, F = 0, below any positive threshold.
    rng = np.random.default_rng(0)
    solutions = random_solutions(rng, "shared", 2)
    q = np.concatenate([solutions.q[:1], -solutions.q[:1]] * 2)
    four = type(solutions)(q, solutions.p[:1].repeat(4, 0), solutions.features, ("f", "g"))
    assert estimate(four, remove(four, ["f"])).f_ratio == pytest.approx(0, abs=1e-9)
    assert FSTEK(1e-4).fit(four).removed_[0] in ("f", "g")
