"""Tables and figures of the learning section, on curves made by hand."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from scipy import stats

from thesis_lib.chapter5 import committed, live, nine_networks, options, peers, precision
from thesis_lib.chapter5.committed import commits
from thesis_lib.chapter5.networks import STYLES
from thesis_lib.training.config import TrainConfig, step_size


def curves(gain: float = 50.0) -> pd.DataFrame:
    """Two tasks, two networks: the DTRNN gains, the ESN does not."""
    rows = []
    for task in ("Swimmer", "Ant"):
        for net, up in (("dtrnn", gain), ("esn", 0.0)):
            for i in range(1, 11):
                rows.append(
                    {
                        "task": task,
                        "architecture": net,
                        "seed": 0,
                        "iteration": i,
                        "steps": 1000 * i,
                        "mean_return": -10 + up * (i - 1) / 9,
                        "std_return": 5.0,
                        "episodes": 20,
                        "sampling_seconds": 1.0,
                        "update_seconds": 0.5,
                        "wall_seconds": 2.0,
                    }
                )
    return pd.DataFrame(rows)


def test_gains_are_tested_and_corrected() -> None:
    found = nine_networks.improvement(curves(), last=1)
    # Welch by SciPy from the same samples' summaries, times 4 (Holm: both gains are equal and
    # smallest, so that one is multiplied by 4 and the other by at most that)
    sd = 5.0 * np.sqrt(20 / 19)
    p = stats.ttest_ind_from_stats(40, sd, 20, -10, sd, 20, equal_var=False).pvalue
    gained = found.xs("dtrnn", level="architecture")
    assert gained.p.max() == pytest.approx(4 * p, rel=1e-6)
    assert gained.learned.all()
    still = found.xs("esn", level="architecture")
    assert not still.learned.any()
    assert (still.p == 1).all()


def test_episodes_of_the_last_batches_are_pooled() -> None:
    table = curves()
    table["episodes"] = np.where(table.iteration == 10, 60, 20)
    found = nine_networks.improvement(table, last=2)
    expected = (20 * (-10 + 50 * 8 / 9) + 60 * 40) / 80
    assert found.loc[("Ant", "dtrnn"), "last"] == pytest.approx(expected)


def test_tables_have_the_order_of_the_page() -> None:
    table = nine_networks.shown(curves(), last=1).set_index("network")
    assert list(table.columns) == ["Swimmer", "Ant"]
    assert table.Ant["DTRNN"] == "-10 → **40**"
    assert table.Ant["ESN"] == "-10 → -10"
    assert nine_networks.times(curves()).set_index("network").Ant["ESN"] == "15 (20)"


def test_number_types_are_compared_seed_by_seed() -> None:
    rows = [
        (name, seed, i, 1000 * i, 100.0 * seed + shift)
        for name, shift in (("float64", 0.0), ("float32", 1.0))
        for seed in range(5)
        for i in (1, 2)
    ]
    columns = ["precision", "seed", "iteration", "steps", "mean_return"]
    table = pd.DataFrame(rows, columns=columns).assign(
        task="Ant", terrain="flat", architecture="gru", variant="default", accepted=True
    )
    table = table.assign(sampling_seconds=1.0, update_seconds=1.0, wall_seconds=1.0)
    table.loc[(table.precision == "float32") & (table.seed == 4), "mean_return"] += 5
    told = precision.reading(table)
    gaps = np.array([1, 1, 1, 1, 6])  # of means 200 over seeds
    half = stats.t.ppf(0.975, 4) * gaps.std(ddof=1) / np.sqrt(5)
    assert f"difference seed by seed of 2.0 ± {half:.1f} (95%, n = 5)" in told
    # one-sided t test of the mean gap against a tenth of the mean
    p = stats.ttest_1samp(gaps, 20, alternative="less").pvalue
    assert f"20.0, the two are shown to be equivalent (paired TOST, p = {p:.2g})" in told
    plt.close(precision.figure(table))


def test_commits_are_told_run_by_run() -> None:
    one = {"runs": [{"commit": "aaa"}, {"commit": "aaa"}]}
    assert commits(one) == "2 of its 2 runs at commit aaa"
    numbered = {"made_by": [{"commit": "aaa"}], "runs": [{"made_by": 0}, {"made_by": 0}]}
    assert commits(numbered) == commits(one)
    mixed = {"runs": [*one["runs"], {"commit": "bbb+"}]}
    assert commits(mixed).startswith("2 of its 3 runs at commit aaa, the others at 1 more;")
    assert "as 1 of them have" in commits(mixed)


def test_former_defaults_are_told_net_by_net() -> None:
    told = committed.former("options/previous_action/curves")
    assert "CTRNN with time constants of 1 s (now 0.1 s)" in told
    assert "GRU, LSTM and ESN with output weights at 1 of their scale (now 0.1)" in told
    assert "DTRNN" not in told  # nothing of it was changed
    assert committed.former("study/depth/curves") == ""


def test_every_network_has_a_line_of_its_own() -> None:
    assert len(set(STYLES.values())) == len(STYLES) == 9
    figure = nine_networks.figure(curves())
    assert [ax.get_title() for ax in figure.axes[:2]] == ["Swimmer", "Ant"]
    plt.close(figure)


def test_step_sizes_are_the_printed_ones() -> None:
    table = live.bounds().set_index("task")
    assert table.CTRNN["HalfCheetah"] == "0.5"
    assert table.LSTM["Ant"] == "**0.05**"
    assert table.LSTM["Swimmer"] == "**0.1**"  # Duan et al., section 5
    for task in table.index:
        used = step_size(TrainConfig(task=task, architecture="dffwd"))
        assert float(table.DFFWD[task].strip("*")) == used


def test_runs_by_step_size() -> None:
    rows = [
        ("Swimmer", "dffwd-softplus", variant, seed, i, seed + gain * i)
        for variant, gain in (("delta_kl=0.02", 0.0), ("default", 2.0))
        for seed in (0, 4)
        for i in range(1, 8)
    ]
    columns = ["task", "architecture", "variant", "seed", "iteration", "mean_return"]
    curves = pd.DataFrame(rows, columns=columns).assign(
        terrain="flat", precision="float32", steps=1, accepted=True
    )
    curves = curves.assign(sampling_seconds=1.0, update_seconds=1.0, wall_seconds=1.0)
    table = options.by_bound(curves, last=3)
    assert table["bound [nat]"].tolist() == [0.1, 0.02]
    half = stats.t.ppf(0.975, 1) * 2  # of 0 and 4: sd / sqrt(2) is 2
    assert table["first batch"].tolist() == [f"4.0 ± {half:.1f}", f"2.0 ± {half:.1f}"]
    assert table["last 3"].tolist() == [f"14.0 ± {half:.1f}", f"2.0 ± {half:.1f}"]
    assert table.gained.tolist() == ["2 of 2", "0 of 2"]


def duel() -> pd.DataFrame:
    """Curves of four learners on one task, twelve batches, three seeds."""
    generator = np.random.default_rng(0)
    levels = {
        ("ours", "dimension"): 30.0,
        ("linear", "dimension"): 10.0,
        ("ours", "nats"): 15.0,
        ("peer", "dimension"): 20.0,
    }
    rows = [
        ("Hopper", bound, side, seed, batch, 1000 * batch, level + generator.normal())
        for (side, bound), level in levels.items()
        for seed in range(3)
        for batch in range(1, 13)
    ]
    columns = ["task", "bound", "side", "seed", "batch", "steps", "mean_return"]
    return pd.DataFrame(rows, columns=columns)


def test_another_library_is_compared_by_welch() -> None:
    table = duel()
    found = peers.differences(table, last=2)
    for part, first in (("end", 11), ("curve", 1)):
        chosen = table[table.batch >= first]
        runs = chosen.groupby(["side", "bound", "seed"]).mean_return.mean()
        theirs = runs["peer", "dimension"]
        for side, bound in (("ours", "dimension"), ("linear", "dimension"), ("ours", "nats")):
            row = found.loc["Hopper", side, bound, part]
            mine = runs[side, bound]
            test = stats.ttest_ind(mine, theirs, equal_var=False)
            interval = test.confidence_interval()
            assert row.n == 3
            assert row.difference == pytest.approx(mine.mean() - theirs.mean())
            assert row.p == pytest.approx(test.pvalue)
            assert (row.low, row.high) == pytest.approx((interval.low, interval.high))
    shown = peers.shown(table)
    assert len(shown) == 6  # three learners of ours, at the end and over the curve
    assert shown["difference (95%)"].str.startswith("-").sum() == 4


def test_figures_of_comparisons_draw_every_learner_and_setting() -> None:
    figure = peers.figure(duel())
    assert [len(ax.lines) for ax in figure.axes] == [4]
    compared = pd.DataFrame(
        {
            "task": ["Hopper", "Ant"],
            "architecture": ["gru", "esn"],
            "changed": ["gae_lambda=0.9", "leak=1.0"],
            "mean_reference": [50.0, -20.0],
            "difference": [10.0, 5.0],
            "low": [5.0, -5.0],
            "high": [15.0, 15.0],
            "p_holm": [0.01, 0.3],
        }
    )
    ax = options.figure(compared).axes[0]
    dots = [line for line in ax.lines if line.get_marker() == "o"]
    assert [float(dot.get_xdata()[0]) for dot in dots] == [10.0, 5.0]
    assert [dot.get_markerfacecolor() == "white" for dot in dots] == [False, True]
    assert [t.get_text() for t in ax.get_yticklabels()] == [
        "GRU: gae lambda 0.9",
        "ESN: leak 1.0",
    ]
    plt.close("all")
