"""The worlds of chapter 5: robots, tasks, terrain, perturbations, and many of them at once."""

from thesis_lib.locomotion import _mujoco  # noqa: F401 - before all that import mujoco
from thesis_lib.locomotion.batch import BatchTask, Step
from thesis_lib.locomotion.envs import LocomotionEnv, LocomotionVectorEnv
from thesis_lib.locomotion.robots import ROBOTS, Robot
from thesis_lib.locomotion.tasks import TASKS, Task, make_task

__all__ = [
    "ROBOTS",
    "TASKS",
    "BatchTask",
    "LocomotionEnv",
    "LocomotionVectorEnv",
    "Robot",
    "Step",
    "Task",
    "make_task",
]
