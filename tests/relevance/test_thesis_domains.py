"""What the laws say on the domains of the thesis."""

import numpy as np
import pytest

from tests.selection.examples import solved
from thesis_lib.domains import Domain, episodic_cliff, stock, triangle
from thesis_lib.relevance import (
    Solutions,
    cross_task_q,
    domain_relevance,
    k_relevance,
    keep,
    relevance,
    remove,
    sampled_k_relevance,
)

K = np.arange(1, 13)


def cheap_triangle(penalty: float) -> Domain:
    return triangle(red_penalty=penalty)


def test_figure_41_shows_forward_relevance() -> None:
    domain = solved(triangle)
    names = domain.feature_names
    forward = {f: k_relevance(domain, keep(domain, [f]), K, direction="forward") for f in names}
    backward = {f: k_relevance(domain, remove(domain, [f]), K) for f in names}
    # "While the relevance of the action a and distance feature x2 decreases, these features
    # remain domain relevant.  Relevance of the position feature x1 ... disappears completely."
    for curves, decreasing in ((forward, True), (backward, False)):
        assert (np.diff(curves["a"]) < 0).all()
        assert (np.diff(curves["x1"]) < 0).all()
        assert (np.diff(curves["x2"]) < 0).all() == decreasing
    # All four curves are of the form limit + slope / k although p is not shared.
    for curve in forward.values():
        slope = 2 * (curve[0] - curve[1])
        np.testing.assert_allclose(curve, curve[0] - slope + slope / K, atol=1e-12)
    assert forward["x1"][-1] == pytest.approx(forward["x1"][0] / 12)


def test_steps_of_relevance_can_grow_on_the_triangle() -> None:
    # With a red penalty of sqrt(2/3), removing {x1, x3}: rho_1 = rho_2 = 1/9 and then less.
    domain = solved(cheap_triangle, float(np.sqrt(2 / 3)))
    rho = k_relevance(domain, remove(domain, ["x1", "x3"]), [1, 2, 3])
    np.testing.assert_allclose(rho[:2], 1 / 9, atol=1e-12)
    assert rho[2] == pytest.approx(0.1029, abs=5e-5)


@pytest.mark.parametrize("g", [1, 3])
def test_stock_obeys_the_law(g: int) -> None:
    domain = solved(stock, 1, 2, g)
    assert domain.shared
    removed = [remove(domain, [f]) for f in domain.feature_names]
    curves = np.array([k_relevance(domain, labels, K) for labels in removed])
    limits = [domain_relevance(domain, labels) for labels in removed]
    expected = np.array(limits)[:, None] + (curves[:, :1] - np.array(limits)[:, None]) / K
    np.testing.assert_allclose(curves, expected, atol=1e-12)


def test_position_is_weakly_relevant_on_the_cliff() -> None:
    domain = solved(episodic_cliff, True)
    limit = {f: domain_relevance(domain, remove(domain, [f])) for f in domain.feature_names}
    assert 0 < limit["x"] < 1
    assert limit["x"] == pytest.approx(limit["y"])
    assert limit["cliff"] > 1e4 * limit["x"]


def test_exact_formula_on_the_cliff_against_samples() -> None:
    domain = solved(episodic_cliff, True)
    labels = remove(domain, ["x", "y"])
    draws = [
        sampled_k_relevance(domain, labels, 4, 200, seed, replacement=True) for seed in range(20)
    ]
    exact = k_relevance(domain, labels, 4)
    assert exact == pytest.approx(np.mean(draws), abs=4 * np.std(draws) / np.sqrt(20))
    all_pairs = k_relevance(domain, labels, 8, replacement=False)
    assert all_pairs == pytest.approx(relevance(labels, *cross_task_q(domain)), rel=1e-9)
    assert isinstance(domain, Solutions)
