"""The readings of chapter 5's learning: what their rows say is what the code does."""

import inspect
from pathlib import Path

import pandas as pd
import pytest

from thesis_lib.claims.learning import DIFFERENCES, measured
from thesis_lib.edition.scoreboard import effect
from thesis_lib.optimisation import TRPO, Learner, LinearBaseline
from thesis_lib.optimisation.baseline import CLIP
from thesis_lib.policies import ARCHITECTURES, make_policy
from thesis_lib.policies.factory import recurrent_units
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.curves import write
from thesis_lib.training.grid import Grid, run_name
from thesis_lib.training.train import train

ROWS = {row.id: row for row in DIFFERENCES}


def default(function: object, name: str) -> object:
    assert callable(function)
    return inspect.signature(function).parameters[name].default


def test_rows_state_the_defaults() -> None:
    config = TrainConfig()
    assert (config.batch_steps, config.horizon, config.iterations) == (50_000, 500, 500)
    assert "50,000, in episodes of at most 500 steps" in ROWS["5.4-batch"].ours
    assert "500 by default" in ROWS["5.4-iterations"].ours
    assert (config.discount, config.trace, config.bootstrap) == (0.99, 1.0, False)
    assert "gamma is 0.99" in ROWS["2.3.4-discount"].ours
    assert "counts as 0" in ROWS["2.3.4-bootstrap"].ours
    assert (config.cg_iterations, config.damping) == (10, 1e-5)
    assert "10 steps, exact products, and 1e-5" in ROWS["2.3.5-damping"].ours
    assert (TRPO().cg_iterations, TRPO().damping) == (10, 1e-5)
    assert default(LinearBaseline, "ridge") == 1e-5
    assert CLIP == 10
    assert "clipped to ±10" in ROWS["2.3.4-baseline"].ours
    assert default(Learner, "standardise") is True
    assert config.precision == "float32"
    assert (config.initial_log_std, config.checkpoint_every) == (0.0, 10)


def test_floors_of_the_deviation() -> None:
    floors = {n: make_policy(n, 4, 2, dt=0.1).min_log_std for n in ARCHITECTURES}
    recurrent = {"dtrnn", "ctrnn", "gru", "lstm", "esn"}
    assert {n for n, floor in floors.items() if floor is None} == recurrent


def test_sizes_of_the_reservoir() -> None:
    # 3 * 125 * 8 + 4 * 64, and what 3328 would take
    assert recurrent_units("esn", 125, 8) == 3256
    assert recurrent_units("esn", 128, 8) == 3328
    assert "3256" in ROWS["5.4-esn-size"].ours


@pytest.mark.parametrize("row", DIFFERENCES, ids=lambda r: r.id)
def test_every_row_is_whole_sentences(row, tmp_path: Path) -> None:
    for text in (row.thesis, row.ours, effect(row, tmp_path)):
        assert text.rstrip('"').endswith("."), text


def test_what_is_measured_is_told(tmp_path: Path) -> None:
    assert measured("gru", "bootstrap=True", tmp_path) == "Not measured yet."
    base = TrainConfig(iterations=2, batch_steps=40, horizon=20, seed=0)
    configs = Grid(
        ("half-cheetah",), architectures=("gru",), seeds=(0, 1), variants=("bootstrap=True",)
    ).runs(base)
    for config in configs:
        train(config, tmp_path / "runs" / run_name(config))
    write(configs, tmp_path / "runs", tmp_path / "results" / "options" / "gru", command="")
    row = pd.read_csv(tmp_path / "results" / "options" / "gru" / "variants.csv").iloc[0]
    told = measured("gru", "bootstrap=True", tmp_path).replace("−", "-")
    assert "`bootstrap=True` for the GRU on HalfCheetah" in told
    assert "over 2 iterations of 40 steps" in told
    assert f"is {row.mean_changed:.0f} instead of {row.mean_reference:.0f}" in told
    assert f"interval {row.low:.0f} to {row.high:.0f}, 2 seeds" in told
    assert measured("gru", "trace=0.5", tmp_path) == "Not measured yet."
