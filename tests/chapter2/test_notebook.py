"""The backpropagation that chapter 2 writes out, against finite differences and by hand."""

from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pytest

NOTEBOOK = Path(__file__).resolve().parents[2] / "notebooks" / "ch02_networks.ipynb"


@pytest.fixture(scope="module")
def cells() -> dict[str, Any]:
    """The names that the notebook's cells on backpropagation through time define."""
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    source = {cell.id: cell.source for cell in notebook.cells}
    names: dict[str, Any] = {"np": np}
    for cell in ("bptt-forward", "bptt-backward"):
        exec(compile(source[cell], cell, "exec"), names)
    return names


def test_gradients_against_finite_differences(cells: dict[str, Any]) -> None:
    rng = np.random.default_rng(1)
    weights = [rng.normal(size=s) / 2 for s in ((4, 4), (4, 3), (2, 4))]
    x, y = rng.normal(size=(7, 3)), rng.normal(size=(7, 2))

    def loss(*weights: np.ndarray) -> float:
        h, total = np.zeros(4), 0.0
        K, W, U = weights
        for x_n, y_n in zip(x, y, strict=True):
            h = np.tanh(K @ h + W @ x_n)
            total += 0.5 * ((U @ h - y_n) ** 2).sum()
        return total

    gradients = cells["bptt"](*weights, x, y)
    for i, weight in enumerate(weights):
        for index in np.ndindex(weight.shape):
            ends = []
            for sign in (1, -1):
                moved = [w.copy() for w in weights]
                moved[i][index] += sign * 1e-6
                ends.append(loss(*moved))
            assert gradients[i][index] == pytest.approx((ends[0] - ends[1]) / 2e-6, abs=1e-7)


def test_two_steps_of_one_unit_by_hand(cells: dict[str, Any]) -> None:
    k, w, u, x1, x2, y1, y2 = 0.5, 1.5, 2.0, 0.3, -0.2, 0.1, 0.4
    h1 = np.tanh(w * x1)
    h2 = np.tanh(k * h1 + w * x2)
    e1, e2 = u * h1 - y1, u * h2 - y2
    d2 = (1 - h2**2) * u * e2
    d1 = (1 - h1**2) * (u * e1 + k * d2)
    one = np.ones((1, 1))
    got = cells["bptt"](k * one, w * one, u * one, np.array([[x1], [x2]]), np.array([[y1], [y2]]))
    expected = (d2 * h1, d1 * x1 + d2 * x2, e1 * h1 + e2 * h2)
    np.testing.assert_allclose([g.item() for g in got], expected, rtol=1e-12)
