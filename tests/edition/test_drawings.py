"""The pictures of example tasks show what the tasks are."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.patches import FancyArrowPatch
from matplotlib.text import Text

from thesis_lib.appendix_a.pictures import FOUR, THREE, TWO, action_legend, draw_chain
from thesis_lib.domains import figure_a1, figure_a2, figure_a3, stock
from thesis_lib.domains.cliff import layouts as cliff_layouts
from thesis_lib.domains.heat import HeatTask
from thesis_lib.domains.triangle import layouts as triangle_layouts
from thesis_lib.edition.drawings import draw_cliff, draw_heat, draw_stock, draw_triangle
from thesis_lib.edition.plots import beside, panels, unclutter


@pytest.fixture(autouse=True)
def _close_figures():
    yield
    plt.close("all")


def arrows(ax):
    return sum(isinstance(patch, FancyArrowPatch) for patch in ax.patches)


def words(ax):
    return [text.get_text() for text in ax.texts]


def test_a_triangle_has_nine_arrows_and_its_states():
    for shape in ("ring", "line"):
        for layout in triangle_layouts(shape):
            ax = draw_triangle(layout)
            assert arrows(ax) == 9
            assert {"1", "2", "3", "goal"} <= set(words(ax))
            plt.close(ax.figure)


def test_a_cliff_names_start_goal_and_cliff():
    layout = cliff_layouts()[0]
    ax = draw_cliff(layout, policy=np.full((16, 4), 0.25), values=np.full(16, -5.0))
    assert {"S", "G", "cliff", "\N{MINUS SIGN}5"} <= set(words(ax))


def test_a_stock_task_has_one_arrow_an_influence():
    task = stock(2, 3, 2, influence="per_sector").tasks[37]
    ax = draw_stock(task)
    # Every influential stock points at its sector, every global at both.
    assert arrows(ax) == task.influence.sum() + 2 * 2
    assert {"$s_{1}$", "$s_{2}$", "$e_{3}$", "$g_{2}$"} <= set(words(ax))


def test_chains_label_rewards_and_probabilities():
    for task in figure_a1().tasks:
        assert "\N{MINUS SIGN}1" in words(draw_chain(task, TWO))
    ax = draw_chain(figure_a2("c").tasks[1], THREE, title="task 2c")
    assert {"+1", "p = 0.1", "p = 0.9"} <= set(words(ax))
    ax = draw_chain(figure_a3().tasks[1], FOUR)
    action_legend(ax)
    assert {"+6", "p = 0.05", "p = 0.95"} <= set(words(ax))


def test_a_heat_task_shows_its_source_where_it_is():
    ax = draw_heat(HeatTask((7.0, 6.0)), path=[(2, 2), (3, 3)])
    assert "source" in words(ax)
    assert any(line.get_xydata().tolist() == [[7.0, 6.0]] for line in ax.lines)


def test_panels_stand_row_by_row_and_the_rest_is_blank():
    fig, axes = panels(5, 3, 2.0, 0.5, sharey=True)
    assert fig.get_size_inches().tolist() == [7.2, 4.5]
    assert [ax.axison for ax in fig.axes] == [True] * 5 + [False]
    assert axes == fig.axes[:5]
    assert axes[4].get_shared_y_axes().joined(axes[0], axes[4])
    few, _ = panels(2, 3, 2.0)
    assert len(few.axes) == 2  # side by side, with no third place
    plt.close("all")


def test_numbers_on_one_another_part_and_stay_near_their_points():
    fig, ax = plt.subplots()
    ax.set(xlim=(0, 1), ylim=(0, 1))
    # The last stands in the corner, where the asked place is outside.
    points = {"1–4": (0.5, 0.5), "6": (0.501, 0.5), "8": (0.9, 0.5), "10": (1.0, 1.0)}
    for text, at in points.items():
        beside(ax, text, at, (5.0, 5.0), fontsize=6, color="k")
    asked = [Text.get_window_extent(note) for note in ax.texts]
    assert asked[0].overlaps(asked[1])
    unclutter(fig)
    fig.draw_without_rendering()
    boxes = [Text.get_window_extent(note) for note in ax.texts]
    assert words(ax) == list(points)
    assert not any(box.count_overlaps(boxes[:i]) for i, box in enumerate(boxes))
    assert all(abs(np.array(note.xyann)).max() < 25 for note in ax.texts)
    assert (boxes[3].max <= ax.bbox.max).all()


def test_a_number_for_which_there_is_no_place_goes():
    fig, ax = plt.subplots(figsize=(1.0, 1.0))
    ax.set(xlim=(0, 1), ylim=(0, 1))
    for n in range(200):
        beside(ax, str(n), (0.5, 0.5), (5.0, 5.0), fontsize=8, color="k")
    unclutter(fig)
    assert words(ax)[0] == "0"
    assert len(words(ax)) < 200


def test_a_number_keeps_off_a_line():
    fig, ax = plt.subplots()
    ax.set(xlim=(0, 1), ylim=(0, 1))
    ax.plot([0.5, 1.0], [0.5, 0.5])
    beside(ax, "6", (0.5, 0.5), (5.0, 0.0), fontsize=6, color="k")
    unclutter(fig)
    low, high = Text.get_window_extent(ax.texts[0]).intervaly
    line = ax.transData.transform((0.5, 0.5))[1]
    assert not low < line < high
