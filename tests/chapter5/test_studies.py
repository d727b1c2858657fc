"""The studies' statistics by hand, and their criteria on outcomes made by hand."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from scipy.stats import ttest_ind

from tests.chapter5.worlds import THESIS
from thesis_lib.chapter5 import study_filter, study_filter_long, study_hills, study_seeds
from thesis_lib.chapter5.cells import GROUPS, NETS, Cells
from thesis_lib.chapter5.cells import ROBOTS as ROBOT_NAMES
from thesis_lib.chapter5.contrasts import Config
from thesis_lib.edition.ledger import Verdict
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.training import curves
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.grid import run_name, variant
from thesis_lib.training.sweep import sweep
from thesis_lib.training.trained import read_trained


def predictions(seeds=16, share_of_steps=1.0, **bounds):
    """Predictions with intervals (low, high)."""
    rows = [
        study_filter.Prediction(name, (low + high) / 2, low, high, seeds, 0, share_of_steps)
        for name, (low, high) in bounds.items()
    ]
    return pd.DataFrame(rows)


HOLDS, OPEN, FAILS = (0.1, 0.2), (-0.1, 0.1), (-0.2, -0.1)


@pytest.mark.parametrize(
    ("lead", "slow", "filtered", "fixed", "seeds", "verdict"),
    [
        (HOLDS, HOLDS, HOLDS, HOLDS, 16, Verdict.REPRODUCED),
        (HOLDS, HOLDS, HOLDS, HOLDS, 5, Verdict.INCONCLUSIVE),
        (OPEN, HOLDS, HOLDS, HOLDS, 16, Verdict.INCONCLUSIVE),
        (FAILS, HOLDS, HOLDS, HOLDS, 16, Verdict.NOT_REPRODUCED),
        (HOLDS, OPEN, HOLDS, OPEN, 16, Verdict.DIRECTION),
        (HOLDS, OPEN, OPEN, OPEN, 16, Verdict.INCONCLUSIVE),
        (HOLDS, HOLDS, FAILS, HOLDS, 16, Verdict.NOT_REPRODUCED),
        (HOLDS, HOLDS, FAILS, FAILS, 16, Verdict.REFUTED),
    ],
)
def test_the_filter_study_is_judged_by_all_its_predictions(
    lead, slow, filtered, fixed, seeds, verdict
):
    table = predictions(
        seeds, **{"lead": lead, "slow noise": slow, "filter": filtered, "fixed": fixed}
    )
    assert study_filter.because_it_filters(table).verdict is verdict


def test_shorter_runs_than_the_thesiss_decide_nothing():
    arms = {"lead": HOLDS, "slow noise": HOLDS, "filter": HOLDS, "fixed": HOLDS}
    found = study_filter.because_it_filters(predictions(share_of_steps=0.12, **arms))
    assert found.verdict is Verdict.INCONCLUSIVE
    assert "(16 seeds an arm, runs of 12% of the printed steps)" in found.evidence


def test_the_filter_studys_predictions_by_hand():
    kept = {
        ("CTRNN", 0): 0.8,
        ("DTRNN", 0): 0.4,
        ("CTRNN", 100): 0.5,
        ("DTRNN", 100): 0.4,
        ("DTRNN, filtered", 0): 0.7,
        ("CTRNN, fixed", 0): 0.5,
    }
    found = study_filter._predicted({k: np.array(v) for k, v in kept.items()})
    expected = {"lead": 0.4, "slow noise": 0.2 - 0.1, "filter": 0.3 - 0.2, "fixed": 0.3 - 0.2}
    assert {k: float(v) for k, v in found.items()} == pytest.approx(expected)


def filter_store(folder, kept, seeds=8):
    """A layer with the study's arms; ``kept`` maps arm and correlation to the share kept."""
    curves, tests = [], []
    for (arm, correlation), share in kept.items():
        a = study_filter.ARMS[arm]
        for seed in range(seeds):
            at = {"task": "HalfCheetah", "terrain": "flat", "architecture": a.architecture}
            at |= {"variant": a.variant, "seed": seed}
            for i in (1, 500):
                curves.append(at | {"iteration": i, "steps": i * 50_000, "mean_return": 1.0})
            test = at | {"intervention": a.intervention, "test": 0}
            own = 1000.0 if a.intervention == "none" else 300.0
            tests.append(test | {"condition": "base", "correlation": 0, "return": own})
            noisy = {"condition": "noise", "correlation": correlation}
            tests.append(test | noisy | {"return": 1000.0 * share + seed})
    folder.mkdir()
    pd.DataFrame(curves).drop_duplicates().to_csv(folder / "curves.csv", index=False)
    pd.DataFrame(tests).drop_duplicates().to_parquet(folder / "tests.parquet")


@pytest.mark.parametrize(
    ("without", "verdict"), [(0.75, Verdict.REPRODUCED), (0.4, Verdict.REFUTED)]
)
def test_the_filter_study_reads_a_store(tmp_path, without, verdict):
    kept = {("CTRNN", c): 0.8 if c < 10 else 0.5 for c in study_filter.CORRELATIONS}
    kept |= {("DTRNN", c): 0.4 for c in study_filter.CORRELATIONS}
    kept |= {("DTRNN, filtered", 0): without, ("FFWD", 0): 0.4, ("FFWD, filtered", 0): without}
    kept |= {("CTRNN, fixed", 0): 1.2 - without}
    filter_store(tmp_path / "filter", kept)
    config = study_filter.Config(resamples=200, store=str(tmp_path))
    table = study_filter.predictions.run(config=config).table
    assert table.seeds.tolist() == [8] * 4
    assert table.share_of_steps.tolist() == [1.0] * 4
    assert study_filter.because_it_filters(table).verdict is verdict
    shown = study_filter.shown(study_filter.kept.run(config=config).table).set_index("network")
    assert shown.seeds.tolist() == [8] * 6
    # What the filter costs without noise stands under return; shares are of what is earned
    # without it, so that a policy which it ruins keeps little.
    filtered = shown.index.str.endswith("filtered")
    assert set(shown["return"][~filtered]) == {"1000 (0)"}
    assert set(shown["return"][filtered]) == {"300 (0)"}
    # Seed s earns s of 1000 more, which rounding hides.
    assert shown.loc["CTRNN", "noise over 100 steps"] == "0.50 (0.00)"
    assert shown.loc["DTRNN", "white noise"] == "0.40 (0.00)"


def test_the_filter_study_is_read_in_white_and_in_correlated_noise():
    def rows(arm, correlation, shares):
        return [
            study_filter.Kept(arm, correlation, s, 1.0, x, 150, 20_000)
            for s, x in enumerate(shares)
        ]

    made = [*rows("CTRNN", 0, [0.8, 0.6]), *rows("DTRNN", 0, [0.6, 0.4])]
    assert study_filter.reading(pd.DataFrame(made)) == "The policies have not all been tested yet."
    made += rows("CTRNN, fixed", 0, [0.8, 0.6])
    for time, more in ((3, 0.0), (100, 0.2)):
        made += rows("CTRNN", time, [0.7 + more, 0.5 + more])
        made += [r for arm in ("DTRNN", "CTRNN, fixed") for r in rows(arm, time, [0.5, 0.3])]
    # Welch by hand: two pairs with standard errors of 0.1 have 2 degrees of freedom, t = 4.303.
    words = study_filter.reading(pd.DataFrame(made))
    assert "keep 50% to 70% of their return under white noise" in words
    assert "CTRNNs +0.200 [−0.408, +0.808] more than DTRNNs and +0.000 [−0.608, +0.608]" in words
    assert "keep +0.300 [−0.308, +0.908] and +0.300 [−0.308, +0.908] more (Welch)" in words
    assert study_filter.budget(pd.DataFrame(made)) == (
        "150 iterations of 20,000 steps, 12% of a printed run's"
    )


def correlated_noise(lead: float, over_fixed: float, seeds: int = 16) -> pd.DataFrame:
    """Shares kept at two correlation times; seeds of an arm differ by .01 from one to the next."""
    arms = {"CTRNN": 0.5, "DTRNN": 0.5 - lead, "CTRNN, fixed": 0.5 - over_fixed}
    rows = [
        study_filter.Kept(arm, time, 16 + s, 1.0, share + 0.01 * s + shift, 150, 20_000)
        for arm, share in arms.items()
        for time, shift in ((0, 9.0), (3, -0.1), (100, 0.1))
        for s in range(seeds)
    ]
    return pd.DataFrame(rows)


@pytest.mark.parametrize(
    ("lead", "over_fixed", "seeds", "verdict"),
    [
        (0.1, 0.1, 16, Verdict.REPRODUCED),
        (0.1, 0.01, 16, Verdict.DIRECTION),
        (0.1, -0.01, 16, Verdict.INCONCLUSIVE),
        (0.1, -0.1, 16, Verdict.REFUTED),
        (0.1, 0.1, 15, Verdict.INCONCLUSIVE),
        # Welch by hand: sd .0476, standard error of a difference .0168, 30 degrees of freedom:
        # .037 is p = .036, below .05 beside a smaller p, and twice that, .072, after Holm for both.
        (0.037, 0.1, 16, Verdict.REPRODUCED),
        (0.037, 0.037, 16, Verdict.DIRECTION),
    ],
)
def test_fresh_seeds_keep_more_in_correlated_noise_or_not(lead, over_fixed, seeds, verdict):
    table = correlated_noise(lead, over_fixed, seeds)
    found = study_filter.keeps_more_in_correlated_noise(table)
    assert found.verdict is verdict
    assert f"{seeds} fresh seeds an arm, runs of 12% of the printed steps" in found.evidence


def test_fresh_seeds_are_those_from_sixteen_on(tmp_path):
    kept = {(arm, c): 0.5 for arm in ("CTRNN", "DTRNN", "CTRNN, fixed") for c in (0, 3)}
    filter_store(tmp_path / "filter", kept, seeds=18)
    config = study_filter.Config(resamples=200, store=str(tmp_path))
    assert set(study_filter.kept.run(config=config).table.seed) == set(range(16))
    fresh = study_filter.fresh.run(config=config).table
    assert set(fresh.seed) == {16, 17}
    none = study_filter.fresh.run(config=study_filter.Config(store="/nowhere")).table
    assert study_filter.keeps_more_in_correlated_noise(none).verdict is Verdict.NOT_RUN


def test_the_arm_with_fixed_time_constants_is_a_run_of_the_sweep():
    arm = study_filter.ARMS["CTRNN, fixed"]
    step = ROBOTS[study_filter.ROBOT].control_dt
    config = TrainConfig(
        study_filter.ROBOT,
        architecture=arm.architecture,
        time_constant=step,
        trainable_time_constant=False,
    )
    assert variant(config) == arm.variant


def test_power_is_the_share_of_experiments_that_find_the_difference():
    rng = np.random.default_rng(0)
    x, y = rng.normal(1.5, 1, (4000, 5)), rng.normal(0, 1, (4000, 5))
    share = (ttest_ind(x, y, axis=1).pvalue < 0.05).mean()
    assert study_seeds.power(1.5, 1, 5) == pytest.approx(share, abs=0.03)


def test_power_without_a_difference_is_the_level():
    assert study_seeds.power(0, 1, 7) == pytest.approx(0.05)


def test_enough_seeds_are_the_fewest():
    # A table of power analysis: d = 1 needs 17 a group for 80% at 5%, two-sided (Cohen 1988).
    assert study_seeds.seeds_needed(1.0, 1.0) == 17
    assert study_seeds.seeds_needed(0.001, 1.0) == study_seeds.MOST_SEEDS


def test_the_filters_time_constant_is_the_median_of_what_the_ctrnns_learned(tmp_path):
    small = {"iterations": 1, "batch_steps": 40, "horizon": 20}
    configs = [
        TrainConfig("HalfCheetah", architecture="ctrnn", seed=s, **small) for s in (0, 1, 16)
    ]
    configs += [
        TrainConfig("HalfCheetah", architecture="ctrnn", time_constant=1.0, **small),
        TrainConfig("Hopper", architecture="ctrnn", **small),
        TrainConfig("HalfCheetah", architecture="dtrnn", **small),
    ]
    sweep(configs, tmp_path / "runs", workers=1)
    curves.write(configs, tmp_path / "runs", tmp_path / "out", command="")
    learned = np.concatenate(
        [
            read_trained(tmp_path / "runs" / run_name(c)).policy.time_constants().detach().numpy()
            for c in configs[:2]
        ]
    )
    assert len(set(learned)) > 2
    found = study_filter.learned_time_constant(tmp_path / "out" / "policies.pt")
    assert found == pytest.approx(np.median(learned), rel=1e-6)


def effects(rise: tuple[float, float], own: tuple[float, float]) -> pd.DataFrame:
    """Rises under noise with intervals (low, high): RNNs less FNNs, and RNNs' own."""
    return pd.DataFrame(
        study_hills.Effect(source, name, (low + high) / 2, low, high, 0.01, 5, 5, True)
        for source in ("printed", "ours")
        for name, (low, high) in (("noise", rise), ("noise, RNNs", own))
    )


@pytest.mark.parametrize(
    ("rise", "own", "verdict"),
    [
        (HOLDS, HOLDS, Verdict.REPRODUCED),
        (HOLDS, (-0.05, 0.1), Verdict.DIRECTION),
        # RNNs gain nothing, and FNNs lose.
        (HOLDS, (-0.1, 0.05), Verdict.NOT_REPRODUCED),
        (FAILS, HOLDS, Verdict.REFUTED),
    ],
)
def test_hill_training_helps_rnns_only_if_they_gain_themselves(rise, own, verdict):
    assert study_hills.transfers(effects(rise, own)).verdict is verdict


def test_rises_of_the_share_kept_by_hand():
    """FNNs keep .5 and then .3 of their return, RNNs .5 always."""
    returns = np.ones((2, 3, len(ROBOT_NAMES), len(NETS)))
    returns[:, 1:] = 0.5
    returns[1, 1:, :, [net in GROUPS["FNNs"] for net in NETS]] = 0.3
    units = np.full((2, len(ROBOT_NAMES), len(NETS)), 5)
    made = Cells("ours", returns, returns[None], units, units > 0)
    with np.errstate(all="ignore"), pytest.warns(RuntimeWarning, match="Precision loss"):
        found = {e.name: e.value for e in study_hills._rises(made)}
    assert found["noise"] == pytest.approx(np.log(5 / 3))
    assert found["noise, RNNs"] == pytest.approx(0, abs=1e-12)


def test_what_zeroing_memory_and_the_last_action_does_is_told(tmp_path):
    config = Config(resamples=200, store=str(THESIS.write(tmp_path / "store")))
    told = study_hills.reading(study_hills.effects.run(config=config).table)
    # Of the return 0.9 is left on the flat and 0.5 on hills: log(0.9 / 0.5) = 0.588.
    assert "With no memory the loss of regular return of hill-trained RNNs" in told
    assert "is +0.59 [" in told
    assert "(5 robots, 5 seeds or more)" in told
    assert "Policies with no previous action have not been tested yet." in told


def test_effects_of_hills_are_told_apart_by_length(tmp_path):
    """Only the walkers learned for as long as the thesis's: of the rest nothing is in full."""
    store = THESIS.write(tmp_path / "store")
    for path in store.glob("**/curves.csv"):
        table = pd.read_csv(path)
        short = (table.task != "Walker2d") & (table.iteration > 1)
        table[~short].to_csv(path, index=False)
    found = study_hills.effects.run(config=Config(resamples=200, store=str(store))).table
    robots = found.groupby("source").robots.max()
    assert robots[study_hills.IN_FULL] == 1
    told = study_hills.reading_in_full(found)
    assert "alone (one robot, 5 seeds or more)" in told
    assert "without memory hill-trained RNNs lose more by +0.59" in told


def long_store(folder, kept, seeds=3, last=500):
    """Half-cheetahs of the printed length that keep ``kept``, by net, in all noise but white."""
    curves, tests = [], []
    for net, shares in kept.items():
        for seed in range(seeds):
            at = {"task": "HalfCheetah", "terrain": "flat", "architecture": net.lower()}
            at |= {"variant": "default", "seed": seed}
            for i in (1, last):
                curves.append(at | {"iteration": i, "steps": i * 50_000, "mean_return": 1.0})
            test = at | {"test": 0, "policy": "last", "intervention": "none"}
            tests.append(test | {"condition": "base", "correlation": 0.0, "return": 2000.0})
            for time in study_filter.CORRELATIONS:
                share = shares[seed] if time else 9.0
                noisy = {"condition": "noise", "correlation": float(time)}
                tests.append(test | noisy | {"return": 2000.0 * share})
    folder.mkdir(parents=True)
    pd.DataFrame(curves).to_csv(folder / "curves.csv", index=False)
    pd.DataFrame(tests).to_parquet(folder / "tests.parquet")


@pytest.mark.parametrize(
    ("ctrnn", "dtrnn", "verdict"),
    [
        # Welch by hand: standard errors of .1 / sqrt(3) each, so that .5 is t = 6.1 and .1 is 1.2.
        ((0.8, 0.9, 1.0), (0.3, 0.4, 0.5), Verdict.REPRODUCED),
        ((0.8, 0.9, 1.0), (0.7, 0.8, 0.9), Verdict.INCONCLUSIVE),
        # t = 3.0 on 4 degrees of freedom, p = .04: too little for one of two looks.
        ((0.8, 0.9, 1.0), (0.555, 0.655, 0.755), Verdict.INCONCLUSIVE),
        ((0.3, 0.4, 0.5), (0.8, 0.9, 1.0), Verdict.REFUTED),
    ],
)
def test_correlated_noise_after_the_printed_length(tmp_path, ctrnn, dtrnn, verdict):
    long_store(tmp_path / "depth", {"CTRNN": ctrnn, "DTRNN": dtrnn, "GRU": ctrnn})
    config = study_filter.Config(store=str(tmp_path))
    table = study_filter_long.kept.run(config=config).table
    assert len(table) == 3 * 3 * 5
    found = study_filter_long.keeps_more(table)
    assert found.verdict is verdict
    assert found.numbers["difference"] == pytest.approx(np.mean(ctrnn) - np.mean(dtrnn))
    # White noise leaves 9 times the return of all, so that the change is less the lead.
    lead = study_filter_long.lead(table)
    assert (lead["white"].difference, lead["white"].p_value) == (0, 1)
    assert lead["change"].difference == pytest.approx(np.mean(ctrnn) - np.mean(dtrnn))
    told = study_filter_long.reading(table)
    # What is asked twice counts at half of the level in the sentence, too.
    assert told.endswith("over 2 nets; p below 0.025 counts here too).")
    assert ("ahead of DTRNN" in told) == (verdict is Verdict.REPRODUCED)
    (panel,) = study_filter_long.draw(table).axes
    lines = {line.get_label(): line.get_ydata() for line in panel.lines}
    assert lines["DTRNN"] == pytest.approx([9.0, *[np.mean(dtrnn)] * 4])


def test_a_lead_that_shrinks_in_slow_noise_is_a_filters(tmp_path):
    """CTRNNs keep all in white noise and no more than DTRNNs in the slowest."""
    long_store(tmp_path / "depth", {"CTRNN": (0.4, 0.5, 0.6), "DTRNN": (0.4, 0.5, 0.6)})
    table = study_filter_long.kept.run(config=study_filter.Config(store=str(tmp_path))).table
    white = table.correlation == 0
    table.loc[white, "retained"] = 0.5 + 0.4 * (table.architecture == "CTRNN")[white]
    change = study_filter_long.lead(table)["change"]
    # .1 either way at the slow end alone: standard error .1 sqrt(2 / 3), t = -4.9 on 4 degrees.
    assert change.difference == pytest.approx(-0.4)
    assert change.p_value == pytest.approx(2 * stats.t.sf(0.4 / (0.1 * np.sqrt(2 / 3)), 4))
    told = study_filter_long.reading(table)
    assert "CTRNNs keep +0.40" in told
    assert "it shrinks, as a filter's would" in told
    assert "significantly ahead of no net" in told


def test_shorter_or_fewer_policies_do_not_decide_on_the_printed_length(tmp_path):
    clear = {"CTRNN": (0.8, 0.9, 1.0), "DTRNN": (0.3, 0.4, 0.5)}
    long_store(tmp_path / "short" / "breadth", clear, last=150)
    long_store(tmp_path / "few" / "depth", clear, seeds=2)
    verdicts = [
        study_filter_long.keeps_more(
            study_filter_long.kept.run(config=study_filter.Config(store=str(tmp_path / name))).table
        ).verdict
        for name in ("short", "few")
    ]
    assert verdicts == [Verdict.NOT_RUN, Verdict.INCONCLUSIVE]
    empty = study_filter_long.kept.run(config=study_filter.Config(store="/nowhere")).table
    assert study_filter_long.draw(empty).axes
