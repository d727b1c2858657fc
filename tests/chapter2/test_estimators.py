"""Policy-gradient estimators against finite differences and hand calculation."""

import numpy as np
import pytest

from thesis_lib.chapter2 import estimators, kl_quadratic
from thesis_lib.chapter2 import every_trajectory as e

TD = ["td_difference", "td_mean_difference"]


def value(theta: np.ndarray, steps: int, discount: float) -> float:
    """Exact return of an episode, by backward recursion (no trajectories involved)."""
    return float(e.START @ e.state_values(steps, discount, theta)[0])


def finite_difference(steps: int, discount: float, h: float = 1e-5) -> np.ndarray:
    gradient = np.zeros(e.THETA.size)
    for i in range(e.THETA.size):
        shift = np.zeros(e.THETA.size)
        shift[i] = h
        up, down = (e.THETA + sign * shift.reshape(e.THETA.shape) for sign in (1, -1))
        gradient[i] = (value(up, steps, discount) - value(down, steps, discount)) / (2 * h)
    return gradient


@pytest.fixture(scope="module")
def table():
    return estimators.biases.run("book").table.set_index("estimator")


def test_one_step_value_by_hand() -> None:
    policy = e.softmax_policy(e.THETA)
    first = 1 / (1 + np.exp(-0.7))  # pi(0|0), logits 0.5 and -0.2
    second = 1 / (1 + np.exp(-0.2))  # pi(1|1), logits 0.1 and 0.3
    np.testing.assert_allclose([policy[0, 0], policy[1, 1]], [first, second])
    assert value(e.THETA, 1, 0.9) == pytest.approx(0.6 * first + 0.4 * second * 2)


def test_scores_are_gradients_of_the_log_policy() -> None:
    h = 1e-6
    for s in range(2):
        for a in range(2):
            for i in range(4):
                shift = np.zeros(4)
                shift[i] = h
                up, down = (
                    np.log(e.softmax_policy(e.THETA + sign * shift.reshape(2, 2))[s, a])
                    for sign in (1, -1)
                )
                assert e.scores(e.THETA)[s, a, i] == pytest.approx((up - down) / (2 * h), abs=1e-8)


def test_trajectories_are_all_of_them() -> None:
    every = e.trajectories(3)
    assert len({(*s, *a) for s, a in zip(every.states, every.actions, strict=True)}) == 4**3
    assert every.probability.sum() == pytest.approx(1.0)
    policy = e.softmax_policy(e.THETA)
    i = np.flatnonzero((every.states == [0, 1, 1]).all(1) & (every.actions == [1, 0, 1]).all(1))
    by_hand = 0.6 * policy[0, 1] * 0.9 * policy[1, 0] * 0.7 * policy[1, 1]
    np.testing.assert_allclose(every.probability[i], [by_hand])


def test_expected_estimates_are_the_true_gradients(table) -> None:
    config = estimators.biases.config("book")
    plain = finite_difference(config.steps, 1.0)
    discounted = finite_difference(config.steps, config.discount)
    for name in ("whole return", "return to go", "return to go, baseline"):
        assert table.gradient_norm[name] == pytest.approx(np.linalg.norm(plain), rel=1e-7)
        assert table.bias[name] < 1e-12
    for name in ("discounted whole return", "discounted return to go, weighted"):
        assert table.gradient_norm[name] == pytest.approx(np.linalg.norm(discounted), rel=1e-7)
        assert table.bias_discounted[name] < 1e-12
        assert table.bias[name] == pytest.approx(np.linalg.norm(plain - discounted), rel=1e-6)
    # Equation 2.12 is the gradient of neither return.
    for name in ("discounted return to go", "discounted return to go, baseline"):
        assert table.bias[name] > 0.01
        assert table.bias_discounted[name] > 0.01


def test_every_technique_lowers_the_variance(table) -> None:
    v = table.variance
    assert v["whole return"] > v["return to go"] > v["return to go, baseline"]
    assert v["whole return"] > v["discounted whole return"] > v["discounted return to go, weighted"]
    assert v["discounted return to go"] > v["discounted return to go, baseline"]


def test_no_baseline_leaves_less_variance_than_the_best_one(table) -> None:
    best = table.loc["return to go, best baseline"]
    assert best.bias < 1e-10
    assert best.variance < table.variance["return to go, baseline"]
    # Any other baseline of state and time is worse: try some at random.
    every = e.trajectories(6)
    score = e.scores(e.THETA)[every.states, every.actions]
    reward = e.REWARD[every.states, every.actions]
    to_go = reward[:, ::-1].cumsum(axis=1)[:, ::-1]
    rng = np.random.default_rng(0)
    for _ in range(5):
        baseline = e.state_values(6, 1.0) + rng.normal(scale=0.5, size=(6, 2))
        advantage = to_go - baseline[np.arange(6), every.states]
        sample = (score * advantage[:, :, None]).sum(axis=1)
        mean = every.probability @ sample
        variance = every.probability @ ((sample - mean) ** 2).sum(axis=1)
        assert best.variance < variance


def test_value_gradient_against_the_score_function(table) -> None:
    np.testing.assert_allclose(
        np.linalg.norm(e.value_gradient(6)), table.gradient_norm["whole return"], rtol=1e-9
    )
    assert table.slope_difference["whole return"] < 1e-9


def test_td_error_is_the_advantage_on_average_only(table) -> None:
    td = table.loc["TD error"]
    assert td.td_mean_difference < 1e-12 < td.td_difference
    assert td.bias == pytest.approx(table.bias["discounted return to go, baseline"], rel=1e-9)
    assert table.drop(index="TD error")[TD].isna().all(axis=None)


def test_td_error_of_one_step_episodes_is_the_advantage() -> None:
    one = estimators.biases.run(config=estimators.Config(steps=1)).table.set_index("estimator")
    assert one.td_difference["TD error"] < 1e-15


def test_kullback_leibler_by_hand() -> None:
    got = kl_quadratic.kullback_leibler(np.array([[0.5, 0.5]]), np.array([[0.25, 0.75]]))
    np.testing.assert_allclose(got, [0.5 * np.log(2) + 0.5 * np.log(2 / 3)])


def test_state_distribution_agrees_with_the_list_of_trajectories() -> None:
    every = e.trajectories(4)
    visits = [(every.probability * (every.states == s).mean(axis=1)).sum() for s in (0, 1)]
    np.testing.assert_allclose(kl_quadratic.state_distribution(4), visits, rtol=1e-12)


def test_divergence_is_half_the_printed_quadratic_form() -> None:
    table = kl_quadratic.divergences.run("book").table
    smallest = table.loc[table.scale.idxmin()]
    for order in ("kl_new_old", "kl_old_new"):
        assert smallest[order] / smallest.half_quadratic == pytest.approx(1.0, abs=1e-3)
        assert smallest[order] / smallest.printed_quadratic == pytest.approx(0.5, abs=1e-3)
    np.testing.assert_allclose(
        table.trajectory_quadratic, table.steps * table.printed_quadratic, rtol=1e-9
    )


@pytest.mark.parametrize("experiment", [estimators.biases, kl_quadratic.divergences])
def test_smoke(experiment) -> None:
    table = experiment.run("smoke").table
    assert np.isfinite(table.drop(columns=TD, errors="ignore").select_dtypes("number")).all(
        axis=None
    )
