"""Pictures of the front page's findings."""

from pathlib import Path
from typing import Any

import altair as alt
import pandas as pd
import pytest

from thesis_lib.book import findings
from thesis_lib.chapter3 import figure_3_4
from thesis_lib.chapter5 import study_filter


def rows(chart: alt.Chart) -> list[dict[str, Any]]:
    """The rows of a chart's data."""
    return [row for data in chart.to_dict()["datasets"].values() for row in data]


def test_steps_of_the_law_shrink_ever_less() -> None:
    ratio = {r["k"]: r["ratio"] for r in rows(findings.steps()) if r["of"].startswith("steps")}
    # The steps of 1/k are 1/(k (k + 1)), each (k - 1)/(k + 1) of the one before.
    assert ratio[2] == pytest.approx(1 / 3)
    assert ratio[9] == pytest.approx(0.8)
    assert ratio[30] == pytest.approx(29 / 31)
    assert sorted(ratio) == list(range(2, 31))


def test_a_bar_is_the_return_at_the_best_learning_rate() -> None:
    at = {"stocks": 2, "epsilon": 0.01, "ci95": 1.5, "sd": 1.0, "n_runs": 4}
    table = pd.DataFrame(
        [
            at | {"potential": "Q_star", "alpha": 0.1, "mean_return": 60.0},
            at | {"potential": "Q_star", "alpha": 0.2, "mean_return": 63.0},
            at | {"potential": "constant", "alpha": 0.1, "mean_return": 70.0},
            at | {"potential": "Q_mu", "alpha": 0.1, "mean_return": 90.0, "stocks": 3},
        ]
    )
    bars = {
        r["name"]: (r["mean_return"], r["low"], r["high"]) for r in rows(findings.constant(table))
    }
    assert bars == {"Q*": (63.0, 61.5, 64.5), "a constant potential": (70.0, 68.5, 71.5)}


def test_a_point_is_the_mean_over_seeds() -> None:
    table = pd.DataFrame({"arm": "CTRNN", "correlation": [3.0] * 3, "retained": [0.8, 0.9, 1.0]})
    (row,) = rows(findings.noise(table))
    assert (row["network"], row["time"], row["share"]) == ("CTRNN", "3", pytest.approx(0.9))
    assert row["high"] - row["share"] == pytest.approx(4.303 * 0.1 / 3**0.5, rel=1e-3)  # t(2)


def test_all_pictures_are_drawn_from_the_tables_of_a_build(tmp_path: Path) -> None:
    for experiment in (figure_3_4.by_alpha, study_filter.fresh):
        experiment.run("smoke").save(tmp_path)
    made = findings.findings(tmp_path)
    names = {"law-small", "threshold-small", "steps", "constant", "noise"}
    assert set(made) == {f"chart-{n}.svg" for n in names} | {f"picture-{n}.md" for n in names}
    assert "chart-noise.svg" in made["picture-noise.md"]
    assert all("<svg" in made[f"chart-{n}.svg"] for n in names)


def test_a_table_that_is_missing_stops_a_build_and_no_draft(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        findings.findings(tmp_path)
    assert findings.findings(tmp_path, draft=True)["picture-constant.md"] == ""
