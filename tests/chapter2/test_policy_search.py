"""Policy-gradient algorithms with two parameters, judged exactly."""

import numpy as np
import pandas as pd
import pytest
import torch
from scipy import stats

from thesis_lib.chapter2 import learning_curves, one_step, settings
from thesis_lib.chapter2.settings import good_range
from thesis_lib.chapter2.two_parameters import (
    HORIZON,
    NAMES,
    best_return,
    expected_divergence,
    expected_return,
    fisher,
    linear_policy,
    parameters,
)

torch.set_num_threads(1)


def simulate(gain: float, log_std: float, n: int = 200_000) -> tuple[np.ndarray, np.ndarray]:
    """States ``(T, n)`` and returns of the linear policy, written out anew."""
    rng = np.random.default_rng(0)
    s, states, total = rng.normal(size=n), [], np.zeros(n)
    for _ in range(HORIZON):
        states.append(s)
        a = gain * s + np.exp(log_std) * rng.normal(size=n)
        total -= s**2 + 0.1 * a**2
        s = 0.9 * s + 0.5 * a + 0.1 * rng.normal(size=n)
    return np.array(states), total


def test_exact_values_against_simulation() -> None:
    old, new = (-0.5, -0.7), (-0.9, -0.4)
    states, total = simulate(*old)
    assert expected_return(*old) == pytest.approx(
        total.mean(), abs=4 * total.std() / np.sqrt(len(total))
    )
    # D(N(m, s) || N(m', s')) in closed form, at every state visited
    p, q = np.exp(old[1]), np.exp(new[1])
    gap = (old[0] - new[0]) * states
    kl = (np.log(q / p) + (p**2 + gap**2) / (2 * q**2) - 0.5).mean()
    assert expected_divergence(old, new) == pytest.approx(kl, rel=0.01)
    assert expected_divergence(old, old) == 0


def test_divergence_of_one_state_by_quadrature() -> None:
    # two policies with equal gains differ by their deviations alone, whatever the state
    p, q = stats.norm(0, np.exp(-0.7)), stats.norm(0, np.exp(-0.4))
    kl = p.expect(lambda x: p.logpdf(x) - q.logpdf(x))
    assert expected_divergence((-0.5, -0.7), (-0.5, -0.4)) == pytest.approx(kl, rel=1e-7)


def test_fisher_matrix_against_sampled_scores() -> None:
    old = (-0.5, -0.7)
    states, _ = simulate(*old)
    z = np.random.default_rng(1).normal(size=states.shape)
    # d log N(ks + sigma z; ks, sigma^2) in k and in log sigma, at every state visited
    score = np.stack([(z * states / np.exp(old[1])).ravel(), (z**2 - 1).ravel()])
    np.testing.assert_allclose(fisher(*old), score @ score.T / score.shape[1], rtol=0.01, atol=0.01)


def test_fisher_matrix_is_the_curvature_of_the_divergence() -> None:
    old, h = np.array([-0.5, -0.7]), 1e-4
    for i, along in enumerate(np.eye(2)):
        kl = expected_divergence(tuple(old), tuple(old + h * along))
        assert kl == pytest.approx(0.5 * h**2 * fisher(*old)[i, i], rel=1e-3)


def test_a_policy_has_two_parameters() -> None:
    policy = linear_policy(-0.3, -1.0)
    assert policy.n_trainable == 2
    assert parameters(policy) == (-0.3, -1.0)


@pytest.fixture(scope="module")
def curves() -> pd.DataFrame:
    config = learning_curves.Config(iterations=10, runs=3)
    return learning_curves.curves.run(config=config).table


def test_trpo_keeps_its_bound_and_the_others_do_not(curves: pd.DataFrame) -> None:
    kl = curves.groupby("algorithm").kl_sampled.max()
    assert kl.trpo <= 0.05
    # without a line search the quadratic approximation misses the bound
    assert kl.natural_delta > 0.05
    assert set(curves.algorithm) == set(NAMES)


def test_all_of_them_learn_from_the_same_start(curves: pd.DataFrame) -> None:
    first = curves[curves.iteration == 0]
    assert (first.expected_return == expected_return(0.0, 0.0)).all()
    last = curves[curves.iteration == 10].groupby("algorithm").expected_return.mean()
    assert (last > 0.3 * expected_return(0.0, 0.0)).all()
    assert (last < curves.best_return.max()).all()


def test_steps_too_long_are_given_up_and_steps_too_short_get_nowhere() -> None:
    config = settings.Config(
        vpg=(1e-6, 30.0), natural=(0.5,), trpo=(0.05,), iterations=8, runs=2, batch_steps=400
    )
    table = settings.outcomes.run(config=config).table
    short, long = (table[table.setting == s] for s in (1e-6, 30.0))
    assert (short.last_share.abs() < 0.01).all()
    assert short.arrived.isna().all()
    assert long.lost.all()
    trpo = table[table.algorithm == "trpo"]
    assert (trpo.lowest_share >= 0).all()
    # the first share is 0 by definition, and no policy can pass the best one
    assert (table.lowest_share <= 0).all()
    assert (table.last_share < 1).all()


def test_the_shares_are_those_of_the_learning_curves(curves: pd.DataFrame) -> None:
    config = settings.Config(vpg=(0.02,), natural=(0.5,), trpo=(0.05,), iterations=10, runs=3)
    table = settings.outcomes.run(config=config).table
    first = expected_return(0.0, 0.0)
    for row in table.itertuples():
        own = curves[(curves.algorithm == row.algorithm) & (curves.run == row.run)]
        share = (own.expected_return - first) / (best_return() - first)
        assert row.mean_share == pytest.approx(share.mean(), rel=1e-9)
        assert row.last_share == pytest.approx(share.iloc[-1], rel=1e-9)


def test_steps_from_one_batch() -> None:
    table = one_step.steps.run("smoke").table
    assert len(table) == 3 * 2 * len(NAMES)
    for row in table.itertuples():
        old, new = (row.gain, row.log_std), (row.new_gain, row.new_log_std)
        assert row.kl_exact == pytest.approx(expected_divergence(old, new), rel=1e-9)
        gained = expected_return(*new) - expected_return(*old)
        assert row.gain_in_return == pytest.approx(gained, rel=1e-9)
    trpo = table[table.algorithm == "trpo"]
    assert (trpo.kl_sampled <= trpo.delta_kl).all()


def test_the_landscape_holds_the_starts() -> None:
    config = one_step.LandscapeConfig(
        starts=((0.0, 0.0),), windows=(((-0.2, 0.0), (-1.5, 0.0)),), resolution=4
    )
    table = one_step.landscape.run(config=config).table
    assert len(table) == 4 * 4
    at_start = table[(table.gain == 0) & (table.log_std == 0) & (table.start == 0)]
    assert at_start.kl.tolist() == [0.0]
    assert (table.kl >= 0).all()


def test_the_maps_hold_the_bound_around_their_start() -> None:
    config = one_step.LandscapeConfig()
    for start, ((left, right), (low, high)) in zip(config.starts, config.windows, strict=True):
        edges = [(left, start[1]), (right, start[1]), (start[0], low), (start[0], high)]
        assert all(expected_divergence(start, edge) > 0.05 for edge in edges)


def test_good_settings_are_compared_by_the_length_of_a_step() -> None:
    """A bound of 4 nats is a step twice as long as one of 1 nat; a rate of 4 is one four times."""
    rows = [
        (name, setting, run, arrived, last)
        for name in ("natural", "trpo")
        for setting, arrived, last in ((0.25, np.nan, 0.5), (1.0, 9, 0.99), (2.0, 5, 0.99))
        for run in range(2)
    ]
    # at 4 all runs arrive and stay, at 8 one of them ends low, at 16 it all is lost
    for name in ("natural", "trpo"):
        rows += [(name, 4.0, run, 3, 0.9) for run in range(2)]
        rows += [(name, 8.0, 0, 2, 0.99), (name, 8.0, 1, 2, 0.1), (name, 16.0, 0, np.nan, -9)]
    table = pd.DataFrame(rows, columns=["algorithm", "setting", "run", "arrived", "last_share"])
    assert good_range(table, "natural") == pytest.approx(4)
    assert good_range(table, "trpo") == pytest.approx(2)
    assert np.isnan(good_range(table[table.setting > 4], "trpo"))
