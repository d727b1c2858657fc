"""The tasks and terrains of section 5.1 as tables: what they are, before anything learns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd
from scipy.ndimage import maximum_filter

from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.locomotion.batch import BatchTask
from thesis_lib.locomotion.robots import ROBOTS, Ground, build_model, total_mass
from thesis_lib.locomotion.tasks import HORIZON, Limits, make_task
from thesis_lib.locomotion.terrain import PRESETS, Extent, HeightField, hill_maps

PRINTED: Mapping[str, Mapping[str, int]] = MappingProxyType(
    {
        "Swimmer": {"links": 3, "joints": 2, "observation": 22},
        "Hopper": {"links": 4, "joints": 3, "observation": 20},
        "HalfCheetah": {"links": 9, "joints": 6, "observation": 20},
        "Walker2d": {"links": 7, "joints": 6, "observation": 21},
        "Ant": {"links": 13, "joints": 8, "observation": 125},
    }
)
"""Rigid links, actuated joints and entries of the observation as section 5.1.1 states them."""

SQUARE: Extent = ((-20.0, 20.0), (-20.0, 20.0))
"""Map on which terrain is measured, metres."""


# ------------------------------------------------------------------------------------ tasks


@dataclass(frozen=True)
class TasksConfig:
    """Nothing to choose: the table is read off the models."""


def _limits(limits: Limits | None) -> str:
    """Termination in words, as a Markdown cell."""
    if limits is None:
        return "never"
    told = []
    if limits.low > -np.inf:
        told.append(f"$z < {limits.low:g}$")
    if limits.high < np.inf:
        told.append(f"$z > {limits.high:g}$")
    if limits.pitch < np.inf:
        told.append(f"$\\lvert\\theta_y\\rvert > {limits.pitch:g}$")
    return " or ".join(told)


def tasks(config: TasksConfig, context: Context) -> pd.DataFrame:
    """Read the five tasks off their models; columns are documented in :data:`TASKS`."""
    records = []
    for name, robot in ROBOTS.items():
        task, text = make_task(name), make_task(name, reading="text")
        model = build_model(name)
        records.append(
            {
                "robot": name,
                "links": model.nbody - 1,
                "links_printed": PRINTED[name]["links"],
                "joints": robot.action_size,
                "joints_printed": PRINTED[name]["joints"],
                "degrees_of_freedom": robot.nv,
                "mass": total_mass(model),
                "observation": task.observation_size,
                "observation_text": text.observation_size,
                "observation_printed": PRINTED[name]["observation"],
                "timestep_ms": 1000 * robot.timestep,
                "integrator": robot.integrator,
                "control_hz": 1 / robot.control_dt,
                "episode_s": HORIZON * robot.control_dt,
                "control_cost": task.control_cost,
                "control_cost_text": text.control_cost,
                "contact_cost": task.contact_cost,
                "alive_bonus": task.alive_bonus,
                "ends": _limits(task.limits),
                "ends_in_tests": _limits(make_task(name, termination="test").limits),
            }
        )
    return rows(records)


TASKS = Experiment(
    id="tasks-5.1",
    item="Section 5.1.1",
    title="The five tasks: sizes, rates, rewards and limits",
    function=tasks,
    budgets={"smoke": TasksConfig(), "book": TasksConfig(), "thesis": TasksConfig()},
    columns={
        "robot": "name of the robot and its task",
        "links": "rigid bodies of the model",
        "links_printed": "rigid links the text states",
        "joints": "actuators, that is entries of the action",
        "joints_printed": "actuated joints the text states",
        "degrees_of_freedom": "of the model, the free or planar root included",
        "mass": "kg",
        "observation": "entries of the observation in the author's code",
        "observation_text": "entries of the observation under the reading of the text",
        "observation_printed": "entries of the observation the text states",
        "timestep_ms": "physics timestep, ms",
        "integrator": "Euler or RK4",
        "control_hz": "actions per second",
        "episode_s": "seconds in 500 control steps",
        "control_cost": "reward lost per squared action",
        "control_cost_text": "the same under the reading of the text",
        "contact_cost": "reward lost per squared clipped contact force",
        "alive_bonus": "reward of every step",
        "ends": "what ends an episode in training",
        "ends_in_tests": "what ends an episode in the author's test mode",
    },
    seconds={"smoke": 0.2, "book": 0.2, "thesis": 0.2},
)


# ---------------------------------------------------------------------------------- terrain


@dataclass(frozen=True)
class TerrainConfig:
    """How many maps of 40 m x 40 m are measured for each kind of terrain."""

    n_maps: int = 20


def tops_per_area(field: HeightField) -> float:
    """Visible hilltops per square metre: nodes higher than their eight neighbours.

    Nodes on the map's edge are left out, with their area.
    """
    inner = field.heights[1:-1, 1:-1]
    highest = maximum_filter(field.heights, size=3)[1:-1, 1:-1]
    dx, dy = field.resolution
    return float((inner == highest).sum() / (inner.size * dx * dy))


def terrain(config: TerrainConfig, context: Context) -> pd.DataFrame:
    """Measure maps; columns are documented in :data:`TERRAIN`."""
    kinds: list[dict[str, Any]] = [
        {"preset": "author", "robot": robot, "difficulty": difficulty, "colour_map": False}
        for robot in ROBOTS
        for difficulty in (0.5, 1.0)
    ]
    for difficulty in (0.5, 1.0):
        kinds += [
            {"preset": "author", "robot": "Hopper", "difficulty": difficulty, "colour_map": True},
            {"preset": "text", "robot": "Hopper", "difficulty": difficulty, "colour_map": False},
        ]

    def measure(kind: dict[str, Any]) -> list[dict[str, Any]]:
        # All kinds see the same seeds: difficulty and robot scale one set of hills.
        (seed,) = context.seeds(1, 5, 1)
        law = PRESETS[kind["preset"]]
        unit = law.metres[kind["robot"]]
        maps = hill_maps(config.n_maps, seed=seed, extent=SQUARE, flat_patch=None, **kind)
        return [
            {
                **kind,
                "map": i,
                "metres": unit,
                "highest": field.heights.max(),
                "median_height": np.median(field.heights),
                "median_slope": np.median(field.slope()),
                "p95_slope": np.quantile(field.slope(), 0.95),
                "steepest_flank": law.steepest(kind["robot"], kind["difficulty"]),
                # Plateaus of the colour map would count as tops.
                "tops": np.nan if kind["colour_map"] else tops_per_area(field) * unit**2,
                "below_floor": (field.surface < 0).mean(),
                "node_spacing": field.resolution[0],
            }
            for i, field in enumerate(maps)
        ]

    return rows([r for found in context.map(measure, kinds, "terrain") for r in found])


TERRAIN = Experiment(
    id="terrain-5.1",
    item="Section 5.1, Hills",
    title="Heights, slopes and hilltops of the author's terrain and the text's",
    function=terrain,
    budgets={
        "smoke": TerrainConfig(n_maps=2),
        "book": TerrainConfig(),
        "thesis": TerrainConfig(n_maps=100),
    },
    columns={
        "preset": "author (code) or text (section 5.1 in metres)",
        "robot": "for which robot",
        "difficulty": "d",
        "colour_map": "whether the heights went through the colour map of the author's images",
        "map": "index of the map",
        "metres": "metres in a unit of length",
        "highest": "highest node, m",
        "median_height": "median over the map, m",
        "median_slope": "median over the map's triangles, rise over run",
        "p95_slope": "95th percentile of the same",
        "steepest_flank": "slope of the narrowest possible hill's flank, without colour map",
        "tops": "visible hilltops per square unit, missing with the colour map",
        "below_floor": "share of nodes below world z = 0",
        "node_spacing": "m",
    },
    seconds={"smoke": 1, "book": 3, "thesis": 12},
)


# ----------------------------------------------------------------------------------- starts


@dataclass(frozen=True)
class StartsConfig:
    """How many maps each robot is put down on."""

    n_maps: int = 20
    difficulties: tuple[float, ...] = (0.5, 1.0)


def starts(config: StartsConfig, context: Context) -> pd.DataFrame:
    """Put robots down as a reset does and see how deep they stick in the ground."""

    def measure(robot: str) -> list[dict[str, Any]]:
        (seed,) = context.seeds(1, 5, 2)
        found = []
        kinds: list[tuple[float, str | None]] = [(0.0, "flat floor")]
        kinds += [(d, p) for d in config.difficulties for p in ("centred", "author", None)]
        for difficulty, patch in kinds:
            maps: tuple[Ground, ...] | None = None
            under = np.full(config.n_maps, -0.1 if robot == "Swimmer" else 0.0)
            if patch != "flat floor":
                maps = hill_maps(
                    config.n_maps, difficulty, seed, robot=robot, extent=SQUARE, flat_patch=patch
                )
                under = np.array([field.ground_z(0, 0) for field in maps])
            batch = BatchTask(robot, config.n_maps, seed=seed, terrain=maps)
            batch.reset()
            for i in range(config.n_maps):
                depth = -batch.get_data(i).contact.dist
                found.append(
                    {
                        "robot": robot,
                        "difficulty": difficulty,
                        "patch": "none" if patch is None else patch,
                        "map": i,
                        "ground": under[i],
                        "depth": max(float(depth.max()), 0.0) if depth.size else 0.0,
                    }
                )
        return found

    return rows([r for found in context.map(measure, list(ROBOTS), "starts") for r in found])


STARTS = Experiment(
    id="starts-5.1",
    item="Section 5.1, Hills",
    title="How deep robots stick in the ground at a reset, by kind of start patch",
    function=starts,
    budgets={
        "smoke": StartsConfig(n_maps=2, difficulties=(1.0,)),
        "book": StartsConfig(),
        "thesis": StartsConfig(n_maps=100),
    },
    columns={
        "robot": "name",
        "difficulty": "d; 0 for the flat floor",
        "patch": "flat floor, centred (ours), author (beside the robot) or none",
        "map": "index of the map, and of the world",
        "ground": "world z of the ground at the origin, m",
        "depth": "deepest contact after the reset, m; 0 without contact",
    },
    seconds={"smoke": 1, "book": 4, "thesis": 20},
)
