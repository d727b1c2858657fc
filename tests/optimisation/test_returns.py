import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from thesis_lib.optimisation import advantages, discounted_returns, standardised
from thesis_lib.policies import Packing


def by_definition(rewards: np.ndarray, discount: float) -> list[float]:
    n = len(rewards)
    return [sum(discount ** (k - t) * rewards[k] for k in range(t, n)) for t in range(n)]


def test_returns_by_hand() -> None:
    # one episode with rewards 1, 2, 4 and one with 8, at discount 1/2
    packing = Packing(np.array([3, 1]))
    rewards = np.array([1.0, 8.0, 2.0, 4.0])
    assert discounted_returns(rewards, packing, 0.5).tolist() == [3.0, 8.0, 4.0, 4.0]


@given(
    st.lists(st.integers(1, 6), min_size=1, max_size=6),
    st.floats(0, 1),
    st.floats(0, 1),
    st.integers(0, 1000),
)
@settings(max_examples=60, deadline=None)
def test_against_the_sums(
    lengths: list[int], discount: float, gae_lambda: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    packing = Packing(np.array(lengths))
    rewards, values = rng.normal(size=(2, packing.n_steps))
    last = rng.normal(size=len(lengths))
    returns = discounted_returns(rewards, packing, discount)
    estimate = advantages(rewards, values, packing, discount, gae_lambda, last)
    for b, n in enumerate(lengths):
        mine = [np.flatnonzero((packing.episode == b) & (packing.time == t))[0] for t in range(n)]
        r, v = rewards[mine], values[mine]
        np.testing.assert_allclose(returns[mine], by_definition(r, discount), atol=1e-12)
        after = np.append(v[1:], last[b])
        delta = r + discount * after - v
        expected = by_definition(delta, discount * gae_lambda)
        np.testing.assert_allclose(estimate[mine], expected, atol=1e-12)


def test_advantage_is_return_less_baseline_when_lambda_is_1() -> None:
    rng = np.random.default_rng(0)
    packing = Packing(np.array([4, 2, 5]))
    rewards, values = rng.normal(size=(2, packing.n_steps))
    expected = discounted_returns(rewards, packing, 0.9) - values  # equation 2.12
    np.testing.assert_allclose(advantages(rewards, values, packing, 0.9), expected, atol=1e-12)


def test_standardised() -> None:
    x = standardised(np.array([1.0, 2.0, 3.0, 6.0]))
    assert x.mean() == pytest.approx(0, abs=1e-15)
    assert x.std() == pytest.approx(1, abs=1e-7)
    assert standardised(np.full(3, 5.0)).tolist() == [0, 0, 0]


def test_bad_arguments() -> None:
    packing = Packing(np.array([2, 1]))
    with pytest.raises(ValueError, match=r"discount is 1\.1"):
        discounted_returns(np.zeros(3), packing, 1.1)
    with pytest.raises(ValueError, match=r"gae_lambda is -0\.1"):
        advantages(np.zeros(3), np.zeros(3), packing, 0.9, -0.1)
    with pytest.raises(ValueError, match="the batch has 3 steps"):
        discounted_returns(np.zeros(4), packing, 0.9)
