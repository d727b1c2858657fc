"""Experiments of chapter 3: every one at smoke, and the parts that can be checked by hand."""

import numpy as np
import pytest

from thesis_lib.domains import continuing_cliff
from thesis_lib.edition.experiment import Context
from thesis_lib.experiments.chapter3 import EXPERIMENTS, beyond, common, table_3_1
from thesis_lib.experiments.chapter3 import continuing_cliff as cc
from thesis_lib.mdp import planning


@pytest.mark.parametrize("experiment", EXPERIMENTS, ids=lambda e: e.id)
def test_smoke_budget_runs_and_is_the_same_for_any_number_of_workers(experiment):
    one = experiment.run("smoke", seed=5, workers=1).table
    two = experiment.run("smoke", seed=5, workers=2).table
    ours = [c for c in one.columns if c != "cpu_seconds"]
    assert one[ours].equals(two[ours])
    assert len(one) > 0


def test_table_3_1_has_the_printed_entries():
    table = table_3_1.TABLE_3_1.run("smoke").table
    printed = table.dropna(subset=["printed_mean"])
    assert len(printed) == 14  # 12 entries and the two of Q^mu without sensor
    row = printed[(printed.potential == "Q_tilde") & printed.sensor]
    assert sorted(row.printed_mean) == [-4.75, -3.37]


@pytest.mark.slow
def test_table_3_1_meets_the_thesis():
    """At the thesis budget, each entry but Q^mu within 4 standard errors of what is printed."""
    table = table_3_1.TABLE_3_1.run(
        config=table_3_1.Config(potentials=("none", "Q_star", "Q_tilde")), seed=11
    ).table
    z = (table["mean"] - table.printed_mean) / np.hypot(table.ci95, table.printed_ci95) * 1.96
    assert (z.abs() < 4).all()
    assert (z**2).sum() < 32.9  # 99.9% of chi-square with 12 degrees of freedom


def test_stasis_share_by_hand():
    rewards = np.zeros(10)
    rewards[[1, 8]] = 10.0  # gaps without a goal: 1, 6 and 1 steps
    assert cc.stasis_share(rewards, 5) == pytest.approx(0.6)
    assert cc.stasis_share(rewards, 7) == 0.0


def test_leave_one_out_by_hand():
    # Factor 0 is best on task 0 only, factor 1 on tasks 1 and 2.
    totals = np.array([[[9.0], [1.0], [1.0]], [[2.0], [5.0], [5.0]]])
    # For task 0 the others prefer factor 1; for tasks 1 and 2 the sums are 10 against 7.
    assert beyond.leave_one_out(totals).ravel().tolist() == [2.0, 1.0, 1.0]


def test_greedy_path_reaches_the_goal_without_exploration():
    domain = continuing_cliff(0.9)
    for m, task in enumerate(domain.tasks):
        assert cc.reaches_goal(domain, m, planning.solve(task).q)
        assert not cc.reaches_goal(domain, m, planning.soft_policy_iteration(task, 0.2).q)


def test_total_rewards_are_what_the_learner_earned():
    """On a deterministic greedy walk the total is known: the cliff's best path costs 5."""
    from thesis_lib import potentials
    from thesis_lib.domains import episodic_cliff

    domain = episodic_cliff(True)
    learner = common.Learner("q_learning", 1.0, 0.0, episodes=3)
    phi = potentials.q_star(domain)
    first = common.total_rewards(Context(seed=1), domain, [(learner, phi)], 2)
    assert first.shape == (1, 8, 2)
    assert (first <= -15).all()


def test_unknown_potential_is_named():
    with pytest.raises(ValueError, match="choose from none, Q_star"):
        common.named_potentials(
            continuing_cliff(), ["Q"], epsilon=0.1, mu=common.MuSearch(), seed=0
        )
