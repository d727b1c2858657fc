"""Chapter 4, Relevant Representations for Multi-Task RL: one file a result.

Each file holds a result's config with its budgets, the experiment, the criteria of the claims
that its table decides, and its figure; the claims' words stand in ``claims.toml``.  What several
results need is in ``runs`` (domains with their tasks solved), ``protocol`` (that of section 4.3),
``looks``, ``random_solutions`` and ``random_domains``, and for the heat domain in ``heat_space``
and ``heat_runs``.
"""
