"""Potential functions for multi-task reinforcement learning (chapter 3).

The means over tasks that make the three potentials stand in ``averages`` (eqs 3.3 to 3.8),
optimal initialisation for planning in ``theorem_1``, the value of one policy for all tasks in
``cross_task_problem`` and the search for the best in ``cross_task_policy``.
"""

from thesis_lib.potentials.averages import (
    WEIGHTINGS,
    Weighting,
    constant_potential,
    cross_task_values,
    expected_squared_error,
    learning_weights,
    least_squares_weights,
    linear_cross_task_weights,
    optimal_solutions,
    pair_weights,
    policy_values,
    q_mu,
    q_star,
    q_tilde,
    soft_solutions,
    task_policies,
)

__all__ = [
    "WEIGHTINGS",
    "Weighting",
    "constant_potential",
    "cross_task_values",
    "expected_squared_error",
    "learning_weights",
    "least_squares_weights",
    "linear_cross_task_weights",
    "optimal_solutions",
    "pair_weights",
    "policy_values",
    "q_mu",
    "q_star",
    "q_tilde",
    "soft_solutions",
    "task_policies",
]
