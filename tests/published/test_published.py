"""The published numbers against sums a person can recompute from the printed tables.

The sums below were added up from the text of the thesis, row by row and column by column, not
from the CSV files: a digit, a sign or a swapped cell in a file breaks one row and one column.
"""

import numpy as np
import pandas as pd
import pytest

from thesis_lib.published import TABLES, load

NETS = ["CTRNN", "DTRNN", "ESN", "DFFWD", "FFWD", "GRU", "LSTM"]
TASKS = ["ant", "half_cheetah", "hopper", "swimmer", "walker"]
BIG = {
    # table: (row sums, row sums of the errors, column sums, column sums of the errors); the rows
    # are the five tasks trained on the flat, then on hills, the columns are the NETS.
    "table-5.2": (
        [6571.9, 10601.5, 2281.1, 905.5, 3087.0, 2266.8, 6817.5, 1680.6, 325.5, 2824.6],
        [391.0, 1003.0, 296.7, 159.5, 1003.4, 286.8, 910.6, 280.3, 51.3, 710.4],
        [5236.1, 5786.6, 3553.3, 7444.7, 6835.0, 4431.4, 4074.9],
        [703.6, 730.9, 556.0, 839.7, 852.2, 672.2, 738.4],
    ),
    "table-5.3": (
        [17352.0, 25258.5, 8825.1, 2430.9, 11994.5, 9028.1, 19624.3, 5399.1, 1400.7, 9908.5],
        [301.2, 324.8, 245.3, 2.2, 254.0, 257.7, 284.6, 197.1, 13.0, 279.1],
        [19543.8, 19348.7, 10676.3, 15892.4, 19412.7, 14824.0, 11523.8],
        [388.6, 412.3, 224.2, 267.2, 370.7, 268.2, 227.8],
    ),
    "table-c.1": (
        [17352.0, 25258.5, 8805.1, 2430.9, 11994.5, 9028.1, 19624.3, 5399.1, 1400.7, 9908.5],
        [301.2, 324.8, 245.3, 2.2, 254.0, 257.7, 284.6, 197.1, 13.0, 279.1],
        [19523.8, 19348.7, 10676.3, 15892.4, 19412.7, 14824.0, 11523.8],
        [388.6, 412.3, 224.2, 267.2, 370.7, 268.2, 227.8],
    ),
    "table-c.2": (
        [7052.2, 17753.7, 946.6, 1033.5, 6001.5, 5113.1, 17766.9, 739.6, 624.0, 5128.0],
        [247.6, 601.9, 30.7, 13.2, 237.4, 187.0, 363.8, 32.9, 12.7, 179.2],
        [12613.8, 10151.1, 7903.5, 9014.2, 8329.7, 6377.7, 7769.1],
        [358.4, 323.9, 264.1, 299.9, 242.7, 221.0, 196.4],
    ),
    "table-c.3": (
        [6625.0, 11450.2, 3334.1, 1336.0, 11923.6, 7409.2, 14720.6, 2536.8, 181.8, 8538.6],
        [312.2, 385.2, 109.9, 40.5, 266.1, 282.3, 525.2, 121.0, 17.9, 290.5],
        [11265.6, 9823.5, 8408.9, 10667.1, 11209.5, 8313.5, 8367.8],
        [380.9, 359.5, 282.6, 399.3, 352.8, 316.5, 259.2],
    ),
}


@pytest.mark.parametrize("table", BIG)
def test_row_and_column_sums_of_the_locomotion_tables(table: str) -> None:
    rows, row_errors, columns, column_errors = BIG[table]
    frame = load(table)
    assert len(frame) == 70
    for number, by_row, by_column in (
        ("value", rows, columns),
        ("standard_error", row_errors, column_errors),
    ):
        cells = frame.pivot(index=["trained_on", "task"], columns="architecture", values=number)
        order = pd.MultiIndex.from_product([["flat", "hill"], TASKS])
        cells = cells.loc[order, NETS]
        np.testing.assert_allclose(cells.sum(axis=1), by_row, atol=1e-9)
        np.testing.assert_allclose(cells.sum(axis=0), by_column, atol=1e-9)


def test_tables_5_3_and_c_1_differ_in_one_cell_only() -> None:
    a, b = load("table-5.3"), load("table-c.1")
    differ = (a.value != b.value) | (a.standard_error != b.standard_error)
    assert differ.sum() == 1
    assert (a[differ].row.item(), a[differ].architecture.item()) == ("Hopper", "CTRNN")
    assert (a[differ].value.item(), b[differ].value.item()) == (2351.4, 2331.4)
    assert "2331.4" in a[differ].note.item()
    assert "2351.4" in b[differ].note.item()


def test_table_3_1() -> None:
    frame = load("table-3.1")
    assert len(frame) == 16
    assert frame.value.notna().sum() == frame.ci95.notna().sum() == 14
    assert frame[frame.value.isna()].note.str.contains("no number printed").all()
    by_column = frame.groupby(["sensor", "algorithm"])[["value", "ci95"]].sum()
    expected = {
        (False, "q_learning"): (-35.50, 2.91),
        (False, "sarsa"): (-523.75, 130.32),
        (True, "q_learning"): (-16.04, 0.42),
        (True, "sarsa"): (-11.00, 0.36),
    }
    assert set(by_column.index) == set(expected)
    for key, sums in expected.items():
        np.testing.assert_allclose(by_column.loc[key], sums, atol=1e-9)
    by_row = frame.groupby("potential")[["value", "ci95"]].sum()
    for potential, sums in {
        "Q_mu": (-531.77, 132.43),
        "none": (-19.53, 0.46),
        "Q_star": (-18.20, 0.52),
        "Q_tilde": (-16.79, 0.60),
    }.items():
        np.testing.assert_allclose(by_row.loc[potential], sums, atol=1e-9)


def test_table_5_1() -> None:
    frame = load("table-5.1")
    step = frame[frame.quantity == "delta_kl"]
    assert len(step) == 20
    cells = step.pivot(index="task", columns="architecture", values="value")
    np.testing.assert_allclose(
        cells.loc[TASKS].sum(axis=1), [0.64, 0.69, 0.54, 0.32, 0.77], atol=1e-9
    )
    np.testing.assert_allclose(
        cells[["CTRNN", "DTRNN", "GRU", "ESN"]].sum(), [1.5, 0.95, 0.34, 0.17], atol=1e-9
    )
    caption = frame[frame.panel == "caption"].set_index(["quantity", "task"]).value
    assert len(caption) == len(frame) - 20 == 10
    assert caption["spectral_radius", "ant"] == 1.5
    assert caption["weight_density", "ant"] == 0.7
    assert (caption["spectral_radius"].drop("ant") == 1.1).all()
    assert (caption["weight_density"].drop("ant") == 1.0).all()


def test_table_5_6() -> None:
    frame = load("table-5.6")
    assert len(frame) == 14
    sums = frame.groupby("perturbation")[["low", "high"]].sum()
    np.testing.assert_allclose(sums.loc["noise"], [9.47, 13.17], atol=1e-9)
    np.testing.assert_allclose(sums.loc["hill"], [7.85, 11.14], atol=1e-9)
    by_net = frame.groupby("architecture")[["low", "high"]].sum()
    for net, sums_of_net in {
        "CTRNN": (2.45, 3.29),
        "DTRNN": (3.73, 5.21),
        "ESN": (2.06, 2.82),
        "DFFWD": (1.85, 2.58),
        "FFWD": (1.71, 2.19),
        "GRU": (2.67, 4.35),
        "LSTM": (2.85, 3.87),
    }.items():
        np.testing.assert_allclose(by_net.loc[net], sums_of_net, atol=1e-9)
    assert (frame.low < frame.high).all()


def test_doubtful_readings_are_noted_and_not_corrected() -> None:
    heads = {table: set(load(table).column) for table in ("table-5.2", "table-c.1", "table-c.3")}
    assert "DFFWD" in heads["table-5.2"]
    assert "DFFWD" in heads["table-c.3"]
    assert "DFWDD" in heads["table-c.1"]
    c1 = load("table-c.1")
    assert c1[c1.column == "DFWDD"].note.str.contains("DFFWD").all()
    ratios = load("table-5.6")
    assert ratios[ratios.row == "DFEWD"].note.str.contains("DFFWD").all()
    assert (ratios[ratios.row == "DFEWD"].architecture == "DFFWD").all()
    curves = load("table-5.2")
    starred = curves[curves.note.str.contains("asterisk")]
    assert set(zip(starred.row, starred.column, strict=True)) == {
        ("Ant", "ESN"),
        ("Ant hill", "ESN"),
    }


@pytest.mark.parametrize("table", TABLES)
def test_every_table_is_tidy(table: str) -> None:
    frame = load(table)
    assert not frame.duplicated(["panel", "row", "column"]).any()
    assert (frame.table == table).all()
    assert (frame.unit != "").all()
    assert frame.note.map(type).eq(str).all()
    assert (
        frame.drop(columns="sensor", errors="ignore")
        .isna()
        .sum()
        .drop(["value", "standard_error", "ci95", "low", "high"])
        .eq(0)
        .all()
    )
    spoilt = load(table)
    spoilt["value"] = 0.0
    pd.testing.assert_frame_equal(load(table), frame)


def test_unknown_table() -> None:
    with pytest.raises(
        ValueError, match=r"published table 'table-9\.9' does not exist.*table-3\.1"
    ):
        load("table-9.9")
