"""Every criterion passes where its claim is true and does not where it is not."""

import pandas as pd
import pytest

from tests.chapter5.worlds import NULL, OPPOSITE, THESIS, World
from thesis_lib import chapter5
from thesis_lib.chapter5 import calibration, contrasts, figure_5_4, table_5_2, table_5_6
from thesis_lib.chapter5.contrasts import Config
from thesis_lib.edition.chapters import read_chapter
from thesis_lib.edition.ledger import Verdict

#: The modules of the benchmark, which those on worlds, networks and learning precede.
CHAPTER = read_chapter(
    chapter5,
    {
        *("calibration", "contrasts", "table_5_2", "figure_5_3", "printed_length", "aggregates"),
        *("returns", "best_policy", "training_length", "figure_5_4", "figure_5_5", "table_5_6"),
        *("study_filter", "study_filter_long", "study_hills", "study_seeds"),
    },
)
CLAIMS = {claim.id: claim for claim in CHAPTER.claims}
WORLDS = {"thesis": THESIS, "null": NULL, "opposite": OPPOSITE}

#: Where a claim says that there is no difference, nets that are alike bear it out.
TRUE_OF_NULL = {
    *("5.5.2-no-single-best", "5.5.2-noise-no-best", "5.5.2-fnn-rugged", "5.5.2-hill-not-fnns"),
}
#: The world in which the others' opposite is true does not deny these.
TRUE_OF_OPPOSITE = {
    *("5.5.2-best-rnn", "5.5.2-gait-quality", "5.7-varies-across-tasks", "ch5-five-seeds"),
    "table-5.2-bold",
}
#: These are about the printed numbers alone, or need runs of another kind: tested below.
SPECIAL = {
    *("table-5.2-means", "table-5.3-is-c.1", "5.4-regular-test"),
    *("table-5.6-drops", "table-5.6-retained"),
    *("5.5.2-ctrnn-filters", "ch5-correlated-noise", "ch5-correlated-noise-long"),
    *("table-5.1-subset", "5.7-hyperparameters"),
}
ORDINARY = sorted(set(CLAIMS) - SPECIAL)
#: The calibration reads a store of its own (test_calibration).
BENCHMARK = [e for e in CHAPTER.experiments if e is not calibration.readings]


def as_printed(table: pd.DataFrame) -> pd.DataFrame:
    """Runs of a world told as if the thesis printed them, beside themselves."""
    if "ours_leads" in table:
        return table.assign(
            printed=table.ours, printed_error=table.error, leads=table.ours_leads, note=""
        )
    if "source" not in table:
        return table
    ours = table[table.source == "ours"]
    bounds = {}
    if "printed_low" in ours:
        bounds = {"printed_low": ours.low, "printed_high": ours.high}
    printed = ours.assign(source="printed", **bounds)
    return pd.concat([printed, ours], ignore_index=True)


def made(world: World, folder) -> dict[str, pd.DataFrame]:
    config = Config(resamples=1000, store=str(world.write(folder)))
    return {e.id: as_printed(e.run(config=config).table) for e in BENCHMARK}


@pytest.fixture(scope="module")
def worlds(tmp_path_factory) -> dict[str, dict[str, pd.DataFrame]]:
    return {n: made(w, tmp_path_factory.mktemp(n) / "store") for n, w in WORLDS.items()}


@pytest.fixture(scope="module")
def printed() -> dict[str, pd.DataFrame]:
    """The thesis's numbers and no runs."""
    config = Config(resamples=1000, store="/nowhere")
    return {e.id: e.run(config=config).table for e in BENCHMARK}


@pytest.mark.parametrize("claim", ORDINARY)
def test_passes_where_it_is_true(claim, worlds):
    found = CLAIMS[claim].judge(worlds["thesis"])
    assert found.verdict is Verdict.REPRODUCED, found.evidence


@pytest.mark.parametrize("claim", ORDINARY)
def test_does_not_pass_where_it_is_not(claim, worlds):
    found = CLAIMS[claim].judge(worlds["opposite" if claim in TRUE_OF_NULL else "null"])
    assert found.verdict not in (Verdict.REPRODUCED, Verdict.NOT_RUN), found.evidence


@pytest.mark.parametrize("claim", sorted(set(ORDINARY) - TRUE_OF_OPPOSITE))
def test_is_denied_or_not_shown_where_the_opposite_is_true(claim, worlds):
    found = CLAIMS[claim].judge(worlds["opposite"])
    assert found.verdict in (Verdict.REFUTED, Verdict.NOT_REPRODUCED), found.evidence


@pytest.mark.parametrize("claim", ORDINARY)
def test_without_runs_nothing_is_reproduced(claim, printed):
    found = CLAIMS[claim].judge(printed)
    assert found.verdict in (Verdict.NOT_RUN, Verdict.REFUTED, Verdict.NOT_REPRODUCED)
    assert "Ours have not all been run yet." in found.evidence
    assert "nan" not in found.evidence


@pytest.mark.parametrize(
    ("claim", "says"),
    [
        # From a second reader's own bootstrap of the printed tables.
        ("5.5.1-fnn-fastest", "bear it out: FNNs less RNNs +0.32"),
        ("5.5.1-dtrnn-best-rnn", "in direction only: DTRNN less CTRNN +0.06"),
        ("5.5.1-vanilla-over-gated", "bear it out: vanilla RNNs less gated RNNs +0.13"),
        ("5.5.2-noise-flat", "in direction only: CTRNN less ESN +0.061"),
        ("5.5.2-noise-hill", "in direction only: CTRNN less DTRNN +0.188"),
        ("1.4-ctrnn-noise", "deny it: trained on flat: CTRNN less DFFWD -0.05"),
        ("5.5.2-switch-flat-fnn", "bear it out: DFFWD less CTRNN +0.109"),
        ("5.5.2-hopper-worst", "bear it out"),
        ("5.5.2-cheetah-robust", "in direction only"),
        ("1.4-hill-rnn-not-fnn", "bear it out"),
        (
            "table-5.2-bold",
            "in direction only: one net is significantly better than all others on 0 of 10",
        ),
    ],
)
def test_what_the_printed_tables_say(claim, says, printed):
    assert says in CLAIMS[claim].judge(printed).evidence


def test_the_printed_tables_deny_the_headline_on_noise(printed):
    assert CLAIMS["1.4-ctrnn-noise"].judge(printed).verdict is Verdict.REFUTED


def test_the_printed_tables_differ_in_one_cell(printed):
    found = CLAIMS["table-5.3-is-c.1"].judge(printed)
    assert found.verdict is Verdict.REFUTED
    assert "1 of 70 cells differ: Hopper flat, CTRNN: 2351.4 and 2331.4" in found.evidence
    same = printed | {"table-5.3": printed["table-c.1"]}
    assert CLAIMS["table-5.3-is-c.1"].judge(same).verdict is Verdict.REPRODUCED


def test_hill_trained_swimmers_were_tested_on_the_flat(printed):
    assert CLAIMS["5.4-regular-test"].judge(printed).verdict is Verdict.REFUTED
    on_hills = printed | {"table-c.1": printed["table-c.3"]}
    assert CLAIMS["5.4-regular-test"].judge(on_hills).verdict is Verdict.REPRODUCED
    a_third_more = printed["table-c.3"].assign(printed=1.3 * printed["table-c.3"].printed)
    unclear = CLAIMS["5.4-regular-test"].judge(printed | {"table-c.1": a_third_more})
    assert unclear.verdict is Verdict.NOT_REPRODUCED


def test_table_5_6_is_no_ratio_of_drops(printed):
    found = CLAIMS["table-5.6-drops"].judge(printed)
    assert found.verdict is Verdict.REFUTED
    assert "mean ratio of retained shares: 14 of 14 centres inside" in found.evidence
    assert CLAIMS["table-5.6-retained"].judge(printed).verdict is Verdict.REPRODUCED
    table = printed["table-5.6"].copy()
    drops = table.formula == table_5_6.DROPS
    table.loc[drops, "value"] = (table.printed_low + table.printed_high)[drops] / 2
    found = CLAIMS["table-5.6-drops"].judge({"table-5.6": table})
    assert found.verdict is Verdict.REPRODUCED
    table.loc[table.formula == table_5_6.RETAINED, "value"] **= -1
    found = CLAIMS["table-5.6-retained"].judge({"table-5.6": table})
    assert found.verdict is Verdict.REFUTED


def test_printed_means_are_compared_at_the_printed_budget_alone(worlds, printed):
    claim = CLAIMS["table-5.2-means"]
    assert claim.judge(printed).verdict is Verdict.NOT_RUN
    # As printed: our own means, to their standard errors.
    table = worlds["thesis"]["table-5.2"].assign(p_printed=1.0)
    assert claim.judge({"table-5.2": table}).verdict is Verdict.REPRODUCED
    half = table.assign(printed=2 * table.ours)
    assert claim.judge({"table-5.2": half}).verdict is Verdict.INCONCLUSIVE
    other = half.assign(p_printed=0.0001)
    assert claim.judge({"table-5.2": other}).verdict is Verdict.REFUTED
    shallow = table.assign(printed_budget=False)
    assert claim.judge({"table-5.2": shallow}).verdict is Verdict.INCONCLUSIVE


def test_printed_means_by_which_settings_were_chosen_are_a_fit_and_decide_nothing(worlds):
    table = worlds["thesis"]["table-5.2"].assign(p_printed=1.0)
    chosen = table.task.isin(["HalfCheetah", "Hopper"]) & (table.trained_on == "flat")
    table.loc[chosen, "printed"] *= 2
    claim = CLAIMS["table-5.2-means"]
    found = claim.judge({"table-5.2": table})
    assert found.verdict is Verdict.REPRODUCED
    assert "hold the printed mean of 0; " in found.evidence  # of the 14 that were fitted
    alone = table.assign(printed_budget=chosen)
    assert claim.judge({"table-5.2": alone}).verdict is Verdict.INCONCLUSIVE


@pytest.mark.parametrize(("seeds", "iterations"), [(2, 500), (5, 150)])
def test_few_seeds_or_steps_refute_nothing(seeds, iterations, tmp_path):
    folder = OPPOSITE.write(tmp_path / "store", seeds=seeds, iterations=iterations)
    tables = {
        e.id: e.run(config=Config(resamples=1000, store=str(folder))).table
        for e in (contrasts.comparisons, table_5_6.ratios)
    }
    for claim in ("5.5.1-fnn-fastest", "5.5.2-switch-flat-fnn", "1.4-hill-rnn-not-fnn"):
        found = CLAIMS[claim].judge(tables)
        assert found.verdict is Verdict.INCONCLUSIVE, found.evidence
        assert "too few or too short to tell" in found.evidence


@pytest.mark.parametrize("claim", ["5.5.2-cheetah-robust", "5.5.2-hopper-worst"])
def test_robots_that_have_not_run_on_hills_are_not_compared(claim, worlds):
    def without(robot: str) -> dict[str, pd.DataFrame]:
        table = worlds["thesis"][figure_5_4.scores.id]
        left_out = (table.source == "ours") & (table.task == robot) & (table.trained_on == "hill")
        return worlds["thesis"] | {figure_5_4.scores.id: table[~left_out]}

    found = CLAIMS[claim].judge(without("Swimmer"))
    assert found.verdict is Verdict.INCONCLUSIVE
    assert (
        "Our runs (5 seeds or more, 4 of 5 robots) are too few or too short to tell"
        in found.evidence
    )
    own = "HalfCheetah" if claim == "5.5.2-cheetah-robust" else "Hopper"
    assert CLAIMS[claim].judge(without(own)).verdict is Verdict.NOT_RUN


def test_each_claim_has_a_world_or_a_test_of_its_own():
    assert set(CLAIMS) >= SPECIAL | TRUE_OF_NULL
    assert len(CLAIMS) >= 45


def test_ratios_to_the_printed_means_by_hand():
    """Ratios 1.5 and .5 with relative errors (.3 and 1.5 x .2) and (.1 and .5 x .2)."""
    cells = pd.DataFrame(
        {
            "architecture": ["GRU", "GRU"],
            "ours": [150.0, 5.0],
            "error": [30.0, 1.0],
            "printed": [100.0, 10.0],
            "printed_error": [20.0, 2.0],
        }
    )
    found = table_5_2._ratios(cells).loc["GRU"]
    assert found.ratio == pytest.approx(1.0)
    assert found.error == pytest.approx((0.09 + 0.09 + 0.01 + 0.01) ** 0.5 / 2)
