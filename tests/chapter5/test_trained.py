"""Gains and time constants of trained networks, from a sweep made here."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from scipy import stats

from thesis_lib.chapter5 import gain_trained, learned_time_constants, options
from thesis_lib.edition.ledger import Verdict
from thesis_lib.edition.saved import saved
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.curves import write
from thesis_lib.training.grid import Grid, run_name
from thesis_lib.training.run import Training
from thesis_lib.training.train import train

BASE = TrainConfig(batch_steps=100, horizon=20, iterations=2)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[TrainConfig]]:
    """A CTRNN with two initial time constants, and a DTRNN."""
    folder = tmp_path_factory.mktemp("runs")
    grid = Grid(("swimmer",), architectures=("ctrnn", "dtrnn"), variants=("time_constant=0.3",))
    configs = grid.runs(BASE)
    for config in configs:
        train(config, folder / run_name(config))
    write(configs, folder, folder, command="thesis sweep")
    return folder, configs


def test_gains_are_those_of_networks_before_and_after_training(
    runs: tuple[Path, list[TrainConfig]],
) -> None:
    folder, _ = runs
    config = gain_trained.Config(1e-3, 1024, 256, str(folder / "policies.pt"))
    table = gain_trained.before_and_after.run(config=config, seed=3).table
    assert set(table.net) == {"CTRNN, 0.1 s", "CTRNN, 0.3 s", "DTRNN"}
    assert len(table) == 3 * 2 * 128
    wide = table.pivot(index="frequency", columns=["net", "stage"], values="gain")
    linear = table.pivot(index="frequency", columns=["net", "stage"], values="small_signal_gain")
    for net in set(table.net):
        assert not np.allclose(wide[net, "before"], wide[net, "after"], rtol=1e-3)
    # Signals of a thousandth leave a network linear, if it is stable at rest.
    ratio = (wide / linear).median().dropna()
    assert ("CTRNN, 0.3 s", "after") in ratio.index
    assert ratio.to_numpy() == pytest.approx(1, abs=0.1)


def test_time_constants_are_those_of_the_checkpoint(
    runs: tuple[Path, list[TrainConfig]],
) -> None:
    folder, configs = runs
    config = learned_time_constants.Config(str(folder / "policies.pt"))
    table = learned_time_constants.by_unit.run(config=config).table
    assert sorted(table.net.unique()) == ["CTRNN, 0.1 s", "CTRNN, 0.3 s"]
    for run in configs:
        if run.architecture != "ctrnn":
            continue
        raw = Training.load(folder / run_name(run)).policy.state_dict()["tau_raw"]
        own = table[table.initial == run.time_constant]
        dt = 0.025  # the swimmer's control step, below which the clamp lets none go
        expected = torch.clamp(raw, min=dt).double().numpy()
        np.testing.assert_allclose(own.learned, expected)
        assert not np.allclose(own.learned, run.time_constant)


def test_options_are_paired_seed_by_seed() -> None:
    found = options.changes.run("smoke").table
    row = found[(found.architecture == "dtrnn") & (found.changed == "gae_lambda=0.97")].iloc[0]
    curves = saved("options/dtrnn/curves").table
    mean = curves.groupby(["variant", "seed"]).mean_return.mean()
    test = stats.ttest_rel(mean["gae_lambda=0.97"], mean["default"])
    assert row.p_difference == pytest.approx(test.pvalue)
    interval = test.confidence_interval()
    assert (row.low, row.high) == pytest.approx((interval.low, interval.high))


def gain_table(fast: dict[str, list[float]]) -> pd.DataFrame:
    """A gain of 1 at 0.2 and 2 Hz, and the given ones at 20 Hz, a number a seed."""
    rows = [
        (net, seed, "after", frequency, gain)
        for net, gains in fast.items()
        for seed, value in enumerate(gains)
        for frequency, gain in ((0.2, 1.0), (2.0, 1.0), (20.0, value))
    ]
    return pd.DataFrame(rows, columns=["net", "seed", "stage", "frequency", "gain"])


@pytest.mark.parametrize(
    ("slow", "verdict"),
    [
        ([0.1, 0.1], Verdict.REPRODUCED),
        ([0.1, 0.5], Verdict.DIRECTION),
        ([0.5, 0.5], Verdict.NOT_REPRODUCED),
    ],
)
def test_the_verdict_on_the_low_pass_filter(slow: list[float], verdict: Verdict) -> None:
    table = gain_table({"CTRNN, 1 s": slow, "CTRNN, 0.1 s": [0.2, 0.2], "GRU": [0.3, 0.4]})
    before = table.assign(stage="before", gain=9.0)
    found = gain_trained.low_pass_after_training(pd.concat([before, table]))
    assert found.verdict is verdict
    assert "after training" in found.evidence
