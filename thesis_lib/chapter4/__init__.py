"""Chapter 4, Relevant Representations for Multi-Task RL: one file a result.

Each file holds a result's config with its budgets, the experiment and the criteria of the claims
that its table decides; the claims' words stand in ``claims.toml``.
"""

RESULTS = ("contraction", "sampled_threshold", "joint_search", "prediction", "scatter")
"""The chapter's results, in its order."""
