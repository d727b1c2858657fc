"""Finite Markov decision processes: models, planning and learning (chapter 2)."""

from thesis_lib.mdp.environment import TabularEnv
from thesis_lib.mdp.evaluation import Values, evaluate, start_value
from thesis_lib.mdp.greedy import epsilon_greedy, greedy_actions, tie_tolerance
from thesis_lib.mdp.learning import Learned, learn
from thesis_lib.mdp.model import MDP, Outcomes, TabularMDP
from thesis_lib.mdp.occupancy import average_reward, occupancy, stationary_distribution
from thesis_lib.mdp.planning import (
    PolicyIteration,
    Solution,
    ValueIteration,
    policy_iteration,
    soft_policy_iteration,
    solve,
    value_iteration,
)
from thesis_lib.mdp.simulation import Simulated, Trajectory, follow, simulate

__all__ = [
    "MDP",
    "Learned",
    "Outcomes",
    "PolicyIteration",
    "Simulated",
    "Solution",
    "TabularEnv",
    "TabularMDP",
    "Trajectory",
    "ValueIteration",
    "Values",
    "average_reward",
    "epsilon_greedy",
    "evaluate",
    "follow",
    "greedy_actions",
    "learn",
    "occupancy",
    "policy_iteration",
    "simulate",
    "soft_policy_iteration",
    "solve",
    "start_value",
    "stationary_distribution",
    "tie_tolerance",
    "value_iteration",
]
