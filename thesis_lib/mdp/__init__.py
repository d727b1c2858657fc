"""Finite Markov decision processes: models, planning and learning (chapter 2)."""

from thesis_lib.mdp.greedy import epsilon_greedy, greedy_actions, tie_tolerance
from thesis_lib.mdp.learning import Learned, learn
from thesis_lib.mdp.model import MDP, Outcomes, TabularMDP

__all__ = [
    "MDP",
    "Learned",
    "Outcomes",
    "TabularMDP",
    "epsilon_greedy",
    "greedy_actions",
    "learn",
    "tie_tolerance",
]
