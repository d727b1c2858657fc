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
