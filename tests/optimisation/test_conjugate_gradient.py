import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from thesis_lib.optimisation import conjugate_gradient


@given(st.integers(1, 12), st.integers(0, 1000))
@settings(max_examples=40, deadline=None)
def test_against_a_direct_solve(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, n))
    matrix = torch.as_tensor(root @ root.T + np.identity(n))
    b = torch.as_tensor(rng.normal(size=n))
    found = conjugate_gradient(lambda v: matrix @ v, b, iterations=3 * n, tolerance=1e-26)
    expected = torch.linalg.solve(matrix, b)
    torch.testing.assert_close(found.x, expected, rtol=1e-8, atol=1e-9)
    torch.testing.assert_close(found.product, b, rtol=1e-8, atol=1e-8)


def test_as_many_steps_as_eigenvalues() -> None:
    matrix = torch.diag(torch.tensor([1.0, 1.0, 5.0, 5.0, 5.0], dtype=torch.float64))
    b = torch.arange(1.0, 6.0, dtype=torch.float64)
    found = conjugate_gradient(lambda v: matrix @ v, b, iterations=50, tolerance=1e-20)
    assert found.iterations == 2
    assert found.residual < 1e-10


def test_the_product_belongs_to_an_unfinished_solution() -> None:
    rng = np.random.default_rng(0)
    root = rng.normal(size=(20, 20))
    matrix = torch.as_tensor(root @ root.T + 0.1 * np.identity(20))
    b = torch.as_tensor(rng.normal(size=20))
    found = conjugate_gradient(lambda v: matrix @ v, b, iterations=5)
    assert found.iterations == 5
    torch.testing.assert_close(found.product, matrix @ found.x, rtol=1e-9, atol=1e-9)
    assert found.residual == pytest.approx(float((b - matrix @ found.x).norm() / b.norm()))


def test_nothing_to_solve() -> None:
    found = conjugate_gradient(lambda v: v, torch.zeros(3))
    assert found.iterations == 0
    assert found.residual == 0
    assert found.x.tolist() == [0, 0, 0]


def test_it_stops_where_the_curvature_is_not_positive() -> None:
    # the first direction is fine, the second is not
    matrix = torch.diag(torch.tensor([3.0, 1.0, -1.0], dtype=torch.float64))
    b = torch.tensor([3.0, 1.0, 1.0], dtype=torch.float64)
    found = conjugate_gradient(lambda v: matrix @ v, b)
    torch.testing.assert_close(found.x, b * float(b @ b / (b @ matrix @ b)))
    torch.testing.assert_close(found.product, matrix @ found.x)


def test_products_that_are_not_numbers() -> None:
    with pytest.raises(FloatingPointError, match="is not a number"):
        conjugate_gradient(lambda v: v * float("nan"), torch.ones(3))
