"""Chapter 3, Learning Potential Functions for Multi-Task RL: one file a result.

Each file holds a result's config with its budgets, the experiment, the criteria of the claims
that its table decides, and its figure; the claims' words stand in ``claims.toml``.  What
several results need is in ``runs``.
"""

RESULTS = (
    "shaping",
    "theorem_1",
    "levels",
    "mu_star",
    "covering_tour",
    "weights",
    "table_3_1",
    "readings",
    "q_mu_row",
    "learning_rates",
    "learners",
    "figure_3_1",
    "sarsa_solution",
    "figure_3_2",
    "huddle",
    "figure_3_3",
    "figure_3_4",
    "best_kind",
    "level_or_order",
    "scaling",
    "two_values",
)
"""The chapter's results, in its order."""
