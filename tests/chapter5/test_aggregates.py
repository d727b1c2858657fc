"""Interquartile means, probabilities of improvement, and rules that choose a policy."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import mannwhitneyu, trim_mean

from tests.chapter5.worlds import ROBOTS, THESIS
from thesis_lib.chapter5 import aggregates, best_policy
from thesis_lib.chapter5.contrasts import Config


def test_interquartile_mean_by_hand_and_as_rliable_reckons_it():
    scores = np.array([[9.0, 1.0, 2.0, 3.0], [4.0, 5.0, 6.0, 100.0]])
    assert aggregates.iqm(scores) == (3 + 4 + 5 + 6) / 4
    odd = np.random.default_rng(0).normal(size=(5, 3, 7))
    expected = [trim_mean(part, 0.25, axis=None) for part in odd]
    np.testing.assert_allclose(aggregates.iqm(odd), expected)


def test_probability_of_improvement_by_hand_and_by_mann_and_whitney():
    first, second = np.array([[1.0, 3.0]]), np.array([[2.0, 3.0, 0.0]])
    # 1 beats 0; 3 beats 2 and 0 and ties with 3: (1 + 2.5) of 6 pairs.
    assert aggregates.improvement(first, second) == pytest.approx(3.5 / 6)
    rng = np.random.default_rng(1)
    x, y = rng.integers(9, size=(4, 6)), rng.integers(9, size=(4, 5))
    by_row = [mannwhitneyu(a, b).statistic / (len(a) * len(b)) for a, b in zip(x, y, strict=True)]
    assert aggregates.improvement(x, y) == pytest.approx(np.mean(by_row))
    both = aggregates.improvement(x, y) + aggregates.improvement(y, x)
    assert both == pytest.approx(1)


@pytest.fixture(scope="module")
def summed(tmp_path_factory) -> pd.DataFrame:
    store = str(THESIS.write(tmp_path_factory.mktemp("thesis") / "store"))
    config = Config(resamples=300, store=store)
    return aggregates.aggregates.run(config=config).table


def test_a_net_that_is_ahead_everywhere_is_ahead(summed):
    learning = summed[summed.measure == "learning"].set_index("architecture")
    assert (learning.rows == 10).all()
    assert (learning.seeds == 5).all()
    best = learning.loc["DFFWD"]
    assert best.better > 0.95
    assert best.better_low > 0.5
    assert best.leads == 10
    assert learning.leads.sum() < 70
    assert best.iqm == pytest.approx(1, abs=0.02)
    assert (learning.low < learning.iqm).all()
    assert (learning.iqm < learning.high).all()
    # Each pair's two probabilities add up to 1, so that their mean over all nets is a half.
    assert summed.groupby("measure").better.mean().tolist() == pytest.approx([0.5] * 4)


def test_aggregates_are_shown_and_told(summed):
    one = aggregates.shown(summed, "learning")
    assert one.columns.tolist() == ["net", "IQM", "better than another", "among the best"]
    side = aggregates.across(summed, "better", "noise", "switch")
    assert side.shape == (7, 3)
    assert "On 10 rows, with the first 5 runs a net" in aggregates.reading(summed, "learning")
    none = summed.iloc[:0]
    assert aggregates.reading(none, "learning").startswith("No row")
    assert aggregates.across(none, "iqm", "test").test.isna().all()


def test_the_rule_that_chooses_a_policy_can_change_who_is_best(tmp_path):
    """One row: the GRU has the best seed, the LSTM the best mean, the ESN the best batches."""
    rows = {"gru": [(9.0, 900.0), (1.0, 100.0), (2.0, 200.0)], "lstm": [(5.0, 600.0)] * 3}
    rows |= {net: [(0.0, 10.0)] * 3 for net in ("ctrnn", "dtrnn", "esn", "dffwd", "ffwd")}
    at = {"task": ROBOTS[0], "terrain": "flat", "variant": "default"}
    curves, tests = [], []
    for net, seeds in rows.items():
        for seed, (last, tested) in enumerate(seeds):
            run = at | {"architecture": net, "seed": seed}
            curves.append(run | {"iteration": 1, "steps": 50_000, "mean_return": last})
            result = run | {"condition": "base", "test": 0}
            tests.append(result | {"policy": "last", "return": tested})
            batch = 5000.0 if net == "esn" else 1.0
            tests.append(result | {"policy": "best", "return": batch})
    layer = tmp_path / "depth"
    layer.mkdir()
    pd.DataFrame(curves).to_csv(layer / "curves.csv", index=False)
    pd.DataFrame(tests).to_csv(layer / "tests.csv", index=False)
    config = Config(store=str(tmp_path))
    # The tables have the last policies alone.
    assert config.runs().returns()["return"].max() == 900
    table = best_policy.by_rule.run(config=config).table
    assert (table.seeds == 3).all()
    shown = best_policy.shown(table).set_index("net")
    assert shown.loc["LSTM", "all seeds"] == "1.00 (1)"
    assert shown.loc["GRU"].tolist() == ["0.67 (0)", "1.00 (1)", "0.00 (0)"]  # 400 of 600
    assert shown.loc["ESN", "best batch"] == "1.00 (1)"
    told = best_policy.reading(table)
    assert told.count("another net is best on 1 of 1 rows (Ant flat)") == 2
    none = best_policy.by_rule.run(config=Config(store="/nowhere")).table
    assert best_policy.reading(none).startswith("No row")
    assert best_policy.shown(none).columns.tolist() == ["net"]
