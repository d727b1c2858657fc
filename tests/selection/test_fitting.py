"""The exponential fit, and FS-TEK as a threshold on an F-ratio."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar
from scipy.stats import t as student

from tests.relevance.worlds import covariance, distribution, labels, world
from thesis_lib.relevance import cross_task_q, estimate, k_relevance, law, relevance
from thesis_lib.selection import (
    FSTEK,
    fit_exponential,
    fit_inverse,
    fstek_threshold,
    triangle_alpha,
)
from thesis_lib.selection.fitting import check_alpha


@settings(deadline=None, max_examples=100)
@given(
    limit=st.floats(-5, 5),
    scale=st.floats(0.1, 10),
    decay=st.floats(0.2, 2),
    n=st.integers(4, 20),
)
def test_an_exact_exponential_is_recovered(
    limit: float, scale: float, decay: float, n: int
) -> None:
    k = np.arange(1, n + 1)
    fit = fit_exponential(limit + scale * np.exp(-decay * k))
    assert fit is not None
    np.testing.assert_allclose(fit.theta, [limit, scale, decay], rtol=1e-5, atol=1e-6)
    assert fit.standard_error < 1e-6
    assert not fit.increasing


@pytest.mark.parametrize("n", [3, 4, 5, 8, 12, 20, 40])
def test_the_fit_is_the_least_squares_solution(n: int) -> None:
    # For a given decay the best theta_1, theta_2 are linear, so the minimum is over one number.
    k = np.arange(1.0, n + 1)

    def squares(log_decay: float) -> float:
        basis = np.stack([np.ones(n), np.exp(-np.exp(log_decay) * k)], axis=1)
        return float(np.linalg.lstsq(basis, 1 / k, rcond=None)[1].sum())

    grid = np.linspace(-4, 2, 121)
    centre = grid[int(np.argmin([squares(g) for g in grid]))]
    best = minimize_scalar(squares, bounds=(centre - 0.1, centre + 0.1), method="bounded")
    fit = fit_inverse(n)
    assert np.log(fit.decay) == pytest.approx(best.x, abs=1e-3)
    residual = fit.theta[0] + fit.theta[1] * np.exp(-fit.decay * k) - 1 / k
    assert residual @ residual <= best.fun + 1e-12


def test_three_points_by_hand() -> None:
    # 1, 1/2, 1/3: differences 1/2, 1/6, so the decay is ln 3 and the limit
    # 1/3 - (1/6)(1/3)/(1 - 1/3) = 1/4; three points leave no degree of freedom.
    fit = fit_inverse(3)
    np.testing.assert_allclose([fit.asymptote, fit.decay], [0.25, np.log(3)], rtol=1e-6)
    assert np.isnan(fit.standard_error)


@pytest.mark.parametrize("n", [5, 9])
def test_standard_error_is_that_of_the_linearised_model(n: int) -> None:
    fit = fit_inverse(n)
    k = np.arange(1.0, n + 1)
    decay = np.exp(-fit.decay * k)
    J = np.stack([np.ones(n), decay, -fit.theta[1] * k * decay], axis=1)
    residual = fit.theta[0] + fit.theta[1] * decay - 1 / k
    covariance_of_theta = residual @ residual / (n - 3) * np.linalg.inv(J.T @ J)
    assert fit.standard_error == pytest.approx(np.sqrt(covariance_of_theta[0, 0]), rel=1e-6)
    # The condition number is that for data of span 1, and 1/k has the span 1 - 1/n.
    J[:, 2] /= 1 - 1 / n
    assert fit.condition == pytest.approx(np.linalg.cond(J), rel=1e-6)


@settings(deadline=None, max_examples=100)
@given(shift=st.floats(-100, 100), scale=st.floats(1e-4, 1e4), n=st.integers(4, 20))
def test_the_fit_is_affine_equivariant(shift: float, scale: float, n: int) -> None:
    fit = fit_exponential(shift + scale / np.arange(1, n + 1))
    expected = fit_inverse(n).scaled(shift, scale)
    assert fit is not None
    np.testing.assert_allclose(fit.theta, expected.theta, rtol=1e-4, atol=1e-5 * scale)
    assert fit.standard_error == pytest.approx(expected.standard_error, rel=1e-4)


@pytest.mark.parametrize(
    ("values", "increasing"), [([1, 2, 2.5, 2.7], True), ([3, 2, 1.6, 1.5], False)]
)
def test_direction_of_the_curve(values: list[float], increasing: bool) -> None:
    fit = fit_exponential(values)
    assert fit is not None
    assert fit.increasing == increasing


def test_a_straight_line_has_no_fit() -> None:
    # The best exponential has a decay towards 0 and a limit towards minus infinity.
    assert fit_exponential([5, 4, 3, 2, 1]) is None


@pytest.mark.parametrize(
    ("values", "message"),
    [([1, 2], "at least 3"), ([1, 1, 1], "all values are 1"), ([1, np.nan, 2], "finite")],
)
def test_bad_curves_are_refused(values: list[float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        fit_exponential(values)


# FS-TEK is a threshold on an F-ratio.


@pytest.mark.parametrize("chunk", range(10))
def test_fstek_is_a_threshold_on_an_f_ratio(chunk: int) -> None:
    """5000 decisions: FS-TEK's own fit to D(k) against F = n V_n / tr S."""
    rng = np.random.default_rng(chunk)
    removed = 0
    for seed in range(chunk * 500, chunk * 500 + 500):
        n = int(rng.integers(4, 21))
        alpha = float(rng.choice([1e-4, 1e-3, 0.01, 0.06, 0.15, 0.3]))
        solutions = world(seed, "shared", n, scale=float(rng.choice([0.1, 3.0])))
        # A common part, so that relevant features occur too.
        y = labels(seed, 6)
        q = solutions.q + rng.choice([0.0, 0.3, 1.0, 3.0]) * rng.normal(size=6)
        solutions = type(solutions)(q, solutions.p, solutions.features, solutions.feature_names)
        curve = k_relevance(solutions, y, np.arange(1, n + 1), replacement=False)
        fit = fit_exponential(curve)
        assert fit is not None
        assert not fit.increasing
        low = fit.asymptote - student.ppf(1 - alpha / 2, n - 3) * fit.standard_error
        F, threshold = estimate(solutions, y).f_ratio, fstek_threshold(n, alpha)
        if abs(F - threshold) > 1e-4 * (1 + abs(threshold)):
            assert (low <= 0) == (threshold >= F)
        removed += low <= 0
    assert 20 < removed < 480


def test_f_ratio_is_between_over_within_variance() -> None:
    solutions = world(3, "shared", 7)
    y = labels(3, 6)
    # Z_i = Q_i less its mean on each cell; norms are weighted by p.
    p = solutions.p[0]
    cell_mean = np.stack([(solutions.q * p)[:, y == c].sum(1) / p[y == c].sum() for c in range(3)])
    Z = solutions.q - cell_mean.T[:, y]
    mean = Z.mean(axis=0)
    trace = ((Z - mean) ** 2 @ p).sum() / 6
    assert estimate(solutions, y).f_ratio == pytest.approx(7 * (mean**2 @ p) / trace, rel=1e-10)


def test_threshold_in_the_words_of_fstek() -> None:
    # A feature whose F-ratio is just below the threshold goes, one just above stays.
    for n, alpha in ((5, 1e-4), (8, 0.06), (12, 1e-4)):
        threshold = fstek_threshold(n, alpha)
        fit = fit_inverse(n)
        for F, goes in ((threshold - 1e-6, True), (threshold + 1e-6, False)):
            # F = 1 + n U / (b - U), with b - U = 1.
            scaled = fit.scaled((F - 1) / n, 1.0)
            half_width = student.isf(alpha / 2, n - 3) * scaled.standard_error
            assert (scaled.asymptote - half_width <= 0) == goes


def test_threshold_falls_with_the_number_of_tasks_and_ends_below_zero() -> None:
    thresholds = [fstek_threshold(n, 1e-4) for n in range(4, 61)]
    assert np.all(np.diff(thresholds) < 0)
    assert thresholds[0] > 100
    # From here on FS-TEK keeps every feature whose relevance falls at all.
    never = 4 + int(np.argmax(np.array(thresholds) < 0))
    assert 20 < never < 60


def test_beyond_that_number_of_tasks_fstek_removes_nothing() -> None:
    solutions = world(0, "shared", 60)
    assert FSTEK(alpha=1e-4).fit(solutions).support_.all()
    # Even though a tenth of the tasks makes it remove everything.
    assert not FSTEK(alpha=1e-4).fit(solutions.take(np.arange(5))).support_.any()


@pytest.mark.parametrize(("n", "alpha"), [(5, 0.0), (5, 1.0), (5, np.nan), (3, 0.1)])
def test_threshold_arguments(n: int, alpha: float) -> None:
    with pytest.raises(ValueError, match=r"number in \(0, 1\)|at least 4"):
        fstek_threshold(n, alpha)


def test_level_of_the_triangle() -> None:
    # "It is 1e-4 up to k = 5, from which point it linearly increases ... until .3."
    assert [triangle_alpha(k) for k in (1, 5)] == [1e-4, 1e-4]
    assert triangle_alpha(6) == pytest.approx(0.0601)
    assert triangle_alpha(10) == 0.3
    # The formula as printed.
    assert triangle_alpha(5, first=4) == pytest.approx(0.0601)
    assert triangle_alpha(9, first=4) == 0.3


def test_levels_and_schedules() -> None:
    assert check_alpha(0.1, 7) == 0.1
    assert check_alpha(lambda n: n / 100, 7) == 0.07
    with pytest.raises(ValueError, match="7 at 7 tasks"):
        check_alpha(lambda n: n, 7)


def test_law_of_the_curve() -> None:
    solutions = world(9, "shared", 6)
    y, D = labels(9, 6), distribution(9, 6)
    U, b = law(covariance(solutions, y))
    curve = k_relevance(solutions, y, np.arange(1, 7), replacement=False)
    np.testing.assert_allclose(curve, U + (b - U) / np.arange(1, 7), atol=1e-12)
    assert curve[-1] == pytest.approx(relevance(y, *cross_task_q(solutions)), abs=1e-12)
    assert D.sum() == pytest.approx(1)
