"""Chapter 3, Learning Potential Functions for Multi-Task RL: one file a result.

Each file holds a result's config with its budgets, the experiment, the criteria of the claims
that its table decides, and its figure; the claims' words stand in ``claims.toml``.  What
several results need is in ``runs``.
"""
