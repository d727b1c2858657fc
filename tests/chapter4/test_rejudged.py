"""The statements of chapter 4 judged harder: criteria that can fail, what is known exactly."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm, t

from thesis_lib import relevance
from thesis_lib.chapter4 import (
    contraction,
    joint_search,
    prediction,
    predictors,
    roc,
    sampled_threshold,
    scatter,
    threshold,
    threshold_regret,
)
from thesis_lib.chapter4.protocol import Protocol
from thesis_lib.domains import triangle
from thesis_lib.edition.ledger import Verdict
from thesis_lib.potentials import optimal_solutions
from thesis_lib.relevance import Solutions


def test_steps_follow_the_factor_and_a_wrong_law_is_refuted() -> None:
    table = contraction.steps.run("smoke").table
    shared = table[table.kind == "shared"]
    np.testing.assert_allclose(shared.lowest, (shared.k - 1) / (shared.k + 1), atol=1e-6)
    np.testing.assert_allclose(shared.highest, (shared.k - 1) / (shared.k + 1), atol=1e-6)
    grows = table.assign(highest=table.highest.where(table.kind != "shared", 1.1))
    assert contraction.contracts_for_each_k(grows).verdict is Verdict.REFUTED
    calm = table.assign(larger=0.0)
    assert contraction.contracts_for_each_k(calm).verdict is Verdict.REPRODUCED


def test_the_rest_is_judged_by_its_coefficient() -> None:
    config = contraction.Config(domains=8, lengths=(1000,))
    table = contraction.steps.run(config=config).table
    assert contraction.rest_is_of_second_order(table).verdict is Verdict.REPRODUCED
    assert contraction.rest_is_of_second_order(table.assign(rest=2.0)).verdict is Verdict.REFUTED


def test_with_every_combination_the_threshold_decides() -> None:
    config = sampled_threshold.Config(tasks_seen=(5,), max_seqs=(3, threshold.EVERY))
    table = sampled_threshold.agreement.run(config=config, seed=1).table.set_index(
        ["interval", "max_seqs"]
    )
    row = table.loc["curve", threshold.EVERY]
    assert row.agree == row.n_decisions
    assert table.loc["curve", 3].agree < row.n_decisions
    finding = sampled_threshold.both_conditions_are_needed
    assert finding(table.reset_index()).verdict is Verdict.REPRODUCED
    assert finding(table.assign(agree=table.n_decisions).reset_index()).verdict is Verdict.DIRECTION
    assert finding(table.assign(agree=0).reset_index()).verdict is Verdict.REFUTED


def reading(n: int, fpr: float, gain: float, behind: float, most: int = 5) -> dict[str, object]:
    return {
        **{"schedule": "words", "max_seqs": most, "interval": "curve", "tasks_seen": n},
        **{"fpr": fpr, "tpr": 1.0, "over_none": gain, "over_none_ci95": 1.0},
        **{"over_fixed": behind, "over_fixed_ci95": 1.0, "rate_error": 0.1},
        **{"mean_return": 100.0, "sampling": "combinations"},
    }


def with_fixed(rows: list[dict[str, object]]) -> pd.DataFrame:
    """Readings beside fixed features, which earn 100: 2% of it is 2."""
    beside = [{**reading(n, 0.0, 0.0, 0.0), "interval": "fixed"} for n in (5, 6, 8)]
    return pd.DataFrame([*rows, *beside])


@pytest.mark.parametrize(
    ("fpr", "gain", "behind", "verdict"),
    [
        (0.45, 2.0, 0.0, Verdict.REPRODUCED),
        (0.60, 2.0, 0.0, Verdict.DIRECTION),
        (0.45, 0.5, 0.0, Verdict.INCONCLUSIVE),
        (0.45, -1.5, 0.0, Verdict.NOT_REPRODUCED),
        (0.60, 0.5, 0.0, Verdict.INCONCLUSIVE),  # a rate of .5 to .7, and .52 is near
        (0.65, 0.5, 0.0, Verdict.NOT_REPRODUCED),
        (0.45, 2.0, -1.5, Verdict.INCONCLUSIVE),  # .5 to 2.5 below
        (0.45, 2.0, -3.5, Verdict.NOT_REPRODUCED),
    ],
)
def test_a_joint_reading_must_meet_all_that_is_printed(
    fpr: float, gain: float, behind: float, verdict: Verdict
) -> None:
    table = with_fixed([reading(n, fpr, gain, behind) for n in (5, 8)])
    assert joint_search.some_reading_fits(table).verdict is verdict


def test_a_gain_found_among_many_readings_is_corrected_for_them() -> None:
    """Of 20 its interval is norm.isf(.00125) / norm.isf(.025) = 1.54 times as wide."""
    for readings, verdict in ((1, Verdict.REPRODUCED), (20, Verdict.INCONCLUSIVE)):
        rows = [reading(n, 0.45, 1.3, 0.5, most) for most in range(readings) for n in (5, 8)]
        assert joint_search.some_reading_fits(with_fixed(rows)).verdict is verdict


@pytest.mark.parametrize(
    ("last", "error", "verdict"),
    [
        # Of two readings intervals are 1.144 times as wide: .162 of the difference.
        (0.7, 0.1, Verdict.REPRODUCED),
        (0.5, 0.1, Verdict.INCONCLUSIVE),
        (0.3, 0.1, Verdict.INCONCLUSIVE),
        (0.1, 0.1, Verdict.REFUTED),
        (0.1, 0.2, Verdict.INCONCLUSIVE),
    ],
)
def test_the_rise_is_judged_by_intervals(last: float, error: float, verdict: Verdict) -> None:
    rise = [reading(n, fpr, 2, 0, most) for most in (0, 5) for n, fpr in ((5, 0.4), (8, 0.7))]
    rise[-1]["fpr"] = last
    table = with_fixed(rise).assign(rate_error=error)
    assert joint_search.false_positives_rise(table).verdict is verdict


def test_sequences_with_repeats_give_the_curve_of_definition_5() -> None:
    """Against every sequence of three of four tasks, listed; a sample comes near it."""
    domain = triangle()
    observed = Solutions.from_domain(domain, optimal_solutions(domain)).take([0, 3, 5, 11])
    exact = joint_search.WithRepeats(0.01).fit(observed).history_[0].checks
    drawn = joint_search.WithRepeats(0.01, max_seqs=4000).fit(observed).history_[0].checks
    for check, other in zip(exact, drawn, strict=True):
        labels = relevance.remove(observed, [check.feature])
        for k in (1, 2, 3):
            listed = relevance.brute_force_k_relevance(observed, labels, k)
            assert check.curve[k - 1] == pytest.approx(listed, abs=1e-9)
        np.testing.assert_allclose(other.curve, exact[check.feature].curve, rtol=0.1, atol=0.05)


def test_nothing_errs_less_than_the_best_subset_but_what_is_no_subset(
    smoke: Mapping[str, pd.DataFrame],
) -> None:
    table = smoke["ch4-prediction"]
    subsets = table[~table.method.isin(("shrinkage", "cross-fitted"))]
    assert (subsets.regret >= -1e-12).all()
    # A constant explains nothing of Q_d, and errs by its variance at least; the unit is the mean
    # variance of a task's own values.
    domain = triangle()
    solutions = Solutions.from_domain(domain, optimal_solutions(domain))
    own = [
        (p[p > 0] @ (q[p > 0] - p[p > 0] @ q[p > 0]) ** 2)
        for p, q in zip(solutions.p, solutions.q, strict=True)
    ]
    pooled = solutions.p.mean(axis=0)
    weighted = np.where(solutions.p > 0, solutions.p * solutions.q, 0.0).mean(axis=0) / pooled
    variance = pooled @ (weighted - pooled @ weighted) ** 2
    constant = table[(table.method == "none (constant)") & (table.domain == "triangle")]
    assert (constant.excess >= variance / np.mean(own) - 1e-9).all()
    # The truly relevant features of the triangle carry all of Q_d.
    own = table[(table.method == "fixed") & (table.domain == "triangle")]
    assert own.fpr.tolist() == [0.0]
    assert own.tpr.tolist() == [1.0]


def test_mean_and_variance_of_a_task_by_hand() -> None:
    """Values 1 and 5 with weights 3/4 and 1/4: mean 2, variance 3/4 + 9/4; one visits one pair."""
    q = np.array([[1.0, 5.0], [7.0, np.nan]])
    p = np.array([[0.75, 0.25], [1.0, 0.0]])
    mean, variance = prediction.spread(Solutions(q, p, np.array([[0], [1]]), ("f",)))
    assert mean.tolist() == [2.0, 7.0]
    assert variance.tolist() == [3.0, 0.0]


def test_cross_validation_is_of_the_function_that_is_used() -> None:
    """The mean where no task was in ch4-prediction, 0 in the figures of section 4.3."""
    assert prediction.METHODS["cross-validation"]().unseen == "mean"
    assert prediction.METHODS["cross-validation, coarser"]().unseen == "coarser"
    assert roc.SELECTORS["cross-validation"]().unseen == Protocol().unseen == predictors.UNSEEN == 0


def swapped(table: pd.DataFrame, first: str, second: str) -> pd.DataFrame:
    names = {first: second, second: first}
    return table.assign(method=table.method.replace(names))


def regrets() -> pd.DataFrame:
    """Four cells, in which shrinkage errs by 1, the next selector by 2, and so on; all ± .2."""
    methods = ["all features", "fs-tek", "jackknife", "cross-validation", "shrinkage"]
    rows = [
        {"domain": d, "tasks_seen": n, "method": m, "regret": 5.0 - i, "regret_ci95": 0.2,
         "excess": 5.0 - i, "mean_return": float(i)}
        for d in "ab" for n in (3, 4) for i, m in enumerate([*methods, "cross-fitted"])
    ]  # fmt: skip
    return pd.DataFrame(rows)


@pytest.mark.parametrize(
    ("in_one_cell", "verdict"),
    [
        # A difference is ± .4, and ± .60 beside 15 others (norm.isf(.025 / 16) / norm.isf(.025) =
        # 1.508); by the mean over cells ± .51 beside three.
        (1.0, Verdict.REPRODUCED),
        (2.5, Verdict.INCONCLUSIVE),
        (2.7, Verdict.NOT_REPRODUCED),
        (6.0, Verdict.NOT_REPRODUCED),  # by the mean 2 - (1 + 1 + 1 + 6) / 4 = -.25
        (8.0, Verdict.REFUTED),  # by the mean -.75
    ],
)
def test_shrinkage_may_be_beaten_in_a_cell_or_by_the_mean(
    in_one_cell: float, verdict: Verdict
) -> None:
    table = regrets()
    one = (table.method == "shrinkage") & (table.domain == "a") & (table.tasks_seen == 3)
    table.loc[one, "regret"] = in_one_cell
    assert prediction.shrinkage_errs_least(table).verdict is verdict


def test_a_least_largest_regret_is_nothing_where_another_errs_less_in_a_cell() -> None:
    table = regrets()
    table.loc[(table.domain == "b") & (table.method != "shrinkage"), "regret"] += 9.0
    table.loc[(table.domain == "a") & (table.method == "shrinkage"), "regret"] = 2.7
    finding = prediction.shrinkage_errs_least(table)
    assert finding.numbers["shrinkage"] < finding.numbers["cross-validation"]
    assert finding.verdict is Verdict.NOT_REPRODUCED


def test_prediction_claims_can_fail() -> None:
    table = regrets()
    worse = swapped(table, "shrinkage", "fs-tek")
    assert prediction.shrinkage_errs_least(worse).verdict is Verdict.REFUTED
    # As good as the others everywhere, or better by no more than the half-widths, is no proof.
    for same in (table.assign(regret=1.0), table.assign(regret_ci95=0.6)):
        assert prediction.shrinkage_errs_least(same).verdict is Verdict.DIRECTION
    assert prediction.error_predicts_return(table).verdict is Verdict.REPRODUCED
    wrong = table.assign(mean_return=-table.mean_return)
    assert prediction.error_predicts_return(wrong).verdict is Verdict.REFUTED
    # Half of the cells the other way: 0 on average, and the interval over cells reaches -.5 or not.
    cell = pd.factorize(table.domain + table.tasks_seen.astype(str))[0]
    mixed = table.assign(mean_return=table.mean_return * (1 - 2 * (cell % 2)))
    many = pd.concat([mixed.assign(domain=mixed.domain + str(i)) for i in range(10)])
    verdicts = [prediction.error_predicts_return(t).verdict for t in (mixed, many)]
    assert verdicts == [Verdict.INCONCLUSIVE, Verdict.NOT_REPRODUCED]


def test_effects_of_an_irrelevant_feature_have_mean_zero_and_repeat_as_often_as_they_must() -> None:
    rng = np.random.default_rng(2)
    for law, draw in scatter.LAWS.items():
        values = draw(rng, 200_000)
        assert abs(values.mean()) < 5 * values.std() / np.sqrt(len(values)), law
    config = scatter.Config(laws=("one in eight", "sign"), tasks_seen=(4,), runs=300)
    table = scatter.kept.run(config=config).table
    own = table[table.shared & (table.selector == "jackknife")].set_index("law")
    # All four the same cannot be told from relevance; at n = 4 no other draw passes t^2 = 10.1
    # but, of one in eight, none: three and one have F of at most 1.
    for law, chance in (("one in eight", (7 / 8) ** 4 + (1 / 8) ** 4), ("sign", 1 / 8)):
        assert own.low[law] - 0.02 <= chance <= own.high[law] + 0.02


def test_the_level_claim_can_fail() -> None:
    rows = [
        {"law": law, "shared": True, "tasks_seen": n, "selector": "jackknife", "kept": 0.04,
         "low": 0.02, "high": 0.06}
        for law in ("gaussian", "sign") for n in (6, 8, 12)
    ]  # fmt: skip
    table = pd.DataFrame(rows)
    assert scatter.level_is_held(table).verdict is Verdict.REPRODUCED
    assert scatter.level_is_held(table.assign(high=0.09)).verdict is Verdict.INCONCLUSIVE
    # Of six cells the interval is norm.isf(.05 / 12) / norm.isf(.025) = 1.346 times as wide.
    for kept, low, verdict in (
        (0.3, 0.2, Verdict.REFUTED),
        (0.08, 0.055, Verdict.INCONCLUSIVE),
    ):
        one = table.copy()
        one.loc[0, ["kept", "low", "high"]] = kept, low, 2 * kept - low
        assert scatter.level_is_held(one).verdict is verdict


def test_gains_over_all_features_are_counted_where_they_are_shown() -> None:
    """Four of a domain are looked at together: norm.isf(.025 / 4) / norm.isf(.025) = 1.274."""
    gains = {
        ("lake", "jackknife"): (1.3, 1.2),
        ("lake", "fixed"): (3.0, 0.0),
        ("taxi", "jackknife"): (-2.0, 1.2),
        ("taxi", "fixed"): (-1.3, -1.4),
    }
    rows = [
        {"domain": domain, "tasks_seen": n, "method": method, "over_all": own[i],
         "over_all_ci95": 1.0, "fpr": 0.5, "tpr": 1.0}
        for domain in ("taxi", "lake") for i, n in enumerate((4, 8))
        for method, own in (
            ("all features", (0.0, 0.0)),
            *((m, gains[domain, m]) for m in ("jackknife", "fixed")),
        )
    ]  # fmt: skip
    table = pd.DataFrame(rows)
    shown = prediction.against_all(table)
    assert shown.index.tolist() == ["taxi", "lake"]
    assert shown["jackknife F"].tolist() == ["0 / 1", "1 / 0"]
    assert shown["fixed features"].tolist() == ["0 / 2", "1 / 0"]
    assert prediction.no_gain(table) == (["taxi"], ["taxi"])
    once = table.assign(over_all=table.over_all.where(table.over_all != -1.3, -1.2))
    assert prediction.no_gain(once) == (["taxi"], [])
    rules = {"all features": "cross-validation", "fixed": "cross-validation, coarser"}
    by = prediction.by_rule(table.assign(method=table.method.replace(rules)), 8)
    assert by.domain.tolist() == ["taxi", "lake"]
    assert by["jackknife F: rates"].tolist() == ["0.50/1.00"] * 2
    assert by["cross-validation, coarser: gain"].tolist() == ["−1.4 ± 1.0", "0.0 ± 1.0"]


def test_a_potential_that_leans_to_a_task_earns_there_and_loses_elsewhere() -> None:
    gain = prediction.leaning(1, runs=20)
    assert gain["one"].mean > gain["one"].half_width
    assert gain["others"].mean < -gain["others"].half_width
    whole = (gain["one"].mean + 3 * gain["others"].mean) / 4
    assert gain["all"].mean == pytest.approx(whole)


def test_what_it_costs_a_feature_to_be_charged_where_no_task_was() -> None:
    """By hand, of the domain on which it tells."""
    rows = [
        {"domain": d, "tasks_seen": n, "method": m, "fpr": own[n] if d == "torus" else 0.1,
         "tpr": 1.0 - 0.5 * (m == "cross-validation" and d == "torus" and n == 4)}
        for d in ("stock G=1", "torus") for n in (4, 8)
        for m, own in (
            ("cross-validation", {4: 0.1, 8: 0.0}),
            ("cross-validation, coarser", {4: 0.3, 8: 0.2}),
            ("jackknife", {4: 0.9, 8: 0.9}),
        )
    ]  # fmt: skip
    found = roc.charged(pd.DataFrame(rows))
    assert found.index.tolist() == ["torus"]
    assert found.loc["torus"].tolist() == pytest.approx([0.2, 0.25])


def test_the_scatter_s_table_has_a_row_a_law_and_weights() -> None:
    shown = scatter.shown(scatter.kept.run("smoke").table)
    assert shown.columns.tolist() == ["p", "law", "n = 4"]
    assert shown.p.tolist() == ["shared", "shared", "own", "own"]
    # Of three selectors the last flips signs: no choice of four is in the upper 5%.
    assert all(cell.split("/")[2:] == [".00"] for cell in shown["n = 4"])


def test_regret_of_thresholds_by_hand() -> None:
    """One Gaussian direction; with ever more tasks the trace is known, and F is a squared normal.

    Nothing is relevant, and 2 the threshold: E g^2 [g^2 > 2] = 2 (a phi(a) + Q(a)) at a = sqrt 2.
    (1 - 1/F)+ errs E (g^2 - 2 + 1/g^2) [g^2 > 1] = 4 (phi(1) - Q(1)).
    """
    a = np.sqrt(2)
    expected = 2 * (a * norm.pdf(a) + norm.sf(a))
    many = 2000  # the law of the trace is then narrow, and still as wide as a step of u
    assert threshold_regret.risk("cross-validation", many, 1, 0.0) == pytest.approx(
        expected, abs=1e-3
    )
    assert threshold_regret.risk("shrinkage", many, 1, 0.0) == pytest.approx(
        4 * (norm.pdf(1) - norm.sf(1)), abs=1e-3
    )
    # Whatever stays errs by its own scatter; what goes, by the effect.
    for d in (1, 3):
        assert threshold_regret.risk("all features", 5, d, 2.0) == pytest.approx(1, abs=1e-6)
    # FS-TEK's threshold at four tasks is far above any F of an effect of 2.
    assert threshold_regret.risk("fs-tek schedule", 4, 1, 2.0) == pytest.approx(4, rel=0.01)


@pytest.mark.parametrize("rule", ["jackknife", "cross-validation", "shrinkage"])
def test_regret_of_thresholds_against_draws(rule: str) -> None:
    n, d, effect, draws = 5, 3, 1.3, 40_000
    Z = np.random.default_rng(3).normal(size=(draws, n, d))
    mu = np.array([effect * np.sqrt(d / n), 0, 0])
    mean = Z.mean(axis=1) + mu
    F = n * (mean**2).sum(axis=1) / Z.var(axis=1, ddof=1).sum(axis=1)
    limit = {"jackknife": t.isf(0.025, n - 1) ** 2, "cross-validation": 1 + n / (n - 1)}
    weight = np.maximum(1 - 1 / F, 0) if rule == "shrinkage" else 1.0 * (limit[rule] < F)
    error = ((weight[:, None] * mean - mu) ** 2).sum(axis=1) * n / d
    found = threshold_regret.risk(rule, n, d, effect)
    assert abs(error.mean() - found) < 4 * error.std() / np.sqrt(draws)


def test_the_largest_regret_is_over_the_effects() -> None:
    rows = [
        {"rule": rule, "tasks_seen": n, "directions": 1, "effect": e, "regret": n * e}
        for rule in ("shrinkage", "jackknife") for n in (4, 8) for e in (0.0, 2.0, 1.0)
    ]  # fmt: skip
    shown = threshold_regret.largest(pd.DataFrame(rows))
    assert shown.rule.tolist() == ["jackknife", "shrinkage"]
    assert shown["n = 8"].tolist() == [16.0, 16.0]
