"""The worlds of chapter 5: robots, tasks, terrain, perturbations, and many of them at once.

Importing this package registers the Gymnasium environments ``thesis/...``.
"""

from thesis_lib.locomotion.batch import BatchTask, Step
from thesis_lib.locomotion.envs import LocomotionEnv, LocomotionVectorEnv, register
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

register()
