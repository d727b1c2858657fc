"""Chapter 5, Benchmarking Recurrent Architectures for Robust Continuous Control.

One file a result: its config with the budgets, the experiment, the criteria of the claims its
table decides, and its figure; the claims' words stand in ``claims.toml``.  What several need is
in ``networks``, ``open_loop``, ``committed`` and, of the benchmark, ``cells`` (the grid as
numbers), ``contrasts`` (differences between nets), ``cell_table``, ``judging`` and ``runs``;
pictures are in ``architecture_drawing`` and ``pictures``. The benchmark's results take the
printed numbers always, and our own runs where a results store has them.
"""

NETWORKS = (
    "tasks",
    "ground",
    "untrained",
    "first_means",
    "recovery",
    "identities",
    "sizes",
    "responses",
    "gain",
    "gaits",
    "learned_time_constants",
    "gain_trained",
    "integrators",
    "gradients",
    "stability",
    "memory",
    "reservoirs",
    "score",
    "noise",
    "open_loop_tests",
    "live",
    "nine_networks",
    "options",
    "peers",
    "precision",
)
"""Results on worlds, networks and learning, sections 5.1 to 5.4, in their order."""

BENCHMARK = (
    "calibration",
    "contrasts",
    "table_5_2",
    "figure_5_3",
    "printed_length",
    "aggregates",
    "returns",
    "best_policy",
    "training_length",
    "figure_5_4",
    "figure_5_5",
    "table_5_6",
    "study_filter",
    "study_filter_long",
    "study_hills",
    "study_seeds",
)
"""Results of the benchmark, sections 5.4 to 5.7 and appendix C, in their order."""

RESULTS = NETWORKS + BENCHMARK
"""The chapter's results."""
