"""The triangle domain against values worked by hand from section 3.4.3."""

import numpy as np
import pytest

from thesis_lib.domains import triangle
from thesis_lib.domains.triangle import DISTANCE_CODE, TriangleLayout, layouts, triangle_task


def test_there_are_twelve_tasks_of_nine_pairs_and_thirty_six_in_all():
    domain = triangle()
    assert len(domain) == 12
    assert len(set(domain.task_names)) == 12
    assert (domain.present.sum(axis=1) * 3 == 9).all()
    assert domain.n_observations * 3 == 36


def test_the_printed_example_has_its_printed_features():
    # "in the figure, the states would be (1, 0.25), (2, 1), (3, 0.25)": the goal is at 2.
    task = triangle_task(TriangleLayout(goal=2))
    seen = zip(task.features["x1"][:3], task.features["x2"][:3] / DISTANCE_CODE, strict=True)
    assert list(seen) == [(1, 0.25), (2, 1.0), (3, 0.25)]


@pytest.mark.parametrize("layout", layouts(), ids=lambda layout: layout.name)
def test_every_transition_and_reward(layout):
    task = triangle_task(layout)
    after = {1: 2, 2: 3, 3: 1}
    before = {2: 1, 3: 2, 1: 3}
    left, right = (after, before) if layout.reversed else (before, after)
    for s in (1, 2, 3):
        expected = [left[s], right[s], 4 if s == layout.goal else s]
        assert task.transition[s - 1].argmax(axis=1).tolist() == [t - 1 for t in expected]
        stays = expected[2] == s
        assert task.reward[s - 1].tolist() == [-1, -1, -11 if layout.red and stays else -1]


def test_red_penalty_and_steps_are_options():
    task = triangle_task(TriangleLayout(goal=1, red=True), red_penalty=0.5, step_reward=-2)
    assert task.reward[:3, 2].tolist() == [-2, -2.5, -2.5]
    assert task.reward[3].tolist() == [0, 0, 0]


def test_the_ends_of_a_line_stay():
    domain = triangle(shape="line")
    task = triangle_task(TriangleLayout(goal=2, red=True, shape="line"))
    assert task.transition[0, 0, 0] == 1  # L at state 1
    assert task.transition[2, 1, 2] == 1  # R at state 3
    assert task.reward[0, 0] == -11
    assert domain.n_observations * 3 == 48


def test_start_is_uniform_unless_given():
    assert triangle().tasks[0].start.tolist() == pytest.approx([1 / 3, 1 / 3, 1 / 3, 0])
    assert triangle(start=[0, 1, 0]).tasks[0].start.tolist() == [0, 1, 0, 0]


def test_state_value_is_minus_the_distance():
    # Under the optimal policy every step costs 1, so V*(s) = -distance whatever the colour.
    for layout, task in zip(layouts(), triangle().tasks, strict=True):
        values = -np.array([*(layout.distance(s) for s in (1, 2, 3)), 0.0])
        np.testing.assert_allclose(task.lookahead(values).max(axis=1), values)


def test_bad_options_are_one_sentence():
    with pytest.raises(ValueError, match="shape 'cube' does not exist: choose one of ring, line"):
        triangle(shape="cube")
    with pytest.raises(ValueError, match=r"start has shape \(2,\)"):
        triangle(start=[0.5, 0.5])
    with pytest.raises(ValueError, match=r"sums to 0\.9"):
        triangle(start=[0.3, 0.3, 0.3])
