"""Figures 4.3 to 4.8 with the selectors that predict."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from thesis_lib.chapter4 import predictors
from thesis_lib.chapter4.figure_4_3 import Config as Triangle
from thesis_lib.chapter4.runs import solve_domain
from thesis_lib.domains import triangle
from thesis_lib.edition.experiment import Context


def test_potentials_are_those_of_the_figures_and_shrinkage_scales_its_own() -> None:
    solved = solve_domain(triangle(), Triangle().learner, Context())
    tasks = np.array([0, 3, 5, 7, 2])
    # "Earned" is a fixed random projection of the potential, which tells potentials apart.
    weights = np.random.default_rng(1).random(solved.domain.shape).ravel()
    setting = replace(
        predictors.TABLES["triangle"](Context()),
        observe=lambda n, rng: solved.solutions.take(tasks[:n]),
        trial=lambda n, rng: lambda phi: float(weights @ np.ravel(phi)),
    )
    config = predictors.Config(("triangle",), tasks_seen=(4, 5))
    run = predictors._run(setting, config, np.random.SeedSequence(0))
    for j, n in enumerate(config.tasks_seen):
        for i, method in enumerate(predictors.METHODS[:-1]):
            phi = solved.potential(tasks[:n], run.support[j, i])
            assert run.returns[j, i] == pytest.approx(weights @ phi.ravel()), method
        own = solved.solutions.take(tasks[:n])
        phi = predictors.Shrinkage().fit(own).values(own)
        assert run.returns[j, -1] == pytest.approx(weights @ phi)
        assert run.support[j, 0].all()


def test_gains_are_paired_over_runs(smoke: Mapping[str, pd.DataFrame]) -> None:
    table = smoke["ch4-predictors"]
    by = table.set_index(["setting", "tasks_seen", "method"]).sort_index()
    for at in by.index.droplevel("method").unique():
        rows = by.loc[at]
        assert rows.over_none["none"] == rows.over_fstek["fs-tek"] == 0
        expected = rows.mean_return - rows.mean_return["none"]
        np.testing.assert_allclose(rows.over_none, expected, atol=1e-9)
    assert set(smoke["ch4-predictors-heat"].method) == set(predictors.METHODS)


def test_summaries_count_what_is_significant_and_name_who_earns_most() -> None:
    rows = [
        {"setting": s, "tasks_seen": n, "method": m, "mean_return": r, "over_none": r,
         "over_none_ci95": 1.0, "over_fstek": r - 3, "over_fstek_ci95": 1.0}
        for s, n, found in (("a", 4, (0, 3, 5)), ("a", 8, (0, 3, 3.5)), ("b", 4, (0, -3, -6)))
        for m, r in zip(("none", "fs-tek", "shrinkage"), found, strict=True)
    ]  # fmt: skip
    table = pd.DataFrame(rows)
    counts = predictors.compared(table).set_index("selector").loc["shrinkage"]
    assert counts.tolist() == [3, 2, 1, 1, 1]
    first, second = predictors.winners(table).to_dict("records")
    assert (first["setting"], first["8 tasks"]) == ("a", "shrinkage (3.5 ± 1.0)")
    assert second["4 tasks"] == "no selection"
