"""Chapter 4, Relevant Representations for Multi-Task RL: one file a result.

Each file holds a result's config with its budgets, the experiment, the criteria of the claims
that its table decides, and its figure; the claims' words stand in ``claims.toml``.  What several
results need is in ``runs`` (domains with their tasks solved), ``protocol`` (that of section 4.3),
``looks``, ``random_solutions`` and ``random_domains``, and for the heat domain in ``heat_space``
and ``heat_runs``.
"""

RESULTS = (
    "figure_4_1",
    "figure_4_2",
    "theorem_2",
    "contraction",
    "corollary_1",
    "theorem_3",
    "appendix_b",
    "lemma_3",
    "interdependence",
    "observed_tasks",
    "estimators",
    "cost",
    "scale",
    "threshold",
    "sampled_threshold",
    "calibration",
    "roc",
    "joint_search",
    "prediction",
    "threshold_regret",
    "scatter",
    "relevances",
    "readings",
    "figure_4_3",
    "figure_4_4",
    "episodic_cliff",
    "pushes",
    "figure_4_6",
    "settings",
    "heat_relevance",
    "figure_4_7",
    "figure_4_8",
    "heat_readings",
    "predictors",
    "few_tasks",
    "dial",
    "task_relevance",
    "function_law",
    "function_selection",
)
"""The chapter's results, in its order."""
