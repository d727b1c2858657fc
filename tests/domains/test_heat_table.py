"""The heat domain in cells, against the domain's own dynamics."""

import numpy as np
import pytest

from thesis_lib.domains.heat import HeatWorld, move
from thesis_lib.domains.heat_table import heat_table

WORLD = HeatWorld(sensor=0.0)


@pytest.fixture(scope="module")
def table():
    return heat_table(cells=4, headings=8)


def test_an_action_leads_where_the_robot_goes_from_anywhere_in_its_cell(table) -> None:
    """Frequencies of the simulator, which knows no cell, from states drawn evenly in one."""
    rng, n, width = np.random.default_rng(3), 1500, 2.0
    for heading, y, x in ((0, 1, 3), (3, 0, 2), (7, 2, 2)):
        for action in range(4):
            counts = np.zeros((8, 4, 4))
            low = np.array([1 + x * width, 1 + y * width, heading * np.pi / 4])
            for state in low + rng.random((n, 3)) * [width, width, np.pi / 4]:
                move(rng, WORLD.parameters, state, action)
                i, j = np.minimum((state[:2] - 1) // width, 3).astype(int)
                counts[int(state[2] // (np.pi / 4)) % 8, j, i] += 1
            p = table.tasks[0].transition[(heading * 4 + y) * 4 + x, action]
            error = np.sqrt(np.maximum(p * (1 - p), 1e-4) / n)
            assert (np.abs(counts.ravel() / n - p) < 5 * error).all(), (heading, y, x, action)


def test_sources_lie_a_cell_from_the_walls_and_end_an_episode(table) -> None:
    """In the cells of side 2 only the one whose centre is the source is within its radius."""
    ends = [
        {(int(t.features["x"][s]), int(t.features["y"][s])) for s in np.flatnonzero(t.terminal)}
        for t in table.tasks
    ]
    assert ends == [{(1, 1)}, {(1, 2)}, {(2, 1)}, {(2, 2)}]
    # At distance 2 the heat is 1/4, the fourth of twelve intervals.
    beside = table.tasks[0].features["heat"].reshape(8, 4, 4)[:, 1, 2]
    assert beside.tolist() == [3] * 8
    assert table.tasks[0].features["heat"].reshape(8, 4, 4)[0, 1, 1] == 11


def test_too_few_cells_are_refused() -> None:
    with pytest.raises(ValueError, match="at least 3"):
        heat_table(cells=2)
