"""The readings of chapter 5's learning: what their rows say is what the code does."""

import inspect
import re
from pathlib import Path

import pandas as pd
import pytest

from thesis_lib import chapter5
from thesis_lib.chapter5 import options, precision
from thesis_lib.edition.chapters import read_chapter
from thesis_lib.optimisation import TRPO, Learner, LinearBaseline
from thesis_lib.optimisation.baseline import CLIP
from thesis_lib.policies import ARCHITECTURES, make_policy
from thesis_lib.policies.factory import recurrent_units
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.curves import PAIRED_COLUMNS

CHAPTER = read_chapter(chapter5)
ROWS = {row.id: row for row in CHAPTER.differences}


def default(function: object, name: str) -> object:
    assert callable(function)
    return inspect.signature(function).parameters[name].default


def test_rows_state_the_defaults() -> None:
    config = TrainConfig()
    assert (config.batch_steps, config.horizon, config.iterations) == (50_000, 500, 500)
    assert "50,000, in episodes of at most 500 steps" in ROWS["5.4-batch"].ours
    assert "500 by default" in ROWS["5.4-iterations"].ours
    assert (config.discount, config.gae_lambda, config.bootstrap) == (0.99, 1.0, False)
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


def test_every_row_says_where_a_page_shows_it() -> None:
    notebooks = (Path(chapter5.__file__).parents[2] / "notebooks").glob("ch05_*.ipynb")
    prose = "".join(file.read_text(encoding="utf-8") for file in notebooks)
    labels = set(re.findall(r"\((sec-[a-z0-9-]+)\)=", prose))
    assert len(CHAPTER.claims) == 87
    assert all(row.at in labels for row in (*CHAPTER.claims, *CHAPTER.differences))


@pytest.mark.parametrize("row", CHAPTER.differences, ids=lambda r: r.id)
def test_every_row_is_whole_sentences(row) -> None:
    told = [row.effect] if isinstance(row.effect, str) else []
    for text in (row.thesis, row.ours, *told):
        assert text.rstrip('"').endswith("."), text


@pytest.fixture(scope="module")
def committed() -> dict[str, pd.DataFrame]:
    return {e.id: e.run("smoke").table for e in (options.changes, precision.curves)}


def test_effects_of_settings_are_told_from_committed_runs(committed) -> None:
    rows = [r for r in CHAPTER.differences if r.experiments and {*r.experiments} <= {*committed}]
    assert len(rows) == 5
    for row in rows:
        assert not isinstance(row.effect, str)
        told = row.effect(committed)
        assert "seed" in told
        assert told.endswith(").")


def test_what_is_measured_is_told() -> None:
    row = dict.fromkeys(PAIRED_COLUMNS, 0.5) | {
        **{"sweep": "options/gru/curves", "iterations": 2, "batch_steps": 4000},
        **{"task": "HalfCheetah", "architecture": "gru", "changed": "bootstrap=True", "n": 2},
        **{"mean_changed": -7.2, "mean_reference": 3.1, "difference": -10.3},
        **{"low": -12.0, "high": -8.0, "p_difference": 0.01, "p_holm": 0.02},
    }
    other = row | {"changed": "gae_lambda=0.9"}
    told = options.measured(pd.DataFrame([row]), "gru", "bootstrap=True")
    assert "`bootstrap=True` for the GRU on HalfCheetah: over 2 iterations of 4,000 steps" in told
    assert "is -7 instead of 3, a difference of -10 (95% interval -12 to -8, 2 seeds" in told
    assert told.endswith("p = 0.01).")
    both = options.measured(pd.DataFrame([row, other]), "gru", "bootstrap=True")
    assert both.endswith("p = 0.01, 0.02 after Holm for the 2 options tried).")
