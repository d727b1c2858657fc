"""The five tasks of section 5.1.1, read off their models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import pandas as pd

from thesis_lib import published
from thesis_lib.edition.criteria import exact, judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, criterion, effect_of
from thesis_lib.locomotion.robots import ROBOTS, build_model, total_mass
from thesis_lib.locomotion.tasks import HORIZON, TEST_HORIZON, Limits, make_task
from thesis_lib.published import TASKS

PRINTED: Mapping[str, tuple[int, int, int]] = MappingProxyType(
    {
        "Swimmer": (3, 2, 22),
        "Hopper": (4, 3, 20),
        "HalfCheetah": (9, 6, 20),
        "Walker2d": (7, 6, 21),
        "Ant": (13, 8, 125),
    }
)
"""Rigid links, actuated joints and entries of the observation as section 5.1.1 states them."""


@dataclass(frozen=True)
class Config:
    """Nothing to choose: the table is read off the models."""


@dataclass(frozen=True)
class Task:
    """A robot and its task."""

    task: str
    """Name of the robot and its task."""
    links: int
    """Rigid bodies of the model."""
    links_printed: int
    """Rigid links the text states."""
    joints: int
    """Actuators, that is entries of the action."""
    joints_printed: int
    """Actuated joints the text states."""
    degrees_of_freedom: int
    """Of the model, the free or planar root included."""
    mass: float
    """Kilograms."""
    observation: int
    """Entries of the observation in the author's code."""
    observation_text: int
    """Entries of the observation under the reading of the text."""
    observation_printed: int
    """Entries of the observation the text states."""
    timestep_ms: float
    """Physics timestep [ms]."""
    integrator: str
    """Euler or RK4."""
    control_hz: float
    """Actions per second."""
    episode_s: float
    """Seconds in 500 control steps."""
    control_cost: float
    """Reward lost per squared action."""
    control_cost_text: float
    """The same under the reading of the text."""
    contact_cost: float
    """Reward lost per squared clipped contact force."""
    alive_bonus: float
    """Reward of every step."""
    ends: str
    """What ends an episode in training."""
    ends_in_tests: str
    """What ends an episode in the author's test mode."""


def _limits(limits: Limits | None) -> str:
    """Termination in words, as a Markdown cell."""
    if limits is None:
        return "never"
    parts = []
    if limits.low > -np.inf:
        parts.append(f"$z < {limits.low:g}$")
    if limits.high < np.inf:
        parts.append(f"$z > {limits.high:g}$")
    if limits.pitch < np.inf:
        parts.append(f"$\\lvert\\theta_y\\rvert > {limits.pitch:g}$")
    return " or ".join(parts)


@experiment(
    "ch5-tasks",
    item="Section 5.1.1",
    smoke=Config(),
    book=Config(),
    seconds=0.02,
)
def by_robot(config: Config, context: Context) -> list[Task]:
    """The five tasks: sizes, rates, rewards and limits."""
    records = []
    for name, robot in ROBOTS.items():
        task, text = make_task(name), make_task(name, reading="text")
        model = build_model(name)
        links, joints, observation = PRINTED[name]
        records.append(
            Task(
                task=name,
                links=model.nbody - 1,
                links_printed=links,
                joints=robot.action_size,
                joints_printed=joints,
                degrees_of_freedom=robot.nv,
                mass=total_mass(model),
                observation=task.observation_size,
                observation_text=text.observation_size,
                observation_printed=observation,
                timestep_ms=1000 * robot.timestep,
                integrator=robot.integrator,
                control_hz=1 / robot.control_dt,
                episode_s=HORIZON * robot.control_dt,
                control_cost=task.control_cost,
                control_cost_text=text.control_cost,
                contact_cost=task.contact_cost,
                alive_bonus=task.alive_bonus,
                ends=_limits(task.limits),
                ends_in_tests=_limits(make_task(name, termination="test").limits),
            )
        )
    return records


@criterion("5.1-observation-sizes", by_robot)
def observation_sizes(table: pd.DataFrame) -> Finding:
    """Entries of the observation against the printed ones, under either reading."""
    by = table.set_index("task")
    agree = by.observation == by.observation_printed
    sizes = ", ".join(f"{robot} {size}" for robot, size in by.observation.items())
    evidence = f"The author's code gives {sizes}."
    for row in by[~agree].itertuples():
        evidence += (
            f" The text says {row.observation_printed} for the {row.Index}; with the previous "
            f"action, which recurrent networks are fed, it has {row.observation_text}."
        )
    return judged(agree.all(), evidence)


@criterion("5.1-links-joints", by_robot)
def links_and_joints(table: pd.DataFrame) -> Finding:
    """Rigid bodies and actuators of the models against the printed ones."""
    links, joints = table.links == table.links_printed, table.joints == table.joints_printed
    evidence = f"Actuated joints agree for {joints.sum()} of {len(table)} robots, links for "
    evidence += f"{links.sum()}."
    for row in table[~links].itertuples():
        evidence += f" The {row.task} has {row.links} rigid bodies, not {row.links_printed}."
    return exact(links.all() and joints.all(), evidence)


@effect_of("5.1-terrain-extent", by_robot)
def distance_of_the_best(table: pd.DataFrame) -> str:
    """How far the best printed controllers get, by their returns."""
    by = table.set_index("task")
    printed = published.load("table-c.1")
    ways = []
    for name in ("Hopper", "Ant"):
        own = printed[(printed.task == TASKS[name]) & (printed.trained_on == "flat")]
        # Forward velocity is summed over steps, so a return of R is R / rate metres.
        earned = own.value.max() - TEST_HORIZON * by.alive_bonus[name]
        ways.append(f"{earned / by.control_hz[name]:.0f} m ({name})")
    return (
        f"The best printed returns on flat ground mean ways of at least {' and '.join(ways)} in "
        "1000 steps, off the author's maps."
    )


def sizes(table: pd.DataFrame) -> pd.DataFrame:
    """What the robots are and sense, ours beside the printed sizes."""
    return pd.DataFrame(
        {
            "task": table.task,
            "mass [kg]": table.mass,
            "links": _beside(table.links, table.links_printed),
            "motors": _beside(table.joints, table.joints_printed),
            "sensors": _beside(table.observation, table.observation_printed),
            "rate [Hz]": table.control_hz.round().astype(int),
            "episode [s]": table.episode_s,
        }
    )


def _beside(ours: pd.Series, printed: pd.Series) -> list[str]:
    return [
        f"{a} ({b})" if a == b else f"**{a}** ({b})" for a, b in zip(ours, printed, strict=True)
    ]


def rewards(table: pd.DataFrame) -> pd.DataFrame:
    """What each task pays and when an episode ends."""
    cost = [
        f"{c:g}" if c == p else f"**{c:g}** (text {p:g})"
        for c, p in zip(table.control_cost, table.control_cost_text, strict=True)
    ]
    return pd.DataFrame(
        {
            "task": table.task,
            "$c_a$": cost,
            "$c_F$": [f"{c:g}" for c in table.contact_cost],
            "$b$": [f"{b:g}" for b in table.alive_bonus],
            "an episode ends if": table.ends,
            "in tests, if": table.ends_in_tests,
        }
    )
