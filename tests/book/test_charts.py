"""Figures with a slider: what they draw."""

import json
import re
from collections import defaultdict
from typing import Any

import pytest
import vl_convert

from thesis_lib.book import charts
from thesis_lib.chapter5.cells import NETS
from thesis_lib.edition.plots import COLOURS


def rows(chart: Any) -> list[dict[str, Any]]:
    """All data of a chart."""
    return [row for data in chart.to_dict()["datasets"].values() for row in data]


def test_the_exponential_goes_through_three_values_of_the_law() -> None:
    share = defaultdict(dict)
    for row in rows(charts.law()):
        if row["n"] in (3, None):
            share[row["curve"]][row["k"]] = row["share"]
    own, fitted = share["the law"], share["FS-TEK's exponential"]
    assert own[40] == pytest.approx(1 / 40)
    for k in (1, 2, 3):  # 1/4 + 3/4 (1/3)^(k - 1) is 1, 1/2, 1/3
        assert fitted[k] == pytest.approx(1 / k, abs=1e-4)
    assert fitted[40] == pytest.approx(1 / 4, abs=1e-4)


def test_every_level_of_the_slider_has_a_curve() -> None:
    (slider,) = charts.threshold().to_dict()["params"][:1]
    ends = slider["bind"]
    levels = {row.get("exponent") for row in rows(charts.threshold())}
    wanted = ends["min"]
    while wanted <= ends["max"]:
        assert wanted in levels
        wanted += ends["step"]


def test_the_threshold_is_drawn_beside_what_an_f_ratio_can_be() -> None:
    marks = {row["of"]: row["F"] for row in rows(charts.threshold()) if "of" in row}
    assert marks == {"an irrelevant feature": 1, "no feature is below 0": 0}


def test_the_limit_of_the_law_is_at_most_its_first_value() -> None:
    spec = charts.drawn(charts.law(), 100, 100)
    for parameter in spec["params"]:
        if parameter["name"] == "limit":
            parameter["value"] = 10  # the first is 8: the curve must not rise to it
    drawn = vl_convert.vegalite_to_svg(spec)
    values = [float(v) for v in re.findall(r"k-relevance: ([\d.]+)", drawn)]
    assert values
    assert max(values) == min(values) == 8


@pytest.mark.parametrize(("epsilon", "arrives"), [(0.01, True), (0.09, False)])
def test_the_best_policy_huddles_where_exploring_is_dangerous(
    epsilon: float, arrives: bool
) -> None:
    arrows = {
        (row["x"], row["y"]): row["move"]
        for row in rows(charts.huddle())
        if row.get("epsilon") == pytest.approx(epsilon)
    }
    steps = {"↑": (0, 1), "→": (1, 0), "↓": (0, -1), "←": (-1, 0)}
    place = (0, 0)  # the start; the goal is (3, 0), the cliff between them
    for _ in range(20):
        if place == (3, 0):
            break
        move = steps[arrows[place]]
        place = (min(max(place[0] + move[0], 0), 3), min(max(place[1] + move[1], 0), 3))
    assert (place == (3, 0)) is arrives


def test_learners_find_the_goal_and_q_learning_the_shortest_way() -> None:
    last = [row for row in rows(charts.paths()) if row.get("doubled") == 9]
    on = {(row["x"], row["y"]) for row in last if row["on"]}
    edge = {(0, 0), (0, 1), (1, 1), (2, 1), (3, 1)}  # past the cliff to the goal at (3, 0)
    assert {(x, y) for x, y in on if x < 4 and y < 4} == edge  # shaped
    assert {(x, y - 5) for x, y in on if x < 4 and y > 4} == edge
    # Sarsa keeps away from at least one of the two cells above the cliff.
    assert not {(6, 1), (7, 1)} <= on
    assert not {(6, 6), (7, 6)} <= on


def test_every_robot_has_nine_networks_and_one_on_hills_seven() -> None:
    nets, last = defaultdict(set), defaultdict(int)
    for row in rows(charts.learning()):
        nets[row["task"]].add(row["architecture"])
        last[row["task"]] = max(row["steps"], last[row["task"]])
    long = "HalfCheetah, 25 million steps"
    assert len(nets[long]) == 7
    assert 25_000_000 <= last[long] < 25_500_000
    flat = {task for task in nets if not task.endswith((" on hills", " million steps"))}
    assert len(flat) == 5
    assert {len(nets[task]) for task in flat} == {9}
    assert len(nets["HalfCheetah on hills"]) == 7
    assert last["HalfCheetah"] >= 3_000_000  # the study's runs and not the shorter ones


def test_networks_have_the_colours_of_figure_5_3() -> None:
    scale = charts.learning().to_dict()["encoding"]["color"]["scale"]
    colour = dict(zip(scale["domain"], scale["range"], strict=True))
    assert set(colour) == {row["architecture"] for row in rows(charts.learning())}
    assert [colour[net] for net in NETS] == [*COLOURS[: len(NETS)]]


def test_the_page_holds_picture_words_and_chart() -> None:
    page = charts._page("law", "Words.", {"title": "</script>"})
    assert "![Words.](/book/_generated/chart-law.svg)" in page
    (data,) = re.findall(r'<script type="application/json">(.*)</script>', page)
    assert json.loads(data) == {"title": "</script>"}
