"""Calibration: what is averaged, what is left out, and when the text's subset is borne out."""

from pathlib import Path

import pandas as pd
import pytest

from thesis_lib.chapter5 import calibration
from thesis_lib.chapter5.calibration import Config, readings, settings_matter, text_subset_learns
from thesis_lib.edition.ledger import Verdict


def curves(sensors: str, seed: int, returns: list[float]) -> pd.DataFrame:
    iterations = range(1, len(returns) + 1)
    return pd.DataFrame(
        {
            **{"task": "Hopper", "architecture": "dtrnn", "seed": seed, "sensors": sensors},
            **{"time_constant": float("nan"), "head_scale": 1.0, "delta_kl": 0.35},
            **{"iteration": iterations, "steps": 50_000, "mean_return": returns},
        }
    )


def table(folder: Path, *runs: pd.DataFrame) -> pd.DataFrame:
    pd.concat(runs).to_csv(folder / "curves.csv", index=False)
    return readings.run(config=Config(store=str(folder), iterations=4)).table


def test_means_by_hand(tmp_path: Path) -> None:
    made = table(
        tmp_path,
        curves("code", 0, [0.0, 10.0, 20.0, 30.0, 1000.0]),
        curves("code", 1, [20.0, 30.0, 40.0, 50.0]),
        curves("code", 2, [99.0, 99.0]),  # has not come so far
        curves("text", 0, [1.0, 1.0]),
    )
    (row,) = made.itertuples()
    assert (row.mean_return, row.lowest, row.highest, row.n_runs) == (25.0, 15.0, 35.0, 2)
    assert row.last_return == 25.0  # of the last five, here all four
    assert (row.printed_mean, row.printed_se) == (273.4, 60.8)  # table 5.2


@pytest.mark.parametrize(
    ("text", "seeds", "verdict"),
    [
        (200.0, 2, Verdict.REPRODUCED),  # above 273.4 - 2 x 60.8 = 151.8
        (150.0, 2, Verdict.NOT_REPRODUCED),
        (150.0, 1, Verdict.INCONCLUSIVE),
    ],
)
def test_the_text_s_subset(tmp_path: Path, text: float, seeds: int, verdict: Verdict) -> None:
    runs = [
        curves(s, i, [r] * 4) for s, r in (("text", text), ("code", 250.0)) for i in range(seeds)
    ]
    assert text_subset_learns(table(tmp_path, *runs)).verdict is verdict


@pytest.mark.parametrize(
    ("full", "tenth", "verdict"),
    [
        # Standard deviations of 10 and of 300: of a difference 8.2 and 245, on 4 degrees.
        ((390.0, 400.0, 410.0), (690.0, 700.0, 710.0), Verdict.REPRODUCED),
        ((390.0, 400.0, 410.0), (391.0, 401.0, 411.0), Verdict.NOT_REPRODUCED),  # 40 is a tenth
        ((100.0, 400.0, 700.0), (200.0, 500.0, 800.0), Verdict.INCONCLUSIVE),
        ((390.0, 400.0), (690.0, 700.0), Verdict.INCONCLUSIVE),  # too few seeds to be tested
        ((390.0,), (690.0,), Verdict.INCONCLUSIVE),
    ],
)
def test_settings_matter_or_not(tmp_path: Path, full, tenth, verdict: Verdict) -> None:
    """The GRU's output layer: full weights or a tenth of them; the other pairs differ in two."""
    runs = [
        curves("all", seed, [value] * 4).assign(architecture="gru", head_scale=scale, delta_kl=0.07)
        for scale, values in ((1.0, full), (0.1, tenth))
        for seed, value in enumerate(values)
    ]
    runs += [curves("text", seed, [9e3] * 4).assign(architecture="gru") for seed in range(3)]
    found = settings_matter(table(tmp_path, *runs))
    assert found.verdict is verdict
    n = len(full)
    assert ("GRU (Hopper), output × 1 and 0.1: " in found.evidence) is (n > 1)
    assert found.numbers["tested"] == (n == 3)
    assert (f"({n} and {n} seeds, p = " in found.evidence) is (n == 3)


def test_many_pairs_are_corrected_for_their_number(tmp_path: Path) -> None:
    """Means 0, 15 and 20 of three seeds with deviation 7: t is 2.62, 3.50 and .87 on 4 degrees."""
    runs = [
        curves("all", seed, [100 + mean + 7.0 * (seed - 1)] * 4).assign(delta_kl=delta)
        for delta, mean in ((0.1, 0.0), (0.2, 15.0), (0.3, 20.0))
        for seed in range(3)
    ]
    found = settings_matter(table(tmp_path, *runs))
    # p by tables .058, .025 and .43: the least is not below .05 / 3.
    assert found.verdict is Verdict.INCONCLUSIVE
    assert (
        "in one setting: 3, with 3 seeds or more each 3, and significantly different of these 0"
        in found.evidence
    )


def test_what_fits_and_what_was_not_tried(tmp_path: Path) -> None:
    runs = [
        curves("code", 0, [200.0] * 4),  # above 273.4 - 2 x 60.8 = 151.8
        curves("code", 1, [200.0] * 4),
        curves("text", 0, [20.0] * 4),
        curves("code", 0, [50.0] * 4).assign(architecture="gru"),  # below 143.4 - 2 x 41.9 = 59.6
    ]
    made = table(tmp_path, *runs)
    told = calibration.fit(made)
    assert "some reading brings DTRNN to the printed level" in told
    assert "nothing tried brings GRU (35%) there" in told  # 50 of 143.4
    left = calibration.gaps(made)
    assert "On the Hopper nothing was tried for CTRNN, ESN, DFFWD, FFWD and LSTM." in left
    assert "On the Swimmer, whose subset of sensors is a reading too, nothing was." in left
    assert "2 of 3 readings have one seed alone." in left


def test_the_reading_in_use_is_bold_and_a_faster_one_is_told(tmp_path: Path) -> None:
    ffwd = {"architecture": "ffwd", "task": "HalfCheetah", "sensors": "all", "head_scale": 0.1}
    ctrnn = {"architecture": "ctrnn", "delta_kl": 0.1}  # table 5.1, on the Hopper
    made = table(
        tmp_path,
        curves("all", 0, [500.0] * 4).assign(**ffwd, delta_kl=0.05),
        curves("all", 0, [600.0] * 4).assign(**ffwd, delta_kl=0.1),
        curves("code", 0, [700.0] * 4).assign(**ctrnn, time_constant=0.1),
        curves("code", 0, [200.0] * 4).assign(**ctrnn, time_constant=1.0),
    )
    assert set(calibration.shown(made)["first 100"]) == {"**500**", "600", "**700**", "200"}
    assert "one in use learned FFWD (HalfCheetah):" in calibration.fit(made)
    told = calibration.of_step_sizes(made)
    assert "FFWD on the HalfCheetah 500 (1 seed; 500 at the end) with 0.05 and 600 " in told
    assert "CTRNN" not in told  # one step size


def test_an_output_start_that_another_beats_is_named(tmp_path: Path) -> None:
    """Table 5.2 prints far more than any of these; the DTRNN starts whole, the GRU at a tenth."""
    made = table(
        tmp_path,
        curves("all", 0, [900.0] * 4).assign(task="HalfCheetah", architecture="dtrnn"),
        curves("all", 0, [500.0] * 4).assign(
            task="HalfCheetah", architecture="dtrnn", head_scale=0.1
        ),
        curves("all", 0, [400.0] * 4).assign(task="HalfCheetah", architecture="gru"),
        curves("all", 0, [300.0] * 4).assign(
            task="HalfCheetah", architecture="gru", head_scale=0.1
        ),
    )
    told = calibration.of_output_start(made)
    assert "DTRNN 900 and 500 (1), GRU 400 and 300 (1)." in told
    assert "comes nearer to table 5.2, but for GRU;" in told


def test_the_runs_that_are_kept() -> None:
    made = readings.run("book").table
    assert (made.n_runs >= 1).all()
    assert not made[list(calibration.SETTINGS)].duplicated().any()
    told = calibration.of_subsets(made) + calibration.of_time_constants(made)
    assert "nan" not in told + calibration.of_output_start(made) + calibration.of_step_sizes(made)
