"""What can be chosen about a task by name: ground, perturbations, reading of the thesis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from thesis_lib.locomotion.batch import BatchTask, Perturbation
from thesis_lib.locomotion.perturbations import (
    NOISE_ONSET,
    SensorSubset,
    WhiteNoise,
    occlusion,
)
from thesis_lib.locomotion.robots import Ground
from thesis_lib.locomotion.tasks import Reading, Task, Termination, make_task
from thesis_lib.locomotion.terrain import hill_maps


@dataclass(frozen=True)
class TaskOptions:
    """What the keyword arguments of both environments choose, besides their form.

    Attributes
    ----------
    robot
        Swimmer, Hopper, HalfCheetah, Walker2d or Ant.
    reading, termination, control_cost, alive_bonus
        As in :func:`~thesis_lib.locomotion.tasks.make_task`.
    difficulty
        Height of the hills in metres; None for the flat floor.
    terrain_seed
        Decides the hills, as the seed of :func:`~thesis_lib.locomotion.terrain.hill_maps`.
    terrain_preset, resolution
        As ``preset`` and ``resolution`` of :func:`~thesis_lib.locomotion.terrain.hills`.
    switch_at
        World x in metres where flat ground gives way to hills, or ``"task"`` for the
        robot's own; None for hills from the start.
    terrain
        A ground of one's own instead, or one for each world.
    noise, noise_from
        Standard deviation of white noise on all sensors, and the step it starts at.
    sensors
        Names or indices of the sensors the policy is left with, or ``"subset"`` for those
        the thesis leaves to recurrent networks; None for all.
    perturbations
        Further perturbations, at work after those above.
    bad_actions
        As in :class:`~thesis_lib.locomotion.batch.BatchTask`.
    """

    robot: str
    reading: Reading = "code"
    termination: Termination = "train"
    control_cost: float | None = None
    alive_bonus: float | None = None
    difficulty: float | None = None
    terrain_seed: int = 0
    terrain_preset: Literal["author", "text"] = "author"
    resolution: float | None = None
    switch_at: float | Literal["task"] | None = None
    terrain: Ground | Sequence[Ground] | None = None
    noise: float = 0.0
    noise_from: int = NOISE_ONSET
    sensors: Sequence[str | int] | Literal["subset"] | None = None
    perturbations: Sequence[Perturbation] = ()
    bad_actions: Literal["raise", "end"] = "raise"

    def task(self) -> Task:
        """Build the task."""
        return make_task(
            self.robot,
            reading=self.reading,
            termination=self.termination,
            control_cost=self.control_cost,
            alive_bonus=self.alive_bonus,
        )

    def grounds(self, n_maps: int, num_envs: int) -> Ground | list[Ground] | None:
        """Draw the maps, or take those given: worlds take turns on ``n_maps`` maps."""
        if self.difficulty is None:
            if self.switch_at is not None:
                raise ValueError(
                    f"switch_at is {self.switch_at!r}, but there are no hills to switch to; "
                    "give a difficulty."
                )
            return self.terrain if not isinstance(self.terrain, Sequence) else list(self.terrain)
        if self.terrain is not None:
            raise ValueError("Both terrain and difficulty are given; give one of them.")
        maps = hill_maps(
            n_maps,
            self.difficulty,
            self.terrain_seed,
            robot=self.robot,
            preset=self.terrain_preset,
            resolution=self.resolution,
            switch_at=self.switch_at,
        )
        return [maps[i % n_maps] for i in range(num_envs)]

    def all_perturbations(self) -> list[Perturbation]:
        """Sensor subset first, then noise on what is left, then the further ones."""
        chosen: list[Perturbation] = []
        if self.sensors == "subset":
            subset = occlusion(self.robot)
            chosen += [] if subset is None else [subset]
        elif self.sensors is not None:
            chosen.append(SensorSubset(tuple(self.sensors)))
        if self.noise:
            chosen.append(WhiteNoise(self.noise, self.noise_from))
        return [*chosen, *self.perturbations]

    def batch(self, num_envs: int, *, n_maps: int = 1, **options: Any) -> BatchTask:
        """Build the batch of worlds."""
        task = self.task()  # first, so that an unknown robot is named before its terrain
        return BatchTask(
            task,
            num_envs,
            terrain=self.grounds(n_maps, num_envs),
            perturbations=self.all_perturbations(),
            bad_actions=self.bad_actions,
            **options,
        )


def task_options(robot: str, options: dict[str, Any]) -> TaskOptions:
    """Options from keyword arguments; an unknown one is refused with the known ones."""
    known = TaskOptions.__dataclass_fields__
    for name in options:
        if name not in known:
            raise ValueError(f"There is no option {name!r}; the options are {', '.join(known)}.")
    return TaskOptions(robot, **options)
