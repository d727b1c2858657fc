"""Policy-gradient learning: algorithms 5 and 6, and what they are made of."""

from thesis_lib.optimisation.baseline import Baseline, LinearBaseline, baseline_features
from thesis_lib.optimisation.conjugate_gradient import Solution, conjugate_gradient
from thesis_lib.optimisation.gymnasium_task import GymnasiumTask
from thesis_lib.optimisation.learner import Learner
from thesis_lib.optimisation.natural import NaturalPG, full_step, natural_direction
from thesis_lib.optimisation.ppo import PPO
from thesis_lib.optimisation.problem import (
    Algorithm,
    Batch,
    LocalProblem,
    UpdateReport,
    Value,
    make_batch,
)
from thesis_lib.optimisation.regulator import LinearQuadraticTask
from thesis_lib.optimisation.returns import advantages, discounted_returns, standardised
from thesis_lib.optimisation.rollouts import Rollouts, collect, run_episodes
from thesis_lib.optimisation.trpo import TRPO
from thesis_lib.optimisation.value_network import ValueNetwork
from thesis_lib.optimisation.vector_task import VectorTask
from thesis_lib.optimisation.vpg import VPG

__all__ = [
    "PPO",
    "TRPO",
    "VPG",
    "Algorithm",
    "Baseline",
    "Batch",
    "GymnasiumTask",
    "Learner",
    "LinearBaseline",
    "LinearQuadraticTask",
    "LocalProblem",
    "NaturalPG",
    "Rollouts",
    "Solution",
    "UpdateReport",
    "Value",
    "ValueNetwork",
    "VectorTask",
    "advantages",
    "baseline_features",
    "collect",
    "conjugate_gradient",
    "discounted_returns",
    "full_step",
    "make_batch",
    "natural_direction",
    "run_episodes",
    "standardised",
]
