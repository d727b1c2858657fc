"""The cliff domains: hand-counted values, and the symmetries of the grid."""

import numpy as np
import pytest

from thesis_lib.domains import continuing_cliff, episodic_cliff
from thesis_lib.domains.cliff import MOVES, SIZE, CliffLayout, cliff_task, layouts


def optimal_values(task, sweeps=2000):
    """Value iteration, written out here so that the test does not lean on the library's."""
    v = np.zeros(task.n_states)
    for _ in range(sweeps):
        v = (task.reward + task.discount * task.transition @ v).max(axis=1)
    return task.reward + task.discount * task.transition @ v


def turn(x, y):
    """A quarter turn about the middle of the grid."""
    return y, SIZE - 1 - x


def mirror(x, y):
    """A reflection in the diagonal."""
    return y, x


SYMMETRIES = [
    lambda x, y: turn(x, y),
    lambda x, y: mirror(x, y),
    lambda x, y: turn(*mirror(x, y)),
    lambda x, y: turn(*turn(x, y)),
]


def moved(layout, move):
    return CliffLayout(move(*layout.start), move(*layout.goal), layout.size)


def action_map(move):
    """Which action each action becomes."""
    origin = np.array(move(1, 1))
    new = [tuple(np.array(move(1 + dx, 1 + dy)) - origin) for dx, dy in MOVES]
    return [MOVES.index(step) for step in new]


def test_there_are_eight_layouts_and_the_cliff_lies_between():
    assert len(layouts()) == len({(x.start, x.goal) for x in layouts()}) == 8
    for layout in layouts():
        assert len(layout.cliff) == SIZE - 2
        (x0, y0), (x1, y1) = layout.start, layout.goal
        assert (x0 == x1) != (y0 == y1)
    assert CliffLayout((0, 0), (3, 0)).cliff == ((1, 0), (2, 0))


def test_the_shortest_safe_path_takes_five_steps():
    # Up, three across, down: V*(start) = -5; right beside the goal it is -1.
    layout = CliffLayout((0, 0), (3, 0))
    q = optimal_values(cliff_task(layout))
    assert q[layout.state((0, 0))].tolist() == [-5, -1005, -6, -6]
    assert q[layout.state((3, 1))].max() == -1
    # A fall costs 1000 and then five steps from the start.
    assert q[layout.state((1, 1))].tolist() == [-5, -3, -1005, -5]


def test_a_fall_may_cost_a_step_too():
    layout = CliffLayout((0, 0), (3, 0))
    task = cliff_task(layout, fall_costs_step=True)
    assert task.reward[layout.state((0, 0)), 1] == -1001


def test_the_continuing_task_by_hand():
    # The best tour earns 10 on its fifth step: V(start) = 10 g^4 / (1 - g^5).
    layout, g = CliffLayout((0, 0), (3, 0)), 0.9
    task = cliff_task(layout, continuing=True, discount=g)
    q = optimal_values(task)
    assert q[layout.state((0, 0))].max() == pytest.approx(10 * g**4 / (1 - g**5))
    assert not task.terminal.any()
    assert task.start[layout.state((0, 0))] == 1


@pytest.mark.parametrize("make", [episodic_cliff, continuing_cliff])
@pytest.mark.parametrize("move", SYMMETRIES)
def test_symmetries_of_the_grid_map_tasks_and_values_into_each_other(make, move):
    domain = make(sensor=True)
    by_layout = {(x.start, x.goal): (x, t) for x, t in zip(layouts(), domain.tasks, strict=True)}
    actions = action_map(move)
    for layout, task in by_layout.values():
        image = moved(layout, move)
        other_layout, other = by_layout[image.start, image.goal]
        states = [other_layout.state(move(*layout.cell(s))) for s in range(task.n_states)]
        kept = other.transition[np.ix_(states, actions, states)]
        np.testing.assert_array_equal(task.transition, kept)
        np.testing.assert_array_equal(task.reward, other.reward[np.ix_(states, actions)])
        np.testing.assert_allclose(
            optimal_values(task, 400), optimal_values(other, 400)[np.ix_(states, actions)]
        )
        # The sensor turns with the grid: 0 stays, direction d becomes actions[d].
        turned = [0, *(a + 1 for a in actions)]
        seen = [turned[v] for v in task.features["cliff"]]
        assert seen == other.features["cliff"][states].tolist()


def test_the_sensor_points_at_the_cliff():
    layout = CliffLayout((0, 0), (3, 0))
    reading = {cell: layout.sensor(cell) for cell in [(0, 0), (3, 0), (1, 1), (2, 1), (0, 1)]}
    # East of the start, west of the goal, south of the cells above; nothing at (0, 1).
    assert reading == {(0, 0): 2, (3, 0): 4, (1, 1): 3, (2, 1): 3, (0, 1): 0}


def test_the_sensor_enlarges_the_state_space_of_the_domain_but_not_of_a_task():
    blind, seeing = episodic_cliff(), episodic_cliff(sensor=True)
    assert blind.present.sum(axis=1).tolist() == seeing.present.sum(axis=1).tolist() == [13] * 8
    # Corners and inner cells lie on two edges' sides and read two directions or nothing, edge
    # cells read nothing where they are no cliff: 4 * 3 + 4 * 3 + 8.
    assert seeing.n_observations == 32
    assert blind.n_observations == 16


def test_monte_carlo_returns_match_the_exact_value():
    # The uniformly random policy on the continuing cliff, discount .9, from the start.
    layout = CliffLayout((0, 0), (3, 0))
    task = cliff_task(layout, continuing=True, discount=0.9)
    chain = task.transition.mean(axis=1)
    exact = np.linalg.solve(np.eye(16) - 0.9 * chain, task.reward.mean(axis=1))
    rng = np.random.default_rng(5)
    successor = task.outcomes().successor[:, :, 0]
    n, returns = 4000, np.zeros(4000)
    state = np.full(n, layout.state(layout.start))
    for t in range(200):
        action = rng.integers(4, size=n)
        returns += 0.9**t * task.reward[state, action]
        state = successor[state, action]
    error = returns.std(ddof=1) / np.sqrt(n)
    assert abs(returns.mean() - exact[layout.state(layout.start)]) < 4 * error


def test_bad_size_is_one_sentence():
    with pytest.raises(ValueError, match="size is 2, but a cliff needs at least 3"):
        episodic_cliff(size=2)
