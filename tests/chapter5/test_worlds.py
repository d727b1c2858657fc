"""The opening of chapter 5: its tables against hand calculation, its judges on both sides."""

from __future__ import annotations

import inspect
import tomllib
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from thesis_lib import chapter5
from thesis_lib.chapter5 import (
    ground,
    noise,
    open_loop_tests,
    pictures,
    recovery,
    score,
    tasks,
    untrained,
)
from thesis_lib.chapter5.open_loop import NAME, SMOKE_SEARCH, Gait, find_gait
from thesis_lib.edition.chapters import read_chapter
from thesis_lib.edition.ledger import Verdict
from thesis_lib.locomotion import rendering
from thesis_lib.locomotion.batch import BatchTask
from thesis_lib.locomotion.height_field import HeightField
from thesis_lib.locomotion.robots import ROBOTS

OPENING = (
    *(tasks.by_robot, ground.maps, ground.starts, untrained.episodes, recovery.runs),
    *(noise.by_sensor, open_loop_tests.runs),
)
#: The modules on worlds, networks and learning, which precede those of the benchmark.
WORDS = Path(str(chapter5.__file__)).with_name("claims.toml").read_text(encoding="utf-8")
MODULES = tomllib.loads(WORDS)["modules"]
CHAPTER = read_chapter(chapter5, MODULES[: MODULES.index("calibration")])
BY_ID = {claim.id: claim for claim in CHAPTER.claims}


@pytest.fixture(scope="module")
def tables() -> dict[str, pd.DataFrame]:
    return {e.id: e.run("smoke", workers=2).table for e in OPENING}


@pytest.mark.parametrize("experiment", OPENING, ids=lambda e: e.id)
def test_same_seed_same_table_for_any_number_of_workers(experiment, tables) -> None:
    again = experiment.run("smoke", workers=1).table
    pd.testing.assert_frame_equal(again, tables[experiment.id])


# ------------------------------------------------------------------------------------ tables


def test_tasks_are_those_of_section_5_1_1(tables) -> None:
    table = tables["ch5-tasks"].set_index("task")
    assert table.observation.to_dict() == {
        "Swimmer": 20,
        "Hopper": 20,
        "HalfCheetah": 20,
        "Walker2d": 21,
        "Ant": 125,
    }
    assert table.observation_text["Swimmer"] == 22
    assert table.joints.tolist() == [2, 3, 6, 6, 8]
    assert table.episode_s.tolist() == pytest.approx([12.5, 10, 5, 2.5, 10])
    assert table.control_cost["HalfCheetah"] == 0.05
    assert table.control_cost_text["HalfCheetah"] == 0.005
    assert table.ends["Hopper"] == r"$z < 0.7$ or $\lvert\theta_y\rvert > 0.2$"
    assert table.ends["Ant"] == "$z < 0.2$ or $z > 1$"
    assert table.ends_in_tests["Ant"] == "never"


def test_hilltops_are_counted_inside_the_map() -> None:
    """Two tops inside, one on the edge that does not count, on 4 x 6 inner cells of 1 m."""
    heights = np.zeros((6, 8))
    heights += 0.01 * np.arange(48).reshape(6, 8)  # a tilt, so that no plain is level
    heights[2, 2], heights[3, 5], heights[0, 4] = 5, 6, 7
    field = HeightField(heights, (3.5, 2.5))
    assert ground.tops_per_area(field) == pytest.approx(2 / 24)


def test_terrain_of_the_swimmer_is_half_as_high_and_of_the_text_steeper(tables) -> None:
    by = tables["ch5-terrain"].groupby(["preset", "colour_map", "task", "difficulty"]).mean()
    assert by.highest["author", False, "Swimmer", 1.0] == pytest.approx(0.5, rel=0.02)
    assert by.highest["author", False, "Hopper", 1.0] == pytest.approx(1.0, rel=0.02)
    ratio = (
        by.p95_slope["text", False, "Hopper", 1.0] / by.p95_slope["author", False, "Hopper", 1.0]
    )
    assert ratio > 2
    # Half the scale in x and y as on the ant's map: slopes times 2.5 / 2, on the same seeds.
    assert by.p95_slope["author", False, "Hopper", 1.0] == pytest.approx(
        1.25 * by.p95_slope["author", False, "Ant", 1.0], rel=0.05
    )


def test_starts_on_the_centred_patch_are_those_on_the_flat(tables) -> None:
    """The same reset noise, so the same depth, to the height field's single precision."""
    table = tables["ch5-starts"].set_index(["task", "patch", "map"]).depth.sort_index()
    for robot in ROBOTS:
        np.testing.assert_allclose(
            table.loc[robot, "centred"], table.loc[robot, "flat floor"], atol=1e-3
        )
    assert table.xs("none", level="patch").max() > table.xs("flat floor", level="patch").max()


def test_baseline_returns_are_the_sum_of_their_parts(tables) -> None:
    table = tables["ch5-untrained"]
    parts = table[["forward", "control", "contact", "alive", "divergence"]].sum(axis=1)
    np.testing.assert_allclose(parts, table.episode_return, atol=1e-9)
    hopper = table[table.task == "Hopper"]
    np.testing.assert_allclose(hopper.alive, 0.1 * hopper.length)


def test_untrained_controllers_are_standard_normal_and_each_worlds_own() -> None:
    seeds = np.random.SeedSequence(0).spawn(3)
    together, alone = (untrained.untrained("Ant", own) for own in (seeds, seeds[1:2]))
    drawn = np.array([together(t) for t in range(400)])
    np.testing.assert_array_equal(drawn[:, 1:2], [alone(t) for t in range(400)])
    # 9600 draws: four standard errors.
    assert abs(drawn.mean()) < 4 / np.sqrt(drawn.size)
    assert abs(drawn.var() - 1) < 4 * np.sqrt(2 / drawn.size)


def test_a_gait_swings_as_its_equation_says() -> None:
    """Swimmer: 40 actions a second, so step 10 of a 1 Hz gait is a quarter turn later."""
    act = Gait("Swimmer", 1.0, (0.5, 2.0), (0.0, np.pi / 2), (0.1, 0.0)).controller(2)
    np.testing.assert_allclose(act(0), [[0.1, 1.0]] * 2)  # 2 sin(pi/2), clipped to 1
    np.testing.assert_allclose(act(10), [[0.6, 0.0]] * 2, atol=1e-12)


def test_gaits_are_found_again_and_differ_between_searches() -> None:
    first = find_gait("Hopper", SMOKE_SEARCH, 3)
    assert inspect.unwrap(find_gait)("Hopper", SMOKE_SEARCH, 3) == first
    assert find_gait("Hopper", SMOKE_SEARCH, 3, 1) != first
    assert len(first.amplitude) == len(first.phase) == len(first.offset) == 3


def test_search_improves_the_gait() -> None:
    """A real but short search for the half-cheetah earns more than its first guess."""
    from dataclasses import replace

    budget = replace(SMOKE_SEARCH, population=16, elite=4, seconds=2.0)
    earned = []
    for generations in (1, 8):
        gait = find_gait("HalfCheetah", replace(budget, generations=generations), 0)
        batch = BatchTask("HalfCheetah", 8, seed=1, max_episode_steps=200)
        batch.reset()
        act = gait.controller(8)
        for t in range(200):
            step = batch.step(act(t))
        earned.append(step.info.episode_return.mean())
    assert earned[1] > earned[0] + 20


def test_noise_cannot_touch_a_controller_without_sensors(tables) -> None:
    table = tables["ch5-open-loop"].set_index(["condition", "task", "search", "run"])
    earned = table.episode_return
    np.testing.assert_array_equal(earned["noise"], earned["base"])


def test_world_contacts_of_the_ant_are_always_zero(tables) -> None:
    table = tables["ch5-noise"]
    ant = table[(table.task == "Ant") & (table.group == "contact force")]
    world = ant[ant.sensor.str.contains("world")]
    assert len(world) == 12  # six entries under two controllers
    assert (world.zero == 1).all()
    assert (world.sd == 0).all()


# ------------------------------------------------------------------------------------- judges


def judged(name: str, tables: dict[str, pd.DataFrame] | None = None) -> Verdict:
    return BY_ID[name].judge(tables or {}).verdict


def test_sizes_and_links_are_judged_on_both_sides(tables) -> None:
    table = tables["ch5-tasks"]
    assert judged("5.1-observation-sizes", tables) == Verdict.NOT_REPRODUCED
    assert judged("5.1-links-joints", tables) == Verdict.REFUTED
    right = table.assign(observation=table.observation_printed, links=table.links_printed)
    assert judged("5.1-observation-sizes", {"ch5-tasks": right}) == Verdict.REPRODUCED
    assert judged("5.1-links-joints", {"ch5-tasks": right}) == Verdict.REPRODUCED


def terrain_table(**columns) -> pd.DataFrame:
    base = {
        "preset": ["author", "author", "text", "text"] * 2,
        "task": "Hopper",
        "difficulty": [0.5, 1.0] * 4,
        "colour_map": False,
        "map": [0, 0, 0, 0, 1, 1, 1, 1],
        "highest": [0.5, 1.0] * 4,
        "p95_slope": [0.2, 0.4] * 4,
        "tops": [0.3, 0.29, 0.3, 0.3] * 2,
    }
    return pd.DataFrame({**base, **columns})


@pytest.mark.parametrize(
    ("claim", "columns", "verdict"),
    [
        ("5.1-hilltop-density", {}, Verdict.REPRODUCED),
        ("5.1-hilltop-density", {"tops": 0.2}, Verdict.NOT_REPRODUCED),
        ("5.1-height-difficulty", {}, Verdict.REPRODUCED),
        ("5.1-height-difficulty", {"highest": [0.25, 0.5] * 4}, Verdict.DIRECTION),
        ("5.1-steepness-difficulty", {}, Verdict.REPRODUCED),
        ("5.1-steepness-difficulty", {"p95_slope": 0.3}, Verdict.REFUTED),
    ],
)
def test_terrain_claims_are_judged_on_both_sides(claim, columns, verdict) -> None:
    assert judged(claim, {"ch5-terrain": terrain_table(**columns)}) == verdict


def noise_rows(angle: float, velocity: float, other: float, zero: float = 0.9) -> pd.DataFrame:
    """One joint angle of range ±2 sd, one joint velocity, one contact force."""
    kinds = {"joint angle": angle, "joint velocity": velocity, "contact force": other}
    return pd.DataFrame(
        [
            {
                "task": "Ant",
                "controller": controller,
                "group": group,
                "sd": sd,
                "low": -2 * sd,
                "high": 2 * sd,
                "zero": zero if group == "contact force" else 0.0,
                "sigma": 1.0,
            }
            for controller in ("untrained", NAME)
            for group, sd in kinds.items()
        ]
    )


@pytest.mark.parametrize(
    ("claim", "table", "verdict"),
    [
        ("5.1-joint-angles", noise_rows(0.7, 3, 1), Verdict.REPRODUCED),  # range ±1.4
        ("5.1-joint-angles", noise_rows(0.8, 3, 1), Verdict.REFUTED),  # range ±1.6
        ("5.1-joint-velocities", noise_rows(0.7, 3, 1), Verdict.REPRODUCED),
        ("5.1-joint-velocities", noise_rows(0.7, 0.6, 1), Verdict.NOT_REPRODUCED),
        ("5.1-sigma-significant", noise_rows(0.7, 3, 1), Verdict.REPRODUCED),  # 2 of 3 hit
        ("5.1-sigma-significant", noise_rows(0.7, 3, 3), Verdict.NOT_REPRODUCED),  # 1 of 3
        ("5.1-sigma-significant", noise_rows(0.7, 3, 0), Verdict.NOT_REPRODUCED),  # 1 of 2 moving
        ("5.1-contacts-sparse", noise_rows(0.7, 3, 1, zero=0.9), Verdict.REPRODUCED),
        ("5.1-contacts-sparse", noise_rows(0.7, 3, 1, zero=0.4), Verdict.NOT_REPRODUCED),
    ],
)
def test_noise_claims_are_judged_on_both_sides(claim, table, verdict) -> None:
    assert judged(claim, {"ch5-noise": table}) == verdict


@pytest.mark.parametrize(
    ("after", "spread", "verdict"),
    [
        (2.0, 0.2, Verdict.REPRODUCED),  # equal
        (3.0, 0.2, Verdict.REPRODUCED),  # better than from a reset
        (1.0, 0.2, Verdict.REFUTED),  # half the way
        (1.5, 2.0, Verdict.INCONCLUSIVE),  # on the margin
    ],
)
def test_recovery_is_judged_on_both_sides(after, spread, verdict) -> None:
    z = np.linspace(-1, 1, 30)
    table = pd.DataFrame(
        {
            "task": "Swimmer",
            "start": np.repeat(["reset", "struggle"], 30),
            "distance": np.r_[2 + 0.1 * z, after + spread * z],
        }
    )
    assert judged("5.1-swimmer-recovers", {"ch5-recovery": table}) == verdict


def test_statements_on_the_score_are_exact() -> None:
    """By hand: r = (1, -1/2) scores 1 - 3/2 = -1/2; the others are arithmetic too."""
    assert judged("5.3-score-range") == Verdict.REFUTED
    assert "-0.50" in BY_ID["5.3-score-range"].judge({}).evidence
    for name in ("5.3-score-one", "5.3-score-others", "5.3-self-scoring", "5.3-slowing"):
        assert judged(name) == Verdict.REPRODUCED


def test_a_score_that_is_always_1_turns_every_statement_on_it(monkeypatch) -> None:
    monkeypatch.setattr(score, "score", lambda base, perturbed, best: 1.0)
    assert judged("5.3-score-range") == Verdict.REPRODUCED
    for name in ("5.3-score-one", "5.3-score-others", "5.3-self-scoring", "5.3-slowing"):
        assert judged(name) == Verdict.REFUTED


def test_every_difference_says_what_it_changes(tables) -> None:
    computed = [d for d in CHAPTER.differences if not isinstance(d.effect, str)]
    rows = [d for d in computed if set(d.experiments) <= set(tables)]
    assert len(rows) == 9  # eight of these tables, and one of printed ones alone
    for difference in rows:
        assert callable(difference.effect)
        told = difference.effect(tables)
        assert len(told) > 20
        assert "nan" not in told


# --------------------------------------------------------------------------- figures and scores


def test_the_gaits_rank_is_counted_from_the_top() -> None:
    """A controller that nothing can stop and that earns most scores 1 and ranks first."""
    table = pd.DataFrame(
        {
            "task": "Swimmer",
            "condition": ["base", "noise", "switch"],
            "episode_return": [10_000.0, 10_000.0, 1.0],
        }
    )
    made = open_loop_tests.scores(table, ["Swimmer"]).set_index("perturbation")
    assert made[NAME]["noise"] == pytest.approx(1)
    assert made["rank of 8"]["noise"] == 1
    # Of 10000 there is 1 left: 1 (1 - 0.9999); the networks' shares of 10000 are about 0.03.
    assert made["rank of 8"]["switch"] == 8


def test_where_there_is_no_opengl_the_page_says_so() -> None:
    def fail() -> list[rendering.Image]:
        raise rendering.NoGL("No picture can be drawn because of a test.")

    figure = pictures.gallery(fail, ["one", "two"])
    assert "because of a test" in figure.axes[0].texts[0].get_text()
    plt.close(figure)


def test_pictures_stand_in_rows_under_their_titles() -> None:
    images = [np.zeros((4, 6, 3), np.uint8)] * 4
    figure = pictures.gallery(lambda: images, list("abcd"))
    assert [ax.get_title() for ax in figure.axes[:4]] == list("abcd")
    assert len(figure.axes) == 6
    plt.close(figure)


def test_a_white_sky_is_left_out_of_pictures() -> None:
    images = [np.full((40, 6, 3), 255, np.uint8) for _ in range(2)]
    images[0][30:] = images[1][20:] = 0  # one robot is taller
    figure = pictures.gallery(lambda: images, ["a", "b"])
    shapes = [ax.get_images()[0].get_array().shape for ax in figure.axes[:2]]
    assert shapes == [(28, 6, 3)] * 2  # eight rows of sky above the taller one
    plt.close(figure)


def test_a_run_across_the_switch_is_told_in_order() -> None:
    states, ground, told = open_loop_tests.crossing(SMOKE_SEARCH, 0, worlds=2, frames=4)
    assert states.shape == (4, 9)
    assert len(told) == 4
    assert ground.floor == 0.0
    assert (np.diff(states[:, 0]) >= 0).all()


def test_a_robot_on_a_hill_keeps_its_clearance() -> None:
    field = HeightField(np.array([[0.0, 0.0], [2.0, 2.0]]), (5.0, 5.0), z_offset=-0.1)
    pose = pictures.on_hills("Ant", field, 1.0, 2.5)
    # Three quarters up a slope of 2 m, 0.1 m deep, and 0.55 m above it.
    np.testing.assert_allclose(pose[:3], [1.0, 2.5, 1.5 - 0.1 + 0.55])


def test_every_perturbation_is_in_the_table() -> None:
    table = score.perturbation_table()
    assert not table["what it does"].str.contains(":class:").any()
    assert list(table.object) == [
        *("WhiteNoise", "TerrainSwitch", "SensorSubset"),  # the thesis's, then ours
        *("CorrelatedNoise", "SensorFailure", "ActuatorFailure"),
        *("ActionDelay", "MassChange", "FrictionChange", "Push"),
    ]
