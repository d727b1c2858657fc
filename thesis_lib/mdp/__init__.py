"""Finite Markov decision processes: models, planning and learning (chapter 2)."""

from thesis_lib.mdp.environment import TabularEnv
from thesis_lib.mdp.evaluation import Values, evaluate, start_value
from thesis_lib.mdp.greedy import epsilon_greedy, greedy_actions, tie_tolerance
from thesis_lib.mdp.learning import Learned, learn
from thesis_lib.mdp.model import MDP, Outcomes, TabularMDP
from thesis_lib.mdp.occupancy import average_reward, stationary_distribution
from thesis_lib.mdp.planning import (
    PolicyIteration,
    Solution,
    ValueIteration,
    policy_iteration,
    soft_policy_iteration,
    solve,
    value_iteration,
)

__all__ = [
    "MDP",
    "Learned",
    "Outcomes",
    "PolicyIteration",
    "Solution",
    "TabularEnv",
    "TabularMDP",
    "ValueIteration",
    "Values",
    "average_reward",
    "epsilon_greedy",
    "evaluate",
    "greedy_actions",
    "learn",
    "policy_iteration",
    "soft_policy_iteration",
    "solve",
    "start_value",
    "stationary_distribution",
    "tie_tolerance",
    "value_iteration",
]
