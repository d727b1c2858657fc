"""Table 3.1: its entries, and its criteria on tables made by hand."""

import numpy as np
import pandas as pd
import pytest

from thesis_lib.chapter3 import readings, table_3_1
from thesis_lib.edition.ledger import Verdict


def table(returns, sd=1.0, n=100):
    """Entries with these mean returns by potential, algorithm and sensor, exactly as printed."""
    keys = pd.DataFrame(list(returns), columns=["potential", "algorithm", "sensor"])
    means = np.array(list(returns.values()), dtype=float)
    spread = {"ci95": 1.98 * sd / n**0.5, "sd": sd, "n_runs": n}
    printed = {"printed_mean": means, "printed_ci95": 1.96 * sd / n**0.5}
    return keys.assign(mean_return=means, **spread, **printed)


def cliff(**changes):
    """The thesis's picture: Sarsa above Q-learning, potentials help, most with the sensor."""
    level = {"none": 0.0, "Q_star": 1.0, "Q_tilde": 2.0, "Q_mu": -9.0} | changes
    return {
        (p, a, s): level[p] + 0.5 * (a == "sarsa")
        for p in level
        for a in ("q_learning", "sarsa")
        for s in (False, True)
    }


ORDERS = [
    table_3_1.sarsa_beats_q_learning,
    table_3_1.potentials_help_q_learning,
    table_3_1.sensor_lets_potentials_help_sarsa,
    table_3_1.q_mu_is_poor,
]


@pytest.mark.parametrize("judge", ORDERS, ids=lambda c: c.subject)
class TestOrders:
    def test_holds_where_it_should(self, judge):
        found = judge(table(cliff(), sd=0.5, n=400))
        assert found.verdict is Verdict.REPRODUCED
        assert "way stated" not in found.evidence

    def test_equal_means_do_not_show_it(self, judge):
        flat = dict.fromkeys(cliff(), 0.0)
        assert judge(table(flat)).verdict is Verdict.INCONCLUSIVE

    def test_the_wrong_sign_refutes_it(self, judge):
        turned = {key: -value for key, value in cliff().items()}
        found = judge(table(turned, sd=0.5, n=400))
        assert found.verdict is Verdict.REFUTED
        assert "significantly the other way" in found.evidence

    def test_too_few_runs_give_the_direction_only(self, judge):
        assert judge(table(cliff(), sd=50.0, n=3)).verdict is Verdict.DIRECTION


def test_numbers_near_the_printed_ones():
    own = table(cliff())
    assert table_3_1.printed_numbers(own).verdict is Verdict.REPRODUCED
    # 12 entries, each 10 standard errors off.
    shifted = own.assign(printed_mean=own.printed_mean + 10 * (0.01 + 0.01) ** 0.5)
    found = table_3_1.printed_numbers(shifted)
    assert found.verdict is Verdict.NOT_REPRODUCED
    assert found.numbers["chi_square"] == pytest.approx(12 * 100, rel=1e-3)  # 1.96 is rounded


@pytest.mark.parametrize("change", [{"fall_reward": -999.0}, {"discount": 0.9}, {"size": 5}])
def test_a_sensor_does_not_matter_where_tasks_differ_in_nothing_else(monkeypatch, change):
    same, make = table_3_1.sensor_does_not_matter_in_one_task, table_3_1.episodic_cliff
    assert same().verdict is Verdict.REPRODUCED
    assert "8 of 8 tasks" in same().evidence
    monkeypatch.setattr(table_3_1, "episodic_cliff", lambda s: make(s, **(change if s else {})))
    assert same().verdict is Verdict.REFUTED


def test_the_printed_entries_are_beside_ours():
    own = table_3_1.entries.run("smoke").table
    printed = own.dropna(subset=["printed_mean"])
    assert len(printed) == 14  # 12 entries and the two of Q^mu without sensor
    row = printed[(printed.potential == "Q_tilde") & printed.sensor]
    assert sorted(row.printed_mean) == [-4.75, -3.37]


@pytest.mark.slow
def test_table_3_1_meets_the_thesis():
    """At the thesis budget, each entry but Q^mu within 4 standard errors of what is printed."""
    config = table_3_1.Config(potentials=("none", "Q_star", "Q_tilde"))
    own = table_3_1.entries.run(config=config, seed=11).table
    z = (own.mean_return - own.printed_mean) / np.hypot(own.ci95, own.printed_ci95) * 1.96
    assert (z.abs() < 4).all()
    assert (z**2).sum() < 32.9  # 99.9% of chi-square with 12 degrees of freedom


def test_the_fit_is_told_at_its_best_and_at_the_text():
    curve = pd.DataFrame({"reading": "as fitted", "episodes": [500, 600], "chi2": [900.0, 12.0]})
    curve = curve.assign(dof=12, p_value=[0.0, 0.45], worst_z=[9.6, 2.0])
    told = readings.fitted_reading(curve)
    assert "best at 600 episodes (chi-square 12, p = 0.45)" in told
    assert "is 900 (p < 0.001, worst entry 10 standard errors off)" in told


def test_what_a_constant_earns_is_told_for_every_part():
    told = table_3_1.control(table(cliff(constant=1.0)))
    assert told.count("±") == 4
    assert "+1.00 ± 0.28 (Q-learning without sensor)" in told
