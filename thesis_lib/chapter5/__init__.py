"""Chapter 5's benchmark, sections 5.4 to 5.7 and appendix C: one file a result.

Each result takes the printed numbers always, and our own runs where a results store has them
(``runs``); the claims' words stand in ``claims.toml``.  What several results need is in ``cells``
(the grid as numbers), ``contrasts`` (differences between nets), ``cell_table`` and ``judging``.
"""

RESULTS = (
    "calibration",
    "contrasts",
    "table_5_2",
    "figure_5_3",
    "returns",
    "figure_5_4",
    "figure_5_5",
    "table_5_6",
    "study_filter",
    "study_hills",
    "study_seeds",
)
"""The chapter's results, in its order."""
