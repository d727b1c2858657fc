"""What the pages of chapter 4 say in words, on the committed tables that they show."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from thesis_lib.chapter4.figure_4_6 import control
from thesis_lib.chapter4.protocol import ahead, behind

DEEP = Path(__file__).parents[2] / "results/thesis"
KEY = ["global_factors", "tasks_seen"]


@pytest.fixture(scope="module")
def stocks() -> pd.DataFrame:
    return pd.read_csv(DEEP / "figure-4.6.csv")


def of(stocks: pd.DataFrame, method: str) -> pd.DataFrame:
    """Rows of a method, by number of factors and of tasks seen."""
    return stocks[stocks.method == method].set_index(KEY)


def test_the_control_is_counted_by_intervals() -> None:
    """Three cells: ahead of both, ahead of no selection alone, behind fixed features alone."""
    rows = [
        {"global_factors": 1, "tasks_seen": n, "method": m, "mean_return": r, "ci95": half,
         "none_minus": minus, "none_minus_ci95": 1.0}
        for n, (constant, minus, fixed) in enumerate(((9, -2, 3), (9, -1.5, 5), (1, 0.5, 7)))
        for m, r, half in (("constant", constant, 3.0), ("fixed", fixed, 4.0))
    ]  # fmt: skip
    # 3 and 4 make 5: 9 - 3 and 7 - 1 are beyond it, 9 - 5 is not.
    found = {"cells": 3, "over_none": 2, "over_fixed": 1, "under_fixed": 1}
    assert control(pd.DataFrame(rows)) == found


def test_fstek_leads_on_stock_only_where_a_constant_leads_it(stocks: pd.DataFrame) -> None:
    few = stocks[stocks.global_factors < 4]
    led = ahead(of(few, "none"))
    assert led[led.index.isin((4, 5), level=1)].all()
    assert behind(of(few, "constant"))[led].all()
    assert control(few) == {"cells": 30, "over_none": 30, "over_fixed": 30, "under_fixed": 0}


def test_with_four_and_five_factors_the_picture_turns(stocks: pd.DataFrame) -> None:
    many = stocks[stocks.global_factors > 3]
    assert control(many)["under_fixed"] == control(many)["cells"] == 20
    found = of(many, "jackknife").loc[(slice(None), 20), :]
    assert (found.tpr > 0.99).all()
    assert (found.fpr < 0.05).all()
    late = of(many, "fs-tek").query("tasks_seen >= 10")
    # All factors stay, and of the irrelevant features ownership alone goes.
    everything = of(many, "none").features_kept.loc[late.index]
    np.testing.assert_allclose(late.features_kept, everything - 1)
    factors = late.index.get_level_values(0)
    np.testing.assert_allclose(late.fpr, factors / (factors + 1))


def test_the_highest_curves_of_the_stock_figure(stocks: pd.DataFrame) -> None:
    returns = stocks.set_index([*KEY, "method"]).mean_return.unstack()
    best = returns.idxmax(axis=1).groupby("global_factors").unique().str.join(" ")
    assert best.to_dict() == dict.fromkeys((1, 2, 3), "constant") | dict.fromkeys((4, 5), "fixed")


def test_fstek_removes_the_cliff_s_position_at_four_and_five_tasks() -> None:
    """And keeps it ever more often after these."""
    for figure in ("4.4", "4.5"):
        table = pd.read_csv(DEEP / f"figure-{figure}.csv")
        kept = table[table.method == "fs-tek"].set_index("tasks_seen").fpr
        assert (kept[[4, 5]] < 0.2).all()
        assert (kept.loc[6:] > 0.7).all()
        assert kept.loc[6:].is_monotonic_increasing
