"""Perturbations as settings and as text, for tests of trained policies."""

from __future__ import annotations

import ast
import dataclasses
import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from thesis_lib.checks import plain_settings
from thesis_lib.imports import expression
from thesis_lib.locomotion import perturbations
from thesis_lib.locomotion.batch import Perturbation
from thesis_lib.registration import find


@dataclass(frozen=True)
class Disturbances:
    """The perturbations there are, in short: each is left out unless it is asked for."""

    noise: float | None = None
    """Standard deviation of noise on all sensors, in each one's own unit."""
    correlation_time: float = 0.0
    """Control steps over which the noise is correlated; 0 is the thesis's white noise."""
    dead_sensors: tuple[str, ...] = ()
    """Sensors that read 0, by name."""
    switch_at: str | None = None
    """Flat ground that turns hilly: at x metres, or "task" where the task says so."""
    dead_actuators: tuple[str, ...] = ()
    """Motors that go limp, by name."""
    delay: int | None = None
    """Control steps by which actions are late."""
    mass: float | None = None
    """Factor on the mass of the robot."""
    friction: float | None = None
    """Factor on the friction of ground and robot."""
    push: tuple[float, float, float] | None = None
    """Push on the torso, as the change of velocity in m/s along x, y and z."""
    onset: int = perturbations.NOISE_ONSET
    """Control step from which they act; hills are met where they are."""

    def __post_init__(self) -> None:
        plain_settings(self)

    def perturbations(self, difficulty: float = 1.0, seed: int = 0) -> tuple[Perturbation, ...]:
        """What was asked for.

        Parameters
        ----------
        difficulty
            Height of the hills in metres.
        seed
            Decides the hills.

        Raises
        ------
        ValueError
            When a value is out of range.
        """
        onset = self.onset
        found: list[Perturbation] = []
        if self.switch_at is not None:
            place = _place(self.switch_at)
            found.append(perturbations.TerrainSwitch(difficulty, place, seed))
        if self.mass is not None:
            found.append(perturbations.MassChange(self.mass, onset=onset))
        if self.friction is not None:
            found.append(perturbations.FrictionChange(self.friction, onset=onset))
        if self.dead_actuators:
            found.append(perturbations.ActuatorFailure(self.dead_actuators, onset=onset))
        if self.delay is not None:
            found.append(perturbations.ActionDelay(self.delay, onset=onset))
        if self.push is not None:
            found.append(perturbations.Push(self.push, onset=onset))
        if self.noise is not None:
            if self.correlation_time == 0:
                found.append(perturbations.WhiteNoise(self.noise, onset))
            else:
                noise = perturbations.CorrelatedNoise(self.noise, onset, self.correlation_time)
                found.append(noise)
        if self.dead_sensors:
            # After the noise: a sensor that is dead does not tremble.
            found.append(perturbations.SensorFailure(self.dead_sensors, onset=onset))
        return tuple(found)


def _place(text: str) -> float | Literal["task"]:
    if text == "task":
        return "task"
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"switch_at is {text!r}, but it must be metres, or task.") from None


def known_perturbations() -> Mapping[str, type[Perturbation]]:
    """The perturbations there are, by name."""
    return {
        name: kind
        for name, kind in vars(perturbations).items()
        if inspect.isclass(kind) and issubclass(kind, Perturbation) and kind is not Perturbation
    }


def parse_perturbation(text: str) -> Perturbation:
    """Read a perturbation from text such as ``"MassChange(factor=1.5)"``.

    Parameters
    ----------
    text
        A name of :func:`known_perturbations` or one that an installed package offers
        (:mod:`thesis_lib.registration`), with its fields as keywords, or alone.

    Raises
    ------
    ValueError
        When the name or a field does not exist, or a value is out of range.
    """
    try:
        tree = expression(text.strip())
        name, given = (tree.func, tree.keywords) if isinstance(tree, ast.Call) else (tree, [])
        if not isinstance(name, ast.Name) or (isinstance(tree, ast.Call) and tree.args):
            raise ValueError
        values = {str(k.arg): ast.literal_eval(k.value) for k in given}
    except (SyntaxError, ValueError) as error:
        raise ValueError(
            f"{text!r} is not a perturbation: write a name with its fields as keywords, such as "
            "WhiteNoise(sigma=1.0, onset=100)."
        ) from error
    kind = find("perturbation", name.id, known_perturbations())
    fields = [f.name for f in dataclasses.fields(kind)]  # type: ignore[arg-type]
    for field in values:
        if field not in fields:
            raise ValueError(
                f"{name.id} has no field {field!r}: its fields are {', '.join(fields)}."
            )
    try:
        return kind(**values)
    except TypeError as error:
        raise ValueError(f"{text!r} is incomplete: {error}.") from error
