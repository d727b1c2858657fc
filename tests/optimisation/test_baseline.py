import numpy as np
import pytest
from sklearn.linear_model import Ridge

from thesis_lib.optimisation import LinearBaseline, baseline_features


def test_features_by_hand() -> None:
    features = baseline_features(np.array([[2.0, -30.0]]), np.array([50]))
    assert features.tolist() == [[2, -10, 4, 100, 0.5, 0.25, 0.125, 1]]


def test_against_ridge_regression() -> None:
    rng = np.random.default_rng(0)
    observations, time = rng.normal(size=(400, 3)), rng.integers(0, 200, 400)
    returns = rng.normal(size=400) + observations[:, 0]
    baseline = LinearBaseline(ridge=0.3)
    assert (baseline.predict(observations, time) == 0).all()
    baseline.fit(observations, time, returns)
    x = baseline_features(observations, time)
    theirs = Ridge(alpha=0.3, fit_intercept=False).fit(x, returns)
    np.testing.assert_allclose(baseline.weights, theirs.coef_, rtol=1e-8)
    np.testing.assert_allclose(baseline.predict(observations, time), theirs.predict(x), rtol=1e-8)


def test_it_finds_a_value_in_its_span() -> None:
    rng = np.random.default_rng(1)
    observations, time = rng.normal(size=(500, 2)), rng.integers(0, 100, 500)
    values = 3 * observations[:, 0] ** 2 - observations[:, 1] + (time / 100) ** 3 + 7
    baseline = LinearBaseline()
    baseline.fit(observations, time, values)
    np.testing.assert_allclose(baseline.predict(observations, time), values, atol=1e-5)


def test_a_feature_that_is_always_zero_does_no_harm() -> None:
    rng = np.random.default_rng(2)
    observations = np.stack([rng.normal(size=50), np.zeros(50)], axis=1)
    baseline = LinearBaseline()
    baseline.fit(observations, np.arange(50), observations[:, 0])
    assert np.isfinite(baseline.weights).all()


def test_bad_input() -> None:
    with pytest.raises(ValueError, match="ridge is 0"):
        LinearBaseline(ridge=0)
    with pytest.raises((FloatingPointError, np.linalg.LinAlgError)):
        LinearBaseline().fit(np.zeros((3, 1)), np.arange(3), np.array([1, np.nan, 2]))
