"""Intervals and tests, against hand calculation and independent implementations."""

import numpy as np
import pytest
from scipy import stats as scipy_stats

from thesis_lib import stats


def test_mean_ci_by_hand():
    # 1, 2, 3: sd 1, sem 1/sqrt(3), t(.975, 2) = 4.302653
    result = stats.mean_ci([1.0, 2.0, 3.0])
    assert result.mean == 2.0
    assert result.half_width == pytest.approx(4.302653 / np.sqrt(3), abs=1e-6)
    assert result.n == 3


def test_mean_ci_covers_at_its_level():
    rng = np.random.default_rng(0)
    hits = 0
    for _ in range(2000):
        r = stats.mean_ci(rng.normal(size=8))
        hits += abs(r.mean) <= r.half_width
    low, high = scipy_stats.binom.interval(0.9999, 2000, 0.95)
    assert low <= hits <= high


@pytest.mark.parametrize("bad", [[1.0], [], [1.0, np.nan], [1.0, np.inf]])
def test_a_sample_needs_two_finite_values(bad):
    with pytest.raises(ValueError, match="at least 2 finite values"):
        stats.mean_ci(bad)


def test_welch_by_hand():
    # a = 1, 2, 3; b = 2, 4, 6: means 2, 4; variances 1, 4; se^2 = 1/3 + 4/3
    result = stats.welch([1.0, 2.0, 3.0], [2.0, 4.0, 6.0])
    se2 = 1 / 3 + 4 / 3
    t = -2 / np.sqrt(se2)
    dof = se2**2 / ((1 / 3) ** 2 / 2 + (4 / 3) ** 2 / 2)
    assert result.difference == -2
    assert result.p_value == pytest.approx(2 * scipy_stats.t.cdf(t, dof))
    assert result.high - result.low == pytest.approx(2 * scipy_stats.t.ppf(0.975, dof) * se2**0.5)


def test_welch_agrees_with_scipy_also_from_summaries():
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=9), rng.normal(0.5, 3, size=14)
    theirs = scipy_stats.ttest_ind(a, b, equal_var=False)
    interval = theirs.confidence_interval(0.9)
    for x, y in ((a, b), (stats.Summary.of(a), stats.Summary.of(b))):
        ours = stats.welch(x, y, level=0.9)
        assert ours.p_value == pytest.approx(theirs.pvalue, rel=1e-9)
        assert (ours.low, ours.high) == pytest.approx((interval.low, interval.high))


def test_equivalence_agrees_with_two_one_sided_scipy_tests():
    rng = np.random.default_rng(6)
    a, b = rng.normal(size=9), rng.normal(0.2, 2, size=14)
    one = scipy_stats.ttest_ind(a + 1.5, b, equal_var=False, alternative="greater").pvalue
    two = scipy_stats.ttest_ind(a - 1.5, b, equal_var=False, alternative="less").pvalue
    assert stats.equivalence(a, b, 1.5).p_value == pytest.approx(max(one, two), rel=1e-9)


def test_welch_of_constant_samples():
    assert stats.welch([1, 1], [1, 1]).p_value == 1.0
    assert stats.welch([1, 1], [2, 2]).p_value == 0.0


@pytest.mark.parametrize("bad", [(1.0, 0.5, 1), (1.0, np.nan, 5), (1.0, -0.5, 5)])
def test_welch_needs_a_deviation_of_two_values(bad):
    for pair in ((stats.Summary(*bad), [1.0, 2.0]), ([1.0, 2.0], stats.Summary(*bad))):
        with pytest.raises(ValueError, match=f"a sample of {bad[2]} values has standard deviation"):
            stats.welch(*pair)
        with pytest.raises(ValueError, match="at least 2 values and a deviation of at least 0"):
            stats.equivalence(*pair, 1.0)


def test_equivalence_agrees_with_its_interval():
    rng = np.random.default_rng(1)
    for _ in range(50):
        a, b = rng.normal(size=10), rng.normal(0.2, 1, size=12)
        result = stats.equivalence(a, b, margin=1.0)
        assert (result.p_value < 0.05) == (result.low > -1 and result.high < 1)


def test_equivalence_is_not_shown_by_few_runs():
    # Two small samples do not differ significantly, and are not shown to be equal either.
    a, b = [0.0, 1.0, 2.0], [0.1, 1.1, 2.3]
    assert stats.welch(a, b).p_value > 0.5
    assert stats.equivalence(a, b, margin=0.5).p_value > 0.05


def test_equivalence_needs_a_margin():
    with pytest.raises(ValueError, match="margin is 0"):
        stats.equivalence([1, 2], [1, 2], margin=0)


def test_power_of_intervals_beside_a_margin_by_hand():
    """Half of the samples lie to one side; within twice a half-width lie 95% at 95%."""
    assert stats.least_power(1.0, 1.0) == pytest.approx(0.0)
    assert stats.least_power(1.0, 1.0, sides=1) == pytest.approx(0.5)
    assert stats.least_power(2.0, 1.0) == pytest.approx(0.95)
    assert stats.least_power(2.0, 1.0, 0.9, sides=1) == pytest.approx(0.95)
    assert stats.least_power([2.0, 0.5, 9.0], [1.0, 1.0, 0.0]) == 0.0  # the least of them
    assert stats.least_power([1.0, 0.0], 0.0) == 1.0  # nothing varies


def test_holm_by_hand():
    # sorted .01 .02 .03 .04 times 4 3 2 1 = .04 .06 .06 .04, made monotone: .04 .06 .06 .06
    adjusted = stats.holm([0.04, 0.01, 0.03, 0.02])
    assert adjusted == pytest.approx([0.06, 0.04, 0.06, 0.06])


def test_holm_refuses_what_is_no_probability():
    with pytest.raises(ValueError, match=r"in \[0, 1\]"):
        stats.holm([0.1, 1.2])


def test_bootstrap_interval_of_the_mean_is_near_the_normal_one():
    x = np.random.default_rng(2).normal(size=400)
    low, high = stats.bootstrap_ci(x, rng=np.random.default_rng(3), n_resamples=4000)
    half = 1.96 * x.std() / 20
    assert low == pytest.approx(x.mean() - half, abs=0.015)
    assert high == pytest.approx(x.mean() + half, abs=0.015)


def test_iqm_by_hand():
    assert stats.iqm([0, 1, 2, 3, 4, 5, 6, 100]) == pytest.approx((2 + 3 + 4 + 5) / 4)


def test_chi_square_by_hand():
    assert stats.chi_square([1, 2], [0, 4], [1, 2]) == pytest.approx(1 + 1)


def test_kruskal_sees_a_shift():
    assert stats.kruskal([1, 2, 3, 4, 5], [11, 12, 13, 14, 15]) < 0.01


class TestScoreMatrices:
    """rliable's definitions: matrices of runs by tasks."""

    def test_interval_of_one_task_agrees_with_scipys_bootstrap(self):
        x = np.random.default_rng(1).normal(size=(40, 1))
        ours = stats.stratified_bootstrap_ci(
            x, statistic=stats.iqm, rng=np.random.default_rng(2), n_resamples=4000
        )
        theirs = scipy_stats.bootstrap(
            (x[:, 0],),
            lambda v, axis: scipy_stats.trim_mean(v, 0.25, axis=axis),
            method="percentile",
            n_resamples=4000,
            rng=np.random.default_rng(3),
        ).confidence_interval
        assert ours == pytest.approx((theirs.low, theirs.high), abs=0.02)

    def test_runs_are_resampled_within_their_task(self):
        # Tasks differ, runs of a task do not: no resample can change anything.
        x = np.tile([1.0, 2.0, 30.0], (5, 1))
        interval = stats.stratified_bootstrap_ci(
            x, statistic=np.mean, rng=np.random.default_rng(0), n_resamples=50
        )
        assert interval == (11.0, 11.0)

    def test_an_unfinished_matrix_is_refused(self):
        with pytest.raises(ValueError, match="finite"):
            stats.stratified_bootstrap_ci(
                [[1.0, np.nan]], statistic=np.mean, rng=np.random.default_rng(0)
            )


class TestLeading:
    """Kruskal-Wallis, then Welch against the best, as table 5.2 marks its entries."""

    def test_a_clear_order(self):
        samples = {"low": [1, 2, 3, 4, 5], "high": [21, 22, 23, 24, 25], "near": [20, 22, 23, 25]}
        assert stats.leading(samples) == ["high", "near"]

    def test_where_kruskal_finds_nothing_all_lead(self):
        # Two ranks below three: the chance is 2 of 10, which no Kruskal-Wallis test takes for a
        # difference, though Welch's by itself would.
        samples = {"a": [1.0, 1.1], "b": [5.0, 5.1, 5.2]}
        assert stats.welch(*samples.values()).p_value < 0.01
        assert stats.leading(samples) == ["b", "a"]

    def test_printed_means_are_compared_by_welch(self):
        # Table 5.2, Hopper: 792.1 (73.4) and 601.6 (55.4) over 5 runs do not separate, 273.4 does.
        cells = {"DFFWD": (792.1, 73.4), "FFWD": (601.6, 55.4), "DTRNN": (273.4, 60.8)}
        samples = {n: stats.Summary(m, se * 5**0.5, 5) for n, (m, se) in cells.items()}
        assert stats.leading(samples) == ["DFFWD", "FFWD"]


def test_friedman_by_hand():
    # Ranks 1, 2, 3 in each of 4 tasks: chi2 = 12 / (4 * 3 * 4) * (16 + 64 + 144) - 3 * 4 * 4 = 8.
    scores = [[1, 2, 3], [10, 20, 30], [0, 5, 6], [7, 8, 9]]
    assert stats.friedman(scores) == pytest.approx(scipy_stats.chi2.sf(8, 2))


def test_parametric_bootstrap_has_the_means_and_errors_given():
    draws = stats.parametric_bootstrap(
        [[1.0, np.nan]], [[2.0, np.nan]], rng=np.random.default_rng(0), n_resamples=20_000
    )
    assert draws.shape == (20_000, 1, 2)
    assert draws[:, 0, 0].mean() == pytest.approx(1, abs=0.06)
    assert draws[:, 0, 0].std() == pytest.approx(2, rel=0.02)
    assert np.isnan(draws[:, 0, 1]).all()


def test_parametric_bootstrap_refuses_negative_errors():
    with pytest.raises(ValueError, match="at least 0"):
        stats.parametric_bootstrap([1.0], [-1.0], rng=np.random.default_rng(0))


def test_two_sided_counts_the_lesser_tail():
    # 1 of 9 below 0: 2 (1 + 1) / (9 + 1); nothing above 0 is the mirror image.
    draws = np.array([-1.0] + [1.0] * 8)
    assert stats.two_sided(draws) == pytest.approx(0.4)
    assert stats.two_sided(-draws) == pytest.approx(0.4)
    assert stats.two_sided(np.zeros(9)) == 1
    assert np.isnan(stats.two_sided(np.full(9, np.nan)))


def test_combined_of_normal_deviates_is_their_chi_square():
    z = np.array([0.5, -1.5, 2.0])
    total, p = stats.combined(2 * scipy_stats.norm.sf(abs(z)))
    assert total == pytest.approx((z**2).sum())
    assert p == pytest.approx(scipy_stats.chi2.sf((z**2).sum(), 3))


def test_combined_keeps_its_level_where_few_runs_are_compared():
    rng = np.random.default_rng(4)
    rejected = 0
    for _ in range(400):
        p = [stats.welch(rng.normal(size=5), rng.normal(size=5)).p_value for _ in range(7)]
        rejected += stats.combined(p)[1] < 0.05
    assert rejected <= scipy_stats.binom.ppf(0.999, 400, 0.05)


def test_combined_refuses_a_p_value_of_zero():
    with pytest.raises(ValueError, match=r"\(0, 1\]"):
        stats.combined([0.0])
