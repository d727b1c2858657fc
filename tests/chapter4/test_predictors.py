"""Figures 4.3 to 4.8 with the selectors that predict."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from thesis_lib.chapter4 import figure_4_4, predictors
from thesis_lib.chapter4.figure_4_3 import Config as Triangle
from thesis_lib.chapter4.protocol import beside_fstek
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


def test_summaries_count_what_is_shown() -> None:
    """Three cells of a selector: by t of 11 an interval is t(.025/3) / t(.025) = 1.284 as wide."""
    rows = [
        {"setting": s, "tasks_seen": n, "method": m, "over_none": r, "n_runs": 12,
         "over_none_ci95": 1.0, "over_fstek": r - 3, "over_fstek_ci95": 1.0}
        for s, n, found in (("b", 4, (0, 3, 4.3)), ("b", 8, (0, 3, 4.2)), ("a", 4, (0, -3, -6)))
        for m, r in zip(("none", "fs-tek", "shrinkage"), found, strict=True)
    ]  # fmt: skip
    table = pd.DataFrame(rows)
    assert predictors.corrected(3, table.n_runs)[0] == pytest.approx(2.8200 / 2.2010, abs=5e-4)
    counts = predictors.compared(table).set_index("selector").loc["shrinkage"]
    assert counts.tolist() == [3, 2, 1, 1, 1]
    shown = predictors.by_setting(table)
    assert shown.columns.tolist() == ["setting", "FS-TEK", "shrinkage"]
    assert shown.to_numpy().tolist() == [["b", "2 / 0", "2 / 0"], ["a", "0 / 1", "0 / 1"]]


def test_the_f_test_beside_fstek_on_the_figures() -> None:
    """Above by more than the half-width, below by more, and neither; other rows do not count."""
    rows = [
        {"method": m, "tasks_seen": n, "fstek_minus": gap, "fstek_minus_ci95": 1.0}
        for m, n, gap in (
            ("jackknife", 4, -1.1), ("jackknife", 5, 0.9), ("jackknife", 6, 2.0),
            ("none", 4, -3.0), ("jackknife", 3, -3.0),
        )
    ]  # fmt: skip
    table = pd.DataFrame(rows)
    found = beside_fstek([table, table], "jackknife", (4, 5))
    assert found == {"cells": 4, "more": 2, "less": 0}
    assert beside_fstek([table], "jackknife", range(4, 9)) == {"cells": 3, "more": 1, "less": 1}


def test_axes_of_the_cliff_hold_what_can_be_told_apart() -> None:
    rows = [
        {"method": m, "tasks_seen": n, "mean_return": earned, "ci95": 0.0, "fpr": 0.5, "tpr": 1.0}
        for m, own in (("none", (-9e3, 4e3, 5e3)), ("constant", (-1e4, -1e4, -1e4)))
        for n, earned in zip((1, 3, 5), own, strict=True)
    ]  # fmt: skip
    left = figure_4_4.figure(pd.DataFrame(rows)).axes[0]
    assert left.get_ylim() == pytest.approx((3.95, 5.05))
    assert [line.get_label() for line in left.lines] == ["no selection"]
