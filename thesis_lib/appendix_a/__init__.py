"""Appendix A, Stationary Memoryless Multi-Task Policies: one file a result; all are exact.

Each file holds a result's config with its budgets, the experiment, the criteria of the claims
that its table decides, and its figures; the claims' words stand in ``claims.toml``.  How the
domains are drawn is in ``pictures``.
"""
