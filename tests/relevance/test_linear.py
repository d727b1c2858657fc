"""The law of k-relevance for linear cross-task functions."""

from itertools import product

import numpy as np
import pytest

from tests.relevance.worlds import covariance, world
from thesis_lib.relevance import (
    Basis,
    Solutions,
    estimate,
    estimate_from,
    feature_basis,
    increment_covariance,
    linear_class,
    linear_k_relevance,
    list_sequences,
    remove,
)

NAMES = ("f", "g", "a")
FEATURES = np.array(list(product(range(3), range(2), range(2))))


def tasks(seed: int, n: int = 3, kind: str = "weights") -> Solutions:
    """Random tasks on twelve pairs with one random p(x)."""
    rng = np.random.default_rng(seed)
    p = rng.dirichlet(np.ones(12)) if kind == "weights" else np.full(12, 1 / 12)
    return Solutions(rng.normal(size=(n, 12)), np.broadcast_to(p, (n, 12)), FEATURES, NAMES)


def error(columns: np.ndarray, q: np.ndarray, p: np.ndarray) -> float:
    """Weighted mean squared error of the least-squares fit, by the normal equations."""
    gram = columns.T @ (p[:, None] * columns)
    weights = np.linalg.pinv(gram) @ (columns.T @ (p * q))
    return float(p @ (q - columns @ weights) ** 2)


def residual_covariance(solutions: Solutions, columns: np.ndarray) -> np.ndarray:
    """Weighted products of what least-squares fits of the tasks by some columns leave."""
    root = np.sqrt(solutions.p[0])[:, None]
    fitted = columns @ np.linalg.lstsq(root * columns, root * solutions.q.T, rcond=None)[0]
    left = root * (solutions.q.T - fitted)
    return left.T @ left


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("interactions", ["none", "action", "pairs"])
def test_the_law_against_every_sequence(seed: int, interactions: str) -> None:
    solutions = tasks(seed)
    D = np.random.default_rng(seed).dirichlet(np.ones(3))
    basis = feature_basis(solutions, interactions)
    kept = np.array([seed % 2 == 0, seed % 3 == 0, seed % 5 != 0])
    p = solutions.p[0]
    for k in (1, 2, 3, 4):
        sequences, chances = list_sequences(3, k, D)
        listed = 0.0
        for c, chance in zip(sequences, chances, strict=True):
            q = solutions.q[c].mean(axis=0)
            rise = error(basis.columns[:, basis.within(kept)], q, p) - error(basis.columns, q, p)
            listed += chance * rise
        exact = linear_k_relevance(solutions, basis, kept, k, D)
        assert exact == pytest.approx(listed, abs=1e-12)


@pytest.mark.parametrize("seed", range(10))
def test_it_holds_for_ridge_regression_and_any_other_linear_fit(seed: int) -> None:
    # The rise of the error of a smoother is a quadratic form of Q as well.
    solutions = tasks(seed)
    p = solutions.p[0]
    basis = feature_basis(solutions, "pairs")
    kept = np.array([True, False, True])

    def residual(columns: np.ndarray) -> np.ndarray:
        weighted = columns.T * p
        gram = weighted @ columns + 0.3 * np.eye(columns.shape[1])
        return np.eye(12) - columns @ np.linalg.solve(gram, weighted)

    forms = [residual(c) for c in (basis.columns[:, basis.within(kept)], basis.columns)]
    rises = []
    for k in (1, 2, 3, 4):
        sequences, chances = list_sequences(3, k)
        means = solutions.q[sequences].mean(axis=1)
        errors = [((means @ form.T) ** 2) @ p for form in forms]
        rises.append(chances @ (errors[0] - errors[1]))
    # From k = 1 and 2 the law gives the others.
    limit, first = 2 * rises[1] - rises[0], rises[0]
    for k in (3, 4):
        assert rises[k - 1] == pytest.approx(limit + (first - limit) / k, abs=1e-12)


def test_regression_on_all_tasks_at_once_is_regression_on_their_mean() -> None:
    solutions = tasks(1)
    basis = feature_basis(solutions, "action")
    root = np.sqrt(solutions.p[0])
    stacked = np.tile(root[:, None] * basis.columns, (3, 1))
    at_once = np.linalg.lstsq(stacked, (root * solutions.q).ravel(), rcond=None)[0]
    mean = np.linalg.lstsq(
        root[:, None] * basis.columns, root * solutions.q.mean(axis=0), rcond=None
    )[0]
    np.testing.assert_allclose(at_once, mean, atol=1e-12)


def test_weights_keep_their_mean_and_their_squares_obey_the_law() -> None:
    solutions = tasks(2, kind="uniform")
    basis = feature_basis(solutions, "action")
    weights = np.linalg.lstsq(basis.columns, solutions.q.T, rcond=None)[0]
    limit = weights.mean(axis=1) ** 2
    first = (weights**2).mean(axis=1)
    for k in (1, 2, 3):
        sequences, chances = list_sequences(3, k)
        means = solutions.q[sequences].mean(axis=1)
        fitted = np.linalg.lstsq(basis.columns, means.T, rcond=None)[0]
        np.testing.assert_allclose(fitted @ chances, weights.mean(axis=1), atol=1e-12)
        np.testing.assert_allclose(fitted**2 @ chances, limit + (first - limit) / k, atol=1e-12)


def test_a_column_a_pair_is_the_table() -> None:
    # One column for each pair, and one for each cell of the abstraction, read what they say.
    solutions = world(3, "shared", 5)
    labels = remove(solutions, [0])
    n = solutions.n_pairs
    cells = np.eye(labels.max() + 1)[labels]
    rest = np.ones(solutions.n_features, dtype=bool)
    rest[0] = False
    uses = np.concatenate([np.ones((n, len(rest)), bool), np.tile(rest, (cells.shape[1], 1))])
    basis = Basis(np.concatenate([np.eye(n), cells], axis=1), uses)
    ours = increment_covariance(solutions, basis, rest)
    np.testing.assert_allclose(ours, covariance(solutions, labels), atol=1e-12)
    table = estimate(solutions, labels)
    linear = estimate_from(ours)
    assert linear.f_ratio == pytest.approx(table.f_ratio, rel=1e-9)
    assert linear.domain == pytest.approx(table.domain, abs=1e-12)
    assert linear.spread == pytest.approx(table.spread, rel=1e-9)


def test_increments_add_up_to_the_residual_covariance() -> None:
    # From the whole table to some columns, by way of all columns.
    solutions = tasks(4)
    basis = feature_basis(solutions, "action")
    kept = np.array([False, True, True])
    outer = residual_covariance(solutions, basis.columns)
    inner = residual_covariance(solutions, basis.columns[:, basis.within(kept)])
    np.testing.assert_allclose(
        increment_covariance(solutions, basis, kept), inner - outer, atol=1e-12
    )
    part = np.array([False, False, True])
    np.testing.assert_allclose(
        increment_covariance(solutions, basis, part),
        increment_covariance(solutions, basis, kept)
        + increment_covariance(solutions, basis, part, kept),
        atol=1e-12,
    )


def test_a_basis_without_a_constant_fits_the_values_and_not_their_spread() -> None:
    # Q near 10 and two plain columns, against the normal equations.
    rng = np.random.default_rng(6)
    columns, p = rng.normal(size=(4, 2)), np.full(4, 0.25)
    features = np.array(list(product(range(2), repeat=2)))
    q = 10 + rng.normal(size=(3, 4))
    solutions = Solutions(q, np.tile(p, (3, 1)), features, ("f", "g"))
    basis, kept = Basis(columns, np.eye(2, dtype=bool)), np.array([True, False])
    rises = [error(columns[:, :1], row, p) - error(columns, row, p) for row in q]
    got = linear_k_relevance(solutions, basis, kept, 1)
    assert got == pytest.approx(np.mean(rises), rel=1e-9)
    B = residual_covariance(solutions, columns[:, :1]) - residual_covariance(solutions, columns)
    np.testing.assert_allclose(increment_covariance(solutions, basis, kept), B, rtol=1e-9)


def test_columns_by_hand() -> None:
    solutions = tasks(0)
    basis = feature_basis(solutions, "action")
    # 1; two indicators of f; g; a; their products with a.
    assert basis.columns.shape == (12, 1 + 2 + 1 + 1 + 2 + 1)
    assert basis.uses.astype(int).tolist() == [
        [0, 0, 0],
        [1, 0, 0],
        [1, 0, 0],
        [0, 1, 0],
        [0, 0, 1],
        [1, 0, 1],
        [1, 0, 1],
        [0, 1, 1],
    ]
    np.testing.assert_allclose((basis.columns**2)[:, 1:5].mean(axis=0), 1)
    # Without the action its products go too.
    assert basis.within([True, True, False]).tolist() == [True] * 4 + [False] * 4
    numbers = feature_basis(solutions, "none", numeric=["f"])
    assert numbers.columns.shape == (12, 4)
    np.testing.assert_allclose(np.unique(numbers.columns[:, 1]), [-np.sqrt(1.5), 0, np.sqrt(1.5)])


def test_a_constant_feature_has_no_column() -> None:
    features = np.column_stack([np.zeros(4, dtype=int), np.arange(4) % 2, np.arange(4) // 2])
    solutions = Solutions(np.ones((1, 4)), np.full((1, 4), 0.25), features, NAMES)
    basis = feature_basis(solutions, "pairs")
    assert not basis.uses[:, 0].any()


def test_bad_input_is_refused() -> None:
    solutions = tasks(0)
    basis = feature_basis(solutions)
    everything = np.ones(3, dtype=bool)
    with pytest.raises(ValueError, match="interactions 'all' does not exist"):
        feature_basis(solutions, "all")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="different p"):
        linear_class(world(0, "weights", 3), basis)
    with pytest.raises(ValueError, match="12 rows, but there are"):
        linear_class(world(0, "shared", 3), basis)
    with pytest.raises(ValueError, match="subset"):
        increment_covariance(solutions, basis, everything, ~everything)
    with pytest.raises(ValueError, match="uses"):
        Basis(np.ones((4, 2)), np.ones((3, 1), dtype=bool))
    with pytest.raises(ValueError, match="not finite"):
        Basis(np.full((4, 1), np.nan), np.ones((1, 1), dtype=bool))
