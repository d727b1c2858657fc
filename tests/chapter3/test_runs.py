"""Runs of a learner with a potential, and parts of results that can be checked by hand."""

import numpy as np
import pandas as pd
import pytest

from thesis_lib import potentials
from thesis_lib.chapter3 import figure_3_2, huddle, runs, scaling
from thesis_lib.domains import Domain, continuing_cliff, episodic_cliff
from thesis_lib.edition.experiment import Context
from thesis_lib.mdp import planning


def test_stasis_share_by_hand():
    rewards = np.zeros(10)
    rewards[[1, 8]] = 10.0  # gaps without a goal: 1, 6 and 1 steps
    assert figure_3_2.stasis_share(rewards, 5) == pytest.approx(0.6)
    assert figure_3_2.stasis_share(rewards, 7) == 0.0


def test_runs_on_one_random_potential_count_as_one_by_hand():
    """Runs 0, 2 and 4 had the first potential and 1, 3 and 5 the second."""
    of_runs = np.array([[1.0, 10.0], [2.0, 20.0], [3.0, 30.0], [4.0, 40.0], [5.0, 50.0], [9.0, 0]])
    assert figure_3_2.independent(of_runs, 2).tolist() == [[3.0, 30.0], [5.0, 20.0]]
    assert figure_3_2.independent(of_runs, 1) is of_runs


def test_figure_3_2_learns_its_random_potential_more_than_once(monkeypatch):
    """So that its interval knows the luck of learning: with one potential it has no such spread."""
    seeds = []

    def learned(domain, context, **settings):
        seeds.append(context.seed)
        return [np.full((task.n_states, task.n_actions), len(seeds)) for task in domain.tasks]

    monkeypatch.setattr(figure_3_2, "sarsa_solutions", learned)
    config = figure_3_2.Config(n_runs=6, learned=3, steps=200, points=1, stasis=50)
    table = figure_3_2.mean_curves.run("smoke", config=config).table.set_index("potential")
    assert len(set(seeds)) == 3
    assert table.n_runs.to_dict() == {"none": 6, "Q_star": 6, "Q_tilde": 6, "Q_tilde_sarsa": 3}
    with pytest.raises(ValueError, match="n_runs is 5, but it must be a multiple of learned"):
        figure_3_2.Config(n_runs=5, learned=3)


def test_leave_one_out_by_hand():
    # Factor 0 is best on task 0 only, factor 1 on tasks 1 and 2.
    totals = np.array([[[9.0], [1.0], [1.0]], [[2.0], [5.0], [5.0]]])
    # For task 0 the others prefer factor 1; for tasks 1 and 2 the sums are 10 against 7.
    assert scaling.leave_one_out(totals).ravel().tolist() == [2.0, 1.0, 1.0]


def test_every_return_of_the_table_of_factors_has_its_interval():
    words = {"domain": "triangle", "algorithm": "sarsa", "potential": "Q_mu"}
    rows = [
        {**words, "factor": factor, "mean_return": mean, "ci95": half}
        for factor, mean, half in ((0.0, 5.0, 1.0), (1.0, -49426.11, 1240.0), (2.0, 9.0, 0.5))
    ]
    table = pd.DataFrame(rows).assign(derived_mean=8.0, derived_ci95=0.75)
    (best,) = scaling.bests(table).to_dict("records")
    assert (best["factor"], best["at_best"], best["derived"]) == (2.0, 9.0, 8.0)
    (shown,) = scaling.shown(table).to_dict("records")
    assert shown["best factor"] == "2"
    returns = [shown[name] for name in ("return with it", "with factor 1", "derived")]
    assert returns == ["9.00 ± 0.50", "−49,400 ± 1,200", "8.00 ± 0.75"]


def test_greedy_path_reaches_the_goal_without_exploration():
    domain = continuing_cliff(0.9)
    for m, task in enumerate(domain.tasks):
        assert huddle.reaches_goal(domain, m, planning.solve(task).q)
        assert not huddle.reaches_goal(domain, m, planning.soft_policy_iteration(task, 0.2).q)


def test_total_rewards_are_what_the_learner_earned():
    """On a deterministic greedy walk the total is known: the cliff's best path costs 5."""
    domain = episodic_cliff(True)
    learner = runs.TabularLearner("q_learning", 1.0, 0.0, episodes=3)
    phi = potentials.q_star(domain)
    first = runs.total_rewards(Context(seed=1), domain, [(learner, phi)], 2)
    assert first.shape == (1, 8, 2)
    assert (first <= -15).all()


def test_a_potential_draws_the_learner_towards_what_it_values():
    """A task's own Q* walks its best path from the first step, -5 an episode; -Q* leads astray."""
    every = episodic_cliff(False)
    domain = Domain("one task", every.tasks[:1], members=[every.observation_index[0] >= 0])
    learner = runs.TabularLearner("q_learning", 1.0, 0.0, episodes=3)
    phi = potentials.q_star(domain)
    cells = [(learner, phi), (learner, -phi)]
    towards, away = runs.total_rewards(Context(seed=1), domain, cells, 2)
    assert towards.tolist() == [[-15.0, -15.0]]
    assert (away < -15.0).all()


def test_unknown_potential_is_named():
    with pytest.raises(ValueError, match="choose one of none, Q_star"):
        runs.named_potentials(continuing_cliff(), ["Q"], epsilon=0.1, mu=runs.MuSearch(), seed=0)
