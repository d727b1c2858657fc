"""Scores, retained shares and improvement ratios, by hand and against the printed cells."""

import numpy as np
import pytest

from thesis_lib import published, robustness

NETS = ["CTRNN", "DTRNN", "ESN", "DFFWD", "FFWD", "GRU", "LSTM"]
TASKS = ["ant", "half_cheetah", "hopper", "swimmer", "walker"]

# Means of equation 5.4 over the five tasks, computed from Tables C.1 to C.3 by others before
# this module existed; figure 5.4 of the thesis shows them as bars.
MEAN_SCORES = {
    ("flat", "noise"): (0.480, 0.382, 0.418, 0.534, 0.395, 0.279, 0.274),
    ("flat", "switch"): (0.456, 0.448, 0.412, 0.565, 0.570, 0.414, 0.382),
    ("hill", "noise"): (0.584, 0.396, 0.339, 0.369, 0.361, 0.317, 0.392),
    ("hill", "switch"): (0.480, 0.409, 0.269, 0.433, 0.460, 0.370, 0.351),
}


@pytest.fixture(scope="module")
def printed() -> np.ndarray:
    """Tables C.1 to C.3, shape (trained on, condition, robot, net)."""
    cells = np.empty((2, 3, 5, 7))
    for j, table in enumerate(("table-c.1", "table-c.2", "table-c.3")):
        wide = published.load(table).pivot(
            index=["trained_on", "task"], columns="architecture", values="value"
        )
        for i, ground in enumerate(robustness.TRAINED_ON):
            cells[i, j] = wide.loc[ground].loc[TASKS, NETS]
    return cells


def test_score_by_hand():
    # Best of the pair 200: (1, .5) and (.4, .3): 1 (1 - .5) and .4 (1 - .1).
    np.testing.assert_allclose(robustness.score([200, 80], [100, 60]), [0.5, 0.36])


def test_the_best_return_may_be_the_perturbed_one():
    # Best 200 is perturbed: .5 (1 - .5).
    np.testing.assert_allclose(robustness.score([100], [200]), [0.25])


def test_score_against_a_benchmark_set_by_hand():
    # 80 and 60 of 400: .2 (1 - .05).
    assert robustness.score(80, 60, best=400) == pytest.approx(0.19)


def test_task_pairs_are_scaled_each_by_its_own_best():
    base = np.array([[10.0, 5.0], [1000.0, 500.0]])
    scores = robustness.score(base, base)
    np.testing.assert_allclose(scores, [[1, 0.5], [1, 0.5]])


def test_what_was_not_run_has_no_score_nor_have_its_competitors():
    scores = robustness.score([[1, np.nan], [1, 2]], [[1, 1], [1, 2]])
    assert np.isnan(scores[0]).all()
    np.testing.assert_allclose(scores[1], [0.5, 1])


@pytest.mark.parametrize(("base", "best"), [([-1.0, -2.0], None), ([1.0], 0.0)])
def test_a_best_return_that_is_not_positive_scales_nothing(base, best):
    with pytest.raises(ValueError, match="must be positive"):
        robustness.score(base, base, best)


def test_infinite_returns_are_refused():
    with pytest.raises(ValueError, match="infinite"):
        robustness.score([np.inf], [1])


@pytest.mark.parametrize("shape", [(3, 5, 7), (3, 2, 5, 7), (2, 2, 5, 7)])
def test_a_grid_of_another_shape_is_refused(shape):
    with pytest.raises(ValueError, match="trained on"):
        robustness.quadrants(np.ones(shape))


def test_scores_of_the_printed_tables(printed):
    means = robustness.quadrants(printed).mean(axis=-2)
    for (ground, perturbation), expected in MEAN_SCORES.items():
        at = robustness.TRAINED_ON.index(ground), robustness.PERTURBATIONS.index(perturbation)
        np.testing.assert_allclose(means[at], expected, atol=6e-4)


def test_resamples_are_scored_one_by_one(printed):
    both = robustness.quadrants(np.stack([printed, 2 * printed]))
    np.testing.assert_allclose(both[0], robustness.quadrants(printed))
    np.testing.assert_allclose(both[1], both[0])


def test_retained_shares_of_printed_cells(printed):
    kept = robustness.retained(printed)
    assert kept.shape == (2, 2, 5, 7)
    # Ant, CTRNN, flat, noise: 1309.3 / 3214.6; Swimmer hill, FFWD, switch: 4.8 / 177.0.
    assert kept[0, 0, 0, 0] == pytest.approx(1309.3 / 3214.6)
    assert kept[1, 1, 3, 4] == pytest.approx(4.8 / 177.0)


def grid(flat: tuple[float, float, float], hill: tuple[float, float, float]) -> np.ndarray:
    """One robot, one net: base, noise, switch."""
    return np.array([flat, hill], dtype=float)[:, :, None, None]


def test_nothing_is_retained_of_a_return_that_is_not_positive():
    kept = robustness.retained(grid((0, 1, 1), (-10, 5, 5)))
    assert np.isnan(kept).all()


def test_improvement_and_drops_by_hand():
    # Retained: flat .5 and .2, hill .75 and .1; drops: flat .5 and .8, hill .25 and .9.
    returns = grid((100, 50, 20), (200, 150, 20))
    np.testing.assert_allclose(robustness.improvement(returns).ravel(), [1.5, 0.5])
    np.testing.assert_allclose(robustness.ratio_of_drops(returns).ravel(), [0.5, 1.125])


def test_improvement_lies_inside_every_printed_interval_and_the_ratio_of_drops_does_not(printed):
    interval = published.load("table-5.6").set_index(["perturbation", "architecture"])
    ratios = robustness.improvement(printed).mean(axis=1)
    drops = robustness.ratio_of_drops(printed).mean(axis=1)
    inside = {"improvement": 0, "drops": 0}
    for i, perturbation in enumerate(("noise", "hill")):
        for j, net in enumerate(NETS):
            low, high = interval.loc[(perturbation, net), ["low", "high"]]
            inside["improvement"] += low <= ratios[i, j] <= high
            inside["drops"] += low <= drops[i, j] <= high
    assert inside["improvement"] == 14
    assert inside["drops"] < 7
