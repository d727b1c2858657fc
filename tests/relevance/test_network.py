"""Small networks fitted side by side."""

import numpy as np
import pytest

from thesis_lib.relevance import Networks, fit_networks
from thesis_lib.relevance.network import _linearise, _start

X = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], dtype=float)


def test_output_by_hand() -> None:
    net = Networks(
        np.array([[[1.0], [0.0], [0.0]]]),
        np.array([[0.5]]),
        np.array([[2.0]]),
        np.array([-1.0]),
    )
    expected = 2 * np.tanh(X[:, 0] + 0.5) - 1
    np.testing.assert_allclose(net(X), expected[None])


def test_single_precision_gives_the_same_outputs() -> None:
    rng = np.random.default_rng(3)
    shapes = ((4, 5, 3), (4, 3), (4, 3), (4,))
    net = Networks(*(rng.normal(size=shape) for shape in shapes))
    inputs = rng.normal(size=(50, 5))
    short = net.single()(inputs)
    assert short.dtype == np.float32
    np.testing.assert_allclose(short, net(inputs), rtol=0, atol=1e-5)


def test_derivatives_are_those_of_finite_differences() -> None:
    rng = np.random.default_rng(0)
    theta = _start(3, 2, rng)[None] + 0.3
    root = np.sqrt(rng.dirichlet(np.ones(8)))
    y = rng.normal(size=(1, 8))
    residual, jacobian = _linearise(theta, X, y, root, 2)
    for j in range(theta.shape[1]):
        moved = theta.copy()
        moved[0, j] += 1e-6
        change = (_linearise(moved, X, y, root, 2)[0] - residual) / 1e-6
        np.testing.assert_allclose(jacobian[0, :, j], change[0], atol=1e-5)


def test_a_network_learns_what_a_linear_function_cannot() -> None:
    targets = np.stack([X[:, 0] * X[:, 1], X[:, 2], 3 + X[:, 0] - 2 * X[:, 1] * X[:, 2]])
    nets = fit_networks(X, targets, 4, np.random.default_rng(1), iterations=200)
    np.testing.assert_allclose(nets(X), targets, atol=0.05)


def test_rows_do_not_disturb_one_another() -> None:
    rng = np.random.default_rng(2)
    targets = rng.normal(size=(3, 8))
    together = fit_networks(X, targets, 2, np.random.default_rng(3))(X)
    # One scale for all: the same set in another order is fitted alike.
    again = fit_networks(X, targets[::-1], 2, np.random.default_rng(3))(X)[::-1]
    np.testing.assert_allclose(together, again, atol=1e-8)


def test_weights_of_pairs_count() -> None:
    p = np.where(X[:, 0] > 0, 0.25, 0.0)
    targets = np.where(X[:, 0] > 0, X[:, 1], 100.0)[None]
    found = fit_networks(X, targets, 2, np.random.default_rng(0), p=p)(X)[0]
    np.testing.assert_allclose(found[X[:, 0] > 0], X[X[:, 0] > 0, 1], atol=0.05)


@pytest.mark.parametrize(
    ("inputs", "targets", "hidden", "message"),
    [
        (X, np.ones((1, 7)), 2, "same pairs"),
        (X, np.full((1, 8), np.nan), 2, "not finite"),
        (X, np.ones((1, 8)), 0, "hidden"),
        (np.empty((0, 3)), np.ones((1, 0)), 2, "same pairs"),
    ],
)
def test_bad_input_is_refused(inputs, targets, hidden, message) -> None:
    with pytest.raises(ValueError, match=message):
        fit_networks(inputs, targets, hidden, np.random.default_rng(0))
