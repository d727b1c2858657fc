"""What a run is made of: its task, its policy, and what it learns by."""

from __future__ import annotations

from contextlib import closing
from typing import Any

import numpy as np

from thesis_lib.locomotion import BatchTask, make_task
from thesis_lib.locomotion.perturbations import SUBSETS
from thesis_lib.locomotion.tasks import Task
from thesis_lib.locomotion.terrain import hill_maps
from thesis_lib.optimisation import (
    PPO,
    TRPO,
    VPG,
    GymnasiumTask,
    LinearBaseline,
    NaturalPG,
    ValueNetwork,
)
from thesis_lib.optimisation.problem import Algorithm
from thesis_lib.policies import GaussianPolicy, make_policy
from thesis_lib.training.config import (
    PRECISIONS,
    SEED_KEYS,
    TrainConfig,
    head_scale,
    idle_settings,
    is_robot,
    sensors,
    step_size,
    table_5_1,
)


def make_run_task(config: TrainConfig) -> Task:
    """The task of a run: robot, rewards and observations."""
    return make_task(config.task, reading=config.reading, alive_bonus=config.alive_bonus)  # type: ignore[arg-type]


def make_batch_task(config: TrainConfig) -> BatchTask | GymnasiumTask:
    """The task of a run, in its worlds."""
    num_envs = config.num_envs
    if num_envs is None:
        num_envs = max(1, min(100, config.batch_steps // config.horizon))
    if not is_robot(config.task):
        return GymnasiumTask(
            config.task, num_envs, seed=config.seed, max_episode_steps=config.horizon
        )
    terrain = None
    if config.terrain == "hill":
        seed = np.random.SeedSequence(config.seed, spawn_key=(SEED_KEYS["terrain"],))
        maps = hill_maps(config.maps, config.difficulty, seed, robot=config.task)
        terrain = [maps[i % len(maps)] for i in range(num_envs)]
    return BatchTask(
        make_run_task(config),
        num_envs,
        threads=config.threads,
        seed=config.seed,
        terrain=terrain,
        max_episode_steps=config.horizon,
    )


def make_run_policy(config: TrainConfig) -> GaussianPolicy:
    """The policy of a run before training."""
    task: Task | GymnasiumTask
    if is_robot(config.task):
        task = make_run_task(config)
        dt = task.robot.control_dt
    else:
        with closing(GymnasiumTask(config.task, 1)) as task:
            dt = task.dt
    options: dict[str, Any] = {"initial_log_std": config.initial_log_std}
    # What a sweep sets for all its runs goes to the nets that have it.
    idle = idle_settings(config)
    if config.initialisation != "glorot" and "initialisation" not in idle:
        options["initialisation"] = config.initialisation
    if config.previous_action is not None:
        options["previous_action"] = config.previous_action
    if config.architecture == "ctrnn":
        options |= {
            "integrator": config.integrator,
            "time_constant": config.time_constant,
            "time_constant_spread": config.time_constant_spread,
            "trainable_time_constant": config.trainable_time_constant,
            "constraint": config.constraint,
        }
    if config.architecture == "lstm":
        options["forget_bias"] = config.forget_bias
    if config.gate_initialisation is not None and "gate_initialisation" not in idle:
        options["initialisation"] = config.gate_initialisation
    if config.architecture == "esn":
        options["leak"] = config.leak
        for name, printed in (
            ("spectral_radius", "spectral_radius"),
            ("density", "weight_density"),
        ):
            asked = getattr(config, name)
            value = table_5_1(config.task, "esn", printed) if asked is None else asked
            if value is not None:
                options[name] = value
    reading = sensors(config)
    features = None if reading == "all" else [int(i) for i in SUBSETS[reading][config.task]]
    return make_policy(
        config.architecture,
        task.observation_size,
        task.action_size,
        dt=dt,
        seed=config.seed,
        units=None if "units" in idle else config.units,
        features=features,
        head_scale=head_scale(config),
        dtype=PRECISIONS[config.precision],
        **options,
    )


def baseline(config: TrainConfig) -> dict[str, Any]:
    """The learner's baseline, and what it is fitted to."""
    if config.baseline == "linear":
        return {"baseline": LinearBaseline(), "targets": "returns"}
    network = ValueNetwork(seed=config.seed, dtype=PRECISIONS[config.precision])
    return {"baseline": network, "targets": "lambda"}


def make_algorithm(config: TrainConfig) -> Algorithm:
    """The rule a run learns by."""
    if config.algorithm == "vpg":
        return VPG(learning_rate=config.learning_rate or 0.01)
    if config.algorithm == "ppo":
        return PPO(learning_rate=config.learning_rate or 3e-4, seed=config.seed)
    if config.algorithm == "natural":
        return NaturalPG(
            delta=step_size(config),
            cg_iterations=config.cg_iterations,
            damping=config.damping,
        )
    return TRPO(
        delta=step_size(config),
        cg_iterations=config.cg_iterations,
        damping=config.damping,
        kl_direction=config.kl_direction,
    )
