"""Chapter 5, Benchmarking Recurrent Architectures for Robust Continuous Control.

One file a result: its config with the budgets, the experiment, the criteria of the claims its
table decides, and its figure; the claims' words stand in ``claims.toml``.  What several need is
in ``networks``, ``open_loop``, ``committed`` and, of the benchmark, ``cells`` (the grid as
numbers), ``contrasts`` (differences between nets), ``cell_table``, ``judging`` and ``runs``;
pictures are in ``architecture_drawing`` and ``pictures``. The benchmark's results take the
printed numbers always, and our own runs where a results store has them.
"""
